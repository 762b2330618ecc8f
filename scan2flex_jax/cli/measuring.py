"""Commands on measurements before a fit: pose, curve, check."""

from pathlib import Path
from typing import Annotated

import typer

from scan2flex_jax.cli.frames import Columns, Convention, Radians, Tangent, Units, numbers
from scan2flex_jax.cli.options import Force, JsonFile, StudyFolder, begun, file_to_write
from scan2flex_jax.cli.terminal import say
from scan2flex_jax.errors import Scan2FlexError


def pose(
    file: Annotated[
        Path | None,
        typer.Argument(help="Matrices by name, poses as a robot prints them, or a CSV of names, x,y,z and rotations."),
    ] = None,
    matrix: Annotated[str | None, typer.Option(help="One matrix, 16 (or 12) numbers row by row.")] = None,
    position: Annotated[str | None, typer.Option(help="One position, x,y,z.")] = None,
    angles: Annotated[str | None, typer.Option(help="Its three angles, in the --convention.")] = None,
    convention: Convention = None,
    units: Units = None,
    radians: Radians = False,
    tangent: Tangent = "z",
    json: JsonFile = None,
    force: Force = False,
) -> None:
    """Turn 4x4 matrices and Euler angles into the position and quaternion of a study.

    Example: scan2flex pose flange.csv --convention kuka --units mm --tangent x

    Example: scan2flex pose --position 0.5,0,0.3 --angles 0,90,0 --convention rpy
    """
    import numpy as np  # noqa: PLC0415

    from scan2flex_jax.convert import clamp_of_angles, clamp_of_matrix, clamp_toml, read_frames  # noqa: PLC0415
    from scan2flex_jax.study.outputs import Outputs  # noqa: PLC0415

    outputs = Outputs(source=file, force=force)
    outputs.claim(json)
    if sum(given is not None for given in (file, matrix, position)) != 1:
        raise Scan2FlexError("give one of a file, --matrix, and --position with --angles.")
    unit = units or "m"
    if file is not None:
        found = read_frames(file, units=unit, convention=convention, degrees=not radians, tangent=tangent)
    elif matrix is not None:
        count = len(matrix.replace(",", " ").split())
        values = numbers(matrix, 12 if count == 12 else 16, "matrix")
        found = {"": clamp_of_matrix(np.reshape(values, (-1, 4)), units=unit, tangent=tangent)}
    elif angles is None or convention is None:
        raise Scan2FlexError("a position needs --angles and their --convention: kuka, rpy, or axes as in ZYX.")
    else:
        where = numbers(position, 3, "position"), numbers(angles, 3, "angles")
        found = {"": clamp_of_angles(*where, convention, units=unit, degrees=not radians, tangent=tangent)}
    for name, clamp in found.items():
        say(f"{name} = {clamp_toml(clamp)}" if name else clamp_toml(clamp))
    if json:
        clamps = {name: {"position": c.position, "quaternion": c.quaternion} for name, c in found.items()}
        outputs.write_json(json, clamps, by_name=True)


def curve(
    file: Annotated[Path, typer.Argument(help="Text file with a centre curve, as another tool wrote it.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="CSV to write; left out, the numbers are only looked at.", callback=file_to_write),
    ] = None,
    units: Units = None,
    columns: Columns = None,
    json: JsonFile = None,
    force: Force = False,
) -> None:
    """Turn a centre curve of another tool into the CSV of a study: separators, decimal commas, columns and units.

    Example: scan2flex curve export.txt --units mm --columns=-,x,y,z -o sag.csv
    """
    from scan2flex_jax.convert import read_foreign_curve  # noqa: PLC0415
    from scan2flex_jax.study.curves import curve_length  # noqa: PLC0415
    from scan2flex_jax.study.outputs import Outputs  # noqa: PLC0415
    from scan2flex_jax.study.write import csv_text  # noqa: PLC0415

    outputs = Outputs(source=file, force=force)
    outputs.claim(out, json)
    found = read_foreign_curve(file, units=units, columns=columns)
    long = curve_length(found.curve.points)
    for note in (*found.notes, f"{long:.4f} m long"):
        say(note)
    if out:
        outputs.write(out, csv_text(found.curve).encode("ascii"))
    if json:
        outputs.write_json(json, {"points": len(found.curve.points), "arc_length": long, "notes": list(found.notes)})


def check(study: StudyFolder, json: JsonFile = None, force: Force = False) -> None:
    """Read a study; print its contents and warnings.

    Example: scan2flex check my-cable
    """
    from scan2flex_jax.study import describe, study_warnings  # noqa: PLC0415

    loaded, outputs = begun(study, force, json)
    scans = scans_of(loaded)
    say(describe(loaded, scans))
    if json:
        holds = {n: {"points": count, "size": size} for n, (count, size) in scans.items()}
        poses = {p.name: _measured(p, holds.get(p.name)) for p in loaded.poses}
        names = list(loaded.unknown_names)
        said = {"title": loaded.title, "unknown": names, "poses": poses, "warnings": study_warnings(loaded)}
        outputs.write_json(json, said)


def _measured(pose, scan):
    """The measurements of a pose, for the JSON of `check`."""
    markers = 0 if pose.markers is None else len(pose.markers.points)
    return {"role": pose.role, "curve": pose.curve is not None, "scan": scan, "markers": markers}


def scans_of(study):
    """``(points, extents in m)`` of every scan, by pose."""
    from scan2flex_jax.study.scans import scan_facts  # noqa: PLC0415

    return {pose.name: scan_facts(pose.scan) for pose in study.poses if pose.scan is not None}
