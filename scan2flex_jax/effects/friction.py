"""Friction: part of the bending stiffness is carried by strands that slip, so the moment depends on the way to a pose.

``share`` (-) of the bending stiffness slips, at curvatures about ``slip_curvature`` (1/m) away from where it last stuck
(`sliders`). The curvature is a vector in excess of the natural one and has one size in all directions; with two bending
stiffnesses that is ``sqrt(k' K k / EI)``, EI their mean. ``bending_stiffness`` is that before anything slips, and
``share EI slip_curvature`` the full moment of friction. Null: share 0.

The poses of a study act in their order, from a cable without history on or from one with the curvature ``initial_set`` (1/m,
about d1 and d2, in excess of the natural one) as its set, and from a pose with ``reset`` without history again.
"""

from typing import ClassVar

import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.entry import SameShapes, entry_of_memory
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.effects.sliders import BEGUN_AT, BEGUN_SHARE, AbstractSliders


class Friction(AbstractSliders):
    """``share`` (-) of the bending stiffness slips at a mean ``slip_curvature`` (1/m), at first from ``initial_set`` (1/m)."""

    kind: ClassVar[str] = "friction"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "strands slip in bending: the moment depends on the way to a pose"
    size: ClassVar[int] = 2
    share: Float[Array, ""] = parameter("-", domain="fraction")
    slip_curvature: Float[Array, ""] = parameter("1/m", domain="positive")
    initial_set: Float[Array, "2"] = parameter("1/m", 2, optional=True)

    @classmethod
    def begin(cls, curvature: float, length: float, seconds: float) -> tuple[dict[str, float], ...]:
        """See `AbstractMemory.begin`."""
        return tuple({"share": BEGUN_SHARE, "slip_curvature": part * curvature} for part in BEGUN_AT)

    @property
    def threshold(self) -> Float[Array, ""]:
        """Mean threshold (1/m) of the sliders."""
        return self.slip_curvature

    def part(self, strain: Float[Array, "6"], stiffness: Float[Array, "6 6"]) -> tuple[Array, Array, Array]:
        """Curvature (2,), EI, and the bending stiffnesses over EI."""
        bending = stiffness[3:5, 3:5]
        EI = 0.5 * (bending[0, 0] + bending[1, 1])
        return strain[3:5], EI, bending / EI


ENTRY = entry_of_memory(
    Friction, "slip_curvature", lambda c: 0.3 * max(c.curvature_range[1], 0.1 / c.length),
    share=0.3,  # cables lose between a tenth and nine tenths of their stiffness when strands slip
    none=np.zeros(2),
    signature="the same clamps, reached from two sides, hold two shapes",
    settle="go to one pose from both sides, bent more and bent less before",
    same_shapes=(SameShapes("nonlinear_bending", "poses that are all reached from a straight cable"),),
)  # fmt: skip
