"""The potential energy of the rod, one pure function of configuration and parameters.

``W = int 1/2 (Gamma-Gamma_0)' K_Gamma (Gamma-Gamma_0) + 1/2 (Omega-Omega_0)' K_Omega (Omega-Omega_0) - k_rhoA g.phi ds``

is the paper's Eq. 6 with a factor 1/2 on the strain terms. The constitutive law (Eq. 3) and the balance equations (Eq. 5)
require that factor and Eq. 6 lacks it: without it every fitted stiffness is halved. A test on a heavy cantilever fixes it
(tip deflection ``rhoA g L^4 / (8 EI)`` for a small load). The strain terms of an element are those of `element_law`; effects
add their terms.
"""

from collections.abc import Sequence
from dataclasses import replace

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from scan2flex_jax.compilation import lightly_compiled
from scan2flex_jax.geometry import lie
from scan2flex_jax.geometry.small import diagonal, matmul, matvec, vecmat
from scan2flex_jax.rod.effect import AbstractEffect, Element, Node, overriding
from scan2flex_jax.rod.element_law import element_energy
from scan2flex_jax.rod.model import Configuration, Rod

E3 = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)  # strain xi of a straight, unstretched rod: unit advance along d3


def supported(rod: Rod, configuration: Configuration) -> Configuration:
    """The configuration with the held motions of its ends set to those of the supports."""
    b = rod.boundary
    r, R = configuration
    for end, node in ((0, 0), (1, -1)):
        r = r.at[node].set(jnp.where(b.held[end, 0] > 0, b.position[end], r[node]))
        R = R.at[node].set(jnp.where(b.held[end, 3] > 0, b.rotation[end], R[node]))
    return Configuration(r, R)


def strains(rod: Rod, configuration: Configuration) -> Float[Array, "n 6"]:
    """Strains ``(Gamma, Omega)`` of the elements (-, 1/m); paper, Eq. 2."""
    r, R = configuration

    def element(r0, R0, r1, R1):
        return lie.se3_log(vecmat(r1 - r0, R0), matmul(R0.T, R1))

    return jax.vmap(element)(r[:-1], R[:-1], r[1:], R[1:]) / rod.section.ds - jnp.array(E3)


@lightly_compiled
def excess_strains(rod: Rod, configuration: Configuration) -> Float[Array, "n 6"]:
    """Strains of the elements beyond their natural ones (-, 1/m)."""
    return strains(rod, configuration) - rod.section.natural


def node_potential(rod: Rod):
    """Function Node -> energy (J) of the outer fields, or None without any."""
    fields = overriding(rod.effects, "node_potential")
    return (lambda node: sum(f.node_potential(node) for f in fields)) if fields else None


def element_potential(rod: Rod, effects: Sequence[AbstractEffect] | None = None):
    """Function Element -> energy (J) of what acts between two nodes, or None without any; of ``effects``, by default of all."""
    fields = overriding(rod.effects if effects is None else effects, "element_potential")
    each = [*(field.element_potential for field in fields), *(arm.potential for arm in rod.load.arms)]
    return (lambda element: sum(potential(element) for potential in each)) if each else None


def elements(rod: Rod, configuration: Configuration) -> Element:
    """All elements of a configuration, along the first axis of each array."""

    def pairs(x):
        return jnp.stack([x[:-1], x[1:]], axis=1)

    def one(r, R, s, first, last):
        return Element(r, R, s, first, last, rod.section.ds, bending, rod.boundary)

    at, bending = jnp.arange(rod.elements), jnp.mean(diagonal(rod.section.stiffness)[:, 3:5])
    r, R, s = map(pairs, (*configuration, rod.node_s))
    return jax.vmap(one)(r, R, s, at == 0, at == rod.elements - 1)


def node_weights(rod: Rod) -> Float[Array, " nodes"]:
    """Share of the cable length of each node (m), by the trapezoidal rule."""
    w = jnp.ones(rod.elements + 1).at[0].set(0.5).at[-1].set(0.5)
    return w * rod.section.ds


def potential_energy(configuration: Configuration, rod: Rod) -> Float[Array, ""]:
    """Total potential energy (J) of the rod with its ends at the supports."""
    c = supported(rod, configuration)
    excess = strains(rod, c) - rod.section.natural
    total = rod.section.ds * jnp.sum(element_energy(rod, excess))
    total = total - jnp.sum(rod.load.force * c.r) - jnp.sum(rod.load.lever * c.R[:, :, 2])
    field = node_potential(rod)
    if field is not None:
        nodes = (c.r, c.R, rod.node_s, node_weights(rod))
        total = total + jnp.sum(jax.vmap(lambda r, R, s, w: field(Node(r, R, s, w, rod.section.ds, rod.boundary)))(*nodes))
    between = element_potential(rod)
    if between is not None:
        total = total + jnp.sum(jax.vmap(between)(elements(rod, c)))
    return total


def nudged(element: Element, twist: Float[Array, "12"]) -> Element:
    """The element with its two nodes moved by small body twists, as by `displaced`."""
    r, R = jax.vmap(displaced)(element.r, element.R, twist.reshape(2, 6))
    return replace(element, r=r, R=R)


def displaced(
    r: Float[Array, "3"], R: Float[Array, "3 3"], twist: Float[Array, "6"]
) -> tuple[Float[Array, "3"], Float[Array, "3 3"]]:
    """A node moved by a small body twist, exactly to second order: what derivatives at rest need."""
    v, W = twist[:3], lie.hat(twist[3:])
    return r + matvec(R, v + 0.5 * matvec(W, v)), R + matmul(R, W + 0.5 * matmul(W, W))


def retract(configuration: Configuration, twist: Float[Array, "nodes 6"]) -> Configuration:
    """Each node moved by the body twist ``(v, w)``: ``g exp(twist)``."""
    dr, dR = jax.vmap(lie.se3_exp)(twist)
    r, R = configuration
    return Configuration(r + matvec(R, dr), matmul(R, dR))
