"""Evidence: how much more likely the data are with a kind than without it, its size being physically plausible.

Amplitudes in units of their size have a standard normal prior; with ``A = X'X``, ``b = X'y`` (whitened, base taken out)

    log B = 1/2 b' (I + A)^-1 b - 1/2 log |I + A|.

A one-sided amplitude has half the prior: times ``2 Phi(mean/sd)``. A kind with several sites has the mean of ``B`` over them.
Reference: MacKay, "Bayesian interpolation" (1992). BIC, ``T/2 - k/2 log n``, is the second opinion.
"""

import numpy as np
from scipy import special


def log_evidence(A: np.ndarray, b: np.ndarray, one_sided=()) -> float:
    """Log Bayes factor of a group over the base."""
    S = np.eye(len(b)) + A
    mean = np.linalg.solve(S, b)
    value = 0.5 * b @ mean - 0.5 * np.linalg.slogdet(S)[1]
    if any(one_sided):
        sd = np.sqrt(np.diag(np.linalg.inv(S)))
        value += sum(np.log(2.0) + special.log_ndtr(m / s) for m, s, o in zip(mean, sd, one_sided, strict=True) if o)
    return float(value)


def one_step(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Expected amplitudes in units of their size, shrunk by the prior."""
    return np.linalg.solve(np.eye(len(b)) + A, b)


def averaged(values) -> float:
    """Log of the mean of evidences given by their logarithms."""
    values = np.asarray(values, float)
    return float(special.logsumexp(values) - np.log(len(values)))


def bic(T: float, rank: int, n: int) -> float:
    """Half of the drop of the Bayesian information criterion."""
    return 0.5 * T - 0.5 * rank * np.log(n)
