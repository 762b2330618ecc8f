"""Nonlinear bending: the section softens beyond a curvature of slip (wires that slide on each other, a textile).

Moment ``EI k [ratio + (1 - ratio)/sqrt(1 + (k/slip)^2)]`` along the curvature vector, of the curvature k (1/m) in
excess of the natural one; ``slip_curvature`` (1/m), ``ratio`` (-) of the stiffness far beyond the slip to that before
it. The energy beyond the quadratic one, with ``u = (k/slip)^2``, is

``EI (1 - ratio) [slip^2 (sqrt(1 + u) - 1) - k^2/2] = -1/2 EI (1 - ratio) slip^2 (u/(1 + sqrt(1 + u)))^2``,

even in k and free of cancellation. With two bending stiffnesses ``EI k^2`` stands for ``k' K k``. Null: ratio 1.
"""

from typing import ClassVar

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects._fields import parameter
from scan2flex_jax.rod.effect import AbstractEffect


class NonlinearBending(AbstractEffect):
    """Softening beyond ``slip_curvature`` (1/m) down to ``ratio`` (-) of the first stiffness."""

    kind: ClassVar[str] = "nonlinear_bending"
    slip_curvature: Float[Array, ""] = parameter()
    ratio: Float[Array, ""] = parameter()

    def strain_energy(self, strain: Float[Array, "6"], stiffness: Float[Array, "6 6"]) -> Float[Array, ""]:
        """Energy per length (J/m) beyond the quadratic one."""
        bending, curvature = stiffness[3:5, 3:5], strain[3:5]
        EI = 0.5 * (bending[0, 0] + bending[1, 1])
        u = curvature @ bending @ curvature / (EI * self.slip_curvature**2)
        soft = u / (1.0 + jnp.sqrt(1.0 + u))
        return -0.5 * EI * (1.0 - self.ratio) * (self.slip_curvature * soft) ** 2
