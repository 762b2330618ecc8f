"""Dead loads: forces of constant size and direction, as loads on the nodes.

Within an element the centre line is the cubic Hermite curve through its end positions ``r`` with end tangents ``d3``. The
work of a force is then ``F . r`` on positions plus ``C . d3`` on tangents of the nodes, both linear: ``V = -sum F.r + C.d3``.
For a uniform load the tangent terms of neighbouring elements cancel, which leaves the trapezoidal rule with end
correction (Euler-Maclaurin), exact to fourth order in the element length.
"""

import equinox as eqx
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from scan2flex_jax.rod.effect import Element, Section


class Arm(eqx.Module):
    """What a dead ``force`` (N) at the tip of an arm does more than on the centre line: the arm ``offset`` (m, along d1, d2,
    d3) is fixed in the section at ``position`` (m), and the couple of the force has the energy ``-force . R offset``."""

    position: Float[Array, ""]
    force: Float[Array, "3"]
    offset: Float[Array, "3"]

    def potential(self, element: Element) -> Float[Array, ""]:
        """Energy (J) of one element."""
        u, own = element.share(self.position)
        return jnp.where(own, -self.force @ element.arm(u, self.offset), 0.0)


class DeadLoad(eqx.Module):
    """``force`` (N) on node positions, ``lever`` (N m) on node tangents d3, and ``arms`` beside the centre line."""

    force: Float[Array, "nodes 3"]
    lever: Float[Array, "nodes 3"]
    arms: tuple[Arm, ...] = ()

    def __add__(self, other: "DeadLoad | None") -> "DeadLoad":
        if other is None:
            return self
        return DeadLoad(self.force + other.force, self.lever + other.lever, self.arms + other.arms)


def distributed_load(section: Section, per_length: Float[Array, "n 3"]) -> DeadLoad:
    """A force per length (N/m), from its means over the elements; its slope inside them acts as a couple."""
    half, lever = 0.5 * section.ds * per_length, section.ds**2 / 12.0 * per_length
    couple = section.ds**2 / 24.0 * jnp.asarray(jnp.gradient(per_length, axis=0)) if len(per_length) > 1 else 0.0 * lever
    return DeadLoad(_to_nodes(half, half), _to_nodes(lever + couple, couple - lever))


def point_load(
    section: Section, position: Float[Array, ""], force: Float[Array, "3"], offset: Float[Array, "3"] | None = None
) -> DeadLoad:
    """A force (N) at arc length ``position`` (m), on the centre line or ``offset`` (m, along d1, d2, d3) from it; smooth in
    ``position`` (continuous first derivative)."""
    n = section.s.shape[0]
    element = jnp.clip(jnp.floor(position / section.ds), 0, n - 1)
    t = position / section.ds - element
    w = (jnp.arange(n) == element)[:, None].astype(t.dtype)
    h00, h10 = 2 * t**3 - 3 * t**2 + 1, t**3 - 2 * t**2 + t
    h01, h11 = 1 - h00, t**3 - t**2
    ds = section.ds
    arms = () if offset is None else (Arm(position, force, offset),)
    return DeadLoad(_to_nodes(w * h00 * force, w * h01 * force), _to_nodes(w * ds * h10 * force, w * ds * h11 * force), arms)


def _to_nodes(first, second):
    pad = jnp.zeros((1, 3), first.dtype)
    return jnp.concatenate([first, pad]) + jnp.concatenate([pad, second])
