"""The estimate of one unknown, and whether the poses determine it: the rules of `fit` and of `explain`.

A positive unknown is estimated by its logarithm, so its 95 % interval is log-normal. It is *vague* where the standard error of
the logarithm exceeds `VAGUE`: such a value is not determined, nor are the numbers of an unidentifiable direction
(`quantities.known`). `answer` and `fit_result` round estimates and intervals for print.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy import special

from scan2flex_jax.fitting.parameters import Slot
from scan2flex_jax.study.kinds import CABLE, kind_format, split_name

VAGUE = 1.0  # standard deviation of a logarithm (a factor of 2.7) beyond which a value is not worth the name
NORMAL_95 = 1.959964
_TOUCHING = 1e-9  # in ``x``: nearer to a bound than this is at it
_LARGEST = 700.0  # logarithm of the largest number
_LEAST = 1e-3  # that is printed of a share, in per cent, or of a sensitivity


@dataclass(frozen=True)
class Estimate:
    """One unknown: value, standard error and 95 % interval in its own unit; no error where the poses determine none, or where
    the fit is not reliable (`withheld`)."""

    value: float | np.ndarray
    std: float | np.ndarray | None
    low: float | np.ndarray | None
    high: float | np.ndarray | None
    identifiable: bool
    at_bound: bool
    unit: str

    def withheld(self) -> "Estimate":
        """Without standard error and interval, which hold for a model that is believed only."""
        return replace(self, std=None, low=None, high=None)

    def lost(self) -> "Estimate":
        """Not determined: its value is one of several."""
        return replace(self.withheld(), identifiable=False)

    def to_json(self) -> dict:
        """As in the study format; what is not known is left out."""
        out = {"value": _plain(self.value), "identifiable": self.identifiable, "at_bound": self.at_bound}
        known = {"std": self.std, "low": self.low, "high": self.high}
        return out | {k: _plain(v) for k, v in known.items() if v is not None}


def estimate_of(
    slot: Slot,
    centre: Float[np.ndarray, " n"],
    spread: Float[np.ndarray, " n"],
    *,
    own: Float[np.ndarray, " n"] | None = None,
    determined: bool = True,
    seen: bool = True,
    vaguest: float = VAGUE,
    freedom: float = np.inf,
) -> Estimate:
    """The estimate of a slot whose quantities, or their logarithms, are ``centre`` with standard errors ``spread``, infinite
    where there is none.

    ``own``: the numbers in ``x``, which have the slot's range, where they differ from ``centre`` (the increments of a law).
    ``determined``: whether the data determine it, apart from its vagueness; ``seen``: whether it is identifiable at all; if
    not, its value at a bound is meaningless. An interval is given up to a standard error of ``vaguest``, of a logarithm; it is
    that of Student's t with ``freedom`` degrees of freedom.
    """
    own = centre if own is None else own
    bound = (own <= np.array(slot.low) + _TOUCHING) | (own >= np.array(slot.high) - _TOUCHING)
    half = spread * (NORMAL_95 if np.isinf(freedom) else float(special.stdtrit(freedom, 0.975)))
    value, low, high, std = centre, centre - half, centre + half, spread
    if slot.log:
        value = np.exp(centre)
        low, high, std = np.exp(low), np.exp(np.minimum(high, _LARGEST)), value * spread

    def shaped(v):
        return np.reshape(v, slot.shape) if slot.shape else float(v[0])

    finite = bool(np.all(np.isfinite(spread)))
    identifiable = bool(determined and finite and not np.any(vague(slot.log, spread)))
    known = finite and not np.any(vague(slot.log, spread, vaguest))
    error, least, most = (shaped(v) if known else None for v in (std, low, high))
    return Estimate(shaped(value), error, least, most, identifiable, bool(np.any(bound) and seen), unit_of(slot.name))


def vague(logs, std: Float[np.ndarray, " n"], most: float = VAGUE) -> Bool[np.ndarray, " n"]:
    """Which numbers are logarithms whose standard error exceeds ``most``."""
    return np.asarray(logs, bool) & (std > most)


def unit_of(name: str) -> str:
    """Unit of an unknown by its name."""
    kind, _, parameter = split_name(name)
    return (kind_format(kind).parameter(parameter) if kind else CABLE[name]).unit


def two_digits(value: float, sign: bool = False) -> str:
    """``value`` with two significant digits, never with an exponent, and optionally its sign; ``<0.001`` for less."""
    if 0.0 < abs(value) < _LEAST:
        return f"<{_LEAST:g}"
    return np.format_float_positional(value, precision=2, unique=False, fractional=False, trim="-", sign=sign)


def _plain(value):
    return float(value) if np.ndim(value) == 0 else np.asarray(value).tolist()
