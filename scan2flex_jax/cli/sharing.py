"""Commands that write results for others to use: report, export."""

from pathlib import Path
from typing import Annotated

import typer

from scan2flex_jax.cli.options import (
    NOT_TO_BELIEVE,
    Elements,
    Force,
    JsonFile,
    Quiet,
    StudyFolder,
    begun,
    file_to_write,
    one_of,
)
from scan2flex_jax.cli.setup import prepare_jax, progress
from scan2flex_jax.cli.terminal import complain, say

_TO = ("mujoco", "pyelastica", "usd", "abaqus", "orcaflex", "moordyn", "cabledyn", "moduli", "json")


def report(
    study: StudyFolder,
    out: Annotated[Path, typer.Option("--out", "-o", help="HTML file to write.", callback=file_to_write)] = Path("report.html"),
    no_explain: Annotated[
        bool, typer.Option("--no-explain", help="Only the fit (fast): no search for missing physics, no next pose.")
    ] = False,
    interactive: Annotated[
        bool, typer.Option("--interactive", help="Add a plot of all poses that a mouse rotates; needs the extra [report].")
    ] = False,
    json: JsonFile = None,
    elements: Elements = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Write one self-contained page: the answer, shapes, errors, missing physics, forces, and the next pose to scan.

    It needs neither network nor script, and prints as a data sheet of two pages.

    Example: scan2flex report my-cable -o report.html
    """
    loaded, outputs = begun(study, force, out, json)
    folder = prepare_jax()
    from scan2flex_jax.cli.searches import explained  # noqa: PLC0415
    from scan2flex_jax.inference import Explanation, Fit, fit  # noqa: PLC0415
    from scan2flex_jax.reporting import report as page  # noqa: PLC0415
    from scan2flex_jax.reporting import require_libraries  # noqa: PLC0415

    if interactive:
        require_libraries()
    result: Fit | Explanation
    with progress(f"{'fitting' if no_explain else 'explaining'} {loaded.title}", quiet) as tell:
        if no_explain:
            result = fit(loaded, elements=elements, progress=tell)
        else:
            result = explained(loaded, elements, tell, folder, again=False)
        outputs.write(out, page(result, interactive=interactive, progress=tell).encode("utf-8"))
    say("\n".join(result.answer.lines()))
    say(f"\nwritten: {out}")
    if json:
        outputs.write_json(json, result.to_json())
    if not result.believable:
        raise typer.Exit(NOT_TO_BELIEVE)


def export(
    study: StudyFolder,
    to: Annotated[str, typer.Option(help=f"{', '.join(_TO[:-1])} or {_TO[-1]}.", **one_of(*_TO))],
    out: Annotated[Path, typer.Option("--out", "-o", help="File to write.", callback=file_to_write)],
    pose: Annotated[str | None, typer.Option(help="Pose in which the cable hangs; default: the first.")] = None,
    elements: Annotated[int, typer.Option(min=8, max=1000, help="Elements of the cable in the simulator.")] = 40,
    force: Force = False,
) -> None:
    """Write the calibrated cable for a simulator: a MuJoCo model, a PyElastica script, OpenUSD for Newton, sections for Abaqus,
    line types for OrcaFlex and MoorDyn, moduli for programs that take a diameter, or plain JSON.

    Every parameter must have a value: fit the study first, with --save.

    Example: scan2flex export calibrated --to mujoco -o cable.xml --pose sag
    """
    loaded, outputs = begun(study, force, out, purpose="predict")
    prepare_jax()
    from scan2flex_jax.export import export as run  # noqa: PLC0415
    from scan2flex_jax.export.cable import THIN  # noqa: PLC0415

    with progress(f"solving {loaded.title}"):
        text = run(loaded, to, pose=pose, elements=elements)
    outputs.write(out, text.encode("utf-8"))
    if to != "json" and loaded.cable.get("radius") is None:
        said = f"the study has no radius: the {to} file has {100 * THIN:g} % of the length, which changes no equilibrium"
        complain(f"{said}; set radius under [cable] if pictures, contact or motion matter.")
    say(f"written: {out}")
