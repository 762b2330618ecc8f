"""What the commands share: exit codes, options that several have, and the steps that several take."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from scan2flex_jax.cli.setup import progress
from scan2flex_jax.errors import Scan2FlexError

BAD_INPUT, NOT_TO_BELIEVE = 2, 3
EXIT_CODES = (
    "Exit codes: 0 done; 1 a fault of the program itself; 2 input or options that cannot be used, one sentence on standard "
    "error; 3 computed, but not to be believed (a pose that could not be solved); 130 interrupted."
)

StudyFolder = Annotated[Path, typer.Argument(help="Folder of a study, with its study.toml.")]
JsonFile = Annotated[Path | None, typer.Option("--json", help="Write the result here, as JSON.")]
Elements = Annotated[int, typer.Option(min=8, max=5000, help="Elements of the rod.")]


def choices(*names: str):
    """Completion of an option's value by the shell."""
    return lambda incomplete: [name for name in names if name.startswith(incomplete)]


def interactive() -> bool:
    """Whether somebody is there to be asked."""
    return sys.stdin.isatty()


def explained(study, elements: int):
    """The explanation of a study, centre curves extracted first where poses have none; its summary is printed."""
    from scan2flex_jax.explain import explain as run  # noqa: PLC0415

    study = with_curves(study)
    with progress(f"explaining {study.title}") as tell:
        result = run(study, elements=elements, progress=tell)
    typer.echo(result.summary())
    return result


def with_curves(study):
    """The study itself, or with the centre curves of its scans where poses have none."""
    return study if all(pose.curve is not None for pose in study.poses) else extracted(study)[0]


def extracted(study):
    """``(study with curves, curves by pose)``."""
    from scan2flex_jax.scan import extract_study  # noqa: PLC0415

    with progress("extracting centre curves") as tell:
        return extract_study(study, progress=lambda name, i, n: tell(f"{name} ({i} of {n})"))


def drawing():
    """The module `plot`, with a backend that needs no screen."""
    import matplotlib as mpl  # noqa: PLC0415

    mpl.use("Agg")
    from scan2flex_jax import plot  # noqa: PLC0415

    return plot


def draw_explanation(result, folder: Path) -> None:
    """Pictures of the evidence, the residuals and the shapes."""
    plot = drawing()
    plot.save(plot.explained(result), folder / "explanation.png")
    plot.save(plot.overview(result), folder / "shapes.png")


def asked_or_refused(question: str, option: str, check, default: str | None = None):
    """``check(answer)`` of what a person answers; where nobody is there to be asked, a refusal that names the option."""
    if not interactive():
        raise Scan2FlexError(f"{question} is not known: give {option}.")
    while True:
        answer = typer.prompt(question[0].upper() + question[1:], default=default, show_default=bool(default))
        try:
            return check(answer)
        except Scan2FlexError as error:
            typer.echo(f"  {error}", err=True)
