"""The cost to second order about an iterate, its damped step, and the rule of convergence: one code for the fits.

Levenberg-Marquardt damps the step in the scale of the parameters themselves (Marquardt), independent of their units, and the
more the less of the predicted decrease the last step has reached (Nielsen); parameters at a bound that the gradient pushes
outwards are fixed. ``xp`` is the array namespace: `numpy` in the host loop
(`descent`), `jax.numpy` in the traced one (`traced`).

**Converged** means that an undamped Gauss-Newton step predicts a decrease of the cost that is small against the noise. With
the cost ``r'r``, half its gradient ``g`` and half its Hessian ``A``, the decrease ``g' A^-1 g`` over the noise variance is the
squared length of the step in standard errors. A descent that damping has stalled elsewhere predicts more: it has not converged.
References: More, "The Levenberg-Marquardt algorithm: implementation and theory" (1978); Madsen, Nielsen and Tingleff, "Methods
for non-linear least squares problems" (2004), Section 3.2.
"""

from functools import cached_property
from typing import Any

import numpy as np

PREDICTED = 1.0e-3  # of the noise variance: predicted decrease below which a descent stops (0.03 standard errors)
CONVERGED = 1.0e-2  # of the noise variance: that below which a descent that stopped has converged (0.1 standard errors)
EXACT = 1.0e-9  # of the length: smaller distances are rounding errors of an equilibrium, whatever the residual
UNSEEN = 1.0e-10  # of the largest column of the Jacobian: a smaller one is rounding, and its parameter keeps its value
LONGEST = 2.0  # of a step in a logarithm (a factor of 7) or, for other parameters, in units of 1 + |value|
GROWTH, _LEAST = 2.0, 1.0 / 3.0  # of the damping: after a first refused step; least after a good one
_WIDE = 60.0  # a range as wide as this does not limit a step


class Quadratic:
    """The cost to second order about ``x``: half its Hessian ``A`` (n, n) and gradient ``g`` (n,).

    ``scale`` (n,) multiplies the damping; ``free`` (n,) marks the parameters that may move. ``noise``: the variance of the
    noise in units of the cost; ``rounding``: that of rounding errors.
    """

    rank = 1e-12  # of the largest eigenvalue: a smaller one is an undetermined direction

    def __init__(self, x, A, g, scale, free, noise=1.0, rounding=0.0, xp: Any = np):
        """Keep the arrays, of the namespace ``xp``."""
        self.x, self.A, self.g, self.scale, self.free = x, A, g, scale, free
        self.noise, self.rounding, self.xp = noise, rounding, xp

    def solved(self, gradient, damping):
        """The damped step against a gradient (n,), of any length."""
        xp, free = self.xp, self.free
        root, unit = xp.where(free, xp.sqrt(self.scale) + 1e-150, 1.0), xp.eye(len(self.g))
        H = xp.where(free[:, None] & free, self.A / xp.outer(root, root), unit) + damping * unit
        values, vectors = xp.linalg.eigh(H)
        seen = values > self.rank * values[-1]
        along = vectors.T @ xp.where(free, -gradient / root, 0.0)
        along = xp.where(seen, along / xp.where(seen, values, 1.0), 0.0)
        return xp.where(free, vectors @ along / root, 0.0)

    def predicted(self, move):
        """Decrease of the cost along an undamped move, for a linear residual without bounds."""
        return -self.g @ move

    @cached_property
    def decrease(self):
        """Decrease of the cost that an undamped step predicts."""
        return self.predicted(self.solved(self.g, 0.0))

    def stationary(self):
        """Whether a descent may stop here, by `PREDICTED`."""
        return self.decrease <= PREDICTED * self.noise

    def converged(self):
        """Whether a descent that stopped here has converged, by `CONVERGED`."""
        return self.decrease <= CONVERGED * (self.noise + self.rounding)

    def change(self, cost, trial_cost, trial):
        """Change of the cost to that of a ``trial`` (n,), with priors that are scaled anew at every iterate."""
        return trial_cost - cost

    def damped(self, damping, growth, change, trial):
        """Damping and its growth after a step to ``trial`` (n,) that changed the cost: in a curved valley it settles where
        most steps go downhill."""
        xp, move = self.xp, trial - self.x
        predicted = xp.maximum(-(2.0 * self.g + self.A @ move) @ move, 1e-300)
        reached = xp.clip(-change, 0.0, 2.0 * predicted) / predicted
        less = damping * xp.maximum(_LEAST, 1.0 - (2.0 * reached - 1.0) ** 3)
        return xp.where(change < 0, less, damping * growth), xp.where(change < 0, GROWTH, 2.0 * growth)

    def moved(self, trial):
        """The largest move of a parameter to ``trial`` (n,)."""
        return self.xp.max(self.xp.abs(trial - self.x), initial=0.0)


class FitQuadratic(Quadratic):
    """The cost of a fit: ``shared`` parameters first, then the local ones of all poses.

    Logarithms (``logs``, (n,)) have a weak prior of ``precision`` (n,) about the start ``began`` (n,). An unidentifiable
    logarithm follows the mean step of the identifiable ones, so that stiffness ratios are kept: a rod that grows stiffer in
    bending alone would buckle out of its plane.
    """

    rank = 1e-14

    def __init__(self, x, JJ, Jr, began, bounds, logs, precision, shared: int, noise=1.0, rounding=0.0, xp: Any = np):
        """From the normal equations ``JJ`` (n, n), ``Jr`` (n,) and the ``bounds`` (low, high), (n,) each."""
        seen = _above(xp, xp.diagonal(JJ))
        self.began, self.weak, (self.low, self.high), self.shared = began, xp.where(seen, precision, 0.0), bounds, shared
        self.leading, self.following = seen & logs, ~seen & logs
        A, g = JJ + xp.diag(self.weak), Jr + self.weak * (x - began)
        scale = xp.diagonal(A) + 1e-300
        held = ((x <= self.low) & (g > 0)) | ((x >= self.high) & (g < 0))
        super().__init__(x, A, g, scale, ~held & _above(xp, scale), noise, rounding, xp)

    def bounded(self, move):
        """The move (n,) with unidentifiable logarithms following, of bounded length in the shared parameters."""
        xp = self.xp
        count = xp.sum(self.leading)
        mean = xp.sum(xp.where(self.leading, move, 0.0)) / xp.maximum(count, 1)
        move = xp.where(self.following & (count > 0), mean, move)
        reach = xp.where(xp.isfinite(self.low) & (xp.abs(self.high - self.low) < _WIDE), 1.0, 1.0 + xp.abs(self.x))
        longest = xp.max((xp.abs(move) / reach)[: self.shared], initial=0.0)
        return move * xp.minimum(1.0, LONGEST / xp.maximum(longest, 1e-300))

    def change(self, cost, trial_cost, trial):
        """Change of the cost with the weak prior of this iterate."""
        return trial_cost + self.xp.sum(self.weak * ((trial - self.began) ** 2 - (self.x - self.began) ** 2)) - cost

    def moved(self, trial):
        """The largest move of a shared parameter."""
        return self.xp.max(self.xp.abs(trial - self.x)[: self.shared], initial=0.0)


def rounding_of(length, sigma, xp: Any = np):
    """Variance of rounding errors in units of the cost, for a cable of ``length`` (m) and noises ``sigma`` (P,) in m."""
    return xp.mean((EXACT * length / sigma) ** 2)


def _above(xp, squares):
    """Mask of the squared columns that are more than rounding."""
    return squares > UNSEEN**2 * xp.max(squares)
