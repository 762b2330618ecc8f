"""`expect`: what poses will tell, before anyone measures them.

The poses are solved at the guesses of the study and measured there in simulation. The posterior of that study at the guesses
gives the intervals to expect, and its first-order screen the smallest effects that would be found. Nothing is fitted.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import jax
import numpy as np

from scan2flex_jax.effects.catalogue import entry_of
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting.least_squares import Minimum
from scan2flex_jax.fitting.problem import FIT_ELEMENTS, Problem
from scan2flex_jax.fitting.threads import threaded
from scan2flex_jax.inference.planning import POINTS, Plan, measured_in_simulation, ranked_poses
from scan2flex_jax.posterior import quantities as of
from scan2flex_jax.posterior.estimate import NORMAL_95, Estimate
from scan2flex_jax.posterior.likelihood import NONE, inverted
from scan2flex_jax.posterior.posterior import Fitted, Variant, price
from scan2flex_jax.posterior.program import slots_of
from scan2flex_jax.posterior.search import Screen
from scan2flex_jax.posterior.settings import USUAL, Settings
from scan2flex_jax.prediction import settled
from scan2flex_jax.results.explanation import parameter_in_words
from scan2flex_jax.study.model import Study
from scan2flex_jax.study.sense import check_study

_SEEN, _HARDLY = 1.0, 10.0  # usual sizes up to which an effect would be found, and beyond which these poses do not tell


@dataclass(frozen=True)
class Visible:
    """An effect type: the ``parameters`` of the smallest one that would be found whatever its direction, at the place where it
    shows most, and its size over the usual one."""

    kind: str
    parameters: dict
    size: float


@dataclass(frozen=True)
class Expectation:
    """What poses will tell, with a ``noise`` (m) of each coordinate: estimates at the guesses with their intervals, the
    smallest effects that would be found, the most visible first, and the `Plan` of the pose to add."""

    study: Study = field(repr=False)
    noise: float
    estimates: dict[str, Estimate]
    effects: tuple[Visible, ...]
    plan: Plan

    def summary(self) -> str:
        """In plain text."""
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        poses = len(self.study.fit_poses)
        noise = f"with a noise of {1e3 * self.noise:.3g} mm in each coordinate"
        yield f"{self.study.title}: what {poses} pose{'s' * (poses > 1)} will tell, {noise}"
        yield ""
        for name, e in self.estimates.items():
            words = "not determined: these poses do not show it"
            if e.std is not None and np.all(np.isfinite(e.std)):
                value, error = np.asarray(e.value), NORMAL_95 * np.asarray(e.std)
                relative = f"{100 * np.max(np.abs(error / value)):.2g} %" if np.all(value) else f"{np.max(error):.2g} {e.unit}"
                words = f"to within {relative} (95 %)"
            yield f"  {name:<24} {words}"
        yield ""
        yield "  missing effects, the smallest that would be found (alone, and in any direction):"
        for v in (v for v in self.effects if v.size <= _HARDLY):
            said = ", ".join(f"{k} {parameter_in_words(self.study, v.kind, k, x)}" for k, x in v.parameters.items())
            rare = "" if v.size <= _SEEN else f"   ({v.size:.2g} times the usual)"
            yield f"    {v.kind.replace('_', ' '):<24} {said}{rare}"
        if hidden := [v.kind.replace("_", " ") for v in self.effects if v.size > _HARDLY]:
            yield f"    hardly seen at all: {', '.join(hidden)}"
        yield ""
        yield from self.plan.summary().splitlines()

    def to_json(self) -> dict:
        """Lists and numbers."""
        seen = [{"kind": v.kind, "size": v.size, "parameters": {k: np.asarray(x).tolist() for k, x in v.parameters.items()}}
                for v in self.effects]  # fmt: skip
        estimates = {name: e.to_json() for name, e in self.estimates.items()}
        return {"noise": self.noise, "estimates": estimates, "effects": seen, "plan": self.plan.to_json()}


@threaded
def expect(
    study: Study, *, noise: float | None = None, elements: int | None = None, settings: Settings = USUAL
) -> Expectation:
    """Expect what the ``fit`` poses of a study will tell, before they are measured.

    Args:
        study: Its unknowns need guesses; poses need only clamps (curves, if any, choose the branch).
        noise: Standard deviation (m) of one coordinate of the points to be measured; None: the noise that the study states, or
            1/1000 of the length.
        elements: Elements of the rod; None: 40.
        settings: Priors of the model, and thresholds of what counts as found.

    Returns:
        The intervals to expect, the smallest effects that would be found, and the pose that would add most.

    Raises:
        Scan2FlexError: ``noise`` is not positive, a guess is missing, nothing is unknown, a pose does not settle at the
            guesses, or shapes depend on the poses before.

    Examples:
        >>> print(expect(load_study("planned")).summary())  # doctest: +SKIP
    """
    check_study(study, "predict")
    if study.history_dependent or not study.unknowns:
        why = "the shapes depend on the poses before" if study.history_dependent else "nothing is unknown"
        raise Scan2FlexError(f"There is nothing to expect of this study: {why}.")
    if noise is not None and not 0.0 < noise < np.inf:
        raise Scan2FlexError(f"The noise is {noise}; it must be a positive number of metres.")
    h = _foreseen(study, noise, elements or FIT_ELEMENTS, settings)
    plan = ranked_poses(h, [])
    sigma = h.variant.likelihood.noise(h.u).total
    return Expectation(study, float(sigma), of.estimates(h, (h,)), tuple(_visible(h)), plan)


def _foreseen(study: Study, noise, elements: int, settings) -> Fitted:
    """The hypothesis without effects at the guesses, of poses measured there in simulation."""
    keep = np.unique(np.linspace(0, elements, min(POINTS, elements + 1)).round().astype(int))[1:-1]
    poses, solved = [], []
    for pose in study.fit_poses:
        e = settled(study, pose, elements)[1]
        if not bool(e.verdict.solved):
            raise Scan2FlexError(f"pose {pose.name} does not settle at the guesses: {e.verdict.sentence()}")
        poses.append(measured_in_simulation(pose, np.asarray(e.points)[keep]))
        solved.append(jax.tree.map(np.asarray, e.configuration))
    planned = replace(study, poses=tuple(poses))
    problem = Problem(planned, elements, slots=slots_of(planned))
    x = np.r_[problem.both_starts()[0], np.zeros(problem.layout.shared - problem.layout.unknowns)]
    local, start = np.zeros((problem.poses.count, problem.layout.local)), jax.tree.map(lambda *c: np.stack(c), *solved)
    minimum = Minimum(x, local, problem.evaluator(x, local, start=start), 0.0, 0, converged=True)
    v = Variant("expected", problem, minimum, settings, held=True)
    law = v.likelihood
    sigma = noise or law.stated or settings.usual_noise * v.length
    u = np.clip(law.start(np.sqrt(0.5) * sigma, NONE), *np.transpose(law.bounds))
    _, covariance = inverted(v.empty.linear.normal(*law.white(u, v.empty.linear))[0])
    return replace(v.empty, u=u, covariance=covariance)


def _visible(h: Fitted) -> list[Visible]:
    """The smallest effect of each type that leads by what counts as found, beside its prior: in the direction of its amplitudes
    that shows least, at the place where that shows most."""
    screen, v, out = Screen(h), h.variant, []
    information = screen.ladder[0][1]  # in units of the usual sizes
    for kind, places in screen.kinds.items():
        entry, seen = entry_of(kind), []
        for j in places:
            values, vectors = np.linalg.eigh(information[np.ix_(screen.spans[j], screen.spans[j])])
            seen.append((1.0 / np.sqrt(max(values[0], 1e-30)), j, vectors[:, 0]))
        least, j, along = min(seen, key=lambda one: one[0])
        size = np.sqrt(2 * (v.settings.found + price(entry, v.context, v.settings))) * least
        amplitudes = size * along * np.sign(along[np.argmax(np.abs(along))]) * entry.size(v.context)
        amplitudes = np.clip(amplitudes, *entry.bounds(v.context))
        out.append(Visible(kind, entry.parameters(amplitudes, screen.wanted[j].site, v.context), float(size)))
    return sorted(out, key=lambda one: one.size)
