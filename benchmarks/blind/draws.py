"""Random effects of a kind, with one free number: the amplitude `a` that sets how strong it is.

Each draw returns `(make, first, most)`: `make(a)` gives the effect as a table of the study format, `first` is an
amplitude to start from and `most` the largest that is still sensible. `x` is the plain `Model`, `L` the length (m), `W`
the weight (N).
"""

import numpy as np

from . import rod
from .design import unit


def _at(rng, L, low=0.15, high=0.85):
    return round(rng.uniform(low, high) * L, 4)


def _span(rng, L, low, high):
    return _at(rng, L, 0.2, 0.8), round(rng.uniform(low, high) * L, 4)


def _per_end(rng, end_kind):
    """Two vectors; one of the ends is sometimes left alone, and the far end where no pose clamps it."""
    pair = np.stack([unit(rng), unit(rng)])
    if rng.random() < 0.4:
        pair[rng.integers(2)] = 0
    if not (end_kind == rod.CLAMP).any():
        pair[1] = 0
    return pair if np.abs(pair).any() else _per_end(rng, end_kind)


def _curvatures(x):
    """Largest curvature of each pose, 1/m."""
    d3 = np.linalg.norm(np.diff(x.y[..., 3:7], axis=1), axis=-1) / (np.diff(x.F.sigma) * np.real(x.F.length))
    return 2 * d3.max(-1)


def catalogue(rng, kind, x):
    """A draw of one kind of the study format."""
    cable = x.scene.cable
    L, W, EI = cable.length, cable.length * cable.density * 9.81, cable.bending
    sign, u = rng.choice([-1, 1]), unit(rng)
    if kind in ("kink", "stiffness_profile", "density_profile", "point_mass", "point_load"):
        return _local(rng, kind, L, W=W, u=u, sign=sign)
    if kind in ("tether", "support_plane"):
        return _contact(rng, kind, x, L, W)
    pair, other = _per_end(rng, x.scene.end_kind), np.exp(rng.uniform(-1, 1))
    axis, turn = rng.uniform(-1.5, 1.5), rng.uniform(-np.pi, np.pi)
    slip = np.median(_curvatures(x)) * rng.uniform(0.25, 1.0)
    table = {
        "natural_curvature": (lambda a: {"curvature": a * u}, 0.3 / L, 3 / L),
        "anisotropic_bending": (lambda a: {"ratio": np.exp(sign * a), "angle": axis}, 0.1, 1.1),
        "bend_twist_coupling": (lambda a: {"coupling": a * np.array([np.cos(turn), np.sin(turn)])}, 0.05, 0.6),
        "nonlinear_bending": (lambda a: {"slip_curvature": slip, "ratio": np.exp(-a)}, 0.2, 2.5),
        "extensibility": (lambda a: {"axial_stiffness": 1 / a}, 2e-3 / W, 0.06 / W),
        "uniform_load": (lambda a: {"force": a * u}, 0.02 * W / L, 0.6 * W / L),
        "elastic_clamp": (lambda a: {"stiffness": [1 / a, other / a]}, 0.02 * L / EI, 0.4 * L / EI),
        "clamp_rotation": (lambda a: {"rotation": a * pair}, 0.02, 0.35),
        "clamp_offset": (lambda a: {"offset": a * pair}, 2e-3 * L, 0.04 * L),
        "length_error": (lambda a: {"length": L + sign * a}, 4e-3 * L, 0.05 * L),
        "scan_scale": (lambda a: {"factor": 1 + sign * a}, 4e-3, 0.06),
        "scan_offset": (lambda a: {"offset": a * u}, 2e-3 * L, 0.04 * L),
    }
    make, first, most = table[kind]
    return lambda a: {"kind": kind, **make(a)}, first, most


def _local(rng, kind, L, *, W, u, sign):
    if kind.startswith("point"):
        p = _at(rng, L)
        if kind == "point_mass":
            return lambda a: {"kind": kind, "position": p, "mass": a}, 0.05 * W / 9.81, 1.0 * W / 9.81
        return lambda a: {"kind": kind, "position": p, "force": a * u}, 0.02 * W, 1.0 * W
    if kind == "kink":
        p, w = _at(rng, L), round(rng.uniform(0.03, 0.15) * L, 4)
        return lambda a: {"kind": kind, "position": p, "angle": a * u, "width": w}, 0.05, 1.0
    p, w = _span(rng, L, 0.08, 0.35)
    return lambda a: {"kind": kind, "position": p, "width": w, "factor": np.exp(sign * a)}, 0.2, 1.7


def _contact(rng, kind, x, L, W):
    y = x.y[..., :3]
    if kind == "tether":
        k = int(rng.integers(len(x.F.sigma) // 5, 4 * len(x.F.sigma) // 5))
        anchor = np.round(y[:, k].mean(0) + rng.uniform(0.15, 0.5) * L * unit(rng), 3)
        rest = round(float(np.quantile(np.linalg.norm(y[:, k] - anchor, axis=1), rng.uniform(0, 0.6))), 3)
        p = round(float(x.F.sigma[k]) * L, 4)
        fixed = {"kind": kind, "position": p, "anchor": anchor, "rest_length": rest}
        return lambda a: {**fixed, "stiffness": a}, W / L / 20, 20 * W / L
    up = -x.scene.gravity / np.linalg.norm(x.scene.gravity)
    low = np.sort((y @ up).min(1))[min(1, len(y) - 1)]
    return lambda a: {"kind": kind, "normal": up, "offset": low + a}, 2e-3 * L, 0.06 * L


def hidden(rng, kind, x):
    """A draw of one kind outside of the catalogue."""
    cable, P = x.scene.cable, len(x.y)
    L, W = cable.length, cable.length * cable.density * 9.81
    wave = {"waves": round(rng.uniform(1.0, 4.0), 3), "phase": round(rng.uniform(0, 2 * np.pi), 3)}
    plane, sign, p, u = rng.uniform(0, 2 * np.pi), rng.choice([-1, 1]), _at(rng, L), unit(rng)
    loads, turns = rng.normal(size=(P, 3, 3)) / np.array([1, 1.5, 2])[:, None], rng.normal(size=(P, 2, 3))
    if kind == "bending_friction":
        signs = np.where(rng.permutation(P) < (P + 1) // 2, 1, -1)
        k = float(np.median(_curvatures(x)))
        fixed = {"kind": kind, "scale": 0.3 * k, "sign": signs}
        return lambda a: {**fixed, "moment": a * cable.bending}, 0.02 * k, 0.25 * k
    table = {
        "wavy_bending": (lambda a: {"amplitude": a, **wave}, 0.1, 0.75),
        "wavy_curvature": (lambda a: {"amplitude": [a * np.cos(plane), a * np.sin(plane)], **wave}, 0.5 / L, 8 / L),
        "wavy_mass": (lambda a: {"amplitude": a, **wave}, 0.2, 0.95),
        "taper_stiffness": (lambda a: {"exponent": sign * a}, 0.1, 0.9),
        "taper_mass": (lambda a: {"exponent": sign * a}, 0.1, 0.9),
        "pose_loads": (lambda a: {"harmonics": a * loads}, 0.01 * W / L, 0.4 * W / L),
        "pose_reseating": (lambda a: {"rotation": a * turns}, 0.01, 0.2),
        "point_couple": (lambda a: {"position": p, "couple": a * u}, 0.005 * W * L, 0.2 * W * L),
    }
    make, first, most = table[kind]
    return lambda a: {"kind": kind, **make(a)}, first, most


def settle(make, first, most, strength, target):
    """The amplitude at which `strength(effect)` meets the target (or nearly, at the largest sensible amplitude)."""
    a, got = first, None
    for _ in range(7):
        got = strength(make(a))
        if got is None:
            a, most = a / 2, min(most, a / 1.4)
            continue
        if abs(np.log(got / target)) < 0.04 or (a >= most and got < target):
            break
        a = min(most, a * np.clip(target / max(got, 1e-12), 1 / 8, 8))
    return None if got is None else (make(a), got)
