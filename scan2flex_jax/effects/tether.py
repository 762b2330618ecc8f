"""Tether: a string or a spring from a fixed point to a place on the cable, slack when shorter than its rest length.

The place at arc length ``position`` (m) is tied to ``anchor`` (m, scan frame) by a spring of ``stiffness`` (N/m) and
``rest_length`` (m): energy ``1/2 k max(distance - rest_length, 0)^2``, continuously differentiable.

The place lies between two nodes. Each of them carries the energy of a point ahead of (behind) it along its tangent,
``r + ds u/(1 + 2|u|) d3`` with ``u = (position - s)/ds``, with weight ``1 - 3u^2 + 2|u|^3``: the weights add to one
and the weighted mean of the two points is the cubic Hermite curve. Second order in the mesh, smooth in position.
Null: stiffness 0.
"""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.builders import places
from scan2flex_jax.effects.entry import CatalogueEntry, Context, SameShapes, along_loaded
from scan2flex_jax.effects.format import leaf, parameter
from scan2flex_jax.rod.effect import AbstractEffect, Node

TINY = 1.0e-24  # m^2: keeps the derivative of a distance of zero finite


def place_on_cable(node: Node, position: Float[Array, ""]):
    """``(point, weight)``: contribution of this node to the place at ``position`` (m); the weights add to one."""
    u = (position - node.s) / node.ds
    v = jnp.minimum(jnp.abs(u), 1.0)
    return node.r + node.ds * jnp.clip(u, -1.0, 1.0) / (1.0 + 2.0 * v) * node.R[:, 2], 1.0 + v**2 * (2.0 * v - 3.0)


class Tether(AbstractEffect):
    """A spring of ``stiffness`` (N/m) and ``rest_length`` (m) from ``anchor`` (m) to the cable at ``position`` (m)."""

    kind: ClassVar[str] = "tether"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "a string or spring from a fixed point"
    position: Float[Array, ""] = parameter("m", domain="along_cable")
    anchor: Float[Array, "3"] = parameter("m", 3)
    stiffness: Float[Array, ""] = parameter("N/m", domain="positive")
    rest_length: Float[Array, ""] = parameter("m", domain="nonnegative", default=0.0)

    def node_potential(self, node: Node) -> Float[Array, ""]:
        """Energy (J) of the spring, this node's share."""
        point, weight = place_on_cable(node, self.position)
        span = point - self.anchor
        longer = jnp.maximum(jnp.sqrt(span @ span + TINY) - self.rest_length, 0.0)
        return 0.5 * weight * self.stiffness * longer**2


class AnchoredSpring(AbstractEffect):
    """A `tether` in the ``pull`` (N) on the cable at ``position`` when that is at ``centre``; pull and stiffness may be zero.

    With ``reach`` 0 its rest length is zero, and the energy is ``1/2 k |r - centre|^2 - pull . (r - centre)``, linear in the
    ``stiffness`` k (N/m) and the pull. Otherwise the anchor is at ``reach`` from the centre in the direction of the pull, and
    the energy is ``(k (d - reach) + |pull|)^2/(2 k)`` at the distance d from the anchor, zero when slack. Lengths in m.
    """

    position: Float[Array, ""] = leaf()
    centre: Float[Array, "3"] = leaf(3)
    stiffness: Float[Array, ""] = leaf()
    pull: Float[Array, "3"] = leaf(3)
    reach: Float[Array, ""] = leaf(default=0.0)

    def node_potential(self, node: Node) -> Float[Array, ""]:
        """Energy (J) of the spring, this node's share."""
        point, weight = place_on_cable(node, self.position)
        span, k, string = point - self.centre, self.stiffness, self.reach > 0
        tension = jnp.sqrt(self.pull @ self.pull + TINY)
        away = span - self.reach * self.pull / tension
        longer = jnp.sqrt(away @ away + TINY) - self.reach
        taut = jnp.maximum(k * longer + tension, 0.0) ** 2 / jnp.where(string, 2.0 * k, 1.0)
        return weight * jnp.where(string, taut, 0.5 * k * span @ span - self.pull @ span)

    def reported(self, context: Context) -> dict[str, Array]:
        """The parameters of the format."""
        string, tension = self.reach > 0, jnp.linalg.norm(self.pull)
        k = jnp.where(string, self.stiffness, jnp.maximum(self.stiffness, _FAR * _tether_size(context)[0]))
        reach = jnp.maximum(self.reach, tension / k)
        away = jnp.where(string, reach / jnp.maximum(tension, TINY), 1.0 / k) * self.pull
        rest = jnp.where(string, reach - tension / k, 0.0)
        return {"position": self.position, "anchor": self.centre + away, "stiffness": k, "rest_length": rest}


_FAR = 1e-4  # of the size: stiffness of a constant force, from an anchor thousands of lengths away
_REACH = (0.03, 1.0)  # of the length: distance of a string's anchor from the cable
_SOFTEST, _SPREAD = 1.0 / 6.0, 1.5  # of strings: stiffness at zero amplitude, of the size; its logarithm per size


def _tether_size(c):
    return np.array([0.3 * c.force / c.length, *(3 * [0.1 * c.force])])  # a thread that pulls with a tenth


def _tether(a, site, c):
    """A spring of zero rest length about the centre of the scans; with a ``reach`` a string, whose stiffness is log-normal."""
    site = _rest(c) | site
    string = jnp.asarray(site["reach"]) > 0
    k = jnp.where(string, _string_stiffness(a[0], site["softest"]), a[0])
    centre = jnp.where(string, jnp.asarray(site["place"]), jnp.asarray(c.centre))
    return (AnchoredSpring(site["position"], centre, k, a[1:], site["reach"]),)


def _rest(c):
    """What a spring lacks of the site of a string."""
    return {"reach": 0.0, "place": np.zeros(3), "softest": 1.0}


def _string_stiffness(a, softest):
    return softest * jnp.exp(_SPREAD * a * _SOFTEST / softest)


def _string_amplitude(k, softest):
    return np.log(k / softest) / _SPREAD * softest / _SOFTEST


def _strings(a, site, c, places):
    """Further starts after a spring of zero rest length: strings with the same pull at the tautest of ``places`` (m)."""
    if "reach" in site or len(places) < 2:
        return []
    pulls = np.asarray(a, float)[1:] - float(a[0]) * (places - c.centre)
    forces = np.linalg.norm(pulls, axis=1)
    tautest = np.argmax(forces)
    pull, tension, place = pulls[tautest], forces[tautest], places[tautest]
    if tension < 1e-3 * c.force:
        return []
    out: list = []
    softest = _SOFTEST * _tether_size(c)[0]
    for reach in (0.2 * c.length, 0.4 * c.length):
        distance = np.linalg.norm(places - place - reach * pull / tension, axis=1)
        distances = distance - np.mean(distance)  # all zero in repeats of one pose, which carry no information on the stiffness
        slope = distances @ forces / max(float(distances @ distances), 1e-300)
        k = np.clip(slope, 6.0 * softest, 200.0 * softest)
        moved = {"position": float(site["position"]), "reach": reach, "place": place, "softest": softest}
        out.append((np.array([_string_amplitude(k, softest), *pull]), moved, {}))
    return out


ENTRY = CatalogueEntry(
    Tether, ("stiffness", "pull x", "pull y", "pull z"),
    _tether_size,
    build=_tether,
    sites=places, rest=_rest, one_sided=(True, False, False, False), other_starts=_strings,
    moving={"position": along_loaded, "reach": lambda c: (_REACH[0] * c.length, _REACH[1] * c.length)},
    signature="the cable is drawn at one place of it towards one point of space, from whichever side",
    settle="look for a string at the named place",
    same_shapes=(SameShapes("point_load", "an anchor far away against the motion of the place between poses"),),
)  # fmt: skip
