"""Levenberg-Marquardt on the residuals of all poses with their implicit Jacobian, and the two methods beside it.

The cost is ``sum (r / sigma)^2 + |z|^2``: measured minus modelled shape, and the priors of what is known only nearly. Its
share for one residual stands for the square of the noise, which is not known yet: in units of it, logarithms are held weakly
where they began (a factor of 20 is one standard deviation), so that a number that the poses hardly feel does not drift to where
the rod is no cable and takes hundreds of steps to solve, while what they determine moves by a small part of its standard error;
and the fit has converged when a step promises less than a thousandth of it. Marquardt's scaling makes the steps independent of
units; steps in logarithms are bounded, the range of the user is kept by holding those numbers that lie at a bound and want to
leave it. Solves follow the branch from one iterate to the next; a fit that began from configurations already found starts from
the measured curves once more at the end, and goes on if that finds a closer branch.
Reference: More, "The Levenberg-Marquardt algorithm: implementation and theory" (1978).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import optimize

from scan2flex_jax.fitting.evaluate import Evaluation, Evaluator

MOST_ITERATIONS = 60
_PATIENCE, _FAR = 10, 10.0  # iterations, and cost over the one to beat, after which a descent is given up
LONGEST = 2.0  # in a logarithm (a factor of 7) or, for other numbers, in units of 1 + |value|
COST_TOLERANCE, STEP_TOLERANCE = 1.0e-10, 1.0e-8
UNSEEN = 1.0e-10  # of the largest column of the Jacobian: a smaller one is rounding, and the number stays where it is
_GAIN = 1.0e-4  # of the cost: what a converged fit of another method may still promise to gain
PROMISED = 1.0e-3  # of the cost for one residual: what an undamped step may still promise at a minimum
GIVE_UP = 1.0e12  # damping at which no step helps
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
    e = evaluator(shared, local, start=start) if known is None else known
    cost, damping, iteration, converged, checked = goal.cost(e, shared, local), 1e-3, 0, False, start is None
    began, residuals = shared, max(int(np.count_nonzero(e.residual)), 1)
    while np.isfinite(cost) and iteration < (MOST_ITERATIONS if cost < _FAR * goal.beat else goal.patience):
        share = cost / residuals
        bowl = _Bowl(goal, e, shared, local, share * goal.weak, began)
        if bowl.promised() <= PROMISED * share:
            small = True
        else:
            iteration += 1
            trial = bowl.step(damping)
            e2 = evaluator(*trial, start=e.configuration)
            cost2 = goal.cost(e2, *trial)
            goal.progress(f"iteration {iteration}: cost {min(cost, cost2):.6g}")
            held = np.sum(bowl.weak * ((trial[0] - began) ** 2 - (shared - began) ** 2))
            small = abs(cost2 + held - cost) <= COST_TOLERANCE * cost
            if cost2 + held < cost:
                small |= np.max(np.abs(trial[0] - shared), initial=0.0) < STEP_TOLERANCE
                (shared, local), e, cost, damping = trial, e2, cost2, max(0.1 * damping, 1e-12)
            else:
                damping *= 10.0
        if small or damping > GIVE_UP:
            converged = True
            if checked:
                break
            fresh = evaluator(shared, local)
            if goal.cost(fresh, shared, local) >= cost * (1 - 1e-6):
                break
            e, cost, damping, converged, checked = fresh, goal.cost(fresh, shared, local), 1e-3, False, True
    return Minimum(shared, local, e, cost, iteration, converged)


class _Bowl:
    """The cost to second order about an iterate, in the numbers that are felt and not held at a bound.

    A logarithm that no pose feels goes with those that are felt: a plane pose says nothing of torsion, but a rod that grows
    stiffer in bending alone would buckle out of the plane.
    """

    def __init__(self, goal, e, shared, local, weak=0.0, began=0.0):
        JJ, self.Jr = goal.normal_equations(e, shared, local)
        self.x, self.shape, n = np.r_[shared, local.ravel()], local.shape, len(shared)
        felt = np.diag(JJ)[:n] > UNSEEN**2 * np.max(np.diag(JJ))
        logs = np.broadcast_to(goal.weak, n) > 0
        self.weak, self.leading, self.following = np.where(felt, weak, 0.0), felt & logs, ~felt & logs
        JJ[np.arange(n), np.arange(n)] += self.weak
        self.Jr[:n] += self.weak * (shared - began)
        self.low = np.r_[goal.low, np.full(len(self.x) - n, -np.inf)]
        self.high = np.r_[goal.high, np.full(len(self.x) - n, np.inf)]
        self.JJ, self.scale = JJ, np.diag(JJ) + 1e-300
        held = ((self.x <= self.low) & (self.Jr > 0)) | ((self.x >= self.high) & (self.Jr < 0))
        self.free = ~held & (self.scale > UNSEEN**2 * np.max(self.scale))

    def move(self, damping):
        """The step, nowhere shortened."""
        root = np.sqrt(self.scale * (1.0 + damping))[self.free]
        A = (self.JJ + damping * np.diag(self.scale))[np.ix_(self.free, self.free)]
        out = np.zeros_like(self.x)
        out[self.free] = np.linalg.lstsq(A / np.outer(root, root), -self.Jr[self.free] / root, rcond=1e-14)[0] / root
        return out

    def promised(self) -> float:
        """By how much an undamped step would lower the cost, to second order."""
        return float(-self.Jr @ self.move(0.0))

    def step(self, damping):
        """Shared and local numbers after a damped step of bounded length."""
        move, n = self.move(damping), len(self.x) - int(np.prod(self.shape))
        if np.any(self.leading):
            move[:n][self.following] = np.mean(move[:n][self.leading])
        low, high, x = self.low[:n], self.high[:n], self.x[:n]
        reach = np.where(np.isfinite(low) & (np.abs(high - low) < 60), 1.0, 1.0 + np.abs(x))
        longest = np.max(np.abs(move[:n]) / reach, initial=0.0)
        move *= min(1.0, LONGEST / longest) if longest > 0 else 1.0
        x = np.clip(self.x + move, self.low, self.high)
        return x[:n], x[n:].reshape(self.shape)


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
    converged = bool(found.success) or (np.isfinite(cost) and _Bowl(goal, e, x, local).promised() <= _GAIN * cost)
    return Minimum(x, local, e, cost, int(found.nit), bool(converged))
