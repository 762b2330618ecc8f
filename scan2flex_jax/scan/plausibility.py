"""Plausibility of an extracted curve: the doubts about it, in sentences; any of them makes it not `sure`.

A curve that followed a wrong path fits badly somewhere, is too long or too short, bends more sharply than a cable can, or
leaves nearby points unexplained. Each indicator is compared with the noise of the points:

* *pulls*: at each station along the cable, score and information of the points give a displacement ``u`` of the curve.
  Smoothness may keep the curve from following noise, never from following the cable;
* *length* from clamp to clamp against the stated one, *directions* at the clamps against theirs, the *radius*;
* *points near the curve* that lie on no surface around it.

Symbols: r radius, L length, u, s: m; kappa curvature, 1/m.
"""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np

from scan2flex_jax.scan import spline

LENGTH_AGREES, RADIUS_AGREES, TANGENT_AGREES = 0.01, 0.15, 0.15  # of L, of r, rad
FREE_AGREES = 0.03  # of L, with one free end
_STATIONS = 40
_PULLED = 0.5  # of sigma or 0.1 r, whichever is larger: a larger mean pull is significant
_HARD, _SIGNIFICANT = 1.0, 25.0  # of r: pull of a single station; its chi-squared with two degrees of freedom
_LONG_GAP = 0.16  # of L: longest gap that may be interpolated
_VAGUE = 3.0  # of the noise of a point: a curve with a larger std, also above a thousandth of L, is a guess
_BESIDE = 2.5  # of the noise: largest offset of an end from its clamp; also for the radius
_MOST_BENT = 0.6  # rad: largest bend between the last seen point and the clamp
_REACHED = 2.0  # radii before its clamp: an end that comes this near was seen
_KINK = 0.7  # kappa r out of reach of a cable
_TOLD = 20  # points near the curve at a station, from which their share on it counts
_UNEXPLAINED = 0.4  # smallest share of the points within a radius of the surface that must lie on it


def pulls(fit, radius: float):
    """Score-test displacements (b, 2) of each station in m, their chi-squared (b,), parameters (b,)."""
    K = len(fit.points)
    station = np.clip((fit.parameter / (K - 1) * _STATIONS).astype(int), 0, _STATIONS - 1)
    c = spline.coefficients(jnp.asarray(fit.points))
    at = (np.arange(_STATIONS) + 0.5) / _STATIONS * (K - 1)
    tangent = np.asarray(spline.evaluate(c, jnp.asarray(at), 1))
    normals = np.linalg.svd(tangent[:, None])[2][:, 1:]
    g = np.stack([np.bincount(station, x, _STATIONS) for x in fit.score.T], axis=1)
    told = np.stack([np.bincount(station, x, _STATIONS) for x in fit.information.reshape(len(station), 9).T], axis=1)
    g = np.einsum("bni,bi->bn", normals, g)
    told = np.einsum("bni,bij,bmj->bnm", normals, told.reshape(-1, 3, 3), normals)
    held = told + np.eye(2) / radius**2
    u = -np.linalg.solve(held, g[..., None])[..., 0]
    return u, np.einsum("bn,bnm,bm->b", u, told, u), at


def foreign(fit, radius: float) -> np.ndarray:
    """Mask of the stations (b,) where few of the points near the curve lie on it (a connector), and of their neighbours."""
    station = np.clip((fit.parameter / (len(fit.points) - 1) * _STATIONS).astype(int), 0, _STATIONS - 1)
    away = np.abs(fit.residual)
    near, on = (np.bincount(station[away < reach], minlength=_STATIONS) for reach in (radius, min(3.0 * fit.sigma, radius)))
    found = (near >= _TOLD) & (on < _UNEXPLAINED * near)
    return found | np.r_[found[1:], False] | np.r_[False, found[:-1]]


def doubts(curve, fit, radius, length, start, end, few: bool = False) -> list[str]:
    """Doubts about an extracted `CentreCurve`, in sentences; for ``few`` hand-set points only length and ends are tested."""
    if few:
        return _of_length(curve, length, start, end) + _of_clamps(curve, start, end, radius)
    said = _of_fit(curve, fit, radius) + _of_length(curve, length, start, end) + _of_gaps(curve) + _of_shape(curve, radius)
    return said + _of_clamps(curve, start, end, radius)


def astray(curve, fit, radius, length, start, end) -> list[str]:
    """Those of the doubts that question what was seen: not what is missing at an end or in a gap, nor a direction at a clamp,
    which its block may bend over a radius or two."""
    longer = bool(length) and start is not None and clamp_to_clamp(curve, start, end) > length
    said = _of_fit(curve, fit, radius) + _of_shape(curve, radius)
    said += _of_length(curve, length, start, end) if longer else []

    def reached(clamp, k):
        far = clamp is None or abs((curve.points[k] - clamp.position) @ curve.tangents[k]) >= _REACHED * radius
        return None if far else replace(clamp, tangent=None)

    return said + _of_clamps(curve, reached(start, 0), reached(end, -1), radius)


def _of_fit(curve, fit, radius):
    """Doubts about the last stage."""
    return ([] if fit.settled else ["the last stage did not converge: look at the picture"]) + _of_pulls(curve, fit, radius)


def _of_pulls(curve, fit, radius):
    u, chi, at = pulls(fit, radius)
    size = np.linalg.norm(u, axis=1)
    seen = fit.information.any(axis=(1, 2))
    if not seen.any():
        return []
    clear = np.where(chi > _SIGNIFICANT, size, 0.0)
    said = []
    mean = float(np.sqrt(np.mean(clear**2)))
    if mean > max(_PULLED * fit.sigma, 0.1 * radius):
        said.append(f"the points indicate a curve {1e3 * mean:.2g} mm (root mean square) away from this one")
    elif clear.max() > max(_HARD * radius, fit.sigma):
        where = 100.0 * at[np.argmax(clear)] / (len(fit.points) - 1)
        said.append(f"near {where:.0f} % of the length the points lie {1e3 * clear.max():.2g} mm off the curve's surface")
    return said


def _of_length(curve, length, start, end):
    """Length from clamp to clamp; up to a free end the scan may be slightly short."""
    if not length or start is None:
        return []
    whole = clamp_to_clamp(curve, start, end)
    if abs(whole / length - 1.0) <= (FREE_AGREES if end is None else LENGTH_AGREES):
        return []
    ways = "from the clamp to the free end" if end is None else "from clamp to clamp"
    return [f"{ways} the scan is {whole:.4g} m long where the study says {length:.4g} m"]


def _of_gaps(curve):
    """Doubt about a curve interpolated over a long unseen part."""
    long = [(a, b) for a, b in curve.gaps if b - a > _LONG_GAP * curve.length]
    said = [f"from s = {a:.3g} m to {b:.3g} m nothing was seen: too much of the length to guess" for a, b in long]
    worst = float(np.max(curve.std))
    if not said and worst > max(_VAGUE * curve.noise, 1e-3 * curve.length):
        said.append(f"at s = {curve.arc_length[np.argmax(curve.std)]:.3g} m the curve is uncertain by {1e3 * worst:.2g} mm")
    return said


def _of_shape(curve, radius):
    said = []
    if abs(curve.radius.mean / radius - 1.0) > max(RADIUS_AGREES, curve.noise / radius):
        said.append(f"the points lie {curve.radius.mean:.4g} m from the curve where the study says a radius of {radius:.4g} m")
    if curve.radius.share < _UNEXPLAINED:
        said.append(f"only {100 * curve.radius.share:.0f} % of the points near the curve lie on a tube around it")
    bend = np.linalg.norm(np.diff(curve.tangents, axis=0), axis=1) / curve.arc_length[1]
    if bend.max() * radius > _KINK:
        where = float(curve.arc_length[np.argmax(bend)])
        said.append(f"at s = {where:.3g} m the curve turns more sharply than a cable of this radius can")
    return said


def _of_clamps(curve, start, end, radius):
    said = []
    for one, k, name in ((start, 0, "start"), (end, -1, "end")):
        if one is None:
            continue
        off = curve.points[k] - one.position
        beside = float(np.linalg.norm(off - (off @ curve.tangents[k]) * curve.tangents[k]))
        if beside > max(radius, _BESIDE * curve.noise):
            said.append(f"the curve misses the {name} clamp by {1e3 * beside:.2g} mm")
        if one.tangent is None:
            continue
        angle = float(np.arccos(np.clip(curve.tangents[k] @ one.tangent, -1.0, 1.0)))
        step = curve.arc_length[1]
        a, b = (0, 8) if k == 0 else (-9, -1)
        bend = float(np.linalg.norm(curve.tangents[b] - curve.tangents[a]) / (8 * step))
        if angle > TANGENT_AGREES + min(bend * (float(np.linalg.norm(off)) + 4 * step), _MOST_BENT):
            said.append(f"at the {name} the curve points {np.degrees(angle):.0f} degrees away from the clamp's direction")
    return said


def clamp_to_clamp(curve, start, end) -> float:
    """Length (m) of the curve plus the missing parts at its ends, along it: a lateral offset from a clamp adds nothing."""
    first = (curve.points[0] - start.position) @ curve.tangents[0]
    last = 0.0 if end is None else (end.position - curve.points[-1]) @ curve.tangents[-1]
    return float(curve.length + first + last)
