"""Tension stiffening: bending stiffness grows with tension, ``EI + gain N``.

A law with an energy must then also shorten the cable when it bends (Maxwell), by ``gain k^2/2`` per length at the
curvature k: ``1/2 EA (epsilon + gain k^2/2)^2 + 1/2 EI k^2``, of which this is the part in addition to the quadratic
one. This is the stiffening of a bundle of wires off the axis, with ``gain`` (m^2) of the size of the squared
radius. Stiffening by friction between layers, which can be far larger, has no energy and is not covered. Null: 0.
"""

from typing import ClassVar

import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.entry import CatalogueEntry
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.rod.effect import AbstractEffect


class TensionStiffening(AbstractEffect):
    """Bending stiffness per tension ``gain`` (m^2)."""

    kind: ClassVar[str] = "tension_stiffening"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "bending stiffens under tension"
    gain: Float[Array, ""] = parameter("m^2")

    def strain_energy(self, strain: Float[Array, "6"], stiffness: Float[Array, "6 6"]) -> Float[Array, ""]:
        """Energy per length (J/m) in addition to the quadratic one."""
        shortening = 0.5 * self.gain * (strain[3] ** 2 + strain[4] ** 2)
        return stiffness[2, 2] * shortening * (strain[2] + 0.5 * shortening)


ENTRY = CatalogueEntry(
    TensionStiffening, ("gain",),
    lambda c: np.array([c.radius_or_guess**2]),  # wires at the radius
    one_sided=(True,),
    signature="tight poses bend less than slack ones, and bent ones are shorter",
    settle="scan poses whose tension differs threefold",
)  # fmt: skip
