"""The tables of docs/peers.md: other programs on the same cables, ways to fit, the arithmetic. See `benchmarks.tables`."""

from pathlib import Path

from benchmarks.markdown import load, made_on, table

PAGE = Path(__file__).parents[2] / "docs" / "peers.md"


def ratios() -> str:
    """Time at equal accuracy and error at equal mesh of every program, both over ours."""
    entry = load("peers")
    results, rows = entry["results"], []
    for name, about in results["peers"].items():
        own = [r for r in results["runs"] if r["peer"] == name]
        done = [r["error"] for r in own if "failed" not in r and r.get("rest to", 0.0) is not None]
        if not done:
            rows.append([name, about.get("missing") or about.get("failed") or about["what"], *["-"] * 5])
            continue
        r = results["ratios"].get(name, {})  # ours has none
        keys = ("seconds over ours at equal accuracy", "error over ours at equal mesh")
        spread = ["-" if r.get(k) is None else f"{_times(r[k]['median'])} ({_times(r[k]['least'])})" for k in keys]
        runs = f"{len(done)}" + (f", {len(own) - len(done)} failed" if len(own) > len(done) else "")
        memory = f"{about['memory_MB']:.0f} MB" if "memory_MB" in about else "-"
        rows.append([name, about["what"], runs, f"{min(done):.1e}", *spread, memory])
    head = ["program", "how", "runs", "least error", "time over ours, as accurate", "error over ours, same mesh", "memory"]
    return table(head, rows) + made_on(entry)


def _times(x):
    return f"{x:,.0f}" if x >= 10 else f"{x:.2g}"


def runs() -> str:
    """Processor time and error of every program and mesh, per problem; at the tightest tolerance of rest that was reached."""
    entry = load("peers")
    rows, problems = [], list(entry["results"]["problems"])
    kept = {}
    for r in entry["results"]["runs"]:
        if "failed" not in r and r.get("rest to", 0.0) is not None:
            kept[r["peer"], r["size"], r["problem"]] = r  # tolerances of rest come from loose to tight
    for peer, size in dict.fromkeys((peer, size) for peer, size, _ in kept):
        cells = [kept.get((peer, size, problem)) for problem in problems]
        rows.append([f"{peer}, {size:g}", *("-" if c is None else f"{_time(c['seconds'])}, {c['error']:.1e}" for c in cells)])
    return table(["program, elements (or tolerance)", *problems], rows) + made_on(entry)


def _time(seconds):
    return f"{1e3 * seconds:.2g} ms" if seconds < 0.1 else f"{seconds:.2g} s"


def fits() -> str:
    """Ways to fit with the same equilibrium solver."""
    entry = load("peers")
    rows = [
        [
            way, f"{f['recovered']} of {f['guesses']}", f"{f['median equilibria']:.0f}", f"{f['median_s']:.2f}",
            f"{f['equilibria over the first']:.2g}", f"{f['seconds over the first']:.2g}",
        ]
        for way, f in entry["results"]["fits"].items()
    ]  # fmt: skip
    head = [
        "way",
        "recovered",
        "equilibria (median)",
        "processor s (median)",
        "equilibria over the first",
        "time over the first",
    ]
    return table(head, rows) + made_on(entry)


def arithmetic() -> str:
    """Operations of a step and of a solve, and the share of the processor's peak for such small blocks."""
    entry = load("peers")
    limits = entry["results"]["limits"]
    rows = []
    for part, r in limits["parts"].items():
        shares = [f"{100 * r[k]:.1f} %" if k in r else "-" for k in ("share of one block at a time", "share of eight at once")]
        rate = f"{r['operations per second'] / 1e9:.2f} G/s"
        rows.append([part, f"{r['arithmetic']:,}", f"{1e6 * r['seconds']:.0f} us", rate, *shares])
    for name, rate in limits["peak (1/s)"].items():
        if name != "missing":
            rows.append([f"6x6 blocks, {name.replace('_', ', ')}", "-", "-", f"{rate / 1e9:.1f} G/s", "-", "-"])
    head = ["part", "operations", "processor time", "rate", "of products, one at a time", "of products, eight at once"]
    return table(head, rows) + made_on(entry)


def kernel() -> str:
    """The solver in JAX and the compiled one, taken in turn."""
    entry = load("kernel")
    r = entry["results"]
    rows = []
    for pose, t in r["single"].items():
        for start, words in (("generic", "generic start"), ("warm", "start at the solution")):
            rows.append(_beside(f"pose `{pose}`, {words}", t[f"{start}, JAX"]["min_s"], t[f"{start}, kernel"]["min_s"]))
    for clamps, words in (("the same clamps", "between the same clamps"), ("each its own", "each between its own clamps")):
        t = r["batch"][clamps]
        each = (t[way]["s per cable"] for way in ("JAX, loop in one call", "kernel, vmap"))
        rows.append(_beside(f"each of {r['batch']['cables']} cables of one call, {words}, {t['steps']:.1f} steps", *each))
    for fit, words in (("first_s", "the first in its process"), ("later_s", "compiled before")):
        rows.append(_beside(f"fit of the simulated cable, {words}", *(r["fits"][way][fit] for way in ("JAX", "kernel"))))
    steps = r["limits"]["JAX"], r["limits"]["kernel"]
    rows.append(_beside("a Newton step", *(x["s"] for x in steps)))
    rows.append(["its operations", *(f"{x['operations of a step']:,}" for x in steps), "-"])
    if all("share of eight at once" in x for x in steps):
        shares = (f"{100 * x['share of eight at once']:.1f} %" for x in steps)
        rows.append(["its rate, of products, eight at once", *shares, "-"])
    return table(["40 elements, least time", "in JAX", "compiled", "ratio"], rows) + made_on(entry)


def _beside(what, jax, compiled):
    scale, unit = (1.0, "s") if jax > 1.0 else (1e3, "ms")
    return [what, f"{scale * jax:.3g} {unit}", f"{scale * compiled:.3g} {unit}", f"{jax / compiled:.1f}"]


TABLES = {"ratios": ratios, "runs": runs, "fits": fits, "arithmetic": arithmetic, "kernel": kernel}
