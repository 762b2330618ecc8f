"""Anisotropic bending: the bending stiffness differs between two axes of the cross section (a flat or two-core cable).

Bending about ``a = cos(angle) d1 + sin(angle) d2`` keeps k_EI, about the other axis ``b`` it has ``ratio`` times k_EI:
``K -> A K A`` with ``A = 1 + (sqrt(ratio) - 1) b b'``, which is that for equal stiffnesses and stays positive for
others. ``angle`` in rad. Null: ratio 1 (then the angle says nothing).
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects._fields import parameter
from scan2flex_jax.rod.effect import AbstractEffect, Section


class AnisotropicBending(AbstractEffect):
    """Bending stiffness ``ratio`` (-) times as large about the axis at ``angle`` + 90 degrees (rad, from d1)."""

    kind: ClassVar[str] = "anisotropic_bending"
    ratio: Float[Array, ""] = parameter()
    angle: Float[Array, ""] = parameter()

    def section(self, section: Section, length: Float[Array, ""]) -> Section:
        """Sections with anisotropic stiffness."""
        b = jnp.stack([-jnp.sin(self.angle), jnp.cos(self.angle)])
        stretch = jnp.eye(6).at[3:5, 3:5].add((jnp.sqrt(self.ratio) - 1.0) * jnp.outer(b, b))
        return eqx.tree_at(lambda x: x.stiffness, section, stretch @ section.stiffness @ stretch)
