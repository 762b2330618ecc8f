"""The ends of a measured curve as clamps: place and direction with their errors, and whether an end hangs free.

Place and direction are those of a cubic in arc length s through the points near the end. Its window is two steps shorter than
the widest one whose slope agrees with those of all shorter ones (Lepski's rule), so that the bias by bending is a small part of
the error by noise.

The moment ``M`` turns the tangent of an isotropic rod by ``EI t' = M x t``, whatever its torsion. With ``M(s)`` from the weight
``w`` of the part beyond s and from a moment and a force at the end, ``r(s) = r0 + s t0 + int int M x dr ds / EI`` is linear in
``(r0, t0, w/EI, M_L/EI, F_L/EI)``: a regression of the points on integrals over them, without derivatives. The end hangs free
if ``M_L`` and ``F_L`` explain no more than noise would (F test), while the weight shows.
"""

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from scipy import special  # `scipy.stats` imports slowly
from scipy.spatial.transform import Rotation

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.study.facts import point_noise
from scan2flex_jax.study.model import Clamp, Tolerance

Points = Annotated[np.ndarray, "n 3"]
_CUBIC, _LEAST, _WIDEN = 4, 5, 4 / 3  # coefficients; points of the shortest window; factor from one window to the next
_AGREE, _BACK = 2.0, 2  # standard errors between slopes that agree; windows back from there, where bias is a small part
_SLOW = 0.1  # of the slope of a curve: its points turn back
_MOST_SHIFT, _MOST_TURN = 0.01, 0.3  # of the length, rad: errors of an end that shows nothing
_AGAIN = 3.0  # times those errors: a fit counts the same points again, and they shall decide there
_FEWEST = 12  # points that tell a free end
_CHANCE, _SHOWN = 1e-3, 5.0  # p of end loads that noise explains; standard errors by which the weight of a free end shows
_NEARLY = 0.01  # of the squared bends, not explained: an end that may be free
_RANK, _TINY = 1e-9, 1e-300

Hanging = Literal["free", "unclear", "held"]


@dataclass(frozen=True)
class CurveEnd:
    """An end of a curve: ``position`` (m), unit ``direction`` into the curve, and their standard errors per coordinate
    (``position_sd``, m) and per axis (``direction_sd``, rad)."""

    position: Annotated[np.ndarray, "3"]
    direction: Annotated[np.ndarray, "3"]
    position_sd: float
    direction_sd: float


def curve_end(points: Points, noise: float | None = None) -> CurveEnd:
    """The first end of a curve (m); ``noise`` (m) of a coordinate counts where the scatter of the points is smaller.

    Raises `Scan2FlexError` for a curve that turns back on itself there.
    """
    s, sigma = _arc(points), max(noise or 0.0, _scatter(points))
    kept: list[tuple[np.ndarray, np.ndarray]] = []
    count = min(len(points), _LEAST)
    while True:
        found, weight = _polynomial(points[:count], s[:count] / s[-1], _CUBIC)
        slack = _AGREE * np.sqrt(2.0) * sigma  # of two directions
        if any(np.linalg.norm(found[1] - other[1]) > slack * own[1] for other, own in kept):
            break
        kept.append((found, weight))
        if count == len(points):
            break
        count = min(len(points), int(np.ceil(_WIDEN * count)))
    found, weight = kept[max(len(kept) - 1 - _BACK, 0)]
    size, bias = float(np.linalg.norm(found[1])), 0.0
    if not size > _SLOW * s[-1]:
        raise Scan2FlexError("a curve turns back on itself: its clamps cannot be taken from it, give them.")
    if len(kept) <= _BACK:  # bends within the shortest window may exceed the noise
        bias = float(np.linalg.norm(found[1] - _polynomial(points[:_LEAST], s[:_LEAST] / s[-1], _CUBIC + 1)[0][1]))
    place, turn = sigma * max(1.0, weight[0]), float(np.hypot(sigma * weight[1], bias)) / size
    return CurveEnd(found[0], found[1] / size, float(min(place, _MOST_SHIFT * s[-1])), min(turn, _MOST_TURN))


def _polynomial(points, u, most):
    """Coefficients of a polynomial in ``u`` through points, ``most`` of them, and their standard errors over the noise."""
    basis = np.vander(u, min(most, max(len(u) - 1, 2)) if most <= _CUBIC else min(most, len(u)), increasing=True)
    inverse = np.linalg.pinv(basis)
    return inverse @ points, np.linalg.norm(inverse, axis=1)


def clamps_of_curve(points: Points, noise: float | None = None, *, free: bool = False) -> tuple[Clamp, Clamp | None, Tolerance]:
    """Clamps at the ends of a curve (m), along it, and their tolerance; the end's frame is the start's, transported without
    twist. A ``free`` end has none.

    Raises `Scan2FlexError` for a curve that turns back on itself.
    """
    first = curve_end(points, noise)
    if free:
        return _clamp(first, _frame_on(first.direction)), None, _tolerance(first)
    last = curve_end(points[::-1], noise)
    tangents = np.gradient(points, axis=0)
    tangents[0], tangents[-1] = first.direction, -last.direction
    size = np.linalg.norm(tangents, axis=1, keepdims=True)
    if not np.all(size > 1e-9 * np.max(size)):
        raise Scan2FlexError("a curve turns back on itself: its clamps cannot be taken from it, give them.")
    tangents /= size
    axis = np.cross(tangents[:-1], tangents[1:])
    sine, cosine = np.linalg.norm(axis, axis=1), np.sum(tangents[:-1] * tangents[1:], axis=1)
    turns = axis / np.maximum(sine, 1e-300)[:, None] * np.arctan2(sine, cosine)[:, None]
    start = end = _frame_on(tangents[0])
    for turn in Rotation.from_rotvec(turns):
        end = turn * end
    return _clamp(first, start), _clamp(last, end), _tolerance(first, last)


def _clamp(end: CurveEnd, frame: Rotation) -> Clamp:
    return Clamp(end.position, frame.as_quat(canonical=True, scalar_first=True))


def hanging(points: Points, gravity: Annotated[np.ndarray, "3"]) -> Hanging:
    """Whether the last end of a curve (m) hangs free under ``gravity``; "unclear" if it nearly does."""
    if len(points) < _FEWEST or not np.any(gravity):
        return "held"
    free, x, variance = _regression(points, gravity, held=False)
    held, _, _ = _regression(points, gravity, held=True)
    line = _regression(points, 0.0 * gravity, held=False)[0]
    normals = 1 if _flat(points) else 2
    loads, spare = 3 * normals, normals * len(points) - 6 * normals - 1  # of a moment and a force, across the curve
    chance = special.fdtrc(loads, spare, max(free - held, 0.0) / loads / max(held / spare, _TINY))
    shown = x > _SHOWN * np.sqrt(variance * max(free, _TINY) / spare)
    if shown and chance > _CHANCE:
        return "free"
    return "unclear" if chance > _CHANCE or (shown and free < _NEARLY * line) else "held"


def wider(one: Tolerance, other: Tolerance) -> Tolerance:
    """A tolerance that covers the clamps of two."""
    return replace(one, **{n: max(getattr(one, n), getattr(other, n)) for n in ("clamp_position", "clamp_rotation")})


def _tolerance(*ends: CurveEnd) -> Tolerance:
    """The tolerance of clamps at these ends, wide enough that the curve decides in a fit."""
    place, turn = (
        float(f"{_AGAIN * max(sds):.2g}") for sds in zip(*((e.position_sd, e.direction_sd) for e in ends), strict=True)
    )
    return Tolerance(clamp_position=place, clamp_rotation=turn)


def _regression(points, gravity, *, held):
    """``(sum of squares, w/EI, its variance over that of the noise)`` of a curve by its weight, and loads at a ``held`` end."""
    s, n = _arc(points), len(points)
    ds, dr = np.diff(s)[:, None], np.diff(points, axis=0)

    def along_s(f):
        return np.concatenate([np.zeros((1, 3)), np.cumsum(0.5 * (f[1:] + f[:-1]) * ds, axis=0)])

    def bent(moment):
        turned = np.cross(0.5 * (moment[1:] + moment[:-1]), dr)
        return along_s(np.concatenate([np.zeros((1, 3)), np.cumsum(turned, axis=0)]))

    covered = along_s(points)
    arm = covered[-1] - covered - points * (s[-1] - s)[:, None]
    columns = [bent(np.cross(arm, gravity / (np.linalg.norm(gravity) or 1.0)))]
    columns += [f * axis for f in (np.ones((n, 1)), s[:, None]) for axis in np.eye(3)]
    columns += [bent(np.tile(axis, (n, 1))) for axis in np.eye(3) if held]
    columns += [bent(np.cross(points[-1] - points, axis)) for axis in np.eye(3) if held]
    A, y = np.stack([c.ravel() for c in columns], axis=1), points.ravel()
    scale = np.linalg.norm(A, axis=0)
    scale[scale == 0] = 1.0
    inverse = np.linalg.pinv(A / scale, rcond=_RANK)
    x = inverse @ y
    return float(np.sum((y - A @ (x / scale)) ** 2)), x[0] / scale[0], float(inverse[0] @ inverse[0]) / scale[0] ** 2


def _scatter(points):
    """Noise (m) of a coordinate that the points show, of those in a plane within it; 1 % of the length for few points."""
    shown = point_noise(points)
    return _MOST_SHIFT * _arc(points)[-1] if np.isinf(shown) else shown * (np.sqrt(2.0) if _flat(points) else 1.0)


def _flat(points):
    """Whether the points lie in a plane exactly, as those of a photograph do."""
    return bool(np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[-1] < _RANK * _arc(points)[-1])


def _arc(points):
    """Arc lengths of the points."""
    return np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]


def _frame_on(d3):
    """A frame with the given direction as d3: d1 in the plane of d3 and the vertical, if that is defined."""
    up = np.array([0.0, 0.0, 1.0]) if abs(d3[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    d1 = up - (up @ d3) * d3
    d1 /= np.linalg.norm(d1)
    return Rotation.from_matrix(np.column_stack([d1, np.cross(d3, d1), d3]))
