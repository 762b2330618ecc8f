"""Commands that search for missing physics and for the next pose to measure: explain, plan."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from scan2flex_jax.cli.fleet import StudyFolders, Workers, each
from scan2flex_jax.cli.options import (
    NOT_TO_BELIEVE,
    Elements,
    Force,
    JsonFile,
    Quiet,
    StudyFolder,
    begun,
    draw_explanation,
    drawing,
    explained,
    explanation_pictures,
    folder_to_write,
    other_folder,
    picture_to_write,
    saved,
)
from scan2flex_jax.cli.setup import prepare_jax, progress
from scan2flex_jax.cli.terminal import say
from scan2flex_jax.errors import Scan2FlexError


def explain(
    studies: StudyFolders,
    json: JsonFile = None,
    figures: Annotated[
        Path | None, typer.Option(help="Folder for pictures of the evidence, residuals and shapes.", callback=folder_to_write)
    ] = None,
    save: Annotated[
        Path | None, typer.Option(help="Save the study with the effect declared to this folder.", callback=folder_to_write)
    ] = None,
    elements: Elements = None,
    workers: Workers = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Find which physics the model lacks, with the error before and after.

    Of several studies each is explained; {} in names of files stands for a study's name.

    Example: scan2flex explain my-cable --json result.json --figures pictures

    Example: scan2flex explain cable-1 cable-2 --json results/{}.json --workers 2
    """
    each(studies, partial(_explain, elements, force, quiet), workers, json=json, figures=figures, save=save)


def _explain(elements, force, quiet, study, *, say, json, figures, save) -> bool:
    """One study; returns whether to believe the result."""
    loaded, outputs = begun(study, force, json, *(explanation_pictures(figures) if figures else ()))
    other_folder(save, loaded.folder)
    result = explained(loaded, elements, prepare_jax(), quiet, say, again=True)
    if json:
        outputs.write_json(json, result.to_json())
    if figures and result.fit is not None:
        draw_explanation(result, figures, outputs.write)
    if save:
        saved(result.study, save, say)
    return result.believable


def plan(
    study: StudyFolder,
    json: JsonFile = None,
    figure: Annotated[
        Path | None, typer.Option(help="Draw what planned poses would show to this PNG or SVG.", callback=picture_to_write)
    ] = None,
    elements: Elements = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Say what planned poses will tell, or rank the next pose after some are measured.

    With poses that have clamps and no shape yet, and guesses of the unknowns: the intervals to expect, the smallest missing
    effects that would be found, and the pose to add. With measured poses: candidates by how much they would add to the answer.
    These vary the clamps of the first poses: twisted, rolled, nearer, aside. For your own poses use `scan2flex_jax.plan`.

    Example: scan2flex plan my-cable --json next.json
    """
    loaded, outputs = begun(study, force, json, figure, purpose="predict")
    folder = prepare_jax()
    from scan2flex_jax.inference import expect  # noqa: PLC0415
    from scan2flex_jax.inference import plan as rank  # noqa: PLC0415
    from scan2flex_jax.study.sense import check_study  # noqa: PLC0415

    if all(pose.curve is None and pose.scan is None and pose.markers is None for pose in loaded.fit_poses):
        with progress("solving planned poses", quiet):
            expected = expect(loaded, elements=elements)
        say(expected.summary())
        if figure:
            plot = drawing()
            plot.save(plot.expected(expected).figure, figure, write=outputs.write)
        if json:
            outputs.write_json(json, expected.to_json())
        return
    check_study(loaded)
    if figure:
        raise Scan2FlexError("--figure is for planned poses, and these are measured: use `scan2flex explain --figures`.")
    result = explained(loaded, elements, folder, quiet)
    with progress("solving candidate poses", quiet):
        ranked = rank(result)
    say("\n" + ranked.summary())
    if json:
        outputs.write_json(json, ranked.to_json())
    if not result.believable:
        raise typer.Exit(NOT_TO_BELIEVE)
