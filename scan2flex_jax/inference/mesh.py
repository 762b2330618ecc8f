"""The error of the mesh, which would pass for missing physics: the shapes of a fit solved with twice the elements."""

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from scan2flex_jax.fitting.evaluate import one
from scan2flex_jax.fitting.parameters import boundary_at, model_at
from scan2flex_jax.fitting.threads import each_pose
from scan2flex_jax.rod.memory import remembering
from scan2flex_jax.rod.model import CableModel
from scan2flex_jax.statics.solve import equilibrium


def mesh_error(problem, minimum) -> np.ndarray:
    """Largest displacement (m) of a node of each pose with twice the elements; NaN without an equilibrium."""
    before = problem.evaluator.states_before(minimum.shared, minimum.local, minimum.evaluation.configuration)

    def of_pose(i):
        model = model_at(problem.layout, problem.poses.template(i), jnp.asarray(minimum.shared))
        if before[i]:  # each half of an element remembers what the whole does
            halves = tuple(np.repeat(left, 2, axis=0) for left in before[i])
            model = CableModel(model.cable, model.gravity, remembering(model.effects, halves))
        stated = jax.tree.map(jnp.asarray, one(problem.poses.boundary, i))
        boundary = boundary_at(problem.layout, stated, jnp.asarray(minimum.local[i]))
        c = one(minimum.evaluation.configuration, i)
        e = equilibrium(model, boundary, start=_doubled(c), elements=2 * problem.elements)
        error = np.max(np.linalg.norm(np.asarray(e.points)[::2] - c.r, axis=1))
        return error if bool(e.verdict.solved) else np.nan

    return np.array(each_pose(of_pose, problem.poses.count))


def _doubled(c):
    """The configuration with a node added at the middle of each element."""
    a, b = Rotation.from_matrix(c.R[:-1]), Rotation.from_matrix(c.R[1:])
    r, R = (np.repeat(x, 2, axis=0)[:-1] for x in (c.r, c.R))
    r[1::2], R[1::2] = 0.5 * (c.r[:-1] + c.r[1:]), (a * (a.inv() * b) ** 0.5).as_matrix()
    return type(c)(r, R)
