"""Clamp offset: a clamp is displaced from its stated position, by the same vector in every pose.

``offset`` (m) is one vector per end, in the frame of the nominal clamp: ``r + R offset``, before any `clamp_rotation`
(`effects.ordered`). An end without a clamp has the entry 0. Null: 0.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.builders import ends, ends_without
from scan2flex_jax.effects.entry import CatalogueEntry, SameShapes
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.effect import AbstractEffect
from scan2flex_jax.study.kinds import ENDS


class ClampOffset(AbstractEffect):
    """Shifts ``offset`` (m) of start and end clamp."""

    kind: ClassVar[str] = "clamp_offset"
    place: ClassVar[str] = "clamps"
    words: ClassVar[str] = "a clamp is shifted from where it is said to be"
    offset: Float[Array, "2 3"] = parameter("m", 3, per_end=True)

    def clamps(self, boundary: Boundary) -> Boundary:
        """The clamps shifted."""
        shift = jnp.einsum("eij,ej->ei", boundary.rotation, self.offset)
        return eqx.tree_at(lambda b: b.position, boundary, boundary.position + shift)


ENTRY = CatalogueEntry(
    ClampOffset, tuple(f"{end} along {d}" for end in ENDS for d in ("d1", "d2", "d3")),
    lambda c: np.full(6, 0.003 * c.length),  # three millimetres on a metre
    sites=ends, inactive_of=ends_without(3),
    signature="the misfit is a shift next to a clamp that turns with the clamp",
    settle="scan the edges of the clamps along with the cable",
    same_shapes=(SameShapes("length_error", "a shift along the tangent of a clamp whose neighbourhood is straight"),
                 SameShapes("scan_offset", "the same shift of both clamps, when no pose turns them")),
)  # fmt: skip
