"""The least-squares problem of a fit, as `descent` minimises it, and the two alternative methods.

The cost is ``sum (r / sigma)^2 + |z|^2``: measured minus modelled shape, and the priors of nuisance parameters. The noise
variance is unknown, so the cost over the number of measured values stands in for it. In units of it, logarithms have a weak
prior about their start (a factor of 20 is one standard deviation), so that an unidentifiable one does not drift to where
the rod is no cable and takes hundreds of steps to solve, while identifiable ones move by a small part of their standard
error; it is also the noise in the rule of convergence (`quadratic`). Steps in logarithms are bounded. A fit from known
configurations starts once more from the measured curves at the end.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import optimize

from scan2flex_jax.fitting.descent import Model, Point, Rules, descend
from scan2flex_jax.fitting.evaluate import Evaluation, Evaluator
from scan2flex_jax.fitting.quadratic import FitQuadratic

MOST_ITERATIONS = 60
_PATIENCE, _FAR = 10, 10.0  # iterations, and cost over the one to beat, after which a descent is given up
COST_TOLERANCE, STEP_TOLERANCE = 1.0e-10, 1.0e-8
_CLOSER = 1.0e-6  # of the cost: least gain of a start from the measured curves
GIVE_UP = 1.0e12  # damping at which no step helps
_FAILED = 1.0e12  # a cost that stands for an unsolved pose in methods that know no rejection


Progress = Callable[[str], None]


def silent(message: str) -> None:
    """No progress."""


def prefixed(progress: Progress, prefix: str) -> Progress:
    """The progress of a part of a call, whose costs may have other units than those of the call itself."""
    return lambda message: progress(f"{prefix}: {message}")


@dataclass
class Minimum:
    """The end of a method: shared and local parameters, the evaluation there, its cost, and its status (`descent.Descent`);
    ``rivals``: shared parameters of minima elsewhere that are about as good, with their RMS distances (m)."""

    shared: np.ndarray
    local: np.ndarray
    evaluation: Evaluation
    cost: float
    iterations: int
    converged: bool
    stalled: bool = False
    rivals: tuple[tuple[np.ndarray, float], ...] = ()


@dataclass
class Goal:
    """The objective: an evaluator, the scale of residuals of each pose (m), and bounds of the shared parameters.

    ``weak``: precision of the prior of each shared parameter about its start, over the noise variance (0: free); ``rounding``:
    the variance of rounding errors in units of the cost. ``beat``: the cost that a useful minimum has to reach; a descent far
    above it is given up after ``patience`` iterations.
    """

    evaluator: Evaluator
    sigma: np.ndarray
    low: np.ndarray
    high: np.ndarray
    progress: Progress = silent
    weak: np.ndarray | float = 0.0
    rounding: float = 0.0
    beat: float = np.inf
    patience: int = _PATIENCE

    def cost(self, e: Evaluation, shared, local) -> float:
        """Weighted squares of residuals and priors."""
        if not e.solved:
            return np.inf
        prior = np.sum(self.evaluator.layout.prior.pull(shared) ** 2) + np.sum(local**2)
        return float(np.sum((e.residual / self.sigma[:, None, None]) ** 2) + prior)

    def normal_equations(self, e: Evaluation, shared, local):
        """``J'J`` and ``J'r`` of the cost in shared and then all local parameters."""
        return normal_equations(
            self.evaluator.layout,
            e.residual / self.sigma[:, None, None],
            e.jacobian / self.sigma[:, None, None, None],
            shared,
            local,
        )


def normal_equations(layout, residual, jacobian, shared, local):
    """``J'J`` (with the priors' unit rows) and ``J'r`` of weighted residuals and Jacobian of all poses."""
    P, n, k = len(residual), layout.shared, layout.local
    JJ, Jr = np.zeros((n + P * k, n + P * k)), np.zeros(n + P * k)
    for i in range(P):
        J, r = jacobian[i].reshape(-1, n + k), residual[i].ravel()
        own = np.r_[np.arange(n), n + i * k + np.arange(k)]
        JJ[np.ix_(own, own)] += J.T @ J
        Jr[own] += J.T @ r
    JJ[np.diag_indices_from(JJ)] += np.r_[layout.prior.precision(n), np.ones(P * k)]
    Jr[layout.prior.at] += layout.prior.pull(shared) / layout.prior.std
    Jr[n:] += local.ravel()
    return JJ, Jr


def levenberg_marquardt(
    goal: Goal, shared: np.ndarray, local: np.ndarray | None = None, start=None, known: Evaluation | None = None
) -> Minimum:
    """The nearest minimum from ``shared`` (and ``local``); ``start``: configurations to continue from; ``known``: the
    evaluation there (from the measured curves), if available."""
    evaluator = goal.evaluator
    local = np.zeros((evaluator.poses.count, evaluator.layout.local)) if local is None else local
    e = evaluator(shared, local, start=start) if known is None else known
    model = _FitModel(goal, shared, local.shape)
    rules = Rules(
        most=lambda cost: MOST_ITERATIONS if cost < _FAR * goal.beat else goal.patience,
        settled=lambda cost: COST_TOLERANCE * cost, step=STEP_TOLERANCE, judged=True, damping=1e-3, least=1e-12,
        give_up=GIVE_UP, closer=None if start is None else lambda cost: _CLOSER * cost,
        hopeless=goal.beat, progress=goal.progress, bend=model.bends,
    )  # fmt: skip
    found = descend(model, model.of(np.r_[shared, local.ravel()], e), rules)
    shared, local = model.split(found.point.x)
    return Minimum(shared, local, found.point.found, found.point.cost, found.iterations, found.converged, found.stalled)


class _FitModel(Model):
    """The fit of a study: its shared parameters, then the local ones of all poses.

    Logarithms have a weak prior about the start ``began`` of the descent.
    """

    def __init__(self, goal: Goal, began: np.ndarray, shape: tuple[int, ...]):
        """No pose is solved yet; ``shape`` (poses, local) is that of the local parameters."""
        self.goal, self.shape, self.values = goal, shape, goal.evaluator.poses.values
        self.shared, rest = len(began), int(np.prod(shape))
        free = np.full(rest, np.inf)
        self.began, self.low, self.high = np.r_[began, np.zeros(rest)], np.r_[goal.low, -free], np.r_[goal.high, free]
        self.bends = any(slot.root for slot in goal.evaluator.layout.slots)  # a field's components trade in curved valleys
        self.weak = np.r_[np.broadcast_to(goal.weak, self.shared), np.zeros(rest)]

    def split(self, x):
        """Shared and local parameters."""
        return x[: self.shared], x[self.shared :].reshape(self.shape)

    def of(self, x, e: Evaluation) -> Point:
        """The point of a known evaluation at ``x``."""
        rows = self._rows(e) if self.bends else ()
        return Point(x, self.goal.cost(e, *self.split(x)), e.configuration, e, *rows)

    def _rows(self, e):
        """Weighted residuals (k,) and their Jacobian (k, n) of all poses."""
        J = e.jacobian / self.goal.sigma[:, None, None, None]
        each, n = J.reshape(len(J), -1, J.shape[-1]), self.shared
        own = [np.kron(np.eye(len(J))[i], x[:, n:]) for i, x in enumerate(each)]
        return (e.residual / self.goal.sigma[:, None, None]).ravel(), np.c_[J[..., :n].reshape(-1, n), np.concatenate(own)]

    def at(self, x, start=None) -> Point:
        return self.of(x, self.goal.evaluator(*self.split(x), start=start))

    def about(self, point) -> FitQuadratic:
        JJ, Jr = self.goal.normal_equations(point.found, *self.split(point.x))
        share, bounds = point.cost / self.values, (self.low, self.high)
        return FitQuadratic(
            point.x, JJ, Jr, self.began, bounds, self.weak > 0, share * self.weak, self.shared, share, self.goal.rounding
        )

    def bounded(self, move, about):
        return about.bounded(move)


def bfgs(goal: Goal, shared: np.ndarray) -> Minimum:
    """L-BFGS-B on the summed squared distance with its gradient by the implicit function theorem (local parameters at zero)."""
    return _scipy(goal, shared, "L-BFGS-B", derivative=True, options={"maxiter": 200, "ftol": 1e-15, "gtol": 1e-9})


def nelder_mead(goal: Goal, shared: np.ndarray) -> Minimum:
    """The paper's method (Section 5.2.2), its baseline here; no gradient, in logarithms of positive parameters."""
    return _scipy(goal, shared, "Nelder-Mead", derivative=False, options={"maxiter": 400, "xatol": 1e-6, "fatol": 1e-14})


def _scipy(goal, shared, method, derivative, options):
    evaluator = goal.evaluator
    local = np.zeros((evaluator.poses.count, evaluator.layout.local))
    best = {"cost": np.inf}

    def value(x):
        e = evaluator(x, local, derivative=derivative)
        cost = goal.cost(e, x, local)
        if cost < best["cost"]:
            best.update(cost=cost, x=x.copy())
            goal.progress(f"{method}: cost {cost:.6g}")
        if not derivative:
            return cost if np.isfinite(cost) else _FAILED
        if not np.isfinite(cost):
            return _FAILED, np.zeros_like(x)
        _, Jr = goal.normal_equations(e, x, local)
        return cost, 2.0 * Jr[: len(x)]

    bounds = optimize.Bounds(goal.low, goal.high)
    found = optimize.minimize(value, shared, method=method, jac=derivative, bounds=bounds, options=options)
    x = best.get("x", shared)
    e = evaluator(x, local)
    cost, converged = goal.cost(e, x, local), bool(found.success)
    if np.isfinite(cost) and evaluator.distance != "hausdorff":  # it has no least squares to judge by
        model = _FitModel(goal, x, local.shape)
        converged = bool(model.about(model.of(np.r_[x, local.ravel()], e)).converged())
    return Minimum(x, local, e, cost, int(found.nit), converged, bool(found.success) and not converged)
