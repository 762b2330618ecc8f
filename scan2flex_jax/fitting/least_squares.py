"""The least-squares problem of a fit, as `descent` minimises it, and the two methods beside it.

The cost is ``sum (r / sigma)^2 + |z|^2``: measured minus modelled shape, and the priors of nearly known numbers. The noise
variance is unknown, so cost / n_residuals stands in for it. In units of it, logarithms are held weakly where they began (a
factor of 20 is one standard deviation), so that a number that the poses hardly feel does not drift to where the rod is no cable
and takes hundreds of steps to solve, while what they determine moves by a small part of its standard error; and the fit has
converged when a step promises less than a thousandth of it. Steps in logarithms are bounded. A fit that began from
configurations already found starts from the measured curves once more at the end.

A moment law makes the cost a narrow valley that bends: where a cable yields, its moment hardly grows, so that steps of the law
and the stiffness before it make up for one another far from linearly. Such a fit bends its steps (`descent`). Its last part is
not that of small residuals: along the valley the curvature of the cost exceeds that of ``J'J``, whose steps go too far and are
refused in turn. A descent that ends so goes on by BFGS in the metric of ``J'J``.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize

from scan2flex_jax.fitting.descent import Model, Point, Quadratic, Rules, descend
from scan2flex_jax.fitting.evaluate import Evaluation, Evaluator

MOST_ITERATIONS = 60
_PATIENCE, _FAR = 10, 10.0  # iterations, and cost over the one to beat, after which a descent is given up
LONGEST = 2.0  # in a logarithm (a factor of 7) or, for other numbers, in units of 1 + |value|
COST_TOLERANCE, STEP_TOLERANCE = 1.0e-10, 1.0e-8
UNSEEN = 1.0e-10  # of the largest column of the Jacobian: a smaller one is rounding, and the number stays where it is
_CLOSER = 1.0e-6  # of the cost: what a start from the measured curves must gain
_GAIN = 1.0e-4  # of the cost: what a converged fit of another method may still promise to gain
PROMISED = 1.0e-3  # of the cost for one residual: what an undamped step may still promise at a minimum
GIVE_UP = 1.0e12  # damping at which no step helps
_RIDGE = 1.0e-9  # of correlations, so that numbers that nothing determines have a direction too
_MOST_BFGS = 120  # iterations
_FAILED = 1.0e12  # a cost that stands for an unsolved pose in methods that know no rejection


Progress = Callable[[str], None]


def silent(message: str) -> None:
    """The progress of a call that tells nobody."""


def prefixed(progress: Progress, prefix: str) -> Progress:
    """The progress of a part of a call: its costs may have another unit than those of the call itself."""
    return lambda message: progress(f"{prefix}: {message}")


@dataclass
class Minimum:
    """Where a method ended: shared and local numbers, the evaluation there, its cost, and why it stopped."""

    shared: np.ndarray
    local: np.ndarray
    evaluation: Evaluation
    cost: float
    iterations: int
    converged: bool


@dataclass
class Goal:
    """What is minimised: an evaluator, the scale of residuals of each pose (m), and bounds of the shared numbers.

    ``weak``: precision with which each shared number is held where it began, in shares of the cost (0: free). ``beat``: the
    cost that a minimum has to come under to be of use; a descent far above it is given up after ``patience`` iterations.
    """

    evaluator: Evaluator
    sigma: np.ndarray
    low: np.ndarray
    high: np.ndarray
    progress: Progress = silent
    weak: np.ndarray | float = 0.0
    beat: float = np.inf
    patience: int = _PATIENCE

    def cost(self, e: Evaluation, shared, local) -> float:
        """Weighted squares of residuals and priors."""
        if not e.solved:
            return np.inf
        prior = np.sum(self.evaluator.layout.prior.pull(shared) ** 2) + np.sum(local**2)
        return float(np.sum((e.residual / self.sigma[:, None, None]) ** 2) + prior)

    def normal_equations(self, e: Evaluation, shared, local):
        """``J'J`` and ``J'r`` of the cost in shared and then all local numbers."""
        return normal_equations(
            self.evaluator.layout,
            e.residual / self.sigma[:, None, None],
            e.jacobian / self.sigma[:, None, None, None],
            shared,
            local,
        )


    def without(self, own: np.ndarray) -> "Goal":
        """The same with the shared numbers ``own`` held at zero."""
        low, high = self.low.copy(), self.high.copy()
        low[own] = high[own] = 0.0
        return replace(self, low=low, high=high)


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
    """The nearest minimum from ``shared`` (and ``local``); ``start`` continues configurations already found, ``known`` is the
    evaluation there (from the measured curves) if it has been made."""
    evaluator = goal.evaluator
    local = np.zeros((evaluator.poses.count, evaluator.layout.local)) if local is None else local
    model = _FitModel(goal, shared, local.shape)
    e = evaluator(shared, local, start=start) if known is None else known
    model.residuals = max(int(np.count_nonzero(e.residual)), 1)
    rules = Rules(
        most=lambda cost: MOST_ITERATIONS if cost < _FAR * goal.beat else goal.patience,
        settled=lambda cost: COST_TOLERANCE * cost, step=STEP_TOLERANCE, promises=PROMISED, damping=1e-3, least=1e-12,
        give_up=GIVE_UP, stuck_converges=True, closer=None if start is None else lambda cost: _CLOSER * cost,
        bend=model.bends, progress=goal.progress,
    )  # fmt: skip
    found = descend(model, model.of(np.r_[shared, local.ravel()], e), rules)
    shared, local = model.split(found.point.x)
    end = Minimum(shared, local, found.point.found, found.point.cost, found.iterations, found.converged)
    return _carried_on(model, end) if model.bends and not end.converged and end.cost < _FAR * goal.beat else end


class _FitModel(Model):
    """The fit of a study: its shared numbers, then the local ones of all poses.

    Logarithms are held weakly where the descent ``began``; ``residuals`` is their number there.
    """

    def __init__(self, goal: Goal, began: np.ndarray, shape: tuple[int, ...]):
        """Nothing is evaluated yet; ``shape`` (poses, local) is that of the local numbers."""
        self.goal, self.began, self.shape, self.residuals = goal, began, shape, 1
        free = np.full(int(np.prod(shape)), np.inf)
        self.low, self.high = np.r_[goal.low, -free], np.r_[goal.high, free]
        walks = goal.evaluator.layout.walks
        self.bends = bool(np.any(goal.high[: len(walks)][walks] > goal.low[: len(walks)][walks]))

    def split(self, x):
        """Shared and local numbers."""
        return x[: len(self.began)], x[len(self.began) :].reshape(self.shape)

    def of(self, x, e: Evaluation) -> Point:
        """The evaluation at ``x`` that is known."""
        cost = self.goal.cost(e, *self.split(x))
        whole = self._residual(e) if self.bends and np.isfinite(cost) else (None, None)
        return Point(x, cost, e.configuration, e, *whole)

    def _residual(self, e: Evaluation):
        """Weighted residual (k,) of all poses and its Jacobian (k, n) by all numbers."""
        n, (poses, own) = len(self.began), self.shape
        sigma, points = self.goal.sigma[:, None, None], e.residual[0].size
        J = np.zeros((poses, points, n + poses * own))
        for i, part in enumerate((e.jacobian / sigma[..., None]).reshape(poses, points, -1)):
            J[i, :, :n], J[i, :, n + i * own : n + (i + 1) * own] = part[:, :n], part[:, n:]
        return (e.residual / sigma).ravel(), J.reshape(poses * points, -1)

    def at(self, x, start=None) -> Point:
        return self.of(x, self.goal.evaluator(*self.split(x), start=start))

    def about(self, point) -> "_Bowl":
        share = point.cost / self.residuals
        return _Bowl(self, point, share * self.goal.weak, share)

    def bounded(self, move, about):
        """Logarithms that no pose feels follow, and steps in shared numbers are bounded."""
        n, move = len(self.began), move.copy()
        if np.any(about.leading):
            move[:n][about.following] = np.mean(move[:n][about.leading])
        low, high, x = self.low[:n], self.high[:n], about.x[:n]
        reach = np.where(np.isfinite(low) & (np.abs(high - low) < 60), 1.0, 1.0 + np.abs(x))
        longest = np.max(np.abs(move[:n]) / reach, initial=0.0)
        return move * (min(1.0, LONGEST / longest) if longest > 0 else 1.0)


class _Bowl(Quadratic):
    """The cost of a fit to second order about an iterate, in the numbers that are felt and not held at a bound.

    A logarithm that no pose feels goes with those that are felt: a plane pose says nothing of torsion, but a rod that grows
    stiffer in bending alone would buckle out of the plane.
    """

    rank = 1e-14

    def __init__(self, model: _FitModel, point: Point, weak: np.ndarray | float = 0.0, share: float = 1.0):
        """With logarithms held by the precision ``weak``."""
        goal, began = model.goal, model.began
        JJ, Jr = goal.normal_equations(point.found, *model.split(point.x))
        n, x = len(began), point.x
        felt = np.diag(JJ)[:n] > UNSEEN**2 * np.max(np.diag(JJ))
        logs = np.broadcast_to(goal.weak, n) > 0
        self.began, self.weak = began, np.where(felt, weak, 0.0)
        self.leading, self.following = felt & logs, ~felt & logs
        JJ[np.arange(n), np.arange(n)] += self.weak
        Jr[:n] += self.weak * (x[:n] - began)
        scale = np.diag(JJ) + 1e-300
        held = ((x <= model.low) & (Jr > 0)) | ((x >= model.high) & (Jr < 0))
        super().__init__(x, JJ, Jr, scale, ~held & (scale > UNSEEN**2 * np.max(scale)), share)

    def change(self, before, trial):
        n, began = len(self.began), self.began
        held = np.sum(self.weak * ((trial.x[:n] - began) ** 2 - (before.x[:n] - began) ** 2))
        return trial.cost + held - before.cost

    def moved(self, before, trial):
        n = len(self.began)
        return float(np.max(np.abs(trial.x[:n] - before.x[:n]), initial=0.0))


def _carried_on(model: _FitModel, found: Minimum) -> Minimum:
    """The end of a descent carried on by BFGS, in numbers of which ``J'J`` is the unit matrix and within the bounds."""
    goal, x, begun = model.goal, np.r_[found.shared, found.local.ravel()], found.evaluation.configuration
    free = (x > model.low) & (x < model.high)
    JJ, _ = goal.normal_equations(found.evaluation, found.shared, found.local)
    scale = np.sqrt(np.diag(JJ)[free]) + 1e-150
    unit = JJ[np.ix_(free, free)] / np.outer(scale, scale) + _RIDGE * np.eye(len(scale))
    ways = np.linalg.inv(np.linalg.cholesky(unit)).T / scale[:, None]

    def at(y):
        trial = x.copy()
        trial[free] += ways @ y
        inside = np.all((trial >= model.low) & (trial <= model.high))
        return model.at(trial, begun) if inside else Point(trial, np.inf, None)

    def value(y):
        point = at(y)
        if not np.isfinite(point.cost):
            return _FAILED, np.zeros(len(y))
        goal.progress(f"BFGS: cost {point.cost:.6g}")
        return point.cost, 2.0 * ways.T @ goal.normal_equations(point.found, *model.split(point.x))[1][free]

    flat = np.sqrt(PROMISED * found.cost / model.residuals)  # of the gradient: it promises a quarter of its square
    end = optimize.minimize(value, np.zeros(len(scale)), jac=True, method="BFGS", options={"gtol": flat, "maxiter": _MOST_BFGS})
    point = at(end.x)
    if not point.cost <= found.cost:
        return found
    (shared, local), count = model.split(point.x), found.iterations + int(end.nit)
    return Minimum(shared, local, point.found, point.cost, count, bool(np.max(np.abs(end.jac)) <= flat))


def bfgs(goal: Goal, shared: np.ndarray) -> Minimum:
    """L-BFGS-B on the summed squared distance with its gradient by the implicit function theorem (local numbers at zero)."""
    return _scipy(goal, shared, "L-BFGS-B", derivative=True, options={"maxiter": 200, "ftol": 1e-15, "gtol": 1e-9})


def nelder_mead(goal: Goal, shared: np.ndarray) -> Minimum:
    """The paper's method (Section 5.2.2), its baseline here; no gradient, in logarithms of positive numbers."""
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
    cost = goal.cost(e, x, local)
    converged = bool(found.success) or (np.isfinite(cost) and _gain(goal, x, local, e) <= _GAIN * cost)
    return Minimum(x, local, e, cost, int(found.nit), bool(converged))


def _gain(goal, shared, local, e) -> float:
    """What an undamped step would gain."""
    model = _FitModel(goal, shared, local.shape)
    bowl = _Bowl(model, model.of(np.r_[shared, local.ravel()], e))
    return bowl.promised(bowl.solved(bowl.g, 0.0))
