"""Supports between the ends: what holds a point of the cable to a point of space, and the force that it exerts.

A support is a spring ``1/2 k |gap|^2`` between two nodes (`AbstractEffect.element_potential`), on the cubic Hermite curve of
the element. Its stiffness ``k = 1e5 EI / ds^3`` is far above that of an element in bending, ``12 EI / ds^3``: over a span of
``n`` elements it yields by ``24 / (1e5 n^3)`` of the span's deflection, 4e-7 of it at n = 8. The error of the Hermite curve is
larger.
"""

import abc
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from scan2flex_jax.geometry.small import matvec, vecmat
from scan2flex_jax.rod.effect import AbstractEffect, Element
from scan2flex_jax.rod.energy import elements, nudged, supported
from scan2flex_jax.rod.model import Configuration, Rod

_RIGID = 1.0e5  # times the bending stiffness of an element over its length cubed


class AbstractSupport(AbstractEffect):
    """Base of the supports: `held_at` says where an element is held, `gap` what is left open there."""

    anchor: eqx.AbstractVar[Float[Array, "3"]]

    @abc.abstractmethod
    def held_at(self, element: Element) -> tuple[Float[Array, ""], Bool[Array, ""]]:
        """``(u, own)``: the place along the element (0..1, beyond it at an end of the cable), and whether it is held at all."""

    @abc.abstractmethod
    def gap(self, element: Element, u: Float[Array, ""]) -> Float[Array, "3"]:
        """From the anchor to the place ``u`` of the element (m), in the held directions."""

    @abc.abstractmethod
    def hint(self, length: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, "3"]]:
        """``(s, along)`` for a start: arc length of the held place (m), NaN if it is not known, and the direction of the cable
        there, zero if that is not known."""

    @abc.abstractmethod
    def lost(self, points: Float[Array, "nodes 3"]) -> Bool[Array, ""]:
        """Whether the cable is not where the support could hold it."""

    def element_potential(self, element: Element) -> Float[Array, ""]:
        """Energy (J) of the spring."""
        gap = self.open(element)
        return 0.5 * rigid(element) * gap @ gap

    def open(self, element: Element) -> Float[Array, "3"]:
        """The gap (m) in an element; zero where it is not held."""
        u, own = self.held_at(element)
        return jnp.where(own, self.gap(element, u), 0.0)


class Guide(AbstractEffect):
    """What guided ends and hinges hold of the ends of a pose (`Boundary` says where): ``across`` (start, end) projects on the
    directions in which a guide holds the position, ``axis`` is that of a hinge; both zero elsewhere."""

    kind: ClassVar[str] = "guided end or hinge"
    place: ClassVar[str] = "clamps"
    across: Float[Array, "2 3 3"]
    axis: Float[Array, "2 3"]

    def element_potential(self, element: Element) -> Float[Array, ""]:
        """Energy (J) of the springs at an end of the cable."""
        b, k = element.boundary, rigid(element)
        gap = matvec(self.across, element.r - b.position)
        material = vecmat(self.axis, b.rotation)  # the axis in the section, which the hinge keeps on the axis in space
        turned = matvec(element.R, material) - self.axis
        each = 0.5 * k * jnp.sum(gap**2, axis=1) + 0.5 * k * element.ds**2 * jnp.sum(turned**2, axis=1)
        return jnp.sum(jnp.where(jnp.stack([element.first, element.last]), each, 0.0))


def supports(rod: Rod) -> tuple[AbstractSupport, ...]:
    """The supports of a rod between its ends."""
    return tuple(effect for effect in rod.effects if isinstance(effect, AbstractSupport))


def rigid(element: Element) -> Float[Array, ""]:
    """Stiffness (N/m) of a rigid support."""
    return _RIGID * element.bending / element.ds**3


class Springs(NamedTuple):
    """The springs of the supports: each one's ``gap`` (m) in each element, zero where it does not hold, its derivatives
    ``slope`` and ``bend`` by the twists of the element's nodes (None if not asked for), and the ``stiffness`` (N/m) of all."""

    gap: Float[Array, "supports n 3"]
    slope: Float[Array, "supports n 3 12"]
    bend: Float[Array, "supports n 3 12 12"] | None
    stiffness: Float[Array, ""]

    @property
    def gradient(self) -> Float[Array, "n 12"]:
        """Gradient of their energy by the twists of the nodes of each element (N, N m)."""
        return self.stiffness * jnp.einsum("sni,snij->nj", self.gap, self.slope)

    def forces(self, twist: Float[Array, "nodes 6"] | None = None) -> Float[Array, "supports 3"]:
        """Their forces (N) on the anchors, to first order after a motion ``twist`` of the nodes."""
        gap = self.gap
        if twist is not None:
            gap = gap + jnp.einsum("snij,nj->sni", self.slope, jnp.concatenate([twist[:-1], twist[1:]], axis=1))
        return self.stiffness * jnp.sum(gap, axis=1)

    def hessian(self, forces: Float[Array, "supports 3"]) -> Float[Array, "n 12 12"]:
        """Hessian with given ``forces`` (N) in its geometric part.

        The springs are nearly rigid, as the cable is in stretching: after a step of Newton's method their gaps tell nothing of
        their forces, which the step itself predicts (`rod.assembly`).
        """
        material = jnp.einsum("snij,snik->njk", self.slope, self.slope)
        return self.stiffness * material + jnp.einsum("si,snijk->njk", forces, jnp.asarray(self.bend))


def springs(rod: Rod, configuration: Configuration, *, bends: bool = False) -> Springs:
    """The springs of a rod with supports; with ``bends`` their second derivatives too."""
    each = elements(rod, configuration)
    kinds: dict = {}
    for i, effect in enumerate(supports(rod)):
        kinds.setdefault(jax.tree.structure(effect), []).append((i, effect))

    def one(effect, element):
        def gap(twist):
            found = effect.open(nudged(element, twist))
            return found, found

        def slope(twist):
            found = jax.jacfwd(gap, has_aux=True)(twist)
            return found[0], found

        still = jnp.zeros(12)
        return jax.jacfwd(slope, has_aux=True)(still) if bends else (None, slope(still)[1])

    places, parts = [], []
    for group in kinds.values():  # those of one structure are traced once
        stacked = jax.tree.map(lambda *x: jnp.stack(x), *(effect for _, effect in group))
        places += [i for i, _ in group]
        parts.append(jax.vmap(jax.vmap(one, (None, 0)), (0, None))(stacked, each))
    bend, (slope, gap) = jax.tree.map(lambda *x: jnp.concatenate(x)[jnp.argsort(jnp.array(places))], *parts)
    return Springs(gap, slope, bend, _RIGID * each.bending[0] / rod.section.ds**3)


def lost(rod: Rod, points: Float[Array, "nodes 3"]) -> Bool[Array, ""]:
    """Whether the cable has left one of its supports."""
    return jnp.any(jnp.array([False, *(e.lost(points) for e in rod.effects if isinstance(e, AbstractSupport))]))


def support_reactions(rod: Rod, configuration: Configuration) -> tuple[Float[Array, " supports"], Float[Array, "supports 3"]]:
    """Arc length (m) that each support holds, and its force (N) on the cable.

    The energy depends on the distance from the anchor alone, so its derivative by the anchor is the force on the cable.
    """
    each = elements(rod, supported(rod, configuration))

    def one(effect):
        def energy(anchor):
            return jnp.sum(jax.vmap(eqx.tree_at(lambda e: e.anchor, effect, anchor).element_potential)(each))

        u, own = jax.vmap(effect.held_at)(each)
        at = jnp.sum(jnp.where(own, each.s[:, 0] + u * rod.section.ds, 0.0)) / jnp.maximum(jnp.sum(own), 1)
        return at, jax.grad(energy)(effect.anchor)

    at, force = zip(*(one(effect) for effect in supports(rod)), strict=True)
    return jnp.stack(at), jnp.stack(force)
