"""This package as a solver of `cosseratbench`, beside the solvers that come with it, on its two static experiments.

`python -m benchmarks.peers.cosserat_bench` runs cantilever and catenary with every installed solver and prints a line of JSON
for each. The adapter answers quasi-static scenarios of one rod without contact and without driven ends; others are refused as
`cosseratbench` wants them refused. Frames between the first and the last are the equilibrium: there is no way towards it.
"""

import json
import sys

import jax
import jax.numpy as jnp
import numpy as np
from cosseratbench import registry
from cosseratbench.experiment import run
from cosseratbench.scenario import End, EndCondition
from cosseratbench.solver import Capability, Diverged
from cosseratbench.trajectory import Trajectory

from scan2flex_jax.effects.point_load import PointLoad
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.model import CableModel
from scan2flex_jax.statics.solve import equilibrium

EXPERIMENTS = ("cantilever", "catenary")
_SHEAR = 4.0 / 3.0  # inverse shear coefficient of a circular section, 3/4 of the area carries it


class Scan2FlexSolver:
    """The equilibrium solver behind the interface of `cosseratbench.solver.Solver`."""

    name = "scan2flex_jax"
    capabilities = frozenset({Capability.STRETCH, Capability.SHEAR})

    def run(self, scenario, *, n_elements, n_frames):
        """A `Trajectory` whose first frame is the scenario's start and whose others are the equilibrium."""
        _refuse(scenario)
        rod = scenario.rods[0]
        model, boundary = _model(rod, scenario.gravity), _boundary(rod)
        answer = equilibrium(model, boundary, elements=n_elements)
        if not bool(answer.verdict.solved):
            raise Diverged(answer.verdict.sentence())
        R = np.asarray(answer.configuration.R)
        middle = R[:-1, :, 0] + R[1:, :, 0]
        directors = middle / np.linalg.norm(middle, axis=1, keepdims=True)
        points, again = np.asarray(answer.points)[None], (n_frames - 1, 1, 1)
        positions = np.concatenate([rod.nodes(n_elements)[None], np.tile(points, again)])
        directions = np.concatenate([rod.directors(n_elements)[None], np.tile(directors[None], again)])
        return Trajectory(np.linspace(0.0, scenario.duration, n_frames), (positions,), (directions,))


def _refuse(scenario):
    if not scenario.quasi_static:
        raise NotImplementedError("dynamics")
    if len(scenario.rods) != 1:
        raise NotImplementedError("several rods")
    rod = scenario.rods[0]
    if rod.start_motion is not None or rod.end_motion is not None:
        raise NotImplementedError("driven ends")
    if rod.start is EndCondition.FREE:
        raise NotImplementedError("a free start")


def _model(rod, gravity):
    m, area, second = rod.material, rod.area, rod.second_moment_of_area
    cable = Cable(
        rod.length, m.density * area, m.youngs_modulus * second, 2 * m.shear_modulus * second,
        m.shear_modulus * area / _SHEAR, m.youngs_modulus * area,
    )  # fmt: skip
    places = {End.START: 0.0, End.END: rod.length}
    loads = tuple(PointLoad(jnp.array(places[x.at]), jnp.array(x.force)) for x in rod.loads)
    return CableModel(cable, jnp.array(gravity, float), loads)


def _boundary(rod):
    points = np.asarray(rod.centerline, float)
    ends = []
    for condition, point, ahead in zip((rod.start, rod.end), points[[0, -1]], np.diff(points, axis=0)[[0, -1]], strict=True):
        tangent = ahead / np.linalg.norm(ahead)
        across = np.asarray(rod.normal, float) - np.dot(rod.normal, tangent) * tangent
        d1 = across / np.linalg.norm(across)
        frame = np.stack([d1, np.cross(tangent, d1), tangent], axis=1)
        clamped = frame if condition is EndCondition.CLAMPED else None
        ends.append(None if condition is EndCondition.FREE else (point, clamped))
    return Boundary.of(*ends)


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    solvers = [Scan2FlexSolver()]
    for name in registry.names(registry.SOLVERS):
        try:
            solvers.append(registry.load_solver(name))
        except ImportError as error:
            sys.stderr.write(f"{name}: skipped, {error}\n")
    for experiment in map(registry.load_experiment, EXPERIMENTS):
        for solver in solvers:
            told = {"experiment": experiment.name, "solver": solver.name}
            try:
                result = run(experiment, solver)
                told |= {"elements": result.n_elements, "outcome": result.outcome, "wall_s": result.wall_time}
                told |= dict(result.metrics or {})
            except Exception as error:  # a library of another version breaks its adapter, not this comparison
                told["failed"] = str(error)
            sys.stdout.write(json.dumps(told) + "\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
