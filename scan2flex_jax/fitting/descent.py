"""Levenberg-Marquardt with bounds and priors, its damping raised and lowered: one descent for fits and refits of `explain`.

A *model* evaluates a parameter vector ``x`` and gives the cost to second order about it (`quadratic`), with its priors. Solves
follow the branch from one iterate to the next; a descent that has settled may start once more from the measured curves, and
continues if these lead to a closer branch.

A step that went uphill shows how the residual curves along it, ``c = r(end) - r - J step``. The second-order correction
``-(J'J + ...)^-1 J' c`` follows the valley whose floor it left: geodesic acceleration, with the refused step in place of a
finite difference.
Reference: Transtrum and Sethna, "Improvements to the Levenberg-Marquardt algorithm for nonlinear least-squares minimization"
(2012).
"""

import abc
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from scan2flex_jax.fitting.quadratic import GROWTH, Quadratic

_TRUSTED = 4.0  # decrease of the cost by all further steps, at most, over that predicted for a linear step
_PATIENCE = 3  # steps in a row that predict too little


@dataclass(frozen=True)
class Point:
    """An evaluation ``found`` at ``x`` (n,): its cost, infinite where a pose is not solved, and its configurations.

    ``residual`` (k,) and ``jacobian`` (k, n): for a descent that bends its steps.
    """

    x: np.ndarray
    cost: float
    configuration: Any
    found: Any = None
    residual: np.ndarray | None = None
    jacobian: np.ndarray | None = None


@dataclass(frozen=True, kw_only=True)
class Rules:
    """When a descent stops, and how it continues after a refused step.

    A descent makes ``most`` iterations (a function of the cost). It stops where a step changes the cost by less than
    ``settled`` (a function of the cost) or the parameters by less than ``step``, where the quadratic is stationary, and where
    the damping reaches ``give_up``. With ``judged`` it has converged by the rule of `quadratic`; without, by having stopped
    before it was given up. ``damping`` is that of the first step and stays above ``least``, after a refused step above
    ``refused``. ``closer``: decrease of a settled cost from which on a start from the measured curves is followed (None:
    untested). ``bend``: steps that go uphill are bent, and the first that is refused is tried from the measured curves too,
    where ``closer`` tests these. ``hopeless``: a cost that the descent must reach; one that does not predict it is given up.
    """

    most: Callable[[float], int]
    settled: Callable[[float], float]
    step: float = 0.0
    judged: bool = False
    damping: float
    least: float
    refused: float = 0.0
    give_up: float
    closer: Callable[[float], float] | None
    bend: bool = False
    hopeless: float = np.inf
    progress: Callable[[str], None] = lambda message: None


class Model(abc.ABC):
    """The cost to minimise, over parameters within the bounds ``low`` and ``high`` (n,)."""

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
        """The move (n,), shortened to the largest step that the model allows."""

    def end(self, move: np.ndarray, about: Quadratic) -> np.ndarray:
        """Where a bounded move ends within the bounds."""
        return np.clip(about.x + self.bounded(move, about), self.low, self.high)


@dataclass(frozen=True)
class Descent:
    """The end of a descent, its iterations, and its status: ``converged``, or ``stalled``, where no step lowers the cost though
    the quadratic predicts it. Neither: the descent ran out of iterations, was given up, or has an infinite cost."""

    point: Point
    iterations: int
    converged: bool
    stalled: bool = False


def descend(model: Model, point: Point, rules: Rules, damping: float | None = None) -> Descent:
    """The nearest minimum from an evaluation; stays there where its cost is infinite.

    ``damping`` is that of the first step, if it is not that of the rules.
    """
    damping, growth, iteration, stopped, lost = rules.damping if damping is None else damping, GROWTH, 0, False, 0
    closer = rules.closer
    afar = rules.bend and closer is not None
    while np.isfinite(point.cost) and iteration < rules.most(point.cost) and damping < rules.give_up:
        q = model.about(point)
        stopped = bool(q.stationary())
        if not stopped:
            iteration += 1
            move = q.solved(q.g, damping)
            lost = lost + 1 if point.cost - _TRUSTED * q.predicted(move) > rules.hopeless else 0
            if lost >= _PATIENCE:
                break
            trial, afar = _trial(model, q, point, move, damping, rules, afar)
            rules.progress(f"iteration {iteration}: cost {min(point.cost, trial.cost):.6g}")
            change = q.change(point.cost, trial.cost, trial.x)
            stopped = bool(abs(change) <= rules.settled(point.cost) or (change < 0 and q.moved(trial.x) < rules.step))
            damping, growth = map(float, q.damped(damping, growth, change, trial.x))
            damping = max(damping, rules.least if change < 0 else rules.refused)
            point = trial if change < 0 else point
        stopped |= rules.judged and damping >= rules.give_up
        if stopped and closer is not None:
            fresh, least = model.at(point.x), point.cost - closer(point.cost)
            closer = None
            if fresh.cost < least:
                point, damping, stopped = fresh, rules.damping, False
        if stopped:
            break
    if not (rules.judged and np.isfinite(point.cost)):
        return Descent(point, iteration, stopped or bool(np.isfinite(point.cost) and model.about(point).stationary()))
    converged = bool(model.about(point).converged())
    return Descent(point, iteration, converged, stopped and not converged)


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
