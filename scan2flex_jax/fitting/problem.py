"""The least-squares problem of one study: its parameters, model and poses as arrays, and its minima.

A `Fit` keeps its `Problem`, so that the search for missing physics and the planning of poses continue from the fit. It holds no
reference to the caller: a `Problem` can be pickled and sent to another process.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from scan2flex_jax.errors import NotSettledError, Scan2FlexError
from scan2flex_jax.fitting.evaluate import Evaluation, Evaluator
from scan2flex_jax.fitting.least_squares import (
    Goal,
    Minimum,
    Progress,
    bfgs,
    levenberg_marquardt,
    nelder_mead,
    silent,
)
from scan2flex_jax.fitting.noise import metre_noise
from scan2flex_jax.fitting.parameters import layout_of, start_vector, template
from scan2flex_jax.fitting.poses import Poses, poses_of
from scan2flex_jax.fitting.quadratic import rounding_of
from scan2flex_jax.fitting.start import (
    STIFFNESSES,
    length_start,
    own_start,
    places,
    several_effects,
    several_starts,
    shapes_scale,
)
from scan2flex_jax.rod.effect import AbstractEffect
from scan2flex_jax.statics.verdict import SENTENCES, SOLVED
from scan2flex_jax.study.model import Study, StudyPose

FIT_ELEMENTS = 40  # fourth order: 1e-6 of the length on the poses of the tests
CREDIBLE = 0.01  # of the length: RMS distance of a minimum above which another start is tried too
_AS_GOOD = 1.25  # RMS distance of a minimum over that of the best, up to which it is about as good
_SAME = 0.05  # of the logarithm of a number, or of its size: starts that differ by less are one
_ELSEWHERE = 0.1  # the same of a minimum elsewhere
WEAK = 3.0  # standard deviation of a logarithm about the start of a fit: a factor of 20
UNSCALED = (1.0, 0.1, 10.0, 100.0, 1000.0)  # factors on the start where no pose shows a shape, all tried
LADDER = (1.0, 0.1, 10.0, 0.01, 100.0)  # factors on the start, tried in turn until every pose can be solved


class Problem:
    """The least-squares problem of one study.

    ``layout`` maps the parameter vector to models, starting from ``template`` in poses without gravity or effects of their own;
    ``poses`` are the ``fit`` poses as arrays; ``length`` (m) is the scale of the residuals; ``evaluator`` returns residuals and
    their Jacobian, and counts the equilibria that it solved.
    ``slots``: placeholders for energy laws of effects that may be added later, at zero amplitude.
    """

    def __init__(
        self, study: Study, elements: int = FIT_ELEMENTS, distance: str = "normal", slots: tuple[AbstractEffect, ...] = ()
    ):
        """Arrays of the poses; nothing is solved yet."""
        self.study, self.elements, self.slots = study, elements, slots
        self.layout, self.template = layout_of(study), template(study)
        self.length = float(length_start(study))
        self.poses = poses_of(study, study.fit_poses, self.length, elements)
        self.evaluator = self.evaluator_of(self.poses, distance)

    @cached_property
    def held_out(self) -> Poses | None:
        """The ``validate`` poses as arrays; None without them."""
        study = self.study
        return poses_of(study, study.validate_poses, self.length, self.elements) if study.validate_poses else None

    def evaluator_of(self, poses: Poses, distance: str = "normal") -> Evaluator:
        """An evaluator of other poses, with its count of equilibria at zero."""
        return Evaluator(self.layout, poses, self.elements, distance, self.slots)

    def with_study(self, study: Study) -> "Problem":
        """The problem of another study with the same unknowns; the count of equilibria continues."""
        other = Problem(study, self.elements, self.evaluator.distance, self.slots)
        other.evaluator.equilibria = self.evaluator.equilibria
        return other

    def hold_out(self, study: Study) -> None:
        """Replace the study by one that differs only in its ``validate`` poses."""
        self.study = study
        self.__dict__.pop("held_out", None)

    def predicted(self, minimum: Minimum) -> Evaluation:
        """The evaluation of the ``validate`` poses at a minimum."""
        if self.held_out is None:
            raise Scan2FlexError("the study has no pose with role 'validate': there is nothing to predict")
        return self.evaluator_of(self.held_out, self.evaluator.distance)(minimum.shared)

    def first_scale(self) -> np.ndarray:
        """Standard deviation (m) that weighs each pose: the stated noises, else a thousandth of the length for all."""
        return np.array([metre_noise(self.study, pose, self.length) for pose in self.study.fit_poses])

    def goal(self, sigma: np.ndarray, progress: Progress = silent) -> Goal:
        """The objective, with residuals in units of ``sigma`` (m) per pose."""
        low, high = self.layout.ranges
        free = np.full(self.layout.shared - self.layout.unknowns, np.inf)
        low, high = np.r_[low, -free], np.r_[high, free]
        weak, rounding = np.where(self.logs(), WEAK**-2, 0.0), float(rounding_of(self.length, sigma))
        return Goal(self.evaluator, sigma, low, high, progress, weak, rounding)

    def starts(self) -> list[np.ndarray]:
        """Start vectors of the unknowns: the user's guess if given, and the package's own if it differs; one for each of
        `several_starts`."""
        starts: list[np.ndarray] = []
        for given in several_starts(self.study, self.poses, self.length):
            for x in self.both_starts(given=given):
                starts += [] if any(self._apart(x, y) <= _SAME for y in starts) else [x]
        if np.any(shapes_scale(self.poses)):
            return starts
        return [x + np.where(self.layout.logs, np.log(factor), 0.0) for factor in UNSCALED for x in starts]

    def elsewhere(self) -> list[np.ndarray]:
        """Further start vectors where parameters of several effects are unknown, whatever their guesses: at places along the
        cable."""
        if not several_effects(self.study):
            return []
        unknowns = tuple(replace(u, guess=None) if "." in u.name else u for u in self.study.unknowns)
        starts: list[np.ndarray] = []
        for given in places(self.study, self.length):
            x = self.both_starts(replace(self.study, unknowns=unknowns), given)[0]
            starts += [] if any(self._apart(x, y) <= _SAME for y in starts) else [x]
        return starts

    def both_starts(
        self, study: Study | None = None, given: dict[str, float] | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Start vectors of the unknowns: the user's guess if given, and the package's own; ``study`` has other guesses,
        ``given`` the start of other parameters by name."""
        study = self.study if study is None else study
        own = own_start(study, self.poses, self.length) | (given or {})
        return start_vector(study, self.layout, own), start_vector(_without_guesses(study), self.layout, own)

    def minimise(
        self, method: str, progress: Progress = silent, beat: float = np.inf, start: np.ndarray | None = None
    ) -> Minimum:
        """The minimum from the start that fits better, and from the others too if the first is in doubt, if parameters of
        several effects are unknown, or if readings are changes, which a limp cable may show as well as a stiff one: then with
        its rivals.

        With ``start``, values of the unknowns, only from there. The slower methods use the first start only. Nuisance
        parameters are held at zero. A descent that stays far above the cost ``beat`` is given up. Raises `NotSettledError` if
        a pose cannot be solved.
        """
        goal = replace(self.goal(self.first_scale(), progress), beat=beat)
        prior = np.zeros(self.layout.shared - self.layout.unknowns)
        starts = self.starts() if start is None else [start]
        starts += self.elsewhere() if start is None and method == "least-squares" else []
        if method != "least-squares":
            run = {"bfgs": bfgs, "nelder-mead": nelder_mead}[method]
            return self._finite(run(goal, np.r_[starts[0], prior]))
        local = np.zeros((self.poses.count, self.layout.local))
        begun = [(x, self.evaluator(x, local)) for x in (np.r_[x, prior] for x in starts)]
        begun.sort(key=lambda start: goal.cost(start[1], start[0], local))
        found, several = [], start is None and (several_effects(self.study) or bool(self.poses.reference))
        for x, evaluation in begun:
            found.append(self._descend(goal, x, evaluation))
            if self._beyond_doubt(found[-1], goal) and not several:
                break
        best = self._finite(min(found, key=lambda m: m.cost))
        return replace(best, rivals=tuple(self._rivals(best, found))) if several else best

    def _apart(self, x, y) -> float:
        """The largest difference of two vectors of the unknowns: of logarithms, or of others over their sizes."""
        logs, n = self.layout.logs, self.layout.unknowns
        size = np.where(logs, 1.0, np.maximum(np.abs(x[:n]), np.abs(y[:n])))
        return float(np.max(np.abs(x[:n] - y[:n]) / np.maximum(size, 1e-12), initial=0.0))

    def _rivals(self, best, found) -> Iterator[tuple[np.ndarray, float]]:
        """Minima elsewhere that are about as good as the best, each once."""
        reported = [best.shared]
        for m in sorted(found, key=lambda m: m.cost):
            near = np.isfinite(m.cost) and self.rms(m) <= _AS_GOOD * self.rms(best)
            if near and all(self._apart(m.shared, x) > _ELSEWHERE for x in reported):
                reported.append(m.shared)
                yield m.shared, self.rms(m)

    def _beyond_doubt(self, minimum, goal):
        """Whether a minimum needs no second start: converged, at no bound, and close to the measured shapes."""
        inside = np.all((minimum.shared > goal.low) & (minimum.shared < goal.high))
        return bool(minimum.converged and inside and self.rms(minimum) < CREDIBLE * self.length)

    def rms(self, minimum: Minimum) -> float:
        """Root mean square distance (m) of the fitted poses at a minimum."""
        return float(np.sqrt(np.sum(minimum.evaluation.residual**2) / np.asarray(self.poses.mask).sum()))

    def logs(self) -> np.ndarray:
        """Mask of the shared numbers that are logarithms."""
        return np.r_[self.layout.logs, np.zeros(self.layout.shared - self.layout.unknowns, bool)]

    def _descend(self, goal, x, evaluation):
        """Levenberg-Marquardt from ``x``, or from a stiffer or softer start if a pose cannot be solved there."""
        logs = self.logs()
        for factor in LADDER:
            start = np.clip(x + np.where(logs, np.log(factor), 0.0), goal.low, goal.high)
            minimum = levenberg_marquardt(goal, start, known=evaluation if factor == 1.0 else None)
            if np.isfinite(minimum.cost):
                return minimum
        return minimum

    def seen_by_normals(self, minimum: Minimum) -> Minimum:
        """The minimum of another distance with residuals along the normals, for the statistics and the poses."""
        old = self.evaluator
        self.evaluator = self.evaluator_of(self.poses)
        self.evaluator.equilibria = old.equilibria
        start = minimum.evaluation.configuration
        return replace(minimum, evaluation=self.evaluator(minimum.shared, minimum.local, start=start))

    def _finite(self, minimum):
        if np.isfinite(minimum.cost):
            return minimum
        raise NotSettledError(
            "no values in the range let every pose settle",
            "check clamps, length and turns of these poses",
            unsettled(self.study.fit_poses, minimum.evaluation),
        )


def unsettled(study_poses: Sequence[StudyPose], evaluation: Evaluation) -> dict[str, str]:
    """Reasons, by pose name, why poses are not in a stable equilibrium."""
    codes = zip(study_poses, np.asarray(evaluation.verdict.code), strict=True)
    return {pose.name: SENTENCES[int(code)] for pose, code in codes if code != SOLVED}


def _without_guesses(study):
    cable = {k: v for k, v in study.cable.items() if k not in STIFFNESSES or k not in study.unknown_names}
    unknowns = tuple(replace(u, guess=None) if u.name in STIFFNESSES else u for u in study.unknowns)
    return replace(study, cable=cable, unknowns=unknowns)
