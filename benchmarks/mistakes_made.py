"""Deliberate mistakes of `benchmarks.mistakes`: functions that put them into a study.

``KINDS`` maps a mistake to its function (from study to study, or to None where impossible) and to words of the right remedy.
"""

from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

from scan2flex_jax.study import Clamp, MeasuredCurve

MILLIMETRES, CENTIMETRES, INCHES, BADLY = 1000.0, 100.0, 1 / 0.0254, 1.02
POUNDS = 2.2046


def rotation(clamp):
    """The rotation of a clamp with a quaternion."""
    return Rotation.from_quat(clamp.quaternion, scalar_first=True)


def _held(clamp):
    return clamp is not None and clamp.quaternion is not None


def poses_changed(change, which=None):
    """A mistake of all poses, or of those that ``which(study)`` gives."""

    def made(study):
        names = [p.name for p in (study.poses if which is None else which(study))]
        poses = tuple(change(p) if p.name in names else p for p in study.poses)
        return replace(study, poses=poses) if any(a is not b for a, b in zip(poses, study.poses, strict=True)) else None

    return made


def clamps_changed(change, ends=("start", "end")):
    def one(pose):
        held = {end: getattr(pose, end) for end in ends if _held(getattr(pose, end))}
        return replace(pose, **{end: Clamp(c.position, change(c)) for end, c in held.items()}) if held else pose

    return one


def turned(by):
    """Clamps written with other axes of the same body."""
    return lambda c: np.roll((rotation(c) * by).as_quat(), 1)


def rolled(degrees):
    return turned(Rotation.from_euler("z", degrees, degrees=True))


def both_held(pose):
    return _held(pose.start) and _held(pose.end)


def fit_pose(k):
    """The fitted pose number ``k`` with two clamps (the last one where there are fewer)."""

    def which(study):
        some = [p for p in study.fit_poses if both_held(p)] or list(study.fit_poses)
        return [some[min(k, len(some) - 1)]]

    return which


def with_more_turns(more):
    return lambda p: replace(p, turns=p.turns + more) if both_held(p) else p


def only_held(change):
    return lambda p: change(p) if both_held(p) else p


def swapped(pick):
    def made(study):
        pair = pick(study)
        if pair is None:
            return None
        a, b = pair
        curves = {a.name: b.curve, b.name: a.curve}
        return replace(study, poses=tuple(replace(p, curve=curves.get(p.name, p.curve)) for p in study.poses))

    return made


def two_fitted(first):
    def pick(study):
        some = study.fit_poses if first else study.fit_poses[::-1]
        return some[:2] if len(some) > 1 else None

    return pick


def fitted_and_not(study):
    return (study.fit_poses[0], study.validate_poses[0]) if study.validate_poses else None


def copied_clamps(study):
    """The second fitted pose has the clamps of the first one: copied, and not changed."""
    if len(study.fit_poses) < 2:
        return None
    a, b = study.fit_poses[:2]
    return replace(study, poses=tuple(replace(p, start=a.start, end=a.end) if p is b else p for p in study.poses))


def reversed_curve(pose):
    return replace(pose, curve=MeasuredCurve(pose.curve.points[::-1]))


def exchanged_clamps(pose):
    return pose if pose.end is None else replace(pose, start=pose.end, end=pose.start)


def other_roll(study):
    """Rolls from the first pose's, on the shortest way from tangent to tangent, with the other sign."""
    first = next((p for p in study.poses if both_held(p)), None)
    if first is None:
        return None
    a = rotation(first.end)

    def one(pose):
        if not both_held(pose) or pose is first:
            return pose
        b = rotation(pose.end)
        ta, tb = (x.as_matrix()[:, 2] for x in (a, b))
        axis = np.cross(ta, tb)
        sine = np.linalg.norm(axis)
        across = Rotation.from_rotvec(axis / max(sine, 1e-12) * np.arctan2(sine, ta @ tb)) * a
        roll = (across.inv() * b).as_rotvec()
        return replace(pose, end=Clamp(pose.end.position, np.roll((across * Rotation.from_rotvec(-roll)).as_quat(), 1)))

    return replace(study, poses=tuple(one(p) for p in study.poses))


def other_twist(study):
    """The end clamps rolled so that the twist of every pose, beyond frames carried along its curve, has the other sign."""

    def one(pose):
        if not both_held(pose):
            return pose
        R, t = rotation(pose.start), rotation(pose.start).as_matrix()[:, 2]
        points = uniform_filter1d(pose.curve.points, max(1, len(pose.curve.points) // 16), axis=0)
        for onward in [*np.diff(points, axis=0), rotation(pose.end).as_matrix()[:, 2]]:
            n = onward / np.linalg.norm(onward)
            axis = np.cross(t, n)
            sine = np.linalg.norm(axis)
            R, t = Rotation.from_rotvec(axis / max(sine, 1e-12) * np.arctan2(sine, t @ n)) * R, n
        twist = (R.inv() * rotation(pose.end)).as_rotvec()
        return replace(pose, end=Clamp(pose.end.position, np.roll((R * Rotation.from_rotvec(-twist)).as_quat(), 1)))

    out = replace(study, poses=tuple(one(p) for p in study.poses))
    return out if any(both_held(p) for p in study.poses) else None


def scaled(curves=1.0, clamps=1.0, length=1.0, density=1.0):
    def clamp(c):
        return None if c is None else Clamp(clamps * c.position, c.quaternion)

    def made(study):
        def one(pose):
            own = {"start": clamp(pose.start), "end": clamp(pose.end), "curve": MeasuredCurve(curves * pose.curve.points)}
            return replace(pose, **own)

        factors = {"length": length, "length_density": density}
        cable = {**study.cable, **{name: factor * study.cable[name] for name, factor in factors.items()}}
        return replace(study, poses=tuple(map(one, study.poses)), cable=cable)

    return made


def gravity(other):
    return lambda study: replace(study, gravity=other(np.asarray(study.gravity)))


def _axes(axis, degrees):
    return turned(Rotation.from_euler(axis, degrees, degrees=True))


def all_clamps(change, *ends):
    return poses_changed(clamps_changed(change, ends or ("start", "end")))


def all_rolls(degrees, end):
    return poses_changed(only_held(clamps_changed(rolled(degrees), (end,))))


def one_roll(degrees):
    return poses_changed(only_held(clamps_changed(rolled(degrees), ("end",))), fit_pose(1))


KINDS = {
    "first two fitted poses exchanged": (swapped(two_fitted(True)), ("exchange their centre_curve",)),
    "last two fitted poses exchanged": (swapped(two_fitted(False)), ("exchange their centre_curve",)),
    "a fitted and a validate pose exchanged": (swapped(fitted_and_not), ("exchange their centre_curve",)),
    "clamps copied from another pose": (copied_clamps, ("look at its clamps", "multiply its end quaternion")),
    "a turn too many in one pose": (poses_changed(with_more_turns(1), fit_pose(0)), ("turns =",)),
    "a turn too few in one pose": (poses_changed(with_more_turns(-1), fit_pose(1)), ("turns =",)),
    "end rolled by half a turn in one pose": (one_roll(180), ("multiply its end quaternion",)),
    "end rolled by 90 degrees in one pose": (one_roll(90), ("multiply its end quaternion",)),
    "end rolled by 90 degrees in all poses": (all_rolls(90, "end"), ("multiply the end quaternions",)),
    "end rolled by half a turn in all poses": (all_rolls(180, "end"), ("multiply the end quaternions",)),
    "start rolled by -90 degrees in all poses": (all_rolls(-90, "start"), ("multiply the end quaternions",)),
    "sign of the rolls from pose to pose": (other_roll, ("turn the roll",)),
    "sign of the twist": (other_twist, ("turn the roll",)),
    "tangent is x": (all_clamps(_axes("y", -90)), ("x axis",)),
    "tangent is y": (all_clamps(_axes("x", 90)), ("y axis",)),
    "tangent is -z": (all_clamps(_axes("x", 180)), ("z axis", "multiply the start quaternions")),
    "tangent inward at the end": (all_clamps(_axes("x", 180), "end"), ("multiply the end quaternions",)),
    "one curve reversed": (poses_changed(reversed_curve, fit_pose(1)), ("reverse the order",)),
    "all curves reversed": (poses_changed(reversed_curve), ("reverse the order",)),
    "clamps exchanged in one pose": (poses_changed(exchanged_clamps, fit_pose(1)), ("exchange",)),
    "clamps exchanged in all poses": (poses_changed(exchanged_clamps), ("exchange",)),
    "quaternions scalar-last": (all_clamps(lambda c: np.roll(c.quaternion, -1)), ("[w, x, y, z]",)),
    "quaternions conjugated": (all_clamps(lambda c: c.quaternion * [1, -1, -1, -1]), ("signs of their x, y and z",)),
    "gravity upward": (gravity(lambda g: -g), ("write gravity",)),
    "gravity along another axis": (gravity(lambda g: np.roll(g, 1)), ("write gravity",)),
    "density in g/m": (scaled(density=1000.0), ("check the unit",)),
    "density in t/m": (scaled(density=0.001), ("check the unit",)),
    "density in lb/m": (scaled(density=POUNDS), ("check the unit", "looks like lb/m")),
    "curves in mm": (scaled(curves=MILLIMETRES), ("millimetres",)),
    "curves in cm": (scaled(curves=CENTIMETRES), ("centimetres",)),
    "curves in inches": (scaled(curves=INCHES), ("inches",)),
    "curves 2 % too large": (scaled(curves=BADLY), ("curves look",)),
    "clamps in mm": (scaled(clamps=MILLIMETRES), ("millimetres",)),
    "clamps in inches": (scaled(clamps=INCHES), ("inches",)),
    "clamps 2 % too large": (scaled(clamps=BADLY), ("positions look",)),
    "length in mm": (scaled(length=MILLIMETRES), ("millimetres",)),
    "length in cm": (scaled(length=CENTIMETRES), ("centimetres",)),
    "length in inches": (scaled(length=INCHES), ("inches",)),
}
