"""The tables of the README and of the pages in docs: from the JSON files in `benchmarks/results`, and the keys of a study.

`python -m benchmarks.tables` from the repository's root rewrites the text on each page between `<!-- table:NAME -->` and
`<!-- end -->`. A table is a function of the results of its records that yields rows, below the decorator `table`.
"""

import math
import re
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from benchmarks import blind_score, scan_alarms
from benchmarks.record import load
from scan2flex_jax.study.kinds import KEYS

ROOT = Path(__file__).parents[1]
README, DOCS = ROOT / "README.md", ROOT / "docs"
PAGES: dict[Path, dict[str, Callable[[], str]]] = {}
"""By page, the functions that write its tables, in the order of the page."""
_PART = re.compile(r"(<!-- table:([a-z]+) -->\n).*?(<!-- end -->)", re.DOTALL)
MEASURED = ("", "measured", "target")


def markdown(head: Iterable[str], rows: Iterable[Iterable]) -> str:
    """A table; None is a dash."""
    cells = [list(head), ["---"] * len(list(head)), *(["-" if x is None else str(x) for x in row] for row in rows)]
    return "".join(f"| {' | '.join(row)} |\n" for row in cells)


def table(page: str, name: str, head: tuple, *records: str, note: str | Callable[..., str] = ""):
    """Declare the table ``name`` of a page: the decorated function makes its rows of the results of ``records``. ``note``: a
    sentence below the table with keys of the first record's results in braces, or a function of all results that writes it."""

    def declared(rows: Callable[..., Iterable]):
        def written() -> str:
            entries = {record: load(record) for record in records}
            results = [entry["results"] for entry in entries.values()]
            below = [note.format_map(results[0]) if isinstance(note, str) else note(*results)]
            of = "`{}`: " if len(records) > 1 else ""
            below += [of.format(record) + _made_on(entry) for record, entry in entries.items()]
            return markdown(head, rows(*results)) + "".join(f"\n{x}\n" for x in below if x)

        PAGES.setdefault(DOCS / page, {})[name] = written
        return rows

    return declared


def _made_on(entry) -> str:
    """Machine and date of the figures."""
    m = entry["machine"]
    return (
        f"{m['cores']} cores ({m['cpu']}), load average {m['load_average']} at the end; jax {entry['versions']['jax']}, "
        f"CPU, float64; {entry['date'][:10]}."
    )


def measured(value):
    """A share with its count, or a number."""
    if isinstance(value, dict):
        return None if value["share"] is None else f"{100 * value['share']:.1f} % of {value['of']}"
    return None if value is None else f"{value:.2f}"


def interval(value, low, high):
    return f"{value:.2f}" + ("" if low is None else f" ({low:.2f} to {high:.2f})")


# The first screen of the README


def rod() -> str:
    """The stiffness along the bamboo rod, as `benchmarks.readme` recorded it."""
    r = load("readme")["results"]["rod"]
    off = 100 * max(abs(x / true - 1) for x, true in zip(r["EI"], r["calipers"], strict=True))
    before, after = (1e3 * x for x in r["unseen"])
    if "stiffness_field" not in r["found"][0]:
        raise ValueError("the stiffness along the rod was not found: write another caption")
    return (
        "*A bamboo fly rod droops under weights at its tip. Its study calls it uniform; `explain` finds that its stiffness\n"
        f"varies: EI falls from {r['EI'][0]:.1f} to {r['EI'][-1]:.3f} N m^2 between {r['at'][0]} and {r['at'][-1]} m, within "
        f"{off:.0f} % of\ncaliper measurements, which the search does not use. Weights that were never fitted are predicted to "
        f"{after:.1f} mm, {before:.0f} mm before.*\n"
    )


def find() -> str:
    """What `scan2flex demo` finds, as `benchmarks.readme` recorded it."""
    f = load("readme")["results"]["find"]
    (at, std, true), (before, after) = f["position"], f["GJ"]
    low, high = at - 1.96 * std, at + 1.96 * std
    fitted, unseen = ("from {:.1f} to {:.1f} mm".format(*(1e3 * x for x in f[name])) for name in ("fitted", "unseen"))
    return (
        f"*A simulated cable of {f['length']:.2f} m has a stiff sleeve that its study does not mention. `explain` finds it at\n"
        f"{at:.3f} m (95 %: {low:.3f} to {high:.3f}; truth: {true:.3f} m). The error falls {fitted}, in poses that were\n"
        f"never fitted {unseen}; that of GJ from {100 * before:+.1f} to {100 * after:+.1f} %. `scan2flex demo` shows it.*\n"
    )


def works() -> str:
    """How well it works, in one small table."""
    rows, wing = list(load("blind")["results"]["rows"].values()), load("wing")["results"]["rows"][0]
    words = {
        "truth_in_tie_set": "one missing effect, blind: named, or tied with few others",
        "false_alarms": "something named where nothing is missing",
        "named_and_wrong": "named alone, and wrong",
        "coverage_95": "95 % intervals of EI and GJ that hold the truth",
    }
    lines = [(words[key], measured(blind_score.METRICS[key][2](blind_score.Classes(rows)))) for key in words]
    EI = f"{interval(*wing['EI'])}, {wing['EI_published']:.2f} N m^2"
    lines.append(("a real wing: EI from light weights, and the published one", EI))
    lines.append(("its displacement under heavier weights: RMS error of the prediction", f"{wing['rms_heavy_mm']:.1f} mm"))
    return markdown(("", "measured"), lines)


def answer() -> str:
    """The first lines of a fit, as `benchmarks.readme` recorded them."""
    return "```text\n" + "\n".join(load("readme")["results"]["lines"]) + "\n```\n"


PAGES[README] = {"rod": rod, "find": find, "works": works, "answer": answer}

# Accuracy


@table("accuracy.md", "blind", ("", "seed 20261130", "seeds 20261301 and 20261303", "target"), "blind", "blind_further")
def blind(*results):
    of = [list(found["rows"].values()) for found in results]
    for (words, first, target), (_, second, _) in zip(*map(by_metric, of), strict=True):
        yield words, first, second, target
    seconds = ([r["processor_seconds"] for r in rows if r.get("processor_seconds")] for rows in of)
    words = "processor seconds for a case, compilation included: mean, most"
    yield words, *(f"{np.mean(some):.0f}, {max(some):.0f}" for some in seconds), "60 at most"
    yield "cases, of them ended by a fault", *(f"{len(rows)}, {sum(bool(r.get('fault')) for r in rows)}" for rows in of), None


@table("accuracy.md", "reliable", ("", "without the score", "with it"), "blind_further")
def reliable(results):
    return [(words, *map(measured, shares)) for words, *shares in blind_score.reliable(list(results["rows"].values()))]


@table("accuracy.md", "background", MEASURED, "background")
def background(results):
    return by_metric(list(results["rows"].values()))


def by_metric(rows):
    return [(words, measured(value), target) for words, value, target in blind_score.scored(rows)]


def _lines_of_explain(rows):
    """The rows of `explain` in the words of the data set's scorer; alarms are those of the test."""
    for r in rows.values():
        named = {"alarm": r["detected"], "in_tie_set": r["in_tie_set"], "both": r["both_tied"], "wrong": r["named_and_wrong"]}
        covers = {k: v for k, v in r.items() if k.startswith("covers_")}
        seen = {"unseen_over_noise": r["validate_over_floor"]} if "validate_over_floor" in r else {}
        yield {"class": r["class"], **named, "unexplained": r["verdict"] == "unexplained", **covers, **seen}


REACHED = (
    ("nothing missing: `alarm`", ("none",), "alarm"),
    ("one effect: `in_tie_set`", ("one",), "in_tie_set"),
    ("two effects: `both`", ("two",), "both"),
    ("an effect in no list: `unexplained`", ("off",), "unexplained"),
    ("`wrong`", ("none", "one", "off"), "wrong"),
    ("`covers_...`, nothing missing", ("none",), "covers_"),
    ("`covers_...`, one effect or two", ("one", "two"), "covers_"),
)


@table("benchmark.md", "reached", ("", "plain fit", "oracle", "`explain`"), "blind", "blind_others")
def reached(blind, others):
    rows_of = [others.get(name, {}) for name in ("plain", "oracle")]
    by = [*([*rows.values()] for rows in rows_of), [*_lines_of_explain(blind["rows"])]]
    for words, classes, key in REACHED:
        chosen = [[v for r in rows if r["class"] in classes for k, v in r.items() if k.startswith(key)] for rows in by]
        yield words, *(measured(blind_score.share(values)) for values in chosen)
    for words, classes in (("nothing missing", ("none",)), ("one effect or two", ("one", "two"))):
        ratios = [[r["unseen_over_noise"] for r in rows if r["class"] in classes and "unseen_over_noise" in r] for rows in by]
        cells = (f"{np.median(x):.2f}, {max(x):.1f} of {len(x)}" if x else None for x in ratios)
        yield f"`unseen_over_noise`, {words}: median, most", *cells
    for name in ("bamboo-rod", "wing-bare"):
        cells = (f"{rows[name]['unseen_over_noise']:.2f}" if name in rows else None for rows in rows_of)
        yield f"the same: {name}", *cells, None


SBC_HEAD = ("noise", "parameter", "draws", "uniform ranks: p", "spread of the normal scores",
            *(f"in {c} % intervals" for c in (50, 80, 95)), "withheld")  # fmt: skip


@table("accuracy.md", "sbc", SBC_HEAD, "sbc")
def sbc(results):
    for r in results["rows"]:
        parameter = r["parameter"].replace("natural_curvature.curvature", "natural curvature").replace("_", " ")
        covered = (f"{100 * r['covered'][c]:.0f} %" for c in ("50", "80", "95"))
        noise = "white alone" if r["white_alone"] else "as the model expects"
        yield noise, parameter, r["draws"], f"{r['p_value']:.2f}", f"{r['spread']:.2f}", *covered, r["withheld"]


@table("accuracy.md", "sensors", MEASURED, "scan_sensors")
def sensors(results):
    return [(words, measured(value), target) for words, value, target in scan_alarms.scored(results["rows"])]


RODS_HEAD = ("rod: form, and EI at the grip over that at the tip", "found, and tied with it", "poses never fitted, mm",
             "EI off by at most", "EI in its band")  # fmt: skip


@table("accuracy.md", "rods", RODS_HEAD, "rods")
def rods(results):
    for name, r in results["rods"].items():
        told = "; ".join(" + ".join(kind.replace("_", " ") for kind in kinds) or "nothing" for kinds in r["found"])
        before, after = r["unseen_mm"]
        along = (f"{100 * r['off']:.0f} %", f"{100 * r['held']:.0f} %") if "off" in r else (None, None)
        yield name, told, f"{before:.1f}, then {after:.1f}", *along


KINECT_HEAD = ("mean node error over length", "all four fitted", "published: adapted rod, MuJoCo",
               "left out, clamps as read: mean (worst) of poses solved", "left out, clamps within tolerances")  # fmt: skip


@table("accuracy.md", "kinect", KINECT_HEAD, "kinect_wires")
def kinect(results):
    for wire, r in results.items():
        left_out = (f"{100 * e['mean']:.1f} % ({100 * e['worst']:.1f} %) of {e['of']}"
                    for e in (r["as read"], r["within tolerances"]))  # fmt: skip
        published = ", ".join(f"{x} %" for x in r["published, percent"])
        yield wire, f"{100 * r['all fitted']['mean over poses']:.1f} %", published, *left_out


@table("accuracy.md", "sensitivity", ("sensitivity", "result", "cost or origin"), "sensitivity")
def sensitivity(r):
    for name, g in r["guesses"].items():
        some = "" if g["run"] == g["guesses"] else f" (a random {g['run']} of {g['guesses']:,})"
        took = f"{g['median equilibria']:.0f} equilibria, {g['median_s']:.1f} s (medians)"
        yield f"guesses {name}", f"{g['recovered']:,} of {g['run']:,} recovered{some}", took
    for name, c in r["clamps"].items():
        own = {letter: c[k] for letter, k in (("EI", "bending_stiffness"), ("GJ", "torsional_stiffness")) if k in c}
        ends = ((100 * math.expm1(x["mean"]), 100 * math.exp(x["mean"]) * x["standard error"]) for x in own.values())
        means = ", ".join(f"{mean:+.2f} ± {error:.2f} %" for mean, error in ends)
        below = "below the truth: " + ", ".join(f"{100 * x['underestimated']:.0f} %" for x in own.values())
        below += f", both {100 * c['both underestimated']:.0f} %" if "both underestimated" in c else ""
        if all("linear in the turns" in x for x in own.values()):
            below += "; linear in the turns: " + ", ".join(f"{100 * x['linear in the turns']:.0f} %" for x in own.values())
        yield f"clamps turned, {name} ({c['draws']:,} draws): mean error of {', '.join(own)}", means, below
    for c in r.get("cantilever", {}).values():
        low, high = c["measured over formula, EI/(w L^3) above 1"]
        power = f"grows with the power {c['power of EI/(g rhoA), stiff half']:.2f} of EI/(g rhoA)"
        yield "cantilever: error of EI over the formula, EI/(w L^3) above 1", f"{low:.3f} to {high:.3f}", power


@table("accuracy.md", "firstuse", (
    "whole command", "empty cache", "processor time", "filled cache", "processor time"
), "first_use")  # fmt: skip
def first_use(results):
    for name, r in results.items():
        runs = [r[way] for way in ("empty cache", "filled cache")]
        yield "`demo`" if name == "demo" else name, *(f"{run[key]:.0f} s" for run in runs for key in ("seconds", "processor"))


_COMPILED = {
    "_evaluate": "equilibrium of a pose, distances of its points, and their derivatives",
    "_map": "from the numbers of a fit or a hypothesis to the states of its poses",
    "_equilibrium": "equilibrium with twice the elements, for the error of the mesh",
    "_start": "start along a measured curve",
}


@table("accuracy.md", "compiled", ("compiled function", "what it is", "compilations", "seconds"), "first_use")
def compiled(results):
    """The costliest functions of one command; the others together."""
    found = results["explain the black wire"]["empty cache"]["compiled"]
    rows = sorted(found.items(), key=lambda item: -item[1]["seconds"])
    for name, own in rows[:5]:
        yield f"`{name}`", _COMPILED.get(name), own["compilations"], f"{own['seconds']:.1f}"
    rest = [own for _, own in rows[5:]]
    yield f"{len(rest)} others", None, sum(x["compilations"] for x in rest), f"{sum(x['seconds'] for x in rest):.1f}"


# Other programs


@table("compared.md", "fit", (
    "method", "recovered", "equilibria (median)", "seconds (median)", "seconds (all guesses)"
), "sensitivity")  # fmt: skip
def fit(results):
    for name, g in results["guesses"].items():
        if name.startswith("5 x 5, "):
            seconds = f"{g['median_s']:.2f}", f"{g['seconds']:.0f}"
            yield name.removeprefix("5 x 5, "), f"{g['recovered']} of {g['run']}", f"{g['median equilibria']:.0f}", *seconds


@table("peers.md", "ratios", (
    "program", "how", "runs", "least error", "time over ours, as accurate", "error over ours, same mesh"
), "peers")  # fmt: skip
def peers(r):
    def median_and_least(name, key):
        x = r["ratios"].get(name, {}).get(key)
        return x and "{} ({})".format(*(f"{v:,.0f}" if v >= 10 else f"{v:.2g}" for v in (x["median"], x["least"])))

    for name, about in r["peers"].items():
        own = [run for run in r["runs"] if run["peer"] == name]
        errors = [run["error"] for run in own if "failed" not in run and run.get("rest to", 0.0) is not None]
        runs = f"{len(errors)}, {len(own) - len(errors)} failed" if len(own) > len(errors) else len(errors)
        keys = "seconds over ours at equal accuracy", "error over ours at equal mesh"
        least = f"{min(errors):.1e}" if errors else None
        yield name, about.get("missing", about["what"]), runs, least, *(median_and_least(name, key) for key in keys)


def hung(r) -> str:
    rod, strip = (100 * r["repeatability"][name] for name in ("bamboo-rod", "textile-strip"))
    return (
        f"Largest distance of a link over the length, with 20 / 40 / 80 links. Newton {r['newton']}, MuJoCo {r['mujoco']}.\n"
        "Repeatability: the RMS distance over the length between two takes of one pose of a real cable. The unit is that\n"
        f"of the bamboo rod, {rod:.2f} %; the strip of fabric has {strip:.1f} %."
    )


@table("export.md", "simulators", (
    "cable", "Newton", "MuJoCo", "Newton, in units of repeatability", "MuJoCo, in units of repeatability"
), "simulators", note=hung)  # fmt: skip
def simulators(r):
    units, forms = (0.01, r["repeatability"]["bamboo-rod"]), ("{:.2f} %", "{:.1f}")
    for name in dict.fromkeys(row["cable"] for row in r["rows"]):
        rows = [[x for x in r["rows"] if x["cable"] == name and x["target"] == target] for target in ("newton", "mujoco")]
        yield name, *(
            " / ".join(form.format(x["off"] / unit) if "off" in x else "refused" for x in row)
            for unit, form in zip(units, forms, strict=True) for row in rows
        )  # fmt: skip


# Laws and memory


@table("adding-an-effect.md", "laws", (
    "law of the shapes", "cables fitted", "curvatures whose band holds it", "largest error", "called linear"
), "laws")  # fmt: skip
def laws(r):
    for law in dict.fromkeys(c["law"] for c in r["cases"]):
        own = [c for c in r["cases"] if c["law"] == law]
        fitted = [c for c in own if "failed" not in c]
        held = f"{100 * sum(c['coverage'] for c in fitted) / len(fitted):.0f} %" if fitted else None
        largest = f"{100 * max(c['error'] for c in fitted):.1f} %" if fitted else None
        yield law, f"{len(fitted)} of {len(own)}", held, largest, f"{sum(c['linear'] for c in fitted)} of {len(fitted)}"


@table("missing-effects.md", "memory", MEASURED, "memory")
def memory(r):
    s = r["summary"]
    lines = [
        ("named, memory clear", "memory that moves the poses by three times the noise or more: named", "80 %"),
        ("not named, no memory", "no memory: not named", "95 %"),
        ("next pose better", "the next pose predicted better than without memory", "90 %"),
        ("loop area within 15 %", "area of the hysteresis loop within 15 %", "all"),
    ]
    for key, words, target in lines:
        yield words, f"{100 * s[key][0] / s[key][1]:.0f} % of {s[key][1]}", target
    for law, (held, of) in s["loop area within 15 %, by law"].items():
        yield f"the same, {law}", f"{held} of {of}", None
    own = s.get("loop area within 15 %, Dahl fitted with dahl")
    if own and own[1]:
        yield "the same, Dahl, fitted with `dahl`", f"{own[0]} of {own[1]}", "all"
    yield "area of the loop over the true one, median", f"{s['loop area over the true one, median']:.2f}", "0.85 to 1.15"


# Real cables


TIP_QUESTIONS = {
    "without": "without the weight", "carried over": "with it: what the answer above predicts, nothing fitted",
    "with": "with it, undeclared; EI to 4 % and effects carried over",
    "with, alone": "with it, undeclared, nothing carried over",
    "both": "both series in one fit, with the effects found without the weight, mass unknown",
}  # fmt: skip
UNITS = {
    "mass": "kg", "length": "m", "position": "m", "curvature": "1/m", "angle": "rad", "force": "N", "slip_curvature": "1/m",
}  # fmt: skip
SIZES = (
    "mass", "length", "curvature", "angle", "force", "factor", "ratio", "position", "offset", "stiffness", "coupling", "taper",
)  # fmt: skip


@table("real/tip-weights.md", "weights", (
    "cable", "series", "answer", "fitted, mm", "left out in turn, mm", "held out, mm", "their median, mm"
), "tip_weights")  # fmt: skip
def weights(results):
    for cable, answers in results.items():
        for question, told in answers.items():
            roles = (_before_after(told, f"rms_{role}") for role in ("fit", "left_out", "validate"))
            yield cable.replace("_", ", "), TIP_QUESTIONS[question], _answer(told), *roles, _median_unseen(told)


def _answer(told) -> str:
    """Verdict, effects with their 95 % intervals, EI."""
    if "failed" in told:
        return told["failed"]
    parts = [told["verdict"]] if "verdict" in told else []
    parts += [", ".join(map(_effect, told["added"]))] if told.get("added") else []
    rivals = sorted({k for r in told.get("ranking", []) if r["kind"] in _kinds(told) for k in r["tied_with"]} - _kinds(told))
    parts += [f"tied with {', '.join(f'`{kind}`' for kind in rivals)}"] if rivals else []
    for name, e in told.get("estimates", {}).items():
        if np.ndim(e["value"]) == 0:
            parts.append(f"{name} {e['value']:.3g}" + (f" ({e['low']:.3g} to {e['high']:.3g})" if "low" in e else ""))
    return "; ".join(parts) or "-"


def _kinds(told) -> set[str]:
    return {chosen["kind"] for chosen in told.get("added", [])}


def _effect(chosen) -> str:
    """An effect with its sizes and places; a moment law by its first and last secant factor, a field by EI at its ends."""
    given, parts = chosen["parameters"], []
    if np.ndim(given.get("factor", 0.0)):
        ends = (f"{given['factor'][k]:.2g} at {given['curvature'][k]:.2g} 1/m" for k in (0, -1))
        return f"`{chosen['kind']}` (secant factor {' to '.join(ends)})"
    if "log_factor" in given:
        ends = np.exp(np.array(given["log_factor"])[[0, -1]])
        return f"`{chosen['kind']}` (EI times {ends[0]:.2g} at the clamp, {ends[1]:.2g} at the tip)"
    for name in (n for n in given if n in SIZES):
        size, std = float(np.linalg.norm(given[name])), chosen.get("std", {}).get(name)
        along = None if std is None or not size else abs(float(np.dot(np.ravel(given[name]), np.ravel(std)))) / size
        parts.append(f"{name} {size:.3g}{'' if along is None else f' ± {1.96 * along:.2g}'} {UNITS.get(name, '')}".strip())
    return f"`{chosen['kind']}`" + (f" ({', '.join(parts)})" if parts else "")


def _before_after(told, role):
    values = [told.get(when, {}).get(role) for when in ("before", "after")]
    return " to ".join(f"{1e3 * v:.1f}" for v in values if v is not None and np.isfinite(v)) or None


def _median_unseen(told):
    if "median of held-out poses" not in told:
        return None
    fallen = len(told["fallen over"])
    return f"{1e3 * told['median of held-out poses']:.1f}" + (f" ({fallen} on another branch)" if fallen else "")


@table("real/wing.md", "wing", (
    "wing", "EI from the light weights, N m^2", "published", "heavier ones, RMS", "believed",
    "weights found within their 95 % interval", "heaviest"
), "wing", note="Fitted: weights up to {light_kg:g} kg. The stated noise is {noise_mm:g} mm.")  # fmt: skip
def wing(results):
    for r in results["rows"]:
        held = sum(w["low"] <= w["hung"] <= w["high"] for w in r["weights"])
        heaviest = "{hung:g} kg: {found:.2f} ({low:.2f} to {high:.2f})".format(**r["weights"][-1])
        believed = "yes" if r["believed"] else "no"
        rms, share = f"{r['rms_heavy_mm']:.1f} mm", f"{held} of {len(r['weights'])}"
        yield r["series"], interval(*r["EI"]), r["EI_published"], rms, believed, share, heaviest


@table("real/wing.md", "torsion", (
    "wing", "EI, N m^2", "GJ, N m^2", "published GJ", "GJ to first order from each light weight", "heavier ones, twist, RMS",
    "believed"
), "wing_torsion", note="Fitted: weights up to {light_kg:g} kg. Noise: {noise_mm:g} mm, {noise_deg:.1g} degrees.")  # fmt: skip
def wing_torsion(results):
    for r in results["rows"]:
        first, believed = ", ".join(f"{x:.1f}" for x in r["GJ_first_order"]), "yes" if r["believed"] else "no"
        off = f"{r['rms_heavy_deg']:.2f} degrees of up to {max(a for a, _ in r['twists'].values()):.1f}"
        yield r["series"], interval(*r["EI"]), interval(*r["GJ"]), r["GJ_published"], first, off, believed


# Bending tests


@table("test-benches.md", "tests", (
    "test", "reading of a strip of EI = 2e-5 N m^2", "1 % of EI moves it by", "EI by the closed form", "with friction, first",
    "with friction, returned"
), "bending_tests")  # fmt: skip
def bending_tests(results):
    for r in results["rows"]:
        shares = ("none" if x is None else f"{100 * (x - 1):+.0f} %" for x in (r["closed"], r["first"], r["returned"]))
        yield r["test"], f"{r['reading']} {r['value_mm']:.2f} mm", f"{r['mm_per_percent']:.2g} mm", *shares


# Scans

EXTRACTED = ("scans", "cases", "met, sure", "not sure", "refused", "missed, sure", "by at most", "RMS over noise")


def extracted(results, groups):
    """A row for each sensor and group of cases."""
    for sensor, target in results["targets"].items():
        for name, holds in groups.items():
            cases = [c for c in results["cases"] if c["sensor"] == sensor and holds(c)]
            of_class = {n: [c for c in cases if c["class"] == n] for n in ("met", "not sure", "refused", "missed")}
            over = [max(c["rms_over_noise"] / target, c["bias_over_radius"] / 0.2, abs(c["length_error"]) / 0.005)
                    for c in of_class["missed"]]  # fmt: skip
            noise = np.median([c["rms_over_noise"] for c in cases if "refused" not in c])
            most = f"{max(over):.1f} times" if over else None
            yield f"{sensor}, {name}", len(cases), *map(len, of_class.values()), most, f"{noise:.2f}"


@table("scanning.md", "extraction", EXTRACTED, "extraction")
def extraction(results):
    return extracted(results, {f"{n} view{'s' * (n > 1)}": (lambda c, n=n: c["views"] == n) for n in (1, 2, 3)})


def gaps(r) -> str:
    some = [c for c in r["cases"] if c["gap"] and "refused" not in c]
    marked = sum(any(low < 0.4 * c["length"] < high for low, high in c["gaps"]) for c in some)  # of 0.35 to 0.45 L
    return f"Of the gaps in curves that were found, {marked} of {len(some)} were marked as such."


@table("scanning.md", "kinds", EXTRACTED, "extraction", note=gaps)
def extraction_by_scene(results):
    return extracted(results, {
        "plain": lambda c: not (c["gap"] or c["guide_points"] or c["table"]), "guide points": lambda c: c["guide_points"],
        "a gap of 10 %": lambda c: c["gap"], "a table": lambda c: c["table"],
    })  # fmt: skip


@table("scanning.md", "virtual", (
    "experiment", "error (RMS)", "stated deviation", "intervals hold it", "fitted poses", "never fitted"
), "virtual_experiments")  # fmt: skip
def virtual(r):
    letters = {"bending_stiffness": "EI", "torsional_stiffness": "GJ"}
    for name, s in r["summary"].items():
        values = [(letters[key], s[key]) for key in letters if key in s]
        errors = ", ".join(f"{letter} {100 * x['rms_error']:.2f} %" for letter, x in values)
        stated = ", ".join(f"{100 * x['mean_relative_std']:.2f} %" for _, x in values)
        held = f"{sum(x['covered'] for _, x in values)} of {len(values) * (s['runs'] - s['failed'])}"
        far = [s[f"{role} rms_truth_mm"] for role in ("fit", "validate")]
        yield name, errors, stated, held, *(None if x is None else f"{x:.3f} mm" for x in far)


# Many cables, hostile and mistaken input


@table("sweeps.md", "batches", ("256 cables", "processor time each", "steps each"), "batches")
def batches(b):
    mean, most, group = b["steps: mean, most, of a group"]
    steps = {"loop": mean, "loop in one call": mean, "vmap": most, "vmap, groups of 8": group, "compiled solver": mean}
    for way in (way for way in steps if way in b):
        yield way, f"{1e3 * b[way]['s per cable']:.2f} ms", f"{steps[way]:.1f}"


@table("robustness.md", "attacks", ("reader", "inputs", "refused in one sentence", "slowest", "failures"), "attacks",
       note="{inputs} inputs, {failures} failures.")  # fmt: skip
def attacks(r):
    for name, a in r["readers"].items():
        failures = sum(f["count"] for f in a["failures"].values())
        yield name, a["inputs"], a["refused in one sentence"], f"{1e3 * a['slowest_s']:.0f} ms", failures


def mistakes_made(r) -> str:
    return (
        "{made} studies with one of {kinds} mistakes: {named} named with the right remedy, {warned} warned of, {missed} "
        "missed,\n"
        "{without trace} without a trace in the shapes. Intervals that exclude the truth without a warning in the first three\n"
        "lines: {intervals without a warning that exclude the truth, with a trace} with a trace, {the same without a trace} "
        "without. Physics named over a mistake: {physics named}.\nStudies without a mistake: {without a mistake}; accused of "
        "one: {accusations}."
    ).format_map(r["table"] | {"accusations": len(r["table"]["accused"])})


STUDIES = ("textile-strip", "black-wire", "d04", "d15", "d18")


@table("mistakes.md", "mistakes", ("mistake", *STUDIES), "mistakes", note=mistakes_made)
def mistakes(r):
    steps = {"refusal": "refused", "check": "`check`", "fit": "`fit`"}
    for mistake in dict.fromkeys(m for study in r["cases"].values() for m in study):
        cases = [r["cases"][study].get(mistake) for study in STUDIES]
        yield mistake, *(c and (steps[c["by"]] if c["outcome"] == "named" else c["outcome"]) for c in cases)


# The keys of a study


def keys(*tables: str) -> Callable[[], str]:
    """The keys of tables of `study.toml`, as they are declared."""
    declared = [key for name in tables for key in KEYS[name].values()]
    rows = [(f"`{key.name}`", key.unit, key.default, f"`{key.example}`", key.words) for key in declared]
    return lambda: markdown(("key", "unit", "default", "example", "meaning"), rows)


PAGES[DOCS / "study.md"] = {name: keys(name) for name in ("study", "cable", "tolerance", "unknown")}
PAGES[DOCS / "study.md"] |= {"pose": keys("pose", "clamp")} | {name: keys(name) for name in ("angle", "wrench", "effect")}


def filled(text: str, tables: dict) -> str:
    """The text with its tables made anew."""
    return _PART.sub(lambda m: m[1] + tables[m[2]]() + m[3], text)


if __name__ == "__main__":
    for path, tables in PAGES.items():
        path.write_text(filled(path.read_text(), tables))
