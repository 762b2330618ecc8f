"""From evidence to words: what may be named, what is tied, what these poses cannot see (thresholds: `settings`).

Evidence is in nats over the base model.
"""

from dataclasses import dataclass

from scan2flex_jax.diagnosis.settings import USUAL, DiagnosisSettings

NAMED, FAVOURED, TIED, TOO_LITTLE, ABSENT, INCONCLUSIVE = (
    "named", "favoured", "tied", "too little", "absent", "inconclusive",
)  # fmt: skip
NONE, EXPLAINED, PARTLY, TIE, UNEXPLAINED, UNSOLVED = (
    "no missing effect", "explained", "partly explained", "tied", "unexplained", "not in equilibrium",
)  # fmt: skip
FOUND = (EXPLAINED, PARTLY, TIE)
_LEAST = 1.0  # nats that a kind must have over nothing to be spoken of
_SAME_MISFIT = 4.0  # of chi-squared: two kinds of one exact class differ by no more
_SEEN = 3.0  # whitened length of one physical size that makes its absence a finding


@dataclass(frozen=True)
class Candidate:
    """A set of kinds, its evidence, its misfit, the kinds that shapes alone can never tell from it, what is no kind (the
    gravity of the study, its density) and gives the same shapes ``outside`` the catalogue, and whether the kinds are
    ``pieces`` of one field: several that all make one property vary along the cable."""

    kinds: tuple[str, ...]
    log_evidence: float
    chi2: float = 0.0
    same_shapes: tuple[str, ...] = ()
    outside: tuple[str, ...] = ()
    pieces: bool = False


def varies(constancy: float | None, effects: int, settings: DiagnosisSettings = USUAL) -> bool:
    """Whether a set of effects would need another size in each pose, by the p-value of one size in all.

    Several effects are sought longer, and tested at the level of all other tests.
    """
    return constancy is not None and constancy <= (settings.level if effects > 1 else settings.same_size_level)


def ties(candidates, settings: DiagnosisSettings = USUAL) -> list[int]:
    """Indices within ``lead_favoured`` of the best, best first; and those of its exact class that fit as well.

    Within an exact class evidence compares nothing but assumed sizes, so the misfit decides.
    """
    order = sorted(range(len(candidates)), key=lambda i: -candidates[i].log_evidence)
    best = candidates[order[0]]
    near = best.log_evidence - settings.lead_favoured
    return [i for i in order if candidates[i].log_evidence > near or _alike(best, candidates[i])]


def _alike(a: Candidate, b: Candidate) -> bool:
    """Whether two single kinds are declared to give the same shapes, and do so here."""
    if len(a.kinds) != 1 or len(b.kinds) != 1:
        return False
    return (b.kinds[0] in a.same_shapes or a.kinds[0] in b.same_shapes) and b.chi2 <= a.chi2 + _SAME_MISFIT


def leading(candidates, field: float = float("-inf"), settings: DiagnosisSettings = USUAL) -> str:
    """Verdict of the best candidate; a ``field`` (log evidence of the best family) that is nearly as likely ties with it."""
    if len(ties(candidates, settings)) > 1 or max(candidates, key=lambda c: c.log_evidence).outside:
        return TIED
    order = sorted((c.log_evidence for c in candidates), reverse=True)
    if order[0] - field < settings.lead_favoured:
        return TIED
    lead = order[0] - order[1] if len(order) > 1 else float("inf")
    return NAMED if lead >= settings.lead_named else FAVOURED if lead >= settings.lead_favoured else TIED


def whole(
    test, after, candidates, constancy: float | None = None, field: float = 0.0, unseen: float | None = None,
    settings: DiagnosisSettings = USUAL,
) -> str:
    """Verdict of the study, once every pose is solved, from the test before and after the best candidate.

    A kind explains the shapes when it is likelier than nothing, no structure is left beside it, its size is the same in all
    poses (``constancy``, a p-value), and poses left out in turn are not predicted far worse with it than without (``unseen``,
    the ratio of the errors). A ``field`` (log evidence of the best family) that is nearly as likely, or likelier, ties with it,
    and stands in for it when it is far likelier. Several kinds that all say how one property varies along the cable are pieces
    of a field, which describes it and names nothing.
    """
    if test.p_value > settings.level:
        return NONE
    best = max(candidates, key=lambda c: c.log_evidence, default=Candidate((), float("-inf")))
    fails = varies(constancy, len(best.kinds), settings) or (unseen is not None and unseen > settings.worse)
    if best.log_evidence < max(_LEAST, field - settings.field_lead) or after.p_value <= settings.level or best.pieces or fails:
        return UNEXPLAINED
    return EXPLAINED if leading(candidates, field, settings) != TIED else TIE


def of_kind(log_evidence: float, visible: float, settings: DiagnosisSettings = USUAL) -> str:
    """Verdict of a kind that is not among the best: too little, absent, or not to be seen in these poses."""
    if visible < _SEEN:
        return INCONCLUSIVE
    return ABSENT if log_evidence < settings.lead_favoured else TOO_LITTLE
