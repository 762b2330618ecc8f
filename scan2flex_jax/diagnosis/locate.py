"""Location of missing physics: the equivalent load, a field of forces that would cause the residual.

The equivalent load is a Gaussian process ``f(s)`` (N/m, in the scan frame) with the prior of `families`; the sensitivity of the
equilibrium gives its posterior mean and standard deviation. Balance holds by construction, and no scan is differentiated. The
field shows where an effect acts, not which; its band is wide along directions in which the cable is stiff. A field of natural
curvature (1/m) is computed likewise.
"""

from dataclasses import dataclass

import numpy as np

from scan2flex_jax.diagnosis.families import DESCRIBED, best_amplitude
from scan2flex_jax.geometry.fields import POINTS, smooth_root


@dataclass(frozen=True)
class Field:
    """A field along the cable: ``s`` (k,) m, posterior ``mean`` and ``std`` (k, 3) in ``unit``, and log evidence ``gain``."""

    s: np.ndarray
    mean: np.ndarray
    std: np.ndarray
    gain: float
    unit: str

    def to_json(self) -> dict:
        """Lists."""
        return {"s": self.s.tolist(), "mean": self.mean.tolist(), "std": self.std.tolist(), "unit": self.unit}


LOAD = "load"


def common_field(stage, name: str) -> Field:
    """A field of `families.DESCRIBED`, the same in all poses: loads in the scan frame, curvatures in material axes."""
    return _field(stage, name, slice(None))


def pose_loads(stage) -> list[Field]:
    """The equivalent load (N/m) of each pose by itself."""
    return [_field(stage, LOAD, rows) for rows in stage.white.rows]


def _field(stage, name, rows):
    columns = stage.fields[name]
    S = np.zeros((len(stage.y), columns[0].shape[-1]))
    S[rows] = -stage.white.stack(columns)[rows]
    root = smooth_root(POINTS, 3)
    Z = S @ root
    Z = Z - stage.Q @ (stage.Q.T @ Z)
    U, d, Vt = np.linalg.svd(Z, full_matrices=False)
    a, gain = best_amplitude(U, d, stage.y)
    t = (a * d) ** 2
    mean = root @ (Vt.T @ (a**2 * d / (1 + t) * (U.T @ stage.y)))
    spread = root @ (np.eye(len(root)) - (Vt.T * (t / (1 + t))) @ Vt) @ root.T
    std = a * np.sqrt(np.maximum(np.diag(spread), 0.0))
    s = np.linspace(0.0, stage.bench.context.length, POINTS)
    return Field(s, mean.reshape(POINTS, 3), std.reshape(POINTS, 3), float(gain), DESCRIBED[name].unit)
