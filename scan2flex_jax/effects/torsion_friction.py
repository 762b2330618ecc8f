"""Friction in torsion: part of the torsional stiffness is carried by strands that slip, as `friction` in bending.

``share`` (-) of GJ slips, at twists about ``slip_twist`` (rad/m) away from where it last stuck (`sliders`), in excess of the
natural twist; before the first pose it stuck at the twist ``initial_set`` (rad/m). Null: share 0.
"""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.entry import entry_of_memory
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.effects.sliders import BEGUN_AT, BEGUN_SHARE, AbstractSliders


class TorsionFriction(AbstractSliders):
    """``share`` (-) of the torsional stiffness slips at a mean ``slip_twist`` (rad/m), first from ``initial_set`` (rad/m)."""

    kind: ClassVar[str] = "torsion_friction"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "strands slip in torsion: the torque depends on the way to a pose"
    size: ClassVar[int] = 1
    share: Float[Array, ""] = parameter("-", domain="fraction")
    slip_twist: Float[Array, ""] = parameter("1/m", domain="positive")
    initial_set: Float[Array, ""] = parameter("1/m", optional=True)

    @classmethod
    def begin(cls, curvature: float, length: float, seconds: float) -> tuple[dict[str, float], ...]:
        """See `AbstractMemory.begin`; a typical twist is half a turn along the cable."""
        return tuple({"share": BEGUN_SHARE, "slip_twist": part * np.pi / length} for part in BEGUN_AT)

    @property
    def threshold(self) -> Float[Array, ""]:
        """Mean threshold (rad/m) of the sliders."""
        return self.slip_twist

    def part(self, strain: Float[Array, "6"], stiffness: Float[Array, "6 6"]) -> tuple[Array, Array, Array]:
        """Twist (1,), GJ, and the unit metric."""
        return strain[5:6], stiffness[5, 5], jnp.ones((1, 1))


ENTRY = entry_of_memory(
    TorsionFriction, "slip_twist", lambda c: 0.6 * np.pi / c.length,  # a third of a turn along the cable
    share=0.3,  # as in bending
    none=0.0,
    signature="the same clamps, twisted there from two sides, hold two shapes",
    settle="twist one clamp to the same angle from both sides",
)  # fmt: skip
