"""Torsion law: the torque over twist in any form that grows, as tangent stiffness at points of a grid (`moment_law`).

``factor`` (-) is the tangent stiffness over GJ, that at zero twist, at each ``twist`` (rad/m) of a growing grid. It acts on
the size of the twist in excess of the natural one. Null: all factors 1.
"""

from typing import ClassVar

import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.entry import CatalogueEntry
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.effects.moment_law import WALK, excess_energy, law
from scan2flex_jax.rod.effect import AbstractEffect


class TorsionLaw(AbstractEffect):
    """Tangent torsional stiffness ``factor`` (-) times that at zero twist, at points ``twist`` (rad/m)."""

    kind: ClassVar[str] = "torsion_law"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "the torque grows with twist in a way of its own"
    twist: Float[Array, " m"] = parameter("1/m", per_point=True, domain="positive", estimable=False)
    factor: Float[Array, " m"] = parameter("-", per_point=True, domain="positive", walk=WALK)

    def square(self, strain: Float[Array, "6"], stiffness: Float[Array, "6 6"]) -> Float[Array, ""]:
        """Square of the twist (1/m^2) that the law acts on."""
        return strain[5] ** 2

    def strain_energy(self, strain: Float[Array, "6"], stiffness: Float[Array, "6 6"]) -> Float[Array, ""]:
        """Energy per length (J/m) in addition to the quadratic one."""
        return stiffness[5, 5] * excess_energy(self.square(strain, stiffness), self.twist, self.factor)


ENTRY = CatalogueEntry(
    TorsionLaw,
    **law(TorsionLaw, "twist", 5, lambda c: 2.0 * np.pi / c.length),  # one turn along the cable
    signature="strongly twisted poses look softer or stiffer in torsion than gently twisted ones",
    settle="turn one clamp by several full turns, a pose at each",
)  # fmt: skip
