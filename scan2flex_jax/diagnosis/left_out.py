"""Leave-one-pose-out error: each pose predicted by the model refitted to the others.

The refits are under the law of the residual that is most likely given the model and all poses.
"""

from dataclasses import replace

import numpy as np

from scan2flex_jax.diagnosis.refit import Refit, again, configurations
from scan2flex_jax.diagnosis.sensitivity import Bench, Numbers
from scan2flex_jax.statics.verdict import SOLVED

_STEPS = 10  # iterations of a refit without one pose, which starts from that of all poses


def refitted(bench: Bench, found: Refit) -> np.ndarray:
    """Per pose the RMS distance (m) between its measured points and the prediction of a refit to the others; NaN where that
    refit or the pose is not solved."""
    return np.array([_error(bench, found, i) for i in range(bench.poses.count)])


def _error(bench, found, i):
    others = [k for k in range(bench.poses.count) if k != i]
    n = Numbers(bench, found.components)
    local = n.shared + n.local * np.arange(bench.poses.count + 1)
    own = np.arange(local[i], local[i + 1])
    rest = replace(found, vector=np.delete(found.vector, own), shapes=[found.shapes[k] for k in others])
    end = again(bench.only(others), rest, found.law.only(others), most=_STEPS)
    if not np.isfinite(end.cost):
        return np.nan
    shared, effects = end.vector[: n.shared], end.vector[n.base - n.local :]
    vector = np.concatenate([shared, np.zeros(n.local), effects])  # nuisance parameters of an unseen pose: as declared
    alone = bench.only([i])
    shape = alone.shapes(found.components, vector, configurations(found.shapes[i : i + 1]), derivative=False)[0]
    if int(shape.verdict.code) != SOLVED or not np.all(np.isfinite(shape.residual)):
        return np.nan
    return float(np.sqrt(np.mean(np.sum(shape.residual[bench.real[i]] ** 2, axis=1))))
