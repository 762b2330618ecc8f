"""Gates: what looks like missing physics and is none. Asked first, and said in words.

A mesh that is too coarse, a pose on a saddle or on a foreign branch, and effects that do not vanish at zero amplitude would
all be reported as physics. ``mesh`` is an estimate (m) of the discretisation error of the plain fit's shapes: the largest
change of a node from half the mesh to the whole, over three (the rod is second order in the mesh).
"""

import jax.numpy as jnp
import numpy as np

from scan2flex_jax.equilibrium.solve import equilibrium
from scan2flex_jax.fit.evaluate import one
from scan2flex_jax.fit.parameters import boundary_at, model_at

_OF_NOISE = 0.5  # of the noise: mesh error beyond this may be taken for physics


def mesh_error(problem, minimum) -> np.ndarray:
    """Estimated error (m) of each pose's shape from the number of elements."""
    half = problem.elements // 2
    model = model_at(problem.layout, problem.template, jnp.asarray(minimum.shared))
    out = []
    for i in range(problem.poses.count):
        boundary = boundary_at(problem.layout, one(problem.poses.boundary, i), jnp.asarray(minimum.local[i]))
        c = one(minimum.evaluation.configuration, i)
        start = type(c)(c.r[::2], c.R[::2])
        e = equilibrium(model, boundary, start=start, elements=half)
        out.append(np.max(np.linalg.norm(np.asarray(e.points) - c.r[::2], axis=1)) / 3.0)
    return np.array(out)


def sentences(mesh: np.ndarray | None, noise, names) -> tuple[str, ...]:
    """What the gates have to say."""
    if mesh is None:
        return ()
    limit = _OF_NOISE * noise.total
    coarse = [f"{n} ({1e3 * m:.2f} mm)" for n, m in zip(names, mesh, strict=True) if not m <= limit]
    text = f"the mesh error may reach the noise in {', '.join(coarse)}: repeat with more elements before believing a name"
    return (text,) if coarse else ()
