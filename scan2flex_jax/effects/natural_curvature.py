"""Natural curvature: the cable is bent (or twisted) at rest, uniformly along s.

``curvature`` is added to Omega_0 (1/m, about d1, d2, d3), so a section carries ``K_Omega (Omega - Omega_0)``. It
turns with the cable: rolling both clamps rolls it. Null: 0.
Source: paper, Eq. 3, which contains Omega_0 but sets it to zero.
"""

from typing import ClassVar

import equinox as eqx
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.builders import AXES
from scan2flex_jax.effects.entry import CatalogueEntry, SameShapes
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.rod.effect import AbstractEffect, Section


class NaturalCurvature(AbstractEffect):
    """Set curvature ``curvature`` (1/m) of the whole cable."""

    kind: ClassVar[str] = "natural_curvature"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "the cable is bent at rest, alike along s"
    curvature: Float[Array, "3"] = parameter("1/m", 3)

    def section(self, section: Section, length: Float[Array, ""]) -> Section:
        """Sections with the curvature added to their natural one."""
        return eqx.tree_at(lambda x: x.natural, section, section.natural.at[:, 3:].add(self.curvature))


ENTRY = CatalogueEntry(
    NaturalCurvature, AXES,
    lambda c: np.full(3, 0.5 / c.length),  # a cable off a drum keeps an arc of about thirty degrees in its length
    signature="a bow out of the plane of the pose, alike all along, that turns over when both clamps are rolled",
    settle="scan one pose again with both clamps rolled by 180 degrees, or with one end free",
    same_shapes=(
        SameShapes("clamp_rotation", "the part about d3 (natural twist) and a roll of one clamp", always=True),
        SameShapes("kink", "the part about d3 (natural twist) and a twist at one place", always=True),
        SameShapes("bend_twist_coupling", "in fewer than four poses, or in poses that lie in one plane"),
    ),
)  # fmt: skip
