"""Changes of the base model that are linear where a kind of the format is not: for the catalogue's amplitudes.

They are not declared in studies; the catalogue builds them so that an amplitude of zero is exactly the base model,
whatever the cable's own parameters are, and reports them as the kind that they stand for.
"""

import math

import equinox as eqx
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects._fields import parameter
from scan2flex_jax.effects.tether import TINY, place_on_cable
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.effect import AbstractEffect, Node, Section


class LengthFactor(AbstractEffect):
    """A `length_error` relative to the cable's own length: ``L exp(log_factor)``."""

    log_factor: Float[Array, ""] = parameter()

    def cable(self, cable: Cable) -> Cable:
        """The cable with the true length."""
        return eqx.tree_at(lambda c: c.length, cable, cable.length * jnp.exp(self.log_factor))


class AxialCompliance(AbstractEffect):
    """An `extensibility` beyond the cable's own: ``1/EA + compliance`` (1/N)."""

    compliance: Float[Array, ""] = parameter()

    def cable(self, cable: Cable) -> Cable:
        """The cable with the true axial stiffness."""
        EA = cable.axial_stiffness / (1.0 + self.compliance * cable.axial_stiffness)
        return eqx.tree_at(lambda c: c.axial_stiffness, cable, EA)


class AnchoredSpring(AbstractEffect):
    """A `tether` by its ``pull`` (N) on the cable at ``position`` when that is at ``centre``: both numbers may be zero.

    With ``reach`` 0 its rest length is zero, and the energy is ``1/2 k |r - centre|^2 - pull . (r - centre)``, linear in the
    ``stiffness`` k (N/m) and the pull. Otherwise it is anchored at ``reach`` from the centre towards the pull, and the energy
    is ``(k (d - reach) + |pull|)^2/(2 k)`` at the distance d from there, zero where it is slack. Places and lengths in m.
    """

    position: Float[Array, ""] = parameter()
    centre: Float[Array, "3"] = parameter(3)
    stiffness: Float[Array, ""] = parameter()
    pull: Float[Array, "3"] = parameter(3)
    reach: Float[Array, ""] = parameter(default=0.0)

    def node_potential(self, node: Node) -> Float[Array, ""]:
        """Energy (J) of the spring, as far as it hangs on this node."""
        point, weight = place_on_cable(node, self.position)
        span, k, string = point - self.centre, self.stiffness, self.reach > 0
        tension = jnp.sqrt(self.pull @ self.pull + TINY)
        away = span - self.reach * self.pull / tension
        longer = jnp.sqrt(away @ away + TINY) - self.reach
        taut = jnp.maximum(k * longer + tension, 0.0) ** 2 / jnp.where(string, 2.0 * k, 1.0)
        return weight * jnp.where(string, taut, 0.5 * k * span @ span - self.pull @ span)


class BendingSplit(AbstractEffect):
    """`anisotropic_bending` at a fixed geometric mean: ``split`` (-) is log(ratio) (cos 2 angle, sin 2 angle).

    The stiffness about the axis at ``angle`` is ``EI/sqrt(ratio)``, about the other one ``EI sqrt(ratio)``: ``A K A``
    with ``A = exp(-M/4)``, ``M = [[p, q], [q, -p]]``, whose square is ``p^2 + q^2``, so the series are even and
    smooth at 0.
    """

    split: Float[Array, "2"] = parameter(2)

    def section(self, section: Section, length: Float[Array, ""]) -> Section:
        """Sections with anisotropic stiffness."""
        p, q = self.split
        t = self.split @ self.split / 16.0
        cosh = sum(t**k / math.factorial(2 * k) for k in range(10))
        sinhc = sum(t**k / math.factorial(2 * k + 1) for k in range(10))
        A = cosh * jnp.eye(2) - 0.25 * sinhc * jnp.stack([jnp.stack([p, q]), jnp.stack([q, -p])])
        stretch = jnp.eye(6).at[3:5, 3:5].set(A)
        return eqx.tree_at(lambda x: x.stiffness, section, stretch @ section.stiffness @ stretch)
