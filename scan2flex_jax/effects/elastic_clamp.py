"""Elastic clamp: a grip that yields in rotation.

A spring of energy ``1/2 stiffness |theta|^2`` (N m/rad, one per end, infinite = rigid) lies between the clamp and the
end section. It is eliminated: the twist of the end element, ``x = ds xi``, gets the spring's compliance in series,

``ds K^-1 -> ds K^-1 + (1/stiffness) U U'``,  ``U`` = the columns of the inverse left (start) or right (end) Jacobian
that carry a rotation of the element's outer end into ``x`` (at its natural strain),

so the spring sits at the clamp and not in the middle of the element. The end frame stays at the clamp, no degree of freedom
is added, and a rigid grip is exactly the baseline model. The remaining error is of the order of
``ds theta^2`` (0.5 % of the angle at 0.7 rad with 16 elements). ``compliance`` (rad/(N m)) adds to ``1/stiffness``: it
is zero for a rigid grip and so has a derivative there. Null: infinite stiffness, no compliance.
"""

from dataclasses import replace
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.builders import ends, ends_without
from scan2flex_jax.effects.entry import CatalogueEntry, Context, SameShapes
from scan2flex_jax.effects.format import leaf, parameter
from scan2flex_jax.geometry import lie
from scan2flex_jax.rod.effect import AbstractEffect, Section
from scan2flex_jax.rod.element_law import stiffness_within
from scan2flex_jax.rod.energy import E3

_RIGID = 1e-12  # of the compliance of the cable


class ElasticClamp(AbstractEffect):
    """Rotational ``stiffness`` (N m/rad) of start and end grip; ``compliance`` (rad/(N m)) adds to its inverse."""

    kind: ClassVar[str] = "elastic_clamp"
    place: ClassVar[str] = "clamps"
    words: ClassVar[str] = "a grip yields in rotation"
    rank: ClassVar[int] = 3
    inert: ClassVar[float] = float("inf")
    stiffness: Float[Array, "2"] = parameter("N m/rad", per_end=True, domain="positive", default=float("inf"))
    compliance: Float[Array, "2"] = leaf(2, default=0.0)

    @property
    def total_compliance(self) -> Float[Array, "2"]:
        """Rotation per moment of each grip (rad/(N m))."""
        return 1.0 / self.stiffness + self.compliance

    def reported(self, context: Context | None) -> dict[str, Array]:
        """The parameters of the format; of a rigid grip that was fitted a large finite one."""
        least = 0.0 if context is None else _RIGID * context.length / context.bending_stiffness
        return {"stiffness": 1.0 / jnp.maximum(self.total_compliance, least)}

    def section(self, section: Section, length: Float[Array, ""]) -> Section:
        """End sections with the grips in series."""
        K, ds = section.stiffness, section.ds
        ends = np.array([0, -1])

        def less(sign, c, natural, K):
            U = lie.right_jacobian_inverse(sign * ds * (natural + jnp.array(E3)))[:, 3:]
            KU = K @ U
            softer = c * KU @ jnp.linalg.solve(ds * jnp.eye(3) + c * U.T @ KU, KU.T)
            return 0.5 * (softer + softer.T)

        both = jax.vmap(less)(np.array([-1.0, 1.0]), self.total_compliance, section.natural[ends], K[ends])
        return replace(section, stiffness=K.at[ends].add(-both), within=stiffness_within(K))


ENTRY = CatalogueEntry(
    ElasticClamp, ("compliance at start", "compliance at end"),
    lambda c: np.full(2, 0.02 * c.length / c.bending_stiffness),  # a grip as compliant as two per cent of the cable
    build=lambda a, site, c: (ElasticClamp(compliance=a * jnp.asarray(site["ends"])),),
    sites=ends, inactive_of=ends_without(1), one_sided=(True, True),
    signature="the cable leaves a clamp at an angle that grows with the moment there",
    settle="scan the edges of the clamps along with the cable, and measure the free length",
    same_shapes=(SameShapes("length_error", "when the position of the clamp's edge and the free length are not known"),
                 SameShapes("stiffness_profile", "a softer span at the clamp", always=True)),
)  # fmt: skip
