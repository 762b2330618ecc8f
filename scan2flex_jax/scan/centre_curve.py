"""The extracted centre curve: its ends at the clamps, its uncertainty and its warnings.

Points beyond the clamps, on the block of a clamp, do not count.

Symbols: s arc length (m) from the first to the last point of the cloud that lies on the cable; r radius (m); d3 tangent;
frame (d1, d2, d3) rotation-minimising: without rotation about the tangent.
"""

from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from scan2flex_jax.geometry import curves
from scan2flex_jax.scan import spline
from scan2flex_jax.scan.refine import Refined
from scan2flex_jax.scan.settings import USUAL

POINTS = 201
_FINE = 20  # samples per output point for measuring the arc length


@dataclass(frozen=True)
class RadiusStatistics:
    """Radius measured from the cloud: mean and standard deviation of distances to the curve (m), number of points on the cable.

    ``share``: fraction of the points near the curve that lie on its surface.
    """

    mean: float
    std: float
    points: int
    share: float


@dataclass(frozen=True)
class CentreCurve:
    """Points (m) at even arc length (m) with unit tangents, frames (d1, d2, d3 in columns) and standard deviation (m).

    ``std`` is that of one coordinate across the curve, from the scatter of the points and the estimated smoothness; it grows
    inside gaps. It excludes errors common to all points (a range bias).
    ``noise``: standard deviation of a point from the surface (m); ``gaps``: intervals of s (m) without points;
    ``stages``: intermediate clouds and curves, for plotting; ``warnings``: one sentence each, and ``doubts`` those of them
    that question the curve as a whole; ``astray``: whether one of them questions the part that was seen.
    """

    points: Float[np.ndarray, "n 3"]
    arc_length: Float[np.ndarray, " n"]
    tangents: Float[np.ndarray, "n 3"]
    frames: Float[np.ndarray, "n 3 3"]
    std: Float[np.ndarray, " n"]
    radius: RadiusStatistics
    noise: float
    gaps: tuple[tuple[float, float], ...]
    found_by: str
    along_ray: bool = False
    stages: dict[str, np.ndarray] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    astray: bool = False

    @property
    def sure(self) -> bool:
        """Whether there are no doubts about the curve."""
        return not self.doubts

    @property
    def seen(self) -> np.ndarray:
        """Mask of the points outside the gaps and their edges (n,), where what hid the cable stands near."""
        return ~self.in_gaps(self.arc_length, USUAL.gap_radii * self.radius.mean)

    def in_gaps(self, s: np.ndarray, edge: float = 0.0) -> np.ndarray:
        """Whether arc lengths (m) lie in a gap, or within an ``edge`` (m) of it."""
        return np.any([(s > a - edge) & (s < b + edge) for a, b in [(-1.0, -1.0), *self.gaps]], axis=0)

    @property
    def length(self) -> float:
        """Arc length of the observed part (m); it may end short of the clamps."""
        return float(self.arc_length[-1])


def centre_curve(fit: Refined, radius: float, found_by: str, stages, clamps=(None, None)) -> CentreCurve:
    """Sample a refined spline between the first and the last cloud point on the cable, within the clamps if known (m)."""
    c = spline.coefficients(jnp.asarray(fit.points))
    on = fit.weight > USUAL.certain
    span, gaps_t = _span_and_gaps(np.sort(fit.parameter[on]), c, radius, clamps)
    gaps_t = gaps_t if found_by == "guide points" else _joined(gaps_t)  # guided, what stands between gaps is the cable
    fine = np.linspace(span[0], span[1], _FINE * POINTS + 1)
    q = np.asarray(spline.evaluate(c, jnp.asarray(fine)))
    s = spline.arc_length(q)
    t = np.interp(np.linspace(0.0, s[-1], POINTS), s, fine)
    tangents = spline.unit(np.asarray(spline.evaluate(c, jnp.asarray(t), 1)))
    near = np.abs(fit.residual) < 2.0 * radius
    seen = fit.residual[on]
    stats = RadiusStatistics(
        float(radius + seen.mean()), float(seen.std()), int(on.sum()), float(on.sum() / max(near.sum(), 1))
    )
    return CentreCurve(
        points=np.asarray(spline.evaluate(c, jnp.asarray(t))),
        arc_length=np.linspace(0.0, s[-1], POINTS),
        tangents=tangents,
        frames=np.asarray(_frames(jnp.asarray(tangents))),
        std=_std_across(fit, t, tangents),
        radius=stats,
        noise=fit.sigma,
        gaps=tuple((float(np.interp(a, fine, s)), float(np.interp(b, fine, s))) for a, b in gaps_t),
        found_by=found_by,
        along_ray=fit.along_ray,
        stages=dict(stages),
    )


@jax.jit
def _frames(tangents):
    """Rotation-minimising frames; the first is an arbitrary frame on the first tangent."""
    return curves.transported_frames(tangents, curves.frame_on(tangents[0]))


def _span_and_gaps(t, c, radius, clamps):
    """Parameters of the cloud's first and last point (strays and points behind a clamp do not count), and gaps."""
    speed = float(np.mean(np.linalg.norm(np.asarray(spline.half_knot_tangents(c)), axis=1)))
    wide = max(USUAL.gap_radii * radius, USUAL.tube_of_length * speed * c.shape[1]) / speed
    wide = max(wide, 8.0 * (t[-1] - t[0]) / len(t))
    after = np.searchsorted(t, t + wide) - np.arange(len(t))
    before = np.arange(len(t)) - np.searchsorted(t, t - wide) + 1
    crowd = USUAL.lone * np.median(after)
    first, last = int(np.argmax(after >= crowd)), len(t) - 1 - int(np.argmax(before[::-1] >= crowd))
    t = t[first : last + 1]
    low, high = t[0], t[-1]
    at = [None if p is None else float(spline.nearest(c, jnp.asarray(p)[None])[0]) for p in clamps]
    low = low if at[0] is None or at[0] > 0.5 * (low + high) else max(low, at[0])
    high = high if at[1] is None or at[1] < 0.5 * (low + high) else min(high, at[1])
    breaks = np.flatnonzero(np.diff(t) > wide)
    gaps = [(t[b], t[b + 1]) for b in breaks if t[b] > low and t[b + 1] < high]
    return (low, high), gaps


def _joined(gaps):
    """Gaps, of which two with a shorter island of points between them are one: what stands there need not be the cable, and a
    curve that is led by it strays."""
    out: list[tuple[float, float]] = []
    for a, b in gaps:
        if out and a - out[-1][1] < max(b - a, out[-1][1] - out[-1][0]):
            a = out.pop()[0]  # noqa: PLW2901
        out.append((a, b))
    return out


def _std_across(fit: Refined, t, tangents):
    """Standard deviation (m) of one coordinate across the curve at ``t``."""
    K = len(fit.points)
    W = np.asarray(spline.weights(K, jnp.asarray(t)))
    cov = fit.covariance.reshape(K, 3, K, 3)
    local = np.einsum("nk,kilj,nl->nij", W, cov, W, optimize=True)
    across = np.trace(local, axis1=1, axis2=2) - np.einsum("ni,nij,nj->n", tangents, local, tangents)
    return np.sqrt(np.maximum(0.5 * across, 0.0))
