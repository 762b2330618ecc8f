"""PyElastica: a Cosserat rod, damped until it rests.

Only the rest counts, so what leaves it alone is chosen for speed. The rotational inertia is that of a section with a radius of
gyration of half an element, which makes shearing no faster than stretching and so allows the largest steps that stretching
allows; the damping is close to critical for the slowest mode.

PyElastica holds frames on elements. Clamped as in its own examples, a whole element at the clamp stays straight, an error of
first order; with the middle of that element in the clamp, as here, the error is of second order: the rod is half an element
longer at each clamp, and points are the elements' middles.
"""

import elastica as ea
import numpy as np

from benchmarks.peers.problems import Solution, start_chain
from benchmarks.peers.rest import relax

_STEP = 0.35  # of the time in which a stretching wave crosses an element: 0.5 is its limit of stability
_DAMPING = 1.5  # of the slowest angular frequency, 1/s of all velocities
_CHECKS = 40  # a slowest period
_RADIUS = 5e-3  # m; only PyElastica's own checks see it


class Scene(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping):
    """One rod in the world."""


def prepare(problem, elements):
    """A function that builds the rod on the start curve and lets it settle; compiles by a few steps first."""
    _run(problem, elements, longest=0.0)
    return lambda: _run(problem, elements)


def _run(problem, elements, **limit) -> list[Solution]:
    ds, rod = _rod(problem, elements)
    scene, step = _scene(problem, rod, ds)
    stepper, time = ea.PositionVerlet(), np.float64(0.0)
    s = _stations(problem, rod.n_elems, ds)
    period = 2 * np.pi / problem.slowest
    count = max(1, int(period / _CHECKS / step))

    def advance():
        nonlocal time
        for _ in range(count):
            time = stepper.step(scene, time, step)

    def state():
        speed = np.sqrt(np.max(np.sum(rod.velocity_collection**2, axis=0)))
        return s, _points(problem, rod.position_collection.T), speed

    return relax(problem, advance, state, count * float(step), **limit)


def _rod(problem, elements):
    """Element length, and the rod on the start curve."""
    ds, points, frames = start_chain(problem, elements)
    count = len(frames)
    rod = ea.CosseratRod.straight_rod(
        count, np.zeros(3), problem.start_frame[:, 2], problem.start_frame[:, 0], count * ds, _RADIUS,
        density=problem.density / (np.pi * _RADIUS**2), youngs_modulus=1e6, shear_modulus=1e6,
    )  # fmt: skip
    stiff = problem.stretching
    rod.shear_matrix[:] = np.diag([stiff] * 3)[:, :, None]
    rod.bend_matrix[:] = np.diag([problem.bending, problem.bending, problem.torsion])[:, :, None]
    inertia = problem.density * ds * (0.5 * ds) ** 2
    rod.mass_second_moment_of_inertia[:] = inertia * np.eye(3)[:, :, None]
    rod.inv_mass_second_moment_of_inertia[:] = np.eye(3)[:, :, None] / inertia
    rod.position_collection[:] = points.T
    rod.director_collection[:] = np.transpose(frames, (2, 1, 0))  # rows d1, d2, d3
    return ds, rod


def _scene(problem, rod, ds):
    scene = Scene()
    scene.append(rod)
    positions = (0, 1) if problem.free else (0, 1, -2, -1)
    held = {"constrained_position_idx": positions, "constrained_director_idx": (0,) if problem.free else (0, -1)}
    scene.constrain(rod).using(ea.FixedConstraint, **held)
    gravity = np.array([0.0, 0.0, -problem.weight / problem.density])
    scene.add_forcing_to(rod).using(ea.GravityForces, acc_gravity=gravity)
    step = np.float64(_STEP * ds / np.sqrt(problem.stretching / problem.density))
    damping = _DAMPING * problem.slowest
    scene.dampen(rod).using(ea.AnalyticalLinearDamper, uniform_damping_constant=damping, time_step=step)
    scene.finalize()
    return scene, step


def _stations(problem, count, ds):
    s = np.arange(count) * ds
    return np.append(s, problem.length) if problem.free else s


def _points(problem, nodes):
    middles = 0.5 * (nodes[1:] + nodes[:-1])
    return np.vstack([middles, nodes[-1:]]) if problem.free else middles
