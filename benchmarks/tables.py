"""The tables of the README and of the pages in docs: from the JSON files in `benchmarks/results`, and the keys of a study.

`python -m benchmarks.tables` from the repository's root rewrites the text on each page between `<!-- table:NAME -->` and
`<!-- end -->`. A table is declared below: the records that it reads, its rows, and its columns, each a heading and a function
that writes the cell of a row. A value that a record lacks is a dash.
"""

import json
import math
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.record import RESULTS
from scan2flex_jax.study.kinds import KEYS

ROOT = Path(__file__).parents[1]
README, DOCS = ROOT / "README.md", ROOT / "docs"
_PART = re.compile(r"(<!-- table:([a-z]+) -->\n).*?(<!-- end -->)", re.DOTALL)
Cell = Callable[[Any], object]


class Table(NamedTuple):
    """``rows`` of the results of all ``records``; ``columns`` by heading; ``note``: a sentence below the table, with keys of
    the first record in braces, or a function of the results that writes it."""

    records: tuple[str, ...]
    columns: dict[str, Cell]
    rows: Callable[..., Iterable]
    note: str | Callable[..., str] = ""

    def __call__(self) -> str:
        """The Markdown."""
        entries = [load(name) for name in self.records]
        results = [entry["results"] for entry in entries]
        lines = [list(self.columns), ["---"] * len(self.columns)]
        lines += [[_written(cell, row) for cell in self.columns.values()] for row in self.rows(*results)]
        note = self.note.format_map(results[0]) if isinstance(self.note, str) else self.note(*results)
        of = [f"`{name}`: " if len(entries) > 1 else "" for name in self.records]
        below = [x for x in (note, *(name + _made_on(entry) for name, entry in zip(of, entries, strict=True))) if x]
        return "".join(f"| {' | '.join(line)} |\n" for line in lines) + "".join(f"\n{x}\n" for x in below)


def load(name: str) -> dict:
    """The record of one benchmark."""
    return json.loads((RESULTS / f"{name}.json").read_text())


def _written(cell: Cell, row) -> str:
    try:
        value = cell(row)
    except (KeyError, TypeError):  # a figure that the record lacks
        value = None
    return "-" if value is None else str(value)


def _made_on(entry) -> str:
    """Machine and date of the figures."""
    m = entry["machine"]
    return (
        f"{m['cores']} cores ({m['cpu']}), load average {m['load_average']} at the end; jax {entry['versions']['jax']}, "
        f"CPU, float64; {entry['date'][:10]}."
    )


def item(*keys, form: str = "{}", times: float = 1.0) -> Cell:
    """The cell that writes the value at these keys of a row."""

    def cell(row):
        for key in keys:
            row = row[key]
        return None if row is None else form.format(row if times == 1.0 else times * row)

    return cell


def percent(*keys, digits: int = 1) -> Cell:
    return item(*keys, form=f"{{:.{digits}f}} %", times=100.0)


def columns(*heads: str) -> dict[str, Cell]:
    return {head: (lambda row, k=k: row[k]) for k, head in enumerate(heads)}


# Scores


def scores(*lines: tuple, more: Callable[..., list] = lambda *_: []) -> Callable[..., Iterable]:
    """Rows of words, value and target from the table of the first record, by lines of key, words and, if any, target; a value
    is a share with its count, or a number. ``more``: further rows of all records."""

    def rows(*results):
        table = results[0]["table"]
        return [(words, _measured(table.get(key)), *(target or "-")) for key, words, *target in lines] + more(*results)

    return rows


def _measured(value):
    if isinstance(value, dict):
        return None if value["share"] is None else f"{100 * value['share']:.1f} % of {value['of']}"
    return None if value is None else f"{value:.2f}"


def _cost(results):
    t = results["table"]
    rows = [
        ("seconds for a case: mean, most", f"{t['seconds_mean']:.0f}, {t['seconds_most']:.0f}", "60 at most"),
        ("the same in processor time, compilation included",
         f"{t['processor_seconds_mean']:.0f}, {t['processor_seconds_most']:.0f}", "-"),
    ]  # fmt: skip
    if m := t.get("memory"):
        words = f"memory of one process with {m['studies']} cases: after 20, at most afterwards, at the end"
        rows.append((words, f"{m['after_20']:,.0f}, {m['most']:,.0f}, {m['last']:,.0f} MiB", "flat"))
    return [*rows, ("cases, of them ended by a fault", f"{t['cases']}, {t['faults']}", "-")]


MEASURED = columns("", "measured", "target")
BLIND = Table(("blind",), MEASURED, scores(
    ("false_alarms", "nothing missing: alarms at the 5 % level", "3-8 %"),
    ("detected_above_0.7", "one or two effects of strength above 0.7: detected", "95 %"),
    ("truth_in_tie_set_6_poses", "one effect, six poses or more: in the tie set", "90 %"),
    ("truth_in_tie_set", "one effect, all cases: in the tie set"),
    ("mean_tie_set", "effect types in a tie set, mean", "2 at most"),
    ("top_1", "one effect: ranked first", "85 %"),
    ("top_1_above_1.5", "the same, strength above 1.5", "95 %"),
    ("named_and_wrong", "named alone, and wrong", "2 % at most"),
    ("both_of_a_pair", "two effects: both found", "80 %"),
    ("both_tied", "two effects: both in the tied sets"),
    ("one_of_a_pair", "two effects: at least one in the tie set"),
    ("off_catalogue_flagged", 'an effect outside the catalogue: answered "unexplained"', "75 %"),
    ("fit_within_5_percent", "ranked first and right: RMS after within 5 % of the noise", "all"),
    ("validate_better", "poses never fitted: predicted better than before", "90 %"),
    ("validate_within_1.15", "ranked first and right: those within 1.15 of the noise", "all"),
    ("validate_within_1.15_no_tolerance", "the same in studies without tolerances (a new pose's clamps deviate too)", "all"),
    ("place_within_2_percent", "right effect type with a position along the cable: within 2 % of the length", "all"),
    ("place_within_2_percent_if_seen", "the same, where its standard error is below 1 % of the length"),
    ("place_covered", "95 % intervals of positions that hold the truth"),
    ("coverage_95", "95 % intervals of EI and GJ that hold the truth, after", "92-97 %"), more=_cost,
))  # fmt: skip
BACKGROUND = Table(("background",), MEASURED, scores(
    ("background_alone_named", "background alone, and something named", "5 % at most"),
    ("background_in_tie_set", "one effect above it: in the tie set", "85 %"),
    ("background_missed_for_a_mistake", "not in it, since a likely mistake of the input was reported"),
    ("background_named_and_wrong", "named, and wrong"),
    ("background_size_within_15_percent", "one effect: in the tie set, and its size within 15 %", "80 %"),
    ("background_validate_within_1.3", "one effect: poses never fitted within 1.3 of the error of the true model", "80 %"),
    ("background_discrepancy_over_true_median", "reported over true scatter, median"),
    ("background_coverage_95_alone", "95 % intervals of EI and GJ that hold the truth: background alone", "92-97 %"),
    ("background_coverage_95_with_effect", "the same with an effect, after it is searched", "92-97 %"),
    ("background_parameters_covered", "95 % intervals of the effect's parameters that hold the truth", "92-97 %"),
    ("background_coverage_95_plain_fit_alone", "the same of the baseline fit, background alone", "92-97 %"),
    ("background_coverage_95_plain_fit_with_effect", "the same of the baseline fit, before an effect is known", "92-97 %"),
))  # fmt: skip
_STRONG = scores(
    ("named_curve", "a strong effect: named alone from curves"),
    ("named_scan", "from scans"),
    ("right_scan", "from scans, and rightly"),
    ("named_as_from_curves", "from scans as from curves", "16 of 20"),
    ("answered_as_from_curves", "the same answer as from curves, ties and unexplained cases included"),
)
SCANS = Table(("scan_none", "scan_alarms"), MEASURED, scores(
    ("alarms_scan", "nothing missing: scans that raise an alarm at the 5 % level", "3 of 40 at most"),
    ("alarms_curve", "the same poses as curves"),
    ("covered_scan", "nothing missing: 95 % intervals of EI and GJ from scans that hold the truth", "92-97 %"),
    ("covered_curve", "the same from curves", "92-97 %"), more=lambda none, strong: list(_STRONG(strong)),
))  # fmt: skip


def _memory(r):
    s = r["summary"]

    def of(key):
        return f"{100 * s[key][0] / s[key][1]:.0f} % of {s[key][1]}"

    took = ", ".join(f"{v['clock']:.1f}" for v in r["seconds of fits"].values())
    return [
        ("memory that moves the poses by three times the noise or more: named", of("named, memory clear"), "80 %"),
        ("no memory: not named", of("not named, no memory"), "95 %"),
        ("the next pose predicted better than without memory", of("next pose better"), "90 %"),
        ("area of the hysteresis loop within 15 %", of("loop area within 15 %"), "all"),
        *((f"the same, {law}", f"{n[0]} of {n[1]}", "-") for law, n in s["loop area within 15 %, by law"].items()),
        ("area of the loop over the true one, median", f"{s['loop area over the true one, median']:.2f}", "0.85 to 1.15"),
        ("seconds of a fit with 5, 10, 20 poses", took, "30 s for 20"),
    ]


MEMORY = Table(("memory",), MEASURED, _memory)

# Real cables

TIP_QUESTIONS = {
    "without": "without the weight", "carried over": "with it: what the answer above predicts, nothing fitted",
    "with": "with it, undeclared; EI to 4 % and effects carried over",
    "with, alone": "with it, undeclared, nothing carried over",
    "both": "both series in one fit, with the effects found without the weight, mass unknown",
}  # fmt: skip
_UNITS = {"mass": "kg", "position": "m", "curvature": "1/m", "angle": "rad", "force": "N", "slip_curvature": "1/m"}
_SIZES = ("mass", "curvature", "angle", "force", "factor", "ratio", "position", "offset", "stiffness", "coupling", "taper")


def _tip_rows(results):
    for cable, r in results.items():
        for question, told in r.items():
            yield {"cable": cable.replace("_", ", "), "question": question} | told


def _found(told) -> str:
    """Verdict, effects with their 95 % intervals, EI."""
    if "failed" in told:
        return told["failed"]
    parts = [told["verdict"]] if "verdict" in told else []
    parts += [", ".join(map(_effect, told["added"]))] if told.get("added") else []
    for name, e in told.get("estimates", {}).items():
        if np.ndim(e["value"]) == 0:
            parts.append(f"{name} {e['value']:.3g}" + (f" ({e['low']:.3g} to {e['high']:.3g})" if "low" in e else ""))
    return "; ".join(parts) or "-"


def _effect(chosen) -> str:
    """An effect with its sizes and places; a moment law by its first and last secant factor."""
    given, said = chosen["parameters"], []
    if np.ndim(given.get("factor", 0.0)):
        ends = (f"{given['factor'][k]:.2g} at {given['curvature'][k]:.2g} 1/m" for k in (0, -1))
        return f"`{chosen['kind']}` (secant factor {' to '.join(ends)})"
    for name in (n for n in given if n in _SIZES):
        size, std = float(np.linalg.norm(given[name])), chosen.get("std", {}).get(name)
        along = None if std is None or not size else abs(float(np.dot(np.ravel(given[name]), np.ravel(std)))) / size
        said.append(f"{name} {size:.3g}{'' if along is None else f' ± {1.96 * along:.2g}'} {_UNITS.get(name, '')}".strip())
    return f"`{chosen['kind']}` ({', '.join(said)})"


def _before_after(role) -> Cell:
    def cell(told):
        values = [told.get(when, {}).get(role) for when in ("before", "after")]
        return " to ".join(f"{1e3 * v:.1f}" for v in values if v is not None and np.isfinite(v)) or None

    return cell


def _unseen(told):
    fallen = len(told["fallen over"])
    return f"{1e3 * told['median of poses never seen']:.1f}" + (f" ({fallen} on another branch)" if fallen else "")


WEIGHTS = Table(("tip_weights",), {
    "cable": item("cable"), "series": lambda told: TIP_QUESTIONS[told["question"]], "found": _found,
    "fitted, mm": _before_after("rms_fit"), "left out in turn, mm": _before_after("rms_left_out"),
    "never seen, mm": _before_after("rms_validate"), "their median, mm": _unseen,
}, _tip_rows)  # fmt: skip

def _left_out(key) -> Cell:
    def cell(row):
        e = row[1][key]
        return None if e["mean"] is None else f"{100 * e['mean']:.1f} % ({100 * e['worst']:.1f} %) of {e['of']}"

    return cell


KINECT = Table(("kinect_wires",), {
    "mean node error over length": item(0), "all four fitted": percent(1, "all fitted", "mean over poses"),
    "published: adapted rod, MuJoCo": lambda row: ", ".join(f"{x} %" for x in row[1]["published, percent"]),
    "left out, clamps as read: mean (worst) of poses solved": _left_out("as read"),
    "left out, clamps within tolerances": _left_out("within tolerances"),
    "the same, with what `explain` finds": _left_out("explained, within tolerances"),
}, lambda r: r.items())  # fmt: skip

# Sensitivity, time


def _sensitivity(r):
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


SENSITIVITY = Table(("sensitivity",), columns("sensitivity", "result", "cost or origin"), _sensitivity)
FIT = Table(("sensitivity",), {
    "method": lambda row: row[0].removeprefix("5 x 5, "), "recovered": lambda row: f"{row[1]['recovered']} of {row[1]['run']}",
    "equilibria (median)": item(1, "median equilibria", form="{:.0f}"), "seconds (median)": item(1, "median_s", form="{:.2f}"),
    "seconds (all guesses)": item(1, "seconds", form="{:.0f}"),
}, lambda r: [row for row in r["guesses"].items() if row[0].startswith("5 x 5")])  # fmt: skip


def _equilibrium(r):
    for pose, t in r["solves"].items():
        for start, words in (("generic", "generic start"), ("warm", "start at the solution"), ("bfgs generic", "BFGS")):
            yield f"pose `{pose}`, {words}", f"{1e3 * t[start]['min_s']:.1f} ms", f"{t[start]['steps']} steps"
    for start, t in r["jacobian"].items():
        for count in ("2", "12"):
            j = t[f"points and jacobian, {count} parameters"]
            share = f"{100 * j['jacobian over forward']:+.0f} % of the shape alone"
            yield f"shape and Jacobian of {count} parameters, {start} start", f"{1e3 * j['min_s']:.1f} ms", share
    for name, words in (("compiling", "first call, compiling"), ("from the cache", "first call, from the compilation cache")):
        yield words, f"{r['first call'][name]['first_s']:.1f} s", "imports excluded"


EQUILIBRIUM = Table(("equilibrium",), columns("one equilibrium", "least time", "steps or ratio"), _equilibrium)


def _batches(b):
    mean, most, group = b["steps: mean, most, of a group"]
    steps = {"loop": mean, "loop in one call": mean, "vmap": most, "vmap, groups of 8": group, "compiled solver": mean}
    for way in (way for way in steps if way in b):
        yield way, f"{1e3 * b[way]['s per cable']:.2f} ms", f"{steps[way]:.1f}"


BATCHES = Table(("batches",), columns("256 cables", "processor time each", "steps each"), _batches)
WORKERS = Table(("sweep_workers",), columns("equilibria", "workers", "killed", "failed", "equal to one process"), lambda r: [
    (r["equilibria"], r["workers"], r["killed"], r["failed"], "every number" if r["equal"] else "no")
])  # fmt: skip
FIRST_USE = Table(("first_use",), {
    "whole command": lambda row: "`demo`" if row[0] == "demo" else row[0],
    "empty cache": item(1, "empty cache", form="{:.0f} s"), "filled cache": item(1, "filled cache", form="{:.0f} s"),
}, lambda r: r.items())  # fmt: skip


# Other programs


def _peers(r):
    for name, about in r["peers"].items():
        own = [run for run in r["runs"] if run["peer"] == name]
        errors = [run["error"] for run in own if "failed" not in run and run.get("rest to", 0.0) is not None]
        failed = f", {len(own) - len(errors)} failed" if len(own) > len(errors) else ""
        found = {"runs": f"{len(errors)}{failed}", "error": f"{min(errors):.1e}"} if errors else {}
        yield r["ratios"].get(name, {}) | {"name": name, "missing": about.get("missing")} | about | found


def _ratio(key) -> Cell:
    def size(x):
        return f"{x:,.0f}" if x >= 10 else f"{x:.2g}"

    return lambda row: f"{size(row[key]['median'])} ({size(row[key]['least'])})"


RATIOS = Table(("peers",), {
    "program": item("name"), "how": lambda row: row["missing"] or row["what"], "runs": item("runs"),
    "least error": item("error"), "time over ours, as accurate": _ratio("seconds over ours at equal accuracy"),
    "error over ours, same mesh": _ratio("error over ours at equal mesh"),
}, _peers)  # fmt: skip


# Scans


def _over(case, target) -> float:
    """The largest ratio of an error to its target."""
    return max(case["rms_over_noise"] / target, case["bias_over_radius"] / 0.2, abs(case["length_error"]) / 0.005)


def _of_class(name) -> Cell:
    return lambda row: sum(case["class"] == name for case in row[1])


def _median(value) -> Callable:
    return lambda row: np.median([value(case) for case in row[1] if "refused" not in case])


_WITH: dict[str, Callable] = {
    "plain": lambda c: not (c["gap"] or c["guide_points"] or c["table"]), "guide points": lambda c: c["guide_points"],
    "a gap of 10 %": lambda c: c["gap"], "a table": lambda c: c["table"],
}  # fmt: skip
_VIEWS = {f"{n} view{'s' * (n > 1)}": (lambda c, n=n: c["views"] == n) for n in (1, 2, 3)}


def _extraction(groups):
    def rows(r):
        for sensor, target in r["targets"].items():
            for name, holds in groups.items():
                yield f"{sensor}, {name}", [c for c in r["cases"] if c["sensor"] == sensor and holds(c)], target

    return rows


def _gaps(r) -> str:
    gaps = [c for c in r["cases"] if c["gap"] and "refused" not in c]
    marked = sum(any(low < 0.4 * c["length"] < high for low, high in c["gaps"]) for c in gaps)  # of 0.35 to 0.45 L
    missed = [c for c in r["cases"] if c["class"] == "missed"]
    beyond = sum(c["bound_mm"] > r["targets"][c["sensor"]] * c["noise_mm"] for c in missed)
    return (
        f"Of the gaps in curves that were found, {marked} of {len(gaps)} were marked as such. Of the {len(missed)} curves\n"
        f"that missed a target without a warning, {beyond} have a Cramer-Rao bound above it."
    )


EXTRACTED = {
    "scans": item(0), "cases": lambda row: len(row[1]), "met, sure": _of_class("met"), "not sure": _of_class("not sure"),
    "refused": _of_class("refused"), "missed, sure": _of_class("missed"),
    "by at most": lambda row: "{:.1f} times".format(max(_over(c, row[2]) for c in row[1] if c["class"] == "missed"))
    if any(c["class"] == "missed" for c in row[1]) else None,
    "RMS over noise": lambda row: f"{_median(lambda c: c['rms_over_noise'])(row):.2f}",
    "RMS over bound": lambda row: f"{_median(lambda c: c['rms_mm'] / c['bound_mm'])(row):.1f}",
}  # fmt: skip
EXTRACTION = Table(("extraction",), EXTRACTED, _extraction(_VIEWS))
KINDS = Table(("extraction",), EXTRACTED, _extraction(_WITH), _gaps)
FORMATS = Table(
    ("formats",),
    {
        "format": item("format"),
        "ending": item("ending", form="`{}`"),
        "file, MB": item("MB", form="{:.0f}"),
        "seconds": item("seconds", form="{:.2g}"),
        "memory, MiB": item("memory_MiB", form="{:.0f}"),
    },
    lambda results: results["rows"],
    "{points:,} points, each file read by a process of its own; 24 bytes a point are 23 MiB.",
)
WING = Table(
    ("wing",),
    {
        "wing": item("series"),
        "EI from the light weights, N m^2": lambda row: _interval(*row["EI"]),
        "published": item("EI_published"),
        "heavier ones, RMS": item("rms_heavy_mm", form="{:.1f} mm"),
        "believed": lambda row: "yes" if row["believed"] else "no",
        "weights found within their 95 % interval": lambda row: "{} of {}".format(
            sum(w["low"] <= w["hung"] <= w["high"] for w in row["weights"]), len(row["weights"])
        ),
        "heaviest": lambda row: "{hung:g} kg: {found:.2f} ({low:.2f} to {high:.2f})".format(**row["weights"][-1]),
    },
    lambda results: results["rows"],
    "Fitted: weights up to {light_kg:g} kg. The stated noise is {noise_mm:g} mm.",
)


SBC = Table(
    ("sbc",),
    {
        "noise": lambda row: "white alone" if row["white_alone"] else "as the model expects",
        "parameter": lambda row: row["parameter"].replace("natural_curvature.curvature", "natural curvature").replace("_", " "),
        "draws": item("draws"),
        "uniform ranks: p": item("p_value", form="{:.2f}"),
        "spread of the normal scores": item("spread", form="{:.2f}"),
        **{f"in {c} % intervals": item("covered", str(c), form="{:.0f} %", times=100) for c in (50, 80, 95)},
        "withheld": item("withheld"),
    },
    lambda results: results["rows"],
)


def _interval(value, low, high):
    return f"{value:.2f}" + ("" if low is None else f" ({low:.2f} to {high:.2f})")


_LETTERS = {"bending_stiffness": "EI", "torsional_stiffness": "GJ"}


def _virtual(r):
    for name, s in r["summary"].items():
        numbers = [(_LETTERS[key], s[key]) for key in _LETTERS if key in s]
        errors = ", ".join(f"{letter} {100 * x['rms_error']:.2f} %" for letter, x in numbers)
        stated = ", ".join(f"{100 * x['mean_relative_std']:.2f} %" for _, x in numbers)
        held = f"{sum(x['covered'] for _, x in numbers)} of {len(numbers) * (s['runs'] - s['failed'])}"
        far = [s[f"{role} rms_truth_mm"] for role in ("fit", "validate")]
        yield name, errors, stated, held, *("-" if x is None else f"{x:.3f} mm" for x in far)


VIRTUAL = Table(("virtual_experiments",), columns(
    "experiment", "error (RMS)", "stated deviation", "intervals hold it", "fitted poses", "never fitted"
), _virtual)  # fmt: skip

# Hostile and mistaken input, laws

EXTREMES = Table(("robustness",), {
    "cable": item(0), "equilibrium": item(1, "equilibrium", "outcome"), "fit": item(1, "fit", "outcome"),
    "steps, or reason": lambda row: f"{row[1]['equilibrium']['steps']} steps" if row[1]["equilibrium"]["outcome"] == "solved"
    else row[1]["equilibrium"]["says"],
}, lambda r: r["cases"].items(),
    "{outcomes[solved]} solved, {outcomes[refused]} refused, {outcomes[failure]} failed.")  # fmt: skip


def _failures(row) -> int:
    return sum(f["count"] for f in row[1]["failures"].values())


ATTACKS = Table(("attacks",), {
    "reader": item(0), "inputs": item(1, "inputs"), "refused in one sentence": item(1, "refused in one sentence"),
    "slowest": item(1, "slowest_s", form="{:.0f} ms", times=1e3), "failures": _failures,
}, lambda r: r["readers"].items(), "{inputs} inputs, {failures} failures.")  # fmt: skip


def _named(study) -> Cell:
    """The outcome for one study, and the step that named the mistake."""
    steps = {"refusal": "refused", "check": "`check`", "fit": "`fit`"}
    return lambda row: steps[row[study].get("by")] if row[study]["outcome"] == "named" else row[study]["outcome"]


_MADE = (
    "{made} studies with one of {kinds} mistakes: {named} named with the right remedy, {warned} warned of, {missed} missed,\n"
    "{without trace} without a trace in the shapes. Intervals that exclude the truth without a warning in the first three\n"
    "lines: {intervals without a warning that exclude the truth, with a trace} with a trace, {the same without a trace} "
    "without. Physics named over a mistake: {physics named}.\nStudies without a mistake: {without a mistake}; accused of one: "
    "{accusations}."
)
STUDIES = ("textile-strip", "black-wire", "d04", "d15", "d18")
def _mistakes(r):
    for mistake in dict.fromkeys(m for study in r["cases"].values() for m in study):
        yield {"mistake": mistake} | {name: study.get(mistake) for name, study in r["cases"].items()}


MISTAKES = Table(
    ("mistakes",), {"mistake": item("mistake")} | {study: _named(study) for study in STUDIES}, _mistakes,
    lambda r: _MADE.format_map(r["table"] | {"accusations": len(r["table"]["accused"])}),
)  # fmt: skip


def _laws(r):
    for law in dict.fromkeys(c["law"] for c in r["cases"]):
        own = [c for c in r["cases"] if c["law"] == law]
        told = [c for c in own if "failed" not in c]
        held = f"{100 * sum(c['coverage'] for c in told) / len(told):.0f} %" if told else "-"
        largest = f"{100 * max(c['error'] for c in told):.1f} %" if told else "-"
        yield law, f"{len(told)} of {len(own)}", held, largest, f"{sum(c['linear'] for c in told)} of {len(told)}"


LAWS = Table(("laws",), columns(
    "law of the shapes", "cables fitted", "curvatures whose band holds it", "largest error", "called linear"
), _laws)  # fmt: skip


def answer() -> str:
    """The first lines of a fit, as `benchmarks.readme` recorded them."""
    return "```text\n" + "\n".join(load("readme")["results"]["lines"]) + "\n```\n"


def find() -> str:
    """What `scan2flex demo` finds, as `benchmarks.readme` recorded it."""
    f = load("readme")["results"]["find"]
    (at, std, true), (before, after) = f["position"], f["GJ"]
    fitted, unseen = ("from {:.1f} to {:.1f} mm".format(*(1e3 * x for x in f[name])) for name in ("fitted", "unseen"))
    return (
        f"*A simulated cable of {f['length']:.2f} m has a stiff sleeve that its study does not mention. `explain` finds it at\n"
        f"{at:.3f} +- {std:.3f} m (truth: {true:.3f} m). The error falls {fitted}, in poses that were never fitted\n"
        f"{unseen}; that of GJ falls from {100 * before:+.1f} to {100 * after:+.1f} %. `scan2flex demo` shows it.*\n"
    )


def works() -> str:
    """How well it works, in one small table."""
    blind, wing = load("blind")["results"]["table"], load("wing")["results"]["rows"][0]
    EI, low, high = wing["EI"]
    lines = [
        ("one missing effect, blind: named, or tied with few others", _measured(blind["truth_in_tie_set"])),
        ("something named where nothing is missing", _measured(blind["false_alarms"])),
        ("named alone, and wrong", _measured(blind["named_and_wrong"])),
        ("95 % intervals of EI and GJ that hold the truth", _measured(blind["coverage_95"])),
        ("a real wing: EI from light weights, and the published one", f"{EI:.2f} ({low:.2f} to {high:.2f}), "
         f"{wing['EI_published']:.2f} N m^2"),
        ("its displacement under heavier weights: RMS error of the prediction", f"{wing['rms_heavy_mm']:.1f} mm"),
    ]  # fmt: skip
    return "".join(f"| {' | '.join(line)} |\n" for line in [("", "measured"), ("---", "---"), *lines])


def _paired(r):
    lines = {
        "pure": [("truth_in_tie_set", "one effect: in the tie set"), ("both_of_a_pair", "two effects: both found"),
                 ("false_alarms", "nothing missing, and an alarm"), ("named_and_wrong", "named alone, and wrong"),
                 ("off_catalogue_flagged", 'outside the catalogue: "unexplained"'),
                 ("coverage_95", "intervals of EI and GJ that hold the truth")],
        "background": [("background_in_tie_set", "with a background, one effect: in the tie set"),
                       ("background_alone_named", "background alone, and something named"),
                       ("background_named_and_wrong", "named, and wrong"),
                       ("background_size_within_15_percent", "its size within 15 %"),
                       ("background_validate_within_1.3", "poses never fitted within 1.3 of the true model's error"),
                       ("background_parameters_covered", "intervals of its parameters that hold the truth")],
    }  # fmt: skip
    for name, rows in lines.items():
        former, now = r[name]["former"], r[name]["now"]
        yield from ((words, _measured(former[key]), _measured(now[key])) for key, words in rows)
        seconds = [f"{x['processor_seconds_mean']:.0f}, {x['processor_seconds_most']:.0f}" for x in (former, now)]
        yield "processor seconds: mean, most", *seconds


PAIRED = Table(("paired",), columns("", "former engine", "this one"), _paired,
               "40 pure cases and 14 with a background; the former engine is that of commit {former}.")  # fmt: skip


def _simulators(r):
    for name in dict.fromkeys(row["cable"] for row in r["rows"]):
        rows = [[x for x in r["rows"] if x["cable"] == name and x["target"] == target] for target in ("newton", "mujoco")]
        yield name, *(" / ".join(f"{100 * x['off']:.2f} %" if "off" in x else "refused" for x in row) for row in rows)


SIMULATORS = Table(("simulators",), columns("cable", "Newton", "MuJoCo"), _simulators,
                   "Largest distance of a link over the length, with 20 / 40 / 80 links. Newton {newton}, MuJoCo {mujoco}.")


def _keys(*tables: str) -> Callable[[], str]:
    """The keys of tables of `study.toml`, as they are declared."""
    keys = [key for table in tables for key in KEYS[table].values()]
    rows = [f"| `{key.name}` | {key.unit} | {key.default} | `{key.example}` | {key.words} |\n" for key in keys]
    return lambda: "".join(["| key | unit | default | example | meaning |\n| --- | --- | --- | --- | --- |\n", *rows])


PAGES: dict[Path, dict[str, Callable[[], str]]] = {
    README: {"find": find, "works": works, "answer": answer},
    DOCS / "accuracy.md": {"blind": BLIND, "background": BACKGROUND, "paired": PAIRED, "sbc": SBC, "scans": SCANS,
                           "kinect": KINECT, "sensitivity": SENSITIVITY, "equilibrium": EQUILIBRIUM, "firstuse": FIRST_USE},
    DOCS / "study.md": {"study": _keys("study"), "cable": _keys("cable"), "tolerance": _keys("tolerance"),
                        "unknown": _keys("unknown"), "pose": _keys("pose", "clamp"), "effect": _keys("effect")},
    DOCS / "compared.md": {"fit": FIT},
    DOCS / "adding-an-effect.md": {"laws": LAWS},
    DOCS / "missing-effects.md": {"memory": MEMORY},
    DOCS / "real" / "wing.md": {"wing": WING},
    DOCS / "scanning.md": {"formats": FORMATS, "extraction": EXTRACTION, "kinds": KINDS, "virtual": VIRTUAL},
    DOCS / "export.md": {"simulators": SIMULATORS},
    DOCS / "sweeps.md": {"workers": WORKERS, "batches": BATCHES},
    DOCS / "peers.md": {"ratios": RATIOS},
    DOCS / "robustness.md": {"extremes": EXTREMES, "attacks": ATTACKS},
    DOCS / "mistakes.md": {"mistakes": MISTAKES},
    DOCS / "real" / "tip-weights.md": {"weights": WEIGHTS},
}  # fmt: skip
"""By page, its tables in order."""


def pages() -> dict:
    """Every page with its tables, in the order of the page."""
    return PAGES


def filled(text: str, tables: dict) -> str:
    """The text with its tables made anew."""
    return _PART.sub(lambda m: m[1] + tables[m[2]]() + m[3], text)


def main() -> None:
    for page, tables in PAGES.items():
        page.write_text(filled(page.read_text(), tables))


if __name__ == "__main__":
    main()
