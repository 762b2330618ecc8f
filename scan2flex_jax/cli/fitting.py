"""Commands that estimate and predict: fit, simulate."""

from itertools import chain
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
    choices,
    drawing,
    folder_to_write,
    picture_to_write,
)
from scan2flex_jax.cli.setup import prepare_jax, progress
from scan2flex_jax.cli.terminal import say

_METHODS, _DISTANCES = ("least-squares", "bfgs", "nelder-mead"), ("normal", "integrated", "hausdorff")


def fit(
    study: StudyFolder,
    method: Annotated[
        str, typer.Option(help="least-squares, bfgs or nelder-mead.", autocompletion=choices(*_METHODS))
    ] = "least-squares",
    distance: Annotated[
        str,
        typer.Option(help="normal, integrated (the paper's Eq. 10), or hausdorff.", autocompletion=choices(*_DISTANCES)),
    ] = "normal",
    json: JsonFile = None,
    save: Annotated[
        Path | None, typer.Option(help="Save the study with its estimates to this folder.", callback=folder_to_write)
    ] = None,
    figure: Annotated[
        Path | None, typer.Option(help="Draw measured and modelled shapes to this PNG or SVG.", callback=picture_to_write)
    ] = None,
    elements: Elements = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Estimate the unknowns of a study from its shapes.

    Example: scan2flex fit my-cable --json result.json --figure fit.png --save calibrated
    """
    from scan2flex_jax.study import load_study, save_study  # noqa: PLC0415
    from scan2flex_jax.study.outputs import Outputs  # noqa: PLC0415

    loaded = load_study(study)
    outputs = Outputs(loaded, source=study, force=force)
    outputs.claim(json, figure)
    prepare_jax()
    from scan2flex_jax.inference import fit as run  # noqa: PLC0415

    with progress(f"fitting {loaded.title}", quiet) as tell:
        asked = f"{', '.join(loaded.unknown_names)} from {_poses(loaded)}" + (f", {elements} elements" if elements else "")
        tell(f"{asked}; the first fit compiles first")
        result = run(loaded, method, distance=distance, elements=elements, progress=tell)
        tell("influence of each pose and of the stated values")
        said = result.summary()
    say(said)
    if json:
        outputs.write_json(json, result.to_json())
    if save:
        save_study(result.calibrated, save)
    if figure:
        plot = drawing()
        plot.save(plot.overview(result), figure, write=outputs.write)
    if not result.believable:
        raise typer.Exit(NOT_TO_BELIEVE)


def _poses(study) -> str:
    """The numbers of fitted and of validate poses, in words."""
    fitted, kept = len(study.fit_poses), len(study.validate_poses)
    return f"{fitted} pose{'s' * (fitted > 1)}" + (f" ({kept} more never fitted)" if kept else "")


def simulate(
    study: StudyFolder,
    out: Annotated[Path, typer.Option(help="Folder for the CSV files.", callback=folder_to_write)] = Path("simulated"),
    json: JsonFile = None,
    elements: Elements = None,
    force: Force = False,
) -> None:
    """Predict shapes, section forces and moments, and clamp reactions of all poses, as CSV.

    Every parameter must have a value: under [cable], or as a guess. Poses need only clamps.

    Example: scan2flex simulate calibrated --out predicted
    """
    from scan2flex_jax.study import load_study  # noqa: PLC0415
    from scan2flex_jax.study.outputs import Outputs  # noqa: PLC0415

    loaded = load_study(study, purpose="predict")
    outputs = Outputs(loaded, source=study, force=force)
    prepare_jax()
    from scan2flex_jax.prediction import csv_files, predict, write_csv  # noqa: PLC0415

    outputs.claim(*chain(*csv_files((pose.name for pose in loaded.poses), out).values()), json)
    with progress(f"simulating {loaded.title}"):
        predictions = predict(loaded, elements=elements)
        files = write_csv(predictions, out, outputs.write)
    for name, p in predictions.items():
        say(f"{name}: {p.sentence()}, {int(p.verdict.steps)} steps -> {files[name][0]}")
    if json:
        outputs.write_json(json, {n: p.to_json() for n, p in predictions.items()})
    if not all(bool(p.verdict.solved) for p in predictions.values()):
        raise typer.Exit(NOT_TO_BELIEVE)
