"""One blind case: draw a cable, poses, noise and a truth; scale it to its strength; solve, check, look for rivals.

The strength is the RMS per coordinate, `sqrt(mean(d^2) / 2)` with `d` the distance between curves, of what the plain
rod cannot follow when EI and GJ are free (to first order, without noise), over the standard deviation of the noise.
A design that fails a check returns `None`, and the next attempt draws another.
"""

import time
from dataclasses import replace

import numpy as np

from . import design, draws, effects, rivals, rod
from . import quaternions as qt
from .noise import draw_noise
from .scene import interpolate, mesh, observation_matrix
from .shapes import INTERVALS, Lens, Model, Tolerance, left_over

STRENGTH = (0.4, 4.0)  # log-uniform
PAIR_STRENGTH = (0.7, 4.0)  # of each of two effects
FEWEST_FIT, MOST_FIT = 3, 8  # poses that are fitted; two more are validate poses
MESH_ERROR = 1e-5  # of L: largest change of the shape when the mesh is doubled
CONTACT_INTERVALS = 224  # a plane bends the cable over a few hundredths of L
MOST_MOVED = 0.2  # of L: an effect that moves a point further has jumped to another branch
SHAPE_IMMUNE = {"clamp_rotation", "clamp_offset", "elastic_clamp", "length_error", "uniform_load", "extensibility",
                "pose_reseating"}  # kinds that tolerances would drown: their studies state none


def make_case(key, kinds, off, most_points, strength=None):
    """One attempt: `key` seeds it, `kinds` are the true catalogue kinds, `off` a hidden kind or none, `strength` is drawn."""
    began = time.perf_counter()
    rng = np.random.default_rng(key)
    posed = pose_cable(rng, kinds, FEWEST_FIT)
    if posed is None:
        return None
    scene, y, fit = posed
    tolerance = draw_tolerance(rng) if not {*kinds, off} & SHAPE_IMMUNE else Tolerance()
    true = deviate(rng, scene, tolerance)
    noise, s = draw_noise(rng, scene.cable.length), draw_points(rng, scene.cable.length, fit + 2, most_points)
    found = choose_effects(rng, (true, y, fit), (s, scene.cable.length, noise, tolerance), kinds, off, strength)
    if found is None or not visible(*found[:2]):
        return None
    truth, answer, tables = found
    seen = observe(true, y, truth, [at / scene.cable.length for at in s])
    if seen is None:
        return None
    case = {"nominal": scene, "fit": fit, "tolerance": tolerance, "noise": noise, "s": s, "effects": truth, "tables": tables}
    case |= measure(rng, case, seen)
    return finished(rng, case, answer | facts(true, scene, noise, s, seen), (off, key, began))


def finished(rng, case, answer, attempt):
    """The generator and the case with its whole answer; `attempt`: the hidden kind or none, the key, and when it began."""
    off, key, began = attempt
    answer |= {"off_catalogue": off or "none", "arc_length_given": case["arc_length"], "noise_stated": case["stated"]}
    answer |= {"seed": list(key), "seconds": round(time.perf_counter() - began, 2)}
    return rng, case | {"answer": answer}


def pose_cable(rng, kinds, fewest):
    """A cable in `fit` (`fewest` to 8) and two validate poses, placed in the scan frame: `(scene, y, fit)`."""
    cable, fit = design.draw_cable(rng), int(rng.integers(fewest, MOST_FIT + 1))
    drawn = design.draw_poses(rng, cable, fit + 2)
    if drawn is None:
        return None
    scene, y = drawn
    design.place(rng, scene, y, rng.uniform(-0.3, 0.3, 3) * cable.length)
    if "support_plane" in kinds and not lower_onto_plane(rng, scene, y, fit):
        return None
    round_clamps(scene)
    return scene, y, fit


def visible(truth, answer):
    """Whether anybody could see the effect: else the case is as good as nothing missing, of which there are enough."""
    return not truth or answer["plain_left"] >= 2 * rivals.NATS


def measure(rng, case, seen):
    """What the sensor gives, and whether its noise and the arc lengths are stated."""
    points = [x + case["noise"].draw(rng, at) for x, at in zip(seen["shapes"], case["s"], strict=True)]
    stated, marked = rng.random() < 0.5, rng.random() < 0.15
    known = not case["tolerance"].length and all(e["kind"] != "length_error" for e in case["effects"])
    return {"points": points, "stated": stated, "arc_length": marked and known}


def round_clamps(scene):
    for x, q in (scene.start, scene.end):
        x[:] = np.round(x, 9)
        q[:] = np.round(q / np.linalg.norm(q, axis=-1, keepdims=True), 9)


def lower_onto_plane(rng, scene, y, fit):
    """Shift sagging poses so that they touch one level, and lift the others; at least two of the fit poses must sag."""
    up, L = -scene.gravity / np.linalg.norm(scene.gravity), scene.cable.length
    height = y[..., :3] @ up
    ends = np.minimum(height[:, 0], height[:, -1])
    sags = (scene.end_kind == rod.CLAMP) & (height.min(1) < ends - 0.03 * L)
    level = np.where(sags, rng.uniform(0, 0.01 * L, len(y)), rng.uniform(0.1, 0.3, len(y)) * L)
    design.move_poses(scene, y, np.array([1.0, 0, 0, 0]), (level - height.min(1))[:, None] * up)
    return sags[:fit].sum() >= 2


def draw_tolerance(rng):
    """A fifth of the studies know some things only nearly."""
    if rng.random() > 0.2:
        return Tolerance()
    draw = {"length": (1e-3, 3e-3), "clamp_position": (3e-4, 1e-3)}
    draw |= {"clamp_rotation": (5e-3, 2e-2), "gravity": (3e-3, 1e-2)}
    chosen = [k for k in draw if rng.random() < 0.6] or ["clamp_rotation"]
    return Tolerance(**{k: float(f"{rng.uniform(*draw[k]):.1g}") for k in chosen})


def deviate(rng, scene, t):
    """The true scene: length and gravity deviate once, every clamp of every pose by itself."""
    P = len(scene.end_kind)
    cable = replace(scene.cable, length=scene.cable.length + t.length * rng.normal())
    gravity = qt.rotate(qt.exp(t.gravity * rng.normal(size=3)), scene.gravity)

    def move(frame):
        turn = qt.exp(t.clamp_rotation * rng.normal(size=(P, 3)))
        return frame[0] + t.clamp_position * rng.normal(size=(P, 3)), qt.product(frame[1], turn)

    return replace(scene, cable=cable, gravity=gravity, start=move(scene.start), end=move(scene.end))


def draw_points(rng, L, poses, most):
    """Arc lengths (m) of the points of each pose: even, random or clustered; a third stop short of the clamps."""
    spacing = rng.choice(["even", "random", "clustered"])
    out = []
    for _ in range(poses):
        n, short = int(rng.integers(40, most + 1)), rng.random() < 1 / 3
        low, high = (rng.uniform(0, 0.05, 2) if short else rng.uniform(0, 0.005, 2)) * L
        if spacing == "even":
            t = np.linspace(0, 1, n)
        elif spacing == "random":
            t = np.sort(rng.uniform(0, 1, n))
        else:
            centres = rng.uniform(0, 1, 4)
            near = 0.06 * rng.normal(size=n) + rng.choice(centres, n)
            spread = np.where(rng.random(n) < 0.6, near, rng.uniform(0, 1, n))
            t = np.sort(np.abs(1 - np.abs(1 - np.abs(spread))))  # folded back into [0, 1]
        out.append(np.round(low + t * (L - high - low - 1e-6 * n), 6) + 1e-6 * np.arange(n))  # no two points at one s
    return out


def rounded(effect):
    """Parameters to six digits; arrays as nested lists."""
    def tidy(v):
        if isinstance(v, str):
            return v
        v = np.asarray(v)
        if v.ndim:
            return [tidy(x) for x in v]
        return int(v) if v.dtype.kind in "iu" else float(f"{float(v):.6g}")

    return {k: tidy(v) for k, v in effect.items()}


def choose_effects(rng, posed, measured, kinds, off, of_strength=None):
    """The truth at its strengths, and the answer about it: `(effects, answer, tables)`."""
    (scene, y, fit), (s, length, noise, tolerance) = posed, measured
    base = compared(scene, y, kinds)
    if base is None:
        return None
    lens = Lens(base.F.sigma, length, s[:fit], noise)
    low, high = (of_strength,) * 2 if of_strength else PAIR_STRENGTH if len(kinds) == 2 else STRENGTH
    strength, truth, strengths = strength_on(base, lens), [], []
    for kind in [*kinds, *([off] if off else [])]:
        goal = np.exp(rng.uniform(*np.log((low, high))))
        effect = scaled(rng, kind, base, strength, (0.9 * max(min(goal, 1.0), STRENGTH[0]), goal))
        if effect is None:
            return None
        truth.append(effect)
        strengths.append(round(float(strength([effect])), 3))
    total = strength(truth) if truth else 0.0
    if total is None:
        return None
    return with_rivals(base, (lens, tolerance), (truth, strengths, round(float(total), 3)), (kinds, off))


def compared(scene, y, kinds):
    """The baseline model on the mesh on which shapes are compared; `None` where it is not solved."""
    L = scene.cable.length
    sigma = mesh(INTERVALS if "support_plane" not in kinds else 2 * INTERVALS, L)
    base = Model(scene, [], sigma, interpolate(mesh(design.FINE, L), y, sigma))
    return base if base.ok.all() else None


def strength_on(base, lens, most=MOST_MOVED):
    """The strength of a truth over the noise of `lens`, as a function; `None` where a point moves by more than `most` L."""
    targets = [base.shape(lens, p) for p in range(len(lens.matrices))]
    J = base.columns(lens, base.stiffness_changes(), correlated=False)

    def strength(truth):
        model = Model(base.scene, truth, base.F.sigma, base.y)
        moved = np.abs(model.y[..., :3] - base.y[..., :3]).max()
        if not model.ok.all() or moved > most * base.scene.cable.length:
            return None
        d = left_over(J, model.residual(lens, targets, correlated=False))
        return np.sqrt((d**2).sum() / lens.count / 2)

    return strength


def with_rivals(base, seen, drawn, of):
    """A truth, drawn with its strengths (of each effect, and of all), and its rivals: `(effects, answer, tables)`."""
    (lens, tolerance), (truth, strengths, total), (kinds, off) = seen, drawn, of
    answer = {"kinds": list(kinds), "plain_over_noise": total, "strengths": strengths}
    found = find_rivals(base, lens, tolerance, truth, own=not off)
    return None if found is None else (truth, answer | found[0], found[1])


def scaled(rng, kind, base, strength, bounds, *, larger=1.0):
    """A drawn effect of at least the first of `bounds` in strength, and near the second where that can be had.

    `larger`: by what factor its amplitude may exceed what `draws` finds sensible.
    """
    enough, goal = bounds
    draw = draws.catalogue if kind in effects.CATALOGUE else draws.hidden
    for _ in range(4):
        make, first, most = draw(rng, kind, base)
        out = draws.settle(lambda a, make=make: rounded(make(a)), first, larger * most, lambda e: strength([e]), goal)
        if out is not None and enough < out[1] < 1.3 * goal:
            return out[0]
    return None


def find_rivals(base, lens, tolerance, truth, own):
    """The accept list of the whole, and for two effects also that of each given the other."""
    scene, sigma, fit = base.scene, base.F.sigma, len(lens.matrices)
    if not truth:
        cable = scene.cable
        return {"accept": [], "plain_left": 0.0, "plain_bending_stiffness": cable.bending,
                "plain_torsional_stiffness": cable.torsion}, {}
    whole = Model(scene, truth, sigma, base.y)
    targets, fits = [whole.shape(lens, p) for p in range(fit)], np.arange(fit)
    scene = scene.pick(fits)
    plain = Model(scene, [], sigma, base.y[fits])
    got = rivals.accepted(plain, lens, targets, tolerance, [truth[0]["kind"]] if len(truth) == 1 and own else [])
    if got is None:
        return None
    tables = {"left_first_order": _digits(got["first_order"]), "left_refitted": _digits(got["refitted"])}
    accept = list(got["accept"])
    if len(truth) == 2:
        tables["accept_for"] = {}
        for k in (0, 1):
            partner = Model(scene, [truth[1 - k]], sigma, whole.y[fits])
            one = rivals.accepted(partner, lens, targets, tolerance, [truth[k]["kind"]]) if partner.ok.all() else None
            if one is None:
                return None
            tables["accept_for"][truth[k]["kind"]] = one["accept"]
            accept += one["accept"]
    EI, GJ = got["stiffness"]
    answer = {"accept": list(dict.fromkeys(accept)), "plain_left": float(f"{got['plain']:.4g}"),
              "plain_bending_stiffness": float(f"{EI:.6g}"), "plain_torsional_stiffness": float(f"{GJ:.6g}")}
    if len(truth) == 2:
        answer["alone"] = got["accept"]
    return answer, tables


def _digits(left):
    return {k: float(f"{v:.4g}") for k, v in sorted(left.items(), key=lambda item: item[1])}


def observe(scene, y, truth, at):
    """The true shapes at the points `at` (over [0, 1]), on a fine mesh, with checks; `None` when one fails."""
    L = scene.cable.length
    points, spans = effects.features(truth)
    intervals = CONTACT_INTERVALS if any(e["kind"] == "support_plane" for e in truth) else design.FINE
    sigma = mesh(intervals, L, points, spans)
    model = Model(scene, truth, sigma, interpolate(mesh(design.FINE, L), y, sigma))
    if not model.ok.all():
        return None
    good, square = design.stable(model.F, model.y, scene.cable, scene.end_kind)
    moderate, twist = design.moderate(model.F, model.y, scene.cable)
    double = np.sort(np.concatenate([sigma, 0.5 * (sigma[1:] + sigma[:-1])]))
    finer = Model(scene, truth, double, interpolate(sigma, model.y, double))
    error = np.abs(finer.y[:, ::2, :3] - model.y[..., :3]).max() / L
    if not (good.all() and moderate.all() and finer.ok.all() and error < MESH_ERROR):
        return None
    nodes, views = finer.y[..., :3], [observation_matrix(double, x) for x in at]
    shapes = [finer.scale * view @ nodes[p] + finer.offset for p, view in enumerate(views)]
    return {"shapes": shapes, "square": square, "twist": twist, "error": error, "model": finer}


def facts(true, nominal, noise, s, seen):
    cable = true.cable
    return {
        "true_bending_stiffness": cable.bending, "true_torsional_stiffness": cable.torsion,
        "true_length": cable.length, "true_gravity": np.round(true.gravity, 6),
        "dimensionless_stiffness": float(f"{cable.bending / (cable.density * 9.81 * cable.length**3):.4g}"),
        "noise_rms": noise.sigma, "noise_kind": "white" if not noise.share else noise.kernel,
        "noise_correlated_share": noise.share, "noise_correlation_length": noise.length if noise.share else 0.0,
        "points": [len(x) for x in s], "ends": [("clamp", "ball", "free")[k] for k in nominal.end_kind],
        "lowest_square_frequencies": np.round(seen["square"], 2), "total_twist": np.round(seen["twist"], 3),
        "mesh_error": float(f"{seen['error']:.1e}"),
    }
