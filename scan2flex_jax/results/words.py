"""Findings of `explain` as data, and their words: nothing else makes sentences of them, and nothing reads a sentence."""

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from scan2flex_jax.posterior.decision import EXPLAINED, NONE, PARTLY, TIE, UNEXPLAINED, UNSOLVED
from scan2flex_jax.posterior.estimate import two_digits
from scan2flex_jax.results.answer import Answer, compose, readings_in_words, reliability, unseen_in_words, warnings_of

Severity = Literal["fine", "doubt", "fault"]


@dataclass(frozen=True)
class Finding:
    """One finding: its ``code``, its ``severity``, and the ``values`` that its sentence tells."""

    code: str
    severity: Severity = "fine"
    values: dict[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        """The finding in words."""
        return _WORDS[self.code].format(**self.values)


_WORDS = {
    "nothing": "the baseline model explains these shapes within the noise: no effect predicts poses left out better "
    "(p = {p:.2g})",
    "explains": "{effects} {explains} the shapes: what remains is noise",
    "partly": "{effects} {explains} most of the error; what remains differs from pose to pose and is more than noise",
    "tied": "{effects} {explains} the shapes, and so would {rivals}",
    "unexplained": "something is missing, and no known effect explains it",
    "field": "it behaves like {field} ({nats:.0f} nats ahead): a description, not a cause",
    "likeliest": "the likeliest, {effects}, leads by {nats:.1f} nats over no effect, and is not established",
    "one_pose": "in a single pose an effect cannot be tested on another one: nothing is established",
    "two_poses": "in two poses an effect cannot be tested on enough others: nothing is established",
    "coarse": "the mesh error reaches the noise in {poses}: nothing is concluded",
    "discrepancy": "beyond the sensor's noise each pose differs in its own way ({mm:.2f} mm, {percent:.2f} % of the length): "
    "friction, handling, or unlisted physics",
    "surprise": "pose {pose}, which was not fitted, is off by {ratio:.1f} times what this model expects",
    "unseen": "pose {pose}, which was not fitted, could not be solved with this model",
    "change": "with {effects} the error {moves} from {was:.2f} to {now:.2f} mm{more}",
    "better": "left out in turn, {better} of {poses} fitted poses are predicted better with it than without",
    "as_good": "shapes alone cannot tell {effects} from an error of the {other}: {when}",
    "less": "a mistake of the input explains less: {mistake}",
    "mistaken": "correct the input first: no missing effect is named until then",
    "turns": "with the stated turns and {effects} the shapes are likelier by {nats:.0f} nats than with the nearest turns alone",
    "axis": "the baseline error, {mm:.2f} mm, is {percent:.2g} % of the radius, no more than a scan's axis may err: "
    "{effects} would lessen it, and is not established",
    "smooth": "the residual varies slowly along the cable ({mm:.1f} mm), unlike the noise of a scanner: if the curves err so, "
    "state their noise (`noise` of a pose)",
}
FIELDS = {
    "distributed_load": "a load that varies along the cable, the same in every pose",
    "curvature_profile": "a natural curvature that varies along the cable",
}


def listed(names) -> str:
    """Effect types in words."""
    return " and ".join(name.replace("_", " ") for name in names)


def found_in_words(explanation) -> str:
    """The effects found and those tied with them: ``kink or natural curvature``."""
    kinds = [r.kind.replace("_", " ") for r in explanation.chosen]
    rivals = [k.replace("_", " ") for r in explanation.chosen for k in r.tied_with]
    rivals = [k for k in dict.fromkeys(rivals) if k not in kinds]
    if explanation.verdict == TIE and not rivals:  # tied with an error of the input
        rivals = ["something outside the catalogue"]
    return " and ".join(kinds) + "".join(f" or {k}" for k in rivals)


def answer_of(explanation) -> Answer:
    """The answer of an `Explanation`."""
    tone, said = belief_of(explanation)
    if explanation.fit is None:
        return Answer((), "", "", said, tone, warnings_of(explanation.study))
    study = explanation.fit.study
    return compose(study, explanation.estimates, explanation.influence, _unseen(explanation), tone, said)


def _unseen(explanation):
    """The final error on unseen poses."""
    e, before = explanation, explanation.rms("validate", after=False)
    was = f", {1e3 * before:.3g} mm before," if e.chosen and np.isfinite(before) else ""
    poses = _unseen_poses(e)
    left_out, length = e.rms_left_out(), e.fit.problem.length
    alone = readings_in_words(e.poses.values())
    return alone or unseen_in_words(e.rms("validate"), poses, left_out, len(e.poses) - poses, length, was)


def belief_of(explanation) -> tuple[str, str]:
    """Tone and sentence: no, with care, or yes, each with its reason."""
    e, found, doubts = explanation, found_in_words(explanation), list[str]()
    yes = f"yes, with {found}: the remaining error is noise"
    if e.verdict == NONE:
        yes = f"yes: the baseline model explains the shapes within the noise (p = {e.p_value:.2g})"
    if e.verdict in (NONE, EXPLAINED) and e.reservation:
        doubts.append(f"{f'{found} explains much' if found else 'no missing effect shows'}, but {e.reservation}")
    elif e.verdict == PARTLY:
        doubts.append(f"{found} removes most of the error, but more than noise remains")
    elif e.verdict == TIE:
        doubts.append(f"{found} explain the shapes alike; the intervals hold for all of them")
    return reliability(faults_of(e), doubts, yes)


def faults_of(explanation) -> list[str]:
    """What makes an answer a "no"; empty if nothing does."""
    e, found = explanation, found_in_words(explanation)
    unsolved = [name for name, p in e.poses.items() if not p.stable]
    said = [f"the input is likely mistaken: {e.mistakes[0]}"] if e.mistakes else []
    said += ["not in equilibrium, nothing is concluded"] if e.fit is None or e.verdict == UNSOLVED else []
    said += [f"{', '.join(unsolved)} could not be solved"] if unsolved else []
    said += ["something is missing, and no known effect explains it"] if e.verdict == UNEXPLAINED else []
    if e.surprised:
        pose, ratio = max(e.surprised.items(), key=lambda item: item[1])
        off = f"is off by {two_digits(ratio)} times what the model expects" if np.isfinite(ratio) else "could not be solved"
        said.append(f"{found + ' removes much of the error, but ' if found else ''}pose {pose}, which was not fitted, {off}")
    return said or list(e.misfits)


def _unseen_poses(e) -> int:
    return sum(p.role == "validate" for p in e.poses.values())
