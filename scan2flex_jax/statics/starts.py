"""Start of a solve: its curve and twist, which select the branch, since a twisted cable has several stable equilibria.

The start is either a generic sag between the supports or a measured curve (which selects the branch nearest to the data).
Frames are transported along the curve without rotation about its tangent. The twist is the smallest angle to the end clamp
plus the stated ``turns`` of the pose, spread evenly; other turns are tried after a fit (`posterior.branches`).
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int

from scan2flex_jax.geometry import curves
from scan2flex_jax.geometry.small import matmul, matvec, vecdot
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.model import Configuration, Rod
from scan2flex_jax.rod.support import AbstractSupport

_OPEN = 0.45  # of the length: speed of a loop at its top, from one end (0) to the other (1)
_DENSE = 257  # points of the curve that is cut into nodes: its polygon is too short by less than 1e-4 of its length


def default_start(rod: Rod, down: Float[Array, "3"], turns: Int[Array, ""] | int = 0) -> Configuration:
    """The generic start of a rod: a sag between its ends, or through its supports where the start is free."""
    sag = sagging_start(rod.boundary, rod.length, down, turns, rod.elements)
    hints = [(e.anchor, *e.hint(rod.length)) for e in rod.effects if isinstance(e, AbstractSupport)]
    if not hints:
        return sag
    free = rod.boundary.held[0, 0] == 0
    through = curve_start(_through(hints, rod.boundary, rod.length, down), rod.boundary, turns, rod.elements)
    return jax.tree.map(lambda a, b: jnp.where(free, a, b), through, sag)


def _through(hints, boundary, length, down):
    """Points of a curve through supports, each ``(anchor, s, direction)`` (`AbstractSupport.hint`), and the end if it is held.

    Places that are not known follow from the anchors along the mean direction of the cable, centred if none is known. Between
    two places the curve sags until it is about as long as the cable there; beyond the first and the last it is straight.
    """
    held, first = boundary.held[1, 0] > 0, hints[0][0]
    anchors = jnp.stack([*(a for a, _, _ in hints), jnp.where(held, boundary.position[1], first)])
    s = jnp.stack([*(s for _, s, _ in hints), jnp.where(held, length, hints[0][1])])
    known = ~jnp.isnan(s)
    s = jnp.where(known, s, 0.0)
    there = jnp.append(jnp.ones(len(hints), bool), held)
    both = (known[:, None] & known[None, :])[:, :, None] * (s[:, None] - s[None, :])[:, :, None]
    along = sum(direction for *_, direction in hints)
    along = along + jnp.sum(both * (anchors[:, None] - anchors[None, :]), axis=(0, 1)) / length**2
    size = jnp.linalg.norm(along)
    along = jnp.where(size > 0, along / jnp.where(size > 0, size, 1.0), boundary.rotation[0, :, 2])
    at = anchors @ along
    of = jnp.where(jnp.any(known), known, there)  # the places that determine where the cable begins
    shift = jnp.sum(of * (jnp.where(known, s, 0.5 * length) - at)) / jnp.sum(of)
    s = jnp.where(known, s, at + shift)
    order = jnp.argsort(s)
    s, anchors = s[order], anchors[order]
    t = length * jnp.linspace(0.0, 1.0, _DENSE)
    k = jnp.clip(jnp.searchsorted(s, t, side="right") - 1, 0, len(s) - 2)
    long, chord = s[k + 1] - s[k], anchors[k + 1] - anchors[k]
    part = jnp.where(long > 0, jnp.clip((t - s[k]) / jnp.where(long > 0, long, 1.0), 0.0, 1.0), 1.0)
    straight = jnp.linalg.norm(chord, axis=1)
    depth = jnp.sqrt(0.375 * straight * jnp.clip(long - straight, 0.0, long))  # of a flat parabola that is ``long``
    weight = jnp.linalg.norm(down)
    side = jnp.where(weight > 0, down / jnp.where(weight > 0, weight, 1.0), curves.frame_on(along)[:, 0])
    beyond = jnp.minimum(t - s[0], 0.0) + jnp.maximum(t - s[-1], 0.0)
    sag = (4.0 * depth * part * (1.0 - part))[:, None] * side
    return anchors[k] + part[:, None] * chord + sag + beyond[:, None] * along


def sagging_start(
    boundary: Boundary,
    length: Float[Array, ""],
    gravity: Float[Array, "3"],
    turns: Int[Array, ""] | int = 0,
    elements: int = 40,
) -> Configuration:
    """A cubic Hermite curve between the clamps that sags along gravity until it is as long as the cable.

    A free end gives the straight rod along the start's tangent. ``turns`` as in the study format. Between clamps that are
    nearly opposite and near each other the curve is a loop, in the plane in which the clamps' frames have no twist.
    """
    p0, p1 = boundary.position
    free_end = boundary.held[1, 0] == 0
    chord = p1 - p0
    distance = jnp.linalg.norm(chord)
    along = jnp.where(distance > 1e-9 * length, chord / jnp.maximum(distance, 1e-12 * length), boundary.rotation[0, :, 2])
    weight = jnp.linalg.norm(gravity)
    down = jnp.where(weight > 0, gravity / jnp.where(weight > 0, weight, 1.0), boundary.rotation[0, :, 0])
    ends = [jnp.where(boundary.held[e, 3] > 0, boundary.rotation[e, :, 2], along) for e in (0, 1)]
    t = jnp.linspace(0.0, 1.0, _DENSE)[:, None]
    hermite = (2 * t**3 - 3 * t**2 + 1) * p0 + (3 * t**2 - 2 * t**3) * p1 + _loop(t, boundary, distance, length)
    reach = (t**3 - 2 * t**2 + t) * ends[0] + (t**3 - t**2) * ends[1]
    flat = boundary.held[:, 3]  # a clamp keeps its tangent while the curve sags, a ball joint lets it tilt
    sag = 4.0 ** (1 + flat[0] * flat[1]) * t ** (1 + flat[0]) * (1 - t) ** (1 + flat[1]) * down

    def too_long(m, a):
        return curves.arc_length(hermite + m * reach + a * sag)[-1] > length

    most = jnp.maximum(distance, 0.5 * length)
    m = _bisect(lambda x: too_long(x, 0.0), most)
    a = _bisect(lambda x: too_long(m, x), length)
    straight = p0 + t * length * boundary.rotation[0, :, 2]
    points = jnp.where(free_end, straight, hermite + m * reach + a * sag)
    return curve_start(points, boundary, turns, elements)


def _loop(t, boundary, distance, length):
    """Displacement to both sides that keeps a curve between opposite clamps from folding back on itself, zero elsewhere.

    Frames that a half turn carries into each other have its axis across both tangents: the loop turns about it.
    """
    R, clamped = boundary.rotation, boundary.held[0, 3] * boundary.held[1, 3]
    opposite = clamped * jnp.clip(-2.0 * vecdot(R[0, :, 2], R[1, :, 2]) - 1.0, 0.0, 1.0)
    turn = matmul(R[0].T, R[1])
    half = 0.5 * jnp.arctan2(turn[1, 0], turn[0, 0])
    side = matvec(R[0], jnp.stack([jnp.sin(half), -jnp.cos(half), 0.0]))  # the axis (cos, sin, 0) times the tangent
    slope = jnp.maximum(_OPEN * length - 1.5 * distance, 0.0)
    return opposite * slope * 8.0 * t**2 * (1 - t) ** 2 * (2 * t - 1) * side


def curve_start(
    points: Float[Array, "m 3"], boundary: Boundary, turns: Int[Array, ""] | int = 0, elements: int = 40
) -> Configuration:
    """Nodes equally spaced along a given curve (m) that goes from the start to the end of the cable."""
    r = curves.resample(points, elements + 1)
    tangent = curves.tangents(r)
    for end, node in ((0, 0), (1, -1)):
        tangent = tangent.at[node].set(jnp.where(boundary.held[end, 3] > 0, boundary.rotation[end, :, 2], tangent[node]))
    first = jnp.where(boundary.held[0, 3] > 0, boundary.rotation[0], curves.frame_on(tangent[0]))
    R = curves.transported_frames(tangent, first)
    lack = R[-1].T @ boundary.rotation[1]
    both = boundary.held[0, 3] * boundary.held[1, 3]
    twist = both * (jnp.arctan2(lack[1, 0], lack[0, 0]) + 2.0 * jnp.pi * turns)
    R = curves.turned_about_tangent(R, twist * jnp.linspace(0.0, 1.0, elements + 1))
    return Configuration(r, R)


def complete_curve(points: np.ndarray, boundary: Boundary, length: float) -> np.ndarray:
    """Measured points (m, 3), extended to the supports where they end short; to a free end straight, up to ``length``."""
    held, position = np.asarray(boundary.held)[:, 0] > 0, np.asarray(boundary.position)
    first = position[0] if held[0] else points[0]
    measured = np.sum(np.linalg.norm(np.diff(points, axis=0), axis=1)) + np.linalg.norm(points[0] - first)
    onward = points[-1] - points[-2]
    onward = points[-1] + max(length - measured, 0.0) * onward / np.linalg.norm(onward)
    return np.concatenate([first[None], points, (position[1] if held[1] else onward)[None]])


def _bisect(too_large, high):
    """Largest x in [0, high] (to high/2^24) with ``too_large(x)`` false; `too_large` is monotone."""

    def halve(_, bracket):
        low, up = bracket
        middle = 0.5 * (low + up)
        far = too_large(middle)
        return jnp.where(far, low, middle), jnp.where(far, middle, up)

    low, _ = jax.lax.fori_loop(0, 24, halve, (0.0 * high, high))
    return jnp.where(too_large(high), low, high)
