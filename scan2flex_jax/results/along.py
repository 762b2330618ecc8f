"""EI along the cable with its band, where a declared effect or one that was found lets the stiffness vary.

GJ varies by the same factor. The band is that of the logarithm to first order in all parameters together: the EI of the middle
and the field trade against one another where no pose bends the middle, and EI(s) is what the shapes tell.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from scan2flex_jax.effects.stiffness_field import StiffnessField
from scan2flex_jax.effects.stiffness_profile import StiffnessProfile
from scan2flex_jax.effects.stiffness_taper import StiffnessTaper
from scan2flex_jax.posterior.posterior import Fitted
from scan2flex_jax.posterior.quantities import averaging, known
from scan2flex_jax.results.answer import UNBELIEVED

VARYING = (StiffnessField.kind, StiffnessTaper.kind, StiffnessProfile.kind)
_SHOWN = 5  # places, evenly spaced, at which a summary tells EI
_VAGUE = 5.0  # factor above which the end of a band is no number to print


@dataclass(frozen=True)
class StiffnessAlong:
    """``bending`` stiffness (k,) in N m^2 at arc lengths ``s`` (k,) in m, its 95 % band from ``low`` to ``high``, and its
    ``factor`` (k,) over that of the middle, which is GJ's too. ``absolute``: whether the poses determine its size; else the
    band is that of the form alone."""

    s: np.ndarray
    bending: np.ndarray
    low: np.ndarray = field(repr=False)
    high: np.ndarray = field(repr=False)
    factor: np.ndarray = field(repr=False)
    absolute: bool = True

    def withheld(self) -> "StiffnessAlong":
        """Without its band, which holds for a model that is believed only."""
        return replace(self, low=np.full_like(self.low, np.nan), high=np.full_like(self.high, np.nan))

    def at(self, s: float | np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """EI (N m^2) at arc lengths ``s`` (m), and the ends of its band."""
        bending, low, high = (np.exp(np.interp(s, self.s, np.log(x))) for x in (self.bending, self.low, self.high))
        return bending, low, high

    def sentences(self) -> tuple[str, ...]:
        """EI at some places, in words."""
        places = np.linspace(self.s[0], self.s[-1], _SHOWN)
        said = [f"{x[0]:.3g} {_band(*x)} at {s:.3g} m" for s, x in zip(places, zip(*self.at(places), strict=True), strict=True)]
        relative = "" if self.absolute else "; its form is known, its size is not"
        return (f"EI along the cable (N m^2): {', '.join(said)}{relative}",)

    def to_json(self) -> dict:
        """Lists, under the names of the fields; without a band that is withheld."""
        arrays = {"s": self.s, "bending": self.bending, "low": self.low, "high": self.high, "factor": self.factor}
        known = {name: x.tolist() for name, x in arrays.items() if np.all(np.isfinite(x))}
        return known | {"absolute": self.absolute}


def withheld(result: Any) -> Any:
    """A fit or an explanation that is not believed, without its intervals."""
    along = None if result.along is None else result.along.withheld()
    return replace(result, estimates={n: e.withheld() for n, e in result.estimates.items()}, along=along)


def _band(value, low, high):
    if not np.isfinite(high):
        return UNBELIEVED
    return f"[{low:.2g}, {high:.2g}]" if high < _VAGUE * value else "(not determined)"


def stiffness_along(best: Fitted, averaged: tuple[Fitted, ...]) -> StiffnessAlong | None:
    """EI along the cable at the best hypothesis; its band averages over all likely ones, by their evidence, as intervals do.

    None where no effect lets it vary.
    """
    declared = {effect.kind for effect in best.variant.study.effects}
    if not (declared | set(best.kinds)) & set(VARYING):
        return None
    hypotheses, weights, quantile = averaging(best, averaged)
    found = [_logs(h) for h in hypotheses]
    centre = dict(zip(map(id, hypotheses), found, strict=True))[id(best)][1]
    spread = np.sqrt(sum(w * (v + (x - centre) ** 2) for w, (_, x, v) in zip(weights, found, strict=True)))
    s = found[0][0]
    EI, half = np.exp(centre), quantile * spread
    middle = np.exp(np.interp(0.5 * best.variant.length, s, centre))
    names = [slot.name for slot in best.variant.program.layout.slots for _ in range(slot.size)]
    absolute = all(ok for name, ok in zip(names, known(best).identifiable, strict=True) if name == "bending_stiffness")
    return StiffnessAlong(s, EI, EI * np.exp(-half), EI * np.exp(half), EI / middle, absolute)


def _logs(h: Fitted) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Arc lengths (m) of the elements' middles, the logarithm of EI there, and its variance."""
    section, slopes = h.variant.program.section(h.components, h.x)
    EI, own = np.asarray(section.within), h.index.of_pose(0)
    EI, slopes = (0.5 * (K[..., 0, 0] + K[..., 1, 1]) for K in (EI, np.asarray(slopes.within)))
    J = slopes / EI
    C = np.nan_to_num(h.covariance[np.ix_(own, own)], posinf=0.0)
    lost = np.flatnonzero(~known(h).identifiable)
    C[lost, :] = C[:, lost] = 0.0
    return np.asarray(section.s), np.log(EI), np.maximum(np.einsum("ik,ij,jk->k", J, C, J), 0.0)
