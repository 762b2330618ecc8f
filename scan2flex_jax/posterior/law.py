"""The moment laws of a fit: bending or torsion moments over the strains that the poses reached, with their bands.

Symbols: ``q`` curvature or twist (1/m), ``m`` moment (N m), ``B`` stiffness at zero strain (N m^2), ``f = (dm/dq)/B`` tangent
stiffness over it (-), whose logarithm is a random walk along the grid (`effects.moment_law`). The 95 % band of ``m`` is that of
``log m`` to first order in all estimates: shapes determine the moment far better than its slope. What is read off a law has,
about its value, the width in logarithms of 95 % of draws from the normal distribution of the estimates.

*Linear*: the gain over the fit with all steps of the walk zero is no larger than noise makes it
(`quantities.linear_p_value`).

Read off a law that is not linear, over the strains reached, which end at ``q_top``, with ``f_end`` the mean of ``f`` over the
upper half of them:

*softening*, *hardening*  ``f_end``, where its interval lies below 1, or above;
*knee*  the smallest ``q`` at which ``log f`` has gone half its way from zero to ``log f_end``;
*break-point moment*  ``m`` at the knee;
*slip plateau*  where the interval of ``f_end`` lies below `PLATEAU`: the mean of ``m`` from the smallest ``q`` on at which
``f`` is below `PLATEAU`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np

from scan2flex_jax.effects import BendingLaw, TorsionLaw
from scan2flex_jax.effects.moment_law import excess_moment, tangent
from scan2flex_jax.fitting.parameters import Layout, values_of
from scan2flex_jax.posterior.estimate import NORMAL_95
from scan2flex_jax.rod.energy import excess_strains
from scan2flex_jax.rod.model import Configuration, Rod
from scan2flex_jax.study.model import Study

PLATEAU = 0.2
_DRAWS = 2000
_POINTS = 241  # of a law as it is drawn
_BAND = (2.5, 97.5)  # per cent
_SIGNIFICANT, _LEAST = 0.05, 0.001  # p-value, and the smallest one printed
STIFFNESS = {BendingLaw.kind: "bending_stiffness", TorsionLaw.kind: "torsional_stiffness"}
_GRID = {BendingLaw.kind: "curvature", TorsionLaw.kind: "twist"}
KINDS = tuple(_GRID)


@dataclass(frozen=True)
class Reading:
    """One property read off a law, with its 95 % interval; ``unit`` "-" for a ratio."""

    name: str
    value: float
    low: float
    high: float
    unit: str

    def __str__(self) -> str:
        """``knee 2.1 [1.9, 2.4] 1/m``."""
        unit = "" if self.unit == "-" else f" {self.unit}"
        return f"{self.name} {self.value:.3g} [{self.low:.3g}, {self.high:.3g}]{unit}"


@dataclass(frozen=True)
class Law:
    """One law with its band: ``moment``, ``low`` and ``high`` (k,) in N m at strains ``at`` (k,) in 1/m, and whether the poses
    ``reached`` each (k,); ``stiffness`` (N m^2) at zero strain. ``p_value``: probability of such a gain over the linear law if
    the law is linear; None for a law that is given, or of a fit that has not settled. ``absolute``: whether the poses
    determine the stiffness at zero strain; else the band is that of the law's form alone."""

    kind: str
    at: np.ndarray
    moment: np.ndarray
    low: np.ndarray = field(repr=False)
    high: np.ndarray = field(repr=False)
    reached: np.ndarray = field(repr=False)
    stiffness: float
    p_value: float | None
    absolute: bool
    readings: tuple[Reading, ...]

    @property
    def linear(self) -> bool:
        """Whether a linear law explains the poses as well."""
        return self.p_value is not None and self.p_value > _SIGNIFICANT

    @property
    def strain(self) -> str:
        """What the law is a function of."""
        return _GRID[self.kind]

    def sentences(self) -> tuple[str, ...]:
        """The law in words."""
        if self.p_value is None:
            return ()
        if not np.any(self.reached):
            return (f"{self.kind}: no fitted pose has a {self.strain} in its grid: nothing is known of it",)
        top = f"up to {self.at[self.reached][-1]:.3g} 1/m, the largest {self.strain} reached"
        p = f"p = {self.p_value:.2g}" if self.p_value >= _LEAST else f"p < {_LEAST}"
        if self.linear:
            return (f"{self.kind}: linear {top} ({p})",)
        said = ", ".join(map(str, self.readings)) or "neither softer nor stiffer at the end"
        out = f"{self.kind}: not linear {top} ({p}): {said}"
        return (out,) if self.absolute else (out, f"{self.kind}: its form is known, its size is not: moments are relative")

    def to_json(self) -> dict:
        """The law as numbers and lists."""
        arrays = {"moment": self.moment, "low": self.low, "high": self.high, "reached": self.reached}
        known = {} if self.p_value is None else {"p_value": self.p_value, "linear": self.linear}
        readings = {r.name: {"value": r.value, "low": r.low, "high": r.high, "unit": r.unit} for r in self.readings}
        return {
            "kind": self.kind, self.strain: self.at.tolist(), **{k: v.tolist() for k, v in arrays.items()}, **known,
            "stiffness": self.stiffness, "absolute": self.absolute, "readings": readings,
        }  # fmt: skip


def _drawn(layout, x, covariance):
    """The unknowns at the minimum, then drawn: each (1 + draws, ...), by name. A number that is not determined stays."""
    known = np.where(np.isfinite(covariance), covariance, 0.0)
    variance, vectors = np.linalg.eigh(known)
    moves = np.random.default_rng(0).standard_normal((_DRAWS, len(known))) * np.sqrt(np.maximum(variance, 0.0)) @ vectors.T
    drawn = x[: layout.unknowns] + np.concatenate([np.zeros((1, len(known))), moves])
    each = [values_of(layout, row) for row in drawn]
    return {name: np.stack([one[name] for one in each]) for name in each[0]}


def law_at(
    kind: str, study: Study, layout: Layout, x: np.ndarray, covariance: np.ndarray, poses: Sequence[tuple[Rod, Configuration]],
    p_value: Callable[[float], float | None],
) -> Law:
    """The law ``kind``, one of `KINDS`, that a study declares, at the unknowns ``x`` (b,) of its ``layout``.

    ``covariance`` (b, b): of these. ``poses``: rods and their equilibria there. ``p_value(secant)``: `Law.p_value`, given the
    law's secant stiffness (N m^2).
    """
    values, name = _drawn(layout, x, covariance), STIFFNESS[kind]
    grid = np.asarray(study.given(f"{kind}.{_GRID[kind]}"), float)
    factor, B = _known_or_drawn(study, values, f"{kind}.factor"), _known_or_drawn(study, values, name)
    B = np.mean(B.reshape(len(B), -1), axis=1)  # of two bending stiffnesses the mean
    count = max(len(factor), len(B))
    factor, B = np.broadcast_to(factor, (count, len(grid))), np.broadcast_to(B, (count,))
    spans = _spans(kind, poses)
    top = max((high for _, high in spans), default=0.0)
    at = np.linspace(0.0, max(grid[-1], top), _POINTS)
    m, f = _moments(at, grid, factor, B)
    reached = np.any([(low <= at) & (at <= high) for low, high in spans], axis=0) if spans else np.zeros(len(at), bool)
    spread = NORMAL_95 * _spread(kind, layout, x, covariance, (at, grid, factor[0], B[0]))
    p = p_value(float(m[0, -1] / at[-1]))
    bent = p is not None and p <= _SIGNIFICANT and np.sum(at <= top) > 1
    readings = _readings(at[at <= top], m[:, at <= top], f[:, at <= top]) if bent else ()
    slot = _slot(layout, name)
    absolute = slot is None or bool(np.all(np.isfinite(np.diag(covariance)[slot.at : slot.at + slot.size])))
    return Law(kind, at, m[0], m[0] * np.exp(-spread), m[0] * np.exp(spread), reached, float(B[0]), p, absolute, readings)


def _slot(layout, name):
    return next((slot for slot in layout.slots if slot.name == name), None)


def _known_or_drawn(study, values, name):
    """A quantity at the minimum and as drawn, (n, ...); n is 1 where it is no unknown."""
    return values[name] if name in values else np.asarray(study.given(name), float)[None]


@jax.jit
def _laws(at, grid, factor, B):
    m = jax.vmap(lambda f, b: b * (at + excess_moment(at, grid, f)))(factor, B)
    return m, jax.vmap(lambda f: tangent(at, grid, f))(factor)


def _moments(at, grid, factor, B):
    """Moment (n, k) in N m and tangent stiffness over that at zero (n, k) of drawn laws."""
    return tuple(map(np.asarray, _laws(jnp.asarray(at), jnp.asarray(grid), jnp.asarray(factor), jnp.asarray(B))))


def _spread(kind, layout, x, covariance, law):
    """Standard deviation (k,) of ``log m`` to first order; of the stiffness at zero strain where ``m`` is zero."""
    at, grid, factor, B = map(jnp.asarray, law)
    slots = {"factor": _slot(layout, f"{kind}.factor"), "B": _slot(layout, STIFFNESS[kind])}

    def log_moment(x):
        own = {name: slot.value(x[slot.at : slot.at + slot.size]) for name, slot in slots.items() if slot is not None}
        f, b = own.get("factor", factor), jnp.mean(own.get("B", B))
        return jnp.log(b) + jnp.log(jnp.where(at > 0, 1.0 + excess_moment(at, grid, f) / jnp.where(at > 0, at, 1.0), 1.0))

    J = np.asarray(jax.jacfwd(log_moment)(jnp.asarray(x[: layout.unknowns])))
    known = np.where(np.isfinite(covariance), covariance, 0.0)
    return np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", J, known, J), 0.0))


def _spans(kind, poses):
    """Smallest and largest strain (1/m) in each fitted pose in which a law acts; along a cable all between them are met."""
    out = []
    for rod, configuration in poses:
        law = next((e for e in rod.effects if getattr(e, "kind", None) == kind), None)
        if law is not None:
            excess = excess_strains(rod, configuration)
            q = np.sqrt(np.maximum(np.asarray(jax.vmap(law.square)(excess, rod.section.stiffness)), 0.0))
            out.append((float(q.min()), float(q.max())))
    return out


def _readings(q, m, f):
    """What is read off draws of a law (n, k) over the strains reached (k,), of which the first is the estimate."""
    end, logs = np.mean(f[:, q >= 0.5 * q[-1]], axis=1), np.log(f)
    low, high = np.percentile(end, _BAND)
    if low <= 1.0 <= high:
        return ()
    rows = np.arange(len(f))
    half = np.argmax(np.sign(end - 1.0)[:, None] * logs >= 0.5 * np.abs(np.log(end))[:, None], axis=1)
    out = [_reading("softening" if high < 1.0 else "hardening", end, "-"), _reading("knee", q[half], "1/m")]
    out.append(_reading("break-point moment", m[rows, half], "N m"))
    if high < PLATEAU:
        flat = np.cumsum(f < PLATEAU, axis=1) > 0
        with np.errstate(invalid="ignore"):
            out.append(_reading("slip plateau", np.sum(m * flat, axis=1) / np.sum(flat, axis=1), "N m"))
    return tuple(out)


def _reading(name, drawn, unit):
    low, high = np.log(np.nanpercentile(drawn, _BAND))
    factor = np.exp(0.5 * (high - low))
    return Reading(name, float(drawn[0]), float(drawn[0] / factor), float(drawn[0] * factor), unit)
