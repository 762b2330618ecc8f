"""Random cables and random poses, each a stable equilibrium of the baseline model.

All is drawn with gravity along -z and turned at random into the scan frame afterwards. A pose starts from a shape that
is known and stable: a circular arc without gravity (or a straight cantilever), an exact equilibrium. Then gravity
grows while the end clamp travels to its random place, with Newton's method at every step; a ball joint lets go of its
moment last. What fails on the way, is no minimum, is close to buckling, or is bent or twisted too much is thrown away.
Lengths in m; `l_g = (EI / (rhoA g))^(1/3)` is the length over which gravity bends the cable.
"""

from dataclasses import replace

import numpy as np

from . import effects, rod, stability
from . import quaternions as qt
from .scene import RIGID, Cable, Scene, interpolate, mesh

GRAVITY = 9.81
COARSE, FINE = 48, 128  # intervals while travelling, and for the answer
TRAVEL = 28  # steps of the way
SAG_MARGIN, BEND_MARGIN = 1.0, 60.0  # lowest omega^2 above g/L (SAG + BEND (l_g/L)^3): an eighth of a straight cable's
FREE_MARGIN = 0.3  # the same for free ends and ball joints, which swing slowly
MAX_CURVATURE, MAX_TWIST = 22.0, np.radians(150)  # kappa L; total twist, well below the half turn that quaternions tell
TWISTS = np.radians([0, 0, 45, -45, 90, -90])


def unit(rng):
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def tilted(rng, axis, low, high):
    """A unit vector at a random angle (rad) between `low` and `high` from `axis`."""
    side = np.cross(axis, unit(rng))
    angle = rng.uniform(low, high)
    return np.cos(angle) * axis + np.sin(angle) * side / np.linalg.norm(side)


def draw_cable(rng):
    length = round(rng.uniform(0.5, 2.0), 3)
    density = float(f"{np.exp(rng.uniform(np.log(0.03), np.log(1.5))):.3g}")
    reach = length * rng.uniform(0.15, 0.6)
    bending = density * GRAVITY * reach**3
    wide = rng.random() < 0.1
    ratio = np.exp(rng.uniform(*np.log((0.15, 8.0) if wide else (0.4, 3.0))))
    radius = round(min(0.012, length / 60, 0.002 + 0.006 * rng.random() + 0.003 * density), 4)
    found = Cable(length, radius, density, float(f"{bending:.4g}"), float(f"{bending * ratio:.4g}"))
    return replace(found, shear=RIGID, axial=RIGID) if rng.spawn(1)[0].random() < 0.5 else found


def _candidate(rng, L, home, kind):
    """Start frame, first arc and goal of one pose: a dictionary of frames."""
    start, first = home
    d3 = qt.rotate(start, np.array([0.0, 0.0, 1.0]))
    if kind == rod.FREE:
        return {"start": start, "at": first, "kind": kind, "half": 0.0, "axis": d3, "goal": first, "frame": start}
    chord = tilted(rng, d3, np.radians(15), np.radians(75))
    goal = first + chord * L * rng.uniform(0.45, 0.86)
    last = tilted(rng, chord, np.radians(5), np.radians(75))
    frame = qt.product(qt.product(qt.between(chord, last), qt.between(d3, chord)), start)
    frame = qt.product(frame, qt.roll(rng.choice(TWISTS)))
    axis = np.cross(d3, chord)
    half = max(np.arccos(np.clip(d3 @ chord, -1, 1)), np.radians(25))
    return {"start": start, "at": first, "kind": kind, "half": half, "axis": axis / np.linalg.norm(axis),
            "goal": goal, "frame": frame}


def _arc(c, L, sigma, bending):
    """States along the circular arc of a candidate (a straight line for a free end)."""
    angle = 2 * c["half"] * sigma
    turn = qt.exp(angle[:, None] * c["axis"])
    y = np.zeros((len(sigma), 13))
    y[:, 3:7] = qt.product(turn, np.broadcast_to(c["start"], turn.shape))
    d3 = qt.rotate(c["start"], np.array([0.0, 0.0, 1.0]))
    k = 2 * c["half"] / L
    along = np.sin(angle) / k if k else L * sigma
    y[:, :3] = c["at"] + along[:, None] * d3
    if k:
        y[:, :3] += ((1 - np.cos(angle)) / k)[:, None] * np.cross(c["axis"], d3)
        y[:, 10:] = bending * k * c["axis"]
    return y


def travel(cable, candidates):
    """Lead all candidates to their goals at once; states on the coarse mesh, and which of them arrived."""
    sigma, L = np.linspace(0, 1, COARSE + 1), cable.length
    y = np.stack([_arc(c, L, sigma, cable.bending) for c in candidates])
    kinds = np.array([c["kind"] for c in candidates])
    travelling = np.where(kinds == rod.FREE, rod.FREE, rod.CLAMP)
    start = (np.stack([c["at"] for c in candidates]), np.stack([c["start"] for c in candidates]))
    first, alive, before = y[:, -1, :7].copy(), np.arange(len(y)), None
    for t in np.linspace(0, 1, TRAVEL + 1)[1:]:
        place = (1 - t) * first[:, :3] + t * np.stack([c["goal"] for c in candidates])
        frame = np.stack([qt.slerp(f[3:7], c["frame"], t) for f, c in zip(first, candidates, strict=True)])
        scene = Scene(cable, t * np.array([0, 0, -GRAVITY]), start, (place, frame), travelling).pick(alive)
        guess = y[alive] if before is None else 2 * y[alive] - before[alive]
        before = y.copy()
        new, ok = rod.solve(effects.build(scene, [], sigma)[0], guess, 9)
        y[alive] = new
        alive = alive[ok]
        if not len(alive):
            break
    return _let_go(cable, candidates, sigma, y, alive)


def _let_go(cable, candidates, sigma, y, alive):
    """Ball joints lose their moment in four steps."""
    for k in [k for k in alive if candidates[k]["kind"] == rod.BALL]:
        one = assemble(cable, [candidates[k]])
        moment = y[k, -1, 10:].copy()
        for share in (0.75, 0.5, 0.25, 0.0):
            F = effects.build(one, [], sigma)[0]
            F.end_moment = (share * moment)[None]
            new, ok = rod.solve(F, y[k : k + 1], 12)
            y[k] = new[0]
            if not ok[0]:
                alive = alive[alive != k]
                break
    return y, alive


def assemble(cable, candidates):
    """The scene of some candidates, gravity along -z."""
    start = (np.stack([c["at"] for c in candidates]), np.stack([c["start"] for c in candidates]))
    end = (np.stack([c["goal"] for c in candidates]), np.stack([c["frame"] for c in candidates]))
    return Scene(cable, np.array([0, 0, -GRAVITY]), start, end, np.array([c["kind"] for c in candidates]))


def stable(F, y, cable, kinds):
    """Which poses are minima with a margin against buckling; the lowest omega^2 over g/L."""
    square = stability.lowest_square_frequency(F, y, cable.density) * cable.length / GRAVITY
    stiff = cable.bending / (cable.density * GRAVITY * cable.length**3)
    margin = np.where(kinds == rod.CLAMP, SAG_MARGIN + BEND_MARGIN * stiff, FREE_MARGIN * (1 + stiff))
    return square > margin, square


def moderate(F, y, cable):
    """Which poses are neither bent nor twisted too much; the total twist, rad."""
    L = cable.length
    kappa, _ = rod.curvature(F, slice(0, None, 2), qt.unrotate(y[..., 3:7], y[..., 10:]), False)
    twist = np.trapezoid(kappa[..., 2], F.sigma * L, axis=-1)
    bend = np.sqrt(kappa[..., 0] ** 2 + kappa[..., 1] ** 2).max(-1)
    return (np.abs(twist) < MAX_TWIST) & (bend * L < MAX_CURVATURE), twist


def _home(rng):
    """Frame and place of a start clamp: tangent at most 50 degrees from the horizontal."""
    a = rng.uniform(0, 2 * np.pi)
    d3 = tilted(rng, np.array([np.cos(a), np.sin(a), 0]), 0, 0.9)
    frame = qt.product(qt.between(np.array([0, 0, 1.0]), d3), qt.roll(rng.uniform(0, 2 * np.pi)))
    return frame, rng.normal(size=3) * 0.1


def draw_poses(rng, cable, count):
    """`count` stable poses of the plain cable, gravity along -z: the scene and the states on the fine mesh."""
    found, fine = [], mesh(FINE, cable.length)
    homes = [_home(rng) for _ in range(12)]
    homes[:6] = [homes[0]] * 6  # half of the poses share one start clamp
    for _ in range(6):
        kinds = rng.choice([rod.CLAMP, rod.BALL, rod.FREE], 12, p=[0.88, 0.05, 0.07])
        batch = [_candidate(rng, cable.length, homes[rng.integers(12)], k) for k in kinds]
        y, alive = travel(cable, batch)
        found += _accepted(cable, [batch[k] for k in alive], y[alive], fine)
        if len(found) >= count:
            break
    else:
        return None
    picked = [found[k] for k in rng.permutation(len(found))[:count]]
    scene, y = assemble(cable, [c for c, _ in picked]), np.stack([s for _, s in picked])
    for p in np.flatnonzero(rng.random(count) < 0.25):
        roll_both(scene, y, p, np.pi)
    return scene, y


def _accepted(cable, candidates, y, fine):
    if not candidates:
        return []
    scene = assemble(cable, candidates)
    F = effects.build(scene, [], fine)[0]
    y, ok = rod.solve(F, interpolate(np.linspace(0, 1, COARSE + 1), y, fine))
    ok &= moderate(F, y, cable)[0]
    ok[ok] = stable(rod.pick(F, ok), y[ok], cable, scene.end_kind[ok])[0]
    return [(c, s) for c, s, good in zip(candidates, y, ok, strict=True) if good]


def roll_both(scene, y, pose, angle):
    """Roll a pose about the cable in both clamps: the shape of an isotropic rod stays, its frames turn."""
    for frames in (scene.start[1], scene.end[1], y[..., 3:7]):
        frames[pose] = qt.product(frames[pose], np.broadcast_to(qt.roll(angle), frames[pose].shape))


def place(rng, scene, y, shift):
    """Turn gravity and all poses at random (half of the time about the plumb line only) and shift them, in place."""
    turn = qt.exp(np.array([0, 0, rng.uniform(-np.pi, np.pi)]))
    turn = qt.exp(unit(rng) * rng.uniform(0, np.pi)) if rng.random() < 0.5 else turn
    scene.gravity = qt.rotate(turn, scene.gravity)
    move_poses(scene, y, turn, shift)


def move_poses(scene, y, turn, shift):
    for x, q in (scene.start, scene.end):
        x[:] = qt.rotate(turn, x) + shift
        q[:] = qt.product(np.broadcast_to(turn, q.shape), q)
    shift = shift if np.ndim(shift) == 1 else shift[:, None]
    y[..., :3] = qt.rotate(turn, y[..., :3]) + shift
    y[..., 3:7] = qt.product(np.broadcast_to(turn, y[..., 3:7].shape), y[..., 3:7])
    y[..., 7:10], y[..., 10:] = qt.rotate(turn, y[..., 7:10]), qt.rotate(turn, y[..., 10:])
