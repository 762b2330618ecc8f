"""The page: contents and figures laid out by jinja2 (which escapes every text), with plotly's script inside.

A content security policy in the page forbids every connection, so that nothing of it depends on a network.
"""

import shlex
from collections.abc import Callable
from datetime import UTC, datetime
from importlib import import_module, resources
from pathlib import Path
from typing import Any

import numpy as np

from scan2flex_jax.diagnosis import Explanation, explain
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting import Fit, fit
from scan2flex_jax.fitting.problem import FIT_ELEMENTS
from scan2flex_jax.reporting import figures
from scan2flex_jax.reporting.contents import Contents, contents_of
from scan2flex_jax.study.model import Study
from scan2flex_jax.study.outputs import keep_measured, measured_files, write_file

_FEW = 1  # poses up to which a choice between them is of no use


def require_libraries() -> None:
    """Refuse in one sentence where the extra is not installed."""
    for name in ("plotly", "jinja2"):
        try:
            import_module(name)
        except ImportError as error:
            raise Scan2FlexError(
                f"a report needs {name}, which is not installed: pip install 'scan2flex_jax[report]'."
            ) from error


def report(
    subject: Study | Fit | Explanation,
    *,
    explained: bool = True,
    elements: int = FIT_ELEMENTS,
    progress: Callable[[str], None] | None = None,
) -> str:
    """The HTML page about a study, a `Fit` or an `Explanation`, as text.

    A study is explained first (or, with ``explained`` False, only fitted) with ``elements`` elements. ``progress`` is called
    with a line of text now and then. Raises `Scan2FlexError` where plotly or jinja2 is missing (extra ``[report]``).
    """
    require_libraries()
    progress = progress or (lambda message: None)
    if not isinstance(subject, Study):
        found = subject
    elif explained:
        found = explain(subject, elements=elements, progress=progress)
    else:
        found = fit(subject, elements=elements)
    contents = contents_of(found, progress=progress)
    progress("writing the page")
    return _render(contents)


def save_report(subject: Study | Fit | Explanation, file: str | Path, **options: Any) -> Path:
    """Write `report` (same options) to a file, in one step; a study's own files are refused."""
    path, study = Path(file), subject if isinstance(subject, Study) else subject.study
    keep_measured(path, measured_files(study))  # before minutes are spent
    write_file(path, report(subject, **options).encode("utf-8"), measured_files(study))
    return path


def _render(c: Contents) -> str:
    import jinja2  # noqa: PLC0415
    from plotly.offline import get_plotlyjs  # noqa: PLC0415

    here = resources.files("scan2flex_jax.reporting")
    loader = jinja2.FunctionLoader(lambda name: (here / name).read_text("utf-8"))
    environment = jinja2.Environment(
        autoescape=True, loader=loader, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {"mm": _mm, "number": _number, "figure": _figure_json}
    parts = {name: (here / name).read_text("utf-8") for name in ("page.css", "page.js")}
    return environment.get_template("page.html").render(
        c=c, plotly=get_plotlyjs(), style=parts["page.css"], script=parts["page.js"], figures=_figures(c), verdict=_verdict(c),
        command=_command(c), written=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"), choice=len(c.poses) > _FEW,
    )  # fmt: skip


def _figures(c: Contents) -> dict:
    """All figures of the page by name; a list of several where there is one for each pose."""
    out = dict.fromkeys(("errors", "correlation", "residuals", "evidence", "load", "sections"))
    out["shapes"] = figures.shapes(c.poses)
    if any(p.stable for p in c.poses):
        out["errors"] = figures.errors(c.poses)
    if c.fit and len(c.fit.labels) > 1:
        out["correlation"] = figures.correlation(c.fit.labels, c.fit.correlation)
    if c.explanation and c.explanation.noise:
        noise = c.explanation.noise.total
        seen = [p for p in c.poses if p.stable and p.before is not None and np.all(np.isfinite(p.before))]
        out["residuals"] = [figures.residual(p, noise) for p in seen]
        if c.explanation.concluded:
            out["evidence"] = figures.evidence(c.explanation)
        out["load"] = figures.load(c.explanation.load)
    if c.sections:
        names = [pose.name for pose in c.study.poses]
        labels = {
            "tension": "tension (N)",
            "shear": "shear force (N)",
            "bending": "bending moment (N m)",
            "torque": "torque (N m)",
        }
        out["sections"] = [figures.along(c.sections, names, quantity, label) for quantity, label in labels.items()]
    return out


def _figure_json(figure) -> str:
    """JSON of a figure that may stand inside a script element: no character in it can end that element."""
    import markupsafe  # noqa: PLC0415

    text = figure.to_json()
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return markupsafe.Markup(text)


def _verdict(c: Contents) -> tuple[str, str]:
    """``(words, tone)`` of the head of the page: good, fair or bad."""
    said = c.explanation or c.fit
    if said is not None and said.mistakes:
        return "the input is likely mistaken", "bad"
    if c.explanation:
        tones = {"no missing effect": "good", "explained": "good", "partly explained": "fair", "tied": "fair"}
        return _found(c.explanation), tones.get(c.explanation.verdict, "bad")
    if not all(p.stable for p in c.poses):
        return "a pose could not be solved", "bad"
    words = {True: ("predicts the poses that it never saw", "good"), False: ("does not predict to within the noise", "bad")}
    valid = None if c.fit is None else c.fit.valid
    return ("not validated", "fair") if valid is None else words[valid]


def _found(explanation: Explanation) -> str:
    """The verdict with the effects that were found, or those that are tied."""
    kinds = [r.kind.replace("_", " ") for r in explanation.chosen]
    if not kinds:
        return explanation.verdict
    rivals = [k.replace("_", " ") for r in explanation.chosen for k in r.tied_with]
    rivals = [k for k in dict.fromkeys(rivals) if k not in kinds]
    if explanation.verdict == "tied" and not rivals:  # with a smooth field, or with an error of what the study states
        rivals = ["something outside the catalogue"]
    return f"{explanation.verdict}: {' and '.join(kinds)}" + "".join(f" or {k}" for k in rivals)


def _command(c: Contents) -> str:
    folder = "STUDY" if c.study.folder is None else shlex.quote(Path(c.study.folder).name)
    only = "" if isinstance(c.explanation, Explanation) else " --no-explain"
    return f"scan2flex report {folder} -o report.html{only} --elements {c.elements}"


def _number(value, digits: int = 5) -> str:
    return "-" if value is None or not np.isfinite(value) else f"{value:.{digits}g}"


def _mm(metres) -> str:
    return "-" if metres is None or not np.isfinite(metres) else f"{1e3 * metres:.3f}"
