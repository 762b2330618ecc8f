"""`fit`: the sequence from a study's measured shapes to estimates with intervals; each step has its own module.

Start (the user's guess, and one from the balance equations), minimise unweighted distances on the measured branches, then the
mode of the posterior (`posterior`): noise, discrepancy and parameters together, as `explain` has them before any effect.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting.evaluate import Evaluation
from scan2flex_jax.fitting.least_squares import Minimum, Progress, silent
from scan2flex_jax.fitting.noise import stated_noise
from scan2flex_jax.fitting.parameters import values_of
from scan2flex_jax.fitting.poses import check_distance
from scan2flex_jax.fitting.problem import Problem
from scan2flex_jax.fitting.states import DISTANCES
from scan2flex_jax.fitting.threads import threaded
from scan2flex_jax.inference.mesh import Found, on_enough_elements
from scan2flex_jax.inference.mistakes import before_branches, hidden
from scan2flex_jax.posterior import belief, branches
from scan2flex_jax.posterior import quantities as of
from scan2flex_jax.posterior.posterior import Variant
from scan2flex_jax.posterior.profile import profiled
from scan2flex_jax.posterior.settings import USUAL, Settings
from scan2flex_jax.results import shapes
from scan2flex_jax.results.along import stiffness_along, withheld
from scan2flex_jax.results.answer import number
from scan2flex_jax.results.fit_result import Fit, not_converged, pose_fits
from scan2flex_jax.rod.effect import AbstractEffect
from scan2flex_jax.study.check import study_warnings, unit_warnings
from scan2flex_jax.study.model import Study
from scan2flex_jax.study.repeats import repeat_sentences
from scan2flex_jax.study.sense import check_study

METHODS = ("least-squares", "bfgs", "nelder-mead")


def fit(
    study: Study,
    method: str = "least-squares",
    *,
    distance: str = "normal",
    elements: int | None = None,
    progress: Callable[[str], None] | None = None,
    settings: Settings = USUAL,
) -> Fit:
    """Estimate the unknowns of ``study`` from the shapes of its ``fit`` poses (paper, Section 5.2, Eq. 9).

    Args:
        study: One cable with at least one ``fit`` pose and one unknown.
        method: "least-squares" (Levenberg-Marquardt with the implicit Jacobian), "bfgs" (on the summed squared distance) or
            "nelder-mead" (the paper's).
        distance: Of curves: "normal", "integrated" (the paper's Eq. 10), or "hausdorff" (for "bfgs" and "nelder-mead": it has
            no least squares).
        elements: Elements of the rod; None: 40, or as many more as the bends of the cable need (`statics.mesh`).
        progress: Called with a line of text now and then.
        settings: Priors of the model, and thresholds of the validation.

    Returns:
        Estimates with their intervals, the errors of all poses (m), the noise, and sentences on their validity. A fit that is
        not reliable (`Fit.believable`) has no intervals.

    Raises:
        Scan2FlexError: There is nothing to fit.
        NotSettledError: No values let every pose settle.

    Examples:
        >>> result = fit(load_study("my-cable"))  # doctest: +SKIP
        >>> result.estimates["bending_stiffness"].value  # doctest: +SKIP
        0.1
    """
    return fitted(study, method, distance=distance, elements=elements, progress=progress, settings=settings)


def with_curves(study: Study, progress: Progress) -> tuple[Study, tuple[str, ...]]:
    """The study with a centre curve extracted for each pose that has a scan alone, and sentences on doubtful ones; those that
    went astray are left out if others remain to be fitted."""
    if not any(pose.curve is None and pose.scan is not None for pose in study.poses):
        return study, ()
    from scan2flex_jax.scan import extract_study  # noqa: PLC0415  (only scans need it, and it loads slowly)

    whole, found = extract_study(study, lambda name, i, n: progress(f"extracting {name} ({i} of {n})"))
    left = {n for n, c in found.items() if c.astray}
    sure = [pose for pose in whole.poses if pose.name not in left]
    out = ", and left out" if any(pose.role == "fit" for pose in sure) else ""
    if out:
        poses = (replace(pose, repeat_of=None if pose.repeat_of in left else pose.repeat_of) for pose in sure)
        whole = replace(whole, poses=tuple(poses))
    doubtful = {n: f"is doubtful{out if n in left else ''}: {'; '.join(c.doubts)}" for n, c in found.items() if not c.sure}
    doubts = [f"the centre curve of pose {n!r} {why}" for n, why in doubtful.items()]
    return whole, ("centre curves were extracted from the scans and fitted", *doubts)


@threaded
def fitted(
    study: Study, method: str = "least-squares", *, distance: str = "normal", elements: int | None = None,
    progress: Progress | None = None, settings: Settings = USUAL, slots: tuple[AbstractEffect, ...] = (),
    turns: bool = True, mistakes: bool = True,
) -> Fit:  # fmt: skip
    """`fit` as `explain` calls it.

    ``slots``: energy laws of effects that may be added later, at zero amplitude, so that a search reuses the functions compiled
    here. ``turns``: False keeps the turns of the study in every pose. ``mistakes``: False looks for none in the input.
    """
    _check(study, method, distance)
    began, progress = time.perf_counter(), progress or silent
    whole, said = with_curves(study, progress)
    given: dict[str, Any] = {"method": method, "progress": progress, "mistakes": mistakes, "settings": settings}
    stages = [partial(stage, **given) for stage in (_minimum, _on_branches if turns else _as_stated)]
    found, mesh = on_enough_elements(lambda n: Problem(whole, n, distance, slots), stages, elements, progress, settings)
    problem, minimum, likely, doubt = found
    turned, whole = branches.sentences(whole, problem.study), problem.study
    several, open_ = shapes.in_words(problem, minimum, shapes.others(problem, minimum, progress))
    rival, stated = minimum.rivals[:1], stated_noise(whole)
    in_doubt = tuple(filter(None, (doubt, several, *(_rival_in_words(problem, minimum, *other) for other in rival))))
    own = (method == "least-squares" and problem.evaluator.distance == "normal") or problem.layout.has_priors
    if problem.evaluator.distance != "normal":
        minimum = problem.seen_by_normals(minimum)
    said = said if own else (*said, _HELD)
    progress("noise, discrepancy and parameters together")
    variant = Variant("as stated", problem, minimum, settings, held=not own)
    posterior = variant.empty
    minimum, solved = _at_mode(posterior, minimum), problem.evaluator.equilibria + variant.program.solves
    noise, discrepancy = variant.likelihood.noise(posterior.u), of.discrepancy_of(posterior)
    known, poses, laws = of.known(posterior), pose_fits(posterior), of.laws_of(posterior)
    estimates = profiled(posterior, of.estimates(posterior, (posterior,)))
    open_ = (*open_, *(name for x, _ in rival for name in _beyond(estimates, values_of(problem.layout, x))))
    estimates = shapes.without(estimates, open_)
    along, loops = stiffness_along(posterior, (posterior,)), of.loops_in(posterior)
    misfits = belief.misfits(whole, poses, problem.length, settings)
    valid, judgement = belief.validity(poses, noise, discrepancy.curvature > 0, stated, problem.length, bool(misfits), settings)
    reservation = belief.reservation(posterior, discrepancy)
    verdict = (*filter(None, [reservation]), judgement)
    warned = study_warnings(whole) if misfits or likely else unit_warnings(whole)
    stopped = () if minimum.converged else (not_converged(minimum),)
    said = (*warned, *said, *repeat_sentences(whole), *study.assumptions, *stopped, *mesh.sentences(), *turned, *in_doubt)
    result = Fit(
        study=whole,
        problem=problem,
        minimum=minimum,
        posterior=posterior,
        method=method,
        distance=distance,
        estimates=estimates,
        labels=problem.layout.labels,
        correlation=_correlation(_in_logs(problem.layout, known.covariance)),
        poses=poses,
        noise=noise,
        discrepancy=discrepancy,
        sentences=(*map(str, likely), *misfits, *said, *_known(known, (*laws, *loops), estimates), *verdict),
        valid=valid,
        judgement=judgement,
        reservation=reservation,
        converged=minimum.converged,
        equilibria=solved,
        seconds=time.perf_counter() - began,
        cost=minimum.cost,
        turned=turned,
        in_doubt=in_doubt,
        open=open_,
        mesh=mesh.sentences(),
        misfits=misfits,
        mistakes=likely,
        settings=settings,
        laws=laws,
        along=along,
        loops=loops,
    )
    return result if result.believable else withheld(result)


def _at_mode(h, minimum) -> Minimum:
    """The mode of a posterior as a minimum: its evaluation, and its cost in units of noise and discrepancy."""
    n = h.index
    shared, local = h.x[: n.shared], h.x[n.shared : n.base].reshape(n.poses, n.local)
    stalled = not h.converged and minimum.stalled
    return Minimum(shared, local, Evaluation.of(h.shapes), h.chi2 + h.linear.quad, minimum.iterations, h.converged, stalled)


def _rival_in_words(problem, minimum, x, rms) -> str:
    """The best minimum elsewhere, which is about as good."""
    values, own = values_of(problem.layout, x), problem.rms(minimum)
    said = ", ".join(f"{name} {' '.join(number(v, 3) for v in np.ravel(value))}" for name, value in values.items())
    return f"other values fit about as well ({1e3 * rms:.3g} mm RMS in place of {1e3 * own:.3g} mm): {said}"


def _beyond(estimates, values) -> list[str]:
    """The estimates whose interval does not hold the value of a minimum that is about as good."""
    known = {name: e for name, e in estimates.items() if e.low is not None and e.high is not None}
    return [name for name, e in known.items() if np.any((values[name] < e.low) | (values[name] > e.high))]


def _known(known, laws, estimates):
    """Sentences on undetermined values, on laws, and on values at a bound."""
    return (*known.sentences, *(s for law in laws for s in law.sentences()), *_bound_sentences(estimates))


def _minimum(problem, _, method, progress, mistakes, settings):
    """The first minimum, and mistakes of the input that show at once."""
    minimum, likely = before_branches(problem, method, progress, settings) if mistakes else (None, ())
    return Found(problem, minimum or problem.minimise(method, progress), likely)


def _on_branches(declared, first, method, progress, mistakes, settings):
    """Problem and minimum on the measured branches, and mistakes of the input that show there."""
    if first.mistakes:
        return first
    problem, minimum, doubt = branches.on_its_branches(declared, first.minimum, method, progress, settings=settings)
    likely = hidden(declared.study, problem, minimum, progress, settings) if mistakes else ()
    problem, minimum = branches.believed(problem, minimum, (declared, first.minimum))
    return Found(problem, minimum, likely, doubt)


def _as_stated(declared, first, method, progress, mistakes, settings):
    """Problem and minimum with the turns of the study, and mistakes of the input that show there."""
    likely = first.mistakes or (hidden(declared.study, declared, first.minimum, progress, settings) if mistakes else ())
    return Found(declared, first.minimum, likely)


def _correlation(covariance):
    """Correlations of a covariance; NaN for entries of infinite variance."""
    spread = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = covariance / np.outer(spread, spread)
    np.fill_diagonal(correlation, 1.0)
    return correlation


def _in_logs(layout, covariance):
    """The covariance of quantities or their logarithms, from that of ``x``: the steps of a law add up."""
    if not any(slot.walk or slot.root for slot in layout.slots):
        return covariance
    open_, S = np.isinf(np.diag(covariance)), layout.sums
    out = S @ np.where(open_[:, None] | open_, 0.0, covariance) @ S.T
    out[open_, open_] = np.inf
    return out


_HELD = "the intervals are those of the posterior about the values of this method and distance"


def _check(study, method, distance):
    if method not in METHODS:
        raise Scan2FlexError(f"method {method!r} is not known: use one of {', '.join(METHODS)}")
    if distance not in DISTANCES:
        raise Scan2FlexError(f"distance {distance!r} is not known: use one of {', '.join(DISTANCES)}")
    if distance == "hausdorff" and method == "least-squares":
        raise Scan2FlexError("the Hausdorff distance has no least squares: use method bfgs or nelder-mead with it")
    if isinstance(study, Study) and not study.unknowns:
        raise Scan2FlexError("the study declares nothing under [unknown]: there is nothing to fit")
    check_study(study)
    check_distance(study, distance)


def _bound_sentences(estimates):
    return [
        f"{n} lies at a bound of its range: widen the range or question the model" for n, e in estimates.items() if e.at_bound
    ]
