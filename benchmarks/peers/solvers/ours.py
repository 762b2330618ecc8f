"""This package, as a user calls it: generic start, the answer with its verdict."""

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from benchmarks.peers.solvers import Found
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.model import CableModel
from scan2flex_jax.statics.solve import equilibrium


def rod(problem) -> tuple[CableModel, Boundary]:
    """The problem in the package's own terms."""
    stiff = problem.stretching
    cable = Cable(problem.length, problem.density, problem.bending, problem.torsion, stiff, stiff)
    model = CableModel(cable, jnp.array([0.0, 0.0, -problem.weight / problem.density]))
    end = None if problem.free else (jnp.array(problem.end), jnp.array(problem.end_frame))
    return model, Boundary.of((jnp.zeros(3), jnp.array(problem.start_frame)), end)


def prepare(problem, elements, solver="newton"):
    """The compiled solve; its first call compiles."""
    jax.config.update("jax_enable_x64", True)
    model, boundary = rod(problem)
    method = optx.BFGS(1e-8, 1e-8) if solver == "bfgs" else None

    def solve():
        answer = equilibrium(model, boundary, elements=elements, solver=method)
        points, v = np.asarray(answer.points), answer.verdict
        if not bool(v.solved):
            raise FloatingPointError(v.sentence())
        return [Found(np.asarray(answer.s), points, {"steps": int(v.steps)})]

    return solve
