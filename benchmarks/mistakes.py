"""Deliberate mistakes in studies: are they named by `check` and `fit`, and is a study without any accused?

    SCAN2FLEX_DATA=... python -m benchmarks.mistakes      (the folder that holds `practice`, `textile-strip` and `black-wire`)

Every mistake of `KINDS` is applied to three simulated studies (the first of the practice studies, by number, that have centre
curves, clamps at both ends, four fitted poses and nothing missing) and to two real ones. docs/mistakes.md defines the
outcomes; a mistake is *named* only if the corrected study fits as the one before the mistake (within a fifth). Then all
practice studies, most of them with an undeclared effect, are fitted as they are: any mistake named there is a false
accusation. An interrupted run continues; without the record it begins anew.
"""

import os
import sys
import tomllib
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

from benchmarks.curves import shortest_turn
from benchmarks.record import complete, record, recorded
from scan2flex_jax.cli.setup import prepare_jax
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting.problem import Problem
from scan2flex_jax.inference import explain, fit
from scan2flex_jax.study import Clamp, MeasuredCurve, load_study, study_warnings

ELEMENTS = 20  # of all fits here: the mesh error stays below 1e-4 of the length
SIMULATED, REAL = 3, ("textile-strip", "black-wire")
FEWEST = 4  # fitted poses of a simulated study
FIRST = 3  # lines that everybody reads
FITS = 1.2  # times the residual of the study before the mistake
TRACE = 0.1  # of that residual: modelled shapes that differ by less are the same
NAMED, WARNED, TRACELESS, MISSED = "named", "warned", "without trace", "missed"


UNITS = {"mm": ("millimetres", 1000.0), "cm": ("centimetres", 100.0), "inches": ("inches", 1 / 0.0254)}


def rotation(clamp):
    """The rotation of a clamp with a quaternion."""
    return Rotation.from_quat(clamp.quaternion, scalar_first=True)


def _held(clamp):
    return clamp is not None and clamp.quaternion is not None


def both_held(pose):
    return _held(pose.start) and _held(pose.end)


def poses_changed(change, which=None):
    """A mistake of all poses, or of those that ``which(study)`` gives; None where nothing changes."""

    def made(study):
        names = [p.name for p in (study.poses if which is None else which(study))]
        poses = tuple(change(p) if p.name in names else p for p in study.poses)
        return replace(study, poses=poses) if any(a is not b for a, b in zip(poses, study.poses, strict=True)) else None

    return made


def clamps_changed(change, ends=("start", "end")):
    """Other quaternions of the clamps, by ``change(clamp)``."""

    def one(pose):
        held = {end: getattr(pose, end) for end in ends if _held(getattr(pose, end))}
        return replace(pose, **{end: Clamp(c.position, change(c)) for end, c in held.items()}) if held else pose

    return one


def _about(axis, degrees):
    """Clamps written with other axes of the same body."""
    turn = Rotation.from_euler(axis, degrees, degrees=True)
    return lambda c: np.roll((rotation(c) * turn).as_quat(), 1)


def fit_pose(k):
    """The fitted pose number ``k`` with two clamps (the last one where there are fewer)."""

    def which(study):
        some = [p for p in study.fit_poses if both_held(p)] or list(study.fit_poses)
        return [some[min(k, len(some) - 1)]]

    return which


def only_held(change):
    return lambda p: change(p) if both_held(p) else p


def more_turns(more, k):
    return poses_changed(only_held(lambda p: replace(p, turns=p.turns + more)), fit_pose(k))


def all_clamps(change, *ends):
    return poses_changed(clamps_changed(change, ends or ("start", "end")))


def rolls(degrees, end, which=None):
    return poses_changed(only_held(clamps_changed(_about("z", degrees), (end,))), which)


def exchanged(pick):
    """The curves of two poses exchanged."""

    def made(study):
        pair = pick(study)
        if len(pair) < 2:
            return None
        curves = {pair[0].name: pair[1].curve, pair[1].name: pair[0].curve}
        return replace(study, poses=tuple(replace(p, curve=curves.get(p.name, p.curve)) for p in study.poses))

    return made


def copied_clamps(study):
    """The second fitted pose has the clamps of the first one: copied, and not changed."""
    if len(study.fit_poses) < 2:
        return None
    a, b = study.fit_poses[:2]
    return replace(study, poses=tuple(replace(p, start=a.start, end=a.end) if p is b else p for p in study.poses))


def reversed_curve(pose):
    return replace(pose, curve=MeasuredCurve(pose.curve.points[::-1]))


def exchanged_clamps(pose):
    return pose if pose.end is None else replace(pose, start=pose.end, end=pose.start)


def _opposite(pose, carried):
    """The end clamp with the opposite roll against a frame carried to it."""
    roll = (carried.inv() * rotation(pose.end)).as_rotvec()
    return replace(pose, end=Clamp(pose.end.position, np.roll((carried * Rotation.from_rotvec(-roll)).as_quat(), 1)))


def other_roll(study):
    """Rolls from the first pose's, on the shortest way from tangent to tangent, with the other sign."""
    first = next((p for p in study.poses if both_held(p)), None)
    if first is None:
        return None
    a = rotation(first.end)
    along = lambda pose: shortest_turn(a.as_matrix()[:, 2], rotation(pose.end).as_matrix()[:, 2]) * a  # noqa: E731
    poses = (_opposite(p, along(p)) if both_held(p) and p is not first else p for p in study.poses)
    return replace(study, poses=tuple(poses))


def other_twist(pose):
    """The end clamp rolled so that the twist beyond a frame carried along the curve has the other sign."""
    R, t = rotation(pose.start), rotation(pose.start).as_matrix()[:, 2]
    points = uniform_filter1d(pose.curve.points, max(1, len(pose.curve.points) // 16), axis=0)
    for onward in [*np.diff(points, axis=0), rotation(pose.end).as_matrix()[:, 2]]:
        n = onward / np.linalg.norm(onward)
        R, t = shortest_turn(t, n) * R, n
    return _opposite(pose, R)


def scaled(curves=1.0, clamps=1.0, length=1.0, density=1.0):
    """Parts of a study in another unit."""

    def clamp(c):
        return None if c is None else Clamp(clamps * c.position, c.quaternion)

    def made(study):
        poses = [replace(p, start=clamp(p.start), end=clamp(p.end)) for p in study.poses]
        poses = tuple(replace(p, curve=MeasuredCurve(curves * p.curve.points)) for p in poses)
        factors = {"length": length, "length_density": density}
        return replace(study, poses=poses, cable={**study.cable, **{n: f * study.cable[n] for n, f in factors.items()}})

    return made


def gravity(other):
    return lambda study: replace(study, gravity=other(np.asarray(study.gravity)))


CONJUGATED = ("signs of their x, y and z", "by [0, 1, 0, 0]")  # the same for clamps along an axis
KINDS = {
    "first two fitted poses exchanged": (exchanged(lambda s: s.fit_poses[:2]), ("exchange their centre_curve",)),
    "last two fitted poses exchanged": (exchanged(lambda s: s.fit_poses[::-1][:2]), ("exchange their centre_curve",)),
    "a fitted and a validate pose exchanged": (
        exchanged(lambda s: (*s.fit_poses[:1], *s.validate_poses[:1])), ("exchange their centre_curve",)
    ),
    "clamps copied from another pose": (copied_clamps, ("look at its clamps", "multiply its end quaternion")),
    "a turn too many in one pose": (more_turns(1, 0), ("turns =",)),
    "a turn too few in one pose": (more_turns(-1, 1), ("turns =",)),
    "end rolled by half a turn in one pose": (rolls(180, "end", fit_pose(1)), ("multiply its end quaternion",)),
    "end rolled by 90 degrees in one pose": (rolls(90, "end", fit_pose(1)), ("multiply its end quaternion",)),
    "end rolled by 90 degrees in all poses": (rolls(90, "end"), ("multiply the end quaternions",)),
    "end rolled by half a turn in all poses": (rolls(180, "end"), ("multiply the end quaternions",)),
    "start rolled by -90 degrees in all poses": (rolls(-90, "start"), ("multiply the end quaternions",)),
    "sign of the rolls from pose to pose": (other_roll, ("turn the roll",)),
    "sign of the twist": (poses_changed(only_held(other_twist)), ("turn the roll",)),
    "tangent is x": (all_clamps(_about("y", -90)), ("x axis",)),
    "tangent is y": (all_clamps(_about("x", 90)), ("y axis",)),
    "tangent is -z": (all_clamps(_about("x", 180)), ("z axis", "multiply the start quaternions")),
    "tangent inward at the end": (all_clamps(_about("x", 180), "end"), ("multiply the end quaternions",)),
    "one curve reversed": (poses_changed(reversed_curve, fit_pose(1)), ("reverse the order",)),
    "all curves reversed": (poses_changed(reversed_curve), ("reverse the order",)),
    "clamps exchanged in one pose": (poses_changed(exchanged_clamps, fit_pose(1)), ("exchange",)),
    "clamps exchanged in all poses": (poses_changed(exchanged_clamps), ("exchange",)),
    "quaternions scalar-last": (all_clamps(lambda c: np.roll(c.quaternion, -1)), ("[w, x, y, z]",)),
    "quaternions conjugated": (all_clamps(lambda c: c.quaternion * [1, -1, -1, -1]), CONJUGATED),
    "gravity upward": (gravity(lambda g: -g), ("write gravity",)),
    "gravity along another axis": (gravity(lambda g: np.roll(g, 1)), ("write gravity",)),
    "density in g/m": (scaled(density=1000.0), ("check the unit",)),
    "density in t/m": (scaled(density=0.001), ("check the unit",)),
    "density in lb/m": (scaled(density=2.2046), ("check the unit", "looks like lb/m")),
    "curves 2 % too large": (scaled(curves=1.02), ("curves look",)),
    "clamps 2 % too large": (scaled(clamps=1.02), ("positions look",)),
}
for part, units in {"curves": UNITS, "clamps": ("mm", "inches"), "length": UNITS}.items():
    KINDS |= {f"{part} in {unit}": (scaled(**{part: UNITS[unit][1]}), UNITS[unit][:1]) for unit in units}
"""By mistake: its function, from study to study or to None where impossible, and words of the right remedy."""


def chosen(data: Path) -> dict:
    """The five studies by their names, the real ones first: they are fitted in seconds."""
    some = {name: load_study(data / name) for name in REAL}
    for path in sorted((data / "practice" / "cases").iterdir()):
        study = load_study(path)
        whole = all(p.curve is not None and both_held(p) for p in study.poses)
        right = whole and len(study.fit_poses) >= FEWEST and not answer(data, path.name)["kinds"]
        if len(some) < SIMULATED + len(REAL) and right:
            some[path.name] = study
    return some


def answer(data: Path, name: str) -> dict:
    """The truth of a practice study; nothing of a real one."""
    path = data / "practice" / "answers" / f"{name}.toml"
    return tomllib.loads(path.read_text()) if path.exists() else {}


def fitted(study):
    """The fit, or the sentence of its refusal."""
    try:
        return fit(study, elements=ELEMENTS)
    except Scan2FlexError as fault:
        return str(fault)


def judged(study, clean, words, truth) -> dict:
    """The result for a mistaken study; ``clean`` is the fit before the mistake."""
    result = fitted(study)
    if isinstance(result, str):
        return {"outcome": NAMED if any(w in result for w in words) else WARNED, "by": "refusal", "says": result[-300:]}
    checked = study_warnings(study)[:FIRST]
    lines = result.summary().splitlines()[1:FIRST]
    right = not result.mistakes or result.mistakes[0].after is None or result.mistakes[0].after < FITS * clean.rms()
    doubted = bool(result.doubts or not result.believable)
    out = {"says": [*checked[:1], *lines], "excludes the truth": excluded(result, truth), "doubted": doubted}
    by = [who for who, said in (("fit", lines), ("check", checked)) if any(w in line for w in words for line in said)]
    if by and right:
        return out | {"outcome": NAMED, "by": by[0]}
    if result.mistakes and same(result.mistakes[0].study, clean.study):
        return out | {"outcome": NAMED, "by": "fit"}
    if traceless(study, result, clean):
        return out | {"outcome": TRACELESS}
    if doubted:
        return out | {"outcome": WARNED}
    e = explain(study, elements=ELEMENTS, mesh=False)
    return out | {"outcome": MISSED, "explain": {"verdict": e.verdict, "chosen": [r.kind for r in e.chosen]}}


def same(mended, study) -> bool:
    """Whether a corrected study equals the study before the mistake, up to a roll common to both clamps of a pose."""
    pairs = list(zip(mended.poses, study.poses, strict=True))
    if any(len(a.curve.points) != len(b.curve.points) for a, b in pairs):
        return False
    apart = [mended.gravity - study.gravity, mended.cable["length"] - study.cable["length"]]
    for a, b in pairs:
        apart.append(a.curve.points - b.curve.points)
        for one, other in ((a.start, b.start), (a.end, b.end)):
            apart += [] if one is None else [one.position - other.position, one.tangent - other.tangent]
        if both_held(b):
            p, q = (rotation(x.start).inv() * rotation(x.end) for x in (a, b))
            roll = rotation(b.start).inv() * rotation(a.start)
            apart.append(np.linalg.norm((roll * p * roll.inv() * q.inv()).as_rotvec()))
    return max(float(np.max(np.abs(x))) for x in apart) < 1e-3


def traceless(study, result, clean) -> bool:
    """Whether the shapes do not reveal the mistake: they fit the mistaken study as well, at the values of its fit or at
    stiffnesses in proportion to its weight."""
    off = [result.poses[p.name].modelled - clean.poses[p.name].modelled for p in clean.study.fit_poses]
    if not result.turned and nearly_equal(off, result.rms(), clean.rms()):
        return True
    weights = [s.cable["length_density"] * float(np.linalg.norm(s.gravity)) for s in (clean.study, study)]
    before = evaluated(clean.study, clean.minimum.shared)
    shared = clean.minimum.shared.copy()
    shared[: clean.problem.layout.unknowns] += np.log(weights[1] / weights[0])  # the unknowns of these studies are stiffnesses
    after = evaluated(study, shared, before.configuration)
    off = after.configuration.r - before.configuration.r
    return bool(after.solved and nearly_equal(off, *(float(np.sqrt(np.sum(e.residual**2))) for e in (after, before))))


def nearly_equal(off, residual, clean) -> bool:
    """Whether shapes and residuals differ by little, compared with the residual of the study without the mistake."""
    apart = float(np.sqrt(np.mean([np.sum(np.square(d), axis=-1) for d in off])))
    return apart < TRACE * clean and abs(residual / clean - 1.0) < TRACE


def evaluated(study, shared, start=None):
    """All poses of a study, validate poses too, at values of its unknowns."""
    every = replace(study, poses=tuple(replace(p, role="fit") for p in study.poses))
    return Problem(every, ELEMENTS).evaluator(shared, start=start)


def excluded(result, truth) -> bool | None:
    """Whether an interval excludes the truth; None without a truth."""
    known = {n: truth.get(f"true_{n}") for n in result.estimates}
    bars = [(e.low, known[n], e.high) for n, e in result.estimates.items() if known[n] is not None and e.low is not None]
    return any(not low <= true <= high for low, true, high in bars) if bars else None


def summed(cases, silent) -> dict:
    """Counts of named mistakes and of false accusations."""
    rows = [case for study in cases.values() for case in study.values() if case is not None]
    counts = {outcome: sum(r["outcome"] == outcome for r in rows) for outcome in (NAMED, WARNED, TRACELESS, MISSED)}
    wrong = [r for r in rows if r["outcome"] in (TRACELESS, MISSED) and r.get("excludes the truth") and not r.get("doubted")]
    return {
        "kinds": len(KINDS), "made": len(rows), **counts,
        "intervals without a warning that exclude the truth, with a trace": sum(r["outcome"] == MISSED for r in wrong),
        "the same without a trace": sum(r["outcome"] == TRACELESS for r in wrong),
        "physics named": sum(bool(r.get("explain", {}).get("chosen")) for r in rows),
        "without a mistake": len(silent), "accused": [n for n, r in silent.items() if r["mistakes"]],
    }  # fmt: skip


def main() -> None:
    """All mistakes of all studies, then the studies without one."""
    data = Path(os.environ.get("SCAN2FLEX_DATA", ""))
    if not (data / "practice").is_dir():
        sys.exit("name the folder that holds practice, textile-strip and black-wire in SCAN2FLEX_DATA")
    prepare_jax()
    known = recorded("mistakes") or {"cases": {}, "silent": {}}
    cases, silent = known["cases"], known["silent"]
    keep = lambda: record("mistakes", {"cases": cases, "silent": silent, "table": summed(cases, silent)})  # noqa: E731

    def with_mistake(study, clean, truth, kind):
        change, words = KINDS[kind]
        mistaken = change(study)
        return None if mistaken is None else judged(mistaken, clean(), words, truth)

    for name, study in chosen(data).items():
        one = partial(with_mistake, study, cache(partial(fitted, study)), answer(data, name))
        complete(cases.setdefault(name, {}), KINDS, one, keep)
    folders = {f.name: f for f in [*sorted((data / "practice" / "cases").iterdir()), *(data / n for n in (*REAL, "red-wire"))]}
    whole = [name for name, f in folders.items() if all(p.curve is not None for p in load_study(f).poses)]

    def without(name):
        result = fitted(load_study(folders[name]))
        return {"mistakes": [] if isinstance(result, str) else [str(m) for m in result.mistakes]}

    complete(silent, whole, without, keep)


if __name__ == "__main__":
    main()
