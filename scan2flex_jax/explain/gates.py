"""Gates: what looks like missing physics and is none.

A mesh that is too coarse would be reported as physics, so it is refined before anything is looked for: the mesh error of the
plain fit's shapes is estimated from half the mesh, and while it reaches a fifth of the noise the number of elements is doubled.
Poses on a saddle or off balance never enter (`fit` and every refit require a stable equilibrium from the measured curve), and
that every effect vanishes at zero amplitude is a property of the catalogue that its tests hold.
"""

import jax
import jax.numpy as jnp
import numpy as np

from scan2flex_jax.equilibrium.solve import equilibrium
from scan2flex_jax.fit.evaluate import one
from scan2flex_jax.fit.parameters import boundary_at, model_at

OF_NOISE = 0.2  # mesh error over the noise of one component beyond which the mesh is refined
MOST_ELEMENTS = 160
_ORDER = 3.0  # half a mesh is off by at least four times as much (second order; smooth shapes by sixteen)


def mesh_error(problem, minimum) -> np.ndarray:
    """Estimated largest error (m) of each pose's shape from the number of elements, by solving with half of them.

    NaN where the half mesh finds no equilibrium.
    """
    half = problem.elements // 2
    model = model_at(problem.layout, problem.template, jnp.asarray(minimum.shared))
    out = []
    for i in range(problem.poses.count):
        said = jax.tree.map(jnp.asarray, one(problem.poses.boundary, i))
        boundary = boundary_at(problem.layout, said, jnp.asarray(minimum.local[i]))
        c = one(minimum.evaluation.configuration, i)
        start = type(c)(c.r[::2], c.R[::2])
        e = equilibrium(model, boundary, start=start, elements=half)
        error = np.max(np.linalg.norm(np.asarray(e.points) - c.r[::2], axis=1)) / _ORDER
        out.append(error if bool(e.verdict.solved) else np.nan)
    return np.array(out)


def too_coarse(error: np.ndarray, noise: float, names) -> list[str]:
    """The poses whose mesh error may be taken for physics, with that error in words."""
    return [f"{n} ({1e3 * m:.2f} mm)" for n, m in zip(names, error, strict=True) if not m <= OF_NOISE * noise]
