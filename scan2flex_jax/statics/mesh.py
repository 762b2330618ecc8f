"""Number of elements that a cable needs: no element may be longer than the bends.

A cable of bending stiffness ``EI`` that carries a force ``T`` bends over the length ``sqrt(EI / T)``, at its clamps and where
a load acts; ``T`` is here the sum of the dead loads, which a hanging cable hardly exceeds. Between ball joints and under spread
loads there are no such bends: the cable is a catenary, which elements longer than ``sqrt(EI / T)`` follow too. A natural
curvature ``Omega_0`` (about all three axes: an anisotropic section turns with the twist) bends it over ``1 / |Omega_0|``.
`DEFAULT_ELEMENTS` are doubled until no element is longer than the shorter of the two, up to `MOST_ELEMENTS`: the error is then
a few 1e-4 of the length at most.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from scan2flex_jax.compilation import compiled
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.model import CableModel, discretise
from scan2flex_jax.rod.support import supports
from scan2flex_jax.statics.balance import DEFAULT_ELEMENTS

MOST_ELEMENTS = 1280  # EI/(w L^3) of 6e-7; an equilibrium then takes some 50 ms
_LOCAL = 2.0  # times the mean load of a node: a load at one place
_FORCE = 1.0e-12  # of EI / L^2: a cable without loads


@compiled
def shortest_bend(model: CableModel, boundary: Boundary) -> Float[Array, ""]:
    """Length (m) over which the cable bends, from its stiffness, its dead loads and its natural curvature."""
    rod = discretise(model, boundary, DEFAULT_ELEMENTS)
    K = jnp.asarray(rod.section.within)
    mean, half = 0.5 * (K[:, 0, 0] + K[:, 1, 1]), 0.5 * (K[:, 0, 0] - K[:, 1, 1])
    softest = jnp.min(mean - jnp.hypot(half, K[:, 0, 1]))
    force = jnp.sum(jnp.linalg.norm(rod.load.force, axis=1)) + _FORCE * softest / rod.length**2
    natural = jnp.max(jnp.linalg.norm(rod.section.natural[:, 3:], axis=1))
    loads = jnp.linalg.norm(rod.load.force, axis=1)
    sharp = bool(supports(rod)) | jnp.any(boundary.held[:, 3] > 0) | (jnp.max(loads) > _LOCAL * jnp.mean(loads))
    return 1.0 / jnp.maximum(jnp.where(sharp, jnp.sqrt(force / softest), 1.0 / rod.length), natural)


class Mesh(NamedTuple):
    """``elements`` of a cable of ``length`` (m) whose shortest ``bend`` (m) is known."""

    elements: int
    length: float
    bend: float

    @property
    def size(self) -> float:
        """Length of an element (m)."""
        return self.length / self.elements

    @property
    def enough(self) -> int:
        """Elements that are not longer than the bends: `DEFAULT_ELEMENTS` times a power of two, at most `MOST_ELEMENTS`."""
        n = DEFAULT_ELEMENTS
        while n < MOST_ELEMENTS and self.length / n > self.bend:
            n *= 2
        return n

    def sentences(self) -> tuple[str, ...]:
        """A sentence if there are more elements than usual for the sake of the bends, or fewer than they need."""
        bends, count = f"bends of {1e3 * self.bend:.2g} mm", f"{self.elements} elements"
        if self.size > self.bend:
            more = "the most that are used" if self.enough <= self.elements else f"{self.enough} are needed"
            return (f"{count} of {1e3 * self.size:.2g} mm are longer than {bends} ({more}): shapes and values may be off",)
        usual = self.length / DEFAULT_ELEMENTS
        if self.elements == DEFAULT_ELEMENTS or usual <= self.bend:
            return ()
        return (f"{count} in place of {DEFAULT_ELEMENTS}: {bends} are shorter than elements of {1e3 * usual:.2g} mm",)
