"""Start values without a guess: for a measured curve the balance of moments is linear in the stiffnesses.

With force ``f = f0 - w s`` (``w = k_rhoA g``) and moment ``m' = -r' x f``, an isotropic straight rod obeys

    EI (t x t') + GJ tau t - m0 + (r - r0) x f0 = (int_0^s u t du) x w,

linear in EI, GJ, and each pose's unknown ``m0, f0`` (paper, Eqs. 3 and 5, integrated, which avoids third derivatives of a
scan). The twist rate ``tau`` is the angle between the end clamp and the transported frame over the length. An estimate from
differentiated data is biased, and only good enough as a start.
"""

from itertools import product

import numpy as np
from scipy.interpolate import make_lsq_spline

from scan2flex_jax.effects import effect_class
from scan2flex_jax.fitting.poses import Poses
from scan2flex_jax.rod.memory import AbstractMemory
from scan2flex_jax.study.facts import FEWEST_BENT, measured_length
from scan2flex_jax.study.kinds import split_name
from scan2flex_jax.study.model import Study

STIFFNESSES = ("bending_stiffness", "torsional_stiffness")
_CANTILEVER = 1e-2  # EI h / (w L^4) of small sags ``h``
_USUAL, _LEAST = 0.03, 1e-3  # EI / (w L^3) of a cable without such a sag, and the least part of it
_FLAT = 1e-5  # of the length: the least sag that counts
_BIASED = 0.03  # of the stiffness by the sag: less is noise of a nearly straight curve
_PLACES = (0.5, 0.25, 0.75)  # of the length
_WIDTH = 0.3  # of the length
_SPANS = 12  # of the smoothing spline: a rod between clamps has a few bends
_DEGREE = 5
_STATIONS = 101
_INSIDE = 0.05  # of the length omitted at each end, where a spline's curvature is inaccurate
_INSIDE_SHORT = 0.1  # the same of the measured part, where that is short


def own_start(study: Study, poses: Poses, length: float) -> dict[str, float]:
    """`balance_start` of a study's poses, and the density (kg/m) assumed for it, for a cable of ``length`` (m).

    The density is the study's value or guess, if there is one.
    """
    known = {name: float(np.mean(value)) for name in STIFFNESSES if (value := study.known(name)) is not None}
    values = {**study.cable, **{u.name: study.start_value(u.name) for u in study.unknowns}}
    density = float(values.get("length_density") or _density_beside(study, length))
    weights = np.array([density * np.asarray(study.gravity_in(pose)) for pose in study.fit_poses])
    begun = dict.fromkeys(_named(study, "mass"), density * length)  # of an effect: as heavy as the cable
    start = balance_start(poses, weights, length, known, _loaded_least(study))
    return {"length": length, "length_density": density} | begun | start


def _named(study: Study, parameter: str) -> list[str]:
    """The names of the unknowns that are this parameter of an effect."""
    return [name for name in study.unknown_names if "." in name and split_name(name)[2] == parameter]


def length_start(study: Study) -> float:
    """Start of the length (m): the value given, the guess, else that of the measured shapes."""
    return float(np.max(study.start_value("length") or measured_length(study) or 1.0))


def several_starts(study: Study, poses: Poses, length: float) -> list[dict[str, float]]:
    """Starts of the parameters of effects that need several, each by name: `memory_starts`, each with unknown positions at some
    places along the cable."""
    names = _named(study, "position")
    places = [dict.fromkeys(names, share * length) for share in _PLACES] if names else [{}]
    return [memory | place for memory in memory_starts(study, poses, length) for place in places]


def several_effects(study: Study) -> bool:
    """Whether parameters of several effects are unknown, so that a fit may end in one of several minima."""
    return len({split_name(name)[:2] for name in study.unknown_names if "." in name}) > 1


def places(study: Study, length: float) -> list[dict[str, float]]:
    """Starts of effects by name: their unknown positions at some places along the cable, of several at different ones, and
    their widths (m)."""
    width = dict.fromkeys(_named(study, "width"), _WIDTH * length)
    names, n = _named(study, "position"), len(_PLACES)
    return [width | {name: _PLACES[(i + k) % n] * length for i, name in enumerate(names)} for k in range(n)]


def memory_starts(study: Study, poses: Poses, length: float) -> list[dict[str, float]]:
    """Starts of the parameters of effects with memory, each by name: one for each threshold that a fit may begin from."""
    times = [pose.time for pose in study.poses if pose.time is not None]
    seconds = float(np.ptp(times)) if times else 0.0
    known = _typical_curvature(poses), length, seconds
    every = [[{f"{e.kind}.{k}": v for k, v in one.items()} for one in _begin(e.kind, known)] for e in study.effects]
    return [{k: v for one in some for k, v in one.items()} for some in product(*filter(None, every))]


def _begin(kind, known):
    cls = effect_class(kind)
    return cls.begin(*known) if issubclass(cls, AbstractMemory) else ()


def _typical_curvature(poses: Poses) -> float:
    """RMS curvature (1/m) of the curves from which the solves start."""
    r, R = np.asarray(poses.start.r), np.asarray(poses.start.R)
    bend = np.linalg.norm(np.cross(R[:, :-1, :, 2], R[:, 1:, :, 2]), axis=2)
    return float(np.sqrt(np.mean((bend / np.linalg.norm(np.diff(r, axis=1), axis=2)) ** 2)))


def _density_beside(study, length) -> float:
    """A start of the mass per length (kg/m): the cable is as heavy as the known point masses on average, or 1 kg/m."""
    masses = [float(m) for e in study.effects if (m := e.parameters.get("mass")) is not None]
    return float(np.mean(masses)) / length if masses and np.mean(masses) > 0 else 1.0


def _loaded_least(study) -> np.ndarray:
    """Mask of the fitted poses with the fewest effects, since the balance of moments includes none."""
    effects = np.array([len(study.acting(pose)) for pose in study.fit_poses])
    return effects == effects.min()


def balance_start(
    poses: Poses, weights: np.ndarray, length: float, known: dict[str, float], use: np.ndarray
) -> dict[str, float]:
    """Bending and torsional stiffness (N m^2) that balance the measured curves best, where they are positive.

    ``known`` holds the stiffnesses that are not unknowns; ``weights`` (P, 3) are per length in N/m, ``length`` is in m, and
    ``use`` (P,) is the mask of the poses used.
    """
    fallback, least = _by_weight(poses, weights, length, use)
    shown = np.flatnonzero(use & np.array(shapes_scale(poses)))
    if not len(shown):
        return {name: known.get(name, fallback) for name in STIFFNESSES}
    blocks = [_pose_equations(poses, i, length, weights[i]) for i in shown]
    columns, right = _assemble(blocks)
    free = [k for k, n in enumerate(STIFFNESSES) if n not in known]
    right = right - sum(columns[:, k] * known[n] for k, n in enumerate(STIFFNESSES) if n in known)
    columns_used = [k for k in free if np.linalg.norm(columns[:, k]) > 0] + list(range(2, columns.shape[1]))
    solution = np.linalg.lstsq(columns[:, columns_used], right, rcond=1e-10)[0]
    found = {STIFFNESSES[k]: solution[columns_used.index(k)] for k in free if k in columns_used}
    bending = found.get("bending_stiffness", known.get("bending_stiffness", fallback))
    bending = bending if bending > least else fallback
    torsion = found.get("torsional_stiffness", bending)
    torsion = torsion if 0.02 * bending < torsion < 50 * bending else bending
    return {"bending_stiffness": float(bending), "torsional_stiffness": float(torsion)}


def _by_weight(poses, weights, length, use) -> tuple[float, float]:
    """Bending stiffness (N m^2) by the weight alone, and the least that is not noise of a nearly straight curve.

    A cantilever that sags by ``h`` (RMS distance from a line) has ``EI = c w L^4 / h`` of its weight per length ``w``; between
    two supports a sag tells the length more than the stiffness.
    """
    sags = []
    for i in np.flatnonzero(use & np.array(shapes_scale(poses)) & (poses.boundary.held[:, 1, 0] == 0)):
        points = np.asarray(poses.points[i])[poses.seen[i]]
        off = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1:] / np.sqrt(len(points))
        if len(points) >= FEWEST_BENT:
            sags.append(_CANTILEVER * np.linalg.norm(weights[i]) * length**4 / max(np.linalg.norm(off), _FLAT * length))
    if sags and np.median(sags) > 0:
        return float(np.median(sags)), _BIASED * float(np.median(sags))
    usual = _USUAL * float(np.max(np.linalg.norm(weights, axis=1))) * length**3 or 1.0
    return usual, _LEAST * usual


def shapes_scale(poses: Poses) -> list[bool]:
    """Which poses show a shape, and so the scale of the stiffness: not those whose markers have some coordinates only, or that
    have other readings only."""
    own = np.any(poses.seen, axis=1)
    return [bool(own[i]) and (poses.rows is None or not np.any(poses.rows[i])) for i in range(poses.count)]


def _pose_equations(poses, i, length, weight):
    mask = poses.seen[i]
    if poses.marked is not None and np.any(own := mask & (np.asarray(poses.marked[i]) == 0)):
        mask = own  # the curve suffices, and markers are not in order with its points
    points, s = np.asarray(poses.points[i])[mask], np.asarray(poses.expected[i])[mask]
    keep = np.concatenate([[True], np.diff(s) > 1e-9 * length])
    points, s = points[keep], s[keep]
    if len(s) < 3:  # no curvature: the other poses, or the weight, give the start
        return np.zeros((0, 2)), np.zeros((0, 6)), np.zeros(0)
    curve = _spline(s, points)
    inside = min(_INSIDE * length, _INSIDE_SHORT * (s[-1] - s[0]))
    at = np.linspace(s[0] + inside, s[-1] - inside, _STATIONS)
    d1, d2 = curve.derivative(1)(at), curve.derivative(2)(at)
    speed = np.linalg.norm(d1, axis=1, keepdims=True)
    t = d1 / speed
    binormal = np.cross(d1, d2) / speed**3
    # moment of the weight: int u t du, from the first station on (its constant is part of m0 and f0)
    moment = np.concatenate(
        [[np.zeros(3)], np.cumsum(0.5 * np.diff(at)[:, None] * (at[1:, None] * t[1:] + at[:-1, None] * t[:-1]), axis=0)]
    )
    r = curve(at)
    lever = np.stack([np.cross(r - r[0], e) for e in np.eye(3)], axis=2)
    constant = np.broadcast_to(-np.eye(3), (len(at), 3, 3))
    twist = total_twist(np.asarray(poses.start.R[i])) / length  # of the start; zero if an end is free to turn
    shared = np.stack([binormal, twist * t], axis=2)
    local = np.concatenate([constant, lever], axis=2)
    rows = 3 * len(at)
    return shared.reshape(rows, 2), local.reshape(rows, 6), np.cross(moment, weight).reshape(rows)


def _spline(s, points):
    """The smoothing spline; with few points the polynomial through them, which has as many coefficients."""
    degree = min(_DEGREE, len(s) - 1)
    spans = int(min(_SPANS, max(2, len(s) // 4))) if len(s) > _DEGREE + 1 else 1
    knots = np.quantile(s, np.linspace(0, 1, spans + 1)[1:-1])
    knots = np.concatenate([[s[0]] * (degree + 1), knots, [s[-1]] * (degree + 1)])
    return make_lsq_spline(s, points, knots, k=degree)


def total_twist(R: np.ndarray) -> float:
    """Twist (rad) of a cable with node frames ``R`` (n, 3, 3): their rotation about the tangent relative to transport."""
    relative = np.einsum("nji,njk->nik", R[:-1], R[1:])
    return float(np.sum(0.5 * (relative[:, 1, 0] - relative[:, 0, 1])))


def _assemble(blocks):
    rows = sum(len(b[2]) for b in blocks)
    columns, right, at = np.zeros((rows, 2 + 6 * len(blocks))), np.zeros(rows), 0
    for i, (shared, local, b) in enumerate(blocks):
        here = slice(at, at + len(b))
        columns[here, :2], columns[here, 2 + 6 * i : 8 + 6 * i], right[here] = shared, local, b
        at += len(b)
    return columns, right
