"""Bending law: the moment over curvature in any form that grows, as tangent stiffness at points of a grid (`moment_law`).

``factor`` (-) is the tangent stiffness over EI, that at zero curvature, at each ``curvature`` (1/m) of a growing grid. It acts
along the curvature vector, on its size in excess of the natural one; with two bending stiffnesses on ``sqrt(k' K k / EI)``, EI
their mean. Null: all factors 1.
"""

from typing import ClassVar

from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.entry import CatalogueEntry, SameShapes
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.effects.moment_law import WALK, excess_energy, law
from scan2flex_jax.rod.effect import AbstractEffect


class BendingLaw(AbstractEffect):
    """Tangent bending stiffness ``factor`` (-) times that at zero curvature, at points ``curvature`` (1/m)."""

    kind: ClassVar[str] = "bending_law"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "the bending moment grows with curvature in a way of its own"
    curvature: Float[Array, " m"] = parameter("1/m", per_point=True, domain="positive", estimable=False)
    factor: Float[Array, " m"] = parameter("-", per_point=True, domain="positive", walk=WALK)

    def square(self, strain: Float[Array, "6"], stiffness: Float[Array, "6 6"]) -> Float[Array, ""]:
        """Square of the curvature (1/m^2) that the law acts on."""
        bending, curvature = stiffness[3:5, 3:5], strain[3:5]
        return curvature @ bending @ curvature / (0.5 * (bending[0, 0] + bending[1, 1]))

    def strain_energy(self, strain: Float[Array, "6"], stiffness: Float[Array, "6 6"]) -> Float[Array, ""]:
        """Energy per length (J/m) in addition to the quadratic one."""
        EI = 0.5 * (stiffness[3, 3] + stiffness[4, 4])
        return EI * excess_energy(self.square(strain, stiffness), self.curvature, self.factor)


ENTRY = CatalogueEntry(
    BendingLaw,
    **law(BendingLaw, "curvature", 3, lambda c: max(c.curvature_range[1], 0.1 / c.length)),
    signature="strongly bent places are softer or stiffer than gently bent ones, alike in every pose",
    settle="scan poses whose largest curvature is well below and well above where the law bends",
    same_shapes=(SameShapes("nonlinear_bending", "when it softens from one stiffness to another"),),
)  # fmt: skip
