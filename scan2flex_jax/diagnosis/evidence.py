"""Evidence of an effect type: log Bayes factor over the base model, with priors of physically plausible sizes.

Amplitudes in units of their physical size have a normal prior of standard deviation ``t``; with ``A = X'X``, ``b = X'y``
(whitened, projected off the base columns)

    log B_t = 1/2 b' (I/t^2 + A)^-1 b - 1/2 log |I + t^2 A|.

Sizes are known to an order of magnitude, and missing effects tend to be strong: ``B`` is the mean over ``t`` in `SCALES`, so
that strength alone does not lower the rank of an effect type. A one-sided amplitude has a half-normal prior: a factor of
``2 Phi(mean/sd)``. ``B`` of an effect type is the mean over its candidate sites. Reference: MacKay, "Bayesian interpolation"
(1992). BIC, ``T/2 - k/2 log n``, is a second criterion.
"""

import numpy as np
from scipy import special

SCALES = (1.0 / 3.0, 1.0, 3.0, 10.0, 30.0)  # of a physical size, equally likely


def log_evidence(A: np.ndarray, b: np.ndarray, one_sided=()) -> float:
    """Log Bayes factor of a group over the base."""
    sizes, axes = np.linalg.eigh(0.5 * (A + A.T))  # negative by rounding only, which may far exceed the prior
    return averaged([_at_scale(t, np.maximum(sizes, 0.0), axes, b, one_sided) for t in SCALES])


def _at_scale(scale, sizes, axes, b, one_sided):
    sizes = sizes + scale**-2
    mean = axes @ (axes.T @ b / sizes)
    value = 0.5 * b @ mean - 0.5 * np.sum(np.log(scale**2 * sizes))
    if any(one_sided):
        sd = np.sqrt(axes**2 @ (1.0 / sizes))
        value += sum(np.log(2.0) + special.log_ndtr(m / s) for m, s, o in zip(mean, sd, one_sided, strict=True) if o)
    return float(value)


def one_step(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Posterior mean of the amplitudes, in units of their size."""
    return np.linalg.solve(np.eye(len(b)) + A, b)


def averaged(values) -> float:
    """Log of the mean of evidences given by their logarithms."""
    values = np.asarray(values, float)
    return float(special.logsumexp(values) - np.log(len(values)))


def bic(T: float, rank: int, n: int) -> float:
    """Half the decrease of the Bayesian information criterion."""
    return 0.5 * T - 0.5 * rank * np.log(n)
