"""Dahl's friction: part of the stiffness is carried by a force that grows along one exponential towards its limit.

About each material axis by itself, with ``x`` (1/m) the curvature or twist in excess of the natural one, ``B`` (N m^2) its
stiffness before anything slips and ``slip`` (1/m) the ``slip_curvature``,

    m = B ((1 - share) x + share slip z),    slip dz = dx - z |dx|,    -1 <= z <= 1

(Dahl, "A solid friction model", Aerospace Corporation TOR-0158(3107-18)-1, 1968). The way back obeys the same law: a cable
that turns at ``z = 1`` has the stiffness ``(1 + share) B`` there. Masing's rule, which the sliders of `friction` obey, does not
hold, and a loop between ``-A`` and ``A`` has the area ``4 share B slip (A - slip tanh(A/slip))``. On a monotone way from ``x0``
with ``z0``, ``z = w - (w - z0) exp(-|x - x0|/slip)`` with ``w`` the sign of ``x - x0``, and ``slip z`` is the slope of a convex
energy; this holds about an axis, and not for a vector of curvature.

It is the friction of Newton's rods (`SolverVBD`: ``dahl_eps_max``, ``dahl_tau``), which act about each axis by itself too, with
one share and one slip for bending and twist. A bend between d1 and d2 meets up to sqrt(2) times the friction about an axis.

At a turn the stiffness jumps by ``2 share B z0``. ``z`` is averaged over `ROUNDING` of ``slip`` on either side: the energy is
twice continuously differentiable, and a pose that is solved again loses half of the rounding (1 %) of its friction. The poses
act in their order, as in `friction`. Null: share 0.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.entry import SameShapes, entry_of_memory
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.effects.sliders import BEGUN_AT, BEGUN_SHARE
from scan2flex_jax.rod.memory import AbstractMemory

ROUNDING = 0.02  # of the slip curvature, on either side of a turn


class Dahl(AbstractMemory):
    """``share`` (-) of bending and torsional stiffness slips along an exponential of ``slip_curvature`` (1/m), at first from
    ``initial_set`` (1/m, about d1, d2, d3)."""

    kind: ClassVar[str] = "dahl"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "friction of Dahl: the moment nears its limit along one exponential, on the way back too"
    share: Float[Array, ""] = parameter("-", domain="fraction")
    slip_curvature: Float[Array, ""] = parameter("1/m", domain="positive")
    initial_set: Float[Array, "3"] = parameter("1/m", 3, optional=True)
    rounding: float = eqx.field(default=ROUNDING, kw_only=True, static=True)

    @classmethod
    def begin(cls, curvature: float, length: float, seconds: float) -> tuple[dict[str, float], ...]:
        """See `AbstractMemory.begin`."""
        return tuple({"share": BEGUN_SHARE, "slip_curvature": part * curvature} for part in BEGUN_AT)

    def without_history(self, elements: int) -> Float[Array, "n 2 3"]:
        """Strains (1/m) and ``z`` (-) of a new cable."""
        return jnp.zeros((elements, 2, 3))

    def at_first(self, elements: int) -> Float[Array, "n 2 3"]:
        """Free of friction at the initial set."""
        return self.without_history(elements).at[:, 0].set(self.initial_set)

    def energy_given(
        self, strain: Float[Array, "6"], stiffness: Float[Array, "6 6"], left: Float[Array, "2 3"]
    ) -> Float[Array, ""]:
        """Energy per length (J/m) in addition to the quadratic one."""
        x, K = strain[3:], stiffness[3:, 3:]
        E, _ = self._averaged(x - left[0], left[1])
        return self.share * (jnp.diagonal(K) @ E - 0.5 * x @ K @ x)

    def leaves(
        self, strain: Float[Array, "6"], stiffness: Float[Array, "6 6"], left: Float[Array, "2 3"], held: Float[Array, ""]
    ) -> Float[Array, "2 3"]:
        """Strains (1/m) and ``z`` (-) after the pose, however long it was held."""
        x = strain[3:]
        return jnp.stack([x, self._averaged(x - left[0], left[1])[1] / self.slip_curvature])

    def _averaged(self, way, z):
        """Energy over ``share B`` (1/m^2) and ``slip z`` (1/m) after a way (1/m) from a state ``z``, averaged about the way."""
        slip, half = self.slip_curvature, self.rounding * self.slip_curvature
        sign = jnp.where(jnp.stack([way + half, way - half]) >= 0.0, 1.0, -1.0)
        far = sign * jnp.stack([way + half, way - half])
        pull = 1.0 - sign * z  # how far the state is from its limit on this way
        gone = -slip * jnp.expm1(-far / slip)
        once = far - pull * gone  # the energy over slip, and below its integral
        twice = sign * (0.5 * far**2 - slip * pull * (far - gone))
        return slip * (twice[0] - twice[1]) / (2.0 * half), slip * (once[0] - once[1]) / (2.0 * half)


ENTRY = entry_of_memory(
    Dahl, "slip_curvature", lambda c: 0.3 * max(c.curvature_range[1], 0.1 / c.length),
    share=0.3,  # as `friction`
    none=np.zeros(3),
    signature="the same clamps, reached from two sides, hold two shapes",
    settle="go to one pose from both sides, bent more and bent less before",
    same_shapes=(SameShapes("friction", "poses that are all approached from the same side"),),
)  # fmt: skip
