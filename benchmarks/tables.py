"""The tables of the README and of the pages in docs, from the JSON files in `benchmarks/results`.

`python -m benchmarks.tables` from the repository's root rewrites the text on each page between `<!-- table:NAME -->` and
`<!-- end -->`. A figure that a record lacks is a dash. Tables of the README, docs/first-cable.md, docs/accuracy.md,
docs/compared.md and docs/theory.md are here; those of the other pages are in their own modules.
"""

import math
import re
from pathlib import Path

from benchmarks import exports_tables, mistakes_tables, robustness_tables, scanning_tables, sweep_tables, tip_weights_tables
from benchmarks.markdown import load, made_on, table
from benchmarks.peers import tables as peers_tables

ROOT = Path(__file__).parents[1]
README, DOCS = ROOT / "README.md", ROOT / "docs"
_PART = re.compile(r"(<!-- table:([a-z]+) -->\n).*?(<!-- end -->)", re.DOTALL)


def milliseconds(seconds) -> str:
    return "-" if seconds is None else f"{1e3 * seconds:.1f} ms"


def equilibrium() -> str:
    """Times of one equilibrium with 40 elements, of its Jacobian, its growth with the mesh, and the first call."""
    entry = load("equilibrium")
    r = entry["results"]
    rows = []
    for pose, t in r.get("solves", {}).items():
        for start in ("generic", "warm"):
            words = {"generic": "generic start", "warm": "start at the solution"}[start]
            rows.append([f"pose `{pose}`, {words}", milliseconds(t[start]["min_s"]), f"{t[start]['steps']} steps"])
        rows.append([f"pose `{pose}`, BFGS", milliseconds(t["bfgs generic"]["min_s"]), f"{t['bfgs generic']['steps']} steps"])
    for start, t in r.get("jacobian", {}).items():
        for count in ("2", "12"):
            j = t[f"points and jacobian, {count} parameters"]
            share = f"{100 * j['jacobian over forward']:+.0f} % of the shape alone"
            rows.append([f"shape and Jacobian of {count} parameters, {start} start", milliseconds(j["min_s"]), share])
    if "growth" in r:
        meshes = r["growth"]["meshes"]
        n = list(meshes)[-1]
        power = f"a step grows with the power {r['growth']['exponent of the time of a step']:.2f} of the elements"
        rows.append([f"{n} elements, generic start", milliseconds(meshes[n]["generic"]["min_s"]), power])
    if "batch" in r:
        b = r["batch"]
        mean, most, group = b["steps: mean, most, of a group"]
        told = {"loop": f"{b['solved']} solved", "loop in one call": f"{mean:.1f} steps each", "vmap": f"{most:.0f} steps each"}
        told |= {way: f"like GJ/EI, {group:.1f} steps each" for way in b if way.startswith("vmap, ")}
        for way, words in told.items():
            rows.append([f"each of {b['cables']} cables, {way} (processor time)", milliseconds(b[way]["s per cable"]), words])
    for name, words in (("compiling", "first call, compiling"), ("from the cache", "first call, from the compilation cache")):
        rows.append([words, f"{r['first call'][name]['first_s']:.1f} s", "imports left out"])
    return table(["one equilibrium", "least time", "what it took"], rows) + made_on(entry)


def fit() -> str:
    """Each method from the paper's 25 guesses."""
    entry = load("fit")
    rows = []
    for name, r in entry["results"].items():
        if isinstance(r, dict) and "recovered" in r:
            figures = (f"{r['recovered']} of {r['guesses']}", f"{r['median equilibria']:.0f}", f"{r['median_s']:.2f}")
            rows.append([name, *figures, f"{r['seconds']:.0f}"])
    head = ["method", "recovered", "equilibria (median)", "seconds (median)", "seconds (all guesses)"]
    return table(head, rows) + made_on(entry)


_BLIND = (  # key, words, target
    ("false_alarms", "nothing missing: alarms at the 5 % level", "3-8 %"),
    ("detected_above_0.7", "one or two effects of strength above 0.7: detected", "95 %"),
    ("truth_in_tie_set_6_poses", "one effect, six poses or more: in the tie set", "90 %"),
    ("truth_in_tie_set", "one effect, all cases: in the tie set", "-"),
    ("mean_tie_set", "effect types in a tie set, mean", "2 at most"),
    ("top_1", "one effect: ranked first", "85 %"),
    ("top_1_above_1.5", "the same, strength above 1.5", "95 %"),
    ("named_and_wrong", "named alone, and wrong", "2 % at most"),
    ("both_of_a_pair", "two effects: both found", "80 %"),
    ("both_tied", "two effects: both in the tied sets", "-"),
    ("one_of_a_pair", "two effects: at least one in the tie set", "-"),
    ("off_catalogue_flagged", 'an effect that no catalogue has: answered "unexplained"', "75 %"),
    ("off_catalogue_field", "the same, or a field that describes it tied with the effects named", "-"),
    ("fit_within_5_percent", "ranked first and right: RMS after within 5 % of the noise", "all"),
    ("validate_better", "poses never fitted: predicted better than before", "90 %"),
    ("validate_within_1.15", "ranked first and right: those within 1.15 of the noise", "all"),
    ("validate_within_1.15_no_tolerance", "the same in studies without tolerances (a new pose's clamps deviate too)", "all"),
    ("place_within_2_percent", "right effect type with a position along the cable: within 2 % of the length", "all"),
    ("place_within_2_percent_if_seen", "the same, where its standard error is below 1 % of the length", "-"),
    ("place_covered", "95 % intervals of positions that hold the truth", "-"),
    ("coverage_95", "95 % intervals of EI and GJ that hold the truth, after", "92-97 %"),
)
_BACKGROUND = (
    ("background_alone_named", "background alone, and something named", "5 % at most"),
    ("background_in_tie_set", "one effect above it: in the tie set", "85 %"),
    ("background_missed_for_a_mistake", "not in it, since a likely mistake of the input was reported", "-"),
    ("background_named_and_wrong", "named, and wrong", "-"),
    ("background_size_within_15_percent", "one effect: in the tie set, and its size within 15 %", "80 %"),
    ("background_validate_within_1.3", "one effect: poses never fitted within 1.3 of the error of the true model", "80 %"),
    ("background_discrepancy_over_true_median", "reported over true scatter, median", "-"),
    ("background_coverage_95_alone", "95 % intervals of EI and GJ that hold the truth: background alone", "92-97 %"),
    ("background_coverage_95_with_effect", "the same with an effect, after it is searched", "92-97 %"),
    ("background_parameters_covered", "95 % intervals of the effect's parameters that hold the truth", "92-97 %"),
    ("background_coverage_95_plain_fit_alone", "the same of the baseline fit, background alone", "92-97 %"),
    ("background_coverage_95_plain_fit_with_effect", "the same of the baseline fit, before an effect is known", "92-97 %"),
)

_IDEAL = (
    ("expected_size_within_15_percent", "an efficient estimator that knows effect type and background: size within 15 %", "-"),
    ("expected_validate_within_1.3", "the same: poses never fitted within 1.3 of the error of the true model", "-"),
)

_SCANS_NONE = (
    ("alarms_scan", "nothing missing: scans that raise an alarm at the 5 % level", "3 of 40 at most"),
    ("alarms_curve", "the same poses as curves", "-"),
    ("covered_scan", "nothing missing: 95 % intervals of EI and GJ from scans that hold the truth", "92-97 %"),
    ("covered_curve", "the same from curves", "92-97 %"),
)
_SCANS_STRONG = (
    ("named_curve", "a strong effect: named alone from curves", "-"),
    ("named_scan", "from scans", "-"),
    ("right_scan", "from scans, and rightly", "-"),
    ("named_as_from_curves", "from scans as from curves", "16 of 20"),
    ("answered_as_from_curves", "the same answer as from curves, ties and unexplained cases included", "-"),
)


def _lines(t, keys) -> list[list[str]]:
    """Rows of shares with their counts, and of other numbers."""
    rows = []
    for key, words, wanted in keys:
        v = t[key]
        if isinstance(v, dict):
            rows.append([words, "-" if v["share"] is None else f"{100 * v['share']:.1f} % of {v['of']}", wanted])
        else:
            rows.append([words, "-" if v is None else f"{v:.2f}", wanted])
    return rows


def background() -> str:
    """The loop on blind cases with a random deviation of each pose: the record `background` of `benchmarks.blind_score`."""
    entry, ideal = load("background"), load("background_ideal")["results"]["table"]
    rows = _lines(entry["results"]["table"], _BACKGROUND) + _lines(ideal, _IDEAL)
    return table(["", "measured", "target"], rows) + made_on(entry)


def scans() -> str:
    """The loop on scans and on curves of the same poses: records `scan_none` (nothing missing) and `scan_alarms` (strong)."""
    none, strong = load("scan_none"), load("scan_alarms")
    rows = _lines(none["results"]["table"], _SCANS_NONE) + _lines(strong["results"]["table"], _SCANS_STRONG)
    return table(["", "measured", "target"], rows) + made_on(none, "Nothing missing: ") + made_on(strong, "Strong effects: ")


def blind() -> str:
    """The loop on blind cases of an independent simulator."""
    entry = load("blind")
    t = entry["results"]["table"]
    rows = _lines(t, _BLIND)
    rows.insert(1, _calibrated())
    rows += _cost(t)
    rows.append(["cases, of them ended by a fault", f"{t['cases']}, {t['faults']}", "-"])
    return table(["", "measured", "target"], rows) + made_on(entry)


def _cost(t) -> list[list[str]]:
    """Rows of the time of a case, and of the memory of a process of many."""
    rows = [["seconds for a case: mean, most", f"{t['seconds_mean']:.0f}, {t['seconds_most']:.0f}", "60 at most"]]
    if t.get("processor_seconds_mean"):
        figures = f"{t['processor_seconds_mean']:.0f}, {t['processor_seconds_most']:.0f}"
        rows.append(["the same in seconds of processor time, compilation included", figures, "-"])
    if t.get("memory"):
        m = t["memory"]
        words = f"memory of one process with {m['studies']} cases: after 20, at most afterwards, at the end"
        rows.append([words, f"{m['after_20']:,.0f}, {m['most']:,.0f}, {m['last']:,.0f} MiB", "flat"])
    return rows


def _calibrated() -> list[str]:
    """The rate of false alarms in all cases with nothing missing."""
    c = load("calibration")["results"]
    words = "the same in all such cases of three seeds, opened before"
    return [words, f"{100 * c['share']:.1f} % of {c['cases']} ({100 * c['low']:.1f} to {100 * c['high']:.1f} %)", "3-8 %"]


def firstuse() -> str:
    """Whole commands with an empty and a filled cache of compiled functions."""
    entry = load("first_use")
    rows = [[f"`{n}`" if n == "demo" else n, *(f"{v:.0f} s" for v in r.values())] for n, r in entry["results"].items()]
    return table(["whole command", "empty cache", "filled cache"], rows) + made_on(entry)


def phases() -> str:
    """Processor seconds of a first command by phase."""
    entry = load("phases")
    names = ("importing", "tracing", "lowering", "compiling", "rest", "all")
    rows = [
        [f"`{command}`, {state}", *(f"{found.get(name, 0.0):.1f}" for name in names)]
        for command, states in entry["results"].items() for state, found in states.items()
    ]  # fmt: skip
    return table(["processor seconds", *names], rows) + made_on(entry)


def sensitivity() -> str:
    """Recovery from grids of guesses, and errors of the estimates under turned clamps."""
    entry = load("sensitivity")
    r, rows = entry["results"], []
    for name, g in r["guesses"].items():
        some = "" if g["run"] == g["guesses"] else f" (a random {g['run']} of {g['guesses']:,})"
        found = f"{g['recovered']:,} of {g['run']:,} recovered{some}"
        took = f"{g['median equilibria']:.0f} equilibria, {g['median_s']:.1f} s (medians)"
        rows.append([f"guesses {name}{_earlier(g)}", found, took])
    for name, c in r["clamps"].items():
        own = {letter: c[k] for letter, k in (("EI", "bending_stiffness"), ("GJ", "torsional_stiffness")) if k in c}
        means = ", ".join(_percent(x["mean"], x["standard error"]) for x in own.values())
        below = "below the truth: " + ", ".join(f"{100 * x['underestimated']:.0f} %" for x in own.values())
        below += f", both {100 * c['both underestimated']:.0f} %" if "both underestimated" in c else ""
        if all("linear in the turns" in x for x in own.values()):
            below += "; linear in the turns: " + ", ".join(f"{100 * x['linear in the turns']:.0f} %" for x in own.values())
        rows.append(
            [f"clamps turned, {name} ({c['draws']:,} draws{_earlier(c)}): mean error of {', '.join(own)}", means, below]
        )
    for name, c in r.get("natural curvature", {}).items():
        rows.append([f"natural curvature {name}", f"{c['recovered']} of {c['starts']} starts recovered", ""])
    for c in r.get("cantilever", {}).values():
        low, high = c["measured over formula, EI/(w L^3) above 1"]
        power = f"grows with the power {c['power of EI/(g rhoA), stiff half']:.2f} of EI/(g rhoA)"
        rows.append(["cantilever: error of EI over the formula, EI/(w L^3) above 1", f"{low:.3f} to {high:.3f}", power])
    return table(["sensitivity", "", ""], rows) + made_on(entry)


def _earlier(figures) -> str:
    """A note on figures that come from a sweep of the previous release."""
    return ", earlier run" if figures.get("by") == "the release before" else ""


def _percent(log, error) -> str:
    """The mean of a logarithm and its standard error, as a change in per cent."""
    return f"{100 * math.expm1(log):+.2f} ± {100 * math.exp(log) * error:.2f} %"


def kinect() -> str:
    """Wires on depth images: error of poses that were fitted, and of poses that were not."""
    entry = load("kinect_wires")
    rows = []
    for wire, r in entry["results"].items():
        whole, (rod, mujoco) = r["all fitted"], r["published, percent"]
        seen = f"{100 * whole['mean over poses']:.1f} %" if "mean over poses" in whole else "-"
        left_out = [r[name] for name in ("as read", "within tolerances", "explained, within tolerances")]
        unseen = [
            "-" if e["mean"] is None else f"{100 * e['mean']:.1f} % ({100 * e['worst']:.1f} %) of {e['of']}" for e in left_out
        ]
        rows.append([wire, seen, f"{rod} %, {mujoco} %", *unseen])
    head = ["mean node error over length", "all four fitted", "published: adapted rod, MuJoCo",
            "left out, clamps as read: mean (worst) of poses solved", "left out, clamps within tolerances",
            "the same, with what `explain` finds"]  # fmt: skip
    return table(head, rows) + made_on(entry)


def answer() -> str:
    """The lines that a first fit prints, as `benchmarks.front_page` recorded them."""
    return "```text\n" + "\n".join(load("front_page")["results"]["lines"]) + "\n```\n"


_STARTS = {
    "curves": "[centre curves or scans in mm, clamp frames of a robot](#curves-and-robot-frames)",
    "markers": "[markers of a motion-capture system](#markers)",
    "arrays": "[arrays in Python](python.md#a-study-from-arrays)",
}


def newcomer() -> str:
    """From a fresh clone to the first stiffness."""
    entry = load("newcomer")
    r = entry["results"]
    rows = [["clone and install", 2, f"{r['clone'] + r['install']:.0f} s"]]
    rows += [[words, r[name]["commands"], f"{r[name]['seconds']:.0f} s"] for name, words in _STARTS.items()]
    return table(["you have", "commands", "first time"], rows) + made_on(entry)


def laws() -> str:
    """Each law of the independent solver: band, error of the moment, and what is said of it."""
    entry = load("laws")
    rows = []
    for law in dict.fromkeys(r["law"] for r in entry["results"]["cases"]):
        own = [r for r in entry["results"]["cases"] if r["law"] == law]
        told = [r for r in own if "failed" not in r]
        if not told:
            rows.append([law, f"0 of {len(own)}", "-", "-", "-"])
            continue
        held = f"{100 * sum(r['coverage'] for r in told) / len(told):.0f} %"
        said = f"{sum(r['linear'] for r in told)} of {len(told)}"
        rows.append([law, f"{len(told)} of {len(own)}", held, f"{100 * max(r['error'] for r in told):.1f} %", said])
    head = ["law of the shapes", "cables fitted", "curvatures whose band holds it", "largest error", "said linear"]
    return table(head, rows) + made_on(entry)


def memory() -> str:
    """Cables that remember, and cables that do not: named or not, the loop, and the pose to come."""
    entry = load("memory")
    r, s = entry["results"], entry["results"]["summary"]

    def share(key):
        found, of = s[key]
        return f"{100 * found / of:.0f} % of {of}"

    took = ", ".join(f"{v['clock']:.1f}" for v in r["seconds of fits"].values())
    rows = [
        ["memory that moves the poses by three times the noise or more: named", share("named, memory clear"), "80 %"],
        ["no memory: not named", share("not named, no memory"), "95 %"],
        ["the next pose predicted better than without memory", share("next pose better"), "90 %"],
        ["area of the hysteresis loop within 15 %", share("loop area within 15 %"), "all"],
        *([f"the same, {law}", f"{of[0]} of {of[1]}", "-"] for law, of in s["loop area within 15 %, by law"].items()),
        ["area of the loop over the true one, median", f"{s['loop area over the true one, median']:.2f}", "0.85 to 1.15"],
        ["seconds of a fit with 5, 10, 20 poses", took, "30 s for 20"],
    ]
    return table(["", "measured", "target"], rows) + made_on(entry)


def ratios() -> str:
    """Error of the elements by ratio of stiffnesses, with their law and with the one that faded."""
    entry = load("stiffness_ratios")
    r = entry["results"]
    usual = r["meshes"].index(40)

    def largest(families, ratio, law, mesh):
        off = [pose[law][mesh] for family in families for pose in r["families"][family][ratio].values()]
        return "not solved" if None in off else f"{max(off):.1e}"

    soft = [family for family in r["families"] if family.endswith("soft")]
    groups = [[family for family in r["families"] if family not in soft], soft]
    rows = []
    for ratio in r["families"][soft[0]]:
        cells = [[*(largest(g, ratio, "error", i) for i in range(3)), largest(g, ratio, "stiffened", usual)] for g in groups]
        rows.append([ratio, *cells[0], *cells[1]])
    head = ["ratio", *(f"{n} elements" for n in r["meshes"]), "40, fading law"]
    return table(head + [f"soft: {words}" for words in head[1:]], rows) + made_on(entry)


PAGES = {
    README: {"answer": answer},
    DOCS / "first-cable.md": {"newcomer": newcomer},
    DOCS / "accuracy.md": {
        "blind": blind,
        "background": background,
        "scans": scans,
        "tipweights": tip_weights_tables.brief,
        "kinect": kinect,
        "sensitivity": sensitivity,
        "equilibrium": equilibrium,
        "firstuse": firstuse,
        "phases": phases,
    },
    DOCS / "compared.md": {"fit": fit},
    DOCS / "theory.md": {"ratios": ratios},
    DOCS / "adding-an-effect.md": {"laws": laws},
    DOCS / "missing-effects.md": {"memory": memory},
}
"""The tables made here, by page, in the order of the page."""
_OTHERS = (
    scanning_tables, sweep_tables, peers_tables, robustness_tables, mistakes_tables, tip_weights_tables, exports_tables,
)  # fmt: skip


def pages() -> dict:
    """Every page with its tables, in the order of the page."""
    return PAGES | {m.PAGE: m.TABLES for m in _OTHERS}


def filled(text: str, tables: dict) -> str:
    """The text with its tables made anew."""
    return _PART.sub(lambda m: m[1] + tables[m[2]]() + m[3], text)


def main() -> None:
    for page, tables in pages().items():
        page.write_text(filled(page.read_text(), tables))


if __name__ == "__main__":
    main()
