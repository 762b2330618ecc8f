"""The page: the answer first, then shapes, errors and missing physics; full estimates and correlations last.

Plain HTML with embedded pictures and no script: it prints as a data sheet of two pages. A content security policy in the page
forbids every connection. The interactive page adds a rotatable plot of all poses, with plotly's script.
"""

from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from importlib import import_module, resources
from pathlib import Path
from typing import Any

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.inference import Explanation, Fit, explain, fit
from scan2flex_jax.reporting import figures, parts
from scan2flex_jax.reporting.contents import Contents, contents_of
from scan2flex_jax.reporting.html import Html, Part, joined, section, tag
from scan2flex_jax.study.model import Study
from scan2flex_jax.study.outputs import keep_measured, measured_files, write_file

_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data: blob:"
_OF_SCRIPTS = "; script-src 'unsafe-inline'"
_FEW = 1  # largest number of poses without a menu to choose one


def require_libraries() -> None:
    """Raise `Scan2FlexError` if plotly, which an interactive page needs, is not installed."""
    try:
        import_module("plotly")
    except ImportError as error:
        said = "an interactive report needs plotly, which is not installed"
        raise Scan2FlexError(f"{said}: pip install 'scan2flex_jax[report]', or leave --interactive out.") from error


def report(
    subject: Study | Fit | Explanation,
    *,
    explained: bool = True,
    interactive: bool = False,
    elements: int | None = None,
    progress: Callable[[str], None] | None = None,
) -> str:
    """The HTML page about a study, a `Fit` or an `Explanation`, as text.

    A study is explained first (or, with ``explained`` False, only fitted) with ``elements`` elements (as in `fit`).
    ``interactive`` adds all poses in a rotatable plot. ``progress`` is called with a line of text now and then. Raises
    `Scan2FlexError` if an interactive page lacks plotly (extra ``[report]``).
    """
    if interactive:
        require_libraries()
    progress = progress or (lambda message: None)
    if not isinstance(subject, Study):
        found = subject
    elif explained:
        found = explain(subject, elements=elements, progress=progress)
    else:
        found = fit(subject, elements=elements, progress=progress)
    contents = contents_of(found, progress=progress)
    progress("drawing the page")
    return _page(contents, interactive)


def save_report(subject: Study | Fit | Explanation, file: str | Path, **options: Any) -> Path:
    """Write `report` (same options) to a file, in one step; a study's own files are refused."""
    path, study = Path(file), subject if isinstance(subject, Study) else subject.study
    keep_measured(path, measured_files(study))  # refuse before computing for minutes
    write_file(path, report(subject, **options).encode("utf-8"), measured_files(study))
    return path


def _page(c: Contents, interactive: bool) -> str:
    here = resources.files("scan2flex_jax.reporting")
    policy = _POLICY + (_OF_SCRIPTS if interactive else "")
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", http_equiv="Content-Security-Policy", content=policy),
        tag("title", f"{c.study.title or 'A cable'} - scan2flex"),
        tag("style", Html((here / "page.css").read_text("utf-8"))),
    )
    written = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    made = f"; {c.fit.method} fit with {c.elements} elements" if c.fit else ""
    foot = tag("footer", f"scan2flex, {written}{made}", class_="soft")
    sections = tuple(_sections(c, interactive))
    body = tag("body", parts.header(c), parts.contents_list(sections), tag("main", sections), foot, _scripts(here, interactive))
    return f"<!doctype html>\n{tag('html', head, body, lang='en')}\n"


def _sections(c: Contents, interactive: bool) -> Iterator[Html]:
    yield parts.shapes(c)
    if interactive:
        yield section("space", "Shapes in space", *_in_space(c), class_="screen")
    yield from parts.errors(c)
    yield from parts.laws(c)
    yield from parts.loops(c)
    yield from parts.stiffness(c)
    yield from parts.missing(c)
    yield from parts.forces(c)
    yield from parts.next_pose(c)
    yield from parts.details(c)
    yield parts.again(c)


def _in_space(c: Contents) -> Iterator[Part]:
    """The plot in space, with a menu to choose one pose."""
    if len(c.poses) > _FEW:
        options = [tag("option", f"{name} ({p.role})", value=str(k)) for k, (name, p) in enumerate(c.poses.items())]
        yield tag("label", "Show ", tag("select", tag("option", "all poses", value=""), options, id="pose-choice"))
    said = "Dots: measured, coloured by their distance from the model. Grey line: modelled. Squares with a line: clamps and"
    yield tag("p", f"{said} their tangents. Drag to rotate, pinch or use the wheel to zoom.", class_="soft")
    yield tag("div", class_="plot", id="shapes-in-space", data_figure="shapes-in-space-data")
    yield tag("script", _json(figures.space(c.study, c.poses)), type="application/json", id="shapes-in-space-data")


def _json(figure) -> Html:
    """JSON of a figure, escaped so that no character in it can end the script element around it."""
    text = figure.to_json()
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return Html(text)


def _scripts(here, interactive: bool) -> Html:
    if not interactive:
        return Html()
    from plotly.offline import get_plotlyjs  # noqa: PLC0415

    return joined(tag("script", Html(get_plotlyjs())), tag("script", Html((here / "page.js").read_text("utf-8"))))
