"""Consistency of a study: enough is known, and cable, clamps and curves fit each other.

Every user of a study calls `check_study`, whether it was read or made in memory. Limits are wide: they catch a wrong unit or a
wrong frame, never a noisy scan. Doubts are warnings of `check.describe`, not errors.
"""

from typing import Literal

import numpy as np

from scan2flex_jax.study.curves import arc_length_fault, curve_length
from scan2flex_jax.study.declared import check_declared, longest_cable
from scan2flex_jax.study.kinds import KEYS, kind_format
from scan2flex_jax.study.model import Markers, MeasuredCurve, Study, StudyPose
from scan2flex_jax.study.rotations import between, columns
from scan2flex_jax.study.values import Where, known, shown

Purpose = Literal["fit", "predict", "extract"]

SPAN_SLACK = 1.05  # clamps further apart than this many L are out of reach of a nearly inextensible cable
CURVE_SLACK = 1.3  # length of a measured curve over L, above which it is not of this cable; noise and stretch stay far below
CURVE_LEAST = 1 / 300  # length of a measured curve over L, below which its unit differs from that of L
GUIDE_SLACK = 2.0  # the same for guide points, which wander over the surface
MARKER_SLACK = 0.1  # of the arc length of the last marker: largest distance of a marker beyond the taut cable
THICK = 0.5  # radius over L, above which its unit differs from that of L
SUPPORTS = ("support", "knife_edge")  # effect types that hold a cable between its ends
STIFF_AXIAL = 1e3  # N: a cable of less may stretch by more than SPAN_SLACK in use, and spans are not checked
ASTRAY, ALONG = 60.0, 30.0  # degrees between clamps and their curves: beyond any error of mounting or bend at a clamp
_NO_GRAVITY = 1e-9
_ROUNDED = 1e-6  # of a length written with few digits
_FORCES = {
    "point_mass": "mass", "uniform_load": "force", "point_load": "force", "tether": "stiffness", "elastic_clamp": "stiffness",
    "elastic_support": "stiffness", "distributed_load": "force", "moment": "moment",
}  # fmt: skip  # the size of effects that set the scale of forces (a force, or a stiffness comparable to the cable's)
_UNITS = {"millimetres": 1000.0, "centimetres": 100.0, "inches": 1 / 0.0254, "feet": 1 / 0.3048}


def check_study(study: Study, purpose: Purpose = "fit") -> None:
    """Raise a `StudyError` for the first inconsistency.

    For the ``purpose`` "fit" every pose needs a measured shape; to "predict", only given measurements must fit the cable; to
    "extract" centre curves, weight and stiffness of the cable may be missing too."""
    where = Where("Study")
    if not isinstance(study, Study):
        raise where.fail(f"got {shown(study)}: give a Study, as load_study(folder) or Study.from_arrays(...) makes it.")
    check_declared(study, where)
    _check_cable(study, where.at("cable"), purpose)
    _check_names(study, where.at("pose"))
    if purpose == "fit":
        _check_scale(study, where)
    reach = _reach(study)
    for pose in study.poses:
        here = where.at("pose").item(pose.name)
        if purpose == "fit" and not pose.measured and not study.only_compared(pose):
            raise here.fail("it has no shape: give it a centre curve, a scan, markers, or readings.")
        _check_readings(study, pose, here)
        if pose.start is None and not any(effect.kind in SUPPORTS for effect in study.acting(pose)):
            said = f"it is missing, and nothing else holds the cable: write {KEYS['pose']['start'].written}"
            raise here.at("start").fail(f"{said}, or declare the effects {' or '.join(SUPPORTS)} in this pose.")
        if pose.turns and any(clamp is None or clamp.quaternion is None for clamp in (pose.start, pose.end)):
            raise here.at("turns").fail(f"got {pose.turns}, but an end turns freely: write turns only between two clamps.")
        if pose.markers is not None:
            _check_markers(study, pose, pose.markers, reach, here.at("markers"))
        if reach is not None:
            _check_spans(pose, reach, here)
        if pose.curve is not None:
            _check_curve(study, pose, pose.curve, reach, here.at("curve"))
    _check_order(study, where.at("pose"))


def _check_markers(study: Study, pose: StudyPose, markers: Markers, reach: float | None, where: Where) -> None:
    """Markers lie on the cable, and no further from the start than their arc length."""
    s = markers.arc_length
    _check_on_cable(study, s[-1], where, "a marker is")
    if reach is None or moved(study) or pose.start is None or pose.change_from is not None:
        return
    away = np.linalg.norm(np.nan_to_num(markers.points - pose.start.position), axis=1)
    far = np.flatnonzero(away > SPAN_SLACK * s + MARKER_SLACK * s[-1] + np.linalg.norm(markers.aside, axis=1))
    if len(far):
        i = int(far[0])
        said = f"marker {i + 1} is at s = {s[i]:g} m, but {away[i]:g} m away from the start clamp"
        raise where.fail(f"{said}: {unit_hint(away[i] / max(s[i], 1e-12))}.")


def _check_on_cable(study: Study, s: float, where: Where, what: str) -> None:
    longest = longest_cable(study)
    if longest is not None and s > longest * (1 + _ROUNDED):
        said = f"{what} at s = {s:g} m on a cable of at most {longest:g} m"
        raise where.at("s").fail(f"{said}: {unit_hint(s / longest)}.")


def _check_readings(study: Study, pose: StudyPose, where: Where) -> None:
    """Angles are on the cable, wrenches at supports that exert them, and changes from a pose with its own shape."""
    for i, one in enumerate(pose.angle):
        _check_on_cable(study, one.s, where.at("angle").item(i + 1), "the angle is read")
    for i, wrench in enumerate(pose.wrench):
        held, here, end = getattr(pose, wrench.end), where.at("wrench").item(i + 1), wrench.end
        if held is None:
            raise here.at("end").fail(f"the {end} of this pose is free: give its {end}, or leave the wrench out.")
        if held.quaternion is None and (wrench.moment is not None or wrench.frame == "clamp"):
            key, none = ("frame", "axes") if wrench.moment is None else ("moment", "moment")
            raise here.at(key).fail(f"the {end} is a ball joint, which has no {none}: leave it out.")
    if pose.change_from is None:
        return
    here = where.at("change_from")
    known(pose.change_from, (other.name for other in study.poses if other.name != pose.name), here, "other pose")
    if study.pose(pose.change_from).change_from is not None:
        raise here.fail(f"pose {shown(pose.change_from)} holds changes itself: name a pose that does not.")
    if study.history_dependent:
        raise here.fail("an effect of the study has memory, and the pose would have two shapes before it: measure places.")


def _check_cable(study: Study, where: Where, purpose: Purpose) -> None:
    """Every required parameter is given or unknown, and together they describe a cable."""
    needed = () if purpose == "extract" else ("length", "length_density", "bending_stiffness", "torsional_stiffness")
    for key in needed:
        if key not in study.cable and key not in study.unknown_names:
            raise where.at(key).fail(f"it is missing: give its value, or declare unknown.{key}.")
    scanned = [pose.name for pose in study.poses if pose.scan is not None]
    if scanned and "radius" not in study.cable and purpose == "fit":
        raise where.at("radius").fail(f"it is missing, and pose {shown(scanned[0])} has a scan: give the radius.")
    longest, radius = longest_cable(study), study.cable.get("radius")
    if longest is not None and radius is not None and float(np.max(radius)) > THICK * longest:
        said = f"the radius is {float(np.max(radius)):g} m on a cable of at most {longest:g} m"
        raise where.at("radius").fail(f"{said}: write both in metres.")


def _check_names(study: Study, where: Where) -> None:
    """Pose names are unique, and repeats refer to another pose."""
    names = [pose.name for pose in study.poses]
    for i, pose in enumerate(study.poses):
        if pose.name in names[:i]:
            raise where.item(i + 1).at("name").fail(f"two poses are called {shown(pose.name)}: give each its own name.")
    for pose in study.poses:
        if pose.repeat_of is not None:
            others = (name for name in names if name != pose.name)
            known(pose.repeat_of, others, where.item(pose.name).at("repeat_of"), "other pose")


def _check_scale(study: Study, where: Where) -> None:
    """A pose is fitted; and without gravity, shapes of an unloaded rod depend only on ratios of stiffnesses."""
    if not study.fit_poses:
        raise where.at("pose").fail('no pose has the role "fit": give it to at least one.')
    adrift = {"bending_stiffness", "torsional_stiffness"} <= set(study.unknown_names)
    if adrift and not any(_has_gravity(study, pose) for pose in study.fit_poses) and not knows_a_force(study):
        said = "gravity is zero and both stiffnesses are unknown, so shapes tell only ratios"
        raise where.at("gravity").fail(f"{said}: give gravity, a stiffness, or the effect of a known load.")


def knows_a_force(study: Study) -> bool:
    """Whether a force measured at a support, or an effect of known size, sets the scale of forces in a fitted pose, independent
    of the cable's weight."""
    if any(pose.wrench for pose in study.fit_poses):
        return True
    for i, effect in enumerate(study.effects):
        parameter = _FORCES.get(effect.kind)
        if parameter is None or study.unknown_of(i, parameter) or not np.any(effect.parameters.get(parameter, 0.0)):
            continue
        poses = [pose for pose in study.fit_poses if effect in study.acting(pose)]
        if any(effect.kind != "point_mass" or _has_gravity(study, pose) for pose in poses):
            return True
    return False


def _has_gravity(study: Study, pose: StudyPose) -> bool:
    return float(np.linalg.norm(study.gravity_in(pose))) > _NO_GRAVITY


def _reach(study: Study) -> float | None:
    """Reach (m) of the straightened cable; None if it may stretch, or no length is known."""
    longest, stated = longest_cable(study), (*study.cable, *study.unknown_names)
    axial = [study.known("axial_stiffness")] if "axial_stiffness" in stated else []
    declared = [(effect.kind, effect.parameters) for effect in study.effects]
    axial += [given.get("axial_stiffness") for kind, given in declared if kind == "extensibility"]
    stretches = {"extensibility.axial_stiffness", "natural_stretch", "length_error.length"} & set(study.unknown_names)
    if stretches or longest is None or any(value is None or float(np.min(value)) < STIFF_AXIAL for value in axial):
        return None
    stretch = study.cable.get("natural_stretch")
    along = 0.0 if stretch is None else float(np.ravel(stretch)[-1])
    lengths = [float(np.max(given["length"])) for kind, given in declared if kind == "length_error" and "length" in given]
    return max([longest, *lengths]) * (1 + max(along, 0.0))


def looks_like(ratio: float) -> tuple[str, float] | None:
    """Probable unit of a length that is about `ratio` times too long, and how many of that unit make a metre."""
    return next(((unit, _UNITS[unit]) for unit in ("millimetres", "centimetres") if 0.3 < ratio / _UNITS[unit] < 3.0), None)


def unit_of(ratio: float) -> tuple[str, float] | None:
    """The same for a length that should equal the compared one, up to a curve's gaps, which identifies inches and feet too."""
    return next(((unit, factor) for unit, factor in _UNITS.items() if 0.8 < ratio / factor < 1.1), None)


def unit_hint(ratio: float, equal: bool = False) -> str:
    """Advice for a length that is `ratio` times too long; `equal`: relative to one that it should equal."""
    unit = (unit_of(ratio) if equal else None) or looks_like(ratio)
    return "correct the length, the unit or the frame" if unit is None else f"it looks like {unit[0]}: divide by {unit[1]:.6g}"


def _check_spans(pose: StudyPose, reach: float, where: Where) -> None:
    """The two ends, and the guide points, are no further apart than the cable is long."""
    span = 0.0 if pose.start is None or pose.end is None else float(np.linalg.norm(pose.end.position - pose.start.position))
    if span > SPAN_SLACK * reach:
        chord = reach if pose.curve is None else float(np.linalg.norm(pose.curve.points[-1] - pose.curve.points[0]))
        measured = 0.0 < chord < reach  # a curve that fits the cable gives the true distance of the ends
        hint = unit_hint(span / (chord if measured else reach), equal=measured)
        said = f"the ends are {span:g} m apart, but the cable is at most {reach:g} m long"
        raise where.at("end.position").fail(f"{said}: {hint}.")
    guided = 0.0 if pose.guide_points is None else curve_length(pose.guide_points)
    if guided > GUIDE_SLACK * reach:
        said = f"the points span {guided:g} m on a cable of {reach:g} m: {unit_hint(guided / reach)}."
        raise where.at("guide_points").fail(said)


def _check_curve(study: Study, pose: StudyPose, curve: MeasuredCurve, reach: float | None, where: Where) -> None:
    """A measured curve is about as long as the cable, and lies near its clamps; its arc lengths are those of its points."""
    points, s, length = curve.points, curve.arc_length, curve_length(curve.points)
    if s is not None:
        if s[0] < -0.05 * (s[-1] - s[0]):  # beyond rounding and noise
            raise where.fail(f"its s begins at {s[0]:g} m: count s from 0 at the start clamp.")
        length = max(length, float(s[-1]))
    if reach is None:
        return
    if s is not None and (fault := arc_length_fault(points, s)) is not None:
        raise where.fail(f"{fault}.")
    if length > CURVE_SLACK * reach:
        hint = unit_hint(length / reach, equal=True)
        raise where.fail(f"the curve is {length:g} m long, but the cable at most {reach:g} m: {hint}.")
    if study.length is not None and length < CURVE_LEAST * reach:
        unit = unit_of(reach / length)
        hint = "write both in metres" if unit is None else f"the cable's looks like {unit[0]}: divide it by {unit[1]:.6g}"
        raise where.fail(f"the curve is {length:g} m long on a cable of {reach:g} m: {hint}.")
    held = {} if moved(study) else {"start": pose.start, "end": pose.end}
    for end, clamp in held.items():
        nearest = 0.0 if clamp is None else float(np.min(np.linalg.norm(points - clamp.position, axis=1)))
        if nearest > reach:  # further from its support than the cable is long
            said = f"the curve stays {nearest:g} m away from the {end} clamp, more than the cable's {reach:g} m"
            raise where.fail(f"{said}: give curve and clamps in one frame.")


def moved(study: Study) -> bool:
    """Whether an effect moves or scales what was measured."""
    return any(kind_format(effect.kind).place == "observation" for effect in study.effects)


def _check_order(study: Study, where: Where) -> None:
    """Detect quaternions with the scalar last: every clamp then points along its curve when read that way, and only then."""
    key = None
    for pose in study.poses:
        points = np.zeros((0, 3)) if pose.curve is None else pose.curve.points
        near = max(1, len(points) // 20)
        for name, clamp, first, last in (("start", pose.start, 0, near), ("end", pose.end, -1 - near, -1)):
            if clamp is None or clamp.quaternion is None or not len(points):
                continue
            chord = points[last] - points[first]
            off = [np.degrees(between(columns(q)[:, 2], chord)) for q in (clamp.quaternion, np.roll(clamp.quaternion, 1))]
            if off[0] < ASTRAY or off[1] > ALONG:
                return
            key = key or where.item(pose.name).at(name).at("quaternion")
    if key is not None:
        said = f"every clamp points more than {ASTRAY:g} degrees away from its curve, and along it with the scalar last"
        raise key.fail(f"{said}: write quaternions as [w, x, y, z].")
