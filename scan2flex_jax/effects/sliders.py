"""Dry friction inside the cable: sliders in parallel with an elastic rest (Prandtl and Ishlinskii).

``x`` (1/m) is a strain of the section (curvature vector or twist), ``B`` (N m^2) its stiffness. A part ``share`` of ``B`` is
carried by ``N`` sliders of equal stiffness, in parallel with the elastic rest ``(1 - share) B``. Slider ``i`` sits at ``q_i``
(1/m) and carries ``share B / N`` times ``x - q_i`` up to its threshold ``r_i``, beyond which it follows (radial return). Given
the positions that the last pose left, a pose has the energy

    1/2 (1 - share) B |x|^2 + share B / N  sum_i H(|x - q_i|; r_i),

with Huber's function ``H``, and leaves ``q_i' = x - g(|x - q_i|; r_i) (x - q_i)/|x - q_i|``, ``g = H'``. The thresholds are
spread evenly (`SPREAD`) about their mean, ``threshold``: loading from the start bends the cable along a smooth curve to the
full friction moment ``share B threshold``, as strands do that slip one after the other; one slider (``spread=(1.0,)``) makes a
sharp knee. Whatever the thresholds, Masing's rule holds: a return branch is the first loading, twice as large.

Before the first pose all sliders sit at ``initial_set`` (1/m), alike along the cable: zero for a new cable. One that comes from
a drum, free of loads, is bent by ``share initial_set`` as long as no slider slips, and by less where they do.

Huber's knee, in which the stiffness jumps, is rounded over `ROUNDING` of the threshold on either side by a parabola in ``g``:
the energy is twice continuously differentiable, so that Newton's method converges and derivatives exist in every pose. Only a
short range is rounded because a rounded knee is not idempotent: a slider that has just slipped loses a quarter of the rounding
(1 %) of its force if the same pose is solved again, and tends to lose all of it (4 %) in many. A hyperbola in place of Huber's
function would lose a third at once.
"""

import abc
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from scan2flex_jax.rod.memory import AbstractMemory

SPREAD = (0.25, 0.75, 1.25, 1.75)  # thresholds of the sliders over their mean: evenly from 0 to 2, by the midpoint rule
ROUNDING = 0.04  # of a threshold, on either side of it
BEGUN_SHARE = 0.4  # of the stiffness: share at which a fit begins
BEGUN_AT = (0.15, 0.5, 1.5)  # of a typical strain: thresholds at which a fit begins, since a cost has a minimum at several


def huber(
    u: Float[Array, "..."], threshold: Float[Array, "..."], rounding: float = ROUNDING
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Rounded Huber function ``H`` (1/m^2) and ``g(r)/r`` (-) at ``u = r^2`` (1/m^2), smooth at zero."""
    low, high, width = (1.0 - rounding) * threshold, (1.0 + rounding) * threshold, 2.0 * rounding * threshold
    stuck = u <= low**2
    r = jnp.sqrt(jnp.where(stuck, low**2, u))  # no square root at zero, where its derivatives have no limit
    past = r >= high
    t = jnp.where(past, width, r - low)
    turned = jnp.where(past, high, r)
    H = 0.5 * turned**2 - t**3 / (6.0 * width) + jnp.where(past, threshold * (r - high), 0.0)
    g = turned - t**2 / (2.0 * width)
    return jnp.where(stuck, 0.5 * u, H), jnp.where(stuck, 1.0, g / r)


class AbstractSliders(AbstractMemory):
    """Base of friction effects: ``share`` (-) of the stiffness that slips, at a mean ``threshold`` (1/m)."""

    share: eqx.AbstractVar[Float[Array, ""]]
    initial_set: eqx.AbstractVar[Float[Array, "..."]]
    spread: tuple[float, ...] = eqx.field(default=SPREAD, kw_only=True, static=True)
    rounding: float = eqx.field(default=ROUNDING, kw_only=True, static=True)
    size: ClassVar[int]

    @property
    @abc.abstractmethod
    def threshold(self) -> Float[Array, ""]:
        """Mean threshold (1/m) of the sliders."""

    @abc.abstractmethod
    def part(self, strain: Float[Array, "6"], stiffness: Float[Array, "6 6"]) -> tuple[Array, Array, Array]:
        """The strain ``x`` (k,) in 1/m that slips, its stiffness ``B`` (N m^2), and the metric (k, k) of its size."""

    def without_history(self, elements: int) -> Float[Array, "n sliders k"]:
        """All sliders at the natural shape."""
        return jnp.zeros((elements, len(self.spread), self.size))

    def at_first(self, elements: int) -> Float[Array, "n sliders k"]:
        """All sliders at the initial set."""
        return jnp.broadcast_to(self.initial_set, (elements, len(self.spread), self.size))

    def energy_given(
        self, strain: Float[Array, "6"], stiffness: Float[Array, "6 6"], left: Float[Array, "sliders k"]
    ) -> Float[Array, ""]:
        """Energy per length (J/m) in addition to the quadratic one."""
        x, B, metric = self.part(strain, stiffness)
        H, _ = huber(_squares(x - left, metric), jnp.asarray(self.spread) * self.threshold, self.rounding)
        return self.share * B * (jnp.mean(H) - 0.5 * x @ metric @ x)

    def leaves(
        self, strain: Float[Array, "6"], stiffness: Float[Array, "6 6"], left: Float[Array, "sliders k"], held: Float[Array, ""]
    ) -> Float[Array, "sliders k"]:
        """Positions (1/m) of the sliders after the pose, however long it was held."""
        x, _, metric = self.part(strain, stiffness)
        _, kept = huber(_squares(x - left, metric), jnp.asarray(self.spread) * self.threshold, self.rounding)
        return x - kept[:, None] * (x - left)


def _squares(x, metric):
    return jax.vmap(lambda v: v @ metric @ v)(x)
