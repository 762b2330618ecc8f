"""Extensibility: the cable stretches.

``axial_stiffness`` (N) replaces the cable's nearly rigid one; the mass is per unstretched length. A cable that
hangs straight down is longer by ``rhoA g L^2 / (2 EA)``. Null: the cable's own axial stiffness.
"""

from typing import ClassVar

import equinox as eqx
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.entry import CatalogueEntry, Context, SameShapes
from scan2flex_jax.effects.format import leaf, parameter
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.effect import AbstractEffect


class Extensibility(AbstractEffect):
    """The true ``axial_stiffness`` (N)."""

    kind: ClassVar[str] = "extensibility"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "the cable stretches"
    axial_stiffness: Float[Array, ""] = parameter("N", domain="positive")

    def cable(self, cable: Cable) -> Cable:
        """The cable with the true axial stiffness."""
        return eqx.tree_at(lambda c: c.axial_stiffness, cable, self.axial_stiffness)


class AxialCompliance(AbstractEffect):
    """An `extensibility` in addition to the cable's own: ``1/EA + compliance`` (1/N)."""

    compliance: Float[Array, ""] = leaf()

    def cable(self, cable: Cable) -> Cable:
        """The cable with the true axial stiffness."""
        return eqx.tree_at(lambda c: c.axial_stiffness, cable, self._with(cable.axial_stiffness))

    def reported(self, context: Context) -> dict[str, Array]:
        """The parameters of the format."""
        return {"axial_stiffness": self._with(context.axial_stiffness)}

    def _with(self, EA):
        return EA / (1.0 + self.compliance * EA)


ENTRY = CatalogueEntry(
    Extensibility, ("compliance",),
    lambda c: np.array([0.01 / c.force]),  # one per cent longer under its own forces: soft plastic, a loose braid
    build=lambda a, site, c: (AxialCompliance(a[0]),),
    one_sided=(True,),
    signature="tight poses are longer than slack ones",
    settle="scan one pose with the clamps pulled apart until the cable is nearly straight",
    same_shapes=(SameShapes("length_error", "when the tension is alike in all poses"),),
)  # fmt: skip
