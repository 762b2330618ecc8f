"""Length error: the length between the clamps is not the nominal one.

``length`` (m) replaces the cable's; the mass per length is unchanged. Null: the nominal length.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.entry import CatalogueEntry, Context, SameShapes
from scan2flex_jax.effects.format import leaf, parameter
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.effect import AbstractEffect


class LengthError(AbstractEffect):
    """The true ``length`` (m) between the clamps."""

    kind: ClassVar[str] = "length_error"
    place: ClassVar[str] = "clamps"
    words: ClassVar[str] = "the length between the clamps is not the nominal one"
    length: Float[Array, ""] = parameter("m", domain="positive")

    def cable(self, cable: Cable) -> Cable:
        """The cable with the true length."""
        return eqx.tree_at(lambda c: c.length, cable, self.length)


class LengthFactor(AbstractEffect):
    """A `length_error` relative to the cable's own length: ``L exp(log_factor)``."""

    log_factor: Float[Array, ""] = leaf()

    def cable(self, cable: Cable) -> Cable:
        """The cable with the true length."""
        return eqx.tree_at(lambda c: c.length, cable, cable.length * jnp.exp(self.log_factor))

    def reported(self, context: Context) -> dict[str, Array]:
        """The parameters of the format."""
        return {"length": context.length * jnp.exp(self.log_factor)}


ENTRY = CatalogueEntry(
    LengthError, ("log length",),
    lambda c: np.array([0.01]),  # one per cent: a cable that slid in its clamp, a tape measure on a coil
    build=lambda a, site, c: (LengthFactor(a[0]),),
    bounds_of=lambda c: (np.full(1, -0.3), np.full(1, 0.3)),
    signature="all poses sag too much or too little",
    settle="measure the length between the clamps",
    same_shapes=(SameShapes("elastic_clamp", "when the position of the clamp's edge is not known"),),
)  # fmt: skip
