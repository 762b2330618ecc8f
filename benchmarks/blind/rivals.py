"""Which kinds of effect do the noise-free shapes not tell from the truth?

Two stages, both with the true covariance of the noise, with EI and GJ free, and with the stated tolerances (and the
background, where there is one) as priors:

1. to first order about the baseline fit, every kind at every place is a handful of columns; all places come
   from one basis (a bump of curvature, stiffness, mass or force in each mesh interval) by linear algebra: `screen`;
2. the kinds that leave little are refitted in full (`refits`).

`left` is `-2 log L` of what remains; the truth itself leaves nothing. A kind is accepted when it leaves less than
`2 * NATS`. A tether (which a weak long spring turns into a point load) and a support plane are tried only as truths.
"""

from dataclasses import replace

import numpy as np

from . import effects as fx
from .refits import EDGE_RANGE, NATS, Fit, refit
from .rod import back_substitute, intervals
from .shapes import EPS

REFITS = 7  # rivals refitted per case, those that leave least to first order
HOPE = 0.4  # of the plain misfit: a rival that leaves more to first order (and more than the truth) is not refitted
RIDGE = 1e-5  # of the mean square of the columns: holds back what EI and GJ absorb (a vertical load) to first order
UNMIXED = {"nonlinear_bending", "anisotropic_bending", "bend_twist_coupling"}  # never together: one law at a time
SPANS = (0.03, 0.06, 0.1, 0.16, 0.25, 0.35)  # widths over L that are scanned
KINK_SPANS = (0.03, 0.06, 0.1, 0.16)


def screen(model, lens, targets, fit):
    """To first order: what each kind leaves, and the effect that does it."""
    d = fit.misfit(model)
    base = fit.columns(model, fit.start())
    Q = np.linalg.svd(base, full_matrices=False)[0]

    def clean(columns):
        columns = fit.free(columns)
        return columns - Q @ (Q.T @ columns)

    d = d - Q @ (Q.T @ d)
    plain, found = float(d @ d), {}

    partners = [e["kind"] for e in model.effects]
    skip = {*partners, *(UNMIXED if set(partners) & UNMIXED else ())}

    def consider(kind, columns, make):
        if kind in skip:
            return
        gram = columns.T @ columns
        ridge = RIDGE * np.trace(gram) / len(gram) + 1e-300
        b = -np.linalg.solve(gram + ridge * np.eye(len(gram)), columns.T @ d)
        left = float(((d + columns @ b) ** 2).sum())
        if left < found.get(kind, (np.inf,))[0]:
            found[kind] = left, make(b)

    for kind, changes, make in _global_kinds(model):
        consider(kind, clean(model.columns(lens, changes)), make)
    _local_kinds(model, lens, clean, consider)
    return plain, found


def _global_kinds(model):
    cable, F, eps = model.scene.cable, model.F, 1j * EPS
    L = cable.length

    def with_effect(**effect):
        return fx.build(model.scene, [*model.effects, effect], F.sigma)

    def shift(kind, name, unit, shape=(3,)):
        basis = np.eye(int(np.prod(shape))).reshape(-1, *shape)
        changes = [with_effect(kind=kind, **{name: eps * unit * e}) for e in basis]
        return kind, changes, lambda b: {"kind": kind, name: (unit * b).reshape(shape)}

    yield shift("natural_curvature", "curvature", 1 / L)
    yield shift("bend_twist_coupling", "coupling", 0.1, (2,))
    yield shift("uniform_load", "force", cable.density * 9.81)
    yield shift("clamp_rotation", "rotation", 1.0, (2, 3))
    yield shift("clamp_offset", "offset", L, (2, 3))
    yield shift("scan_offset", "offset", L)
    yield ("scan_scale", [with_effect(kind="scan_scale", factor=1 + eps)],
           lambda b: {"kind": "scan_scale", "factor": 1 + b[0]})
    yield ("length_error", [with_effect(kind="length_error", length=F.length + eps)],
           lambda b: {"kind": "length_error", "length": L + b[0]})
    if not any(e["kind"] == "anisotropic_bending" for e in model.effects):
        yield ("anisotropic_bending",
               [with_effect(kind="anisotropic_bending", ratio=1 + eps, angle=a) for a in (0.0, np.pi / 4)],
               lambda b: {"kind": "anisotropic_bending", "ratio": np.exp(np.clip(np.hypot(*b), 1e-3, 1)),
                          "angle": 0.5 * np.arctan2(b[1], b[0])})
    for k in np.array([1.0, 2.0, 3.5, 6.0, 10.0]) / L:
        yield ("nonlinear_bending", [with_effect(kind="nonlinear_bending", slip_curvature=k, ratio=1 - eps)],
               lambda b, k=k: {"kind": "nonlinear_bending", "slip_curvature": k, "ratio": np.clip(1 - b[0], 0.1, 0.98)})
    yield ("extensibility", [(replace(F, axial=F.axial + eps / cable.bending), 1.0, 0.0)],
           lambda b: {"kind": "extensibility", "axial_stiffness": cable.bending / max(b[0], 1e-7)})
    grips = [(F.grip[0] + eps, F.grip[1]), (F.grip[0], F.grip[1] + eps)]
    yield ("elastic_clamp", [(replace(F, grip=g), 1.0, 0.0) for g in grips],
           lambda b: {"kind": "elastic_clamp", "stiffness": 1 / np.maximum(b, 1e-4 * L / cable.bending)})


def _local_kinds(model, lens, clean, consider):
    """Places are scanned with columns that are sums of the basis of `bumps`."""
    F, cable, n = model.F, model.scene.cable, len(model.F.sigma) - 1
    L, s = cable.length, 0.5 * (F.sigma[1:] + F.sigma[:-1])
    bump = {name: clean(C) for name, C in bumps(model, lens).items()}
    for i in range(2, n - 1):
        force = bump["force"][:, i::n]
        place = {"position": F.sigma[i] * L}
        consider("point_load", force, lambda b, at=place: {"kind": "point_load", **at, "force": b})
        g = model.scene.gravity
        consider("point_mass", force @ g[:, None],
                 lambda b, at=place: {"kind": "point_mass", **at, "mass": max(b[0], 1e-6)})
    for width in SPANS:
        for at in np.arange(max(EDGE_RANGE, width / 2), 1 - max(EDGE_RANGE, width / 2) + 1e-9, 1 / 48):
            half = 0.5 / n
            box = np.clip((np.minimum(s + half, at + width / 2) - np.maximum(s - half, at - width / 2)) * n, 0, 1)
            span = {"position": at * L, "width": width * L}
            for kind in ("stiffness", "density"):
                consider(f"{kind}_profile", bump[kind] @ box[:, None], lambda b, kind=kind, at=span: {
                    "kind": f"{kind}_profile", **at, "factor": float(np.clip(1 + b[0], 0.2, 5))})
            if width in KINK_SPANS:
                three = np.stack([bump["curvature"][:, k * n : (k + 1) * n] @ box for k in range(3)], 1)
                consider("kink", three, lambda b, at=span: {"kind": "kink", **at, "angle": b * at["width"]})


def bumps(model, lens):
    """Whitened response to a unit force at each node and to a unit bump in each interval."""
    F, eps, n = model.F, 1j * EPS, len(model.F.sigma) - 1
    fields = {
        "force": [replace(F, force=F.force + eps * e) for e in np.eye(3)],
        "curvature": [replace(F, natural=F.natural + eps * e) for e in np.eye(3)],
        "stiffness": [replace(F, compliance=F.compliance * (1 - eps))],
        "density": [replace(F, load=F.load + eps * model.scene.cable.density * model.scene.gravity)],
    }
    model.factor()
    names = [(name, f) for name, many in fields.items() for f in many]
    rows = [intervals(f, model.y).imag.reshape(-1, n, 13) / EPS for _, f in names]
    out = {name: [] for name in fields}
    for p in range(len(lens.matrices)):
        right = np.zeros((13 * (n + 1), len(names) * n))
        for k, r in enumerate(rows):
            j = np.arange(n)
            right[7 + 13 * j[:, None] + np.arange(13), (k * n + j)[:, None]] = r[p]
        dr = -back_substitute(model.lus[p], right).reshape(n + 1, 13, -1)[:, :3]
        C = lens.whiten(model.across(lens, p, model.scale * lens.see(dr, p)), p)
        for k, (name, _) in enumerate(names):
            out[name].append((p, C[:, k * n : (k + 1) * n]))
    poses = range(len(lens.matrices))
    return {name: np.concatenate([np.concatenate([c for q, c in many if q == p], axis=1) for p in poses])
            for name, many in out.items()}


def accepted(model, lens, targets, tolerance, truths):
    """The kinds that explain the targets as well as the true effects `truths` (one, or none for a hidden truth).

    `model` is solved without the effect in question (but with its partner, when there are two). Gives the list, what
    each kind leaves (refitted or to first order), what the rod without it leaves, and its EI and GJ.
    """
    partners = model.effects
    left0, plain = refit(model, lens, targets, tolerance, partners, steps=8)
    if plain is None:
        return None
    fit = Fit(plain, lens, targets, tolerance, plain.effects)
    _, found = screen(plain, lens, targets, fit)
    left = {kind: value for kind, (value, _) in found.items()}
    bar = max([HOPE * left0, 60.0] + [1.2 * left[t] for t in truths if t in left])
    order = [k for k in sorted(left, key=left.get) if left[k] < bar and k not in truths][:REFITS]
    refits = {}
    for kind in order:
        effect = found[kind][1]
        better, _ = refit(plain, lens, targets, tolerance, [*plain.effects, effect])
        refits[kind] = min(better, left0)
    good = [k for k, v in refits.items() if v < 2 * NATS]
    return {"accept": [*truths, *good], "plain": left0, "first_order": left, "refitted": refits,
            "stiffness": (plain.scene.cable.bending, plain.scene.cable.torsion)}

