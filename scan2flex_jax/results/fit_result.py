"""`Fit`, the result of a fit: estimates, poses, noise and sentences, its printed summary, and the format's JSON object."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from scan2flex_jax.fitting.discrepancy import Discrepancy
from scan2flex_jax.fitting.least_squares import Minimum
from scan2flex_jax.fitting.noise import Noise
from scan2flex_jax.fitting.problem import Problem
from scan2flex_jax.fitting.readings import Reading, readings_of
from scan2flex_jax.posterior.belief import overlooked
from scan2flex_jax.posterior.estimate import Estimate
from scan2flex_jax.posterior.law import Law
from scan2flex_jax.posterior.loops import Loop
from scan2flex_jax.posterior.posterior import Fitted
from scan2flex_jax.posterior.quantities import declared, ratios, stable
from scan2flex_jax.posterior.settings import USUAL, Settings
from scan2flex_jax.results.along import StiffnessAlong
from scan2flex_jax.results.answer import (
    EXPLAIN,
    UNBELIEVED,
    Answer,
    answer_of,
    digits_of,
    in_mm,
    moved_in_words,
    noise_in_words,
    number,
)
from scan2flex_jax.results.influence import Influence, influence_of
from scan2flex_jax.statics.verdict import SENTENCES
from scan2flex_jax.study.check import unit_warnings
from scan2flex_jax.study.mistakes import Mistake
from scan2flex_jax.study.model import Study


@dataclass(frozen=True)
class PoseFit:
    """One pose: distances (m) between measured and modelled curve, NaN where it could not be solved; both curves and the
    residual along ``s`` for a picture; and ``ratio``: of a validate pose its distance over that which noise, discrepancy,
    tolerances and the errors of the estimates let expect. Distances are NaN too for a pose without points; ``readings`` are
    its angles and wrenches."""

    role: str
    rms: float
    worst: float
    stable: bool
    measured: np.ndarray = field(repr=False)
    modelled: np.ndarray = field(repr=False)
    s: np.ndarray = field(repr=False)
    residual: np.ndarray = field(repr=False)
    verdict: str = "stable equilibrium"
    ratio: float = 0.0
    readings: tuple[Reading, ...] = ()

    def to_json(self) -> dict:
        """As in the study format; a pose that could not be solved has no distances."""
        out = {"role": self.role, "stable": self.stable}
        out |= {"readings": [one.to_json() for one in self.readings]} if self.readings else {}
        return out | {k: float(v) for k, v in (("rms", self.rms), ("max", self.worst)) if np.isfinite(v)}


def pose_fits(h: Fitted) -> dict[str, PoseFit]:
    """The poses at the mode of a hypothesis, in the order of the study."""
    v, out = h.variant, dict[str, PoseFit]()
    expected = ratios(h)
    groups = [(v.study.fit_poses, v.program, h.shapes)]
    if v.held_out is not None:
        groups.append((v.study.validate_poses, v.held_out, h.predicted))
    for study_poses, program, shapes in groups:
        for i, (pose, shape, real) in enumerate(zip(study_poses, shapes, program.real, strict=True)):
            seen, solved = program.poses.seen[i], stable(shape)
            residual, others = (np.where(solved, shape.residual[which], np.nan) for which in (seen, real & ~seen))
            d = np.linalg.norm(residual, axis=1) if np.any(seen) else np.full(1, np.nan)
            out[pose.name] = PoseFit(
                pose.role, float(np.sqrt(np.mean(d**2))), float(np.max(d)), solved,
                measured=_places(program.poses, i, shape)[seen], modelled=np.asarray(shape.configuration.r),
                s=shape.s[seen], residual=residual, verdict=SENTENCES[int(shape.verdict.code)],
                ratio=expected.get(pose.name, 0.0),
                readings=readings_of(v.study, pose, v.problem.length, others),
            )  # fmt: skip
    return {p.name: out[p.name] for p in v.study.poses if p.name in out}


def _places(poses, i, shape):
    """The measured points (m, 3) of a pose in m; of changes the modelled places with their residual."""
    if not (poses.changes and poses.changes[i]):
        return np.asarray(poses.points[i])
    r = np.asarray(shape.configuration.r)
    at = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(r, axis=0), axis=1))]
    own = np.zeros((3, 3)) if poses.rows is None else np.asarray(poses.rows[i])
    return np.stack([np.interp(shape.s, at, x) for x in r.T], axis=1) + shape.residual @ own


def rms_over(poses: Iterable[PoseFit], figure: str = "rms") -> float:
    """Root mean square distance (m) over all points of some poses, by a ``figure`` of each (``"rms"``, ``"left_out"``); NaN
    without points or where one is not known."""
    values = [(getattr(p, figure), len(p.residual)) for p in poses if len(p.residual)]
    if not values or any(v is None for v, _ in values):
        return float("nan")
    return float(np.sqrt(np.average([v**2 for v, _ in values], weights=[n for _, n in values])))


@dataclass(frozen=True, kw_only=True)
class Fit:
    """Estimates with intervals, the poses with their residuals, and the validation on poses that were not fitted.

    ``correlation`` is that of the entries named by ``labels``; ``sentences`` state undetermined combinations, values at a
    bound, and last whether the validate poses are predicted (``judgement``; ``valid``, None without such poses).
    ``reservation``: why it is believed with care at most (`posterior.belief`), or empty. ``turned``: sentences on poses whose
    turns differ from the study's (`posterior.branches`); ``in_doubt``: on turns about as likely, and on values elsewhere or
    other shapes that fit about as well; ``open``: the unknowns that these leave not determined.
    ``noise`` is the sensor's, ``discrepancy`` the deviation that differs from pose to pose. ``misfits``: sentences on fitted
    poses whose residual is not noise. ``mistakes``: likely mistakes of the input, each of which explains the residual
    (`inference.mistakes`). ``cost`` is that of the mode of the ``posterior``, the ``minimum`` of the ``problem``: squares of
    residuals in units of noise and discrepancy, and priors. ``mesh``: sentences on the number of elements (`statics.mesh`).
    ``settings``: the thresholds of the validation. ``laws``: the declared laws of bending and torsion, with their bands.
    ``along``: EI along the cable, where a declared effect lets it vary. ``loops``: what is read off declared effects with
    memory (`posterior.loops`).
    """

    study: Study = field(repr=False)
    problem: Problem = field(repr=False)
    minimum: Minimum = field(repr=False)
    posterior: Fitted = field(repr=False)
    method: str
    distance: str
    estimates: dict[str, Estimate]
    labels: list[str]
    correlation: np.ndarray
    poses: dict[str, PoseFit]
    noise: Noise
    discrepancy: Discrepancy
    sentences: tuple[str, ...]
    valid: bool | None
    judgement: str
    converged: bool
    equilibria: int
    seconds: float
    cost: float
    turned: tuple[str, ...] = ()
    in_doubt: tuple[str, ...] = ()
    reservation: str = ""
    open: tuple[str, ...] = ()
    mesh: tuple[str, ...] = ()
    misfits: tuple[str, ...] = ()
    mistakes: tuple[Mistake, ...] = ()
    settings: Settings = USUAL
    laws: tuple[Law, ...] = ()
    along: StiffnessAlong | None = None
    loops: tuple[Loop, ...] = ()

    def rms(self, role: str = "fit") -> float:
        """Root mean square distance (m) over all points of the poses of a role; NaN without such poses."""
        return rms_over(p for p in self.poses.values() if p.role == role)

    @property
    def faults(self) -> tuple[str, ...]:
        """Why its values are unusable, and have no intervals: a mistake of the input, a pose that is not stable, no
        convergence, a pose far off its curve, validate poses that are not predicted. Empty without a fault."""
        unsolved = [name for name, p in self.poses.items() if not p.stable]
        said = [f"the input is likely mistaken: {self.mistakes[0]}"] if self.mistakes else []
        said += [f"{', '.join(unsolved)} could not be solved ({self.poses[unsolved[0]].verdict})"] if unsolved else []
        said += [] if self.converged else [not_converged(self.minimum)]
        said += [f"{misfit}{EXPLAIN}" for misfit in self.misfits[:1]]
        return (*said, *([f"{self.judgement}{EXPLAIN}"] if self.valid is False else []))

    @property
    def believable(self) -> bool:
        """Whether it has no fault."""
        return not self.faults

    @property
    def reasons_for_care(self) -> tuple[str, ...]:
        """Why its values are reliable with care at most."""
        careful = (*self.doubts, *(f"{reason}{EXPLAIN}" for reason in (self.reservation, self.overlooked) if reason))
        return (*careful, self.judgement) if self.valid is None else careful

    @property
    def doubts(self) -> tuple[str, ...]:
        """The sentences to read before any value, the most serious first."""
        if self.mistakes:
            first, *others = map(str, self.mistakes)
            return (f"likely mistake: {first}", _AS_IT_STANDS, *(f"or: {other}" for other in others))
        units = unit_warnings(self.study)
        several = _SEVERAL_TURNED.format(len(self.turned)) if len(self.turned) > 1 else _ONE_TURNED
        turned = (several, *self.turned) if self.turned else ()
        judged = (self.judgement,) if self.valid is False else ()
        open_ = () if self.converged else (not_converged(self.minimum),)
        return (*open_, *self.misfits[:1], *units, *turned, *self.in_doubt, *judged)

    @cached_property
    def influence(self) -> Influence | None:
        """Sensitivities of the estimates to poses and stated values (`results.influence`); None for a Hausdorff fit.

        The first access solves the poses twice more.
        """
        if self.distance == "hausdorff" or not np.isfinite(self.cost):
            return None
        return influence_of(self.posterior)

    @cached_property
    def overlooked(self) -> str:
        """The effect type that the model lacks by its score to first order (`posterior.belief`), in words; empty without one,
        and where something else is in doubt.

        The first access scores the catalogue by the functions of `explain`, which it compiles.
        """
        return "" if self.faults or self.doubts or self.reservation else overlooked(self.posterior)

    @property
    def answer(self) -> Answer:
        """The opening lines of the summary (`results.answer`)."""
        return answer_of(self)

    @property
    def calibrated(self) -> Study:
        """The study with the estimates as values and as guesses, ready to be saved or fitted again."""
        return declared(self.study, self.estimates)

    def to_json(self) -> dict:
        """The format's result object."""
        return {
            "format": "scan2flex-result/1",
            "method": self.method,
            "estimates": {name: e.to_json() for name, e in self.estimates.items()},
            "correlations": {
                "names": self.labels,
                "matrix": np.where(np.isfinite(self.correlation), self.correlation, 0.0).tolist(),
            },
            "poses": {name: p.to_json() for name, p in self.poses.items()},
            "noise": self.noise.to_json(),
            "discrepancy": self.discrepancy.to_json(),
            "converged": self.converged,
            "believable": self.believable,
            **({} if self.valid is None else {"valid": self.valid}),
            **({"laws": [law.to_json() for law in self.laws]} if self.laws else {}),
            **({} if self.along is None else {"stiffness_along": self.along.to_json()}),
            **({"loops": [loop.to_json() for loop in self.loops]} if self.loops else {}),
            "mistakes": [m.to_json() for m in self.mistakes],
            "messages": [*([self.overlooked] if self.overlooked else []), *self.sentences],
            "equilibria": self.equilibria,
            "seconds": self.seconds,
            "settings": self.settings.to_json(),
        }

    def summary(self) -> str:
        """The fit in plain text: what was mistaken in the input, the answer, then every estimate, every pose, and further
        sentences."""
        answer, first = self.answer, self.doubts if self.mistakes else self.turned
        answer = replace(answer, doubts=tuple(s for s in answer.doubts if s not in first))
        lines = [self.study.title, *(f"  {s}" for s in first), "", *answer.lines(), ""]
        lines += [f"  {name:<24} {in_words(e)}" for name, e in self.estimates.items()] + [""]
        lines += [] if self.along is None else [f"  {s}" for s in self.along.sentences()] + [""]
        lines += [*_correlation_lines(self), *self._pose_lines()]
        lines += ["", f"  residual as noise: {noise_in_words(self.noise, self.problem.length)}"]
        said = {*self.doubts, *map(str, self.mistakes), *answer.warnings}
        lines += [f"  {s}" for s in self.sentences if s not in said and s not in answer.belief]
        return "\n".join([*lines, f"  {self.method} fit to centre curves, {self.equilibria} equilibria, {self.seconds:.2f} s"])

    def _pose_lines(self):
        """A table of the poses, with the change of the stiffnesses when each is left out."""
        moved = {name: moved_in_words(self.influence, name) for name in self.poses}
        lines = [f"  pose                 role       rms mm    max mm{'   without it' if any(moved.values()) else ''}"]
        for name, p in self.poses.items():
            figures = f"{in_mm(p.rms):>9} {in_mm(p.worst):>9}" if np.isfinite(p.rms) else f"{'':>19}"
            figures = figures if p.stable else f"  {p.verdict}"
            lines.append(f"  {name:<20} {p.role:<9}{figures}   {moved[name]}".rstrip())
            lines += [f"    {one.sentence()}" for one in p.readings]
        return lines


NOT_CONVERGED = "the fit has not converged within its iterations: its values and intervals are not reliable"
STALLED = "the fit has stalled: no step lowers its cost as predicted; its values and intervals are not reliable"
_AS_IT_STANDS = "values and intervals below are those of the study as it stands, and are not reliable"
_ONE_TURNED = "one pose fits only with another number of full turns than the study states"
_SEVERAL_TURNED = (
    "{} poses fit only with other turns than the study states: look at the rolls of their clamps before believing the values"
)


def not_converged(minimum: Minimum) -> str:
    """The status of a minimum that has not converged."""
    return STALLED if minimum.stalled else NOT_CONVERGED


def in_words(e: Estimate) -> str:
    """A value with its interval and unit, marked if it is not determined or at a bound."""
    value = np.ravel(e.value)
    low, high = (None if x is None else np.ravel(x) for x in (e.low, e.high))
    parts = []
    for i, v in enumerate(value):
        digits, span = 5, f" {UNBELIEVED}" if e.identifiable else " (no error bar)"
        if low is not None and high is not None and np.isfinite(low[i]) and np.isfinite(high[i]):
            digits = digits_of(v, low[i], high[i], least=4)
            span = f" [{number(low[i], digits)}, {number(high[i], digits)}]"
        parts.append(f"{number(v, digits)}{span}")
    tail = "" if e.identifiable else "  NOT DETERMINED"
    return ", ".join(parts) + (f" {e.unit}" if e.unit != "-" else "") + tail + ("  AT A BOUND" if e.at_bound else "")


def _correlation_lines(fit):
    n = len(fit.labels)
    pairs = [(abs(fit.correlation[i, j]), i, j) for i in range(n) for j in range(i)]
    strong = [(c, i, j) for c, i, j in sorted(pairs, reverse=True) if np.isfinite(c) and c > 0.9]
    lines = [f"  {fit.labels[j]} and {fit.labels[i]} are correlated: {fit.correlation[i, j]:+.3f}" for _, i, j in strong[:6]]
    return [*lines, ""] if lines else []
