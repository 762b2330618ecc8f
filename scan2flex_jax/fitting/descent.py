"""Levenberg-Marquardt with bounds and priors: one descent, for the fit of a study and for the refits of `explain`.

A *model* evaluates a vector ``x`` of numbers and gives the cost to second order about it, with whatever priors it has. The
descent damps the step in the scale of the numbers themselves (Marquardt), so that it is independent of units; numbers at a
bound that want to leave it are held. Solves follow the branch from one iterate to the next; a descent that has settled may
start once more from the measured curves, and goes on if these lead to a closer branch.

A step that went uphill shows how the residual curves along it, ``c = r(end) - r - J step``. The second-order correction
``-(J'J + ...)^-1 J' c`` follows the valley in which it left the floor: geodesic acceleration, with the refused step in place of
a finite difference.
References: More, "The Levenberg-Marquardt algorithm: implementation and theory" (1978); Transtrum and Sethna, "Improvements to
the Levenberg-Marquardt algorithm for nonlinear least-squares minimization" (2012).
"""

import abc
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

_TRUSTED = 4.0  # times what a linear step promises: what steps to come may bring
_PATIENCE = 3  # steps in a row that promise too little


@dataclass(frozen=True)
class Point:
    """An evaluation at ``x`` (n,): its cost, infinite where a pose is not solved, its configurations, and what else was found.

    ``residual`` (k,) and ``jacobian`` (k, n) are needed by a descent that bends its steps.
    """

    x: np.ndarray
    cost: float
    configuration: Any
    found: Any = None
    residual: np.ndarray | None = None
    jacobian: np.ndarray | None = None


@dataclass(frozen=True, kw_only=True)
class Rules:
    """When a descent stops, and how it goes on after a refused step.

    A descent makes ``most`` iterations (a function of the cost). It has converged where a step changes the cost by less than
    ``settled`` (a function of the cost) or the numbers by less than ``step``, and where an undamped step ``promises`` less
    than this times the scale of the noise (None: untested). ``damping`` is that of the first step and stays above ``least``,
    after a refused step above ``refused``; at ``give_up`` the descent ends, converged if ``stuck_converges``. ``closer``: by
    how much a start from the measured curves must lower a settled cost to be followed (None: untested). ``bend``: steps that
    go uphill are bent, and the first that is refused is tried from the measured curves too, where ``closer`` tests these.
    ``hopeless``: a cost that the descent must come under; one that does not promise it is given up.
    """

    most: Callable[[float], int]
    settled: Callable[[float], float]
    step: float = 0.0
    promises: float | None = None
    damping: float
    least: float
    refused: float = 0.0
    give_up: float
    stuck_converges: bool
    closer: Callable[[float], float] | None
    bend: bool = False
    hopeless: float = np.inf
    progress: Callable[[str], None] = lambda message: None


class Quadratic:
    """The cost to second order about ``x``: half its Hessian ``A`` (n, n) and gradient ``g`` (n,).

    ``scale`` (n,) damps; ``free`` (n,) are the numbers that may move. ``noise``: the scale of promises, a cost.
    """

    rank = 1e-12  # of the largest singular value: a direction that nothing determines

    def __init__(self, x, A, g, scale, free, noise: float = 1.0):
        """Nothing is solved yet."""
        self.x, self.A, self.g, self.free, self.noise = x, A, g, free, noise
        self.root = np.sqrt(scale[free]) + 1e-150
        self.unit = A[np.ix_(free, free)] / np.outer(self.root, self.root)

    def solved(self, gradient: np.ndarray, damping: float) -> np.ndarray:
        """The damped step against a gradient (n,), nowhere shortened."""
        out = np.zeros_like(self.x)
        H = self.unit + damping * np.eye(len(self.root))
        out[self.free] = np.linalg.lstsq(H, -gradient[self.free] / self.root, rcond=self.rank)[0] / self.root
        return out

    def promised(self, move: np.ndarray) -> float:
        """Drop of the cost along an undamped move, were the residual linear and nothing bounded."""
        return float(-self.g @ move)

    def change(self, before: Point, trial: Point) -> float:
        """Of the cost, with priors that are scaled anew at every iterate."""
        return trial.cost - before.cost

    def moved(self, before: Point, trial: Point) -> float:
        """The largest move of a number."""
        return float(np.max(np.abs(trial.x - before.x), initial=0.0))


class Model(abc.ABC):
    """What a descent minimises, over numbers within the bounds ``low`` and ``high`` (n,)."""

    low: np.ndarray
    high: np.ndarray

    @abc.abstractmethod
    def at(self, x: np.ndarray, start: Any = None) -> Point:
        """The evaluation at ``x``, solved from the configurations ``start`` (default: the measured curves)."""

    @abc.abstractmethod
    def about(self, point: Point) -> Quadratic:
        """The cost to second order about an evaluation of finite cost."""

    @abc.abstractmethod
    def bounded(self, move: np.ndarray, about: Quadratic) -> np.ndarray:
        """A step of a length that the model lets itself be moved by at once."""

    def end(self, move: np.ndarray, about: Quadratic) -> np.ndarray:
        """Where a bounded move ends within the bounds."""
        return np.clip(about.x + self.bounded(move, about), self.low, self.high)


@dataclass(frozen=True)
class Descent:
    """Where a descent ended, in how many iterations, and whether it converged."""

    point: Point
    iterations: int
    converged: bool


def descend(model: Model, point: Point, rules: Rules, damping: float | None = None) -> Descent:
    """The nearest minimum from an evaluation; stays there where its cost is infinite.

    ``damping`` is that of the first step, if it is not that of the rules.
    """
    damping, iteration, converged, lost = rules.damping if damping is None else damping, 0, False, 0
    closer = rules.closer
    afar = rules.bend and closer is not None
    while np.isfinite(point.cost) and iteration < rules.most(point.cost) and damping < rules.give_up:
        q = model.about(point)
        converged = rules.promises is not None and q.promised(q.solved(q.g, 0.0)) <= rules.promises * q.noise
        if not converged:
            iteration += 1
            move = q.solved(q.g, damping)
            lost = lost + 1 if point.cost - _TRUSTED * q.promised(move) > rules.hopeless else 0
            if lost >= _PATIENCE:
                break
            trial, afar = _trial(model, q, point, move, damping, rules, afar)
            rules.progress(f"iteration {iteration}: cost {min(point.cost, trial.cost):.6g}")
            change = q.change(point, trial)
            converged = bool(abs(change) <= rules.settled(point.cost))
            if change < 0:
                converged |= bool(q.moved(point, trial) < rules.step)
                point, damping = trial, max(0.1 * damping, rules.least)
            else:
                damping = max(10.0 * damping, rules.refused)
        converged |= rules.stuck_converges and damping >= rules.give_up
        if converged and closer is not None:
            fresh, least = model.at(point.x), point.cost - closer(point.cost)
            closer = None
            if fresh.cost < least:
                point, damping, converged = fresh, rules.damping, False
        if converged:
            break
    return Descent(point, iteration, converged)


def _trial(model, q, point, move, damping, rules, afar):
    """The evaluation at the end of a step; where that is uphill, of the bent step or from the measured curves if lower.
    Whether these are still to be tried comes with it."""
    end = model.end(move, q)
    trial = model.at(end, point.configuration)
    if not rules.bend:
        return trial, afar
    if np.isfinite(trial.cost) and trial.cost > point.cost + rules.settled(point.cost):
        curved = trial.residual - point.residual - point.jacobian @ (end - point.x)
        bent = model.bounded(move, q) + q.solved(point.jacobian.T @ curved, damping)
        trial = min(trial, model.at(model.end(bent, q), point.configuration), key=lambda p: p.cost)
    if not trial.cost < point.cost and afar:  # a pose may have snapped: the measured curves lead back
        return min(trial, model.at(end), key=lambda p: p.cost), False
    return trial, afar
