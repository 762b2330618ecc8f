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
from scan2flex_jax.scan.settings import USUAL

_STATIONS = 40


def _stations(fit) -> np.ndarray:
    """Station (n,) of each point of the cloud, of `_STATIONS` along the curve."""
    return np.clip((fit.parameter / (len(fit.points) - 1) * _STATIONS).astype(int), 0, _STATIONS - 1)


def foreign(fit, radius: float) -> np.ndarray:
    """Mask of the stations (b,) where few of the points near the curve lie on it (a connector), and of their neighbours."""
    station, away = _stations(fit), np.abs(fit.residual)
    near, on = (
        np.bincount(station[away < reach], minlength=_STATIONS) for reach in (radius, min(USUAL.on * fit.sigma, radius))
    )
    found = (near >= USUAL.enough) & (on < USUAL.unexplained * near)
    return found | np.r_[found[1:], False] | np.r_[False, found[:-1]]


def doubts(curve, fit, radius, length, start, end, few: bool = False) -> tuple[list[str], bool]:
    """Doubts about an extracted `CentreCurve`, in sentences, and whether one of them questions what was seen: not what is
    missing at an end or in a gap, nor a direction at a clamp, which its block may bend over a radius or two.

    For ``few`` hand-set points only length and ends are tested.
    """
    of_length, of_clamps = _of_length(curve, length, start, end), _of_clamps(curve, start, end, radius)
    if few:
        return of_length + of_clamps, False
    of_fit, of_shape = _of_fit(fit, radius), _of_shape(curve, radius)
    longer = bool(of_length) and clamp_to_clamp(curve, start, end) > length
    off = _of_clamps(curve, _reached(curve, start, 0, radius), _reached(curve, end, -1, radius), radius)
    return of_fit + of_length + _of_gaps(curve) + of_shape + of_clamps, bool(of_fit or of_shape or longer or off)


def _reached(curve, clamp, k, radius):
    """The position of a clamp that the seen part of the curve reaches, else None."""
    far = clamp is None or abs((curve.points[k] - clamp.position) @ curve.tangents[k]) >= USUAL.reached * radius
    return None if far else replace(clamp, tangent=None)


def _of_fit(fit, radius):
    """Doubts about the last stage: not converged, or pulled off the curve by the points.

    Score and information give each station's displacement u (2,) across the curve, and its chi-squared.
    """
    said = [] if fit.converged else ["the last stage did not converge: look at the picture"]
    K = len(fit.points)
    station = _stations(fit)
    at = (np.arange(_STATIONS) + 0.5) / _STATIONS * (K - 1)
    tangent = np.asarray(spline.evaluate(spline.coefficients(jnp.asarray(fit.points)), jnp.asarray(at), 1))
    normals = np.linalg.svd(tangent[:, None])[2][:, 1:]
    g, precision = np.zeros((_STATIONS, 3)), np.zeros((_STATIONS, 3, 3))
    np.add.at(g, station, fit.score)
    np.add.at(precision, station, fit.information)
    g = np.einsum("bni,bi->bn", normals, g)
    precision = np.einsum("bni,bij,bmj->bnm", normals, precision, normals)
    u = np.linalg.solve(precision + np.eye(2) / radius**2, g[..., None])[..., 0]
    significant = np.einsum("bn,bnm,bm->b", u, precision, u) > USUAL.significant
    size = np.where(significant, np.linalg.norm(u, axis=1), 0.0)
    mean = float(np.sqrt(np.mean(size**2)))
    if mean > max(USUAL.pulled * fit.sigma, USUAL.pulled_radii * radius):
        said.append(f"the points indicate a curve {1e3 * mean:.2g} mm (root mean square) away from this one")
    elif size.max() > max(radius, fit.sigma):
        where = 100.0 * at[np.argmax(size)] / (len(fit.points) - 1)
        said.append(f"near {where:.0f} % of the length the points lie {1e3 * size.max():.2g} mm off the curve's surface")
    return said


def _of_length(curve, length, start, end):
    """Length from clamp to clamp; up to a free end the scan may be slightly short."""
    if not length or start is None:
        return []
    whole = clamp_to_clamp(curve, start, end)
    if abs(whole / length - 1.0) <= (USUAL.free_agrees if end is None else USUAL.length_agrees):
        return []
    ways = "from the clamp to the free end" if end is None else "from clamp to clamp"
    return [f"{ways} the scan is {whole:.4g} m long where the study says {length:.4g} m"]


def _of_gaps(curve):
    """Doubt about a curve interpolated over a long unseen part."""
    long = [(a, b) for a, b in curve.gaps if b - a > USUAL.long_gap * curve.length]
    said = [f"from s = {a:.3g} m to {b:.3g} m nothing was seen: too much of the length to guess" for a, b in long]
    worst = float(np.max(curve.std))
    if not said and worst > max(USUAL.on * curve.noise, USUAL.vague * curve.length):
        said.append(f"at s = {curve.arc_length[np.argmax(curve.std)]:.3g} m the curve is uncertain by {1e3 * worst:.2g} mm")
    return said


def _of_shape(curve, radius):
    said = []
    if abs(curve.radius.mean / radius - 1.0) > max(USUAL.radius_agrees, curve.noise / radius):
        said.append(f"the points lie {curve.radius.mean:.4g} m from the curve where the study says a radius of {radius:.4g} m")
    if curve.radius.share < USUAL.unexplained:
        said.append(f"only {100 * curve.radius.share:.0f} % of the points near the curve lie on a tube around it")
    bend = np.linalg.norm(np.diff(curve.tangents, axis=0), axis=1) / curve.arc_length[1]
    if bend.max() * radius > USUAL.kink:
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
        if beside > max(radius, USUAL.beside * curve.noise):
            said.append(f"the curve misses the {name} clamp by {1e3 * beside:.2g} mm")
        if one.tangent is None:
            continue
        angle = float(np.arccos(np.clip(curve.tangents[k] @ one.tangent, -1.0, 1.0)))
        step = curve.arc_length[1]
        a, b = (0, 8) if k == 0 else (-9, -1)
        bend = float(np.linalg.norm(curve.tangents[b] - curve.tangents[a]) / (8 * step))
        if angle > USUAL.tangent_agrees + min(bend * (float(np.linalg.norm(off)) + 4 * step), USUAL.most_bent):
            said.append(f"at the {name} the curve points {np.degrees(angle):.0f} degrees away from the clamp's direction")
    return said


def clamp_to_clamp(curve, start, end) -> float:
    """Length (m) of the curve plus the missing parts at its ends, along it: a lateral offset from a clamp adds nothing."""
    first = (curve.points[0] - start.position) @ curve.tangents[0]
    last = 0.0 if end is None else (end.position - curve.points[-1]) @ curve.tangents[-1]
    return float(curve.length + first + last)
