"""Opening lines of an explanation: final estimates, their sensitivities, error on unseen poses, and belief."""

import numpy as np

from scan2flex_jax.diagnosis import verdict
from scan2flex_jax.fitting.answer import (
    BAD,
    FAIR,
    GOOD,
    Answer,
    compose,
    distance_in_words,
    left_out_in_words,
    warnings_of,
)


def answer_of(explanation) -> Answer:
    """The answer of an `Explanation`."""
    study, fitted = explanation.study, explanation.fit
    tone, belief = belief_of(explanation)
    if fitted is None:
        return Answer((), "", "", belief, tone, warnings_of(study))
    return compose(fitted.study, explanation.estimates, explanation.influence, _unseen(explanation), tone, belief)


def _unseen(explanation):
    """The final error on validate poses; without them, on fitted poses left out in turn."""
    length, rms = explanation.fit.problem.length, explanation.rms("validate")
    count = sum(p.role == "validate" for p in explanation.poses.values())
    if count and np.isfinite(rms):
        before = explanation.rms("validate", after=False)
        was = f", {1e3 * before:.3g} mm before" if explanation.added and np.isfinite(before) else ""
        return f"{distance_in_words(rms, length)}{was}, in {count} pose{'s' * (count > 1)} that the fit never saw"
    if count:
        return "not known: a validate pose could not be solved"
    return left_out_in_words(explanation.rms_left_out(), length, len(explanation.poses))


def found_in_words(explanation) -> str:
    """The effects found and those tied with them: ``kink or natural curvature``."""
    kinds = [r.kind.replace("_", " ") for r in explanation.chosen]
    rivals = [k.replace("_", " ") for r in explanation.chosen for k in r.tied_with]
    rivals = [k for k in dict.fromkeys(rivals) if k not in kinds]
    if explanation.verdict == verdict.TIE and not rivals:  # tied with a smooth field, or with an error in the study
        rivals = ["something outside the catalogue"]
    return " and ".join(kinds) + "".join(f" or {k}" for k in rivals)


def belief_of(explanation) -> tuple[str, str]:
    """Tone and sentence: no, with care, or yes, each with its reason."""
    unsolved = [name for name, p in explanation.poses.items() if not p.stable]
    if explanation.mistakes:
        return BAD, f"no: the input is likely mistaken: {explanation.mistakes[0]}"
    if explanation.fit is None or explanation.verdict == verdict.UNSOLVED:
        return BAD, "no: not in equilibrium, nothing is concluded"
    if unsolved:
        return BAD, f"no: {', '.join(unsolved)} could not be solved"
    if explanation.misfits and explanation.verdict != verdict.UNEXPLAINED:
        return BAD, f"no: {explanation.misfits[0]}"
    return _of_verdict(explanation)


def _of_verdict(explanation):
    found, fitted = found_in_words(explanation), explanation.fit
    if explanation.verdict == verdict.NONE and fitted.valid is False:
        return BAD, f"no: the fitted poses show no missing effect, but {fitted.sentences[-1]}"
    differ = explanation.discrepancy
    if explanation.verdict == verdict.NONE and differ is not None and differ.curvature:
        size = f"{1e3 * differ.rms:.2g} mm beyond the noise"
        return FAIR, f"with care: no missing effect shows, but poses differ by {size}; the intervals allow for it"
    noise, search = explanation.noise, explanation.search
    if explanation.verdict == verdict.NONE and search is not None and search.stage.of.conspicuous(noise):
        size = f"{1e3 * np.sqrt(2) * noise.total:.2g} mm"
        return FAIR, f"with care: no missing effect shows if the curves err by {size}, smoothly, which the study does not state"
    belief = {
        verdict.NONE: (GOOD, f"yes: the baseline model explains the shapes within the noise (p = {explanation.p_value:.2g})"),
        verdict.EXPLAINED: (GOOD, f"yes, with {found}: the remaining error is noise"),
        verdict.PARTLY: (FAIR, f"with care: {found} removes most of the error, but more than noise remains"),
        verdict.TIE: (FAIR, f"with care: {found} explain the shapes alike; the intervals hold for all of them"),
    }
    return belief.get(explanation.verdict, (BAD, "no: something is missing, and no known effect explains it"))
