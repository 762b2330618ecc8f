"""What the tests of equilibria share: one model with a point force, the reference poses, and functions compiled once.

Every model here has the same effects, so that all tests with the same number of elements share one compiled solve.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float
from reference import clamped_cases

from scan2flex_jax.rod.assembly import derivatives
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.effect import AbstractEffect
from scan2flex_jax.rod.energy import retract, supported
from scan2flex_jax.rod.loads import point_load
from scan2flex_jax.rod.model import CableModel, Configuration, discretise
from scan2flex_jax.statics import blocktridiagonal as bt
from scan2flex_jax.statics.solve import Equilibrium, equilibrium
from scan2flex_jax.statics.starts import sagging_start

START_FRAME = clamped_cases.START_FRAME
WEIGHTLESS = (0.0, 0.0, 0.0)
EARTH = (0.0, 0.0, -9.81)
MESHES = (20, 40)
traces = []  # one entry for each time that a model with a point force is traced


class PointForce(AbstractEffect):
    """A dead force (N) at ``place``, in parts of the length."""

    place: Float[Array, ""]
    force: Float[Array, "3"]

    def dead_load(self, section, gravity):
        traces.append(None)
        return point_load(section, self.place * section.ds * section.s.shape[0], self.force)


def model(cable, gravity=EARTH, force=(0.0, 0.0, 0.0), place=1.0) -> CableModel:
    """A cable with a force (N), on its far end unless said."""
    effect = PointForce(jnp.array(place, float), jnp.array(force, float))
    return CableModel(cable, jnp.array(gravity, float), (effect,))


def cantilever(frame=START_FRAME) -> Boundary:
    """Clamped at the origin with the given frame, free at the far end."""
    return Boundary.of((jnp.zeros(3), jnp.array(frame)))


def clamped(end, end_frame, frame=START_FRAME) -> Boundary:
    """Clamped at the origin and at ``end``."""
    return Boundary.of((jnp.zeros(3), jnp.array(frame)), (jnp.array(end, float), jnp.array(end_frame)))


def reference_case(name, stiff=1.0e5) -> tuple[CableModel, Boundary]:
    """A case of `reference.clamped_cases`; ``stiff`` (N): its shear and axial stiffness where it has none."""
    rod = clamped_cases.CASES[name]
    shear = 1.0 / rod.compliance[0] if rod.compliance[0] > 0 else stiff
    EI, GJ = rod.K[:2], rod.K[2]
    cable = Cable(rod.length, rod.weight / 9.81, EI, GJ, shear, shear, rod.natural_curvature)
    return model(cable), clamped(rod.end, rod.end_frame, rod.start_frame)


class Pose(NamedTuple):
    """Far clamp of a twisted test pose."""

    end: tuple
    frame: np.ndarray


def four_poses() -> list[Pose]:
    """Level; the end aside with +90 and -90 degrees of twist; along +y with 45 degrees."""
    level, plus, along_y = (clamped_cases.CASES[name].end_frame for name in ("P1", "P2", "P3"))
    minus = clamped_cases.rotations.about(clamped_cases.X, -np.pi / 2) @ START_FRAME
    return [
        Pose((0.6, 0.0, 0.0), level),
        Pose((0.6, 0.2, 0.0), plus),
        Pose((0.6, 0.2, 0.0), minus),
        Pose((0.5, 0.3, 0.1), along_y),
    ]


def straight(boundary, length, elements, twist=0.0) -> Configuration:
    """The straight rod along the start clamp, with ``twist`` (rad) spread evenly."""
    s = np.linspace(0.0, 1.0, elements + 1)
    frame = np.asarray(boundary.rotation[0])
    turn = clamped_cases.rotations.exp(s[:, None] * twist * np.array([0.0, 0.0, 1.0]))
    r = np.asarray(boundary.position[0]) + s[:, None] * float(length) * frame[:, 2]
    return Configuration(jnp.array(r), jnp.array(frame @ turn))


generic_start = eqx.filter_jit(sagging_start)


def solved(model, boundary, elements=40, start=None, turns=0) -> Equilibrium:
    """The equilibrium from the given start, or from the generic one."""
    if start is None:
        start = generic_start(boundary, model.cable.length, model.gravity, jnp.asarray(turns), elements)
    return equilibrium(model, boundary, start=start, elements=elements)


@eqx.filter_jit
def loads_of(answer):
    """Energy (J), section forces ``(s, f, m)`` and reactions of an equilibrium."""
    return answer.energy, answer.section_forces(), answer.reactions()


@eqx.filter_jit
def stability(model, boundary, configuration, steps=0):
    """``(negative directions, largest residual (N, N m), configuration)`` after ``steps`` plain Newton steps."""
    rod = discretise(model, boundary, configuration.r.shape[0] - 1)

    def newton(_, c):
        d = derivatives(rod, c)
        step = bt.factor_and_solve(d.diagonal, d.upper, d.gradient[..., None])[0][..., 0]
        return retract(c, -step)

    c = jax.lax.fori_loop(0, steps, newton, supported(rod, configuration))
    d = derivatives(rod, c)
    return bt.factor(d.diagonal, d.upper).negative, jnp.max(jnp.abs(d.gradient)), c


@eqx.filter_jit
def stability_under_force(model, boundary, configuration, force, shift):
    """Negative directions of a state that is known to carry a constant ``force`` (N, in space) and its own moments.

    ``shift`` (N m, on every motion of every node) takes motions without any stiffness out of the count.
    """
    rod = discretise(model, boundary, configuration.r.shape[0] - 1)
    c = supported(rod, configuration)
    known = 0.5 * jnp.einsum("nji,j->ni", c.R[:-1] + c.R[1:], force)  # in the frames half-way, to second order
    d = derivatives(rod, c, predict=lambda n: n.at[:, :3].set(known))
    return bt.factor(d.diagonal + shift * jnp.eye(6), d.upper).negative


def critical(is_stable, low, high, tolerance=1e-4) -> float:
    """The load between ``low`` (stable) and ``high`` (not) where stability ends, by bisection."""
    assert is_stable(low)
    assert not is_stable(high)
    while high - low > tolerance * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if is_stable(middle) else (low, middle)
    return 0.5 * (low + high)


def order(errors, floor=0.0) -> np.ndarray:
    """Observed orders of convergence of errors on meshes that halve; only those whose finer error is above ``floor``."""
    errors = np.asarray(errors)
    return np.log2(errors[:-1] / errors[1:])[errors[1:] > floor]


def at_stations(points, count=10) -> np.ndarray:
    """Those of the nodes that lie at ``count + 1`` equal stations."""
    return np.asarray(points)[:: (len(points) - 1) // count]
