"""Extensibility: the cable stretches.

``axial_stiffness`` (N) stands in for the cable's nearly rigid one; the mass counts per unstretched length. A cable that
hangs straight down becomes longer by ``rhoA g L^2 / (2 EA)``. Null: the cable's own axial stiffness.
"""

from typing import ClassVar

import equinox as eqx
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects._fields import parameter
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.effect import AbstractEffect


class Extensibility(AbstractEffect):
    """The true ``axial_stiffness`` (N)."""

    kind: ClassVar[str] = "extensibility"
    axial_stiffness: Float[Array, ""] = parameter()

    def cable(self, cable: Cable) -> Cable:
        """The cable with the true axial stiffness."""
        return eqx.tree_at(lambda c: c.axial_stiffness, cable, self.axial_stiffness)
