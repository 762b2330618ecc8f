"""Search for mistakes of the input by refits, before missing physics: exchanged poses, turns, rolls, axes, gravity, scale.

If `study.visible` finds a doubt, or the residual of the fit exceeds a few thousandths of the length, the study is refitted with
each likely mistake corrected (`study.mistakes`). A corrected study has no additional parameter: a residual three times smaller
is no accident. A strong missing effect is sometimes imitated by a correction, though only in part: `explain` compares the two
by their scores where a correction leaves more than noise. Single readings of markers come first (`readings`); then, in turn:

1. mistakes of all poses and exchanged curves are solved at the stiffnesses that balance the corrected curves and at those of
   the fit; the nearest ones are refitted;
2. each pose is left out; if the others then fit, its own likely mistakes are solved once each at their stiffnesses, and the
   best one is refitted with all poses. If none corrects it, the pose is reported as the one that does not fit.

A fit that had to change several poses by full turns (`posterior.branches`) may have adapted to a wrong roll: a corrected study
is then accepted if it comes as close with the stated turns. A study that does not settle is searched too.
"""

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from scan2flex_jax.errors import NotSettledError, Scan2FlexError
from scan2flex_jax.fitting.distance import NORMALS
from scan2flex_jax.fitting.least_squares import Minimum, Progress, levenberg_marquardt
from scan2flex_jax.fitting.poses import poses_of
from scan2flex_jax.fitting.problem import Problem
from scan2flex_jax.inference.readings import misread
from scan2flex_jax.posterior import branches
from scan2flex_jax.posterior.settings import Settings
from scan2flex_jax.study import mistakes
from scan2flex_jax.study.mistakes import Mistake
from scan2flex_jax.study.model import Study
from scan2flex_jax.study.visible import carried, clamps_scaled, visible_mistakes

_TIMES_TURNED, _TURNED = 1.02, 2  # `Settings.corrected` if the fit changed the turns of so many poses
_AS_OTHERS = 1.5  # times the distance of the other poses without it: a corrected pose fits as they do
_ALONE_TURNED = 0.01  # `Settings.alone` of such a fit
_FEWEST = 3  # least number of poses that must fit without the one that does not
_FOLLOWED, _FEWEST_FOLLOWED = 24, 4  # refits: _FOLLOWED over the number of poses, at least _FEWEST_FOLLOWED, the nearest ones
_SCREENED = 2  # corrected poses that are solved before all others
_NEARER = 0.6  # times the distance before: a refit below it may be a full turn away from coming close
_HALVED = 0.5  # times the distance before: required of a mistake that is visible without a solve
_PATIENCE = 6  # iterations after which a refit that is far off is given up
_STIFFER = np.log(10.0)  # added to the logarithms of a start that does not settle


class Refit(NamedTuple):
    """A corrected study: RMS distance of its fitted poses (m), the problem, and its minimum or start."""

    mistake: Mistake
    off: float
    problem: Problem
    minimum: Minimum


def before_branches(
    problem: Problem, method: str, progress: Progress, settings: Settings
) -> tuple[Minimum | None, tuple[Mistake, ...]]:
    """The mistakes that are visible without a solve and confirmed by a refit, and the minimum of the study as it stands.

    That minimum is given up if it stays far from the curves. ``(None, ())`` without a confirmed mistake.
    """
    found = visible_mistakes(problem.study)
    if not found:
        return None, ()
    minimum = problem.minimise(method, progress, _cost(problem, settings.close * problem.length))
    likely = _Search(problem.study, problem, minimum, progress, settings).confirmed(found)
    return (minimum, likely) if likely else (None, ())


def hidden(
    study: Study, problem: Problem, minimum: Minimum, progress: Progress, settings: Settings
) -> tuple[Mistake, ...]:
    """The mistakes whose correction explains the curves of ``study``: the best one, and those that explain them alike.

    ``problem`` and ``minimum`` are its fit on the measured branches. Empty for a fit with a small residual.
    """
    search = _Search(study, problem, minimum, progress, settings)
    doubtful = search.doubtful()
    return misread(problem, minimum, doubtful, search.refitted, settings) or (search.hidden() if doubtful else ())


def instead_of(
    fault: NotSettledError, problem: Problem, progress: Progress, settings: Settings, known: NotSettledError | None = None
) -> NotSettledError:
    """The fault of a study that does not settle, with the mistake that is its likely cause, if one is found.

    One that only a refit reveals is not looked for where a cause is ``known``.
    """
    search = _Search(problem.study, problem, None, progress, settings)
    found = search.confirmed(visible_mistakes(problem.study)) or (() if known else search.hidden())
    if known and not found:
        return known
    return NotSettledError(fault.sentence, str(found[0]), fault.reasons) if found else fault


def _distance(problem, residual) -> float:
    """RMS distance (m) over all points of the fitted poses."""
    seen = problem.poses.seen
    return float(np.sqrt(np.sum(residual[seen] ** 2) / max(np.sum(seen), 1)))


def _cost(problem, off) -> float:
    """The cost of a fit whose points all have the distance ``off`` (m)."""
    return float(np.sum(np.sum(problem.poses.seen, axis=1) * (off / problem.first_scale()) ** 2))


class _Search:
    """The refits of one study; without a minimum the study did not settle, and any refit that comes close is better."""

    def __init__(self, study: Study, problem: Problem, minimum: Minimum | None, progress: Progress, settings: Settings):
        self.study, self.problem, self.minimum, self.progress, self.settings = study, problem, minimum, progress, settings
        self.before = np.inf if minimum is None else _distance(problem, minimum.evaluation.residual)
        turned = sum(a.turns != b.turns for a, b in zip(study.fit_poses, problem.study.fit_poses, strict=True))
        self.turned = turned >= _TURNED
        self.left: list[tuple[Refit, float]] = []
        self.close = min(self.before / (_TIMES_TURNED if self.turned else settings.corrected), settings.close * problem.length)

    def doubtful(self) -> bool:
        """Whether the residual exceeds a few thousandths of the length or the stated noise, or the fit changed turns."""
        if self.minimum is None:
            return True
        own = branches.distances(self.minimum.evaluation, self.problem.poses)
        stated = np.array([np.inf if p.noise is None else p.noise for p in self.study.fit_poses])
        limit = self.settings.doubtful * self.problem.length
        beyond = np.any(own > np.maximum(self.settings.beyond_noise * np.sqrt(NORMALS) * stated, 0.5 * limit))
        return bool(self.turned or self.before > limit or beyond)

    def confirmed(self, found: tuple[Mistake, ...]) -> tuple[Mistake, ...]:
        """Mistakes that are visible without a solve, if the study with all of them corrected fits better."""
        refit = self.refitted(found[-1]) if found else None
        limit = min(_HALVED * self.before, self.settings.close * self.problem.length if self.minimum is None else np.inf)
        return () if refit is None or refit.off > limit else tuple(self._with_figures(m, refit) for m in found)

    def hidden(self) -> tuple[Mistake, ...]:
        """The mistakes that only refits reveal; if there is none, the single pose that does not fit."""
        self.progress("looking for mistakes of the input")
        found = [*self.accepted(self.of_all_poses()), *self.of_one_pose()]
        best = min((refit.off for refit in found), default=0.0)
        good = [refit for refit in found if refit.off <= self.settings.alike * best] or self.alone()
        return tuple(self._with_figures(refit.mistake, refit) for refit in good)

    def _with_figures(self, mistake, refit) -> Mistake:
        return replace(mistake, before=self.before if np.isfinite(self.before) else None, after=refit.off)

    def of_all_poses(self) -> Iterator[Mistake]:
        """The hypotheses that concern several poses."""
        yield from clamps_scaled(self.study)
        if not carried(self.study):
            yield from mistakes.of_gravity(self.study)
        yield from mistakes.of_weight(self.study)
        yield from mistakes.of_rolls(self.study)
        yield from mistakes.of_frames(self.study)
        yield from mistakes.of_pairs(self.study)

    def accepted(self, hypotheses: Iterable[Mistake]) -> list[Refit]:
        """The corrected studies that come close, among the nearest at their starts."""
        begun, most = list[Refit](), max(_FEWEST_FOLLOWED, _FOLLOWED // len(self.study.fit_poses))
        for hypothesis in hypotheses:
            b = self.begun(hypothesis, begun[-1].off if len(begun) == most else np.inf)
            begun = sorted([*begun, *([] if b is None else [b])], key=lambda b: b.off)[:most]
        refits = [self._on_its_branches(self.finished(b)) for b in begun]
        return [refit for refit in refits if refit.off <= self.close]

    def _on_its_branches(self, refit):
        """A refit that comes nearer but not close, with a search of its turns."""
        if self.turned or not self.close < refit.off < _NEARER * self.before:
            return refit
        with suppress(Scan2FlexError):
            problem, minimum, _ = branches.on_its_branches(
                refit.problem, refit.minimum, "least-squares", self.progress, branches.NEARER, settings=self.settings
            )
            return Refit(refit.mistake, _distance(problem, minimum.evaluation.residual), problem, minimum)
        return refit

    def of_one_pose(self) -> Iterator[Refit]:
        """Corrected studies of single poses; for each pose without which the others fit, `left` keeps their refit and the
        distance (m) of the pose."""
        poses = self.study.fit_poses
        if len(poses) == 1:
            yield from self.accepted(mistakes.of_pose(self.study, poses[0]))
            return
        for pose in poses:
            rest = self.refitted(mistakes.without(self.study, pose))
            if rest is None or rest.off > self.close:
                continue
            off = self._once(rest, self.study, pose.name)
            self.left.append((rest, off))
            own = [(self._once(rest, m.study, pose.name), m) for m in mistakes.of_pose(self.study, pose)]
            nearest = min(own, key=lambda pair: pair[0], default=None)
            if nearest is not None and nearest[0] < _HALVED * off:
                yield from (refit for refit in self.accepted([nearest[1]]) if refit.off < _AS_OTHERS * rest.off)

    def alone(self) -> list[Refit]:
        """The refit without the one pose that does not fit, if enough others do."""
        if len(self.left) != 1 or len(self.study.fit_poses) <= _FEWEST:
            return []
        rest, off = self.left[0]
        least = (_ALONE_TURNED if self.turned else self.settings.alone) * self.problem.length
        return [rest] if off > max(least, self.settings.corrected * rest.off) else []

    def _once(self, rest, study, name) -> float:
        """Distance (m) of a pose solved at the values of the others."""
        poses = poses_of(study, [study.pose(name)], self.problem.length, self.problem.elements)
        found = rest.problem.evaluator_of(poses)(rest.minimum.shared)
        return float(branches.distances(found, poses)[0])

    def refitted(self, mistake: Mistake) -> Refit | None:
        """The corrected study fitted; None if none of its starts settles."""
        begun = self.begun(mistake)
        return None if begun is None else self.finished(begun)

    def begun(self, mistake: Mistake, nearest: float = np.inf) -> Refit | None:
        """The corrected study at the better of its own start and the values of the fit, or stiffer if neither settles; None if
        it is farther off than ``nearest`` (m) there."""
        try:
            tried = self.problem.with_study(mistake.study)
            own = tried.starts()[-1]
        except (Scan2FlexError, ValueError, np.linalg.LinAlgError):  # no start exists for these clamps and curve
            return None
        starts = [own] if self.minimum is None else [own, self.minimum.shared[: len(own)]]
        near = [x for x in starts if not self._farther(tried, x, nearest)]
        found = [m for m in (_at(tried, x) for x in near) if np.isfinite(m.cost)]
        if not found and len(near) == len(starts):
            stiffer = own + np.where(tried.logs()[: len(own)], _STIFFER, 0.0)
            found = [m for m in [_at(tried, stiffer)] if np.isfinite(m.cost)]
        best = min(found, key=lambda m: m.cost, default=None)
        return None if best is None else Refit(mistake, _distance(tried, best.evaluation.residual), tried, best)

    def _farther(self, tried: Problem, x, nearest: float) -> bool:
        """Whether the first poses that are corrected are so far off that all together are farther off than ``nearest`` (m)."""
        if np.isinf(nearest) or tried.poses.history is not None:
            return False
        pairs = zip(self.study.fit_poses, tried.study.fit_poses, strict=False)
        corrected = [i for i, (stated, own) in enumerate(pairs) if own is not stated] or range(tried.poses.count)
        poses = tried.poses.only(corrected[:_SCREENED])
        residual = tried.evaluator_of(poses, tried.evaluator.distance)(_shared(tried, x)).residual
        return bool(np.sum(residual[poses.seen] ** 2) > nearest**2 * np.sum(tried.poses.seen))

    def finished(self, begun: Refit) -> Refit:
        """The refit from ``begun``; one that stays far off is given up."""
        tried = begun.problem
        goal = replace(tried.goal(tried.first_scale()), beat=_cost(tried, self.close), patience=_PATIENCE)
        minimum = levenberg_marquardt(goal, begun.minimum.shared, known=begun.minimum.evaluation)
        if tried.layout.has_priors and _distance(tried, minimum.evaluation.residual) < self.before:
            minimum = levenberg_marquardt(tried.goal(branches.noises(tried)), minimum.shared, minimum.local)
        return Refit(begun.mistake, _distance(tried, minimum.evaluation.residual), tried, minimum)


def _shared(problem, x) -> np.ndarray:
    """Shared numbers of a start of the unknowns."""
    low, high = problem.layout.ranges
    return np.r_[np.clip(x, low, high), np.zeros(problem.layout.shared - problem.layout.unknowns)]


def _at(problem, x) -> Minimum:
    """A start of the unknowns, evaluated."""
    shared, local = _shared(problem, x), np.zeros((problem.poses.count, problem.layout.local))
    evaluation = problem.evaluator(shared)
    return Minimum(shared, local, evaluation, problem.goal(problem.first_scale()).cost(evaluation, shared, local), 0, False)
