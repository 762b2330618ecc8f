"""The sections of the page in order: header with the answer, shapes, errors, missing physics, forces, next pose, details."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from scan2flex_jax import plot
from scan2flex_jax.inference import Explanation, Fit
from scan2flex_jax.reporting.contents import Contents
from scan2flex_jax.reporting.figures import svg
from scan2flex_jax.reporting.html import Html, Part, joined, section, table, tag
from scan2flex_jax.results.answer import digits_of, in_mm, noise_in_words
from scan2flex_jax.results.explanation import parameter_in_words
from scan2flex_jax.results.words import found_in_words

_TOGETHER = 4  # largest number of poses whose errors can be distinguished in one panel
_PANEL = (4.0, 3.5)  # inches of a panel; several are placed side by side
_WIDE = (4.8, 3.2)
_RANKED = 8  # effects in the table
_SHEET = ((6, "three"), (12, "four"))  # largest number of poses for so many columns of the printed sheet; beyond: five
_QUANTITIES = (
    ("tension", "tension (N)"),
    ("shear", "shear force (N)"),
    ("bending", "bending moment (N m)"),
    ("torque", "torque (N m)"),
)


def header(c: Contents) -> Html:
    """The answer: estimates, the stated values they depend on, error on unseen poses, belief, and warnings of `check`."""
    a = c.answer
    values = [
        tag("div", tag("b", row.symbol), tag("strong", row.value or "-"), tag("span", row.interval), tag("small", row.note),
            class_="value") for row in a.rows
    ]  # fmt: skip
    said: list[Part] = [tag("p", a.belief, class_=f"verdict {a.tone}")]
    said += [tag("p", tag("b", label), " ", text) for label, text in (("Rests on", a.rest), ("Unseen poses", a.unseen)) if text]
    said += [tag("p", doubt, class_="fair") for doubt in a.doubts]
    mistaken = c.explanation.mistakes if c.explanation else c.fit.mistakes if c.fit else ()
    said += [tag("p", f"likely mistake: {mistake}", class_="bad") for mistake in mistaken]
    if a.warnings:
        said += [tag("p", tag("b", "Warnings of check")), tag("ul", (tag("li", warning) for warning in a.warnings))]
    title = tag("h1", c.study.title or "A cable without a title")
    return tag("header", title, tag("div", values, class_="values") if values else "", said, id="answer")


def contents_list(sections: tuple[Html, ...]) -> Html:
    """Links to the sections."""
    found = [re.search(r'^<section id="([\w-]+)".*?><h2>(.*?)</h2>', part) for part in sections]
    return tag("nav", (tag("a", Html(match[2]), href=f"#{match[1]}") for match in found if match))


def shapes(c: Contents) -> Html:
    """One panel per pose (measured, modelled, before), and a table of the distances of all poses."""
    head = ("pose", "role", "before (mm)", "RMS (mm)", "largest (mm)", "left out, before (mm)", "left out (mm)", "without it",
            "")  # fmt: skip
    figures = ("rms_before", "rms", "worst", "left_out_before", "left_out")  # some are those of an explanation
    rows = [
        (name, p.role, *(mm(getattr(p, figure, None)) for figure in figures), c.without.get(name, ""),
         "" if p.stable else tag("span", "not solved", class_="bad"))
        for name, p in c.poses.items()
    ]  # fmt: skip
    said = "Poses with the role “validate” had no part in the fit."
    said += " “Left out”: each fitted pose predicted from the others." if any(row[6] for row in rows) else ""
    moved = any(c.without.values())
    said += " “Without it”: change of the stiffnesses when the pose is left out, to first order." if moved else ""
    return section(
        "poses", "Shapes, measured and modelled", _sheet([_shape(c, name) for name in c.poses]),
        table(head, rows, range(2, 7)), tag("p", said, class_="soft"), _readings(c),
    )  # fmt: skip


def _sheet(panels: list[Html]) -> Html:
    """Panels in the columns of the printed sheet."""
    columns = next((words for most, words in _SHEET if len(panels) <= most), "five")
    return tag("div", panels, class_=f"grid {columns}")


def _readings(c: Contents) -> Part:
    """A table of the angles and wrenches of all poses; empty without any."""
    rows = [
        (name, one.words, *(" ".join(f"{x:.4g}" for x in values) for values in (one.measured, one.modelled)), one.unit,
         f"{one.off:.2g}")
        for name, p in c.poses.items() for one in p.readings
    ]  # fmt: skip
    head = ("pose", "reading", "measured", "modelled", "unit", "off, over its noise")
    return table(head, rows, (5,)) if rows else ""


def _shape(c, name):
    if name in c.found.poses:
        return _panel(lambda ax: plot.shapes(c.found, name, ax), f"shape of pose {name}")
    return _panel(lambda ax: plot.measured(c.study, name, ax), f"shape of pose {name} as it was measured")


def _panel(draw, alt: str, size: tuple[float, float] = _PANEL) -> Html:
    return tag("figure", svg(draw, *size, alt))


def errors(c: Contents) -> Iterator[Html]:
    """Errors along the cable: one panel, or one per pose."""
    found = c.found
    names = [name for name, p in found.poses.items() if p.stable and len(p.residual)]
    if not names:
        return
    if len(names) <= _TOGETHER and len(names) == len(found.poses):
        drawn = _panel(lambda ax: plot.errors(found, ax=ax), "errors of all poses along the cable", _WIDE)
        yield section("errors", "Errors along the cable", drawn, class_="sheet")
        return
    top = 1.05e3 * max(float(np.nanmax(np.linalg.norm(found.poses[name].residual, axis=1))) for name in names)

    def one(ax, name):
        plot.errors(found, name, ax).set_ylim(0.0, max(top, ax.get_ylim()[1]))

    panels = [_panel(lambda ax, name=name: one(ax, name), f"errors of pose {name}", (4.0, 2.6)) for name in names]
    yield section("errors", "Errors along the cable", _sheet(panels), class_="sheet")


def missing(c: Contents) -> Iterator[Html]:
    """Missing physics: the finding, the effect types with their evidence, residuals, and the load common to all poses."""
    e = c.explanation
    if e is None:
        return
    found = found_in_words(e)
    said: list[Part] = [tag("p", tag("strong", f"{e.verdict}: {found}" if found else e.verdict))]
    said += [tag("p", sentence) for sentence in e.sentences if not e.mistakes]
    if e.settle:
        said += [tag("p", "To settle it:"), tag("ul", (tag("li", sentence) for sentence in e.settle))]
    if e.noise is not None and e.concluded:
        said += [_ranking(e), _panel(lambda ax: plot.comparison(e, ax), "comparison of the hypotheses", _WIDE)]
    if e.noise is not None:
        said.append(tag("div", _residuals(e), class_="screen"))
    yield section("missing", "What the model lacks", said, class_="lacks")


def _residuals(e: Explanation) -> Iterator[Html]:
    """Residuals of every pose before and after, and the load common to all poses."""
    names = [name for name, p in e.poses.items() if p.stable and len(p.s) and np.all(np.isfinite(p.residual_before))]
    yield tag("h3", "Residual before and after")
    panels = (_panel(lambda ax, name=name: plot.residual(e, name, ax), f"residual of pose {name}") for name in names)
    yield tag("div", panels, class_="grid")
    if e.load is not None and not (e.chosen and e.concluded):  # after an effect is found, nothing remains to be placed
        said = "Equivalent load common to all poses, with its 95 % band: where a missing effect acts, not which one it is"
        yield tag("h3", said)
        yield _panel(lambda ax: plot.load(e, ax), "equivalent load along the cable", _WIDE)


def _ranking(e: Explanation) -> Html:
    study = e.fit.study if e.fit is not None else e.study

    def words(r):
        tied = f", tied with {', '.join(r.tied_with)}" if r.tied_with else ""
        return f"{e.in_words(r)}{tied}".replace("tied, tied with", "tied with")

    rows = [
        (r.kind, f"{r.log_evidence:.1f}", f"{r.p_value:.3f}", words(r),
         "; ".join(f"{n} {parameter_in_words(study, r.kind, n, value, r.std.get(n))}" for n, value in r.parameters.items()))
        for r in e.ranking[:_RANKED]
    ]  # fmt: skip
    return table(("effect", "log evidence (nats)", "p", "verdict", "parameters (95 % intervals)"), rows, (1, 2))


def _telling(c: Contents, name: str) -> Fit | Explanation | None:
    """The explanation, or else the fit, if it has ``name``."""
    return next((x for x in (c.explanation, c.fit) if x is not None and getattr(x, name)), None)


def laws(c: Contents) -> Iterator[Html]:
    """Moment over curvature or twist, with its band and what is read off it."""
    subject = _telling(c, "laws")
    if subject is None:
        return
    panels, rows = [], []
    for law in subject.laws:
        panels.append(_panel(lambda ax, kind=law.kind: plot.law(subject, kind, ax), f"moment of the {law.kind}", _WIDE))
        found = [(r.name, number(r.value, 3), f"{number(r.low, 3)} to {number(r.high, 3)}", r.unit) for r in law.readings]
        rows += [(law.kind, *row) for row in found]
    said = [tag("p", sentence) for law in subject.laws for sentence in law.sentences()]
    read = [table(("law", "read off it", "value", "95 % interval", "unit"), rows, (2, 3))] if rows else []
    yield section("laws", "Moment over strain", said, tag("div", panels, class_="grid"), *read)


def loops(c: Contents) -> Iterator[Html]:
    """Stick and slip stiffness, and the energy of a cycle, of effects with memory."""
    subject = _telling(c, "loops")
    if subject is None:
        return
    rows = [(x.kind, x.of, name, number(value, 3), unit) for x in subject.loops for name, (value, unit) in x.values.items()]
    said = "Of a section in pure bending or twist, to and fro between the largest strains of the fitted poses."
    head = ("effect", "in", "read off it", "value", "unit")
    yield section("loops", "Hysteresis", tag("p", said, class_="soft"), table(head, rows, (3,)))


def stiffness(c: Contents) -> Iterator[Html]:
    """EI along the cable with its band, where it varies."""
    subject = _telling(c, "along")
    if subject is None or subject.along is None:
        return
    panel = _panel(lambda ax: plot.stiffness(subject, ax), "bending stiffness along the cable", _WIDE)
    said = [tag("p", sentence) for sentence in subject.along.sentences()]
    yield section("stiffness", "Stiffness along the cable", said, tag("div", [panel], class_="grid"))


def forces(c: Contents) -> Iterator[Html]:
    """Forces and moments along the cable, and reactions of the supports."""
    if c.predictions:
        found = c.predictions.items()
        values = {q: {name: (p.section_s, getattr(p, q)) for name, p in found} for q, _ in _QUANTITIES}
        panels = [
            _panel(lambda ax, name=name, label=label: plot.along(values[name], label, ax), f"{label} along the cable")
            for name, label in _QUANTITIES
        ]
        rows = [
            (name, end, *_sized(p.reaction_force[k]), *_sized(p.reaction_moment[k]))
            for name, p in found for k, end in enumerate(("start", "end"))
        ]  # fmt: skip
        head = ("pose", "support", "force on the cable (N), scan frame", "size (N)", "moment (N m)", "size (N m)")
        said = "Of the calibrated cable, with clamps and length as stated in the study. Tension is positive in a stretched"
        text = tag("p", f"{said} cable, torque about the tangent.", class_="soft")
        parts = (text, tag("div", panels, class_="grid"), table(head, rows, range(2, 6)), _unsolved(c))
        yield section("sections", "Forces and moments along the cable", *parts, class_="screen")
    elif c.unsolved:
        yield section("sections", "Forces and moments along the cable", _unsolved(c), class_="screen")


def _unsolved(c: Contents) -> Html:
    return joined(tag("p", f"No forces for {sentence}", class_="fair") for sentence in c.unsolved)


def next_pose(c: Contents) -> Iterator[Html]:
    """Candidates for the next pose to scan."""
    if c.plan is None:
        if c.explanation is None:
            said = "The search for missing physics and for the next pose was skipped (--no-explain)."
            yield section("next", "What to scan next", tag("p", said, class_="soft"), class_="screen")
        return
    pairs = list(c.plan.candidates[0].lead_now) if c.plan.candidates else []
    head = ("pose", "gain for the parameters (nats)", *(f"{a} or {b} (nats)" for a, b in pairs), "")
    rows = [("none more", "0.00", *(f"{c.plan.candidates[0].lead_now[p]:.1f}" for p in pairs), "")] if pairs else []
    for k in c.plan.candidates:
        rows.append((k.words, f"{k.parameters:.2f}", *(f"{k.settles.get(p, 0.0):.1f}" for p in pairs), k.note))
    said = "The most informative pose first. A lead of three nats or more distinguishes a pair of rival effects."
    found = table(head, rows, range(1, 1 + 1 + len(pairs)))
    yield section("next", "What to scan next", found, tag("p", said, class_="soft"), class_="screen")


def details(c: Contents) -> Iterator[Html]:
    """Every estimate in full, the noise, all sentences, and correlations last."""
    rows = list(_estimates(c))
    if not rows and not c.sentences:
        return
    parts: list[Part] = []
    if rows:
        parts.append(table(("parameter", "before", "value", "95 % interval", "unit", ""), rows, (1, 2, 3)))
        wide = " “Before” is the baseline model; after it, intervals cover all tied effects." if c.explanation else ""
        parts.append(tag("p", f"An interval holds when the model is right.{wide}{_noise(c)}", class_="soft"))
    said = [sentence for sentence in c.sentences if c.explanation is None or sentence not in c.explanation.sentences]
    parts += [tag("ul", (tag("li", sentence) for sentence in said))] if said else []
    if c.fit and len(c.fit.labels) > 1:
        width = 1.6 + 0.6 * len(c.fit.labels)
        parts.append(tag("h3", f"Correlations{' in the baseline fit' if c.explanation else ''}"))
        parts.append(_panel(lambda ax: plot.correlations(c.fit, ax), "correlations of the estimates", (width, width)))
    yield section("details", "Every estimate in full", parts, class_="screen")


def _estimates(c: Contents) -> Iterator[tuple[str, ...]]:
    """The rows of all estimated numbers, for an explanation with their values in the baseline fit."""
    for name, e in (c.found.estimates if c.fit else {}).items():
        unit = "" if e.unit == "-" else e.unit
        notes = ["not determined by these poses"] * (not e.identifiable) + ["at a bound of its range"] * e.at_bound
        before = c.fit.estimates[name].value if c.fit and c.explanation else None
        for i, value in enumerate(np.ravel(e.value)):
            low, high, old = (np.nan if v is None else float(np.ravel(v)[i]) for v in (e.low, e.high, before))
            digits = digits_of(value, low, high, least=4)
            interval = "none" if e.low is None else f"{number(low, digits)} to {number(high, digits)}"
            label = f"{name}[{i}]" if np.ndim(e.value) else name
            yield (label, number(old, digits) if c.explanation else "", number(value, digits), interval, unit, "; ".join(notes))


def _noise(c: Contents) -> str:
    n = c.explanation.noise if c.explanation else c.fit.noise if c.fit else None
    return "" if n is None or c.fit is None else f" Noise: {noise_in_words(n, c.fit.problem.length)}."


def again(c: Contents) -> Html:
    """Reproduction of the page: command, versions, files."""
    folder = "STUDY" if c.study.folder is None else shlex.quote(Path(c.study.folder).name)
    only = "" if isinstance(c.explanation, Explanation) else " --no-explain"
    command = f"scan2flex report {folder} -o report.html{only} --elements {c.elements}"
    parts: list[Part] = [tag("pre", command), table(("library", "version"), c.versions)]
    if c.inputs:
        files = table(("file", "SHA-256"), [(name, tag("code", digest)) for name, digest in c.inputs])
        parts.append(tag("details", tag("summary", "Files that were read (SHA-256)"), files))
    parts.append(tag("details", tag("summary", "study.toml"), tag("pre", c.toml)))
    return section("again", "Reproduction", parts, class_="screen")


def number(value: float | None, digits: int = 5) -> str:
    """``digits`` significant digits; a dash for an unknown value."""
    return "-" if value is None or not np.isfinite(value) else f"{value:.{digits}g}"


def mm(metres: float | None) -> str:
    """Millimetres; a dash for a value that could not be computed, empty text for None."""
    return "" if metres is None else "-" if not np.isfinite(metres) else in_mm(metres)


def _sized(vector: np.ndarray) -> tuple[str, str]:
    """A vector, and its size."""
    return " ".join(number(float(v), 3) for v in vector), number(float(np.linalg.norm(vector)), 4)
