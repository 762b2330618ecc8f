"""Commands that come before a fit: new, pose, curve, check."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

from scan2flex_jax.cli.options import (
    Force,
    JsonFile,
    StudyFolder,
    asked_or_refused,
    choices,
    file_to_write,
    folder_to_write,
    interactive,
)
from scan2flex_jax.cli.terminal import say
from scan2flex_jax.errors import Scan2FlexError

_UNITS = ("m", "dm", "cm", "mm", "um", "in", "ft")
_CONVENTIONS = ("kuka", "fanuc", "staubli", "kawasaki", "rpy", "rotvec", "ZYX", "XYZ", "xyz", "zyx")
Units = Annotated[
    str | None,
    typer.Option(help=f"Unit of lengths in the files: {', '.join(_UNITS)}.", autocompletion=choices(*_UNITS)),
]
Columns = Annotated[str | None, typer.Option(help="Columns of a curve, as in s,x,y,z or -,x,y,z.")]
Convention = Annotated[
    str | None,
    typer.Option(
        help="Convention of three angles: kuka, fanuc, staubli, kawasaki, rpy, rotvec, or axes (ZYX moving, xyz fixed).",
        autocompletion=choices(*_CONVENTIONS),
    ),
]
Radians = Annotated[bool, typer.Option("--radians", help="Angles are in radians, not in degrees.")]
Tangent = Annotated[
    str,
    typer.Option(
        help="Axis of the given frames along the cable, from start to end: x, y, z, -x, -y, -z.",
        autocompletion=choices("x", "y", "z", "-x", "-y", "-z"),
    ),
]


def new(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of scans or centre curves, one file a pose.")],
    length: Annotated[str | None, typer.Option(help="Length between the clamps, as in 0.9, '900 mm' or '900 +- 1 mm'.")] = None,
    density: Annotated[str | None, typer.Option(help="Mass per length, as in 0.336 or '336 +- 2 g/m'.")] = None,
    mass: Annotated[str | None, typer.Option(help="Mass of that length, in place of --density, as in '302 +- 1 g'.")] = None,
    radius: Annotated[str | None, typer.Option(help="Radius of the cable, needed by scans, as in '4 mm'.")] = None,
    clamps: Annotated[
        Path | None, typer.Option(help="File of the clamps, by the names 'POSE start' and 'POSE end': see scan2flex pose.")
    ] = None,
    clamps_from_curves: Annotated[
        bool, typer.Option("--clamps-from-curves", help="Take the clamps from the ends of the curves, without twist.")
    ] = False,
    units: Units = None,
    columns: Columns = None,
    convention: Convention = None,
    radians: Radians = False,
    tangent: Tangent = "z",
    gravity: Annotated[str | None, typer.Option(help="Gravity in the scan frame, m/s^2; default: 0,0,-9.81.")] = None,
    validate: Annotated[list[str] | None, typer.Option(help="Validate pose, which no fit uses; may be repeated.")] = None,
    title: Annotated[str | None, typer.Option(help="Title of the study.")] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the study; default: DIR itself.", callback=folder_to_write)
    ] = None,
) -> None:
    """Make a study from a folder of scans or centre curves; prompts for missing values.

    Example: scan2flex new scans --units mm --length '900 mm' --mass '302 g' --clamps clamps.csv --convention kuka
    """
    from scan2flex_jax.convert import measured_files, new_study, read_frames  # noqa: PLC0415
    from scan2flex_jax.study import describe, load_study, save_study  # noqa: PLC0415

    poses = measured_files(folder, () if clamps is None else (clamps,))
    say(f"{len(poses)} poses: {', '.join(pose.name for pose in poses)}")
    long, heavy, tolerance = _length_and_weight(length, density, mass)
    thick = None
    if radius is not None or any(pose.scan for pose in poses):
        thick = _quantity(radius, "length", "the radius of the cable", "--radius")[0]
    if clamps_from_curves and clamps is not None:
        raise Scan2FlexError("--clamps and --clamps-from-curves were both given: leave one out.")
    frames = None
    if clamps is not None:
        frames = read_frames(clamps, units=units or "m", convention=convention, degrees=not radians, tangent=tangent)
    elif not clamps_from_curves:
        frames = _asked_clamps(poses, units or "m", convention, not radians, tangent)
    study, notes = new_study(
        folder, poses, length=long, length_density=heavy, clamps=frames, radius=thick, title=title or "",
        gravity=_gravity(gravity), units=units, columns=columns, validate=_validated(validate, poses), tolerance=tolerance,
    )  # fmt: skip
    scans = _scans(study)  # read before anything is written
    toml = save_study(study, out or folder)
    for note in (*notes, *_assumed(gravity, units, tangent, frames)):
        say(f"  {note}")
    made = load_study(toml)
    say(f"\n{describe(made, scans)}")
    if frames is not None:
        _suggest_tangent(made, tangent)
    say(f"written: {toml}; look it through, then: scan2flex fit {shlex.quote(str(toml.parent))}")


def _length_and_weight(length, density, mass):
    """Length (m), mass per length (kg/m), and the tolerance of both."""
    from scan2flex_jax.study import Tolerance  # noqa: PLC0415

    long, of_length = _quantity(length, "length", "the length of the cable between its clamps", "--length")
    if mass is not None and density is not None:
        raise Scan2FlexError("the mass and the density were both given: leave one of --mass and --density out.")
    if mass is not None:
        heavy, of_weight = (value / long for value in _quantity(mass, "mass", "", ""))
    else:
        question = "the mass per length of the cable"
        heavy, of_weight = _quantity(density, "length density", question, "--density (or --mass)")
    return long, heavy, Tolerance(length=of_length, length_density=of_weight)


def _validated(given, poses):
    """Names of the validate poses."""
    if given is None and interactive() and len(poses) > 1:
        question = "Validate poses, which judge the fit and are not fitted, separated by commas"
        answer = typer.prompt(question, default="", show_default=False)
        given = [name.strip() for name in answer.split(",") if name.strip()]
    return tuple(given or ())


def _assumed(gravity, units, tangent, frames):
    """Defaults that were used because their option was omitted."""
    down = ", ".join(f"{g:g}" for g in _gravity(None))
    said = [f"assumed: gravity is {down} m/s^2 in the scan frame (--gravity)"] if gravity is None else []
    said += ["assumed: lengths are in metres in files that name no unit (--units)"] if units is None else []
    if frames is not None and tangent == "z":
        said.append("assumed: the cable leaves each frame along its z axis, from start to end (--tangent)")
    return said


def _suggest_tangent(study, tangent):
    """Suggest another --tangent if the cable leaves every clamp along another axis."""
    from scan2flex_jax.convert import other_tangent  # noqa: PLC0415
    from scan2flex_jax.study import pose_facts  # noqa: PLC0415
    from scan2flex_jax.study.visible import visible_mistakes  # noqa: PLC0415

    axis = next((mistake.axis for mistake in visible_mistakes(study) if mistake.axis), "")
    if not axis:
        return
    facts = [pose_facts(pose) for pose in study.poses]
    ends = [end for f in facts if f is not None for end in (f.start, f.end) if end is not None]
    angles = sorted(end.angle for end in ends if end.angle is not None)
    middle = angles[len(angles) // 2]
    meant = other_tangent(axis, tangent)
    say(f"the tangents are off by {middle:.0f} degrees at every clamp: did you mean --tangent {meant}? Delete the study.toml")
    say("that was written and start again with it.\n")


def _scans(study):
    """``(points, extents in m)`` of every scan, by pose."""
    from scan2flex_jax.study.scans import scan_facts  # noqa: PLC0415

    return {pose.name: scan_facts(pose.scan) for pose in study.poses if pose.scan is not None}


def _quantity(given, what, question, option):
    """A quantity and its standard deviation, from the option or a prompt."""
    from scan2flex_jax.convert import measured  # noqa: PLC0415

    if given is not None:
        return measured(given, what)
    return asked_or_refused(question, option, lambda answer: measured(answer, what))


def _gravity(given):
    if given is None:
        return (0.0, 0.0, -9.81)
    return _numbers(given, 3, "gravity")


def _numbers(text, count, what):
    import math  # noqa: PLC0415

    try:
        values = [float(cell) for cell in text.replace(",", " ").split()]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
        raise Scan2FlexError(f"the {what} {text[:60]!r} is not {count} numbers: separate them by commas or blanks.")
    return values


def _asked_clamps(poses, units, convention, degrees, tangent):
    """Clamps by name, one prompt per end; None if they are taken from the curves."""
    import numpy as np  # noqa: PLC0415

    from scan2flex_jax.convert import clamp_of_angles, length_unit  # noqa: PLC0415
    from scan2flex_jax.study import Clamp  # noqa: PLC0415

    def clamp(answer):
        if answer.strip() == "free":
            return None
        values = _numbers(answer, 6 if len(answer.replace(",", " ").split()) > 3 else 3, "clamp")
        if len(values) == 3:
            return Clamp(np.array(values) * length_unit(units))
        if convention is None:
            raise Scan2FlexError("three angles need their convention: start again with --convention, or give a position alone.")
        return clamp_of_angles(values[:3], values[3:], convention, units=units, degrees=degrees, tangent=tangent)

    untwisted = "Take the clamps from the ends of the curves (only right where no end is twisted)?"
    if interactive() and all(pose.curve for pose in poses) and typer.confirm(untwisted, default=False):
        return None
    found = {}
    for pose in poses:
        for end in ("start", "end"):
            free = ", or free" if end == "end" else ""
            question = f"the {end} clamp of {pose.name} (x y z and three angles; x y z alone for a ball joint{free})"
            at = asked_or_refused(question, "--clamps FILE (or --clamps-from-curves)", clamp)
            if at is None and end == "start":
                raise Scan2FlexError(f"the start of {pose.name} must be held: give its clamp.")
            if at is not None:
                found[f"{pose.name} {end}"] = at
    return found


def pose(
    file: Annotated[
        Path | None,
        typer.Argument(help="4x4 matrices under their names, or a CSV with name (or pose,end), x,y,z and a rotation."),
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
        values = _numbers(matrix, 12 if count == 12 else 16, "matrix")
        found = {"": clamp_of_matrix(np.reshape(values, (-1, 4)), units=unit, tangent=tangent)}
    elif angles is None or convention is None:
        raise Scan2FlexError("a position needs --angles and their --convention: kuka, rpy, or axes as in ZYX.")
    else:
        where = _numbers(position, 3, "position"), _numbers(angles, 3, "angles")
        found = {"": clamp_of_angles(*where, convention, units=unit, degrees=not radians, tangent=tangent)}
    for name, clamp in found.items():
        say(f"{name} = {clamp_toml(clamp)}" if name else clamp_toml(clamp))
    if json:
        outputs.write_json(json, {name: {"position": c.position, "quaternion": c.quaternion} for name, c in found.items()})


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
    from scan2flex_jax.study import describe, load_study, study_warnings  # noqa: PLC0415
    from scan2flex_jax.study.outputs import Outputs  # noqa: PLC0415

    loaded = load_study(study)
    outputs = Outputs(loaded, source=study, force=force)
    outputs.claim(json)
    scans = _scans(loaded)
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

