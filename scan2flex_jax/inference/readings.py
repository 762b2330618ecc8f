"""Misread markers: a reading without which all others agree, or two rows that are exchanged.

To first order at the fit each marker is left out in turn, and those that are farthest off are exchanged with others; the
nearest studies are refitted. One is a likely mistake if its reading is three times as far off as any other, since a smooth
misfit has none such, and an outlier among so many readings by Student's t of its residual (Cook and Weisberg, "Residuals and
influence in regression" (1982), section 2.2.2).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy import special

from scan2flex_jax.fitting.evaluate import Evaluation, one
from scan2flex_jax.fitting.least_squares import Minimum
from scan2flex_jax.fitting.noise import FINEST, stated_noise
from scan2flex_jax.fitting.poses import Poses, poses_of
from scan2flex_jax.fitting.problem import WEAK, Problem
from scan2flex_jax.fitting.states import Shape
from scan2flex_jax.posterior.belief import moved
from scan2flex_jax.posterior.settings import Settings
from scan2flex_jax.study import mistakes
from scan2flex_jax.study.mistakes import Mistake
from scan2flex_jax.study.parts import Markers

_FOLLOWED = 3  # refits of exchanged, and of omitted markers
_FARTHEST = 2  # markers that are exchanged with others
_LIKELY = 0.1  # probability of so large an outlier among right readings, to first order, from which it is refitted


class _Place(NamedTuple):
    """A marker: the number of its pose among the fitted ones, its own, its row among the points of the pose, and the places of
    its coordinates among all readings."""

    pose: int
    marker: int
    row: int
    own: np.ndarray


@dataclass(frozen=True)
class _Outlier:
    """Sum of ``squares`` (m^2) of the other readings without an outlier, and its ``gain``; the ``size`` (m) of the reading's
    residual, the ``largest`` (m) other one, and degrees of ``freedom``."""

    squares: float
    gain: float
    size: float
    largest: float
    freedom: int

    def probability(self, stated: float | None, settings: Settings, length: float, tried: int) -> float:
        """That one of ``tried`` right readings is as far off; ``stated`` noise (m) and ``length`` (m) of the cable."""
        known = 0.5 / settings.stated**2 if stated else 0.0  # degrees of freedom of a stated noise
        freedom = self.freedom + known
        if freedom <= 0:
            return 1.0
        variance = max((self.squares + known * (stated or 0.0) ** 2) / freedom, (FINEST * length) ** 2)
        return float(2.0 * tried * special.stdtr(freedom, -np.sqrt(max(self.gain, 0.0) / variance)))


def misread(
    problem: Problem, minimum: Minimum | None, doubtful: bool, refitted: Callable[[Mistake], Any], settings: Settings
) -> tuple[Mistake, ...]:
    """The likely mistakes among the markers of a study at its minimum.

    ``doubtful``: whether the fit is far from its points. ``refitted``: of a corrected study its refit with the distance ``off``
    (m), ``problem`` and ``minimum``; None if it does not settle.
    """
    if minimum is None or not minimum.evaluation.solved or all(pose.markers is None for pose in problem.study.fit_poses):
        return ()
    screen = _Screen(problem, minimum, settings)
    doubtful, found = doubtful or screen.off > settings.moved * screen.moved, list[Mistake]()
    for hypotheses in (screen.exchanges(), screen.omissions()):
        tried = len(hypotheses)
        likely = [(o, m) for o, m in hypotheses if doubtful or screen.probability(o, tried) < _LIKELY]
        for outlier, mistake in sorted(likely, key=lambda pair: pair[0].squares)[:_FOLLOWED]:
            found += _confirmed(screen, mistake, refitted(mistake), outlier, tried)
        if found:
            break
    best = min((m.after for m in found if m.after is not None), default=0.0)
    return tuple(m for m in found if m.after is not None and m.after <= settings.alike * best)


class _Screen:
    """The readings of the fitted poses at a minimum: residuals (n,) in m, and their Jacobian (n, k) by the unknowns; `off` is
    their RMS distance (m), and `moved` that by a factor of e in the unknowns."""

    def __init__(self, problem: Problem, minimum: Minimum, settings: Settings):
        """Nothing is solved."""
        self.settings, self.problem, self.study, self.evaluation = settings, problem, problem.study, minimum.evaluation
        self.unknowns, self.shared = problem.layout.unknowns, minimum.shared
        shapes = [Shape(*one(self.evaluation, i)) for i in range(problem.poses.count)]
        real = [np.asarray(mask) > 0 for mask in problem.poses.mask]
        residual, jacobian, self.places, at = [], [], list[_Place](), 0
        for i, (shape, keep) in enumerate(zip(shapes, real, strict=True)):
            points, count = int(np.sum(problem.poses.seen[i])), problem.poses.coordinates(i)
            markers = self.markers(i)
            marked = 0 if markers is None else len(markers.points)
            for row in range(int(np.sum(keep))):
                residual.append(shape.residual[row, : count[row]])
                jacobian.append(np.asarray(shape.columns)[row, : count[row], : self.unknowns])
                if points - marked <= row < points and marked <= points:  # not thinned
                    self.places.append(_Place(i, row - points + marked, row, at + np.arange(count[row])))
                at += count[row]
        self.residual, self.jacobian = np.concatenate(residual), np.concatenate(jacobian)
        self.squares, self.moved = float(np.sum(self.residual**2)), moved(problem, shapes, real)
        self.off = float(np.sqrt(self.squares / sum(map(np.sum, real))))
        weak = np.where(problem.logs()[: self.unknowns], (np.median(problem.first_scale()) / WEAK) ** 2, 0.0)
        self.A = self.jacobian.T @ self.jacobian + np.diag(weak)

    def markers(self, i: int) -> Markers | None:
        """Those of a fitted pose."""
        return self.study.fit_poses[i].markers

    def probability(self, outlier: _Outlier, tried: int) -> float:
        """That right readings have such an outlier."""
        return outlier.probability(stated_noise(self.study, of_all=False), self.settings, self.problem.length, tried)

    def outlier(self, others: np.ndarray, size: float) -> _Outlier:
        """Of the residuals (m) of the other readings, and of the ``size`` (m) of that of the marker."""
        squares, largest = float(np.sum(others**2)), float(np.max(np.abs(others), initial=0.0))
        return _Outlier(squares, self.squares - squares, size, largest, len(others) - self.unknowns)

    def omissions(self) -> list[tuple[_Outlier, Mistake]]:
        """Each marker left out."""
        out = []
        for place in self.places:
            J, r = self.jacobian[place.own], self.residual[place.own]
            moved = self.residual + self.jacobian @ np.linalg.lstsq(self.A - J.T @ J, J.T @ r, rcond=1e-12)[0]
            mistake = mistakes.without_marker(self.study, self.study.fit_poses[place.pose], place.marker)
            if mistake is not None:
                size = float(np.max(np.abs(moved[place.own])))
                out.append((self.outlier(np.delete(moved, place.own), size), mistake))
        return out

    def exchanges(self) -> list[tuple[_Outlier, Mistake]]:
        """Each of the farthest markers exchanged with the others of its pose, or with the only one of another."""
        size = [float(np.max(np.abs(self.residual[place.own]))) for place in self.places]
        farthest = [self.places[k] for k in np.argsort(size)[::-1][:_FARTHEST]]
        out, most = [], float(np.max(np.abs(self.residual)))
        for k, a in enumerate(farthest):
            for b in self.places:
                if any(b is other for other in farthest[: k + 1]) or not self._alike(a, b):
                    continue
                changed, step = self.residual.copy(), self._point(b) - self._point(a)
                for place, sign in ((a, 1.0), (b, -1.0)):
                    axes = _axes(self.problem.poses, self.evaluation, place.pose, place.row)
                    changed[place.own] += sign * (axes @ step)[: len(place.own)]
                moved = changed - self.jacobian @ np.linalg.lstsq(self.A, self.jacobian.T @ changed, rcond=1e-12)[0]
                if (mistake := self._exchanged(a, b)) is not None:
                    out.append((self.outlier(moved, most), mistake))
        return out

    def _alike(self, a: _Place, b: _Place) -> bool:
        """Whether two markers may be exchanged: those of one pose, or the only ones of two."""
        p, q = self.markers(a.pose), self.markers(b.pose)
        if p is None or q is None or a.pose == b.pose:
            return a.pose == b.pose
        return len(p.points) == len(q.points) == 1 and p.measured == q.measured and np.allclose(p.arc_length, q.arc_length)

    def _exchanged(self, a: _Place, b: _Place) -> Mistake | None:
        first, second = sorted((a, b), key=lambda place: (place.pose, place.marker))
        poses = self.study.fit_poses
        if first.pose == second.pose:
            return mistakes.exchanged_markers(self.study, poses[first.pose], first.marker, second.marker)
        return mistakes.exchanged_tables(self.study, poses[first.pose], poses[second.pose])

    def _point(self, place: _Place) -> np.ndarray:
        markers = self.markers(place.pose)
        return np.zeros(3) if markers is None else np.nan_to_num(markers.points[place.marker])


def _axes(p: Poses, evaluation: Evaluation, i: int, row: int) -> np.ndarray:
    """The axes (3, 3) of the residual of a marker."""
    own = np.zeros((3, 3)) if p.rows is None else np.asarray(p.rows[i])
    return own if np.any(own) else np.asarray(evaluation.axes)[i, row]


def _confirmed(screen: _Screen, mistake: Mistake, refit: Any, first: _Outlier, tried: int) -> Iterator[Mistake]:
    """The mistake with its figures, if its refit confirms it."""
    if refit is None:
        return
    rest, size = refit.minimum.evaluation.residual[np.asarray(refit.problem.poses.mask) > 0], first.size
    if mistake.place is not None:
        mistake, size = _expected(screen, mistake, refit)
    squares, largest = float(np.sum(rest**2)), float(np.max(np.abs(rest), initial=0.0))
    outlier = _Outlier(squares, screen.squares - squares, size, largest, first.freedom)
    s = screen.settings
    level = s.gross if size > s.moved * screen.moved else s.outlier
    if size >= s.corrected * largest and screen.probability(outlier, tried) < level:
        yield replace(mistake, before=screen.off, after=refit.off)


def _expected(screen: _Screen, mistake: Mistake, refit: Any) -> tuple[Mistake, float]:
    """The mistake with what the other readings let expect of the one left out, and the size (m) of its residual."""
    name, k = mistake.place or ("", 0)
    pose, problem = screen.study.pose(name), screen.problem
    poses = poses_of(screen.study, [pose], problem.length, problem.elements)
    found = refit.problem.evaluator_of(poses)(refit.minimum.shared)
    row = int(np.sum(poses.seen[0])) - (0 if pose.markers is None else len(pose.markers.points)) + k
    off = _axes(poses, found, 0, row).T @ found.residual[0, row]
    return mistakes.of_reading(mistake, pose, k, off), float(np.max(np.abs(off)))
