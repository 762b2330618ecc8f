"""Length error: the length between the clamps is not the nominal one.

``length`` (m) stands in for the cable's; the mass per length stays. Null: the nominal length.
"""

from typing import ClassVar

import equinox as eqx
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects._fields import parameter
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.effect import AbstractEffect


class LengthError(AbstractEffect):
    """The true ``length`` (m) between the clamps."""

    kind: ClassVar[str] = "length_error"
    length: Float[Array, ""] = parameter()

    def cable(self, cable: Cable) -> Cable:
        """The cable with the true length."""
        return eqx.tree_at(lambda c: c.length, cable, self.length)
