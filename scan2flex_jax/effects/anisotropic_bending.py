"""Anisotropic bending: the bending stiffness differs between two axes of the cross section (a flat or two-core cable).

Bending about ``a = cos(angle) d1 + sin(angle) d2`` keeps k_EI; about the other axis ``b`` it has ``ratio`` times k_EI:
``K -> A K A`` with ``A = 1 + (sqrt(ratio) - 1) b b'``. This form is exact for equal stiffnesses and stays positive for
others. ``angle`` in rad. Null: ratio 1 (where the angle is unidentifiable).
"""

import functools
import math
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.entry import CatalogueEntry, Context
from scan2flex_jax.effects.format import leaf, parameter
from scan2flex_jax.rod.effect import AbstractEffect, Section


class AnisotropicBending(AbstractEffect):
    """Bending stiffness ``ratio`` (-) times as large about the axis at ``angle`` + 90 degrees (rad, from d1)."""

    kind: ClassVar[str] = "anisotropic_bending"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "bending stiffness differs between two axes of the cross section"
    ratio: Float[Array, ""] = parameter("-", domain="positive")
    angle: Float[Array, ""] = parameter("rad")

    def section(self, section: Section, length: Float[Array, ""]) -> Section:
        """Sections with anisotropic stiffness."""
        b = jnp.stack([-jnp.sin(self.angle), jnp.cos(self.angle)])
        stretch = jnp.eye(6).at[3:5, 3:5].add((jnp.sqrt(self.ratio) - 1.0) * jnp.outer(b, b))
        return eqx.tree_at(lambda x: x.stiffness, section, stretch @ section.stiffness @ stretch)


_SERIES = [np.array([1.0 / math.factorial(2 * k), 1.0 / math.factorial(2 * k + 1)]) for k in reversed(range(10))]  # of t^k


class BendingSplit(AbstractEffect):
    """`anisotropic_bending` at a fixed geometric mean: ``split`` (-) is log(ratio) (cos 2 angle, sin 2 angle).

    The stiffness about the axis at ``angle`` is ``EI/sqrt(ratio)``, about the other one ``EI sqrt(ratio)``: ``A K A``
    with ``A = exp(-M/4)``, ``M = [[p, q], [q, -p]]``, whose square is ``p^2 + q^2``, so the series are even and
    smooth at 0.
    """

    split: Float[Array, "2"] = leaf(2)

    def section(self, section: Section, length: Float[Array, ""]) -> Section:
        """Sections with anisotropic stiffness."""
        p, q = self.split
        t = self.split @ self.split / 16.0
        cosh, sinhc = functools.reduce(lambda sum, c: sum * t + c, _SERIES)
        A = cosh * jnp.eye(2) - 0.25 * sinhc * jnp.stack([jnp.stack([p, q]), jnp.stack([q, -p])])
        stretch = jnp.eye(6).at[3:5, 3:5].set(A)
        return eqx.tree_at(lambda x: x.stiffness, section, stretch @ section.stiffness @ stretch)

    def reported(self, context: Context) -> dict[str, Array]:
        """The parameters of the format."""
        p, q = self.split
        return {"ratio": jnp.exp(jnp.hypot(p, q)), "angle": 0.5 * jnp.arctan2(q, p)}


ENTRY = CatalogueEntry(
    AnisotropicBending, ("log ratio cos 2 angle", "log ratio sin 2 angle"),
    lambda c: np.full(2, 0.2),  # twenty per cent: a braid or an imperfectly round core; flat cables have more
    build=lambda a, site, c: (BendingSplit(a),),
    rescaled=lambda a, site, c: {"bending_stiffness": float(np.exp(-0.5 * np.hypot(a[0], a[1])))},
    bounds_of=lambda c: (np.full(2, -4.0), np.full(2, 4.0)),
    signature="a sideways shift that changes with the roll of the cable and comes back after 180 degrees",
    settle="scan one pose with both clamps rolled by 45 and by 90 degrees",
)  # fmt: skip
