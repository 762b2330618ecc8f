"""Spans and points along the cable: smooth boxes and unit bells, averaged over elements, and fields between given points.

``sigma(t)`` is the smooth step ``6 t^5 - 15 t^4 + 10 t^3`` on [0, 1] (twice continuously differentiable); ``sigma_1``
and ``sigma_2`` are its first and second antiderivative. A span of the format is the box ``sigma((s - a)/e + 1/2) -
sigma((s - b)/e + 1/2)`` from ``a = position - width/2`` to ``b = position + width/2`` with ``e = 2 %`` of L. Means
over elements are in closed form (or by quadrature inside elements), so that solutions converge at second order in
the mesh even with an edge inside an element, and are smooth in position and width. All lengths in m.
"""

from collections.abc import Callable
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.compilation import lightly_compiled
from scan2flex_jax.geometry.fields import hats
from scan2flex_jax.rod.effect import Section

EDGE = 0.02  # of L: the length over which an edge is smoothed (study format)
NARROWEST = 0.005  # of L: a quarter of the smoothing; a smaller width changes no shape visibly
_NEAR, _NEAR_WEIGHTS = (0.5 * x for x in np.polynomial.legendre.leggauss(3))  # of the length of an element, about its middle
_POINTS, _WEIGHTS = (0.5 * (x + shift) for x, shift in zip(np.polynomial.legendre.leggauss(8), (1.0, 0.0), strict=True))


def _sigma(t):
    t = jnp.clip(t, 0.0, 1.0)
    return t**3 * (10.0 - 15.0 * t + 6.0 * t**2)


def _sigma_1(t):
    u = jnp.clip(t, 0.0, 1.0)
    return u**4 * (2.5 - 3.0 * u + u**2) + jnp.maximum(t - 1.0, 0.0)


def _sigma_2(t):
    u, past = jnp.clip(t, 0.0, 1.0), jnp.maximum(t - 1.0, 0.0)
    return u**5 * (0.5 - 0.5 * u + u**2 / 7.0) + past * (0.5 + 0.5 * past)


def box(s, position, width, length):
    """The smooth box (-) at arc lengths ``s``."""
    e, s = EDGE * length, s - position
    both = _sigma(jnp.stack([s + 0.5 * width, s - 0.5 * width]) / e + 0.5)
    return both[0] - both[1]


def box_means(section: Section, position, width, length) -> Float[Array, " n"]:
    """Mean of the smooth box (-) over each element."""
    e = EDGE * length
    nodes = jnp.append(section.s - 0.5 * section.ds, section.s[-1] + 0.5 * section.ds)
    left, right = _sigma_1(jnp.stack([nodes - position + 0.5 * width, nodes - position - 0.5 * width]) / e + 0.5)
    return jnp.diff(left - right) * e / section.ds


def series_factor(section: Section, position, width, factor, length) -> Float[Array, " n"]:
    """Factor (-) on the stiffness of each element, from the compliance of a span ``factor`` times as stiff.

    Parts of an element carry the same moment, so their compliances add; averaging the stiffness instead would give an element
    that contains an edge a first-order error in its rotation. Quadrature runs from edge to edge, so that the factor stays
    smooth when an edge moves through an element.
    """
    e, near, far = EDGE * length, position - 0.5 * width, position + 0.5 * width
    first, last = jnp.minimum(near + 0.5 * e, far - 0.5 * e), jnp.maximum(near + 0.5 * e, far - 0.5 * e)
    breaks = jnp.stack([near - 0.5 * e, first, last, far + 0.5 * e])[:, None]
    nodes = section.s[:, None] + section.ds * jnp.array([-0.5, 0.5])
    edges = jnp.clip(nodes[None], breaks[:-1, None], breaks[1:, None])  # of each part of each element
    start, extent = edges[..., :1], edges[..., 1:] - edges[..., :1]
    more = 1.0 / (1.0 + (factor - 1.0) * box(start + extent * jnp.array(_POINTS), position, width, length)) - 1.0
    softer = jnp.sum(extent[..., 0] * (more @ jnp.array(_WEIGHTS)), axis=0)
    return 1.0 / (1.0 + softer / section.ds)


def bell_means(section: Section, position, width, length) -> Float[Array, " n"]:
    """Density (1/m) of unit integral: a box of ``width`` at ``position`` with smoothed edges; at zero width the bell of a
    smoothed point.

    Weighted with hat functions about the midpoints of the elements (half-hats outside are folded back), which keeps the
    first moment too: a mean over elements would move a kink inside an element to its midpoint.
    """
    ds, e = section.ds, EDGE * length
    width = jnp.sqrt(width**2 + (NARROWEST * length) ** 2)
    s = jnp.concatenate([section.s[:1] - 2 * ds, section.s[:1] - ds, section.s])
    s = jnp.concatenate([s, section.s[-1:] + ds, section.s[-1:] + 2 * ds])

    def twice_integrated(x):
        both = _sigma_2(jnp.stack([x + 0.5 * width, x - 0.5 * width]) / e + 0.5)
        return e**2 / width * (both[0] - both[1])

    g = twice_integrated(s - position)
    f = (g[2:] - 2.0 * g[1:-1] + g[:-2]) / ds**2
    inner = f[1:-1].at[0].add(2.0 * f[0]).at[1].add(-f[0]).at[-1].add(2.0 * f[-1]).at[-2].add(-f[-1])
    return inner / (jnp.sum(inner) * ds)


def hat_field(section: Section, values: Float[Array, "m ..."], length) -> Float[Array, "n ..."]:
    """A field given at ``m`` points evenly along the cable, linear between them, at the midpoints of the elements."""
    return jnp.tensordot(hats(section.s / length, values.shape[0]), values, 1)


def field_along(section: Section, values: Float[Array, "m ..."], s: Float[Array, " m"] | None, length):
    """A field at the midpoints of the elements: a `spline` through places ``s`` (m), or a `hat_field` if ``s`` is None."""
    return hat_field(section, values, length) if s is None else spline(section.s, s, values)


@lightly_compiled
def spline(at: Float[Array, " n"], s: Float[Array, " m"], values: Float[Array, "m k"]) -> Float[Array, "n k"]:
    """The natural cubic spline through ``values`` at ``s`` (m), at places ``at`` (m); constant outside."""
    h, rise = jnp.diff(s), jnp.diff(values, axis=0)
    bend = jnp.zeros_like(values)  # second derivative at the places
    if len(h) > 1:
        A = jnp.diag(2.0 * (h[:-1] + h[1:])) + jnp.diag(h[1:-1], 1) + jnp.diag(h[1:-1], -1)
        bend = bend.at[1:-1].set(jnp.linalg.solve(A, 6.0 * jnp.diff(rise / h[:, None], axis=0)))
    u = jnp.clip((at[:, None] - s[:-1]) / h, 0.0, 1.0)  # share of each interval that lies before a place
    curved = u * (1.0 - u) * h**2 / 6.0
    return values[0] + u @ rise - (curved * (2.0 - u)) @ bend[:-1] - (curved * (1.0 + u)) @ bend[1:]


def element_means(section: Section, field: Callable) -> Float[Array, " n"]:
    """Mean over each element of a smooth ``field`` of arc length (m)."""
    at = section.s[:, None] + section.ds * jnp.array(_NEAR)
    return field(at.ravel()).reshape(at.shape) @ jnp.array(_NEAR_WEIGHTS)


def grown(section: Section, log_factor: Callable) -> Section:
    """Sections with EI and GJ times ``exp(log_factor(s))``, smooth in arc length (m), to fourth order in the mesh.

    The stiffness of an element is the mean over it; the mean of a product has a term in the slopes of its factors.
    """
    growth = jax.jvp(log_factor, (section.s,), (jnp.ones_like(section.s),))[1]
    before = jnp.zeros_like(growth) if section.growth is None else section.growth
    factor = element_means(section, lambda s: jnp.exp(log_factor(s))) * jnp.exp(section.ds**2 / 12.0 * before * growth)
    return replace(section, stiffness=scaled_bending(section, factor), growth=before + growth)


def scaled_bending(section: Section, factor: Float[Array, " n"]) -> Float[Array, "n 6 6"]:
    """Section stiffness with EI and GJ times ``factor``, and their couplings to stretching times its square root."""
    root = jnp.where(jnp.arange(6) < 3, 1.0, jnp.sqrt(factor)[:, None])
    return section.stiffness * root[:, :, None] * root[:, None, :]
