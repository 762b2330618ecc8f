"""Readings that are no points of the centre curve: marks beside the axis, angles, and forces and moments at the supports.

A reading is a row among the points of a pose, so that one residual serves all: ``scale * axes @ (measured - modelled)``, in m
where ``scale`` is the noise of the pose (m) over that of the reading (rad, N, N m). What is modelled:

    mark     r(s) + R(s) a           ``a``: its place (m) beside the axis, along d1, d2, d3
    angle    atan2(b . (z x m), z . m)   of ``m = R(s) e``, about the axis ``b`` from the direction ``z``; ``e`` = d1, d2 or d3
    wrench   force and moment of a support on the cable: the gradient of the energy at its node

The rotation ``R(s)`` is interpolated between four nodes, so that it is as accurate as they are (fourth order in the elements).
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int

from scan2flex_jax.compilation import lightly_compiled
from scan2flex_jax.fitting.noise import metre_noise
from scan2flex_jax.geometry.small import cross, matvec
from scan2flex_jax.rod.assembly import out_of_balance
from scan2flex_jax.rod.model import Configuration, Rod
from scan2flex_jax.statics.solve import Equilibrium
from scan2flex_jax.study.kinds import ENDS, FRAMES
from scan2flex_jax.study.model import Study, StudyPose, at_end

POINT, ANGLE, WRENCH = 0, 1, 2  # kinds of rows; from WRENCH on the parts of all wrenches, in the order of `wrenches`
AT_END = 2.0  # mark of a reading at the end of the cable, whatever its length
_UNITS = {"force": "N", "moment": "N m"}
_STENCIL = 4  # nodes of the interpolation


class Readings(NamedTuple):
    """Per row of a pose its ``kind``, its place ``aside`` (m) of the axis along d1, d2, d3, its ``scale`` (m per unit), and its
    own ``noise`` (m, so scaled), 0 for points.

    ``axes``: of an angle its axis, the direction of zero and the material axis; of a wrench the directions of its measured
    components, then zeros.
    """

    kind: Int[Array | np.ndarray, "*poses m"]
    aside: Float[Array | np.ndarray, "*poses m 3"]
    axes: Float[Array | np.ndarray, "*poses m 3 3"]
    scale: Float[Array | np.ndarray, "*poses m"]
    noise: Float[Array | np.ndarray, "*poses m"]


class Row(NamedTuple):
    """A reading that is no point: in ``words``, at the arc length ``s`` (m) with its ``mark``, the measured ``value`` (3,) with
    its ``noise`` in ``unit``, and its ``kind``, ``axes`` and ``scale`` as in `Readings`."""

    words: str
    s: float
    mark: float
    value: np.ndarray
    noise: float
    unit: str
    kind: int
    axes: np.ndarray
    scale: float

    @property
    def components(self) -> int:
        """The number of values that were measured."""
        return components(self.kind, self.axes)


def rows_of(study: Study, pose: StudyPose, length: float) -> list[Row]:
    """The angles of a pose, then the forces and moments at its supports, for a cable of ``length`` (m)."""
    noise, stated, out = metre_noise(study, pose, length), study.stated_length, list[Row]()
    for one in pose.angle:
        mark = AT_END if at_end(one.s, stated) else 1.0
        words = f"angle of {one.of} at s = {one.s:.4g} m"
        value = np.array([one.value, 0.0, 0.0])
        out.append(Row(words, one.s, mark, value, one.noise, "rad", ANGLE, one.axes, noise / one.noise))
    for wrench in pose.wrench:
        end, frame = ENDS.index(wrench.end), FRAMES.index(wrench.frame)
        for part, (name, force, sd) in enumerate(wrench.each):
            if force is None or sd is None:
                continue
            measured = np.flatnonzero(~np.isnan(force))
            axes = np.zeros((3, 3))
            axes[np.arange(len(measured)), measured] = 1.0
            kind, s = WRENCH + 4 * end + 2 * frame + part, end * length
            words = f"{name} at the {wrench.end}, axes of the {wrench.frame}"
            mark = AT_END if end else 1.0
            out.append(Row(words, s, mark, np.nan_to_num(force), sd, _UNITS[name], kind, axes, noise / sd))
    return out


@dataclass(frozen=True)
class Reading:
    """A reading that is no point, in ``words``: ``measured`` and ``modelled`` values (k,) in ``unit``, NaN without an
    equilibrium, and the ``noise`` of one."""

    words: str
    unit: str
    measured: np.ndarray
    modelled: np.ndarray
    noise: float

    @property
    def off(self) -> float:
        """RMS of measured minus modelled over the noise."""
        return float(np.sqrt(np.mean((self.measured - self.modelled) ** 2)) / self.noise)

    def sentence(self) -> str:
        """Measured and modelled values, and their distance."""
        measured, modelled = (" ".join(f"{x:.4g}" for x in values) for values in (self.measured, self.modelled))
        return f"{self.words}: {measured} {self.unit} measured, {modelled} modelled ({self.off:.2g} times its noise off)"

    def to_json(self) -> dict:
        """Lists and numbers; no modelled values without an equilibrium."""
        out = {"reading": self.words, "unit": self.unit, "measured": self.measured.tolist(), "noise": self.noise}
        return out | ({"modelled": self.modelled.tolist(), "off": self.off} if np.all(np.isfinite(self.modelled)) else {})


def readings_of(study: Study, pose: StudyPose, length: float, residual: Float[np.ndarray, "k 3"]) -> tuple[Reading, ...]:
    """The readings of a pose that are no points, given the ``residual`` (m) of their rows."""
    out = []
    for row, r in zip(rows_of(study, pose, length), residual, strict=True):
        n = row.components
        value = row.value[:1] if row.kind == ANGLE else row.axes[:n] @ row.value
        out.append(Reading(row.words, row.unit, value, value - r[:n] / row.scale, row.noise))
    return tuple(out)


def stacked(rows: list[Row]) -> tuple[Readings, Float[np.ndarray, "k 3"]]:
    """Readings as arrays, and their values."""
    kind, axes, scale = (np.array([getattr(row, name) for row in rows]) for name in ("kind", "axes", "scale"))
    noise, values = np.array([row.scale * row.noise for row in rows]), np.array([row.value for row in rows])
    return Readings(kind, np.zeros((len(rows), 3)), axes, scale, noise), values


def residuals_of(rows: list[Row], e: Equilibrium, view: Float[np.ndarray, "3 3"], zero: bool = False) -> np.ndarray:
    """Residual (k, 3) in m of readings at an equilibrium, seen by the linear map ``view``; ``zero``: of values of zero."""
    readings, values = stacked(rows)
    at = np.array([float(e.rod.length) if row.mark == AT_END else row.s for row in rows])
    own = 0 * values if zero else values
    return np.asarray(_residuals(readings, own, at, view, e.rod, e.configuration))


@lightly_compiled
def _residuals(readings, values, at, view, rod, configuration):
    R = jax.vmap(lambda s: rotation_at(configuration.R, rod.section.ds, s))(at)
    return reading_residuals(readings, values, R, view, wrenches(rod, configuration))


def components(kind: int, axes: np.ndarray) -> int:
    """The number of values of a reading that is no point."""
    return 1 if kind == ANGLE else int(np.count_nonzero(np.any(axes != 0.0, axis=1)))


def rotation_at(R: Float[Array, "n 3 3"], ds, s) -> Float[Array, "3 3"]:
    """Rotation (columns d1, d2, d3) at arc length ``s`` (m): the cubic through four nodes, made orthonormal."""
    first = jnp.clip(jnp.floor(s / ds) - 1, 0, R.shape[0] - _STENCIL).astype(int)
    t = s / ds - first
    weights = []
    for k in range(_STENCIL):
        others = [j for j in range(_STENCIL) if j != k]
        weights.append(jnp.prod(jnp.stack([(t - j) / (k - j) for j in others])))
    c = jnp.einsum("k,kij->ij", jnp.stack(weights), jax.lax.dynamic_slice_in_dim(R, first, _STENCIL))
    d3 = c[:, 2] / jnp.linalg.norm(c[:, 2])
    d1 = c[:, 0] - (c[:, 0] @ d3) * d3
    d1 = d1 / jnp.linalg.norm(d1)
    return jnp.stack([d1, cross(d3, d1), d3], axis=1)


def wrenches(rod: Rod, configuration: Configuration) -> Float[Array, "8 3"]:
    """Forces (N) and moments (N m) of both supports on the cable: for each end, and for the axes of the scan and of the clamp,
    the force and the moment."""
    ends = jnp.array([0, -1])
    g = out_of_balance(rod, configuration)[ends].reshape(2, 2, 3)
    seen = jnp.stack([matvec(configuration.R[ends][:, None], g), g], axis=1)
    return seen.reshape(8, 3)


def reading_residuals(
    readings: Readings, values: Float[Array | np.ndarray, "m 3"], R: Float[Array, "m 3 3"], view: Float[Array, "3 3"],
    wrenches: Float[Array, "8 3"],
) -> Float[Array, "m 3"]:  # fmt: skip
    """``residual (m, 3)`` (m) of the rows that are no points, given the rotations at their places; meaningless in others."""

    def one(kind, axes, scale, value, R):
        turned = kind == ANGLE
        axis, zero, read = jnp.where(turned, axes, jnp.eye(3))
        m = jnp.where(turned, view @ R @ read, zero)  # elsewhere the zero angle, which has a derivative
        angle = wrapped(value[0] - jnp.arctan2(axis @ cross(zero, m), zero @ m))
        support = axes @ (value - wrenches[jnp.maximum(kind - WRENCH, 0)])
        return scale * jnp.where(turned, jnp.array([1.0, 0.0, 0.0]) * angle, support)

    return jax.vmap(one)(readings.kind, readings.axes, readings.scale, values, R)


def wrapped(angle, xp=jnp):
    """An angle (rad) without its whole turns."""
    return xp.arctan2(xp.sin(angle), xp.cos(angle))


def change(residual, reference, readings: Readings | None, xp=jnp):
    """Residual (m, 3) of changes from a reference whose residual is that of zeros: whole turns of an angle do not count."""
    left = residual - reference
    if readings is None:
        return left
    scale = xp.asarray(readings.scale)[:, None]
    return xp.where(xp.asarray(readings.kind)[:, None] == ANGLE, scale * wrapped(left / scale, xp), left)
