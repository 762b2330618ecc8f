"""The generative model of a hypothesis, linear about a point, and the likelihood of the sizes of its noise.

For pose p, in rows (`rows`): ``y_p = f_p(x) + Z_p z_p + e_p`` with the prior of ``x`` normal, ``z_p ~ N(0, b^2 I)`` the random
curvature and clamp seat of the pose (`fitting.discrepancy`), and

    C_p = white^2/count I + correlated^2 k(lag/length) + axis^2 m(lag/axis length) + b^2 Z_p Z_p',

``k`` a mixture of Matern 3/2 and the squared exponential, since nobody knows how smooth errors of a scan are; ``axis`` the
given error of the axis of scans, ``m`` Matern 3/2; white and correlated noise of a pose are in proportion to the noise that it
states; readings that state their own noise have that in place of all three; rows across a plane in which all points lie have a
noise of `Settings.largest_noise` of the length besides. The sizes
``u = (log white, log correlated, log length, log b, logit of the share of Matern)`` are those of the largest restricted
likelihood times their prior (Patterson and Thompson 1971), for each hypothesis at its own ``x``, with exact gradients: 8 to 15
evaluations of 3 ms. The discrepancy has a spike and a slab (Mitchell and Beauchamp 1988): ``b`` is zero, or half-Cauchy, which
costs `Settings.discrepancy`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize

from scan2flex_jax.fitting.noise import FINEST, Noise
from scan2flex_jax.posterior.rows import Rows
from scan2flex_jax.posterior.settings import Settings

NONE = 1e-4  # of the usual size of a discrepancy: that counts as none
_MOST_NOISE, _LONGEST, _MOST_DISCREPANCY = 5e-3, 0.3, 10.0  # of the length, of the length, and over the usual size
_SHORTEST = 0.01  # of the length
_REGULAR = 1e-6  # of the variance of a smooth noise, white, for the factorisation
_LEAST = 0.01  # correlated noise over the least white one
_ODDS = 0.02  # precision of the log ratio of white and correlated noise
_ROUGH = 8.0  # largest logit of the share of Matern, and its prior variance
_APART = 100.0  # size of the discrepancy of a pose that does not fit, over the usual one
_UNSEEN = 1e-13  # of the largest eigenvalue of a scaled precision


@dataclass(frozen=True)
class Linear:
    """A hypothesis about a point: rows of its residual ``r`` (P, N), of the columns ``X`` (P, N, k) of its parameters, and
    ``Z`` (P, N, q) of a unit discrepancy; ``at``: per pose the indices of its parameters; ``precision`` and ``pull`` of their
    normal priors (half the gradient), and ``quad``, the priors' part of the cost."""

    r: np.ndarray
    X: np.ndarray
    Z: np.ndarray
    at: list
    precision: np.ndarray
    pull: np.ndarray
    quad: float

    def normal(self, wr, wX) -> tuple[np.ndarray, np.ndarray]:
        """Half the Hessian and half the gradient of the cost of all parameters, from white rows."""
        A, g = np.diag(self.precision).astype(float), self.pull.copy()
        AA, gg = wX.transpose(0, 2, 1) @ wX, np.einsum("pnk,pn->pk", wX, wr)
        for i, at in enumerate(self.at):
            A[np.ix_(at, at)] += AA[i]
            g[at] += gg[i]
        return A, g

    def crossed(self, wX, wS) -> np.ndarray:
        """``X' S`` (k, m) of all parameters with further columns ``S``, from white rows, over the poses."""
        out = np.zeros((len(self.precision), wS.shape[2]))
        for i, at in enumerate(self.at):
            out[at] += wX[i].T @ wS[i]
        return out


class Likelihood:
    """Log likelihood (nats) of the sizes ``u`` given a linear hypothesis; ``stated`` (m) noise or None, ``axis`` (m) that of
    scans, ``usual`` (1/m) the scale of a discrepancy."""

    def __init__(
        self, rows: Rows, length: float, stated: float | None, axis: float, usual: float, settings: Settings,
        outliers: Sequence[int] = (),
    ):  # fmt: skip
        """Bounds of the sizes from the cable's ``length`` (m); ``outliers`` have a wide discrepancy of their own."""
        self.outliers = np.isin(np.arange(rows.poses), list(outliers)) * (_APART * usual) ** 2
        self.rows, self.length, self.stated, self.axis = rows, length, stated, axis
        self.usual, self.settings = usual, settings
        self.of_axis = axis**2 * rows.same * _correlation(rows.lag / (settings.axis_length * length), np.inf)[0]
        shortest, least = max(rows.gap, _SHORTEST * length), np.log(FINEST * length)
        noise = least, np.log(max(_MOST_NOISE * length, 2.0 * (stated or 0.0)))
        lengths = np.log(shortest), np.log(max(_LONGEST * length, 1.1 * shortest))
        most = _MOST_DISCREPANCY if rows.poses > 1 else 2 * NONE  # in a single pose, a discrepancy and an effect are the same
        self.bounds = [noise, (least + np.log(_LEAST), noise[1]), lengths, (np.log(NONE * usual), np.log(most * usual))]
        self.bounds.append((-_ROUGH, _ROUGH))
        T = np.vander(rows.inside / max(rows.inside.max(initial=0.0), 1e-12), 2)
        n = len(rows.inside)
        self.apart_from_line = (np.eye(n) - T @ np.linalg.pinv(T)) / max(n - 2, 1)

    def on(self, rows: Rows) -> "Likelihood":
        """The same law for other poses."""
        return Likelihood(rows, self.length, self.stated, self.axis, self.usual, self.settings)

    def start(self, noise: float, b: float) -> np.ndarray:
        """Sizes to begin from, for a noise (m) and a discrepancy ``b`` over the usual one."""
        return np.r_[np.log([noise, noise, self.settings.correlation * self.length, b * self.usual]), 0.0]

    def noise(self, u) -> Noise:
        """The noise of the sensor."""
        return Noise(*map(float, np.exp(u[:3])))

    def discrepant(self, u) -> bool:
        """Whether the sizes have a discrepancy."""
        return bool(np.exp(u[3]) > 20 * NONE * self.usual)

    def prior(self, u) -> tuple[float, np.ndarray]:
        """Log prior of the sizes and its gradient."""
        s, (sw, sc, _, b), v, g = self.settings, np.exp(u[:4]), 0.0, np.zeros(5)
        d = (u[2] - np.log(s.correlation * self.length)) / s.correlation_spread
        v, g[2] = v - 0.5 * d**2, -d / s.correlation_spread
        v, g[:2] = v - 0.5 * _ODDS * (u[1] - u[0]) ** 2, _ODDS * (u[1] - u[0]) * np.array([1.0, -1.0])
        total = sw**2 + sc**2
        usual = np.log(s.usual_noise * self.length), np.log(s.noise_factor)
        mid, spread = (np.log(self.stated), s.stated) if self.stated else usual
        d = (0.5 * np.log(total) - mid) / spread
        v, g[:2] = v - 0.5 * d**2, g[:2] - d / spread * np.array([sw**2, sc**2]) / total
        v, g[4] = v - 0.5 * u[4] ** 2 / _ROUGH, -u[4] / _ROUGH
        q = (b / self.usual) ** 2  # half-Cauchy: flat towards zero, heavy above
        return v - np.log1p(q), g + np.array([0, 0, 0, -2 * q / (1 + q), 0])

    def covariance(self, u, Z) -> tuple[np.ndarray, tuple]:
        """C (P, N, N), and its derivatives by log white (a diagonal), correlated, length, b, b along tangents (a diagonal), and
        the share of Matern."""
        p, (sw, sc, ell, b) = self.rows, np.exp(u[:4])
        K, dK, dw = (p.same * k * p.noise[:, :, None] ** 2 for k in _correlation(p.lag / ell, u[4]))
        open_ = (1 - p.pad) * (p.known == 0)
        white, ZZ = sw**2 / p.count * open_ * p.noise**2, b**2 * (Z @ Z.transpose(0, 2, 1))
        aside = b**2 * np.sum(Z**2, axis=2) / p.near
        fore = p.tangent * aside**2  # points moved across draw back along the tangent, to second order
        i = np.arange(p.rows)
        K[:, i, i] += _REGULAR * open_
        C = sc**2 * K + ZZ + self.of_axis
        if np.any(self.outliers):
            C += self.outliers[:, None, None] * ZZ / b**2
        C[:, i, i] += white + fore + p.pad + p.known**2 + p.across * (self.settings.largest_noise * self.length) ** 2
        return C, (2 * white, 2 * sc**2 * K, sc**2 * dK, 2 * ZZ, 4 * fore, sc**2 * dw)

    def within(self, u) -> tuple[float, np.ndarray]:
        """Log likelihood of the scatter within bins, and its gradient."""
        p = self.rows
        if not p.dof:
            return 0.0, np.zeros(5)
        sw, sc, ell, _ = np.exp(u[:4])
        k, dk, dw = (np.sum(self.apart_from_line * c) for c in _correlation(np.abs(p.inside[:, None] - p.inside) / ell, u[4]))
        v = sw**2 + sc**2 * k
        dv = np.array([2 * sw**2, 2 * sc**2 * k, sc**2 * dk, 0.0, sc**2 * dw])
        return -0.5 * p.dof * np.log(v) - 0.5 * p.scatter / v, (-0.5 * p.dof / v + 0.5 * p.scatter / v**2) * dv

    def whitening(self, u, Z) -> np.ndarray:
        """Inverse Cholesky factors (P, N, N) of C."""
        return np.linalg.inv(np.linalg.cholesky(self.covariance(u, Z)[0]))

    def white(self, u, lin: Linear, *more) -> tuple[np.ndarray, ...]:
        """White rows of the residual, of the columns of the parameters, and of ``more`` columns (P, N, K)."""
        Li = self.whitening(u, lin.Z)
        return (Li @ lin.r[:, :, None])[:, :, 0], Li @ lin.X, *(Li @ c for c in more)

    def __call__(self, u, lin: Linear, gradient: bool = True, shift: bool = True):
        """Log marginal likelihood with the prior of the sizes; ``shift``: maximised over the linear parameters."""
        C, parts = self.covariance(u, lin.Z)
        try:
            Li = np.linalg.inv(np.linalg.cholesky(C))
        except np.linalg.LinAlgError:
            return (-1e12, np.zeros(5)) if gradient else -1e12
        wr, wX = (Li @ lin.r[:, :, None])[:, :, 0], Li @ lin.X
        A, g = lin.normal(wr, wX)
        log_det, inverse = inverted(A)
        x, known = inverse @ g if shift else np.zeros(len(g)), lin.precision > 0
        value = -0.5 * (np.sum(wr**2) + lin.quad - g @ x) - 0.5 * log_det + 0.5 * np.sum(np.log(lin.precision[known]))
        value += np.sum(np.log(np.einsum("pnn->pn", Li)))
        inside, gi = self.within(u)
        before, gb = self.prior(u)
        value += inside + before
        if not gradient:
            return float(value)
        WX = Li.transpose(0, 2, 1) @ wX
        e = wr - np.einsum("pnk,pk->pn", wX, np.stack([x[a] for a in lin.at]))
        alpha = np.einsum("pmn,pm->pn", Li, e)
        own = np.stack([inverse[np.ix_(a, a)] for a in lin.at])
        G = alpha[:, :, None] * alpha[:, None] - (Li.transpose(0, 2, 1) @ Li - WX @ own @ WX.transpose(0, 2, 1))
        diag = np.einsum("pnn->pn", G)
        along = [np.sum(diag * parts[0]), np.sum(G * parts[1]), np.sum(G * parts[2]), np.sum(G * parts[3])]
        along[3] += np.sum(diag * parts[4])
        along.append(np.sum(G * parts[5]))
        return float(value), 0.5 * np.array(along) + gi + gb

    def mode(self, lin: Linear, starts, most: int = 25, shift: bool = True, bounds=None) -> tuple[np.ndarray, float]:
        """The likeliest sizes from several starts, and the value there."""
        best, bounds = (np.asarray(starts[0]), -np.inf), self.bounds if bounds is None else bounds

        def objective(v):
            value, gradient = self(v, lin, shift=shift)
            return -value, -gradient

        for u in starts:
            begin = np.clip(u, *np.transpose(bounds))
            options = {"maxiter": most, "ftol": 1e-6}
            f = optimize.minimize(objective, begin, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
            if -f.fun > best[1]:
                best = f.x, float(-f.fun)
        return best

    def without(self, lin: Linear, u, most: int = 25) -> tuple[np.ndarray, float]:
        """The likeliest sizes without a discrepancy, and the value there."""
        none = np.log(NONE * self.usual)
        starts = [np.r_[u[:3], none, u[4]]] + [np.r_[u[0], u[0], u[2], none, u[4]]] * self.discrepant(u)
        return self.mode(lin, starts, most, bounds=[*self.bounds[:3], (none, none + 1e-9), self.bounds[4]])

    def likeliest(self, lin: Linear, starts, most: int = 25) -> tuple[np.ndarray, float]:
        """The likeliest sizes under spike and slab, and the value with the cost of a slab."""
        u, value = self.mode(lin, starts, most)
        bare, alone = self.without(lin, u, most)
        return (bare, alone) if alone > value - self.settings.discrepancy else (u, value - self.settings.discrepancy)

    def nearest(self, lin: Linear, u) -> tuple[np.ndarray, float]:
        """The likeliest sizes near others, in their part of spike and slab, and the value with the cost of a slab."""
        if not self.discrepant(u):
            return self.without(lin, u)
        u, value = self.mode(lin, [u])
        return u, value - self.settings.discrepancy

    def gain(self, lin: Linear, u) -> float:
        """Nats that a discrepancy gains."""
        starts = [u] if self.discrepant(u) else [np.r_[u[:3], np.log(f * self.usual), u[4]] for f in (0.03, 1.0)]
        return self.mode(lin, starts)[1] - self.without(lin, u)[1]


def _correlation(d, logit) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Correlation at distances ``d`` over its length, its derivative by the logarithm of that length, and by the ``logit``."""
    a, share = np.sqrt(3.0) * d, 1.0 / (1.0 + np.exp(-logit))
    decay, smooth = np.exp(-a), np.exp(-0.5 * d**2)
    rough = (1.0 + a) * decay
    k, dk = share * rough + (1 - share) * smooth, share * a**2 * decay + (1 - share) * d**2 * smooth
    return k, dk, share * (1 - share) * (rough - smooth)


def inverted(A) -> tuple[float, np.ndarray]:
    """Log determinant and inverse of a precision matrix, scaled to unit diagonal first."""
    scale = np.sqrt(np.maximum(np.diag(A), 1e-100))
    values, vectors = np.linalg.eigh(A / np.outer(scale, scale))
    values = np.maximum(values, _UNSEEN)
    return float(np.sum(np.log(values)) + 2 * np.sum(np.log(scale))), (vectors / values) @ vectors.T / np.outer(scale, scale)


def without(lin: Linear, wr, wX, groups) -> Iterator[tuple[list[int], np.ndarray, np.ndarray]]:
    """``(group, covariance, change)`` of all parameters without each group of poses, to first order; nothing is refitted."""
    A, g = lin.normal(wr, wX)
    for group in groups:
        B, h = A.copy(), g.copy()
        for i in group:
            at = lin.at[i]
            B[np.ix_(at, at)] -= wX[i].T @ wX[i]
            h[at] -= wX[i].T @ wr[i]
        V = inverted(B)[1]
        yield group, V, -V @ h


def left_out(lin: Linear, wr, wX, groups) -> np.ndarray:
    """Log density (nats) of each group of poses (indices) predicted from all others, to first order in the parameters, up to
    the density of the noise alone, which `elpd` adds."""
    out = []
    for group, V, d in without(lin, wr, wX, groups):
        r = np.concatenate([wr[i] + wX[i] @ d[lin.at[i]] for i in group])
        full = np.zeros((len(r), len(V)))
        for k, i in enumerate(group):
            full[k * wX.shape[1] : (k + 1) * wX.shape[1], lin.at[i]] = wX[i]
        S = np.eye(len(r)) + full @ V @ full.T
        L = np.linalg.cholesky(0.5 * (S + S.T))
        out.append(-0.5 * np.sum(np.linalg.solve(L, r) ** 2) - np.sum(np.log(np.diag(L))))
    return np.array(out)


def elpd(likelihood: Likelihood, lin: Linear, u, groups) -> np.ndarray:
    """Log predictive density (nats) of each group of poses given the others (Vehtari, Gelman and Gabry 2017), up to a constant
    that all hypotheses of a study share."""
    Li = likelihood.whitening(u, lin.Z)
    wr, wX = (Li @ lin.r[:, :, None])[:, :, 0], Li @ lin.X
    own = np.sum(np.log(np.einsum("pnn->pn", Li)), axis=1)
    return left_out(lin, wr, wX, groups) + np.array([sum(own[i] for i in group) for group in groups])


def bare(lin: Linear) -> Linear:
    """The rows without parameters."""
    count = len(lin.precision)
    return replace(lin, X=0 * lin.X, precision=np.ones(count), pull=0 * lin.pull, quad=0.0)
