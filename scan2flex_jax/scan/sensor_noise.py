"""Mixture model of a scan's points: honest, flying, or stray, with shares and sizes estimated from the residuals.

On its ray from a viewpoint a point lies a distance e behind the surface that the ray met. A viewpoint's points are

* *honest*: e is normal with standard deviation ``sigma h``; ``h`` grows where the ray grazes the surface;
* *flying*: pixels that mix the cable's silhouette with the background: honest noise plus a depth between 0 and
  ``reach``. They lie *behind* the surface, never in front; treated as honest they push the whole curve away from the
  sensor. Their share depends on the distance of the ray from the silhouette, so there is one share per ring of the tube;
* *strays*: anywhere within the ``window``, and anywhere around the cable: a share ``band`` of their rays meets it.

Expectation-maximisation: `judge` gives for every point the noise part of e, without flight, and its weight; `update`
re-estimates the mixture from them. Without viewpoints there is no ray, so no flight.

Symbols: e, sigma, reach, window: m; h, share: -; u = e/sigma.
Reference: Dempster, Laird, Rubin (1977); Louis (1982) for the information lost by the unknown classification.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

from scan2flex_jax.scan.settings import USUAL

_RINGS = np.array([0.5, 0.8, 0.93])  # of r: bounds between the rings of the tube, from the middle of the view outwards
_ROOT = np.sqrt(2.0 * np.pi)


@dataclass(frozen=True)
class Mixture:
    """Deviation sigma, reach of a flight, and window (m); shares of flying points per ring, of strays, of viewpoints.

    ``band``: share of the strays whose rays meet the tube. All honest rays do; strays lie anywhere around the cable.
    """

    sigma: float
    reach: float
    window: float
    flying: Float[np.ndarray, " rings"]
    strays: float
    views: Float[np.ndarray, " v"]
    band: float = 1.0


@dataclass(frozen=True)
class Judged:
    """Per viewpoint and point: weight (-), noise part of e (m), its mean square (m^2); ring; share of the information.

    ``known`` is the share of the information that remains under the unknown classification.
    """

    weight: Float[np.ndarray, "v n"]
    noise: Float[np.ndarray, "v n"]
    square: Float[np.ndarray, "v n"]
    flies: Float[np.ndarray, "v n"]
    ring: np.ndarray
    known: float


def first_guess(sigma: float, window: float, views: int, band: float = 1.0) -> Mixture:
    """Initial mixture: few strays, few flying points."""
    flying = np.full(len(_RINGS) + 1, 0.05)
    return Mixture(sigma, max(USUAL.shortest * sigma, 0.5 * window), window, flying, 0.03, np.full(views, 1.0 / views), band)


def judge(e, h, side, real, m: Mixture) -> Judged:
    """Expectation step for residuals ``e`` (v, n) in m, their factors ``h`` and the rays' distance ``side`` (in r)."""
    s = m.sigma * h
    ring = np.searchsorted(_RINGS, side)
    share = m.flying[ring]
    a, b = e / s, (e - m.reach) / s
    normal = np.exp(-0.5 * np.minimum(a**2, 80.0)) / _ROOT
    beyond = np.exp(-0.5 * np.minimum(b**2, 80.0)) / _ROOT
    mass = np.maximum(ndtr(a) - ndtr(b), 1e-30)
    inside = np.abs(e) < m.window
    prior = (1.0 - m.strays) * m.views[:, None] * inside
    honest, flight = prior * (1.0 - share) * normal / s, prior * share * mass / m.reach
    total = np.sum(honest + flight, axis=0) + m.strays * m.band / (2.0 * m.window)
    honest, flight = honest / total * real, flight / total * real
    mean = s * (beyond - normal) / mass  # of the noise of a flying point, and its mean square
    square = s**2 * (1.0 + (b * beyond - a * normal) / mass)
    mean, square = np.where(mass > 1e-20, mean, 0.0), np.where(mass > 1e-20, np.maximum(square, 0.0), s**2)
    weight = honest + flight
    first, second = honest * e + flight * mean, honest * e**2 + flight * square
    inverse = 1.0 / np.maximum(weight, 1e-300)
    lost = np.sum((second - np.where(weight > 0, first**2, 0.0)) / s**4)
    known = 1.0 - lost / max(np.sum(weight / s**2), 1e-300)
    return Judged(weight, first * inverse, second / h**2, flight, ring, float(np.clip(known, 0.3, 1.0)))


def update(m: Mixture, j: Judged, e, real, least: float) -> Mixture:
    """Maximisation step over the ``real`` points; sigma is at least ``least`` (m)."""
    sigma = max(float(np.sqrt(np.sum(j.square) / max(np.sum(j.weight), 1e-12))), least)
    flies, everything = (np.bincount(j.ring.ravel(), x.ravel(), len(m.flying)) for x in (j.flies, j.weight))
    flying = np.minimum(flies / (everything + USUAL.doubt), USUAL.most_flying)
    depth = np.sum(j.flies * np.maximum(e, 0.0)) / max(np.sum(j.flies), 1e-12)
    shortest = USUAL.shortest * sigma
    seen = np.sum(j.weight, axis=1)
    seen = seen + USUAL.equal * np.mean(seen) + 1.0
    lost = 1.0 - np.sum(j.weight) / max(np.sum(real), 1)
    return replace(
        m,
        sigma=sigma,
        flying=flying,
        reach=float(np.clip(2.0 * depth, shortest, max(m.window, shortest))),
        strays=float(np.clip(lost, *USUAL.strays)),
        views=seen / np.sum(seen),
    )
