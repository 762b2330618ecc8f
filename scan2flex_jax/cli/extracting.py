"""The command that finds centre curves in scans: extract."""

from pathlib import Path
from typing import Annotated

import typer

from scan2flex_jax.cli.options import (
    NOT_TO_BELIEVE,
    Force,
    JsonFile,
    Quiet,
    StudyFolder,
    begun,
    drawing,
    extracted,
    folder_to_write,
    saved,
)
from scan2flex_jax.cli.setup import prepare_jax
from scan2flex_jax.cli.terminal import say


def extract(
    study: StudyFolder,
    save: Annotated[
        Path | None,
        typer.Option(help="Folder for the study with its curves; default: the study itself.", callback=folder_to_write),
    ] = None,
    figures: Annotated[Path | None, typer.Option(help="Folder for a picture per pose.", callback=folder_to_write)] = None,
    json: JsonFile = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Extract the centre curves of scanned poses and write them into the study.

    Ends with exit code 3 if a curve is doubtful; its sentence gives the reason.

    Example: scan2flex extract my-cable --figures pictures
    """
    from scan2flex_jax.names import file_stems  # noqa: PLC0415
    from scan2flex_jax.study import load_study  # noqa: PLC0415

    loaded, outputs = begun(study, force)
    scanned = [pose.name for pose in loaded.poses if pose.scan is not None and pose.curve is None]
    pictures = {n: figures / f"{stem}.png" for n, stem in file_stems(scanned, (".png",)).items()} if figures else {}
    outputs.claim(*pictures.values(), json)
    prepare_jax()
    found, curves = extracted(loaded, quiet)
    toml = saved(found, save or study)
    written = {pose.name: pose.curve.path for pose in load_study(toml).poses if pose.name in curves and pose.curve is not None}
    for name, one in curves.items():
        said = "".join(f"; {warning}" for warning in one.warnings)
        into = f" -> {written[name]}" if name in written else ""
        say(f"{name}: {one.arc_length[-1]:.4f} m of centre curve{into}{said}")
        if name in pictures:
            drawing()
            from scan2flex_jax.scan import save_picture  # noqa: PLC0415

            save_picture(one, pictures[name], name, outputs.write)
            if pictures[name].stem != name:
                say(f"  its picture is {pictures[name]}")
    said = "with these curves" if curves else "unchanged: every pose with a scan has its centre curve"
    say(f"written: {toml}, {said}")
    if json:
        outputs.write_json(json, {n: _curve_to_json(c) for n, c in curves.items()}, by_name=True)
    if not all(c.sure for c in curves.values()):
        raise typer.Exit(NOT_TO_BELIEVE)


def _curve_to_json(curve):
    numbers = {"arc_length": float(curve.arc_length[-1]), "noise": float(curve.noise), "sure": curve.sure}
    return numbers | {"warnings": list(curve.warnings), "gaps": [list(gap) for gap in curve.gaps]}
