"""Verdicts from evidence: named, tied, or invisible in these poses (thresholds: `settings`).

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


@dataclass(frozen=True)
class Candidate:
    """A set of effect types, its evidence and misfit, the types that give the same shapes, causes ``outside`` the catalogue
    that do (the gravity of the study, its density), and whether its effects are ``pieces`` of one field: several that vary the
    same property along the cable."""

    kinds: tuple[str, ...]
    log_evidence: float
    chi2: float = 0.0
    same_shapes: tuple[str, ...] = ()
    outside: tuple[str, ...] = ()
    pieces: bool = False


def varies(constancy: float | None, settings: DiagnosisSettings = USUAL) -> bool:
    """Whether the sizes of a set of effects differ between poses, by the p-value of homogeneity."""
    return constancy is not None and constancy <= settings.same_size_level


def ties(candidates, settings: DiagnosisSettings = USUAL) -> list[int]:
    """Indices within ``lead_favoured`` of the best, or of its exact class with as good a fit; best first.

    Within an exact class the evidence depends on assumed sizes only, so the misfit decides.
    """
    order = sorted(range(len(candidates)), key=lambda i: -candidates[i].log_evidence)
    best = candidates[order[0]]
    near = best.log_evidence - settings.lead_favoured
    return [i for i in order if candidates[i].log_evidence > near or _alike(best, candidates[i], settings)]


def _alike(a: Candidate, b: Candidate, settings: DiagnosisSettings) -> bool:
    """Whether two single effect types give the same shapes by the catalogue, and fit as well here."""
    if len(a.kinds) != 1 or len(b.kinds) != 1:
        return False
    return (b.kinds[0] in a.same_shapes or a.kinds[0] in b.same_shapes) and b.chi2 <= a.chi2 + settings.same_misfit


def leading(candidates, field: float = float("-inf"), settings: DiagnosisSettings = USUAL) -> str:
    """Verdict on the best candidate; a ``field`` (log evidence of the best family) that is nearly as likely ties with it."""
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
    """Verdict on the study, once every pose is solved, from the tests before and after the best candidate.

    An effect explains the shapes if it is likelier than the base model, the test of the residual is not significant, its size
    is homogeneous across poses (``constancy``, a p-value), and poses left out in turn are not predicted far worse (``unseen``,
    the ratio of the errors). A ``field`` (log evidence of the best family) that is nearly as likely, or likelier, ties with it,
    and replaces it if far likelier. Several effects that vary one property along the cable are pieces of a field, which
    describes the residual without naming its cause.
    """
    if test.p_value > settings.level:
        return NONE
    best = max(candidates, key=lambda c: c.log_evidence, default=Candidate((), float("-inf")))
    fails = varies(constancy, settings) or (unseen is not None and unseen > settings.worse)
    least = max(settings.least_evidence, field - settings.field_lead)
    if best.log_evidence < least or after.p_value <= settings.level or best.pieces or fails:
        return UNEXPLAINED
    return EXPLAINED if leading(candidates, field, settings) != TIED else TIE


def of_kind(log_evidence: float, visible: float, settings: DiagnosisSettings = USUAL) -> str:
    """Verdict on an effect type that is not among the best: too little, absent, or inconclusive in these poses (not visible
    by one step from the baseline model, nor likelier after a refit)."""
    if log_evidence >= settings.lead_favoured:
        return TOO_LITTLE
    return ABSENT if visible >= settings.visible else INCONCLUSIVE
