"""Commands that estimate and predict: fit, simulate."""

from functools import partial
from itertools import chain
from pathlib import Path
from typing import Annotated

import typer

from scan2flex_jax.cli.fleet import StudyFolders, Workers, each
from scan2flex_jax.cli.frames import Convention, Radians, Tangent, Units
from scan2flex_jax.cli.options import (
    NOT_TO_BELIEVE,
    Elements,
    Force,
    JsonFile,
    Quiet,
    StudyFolder,
    begun,
    drawing,
    folder_to_write,
    one_of,
    other_folder,
    picture_to_write,
    saved,
)
from scan2flex_jax.cli.setup import prepare_jax, progress
from scan2flex_jax.cli.terminal import say

_METHODS, _DISTANCES = ("least-squares", "bfgs", "nelder-mead"), ("normal", "integrated", "hausdorff")


def fit(
    studies: StudyFolders,
    method: Annotated[str, typer.Option(help="least-squares, bfgs or nelder-mead.", **one_of(*_METHODS))] = "least-squares",
    distance: Annotated[
        str,
        typer.Option(help="normal, integrated (the paper's Eq. 10), or hausdorff.", **one_of(*_DISTANCES)),
    ] = "normal",
    json: JsonFile = None,
    save: Annotated[
        Path | None, typer.Option(help="Save the study with its estimates to this folder.", callback=folder_to_write)
    ] = None,
    figure: Annotated[
        Path | None, typer.Option(help="Draw measured and modelled shapes to this PNG or SVG.", callback=picture_to_write)
    ] = None,
    elements: Elements = None,
    workers: Workers = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Estimate the unknowns of a study from its shapes.

    Of several studies each is fitted; {} in names of files stands for a study's name.

    Example: scan2flex fit my-cable --json result.json --figure fit.png --save calibrated

    Example: scan2flex fit cable-1 cable-2 --json results/{}.json --workers 2
    """
    settings = {"method": method, "distance": distance, "elements": elements}
    each(studies, partial(_fit, settings, force, quiet), workers, json=json, save=save, figure=figure)


def _fit(settings, force, quiet, study, *, say, json, save, figure) -> bool:
    """One study; returns whether to believe the result."""
    loaded, outputs = begun(study, force, json, figure)
    other_folder(save, loaded.folder)
    prepare_jax()
    from scan2flex_jax.inference import fit as run  # noqa: PLC0415

    with progress(f"fitting {loaded.title}", quiet) as tell:
        elements = f", {settings['elements']} elements" if settings["elements"] else ""
        asked = f"{', '.join(loaded.unknown_names)} from {_poses(loaded)}{elements}"
        tell(f"{asked}; the first fit compiles first")
        result = run(loaded, **settings, progress=tell)
        tell("influence of each pose and of the stated values, and the score of what may be missing")
        said = result.summary()
    say(said)
    if json:
        outputs.write_json(json, result.to_json())
    if save:
        saved(result.calibrated, save, say)
    if figure:
        plot = drawing()
        plot.save(plot.overview(result), figure, write=outputs.write)
    return result.believable


def _poses(study) -> str:
    """The numbers of fitted and of validate poses, in words."""
    fitted, kept = len(study.fit_poses), len(study.validate_poses)
    return f"{fitted} pose{'s' * (fitted > 1)}" + (f" ({kept} more never fitted)" if kept else "")


def simulate(
    study: StudyFolder,
    out: Annotated[Path, typer.Option(help="Folder for the CSV files.", callback=folder_to_write)] = Path("simulated"),
    clamps: Annotated[
        Path | None, typer.Option(help="Poses to simulate instead of those of the study: a file of their clamps, as for new.")
    ] = None,
    units: Units = None,
    convention: Convention = None,
    radians: Radians = False,
    tangent: Tangent = "z",
    json: JsonFile = None,
    elements: Elements = None,
    force: Force = False,
) -> None:
    """Predict shapes, bend radii, section forces and moments, and clamp reactions of all poses.

    Every parameter must have a value: under [cable], or as a guess. Poses need only clamps.

    Example: scan2flex simulate calibrated --out predicted

    Example: scan2flex simulate calibrated --clamps layout.csv --units mm --convention kuka --out layout
    """
    loaded, outputs = begun(study, force, purpose="predict")
    prepare_jax()
    from scan2flex_jax.prediction import csv_files, posed, predict, write_csv  # noqa: PLC0415

    if clamps is not None:
        from scan2flex_jax.convert import read_frames  # noqa: PLC0415

        frames = read_frames(clamps, units=units or "m", convention=convention, degrees=not radians, tangent=tangent)
        loaded = posed(loaded, frames)
    outputs.claim(*chain(*csv_files((pose.name for pose in loaded.poses), out).values()), json)
    with progress(f"simulating {loaded.title}"):
        predictions = predict(loaded, elements=elements)
        files = write_csv(predictions, out, outputs.write)
    for name, p in predictions.items():
        say(f"{name}: {p.sentence()}, {int(p.verdict.steps)} steps -> {files[name][0]}")
        for line in p.lines() if bool(p.verdict.solved) else ():
            say(f"  {line}")
    if json:
        outputs.write_json(json, {n: p.to_json() for n, p in predictions.items()}, by_name=True)
    if not all(bool(p.verdict.solved) for p in predictions.values()):
        raise typer.Exit(NOT_TO_BELIEVE)
