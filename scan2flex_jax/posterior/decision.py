"""The eight decisions of `explain`, from the hypotheses that were scored. Nothing else decides.

A hypothesis *leads* over another where it predicts poses left out better (`Fitted.elpd`): by `found` nats and by two standard
errors of the paired differences over the poses (of Student's t for five poses or fewer). What one pose can say is bounded by
`mistake` nats, since it may be mistaken itself. One more pose that says nothing is counted, so that poses that all reach the
bound have a standard error, and three must agree. Fewer than three are compared by their log evidence.

1. Poses that are not solved, or a mesh whose error reaches the noise: not in equilibrium.
2. Something is missing where a hypothesis with effects leads over the one without. A set of effects is needed where it leads
   over each smaller set, and an effect of any form (a law, the stiffness along the cable) where it leads over the forms that it
   contains. A residual of scans that the error of their axis accounts for is nothing missing, whatever its nats.
3. Tied: hypotheses of as many effects, each found by itself, over which the best does not lead, prior odds counted, or which
   have the same shapes by the catalogue. One with an effect of any form stands first only where it is the likeliest.
4. Explained: no discrepancy is needed beside the noise, which is like a scanner's or stated (`smooth`), and no field leads;
   else partly explained, if the effects take most of the structure away.
5. Unexplained: a field leads, or nothing does while a discrepancy is needed, or the noise is unlike a scanner's. The field is a
   description, no cause.
6. A validate pose that is off by `surprise` times what the hypothesis expects contradicts it: at most partly explained.
7. A mistake of the input that leads over the study as stated stands, unless effects lead over it.
8. Fewer than three poses: described, never established.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import special

from scan2flex_jax.effects.catalogue import catalogue, entry_of
from scan2flex_jax.effects.entry import SameShapes
from scan2flex_jax.posterior import belief
from scan2flex_jax.posterior.posterior import Fitted
from scan2flex_jax.posterior.search import Search, describes, same_shapes
from scan2flex_jax.posterior.settings import FEWEST
from scan2flex_jax.study.mistakes import Mistake

NONE, EXPLAINED, PARTLY, TIE, UNEXPLAINED, UNSOLVED = (
    "no missing effect", "explained", "partly explained", "tied", "unexplained", "not in equilibrium",
)  # fmt: skip
FOUND = (EXPLAINED, PARTLY, TIE)
NAMED, FAVOURED, TIED, TOO_LITTLE, ABSENT, INCONCLUSIVE = (
    "named", "favoured", "tied", "too little", "absent", "inconclusive",
)  # fmt: skip


_ERRORS, _SURE = 2.0, 0.95  # standard errors of a lead; one-sided level of Student's t, which asks for more of few poses


@dataclass(frozen=True)
class Decision:
    """The ``verdict`` on the hypothesis ``best``, which is the likeliest where none is established, those ``tied`` with it, and
    those ``averaged`` in the intervals; ``empty`` is the one without effects.

    Also the likeliest ``cause`` even if not established, the likeliest field as ``description``, the smaller ``p_value`` of
    both against nothing missing, the ``gain`` (nats) of a discrepancy beside the best, the ``mistakes`` that stand, and the
    validate poses that are ``surprised``.
    """

    verdict: str
    best: Fitted
    empty: Fitted
    tied: tuple[Fitted, ...] = ()
    averaged: tuple[Fitted, ...] = ()
    cause: Fitted | None = None
    description: Fitted | None = None
    p_value: float = 1.0
    gain: float = 0.0
    mistakes: tuple[Mistake, ...] = ()
    surprised: dict[str, float] = field(default_factory=dict)

    @property
    def missing(self) -> bool:
        """Whether something is missing from the baseline model."""
        return self.verdict not in (NONE, UNSOLVED)


def compared(h: Fitted, other: Fitted) -> tuple[float, float]:
    """`lead` of a hypothesis over another; the difference in log evidence, without an error, for fewer than `FEWEST` poses."""
    if len(h.elpd) < FEWEST:
        return float(h.score - other.score), 0.0
    return lead(h.elpd - other.elpd, h.variant.settings.mistake)


def lead(differences: np.ndarray, most: float) -> tuple[float, float]:
    """Sum (nats) of paired differences (P,), each bounded by ``most``, and its standard error with one more that is zero."""
    d = np.append(np.clip(differences, -most, most), 0.0)
    return float(np.sum(d)), float(np.std(d, ddof=1) * np.sqrt(len(d)))


def led(differences: np.ndarray, most: float, found: float, before: float = 0.0) -> bool:
    """Whether the poses lead together, by ``found`` nats or more with those ``before`` any pose."""
    total, error = lead(differences, most)
    return total + before > max(found, max(_ERRORS, float(special.stdtrit(len(differences), _SURE))) * error)


def leads(h: Fitted, other: Fitted, found: float, before: float = 0.0) -> bool:
    """Whether a hypothesis leads over another by ``found`` nats or more; ``before``: its prior odds, which a score has."""
    if len(h.elpd) < FEWEST:
        return bool(h.score - other.score > found)
    return led(h.elpd - other.elpd, h.variant.settings.mistake, found, before)


def likeliest(hypotheses: Sequence[Fitted]) -> Fitted | None:
    """The hypothesis that no other predicts better than, by bounded differences and the prior odds of effects; where they go
    round, that of the largest log predictive density among them. None without any."""
    best = max(hypotheses, key=_density, default=None)
    for _ in hypotheses:
        gains = [compared(h, best)[0] + h.log_odds - best.log_odds for h in hypotheses if best is not None]
        if max(gains) <= 0.0:
            break
        best = hypotheses[int(np.argmax(gains))]
    return best


def decide(search: Search, mistaken: list[tuple[Mistake, Fitted]], coarse: bool, surprise) -> Decision:
    """The decision; ``mistaken``: hypotheses of mistakes; ``surprise(h)``: of a hypothesis, by the name of each validate pose
    its RMS distance over the expected one."""
    s = search.variants[0].settings
    empty = max((v.empty for v in search.variants if v.effect is None), key=lambda h: h.score)
    causes = [h for h in search.causes if h.names and h.score > empty.score]
    description, cause, alone = likeliest([h for h in search.ranked if describes(h)]), _needed(causes, s), empty.gain()
    p_value = min((_p_value(h, empty) for h in (cause, description) if h is not None), default=1.0)
    rest: dict[str, Any] = {"cause": cause, "description": description, "p_value": p_value}
    if coarse:
        return Decision(UNSOLVED, empty, empty, averaged=(empty,), **rest)
    ahead = cause is not None and leads(cause, empty, s.found)
    stands = [m for m, h in mistaken if leads(h, empty, s.found) and not (ahead and cause and leads(cause, h, s.found))]
    if stands:
        return Decision(UNEXPLAINED, empty, empty, averaged=(empty,), mistakes=tuple(stands), **rest)
    if belief.of_the_axis(empty):
        rest["p_value"] = 1.0
        return Decision(NONE, empty, empty, (), (empty,), gain=alone, surprised=surprise(empty), **rest)
    likely = [h for h in search.ranked if h.score > search.ranked[0].score - s.averaged]
    field = description is not None and leads(description, cause or empty, s.found) and leads(description, empty, s.found)
    gain = cause.gain() if cause is not None else alone
    takes = cause is not None and (gain <= s.discrepancy or cause.structured() < s.explains * empty.structured())
    if cause is None or not ahead or not takes or field or len(empty.elpd) < FEWEST:
        missing = ahead or field or alone > s.discrepancy or smooth(empty)
        if not missing:
            return Decision(NONE, empty, empty, (), (empty,), gain=alone, surprised=surprise(empty), **rest)
        shown = cause if cause is not None and cause.score > empty.score + s.found else empty
        return Decision(UNEXPLAINED, shown, empty, (), tuple(dict.fromkeys((shown, empty, *likely))), gain=alone, **rest)
    found = [cause, *(h for h in causes if h is not cause and _tied(h, cause, empty, s))]
    cause = _first_of(found)
    tied, gain, surprised = tuple(h for h in found if h is not cause), cause.gain(), surprise(cause)
    partly = gain > s.discrepancy or smooth(cause) or bool(surprised)
    verdict = TIE if tied or errors_of_input(cause.kinds) else PARTLY if partly else EXPLAINED
    averaged = tuple(dict.fromkeys((cause, *tied, *(h for h in likely if h is not empty))))
    return Decision(verdict, cause, empty, tied, averaged, gain=gain, surprised=surprised, **rest)


def _density(h: Fitted) -> float:
    """Log predictive density (nats), or evidence of fewer than `FEWEST` poses."""
    return float(np.sum(h.elpd)) if len(h.elpd) >= FEWEST else h.score


def smooth(h: Fitted) -> bool:
    """Whether a residual that a hypothesis takes for noise, and nobody stated, varies along the cable as no scanner's does."""
    v = h.variant
    taken = v.likelihood.stated is None and not h.discrepant
    return taken and belief.conspicuous(v.likelihood.noise(h.u), v.length, v.settings)


def _p_value(h: Fitted, empty: Fitted) -> float:
    """One-sided probability (Student's t) of such a lead over the hypothesis without effects if neither predicts better; of
    fewer than `FEWEST` poses, the inverse Bayes factor."""
    difference, error = compared(h, empty)
    if len(h.elpd) < FEWEST:
        return float(np.exp(-max(difference, 0.0)))
    return float(special.stdtr(len(h.elpd), -difference / max(error, 1e-12)))


def errors_of_input(kinds) -> list[SameShapes]:
    """Inputs of the study whose errors always give the shapes of a single effect."""
    known = {e.kind for e in catalogue()}
    one = kinds if len(kinds) == 1 and kinds[0] in known else ()
    return [s for k in one for s in entry_of(k).same_shapes if s.other not in known and s.always]


def _needed(causes: list[Fitted], s) -> Fitted | None:
    """The hypothesis with effects that predicts best, of which none is spare, nor of a freer form than it need be."""
    best = likeliest(causes)
    if best is None:
        return None
    smaller = ([h for h in causes if len(h.names) == count] for count in range(len(best.names) - 1, 0, -1))
    for simpler in (likeliest(some) for some in smaller):
        best = simpler if simpler is not None and not leads(best, simpler, s.found) else best
    simpler = likeliest([h for h in causes if _freer(best, h)])
    return simpler if simpler is not None and not leads(best, simpler, s.found) else best


def _first_of(tied):
    """Which of tied hypotheses, the best predicting one before the others, stands first: that one, but an effect of any form
    only where it is the likeliest too."""
    best, *others = tied
    simpler = [h for h in others if not _of_any_form(h) and h.score > best.score]
    return max(simpler, key=lambda h: h.score) if simpler and _of_any_form(best) else best


def _of_any_form(h):
    """Whether an effect of a hypothesis has any form: a law, the stiffness along the cable."""
    return any(c.entry.late or c.entry.varies for c in h.components)


def _freer(h: Fitted, other: Fitted) -> bool:
    """Whether a hypothesis is another one with an effect in a form of any kind that contains it: a law, the stiffness along."""
    free = [c.kind for c in h.components if (c.entry.late or c.entry.varies) and c.kind not in other.names]
    lost = [kind for kind in other.kinds if kind not in h.names]
    same = len(h.names) == len(other.names) and len(lost) == len(set(h.names) - set(other.names)) > 0
    return same and all(any(same_shapes(kind, k) for k in free) for kind in lost)


def _tied(h: Fitted, best: Fitted, empty: Fitted, s) -> bool:
    """Whether two hypotheses of as many effects, each found by itself, cannot be told apart."""
    if len(h.names) != len(best.names) or set(h.names) == set(best.names) or _freer(h, best) or not leads(h, empty, s.found):
        return False
    equivalent = len(h.kinds) == len(best.kinds) == 1 and same_shapes(h.kinds[0], best.kinds[0])
    return not leads(best, h, s.tied, best.log_odds - h.log_odds) or (equivalent and h.chi2 <= best.chi2 + s.same_misfit)
