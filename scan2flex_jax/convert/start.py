"""A new study from scans or centre curves, with the facts of the files and the user's answers.

`new_study` combines measurements (`folder`) with the answers into a `Study` that `save_study` can write. Curves
of other tools are converted (`curves`), scans in another unit are scaled. The caller asks the questions.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from scan2flex_jax.convert.curves import agreed_unit, read_foreign_curve, read_foreign_points
from scan2flex_jax.convert.ends import clamps_of_curve, hanging, wider
from scan2flex_jax.convert.folder import MeasuredFile
from scan2flex_jax.convert.frames import clamp_of_matrix
from scan2flex_jax.convert.motion_capture import captured
from scan2flex_jax.convert.units import length_unit
from scan2flex_jax.errors import Scan2FlexError, StudyError
from scan2flex_jax.study.curves import chord_deficit, curve_length
from scan2flex_jax.study.facts import pose_facts
from scan2flex_jax.study.files import backup, write_atomic
from scan2flex_jax.study.model import Clamp, Markers, MeasuredCurve, Study, StudyPose, Tolerance, Unknown, Value
from scan2flex_jax.study.scans import load_geometry
from scan2flex_jax.study.sense import CURVE_LEAST, CURVE_SLACK, looks_like
from scan2flex_jax.study.values import Where, suggestion

GRAVITY = (0.0, 0.0, -9.81)
_WHOLE = 0.1  # of L: a curve whose ends are the clamps is as long as the cable, up to noise and coarse chords
_SPARSE = 0.05  # of L: points of a curve with arc lengths are nearer to each other than this
_FREE = "its end hangs free: neither a moment nor a force acts there; if it is held, start again with --ends held"
_UNCLEAR = "its end may hang free: taken as held, which is right for both; if it does, start again with --ends free"


def new_study(
    folder: Path,
    poses: list[MeasuredFile],
    *,
    length: float,
    length_density: float,
    clamps: dict[str, Clamp] | None,
    radius: float | None = None,
    title: str = "",
    gravity: np.ndarray | tuple[float, ...] | list[float] = GRAVITY,
    units: str | None = None,
    columns: str | None = None,
    validate: tuple[str, ...] = (),
    tolerance: Tolerance | None = None,
    markers: bool = False,
    frame: int | None = None,
    arc_lengths: dict[str, float] | None = None,
    noise: float | None = None,
    free: bool | None = None,
) -> tuple[Study, tuple[str, ...]]:
    """``(study, notes)``: a study with both stiffnesses unknown, ready for `save_study`.

    ``length`` m, ``length_density`` kg/m, ``radius`` m (needed for scans), ``gravity`` m/s^2. ``clamps`` by "POSE start" and
    "POSE end" (a missing end is free); None takes them from the ends of the curves, without twist, with tolerances from the
    scatter of their points; ``free``: their ends hang free, or are held; None: as their shapes tell. ``units`` and ``columns``
    are those of the files; ``tolerance`` the standard deviations of inexact inputs, ``noise`` (m) that of a coordinate of a
    point. ``markers``: the points of the text files are markers at known arc lengths (a column s, or ``arc_lengths`` by name),
    not curves. ``frame``: of motion captures; None: the mean of all. Raises `Scan2FlexError` for a name of no pose or a missing
    input.
    """
    folder, notes = Path(folder).resolve(), []
    if markers and clamps is None:
        raise Scan2FlexError("markers do not reach the clamps: give the frames of the clamps.")
    names = [pose.name for pose in poses]
    for name in validate:
        if name not in names:
            raise Scan2FlexError(f"no pose is called {name[:60]!r}: {suggestion(name, names)}")
    known = [f"{name} {end}" for name in names for end in ("start", "end")]
    for name in clamps or ():
        if name not in known:
            raise Scan2FlexError(f"the frame {name[:60]!r} belongs to no pose: {suggestion(name, known)}")
    made, known_nearly = [], Tolerance() if tolerance is None else tolerance
    of_curves = {"gravity": np.asarray(gravity, float), "noise": noise, "free": free} if clamps is None else None
    for pose in poses:
        role = "validate" if pose.name in validate else "fit"
        reading = {"units": units, "columns": columns, "frame": frame, "arc_lengths": arc_lengths}
        one, nearly, said = _pose(folder, pose, clamps, of_curves, reading, role, markers)
        _same_unit(pose, one, length, whole=clamps is None)
        made.append(one if noise is None else replace(one, noise=noise))
        known_nearly = wider(known_nearly, nearly)
        notes += [f"{pose.name}: {text}" for text in said]
    if clamps is None:
        notes.append(_of_curves(known_nearly))
    notes += _sparse(made, length)
    notes += [
        f"{pose.name}: its end is free, as there is no frame '{pose.name} end'" for pose in made if clamps and pose.end is None
    ]
    if all(pose.role == "validate" for pose in made):
        raise Scan2FlexError("every pose is kept for validation: leave at least one to fit.")
    cable: dict[str, Value] = {"length": length, "length_density": length_density}
    cable |= {} if radius is None else {"radius": radius}
    unknowns = (Unknown("bending_stiffness"), Unknown("torsional_stiffness"))
    down = np.asarray(gravity, float)
    study = Study(title or folder.name, down, cable, tuple(made), tolerance=known_nearly, unknowns=unknowns, folder=folder)
    return study, tuple(notes)


def frames_of_bodies(
    poses: list[MeasuredFile], *, units: str | None = None, frame: int | None = None, tangent: str = "z"
) -> dict[str, Clamp]:
    """Clamps by "POSE start" and "POSE end" from rigid bodies of these names in motion captures; empty without any."""
    found = {}
    for pose in poses:
        capture = None if pose.curve is None else captured(pose.curve)
        if capture is None:
            continue
        for name, matrix in capture.frames(frame).items():
            if name.lower() in ("start", "end"):
                unit = units or capture.unit or "m"
                found[f"{pose.name} {name.lower()}"] = clamp_of_matrix(matrix, units=unit, tangent=tangent)
    return found


def _pose(folder, files, clamps, of_curves, reading, role, markers):
    """One pose, the tolerance of its clamps, and notes; with ``markers``, the points of its text file are markers."""
    curve, marked, scan, nearly, notes = None, None, None, Tolerance(), []
    if files.curve:
        found = read_foreign_curve(files.curve, **reading)
        curve, notes = found.curve, list(found.notes)
    if of_curves is None:
        start, end = _clamps(files.name, clamps)
    else:
        curve, start, end, nearly, said = _own_clamps(files.name, curve, **of_curves)
        notes += said
    if curve is not None and markers:
        curve, marked = None, _markers(folder, files, curve)
    elif curve is not None:
        curve = replace(curve, path=folder / "curves" / f"{files.name}.csv")
        facts = pose_facts(StudyPose(files.name, role, start, end, curve=curve))
        if facts is not None and facts.backwards:
            curve, notes = _reversed(curve), [*notes, "turned round: it ran from end to start"]
    if files.scan:
        scan, said = _scan(folder, files.scan, reading["units"])
        notes += said
    guides = None if files.guides is None else read_foreign_points(files.guides, units=reading["units"])
    pose = StudyPose(files.name, role, start, end, curve=curve, scan=scan, markers=marked, guide_points=guides)
    return pose, nearly, notes


def _markers(folder, files, curve):
    """The points of a text file as markers."""
    if curve.arc_length is None:
        said = "its markers have no arc length: add a column s, counted from the start clamp, and name it in the header"
        raise StudyError(files.curve, None, f"{said} or with --columns.")
    return Markers(curve.points, curve.arc_length, folder / "markers" / f"{files.name}.csv")


def _sparse(poses, length):
    """A note on points with arc lengths that are so far apart that they may be markers."""
    gaps = [np.max(np.diff(p.curve.arc_length)) for p in poses if p.curve is not None and p.curve.arc_length is not None]
    if not gaps or min(gaps) < _SPARSE * length:
        return []
    return [f"points with arc lengths, up to {1e3 * max(gaps):.3g} mm apart: if they are markers, start again with --markers"]


def _same_unit(files, pose, length, whole):
    """Refuse a curve far longer than the cable, or a cable far longer than its curve: one was read in the wrong unit.

    ``whole``: its ends become the clamps, so it is as long as the cable.
    """
    if pose.curve is None and pose.markers is None:
        return
    long = curve_length(pose.curve.points) if pose.markers is None else float(pose.markers.arc_length[-1])
    if long < CURVE_LEAST * length:
        said = f"in this unit the curve is {long:.3g} m long, but the cable is {length:g} m"
        raise StudyError(files.curve, None, f"{said}: correct the unit of the files, or name that of the length ('900 mm').")
    if long > CURVE_SLACK * length:
        unit = looks_like(long / length)
        hint = "" if unit is None else f" (it looks like {unit[0]})"
        said = f"in this unit the curve is {long:g} m long, but the cable is {length:g} m"
        raise StudyError(files.curve, None, f"{said}: name the unit of the files{hint}, or correct the length.")
    if whole and abs((long + chord_deficit(pose.curve.points)) / length - 1) > _WHOLE:
        said = f"its curve is {long:.4g} m long from end to end, but the cable is {length:g} m between its clamps"
        advice = "check its columns, its unit and the length; of a curve that shows a part of the cable, give the clamps"
        raise StudyError(files.curve, None, f"{said}: {advice}.")


def _clamps(name, clamps):
    if f"{name} start" not in clamps:
        given = ", ".join(repr(known) for known in list(clamps)[:6]) or "none"
        raise Scan2FlexError(f"there is no frame {name + ' start'!r}: give the start clamp of every pose (there are {given}).")
    return clamps[f"{name} start"], clamps.get(f"{name} end")


def _own_clamps(name, curve, gravity, noise, free):
    """``(curve, start, end, tolerance, notes)`` of a curve by itself, turned round if its first point hangs free; ``free``:
    whether its end hangs free, None: as its shape tells."""
    if curve is None:
        raise Scan2FlexError(f"pose {name!r} has only a scan: its clamps cannot be taken from a curve, give them.")
    notes = []
    if free is not False and hanging(curve.points[::-1], gravity) == "free" != hanging(curve.points, gravity):
        curve, notes = _reversed(curve), ["turned round: its first point hangs free"]
    hangs = hanging(curve.points, gravity) if free is None else "free" if free else "held"
    start, end, tolerance = clamps_of_curve(curve.points, noise, free=hangs == "free")
    notes += {"free": [_FREE], "unclear": [_UNCLEAR], "held": []}[hangs] if free is None else []
    return curve, start, end, tolerance, notes


def _of_curves(nearly):
    """A note on clamps that were taken from curves."""
    known = f"directions to {np.degrees(nearly.clamp_rotation):.2g} degrees, places to {1e3 * nearly.clamp_position:.2g} mm"
    said = f"the clamps were taken from the ends of the curves, without twist ([tolerance]: {known}), and are fitted with the"
    return f"{said} stiffness: measure their frames for a narrower interval, and for GJ where an end is twisted"


def _reversed(curve):
    s = curve.arc_length
    return MeasuredCurve(curve.points[::-1], None if s is None else s[-1] - s[::-1], curve.path)


def _scan(folder, path, units):
    """The scan itself, or a copy in metres."""
    factor = length_unit(units or "m")
    if factor == 1.0:
        return path.resolve(), []
    target = folder / "scans" / f"{path.stem}.ply"
    loaded = load_geometry(path)
    if stated := loaded.metadata.get("unit"):
        agreed_unit(units, stated, Where(str(path)))
        return path.resolve(), []  # whoever reads it converts it
    try:
        loaded.apply_scale(factor)
        data = loaded.export(file_type="ply")
    except Exception as fault:  # each of trimesh's readers fails in its own way
        raise StudyError(
            path, None, f"it cannot be read as a scan ({' '.join(str(fault).split())[:120]}): check it."
        ) from fault
    if not (target.exists() and target.read_bytes() == data):
        backup(target)
        write_atomic(target, data)
    return target, [f"a copy in metres is {target.parent.name}/{target.name}"]
