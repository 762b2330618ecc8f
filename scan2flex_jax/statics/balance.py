"""Out-of-balance forces on the nodes, relative to the forces that the rod carries."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from scan2flex_jax.geometry.small import diagonal
from scan2flex_jax.rod.assembly import Derivatives
from scan2flex_jax.rod.model import Rod

DEFAULT_ELEMENTS = 40
FEWEST_ELEMENTS = 2  # one element has no interior node
BALANCE = 1.0e-6  # largest `imbalance` of a solved rod; Newton leaves 1e-9, rounding with 2,000 elements 1e-8
_ROUNDING = 1.0e-7  # ten times the force over axial stiffness at which the rounding of positions (1e-16) reaches BALANCE


def imbalance(rod: Rod, derivatives: Derivatives) -> Float[Array, ""]:
    """Largest residual force and moment on a node over the largest force and moment that the rod carries (-)."""
    d = derivatives
    softest = jnp.min(diagonal(rod.section.stiffness)[:, 3:])
    n, left = jnp.abs(d.elements.n), jnp.abs(d.gradient)
    moment = jnp.max(n[:, 3:]) + 1e-3 * softest / rod.length
    stiffest = jnp.max(rod.section.stiffness[:, 2, 2]) * jnp.maximum(1.0, rod.elements / DEFAULT_ELEMENTS)
    force = _ROUNDING * stiffest + jnp.max(n[:, :3]) + jnp.max(jnp.abs(rod.load.force)) + moment / rod.length
    return jnp.maximum(jnp.max(left[:, :3]) / force, jnp.max(left[:, 3:]) / (moment + force * rod.length))
