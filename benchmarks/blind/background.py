"""Cases with a background: each pose deviates from the rod by itself, and an effect that all poses share may lie above it.

A real cable never repeats to the noise of the sensor. Here each pose has a random natural curvature of its own and each clamp
of each pose is seated a little askew:

    kappa_0(s) = sum_k a_k cos(k pi s / L),   a_k ~ N(0, b^2 c_k^2) for each of d1, d2, d3,   c_k^2 ~ 1 / (1 + (k pi l)^4)

`l` (over L) is the correlation length and `b` (1/m) is set for each pose so that the curvature moves its curve by a given
RMS distance. Both `l` and that distance are drawn once per case; no study states either. The strength of the effect is the
RMS distance that the baseline model cannot follow (to first order, EI and GJ free) over that RMS distance of the background.
A kind counts as a rival of the truth when it explains the shapes as well with the background marginalised.
"""

import time

import numpy as np
from scipy.spatial import cKDTree

from . import cases, effects
from .noise import draw_noise
from .scene import observation_matrix
from .shapes import Lens, Model, Tolerance

MOVES = (0.003, 0.015)  # of L: by how much the curvature moves each curve, log-uniform
REACH = (0.1, 0.5)  # of L: the correlation length, uniform
SEAT = np.radians(0.3)  # standard deviation of a seat, about each axis of each clamp
STRENGTH = (3.0, 30.0)  # of the effect given the background, log-uniform
MOST_MOVED = 0.4  # of L: by how much such an effect may move a point
LARGER = dict.fromkeys(("natural_curvature", "kink", "point_mass", "point_load", "uniform_load", "tether"), 2.0)
"""By what factor the amplitude of a kind may exceed what `draws` finds sensible: kinds that no law of the rod bounds."""
SHORT = 0.95  # a kind that cannot be as strong as drawn may fall short, down to this share of the least strength
FEWEST_FIT = 4
COSINES = 13  # the last has half a per cent of the variance of the first at the shortest correlation length
CLOSE, TRIES = 0.03, 8  # the target distance is met to this, in so many steps
REDRAWS = 8  # of a curvature that makes a pose jump before it has moved so far
FINE = 4000  # samples of a curve to which distances are measured


def make_case(key, kinds, most_points):
    """One attempt: `key` seeds it, `kinds` is empty or holds one kind of the catalogue."""
    began = time.perf_counter()
    rng = np.random.default_rng(key)
    posed = cases.pose_cable(rng, kinds, FEWEST_FIT)
    base = None if posed is None else cases.compared(*posed[:2], kinds)
    under = None if base is None else draw(rng, base)
    if under is None:
        return None
    (scene, y, fit), L = posed, base.scene.cable.length
    noise, s = draw_noise(rng, L), cases.draw_points(rng, L, fit + 2, most_points)
    lens = Lens(base.F.sigma, L, s[:fit], noise)
    drawn = draw_effect(rng, base, lens, under["moves"], kinds)
    if drawn is None:
        return None
    at = [x / L for x in s]
    clean, seen = (cases.observe(scene, y, [*drawn[0], *own], at) for own in ([], under["effects"]))
    found = None if clean is None or seen is None else cases.with_rivals(base, (lens, under["tolerance"]), drawn, (kinds, None))
    if found is None or not cases.visible(*found[:2]):
        return None
    truth, answer, tables = found
    case = {"nominal": scene, "fit": fit, "tolerance": Tolerance(), "noise": noise, "s": s, "effects": truth, "tables": tables}
    case |= cases.measure(rng, case, seen)
    answer |= cases.facts(scene, scene, noise, s, seen)
    answer |= _scatter(clean, seen["shapes"], fit) | _attained(clean, case["points"], fit)
    answer |= {"background_reach": under["reach"], "background_drawn": under["moves"]}
    return cases.finished(rng, case, answer, (None, key, began))


def draw(rng, base):
    """The background of all poses; `None` where a pose cannot be moved as far as asked.

    `effects`: two tables of `effects.SCATTER`; `moves` (m) and `reach` (of L); `tolerance`: the same as standard deviations.
    """
    L, P = base.scene.cable.length, len(base.y)
    moves, reach = float(np.exp(rng.uniform(*np.log(MOVES)))) * L, rng.uniform(*REACH)
    size = 1 / np.sqrt(1 + (np.pi * np.arange(COSINES) * reach) ** 4)
    size /= np.linalg.norm(size)
    series, scale, todo = np.zeros((P, COSINES, 3)), np.zeros(P), np.arange(P)
    for _ in range(REDRAWS):
        series[todo] = size[:, None] * rng.normal(size=(len(todo), COSINES, 3))
        scale[todo], met = _meet(base, todo, series[todo], moves)
        todo = todo[~met]
        if not len(todo):
            break
    else:
        return None
    own = [{"kind": "pose_curvature", "harmonics": scale[:, None, None] * series}]
    own += [{"kind": "pose_reseating", "rotation": SEAT * rng.normal(size=(P, 2, 3))}]
    tolerance = Tolerance(clamp_rotation=SEAT, curvature=scale[:, None] * size)  # as `rivals` marginalises it
    return {"effects": own, "moves": float(f"{moves:.4g}"), "reach": round(reach, 3), "tolerance": tolerance}


def _meet(base, poses, series, moves):
    """Per pose, the size `b` (1/m) of the curvature that moves its curve by `moves` (m, RMS at equal arc length), and
    whether it does: a pose may jump to another shape instead."""
    scene, y = base.scene.pick(poses), base.y[poses]
    scale = np.full(len(poses), 2 * moves / scene.cable.length**2)
    for _ in range(TRIES):
        own = {"kind": "pose_curvature", "harmonics": scale[:, None, None] * series}
        model = Model(scene, [own], base.F.sigma, y)
        moved = np.sqrt(((model.y[..., :3] - y[..., :3]) ** 2).sum(-1).mean(-1))
        met = model.ok & (np.abs(moved / moves - 1) < CLOSE)
        if met.all():
            break
        scale = np.where(met, scale, scale * np.where(model.ok, np.clip(moves / moved, 0.3, 4), 0.5))
    return scale, met


def draw_effect(rng, base, lens, moves, kinds):
    """The truth (one effect or none) with its strengths given a background that moves curves by `moves` (m)."""
    unit = moves / (np.sqrt(2) * lens.noise.sigma)  # of a strength in `cases`, which is per coordinate and over the noise
    strength, truth, strengths = cases.strength_on(base, lens, MOST_MOVED), [], []
    for kind in kinds:
        goal = unit * np.exp(rng.uniform(*np.log(STRENGTH)))
        bounds = unit * SHORT * STRENGTH[0], goal
        effect = cases.scaled(rng, kind, base, strength, bounds, larger=LARGER.get(kind, 1.0))
        if effect is None:
            return None
        alone = strength([effect])
        if alone is None:  # scaled to where some pose is not solved
            return None
        truth.append(effect)
        strengths.append(round(float(alone / unit), 3))
    return truth, strengths, round(float(strength(truth)), 3) if truth else 0.0


def _scatter(clean, shapes, fit):
    """RMS distance (m) by which the background moves the curves that are measured: fitted, validated, each pose."""
    far = [distances(clean, p, x) for p, x in enumerate(shapes)]
    every = [_rms([d]) for d in far]
    return {"background": _rms(far[:fit]), "background_validate": _rms(far[fit:]), "background_of_poses": every}


def _attained(clean, points, fit):
    """RMS distance (m) of the measured points from the true effect's curves without background."""
    far = [distances(clean, p, x) for p, x in enumerate(points)]
    return {"attained_fit": _rms(far[:fit]), "attained_validate": _rms(far[fit:])}


def distances(seen, pose, points):
    """From each point (m) to the nearest of the curve of one pose of `observe`."""
    model = seen["model"]
    curve = model.scale * observation_matrix(model.F.sigma, np.linspace(0, 1, FINE)) @ model.y[pose, :, :3] + model.offset
    return cKDTree(curve).query(points)[0]


def _rms(distances_of_poses):
    """Over all points of some poses, to four digits."""
    return float(f"{np.sqrt(np.mean(np.concatenate(distances_of_poses) ** 2)):.4g}")


def schedule(count, seed):
    """The truths of all cases, `(kinds, off)`, in random order: a third with nothing but background, else one kind each."""
    rng = np.random.default_rng([seed, 0, 0, 2])
    names, none = list(rng.permutation(list(effects.CATALOGUE))), round(count / 3)
    out = [()] * none + [(names[k % len(names)],) for k in range(count - none)]
    return [(out[k], None) for k in rng.permutation(count)]
