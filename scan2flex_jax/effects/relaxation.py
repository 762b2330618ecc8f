"""Relaxation: part of the stiffness creeps away while a pose is held (standard linear solid).

``share`` (-) of the bending and torsional stiffness is in series with a dashpot of ``time_constant`` (s), in parallel with
the elastic rest. With the strain ``v`` of the dashpots, ``x`` the curvature and twist in excess of the natural ones and ``K``
their stiffness, that before anything creeps,

    energy = 1/2 (1 - share) x' K x + 1/2 share (x - v)' K (x - v),    v' = (x - v)/time_constant.

Each pose has its ``time``. It is taken to be reached quickly just before it, and held until the time of the next one at the
strain that it has then: a pose measured at ``t`` and followed by one at ``t + held`` leaves
``v + (x - v) (1 - exp(-held/time_constant))``. What the strain itself creeps while the pose is held is neglected; where the
clamps fix most of the shape, it is a small part. A cable begins without history, or with dashpots at the strain ``initial_set``
(1/m, about d1, d2, d3), and without history again after ``reset``. Null: share 0.
"""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.entry import entry_of_memory
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.rod.memory import AbstractMemory

_BEGUN_SHARE = 0.2  # of the stiffness: share at which a fit begins
_BEGUN_AT = (0.05, 0.3)  # of the time from the first pose to the last: time constants at which a fit begins


class Relaxation(AbstractMemory):
    """``share`` (-) of bending and torsional stiffness creeps away with ``time_constant`` (s)."""

    kind: ClassVar[str] = "relaxation"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "part of the stiffness creeps away while a pose is held"
    needs: ClassVar[str] = "time"
    share: Float[Array, ""] = parameter("-", domain="fraction")
    time_constant: Float[Array, ""] = parameter("s", domain="positive")
    initial_set: Float[Array, "3"] = parameter("1/m", 3, optional=True)

    @classmethod
    def begin(cls, curvature: float, length: float, seconds: float) -> tuple[dict[str, float], ...]:
        """See `AbstractMemory.begin`."""
        return tuple({"share": _BEGUN_SHARE, "time_constant": part * max(seconds, 1.0)} for part in _BEGUN_AT)

    def without_history(self, elements: int) -> Float[Array, "n 3"]:
        """Dashpots at the natural shape."""
        return jnp.zeros((elements, 3))

    def at_first(self, elements: int) -> Float[Array, "n 3"]:
        """Dashpots at the initial set."""
        return jnp.broadcast_to(self.initial_set, (elements, 3))

    def energy_given(
        self, strain: Float[Array, "6"], stiffness: Float[Array, "6 6"], left: Float[Array, "3"]
    ) -> Float[Array, ""]:
        """Energy per length (J/m) in addition to the quadratic one."""
        x, K = strain[3:], stiffness[3:, 3:]
        return self.share * (0.5 * left - x) @ K @ left

    def leaves(
        self, strain: Float[Array, "6"], stiffness: Float[Array, "6 6"], left: Float[Array, "3"], held: Float[Array, ""]
    ) -> Float[Array, "3"]:
        """Strain (1/m) of the dashpots when the pose is left."""
        return left - (strain[3:] - left) * jnp.expm1(-held / self.time_constant)


ENTRY = entry_of_memory(
    Relaxation, "time_constant", lambda c: 300.0,  # s
    share=0.2,  # plastics lose ten to thirty per cent over minutes
    none=np.zeros(3),
    signature="later poses lean towards those that were held long before them",
    settle="take the first pose again, last",
)  # fmt: skip
