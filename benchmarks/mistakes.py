"""Deliberate mistakes in studies: are they named by `check` and `fit`, and is a study without any accused?

    SCAN2FLEX_DATA=... python -m benchmarks.mistakes      (the folder that holds `practice`, `textile-strip` and `black-wire`)

Every mistake is applied to three simulated studies (the first of the practice studies, by number, that have centre curves,
clamps at both ends, four fitted poses and nothing missing) and to two real ones. A mistake counts as

* *named* if `check_study` refuses the study, `check` warns or `fit` reports it in its first three lines, with the right remedy,
  and the corrected study fits as the one before the mistake (within a fifth);
* *without trace* if the mistaken study, at stiffnesses in proportion to its weight, has the same shapes and residual;
* *warned* if the first three lines doubt the values without naming it; else it is *missed*, and `explain` is run too.

Then all other practice studies, most of them with an undeclared effect, are fitted as they are: any mistake named there is a
false accusation.

Recorded cases are kept, so that an interrupted run continues; `--again` repeats them. The record is
`benchmarks/results/mistakes.json`.
"""

import argparse
import json
import os
import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

from benchmarks.record import RESULTS, record
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.study import Clamp, MeasuredCurve, load_study, study_warnings

ELEMENTS = 20  # of all fits here: the mesh error stays below 1e-4 of the length
SIMULATED, REAL = 3, ("textile-strip", "black-wire")
FEWEST = 4  # fitted poses of a simulated study
FIRST = 3  # lines that everybody reads
ALIKE = 1.2  # times the residual of the study before the mistake
TRACE = 0.1  # of that residual: modelled shapes that differ by less are the same
MILLIMETRES, CENTIMETRES, INCHES, BADLY = 1000.0, 100.0, 1 / 0.0254, 1.02
POUNDS = 2.2046


def _rotation(clamp):
    return Rotation.from_quat(clamp.quaternion, scalar_first=True)


def _held(clamp):
    return clamp is not None and clamp.quaternion is not None


def poses_changed(change, which=None):
    """A mistake of all poses, or of those that ``which(study)`` gives."""

    def made(study):
        names = [p.name for p in (study.poses if which is None else which(study))]
        poses = tuple(change(p) if p.name in names else p for p in study.poses)
        return replace(study, poses=poses) if any(a is not b for a, b in zip(poses, study.poses, strict=True)) else None

    return made


def clamps_changed(change, ends=("start", "end")):
    def one(pose):
        held = {end: getattr(pose, end) for end in ends if _held(getattr(pose, end))}
        return replace(pose, **{end: Clamp(c.position, change(c)) for end, c in held.items()}) if held else pose

    return one


def turned(rotation):
    """Clamps written with other axes of the same body."""
    return lambda c: np.roll((_rotation(c) * rotation).as_quat(), 1)


def rolled(degrees):
    return turned(Rotation.from_euler("z", degrees, degrees=True))


def both_held(pose):
    return _held(pose.start) and _held(pose.end)


def fit_pose(k):
    """The fitted pose number ``k`` with two clamps (the last one where there are fewer)."""

    def which(study):
        some = [p for p in study.fit_poses if both_held(p)] or list(study.fit_poses)
        return [some[min(k, len(some) - 1)]]

    return which


def with_more_turns(more):
    return lambda p: replace(p, turns=p.turns + more) if both_held(p) else p


def only_held(change):
    return lambda p: change(p) if both_held(p) else p


def swapped(pick):
    def made(study):
        pair = pick(study)
        if pair is None:
            return None
        a, b = pair
        curves = {a.name: b.curve, b.name: a.curve}
        return replace(study, poses=tuple(replace(p, curve=curves.get(p.name, p.curve)) for p in study.poses))

    return made


def two_fitted(first):
    def pick(study):
        some = study.fit_poses if first else study.fit_poses[::-1]
        return some[:2] if len(some) > 1 else None

    return pick


def fitted_and_not(study):
    return (study.fit_poses[0], study.validate_poses[0]) if study.validate_poses else None


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


def other_roll(study):
    """Rolls from the first pose's, on the shortest way from tangent to tangent, with the other sign."""
    first = next((p for p in study.poses if both_held(p)), None)
    if first is None:
        return None
    a = _rotation(first.end)

    def one(pose):
        if not both_held(pose) or pose is first:
            return pose
        b = _rotation(pose.end)
        ta, tb = (x.as_matrix()[:, 2] for x in (a, b))
        axis = np.cross(ta, tb)
        sine = np.linalg.norm(axis)
        across = Rotation.from_rotvec(axis / max(sine, 1e-12) * np.arctan2(sine, ta @ tb)) * a
        roll = (across.inv() * b).as_rotvec()
        return replace(pose, end=Clamp(pose.end.position, np.roll((across * Rotation.from_rotvec(-roll)).as_quat(), 1)))

    return replace(study, poses=tuple(one(p) for p in study.poses))


def other_twist(study):
    """The end clamps rolled so that the twist of every pose, beyond frames carried along its curve, has the other sign."""

    def one(pose):
        if not both_held(pose):
            return pose
        R, t = _rotation(pose.start), _rotation(pose.start).as_matrix()[:, 2]
        points = uniform_filter1d(pose.curve.points, max(1, len(pose.curve.points) // 16), axis=0)
        for onward in [*np.diff(points, axis=0), _rotation(pose.end).as_matrix()[:, 2]]:
            n = onward / np.linalg.norm(onward)
            axis = np.cross(t, n)
            sine = np.linalg.norm(axis)
            R, t = Rotation.from_rotvec(axis / max(sine, 1e-12) * np.arctan2(sine, t @ n)) * R, n
        twist = (R.inv() * _rotation(pose.end)).as_rotvec()
        return replace(pose, end=Clamp(pose.end.position, np.roll((R * Rotation.from_rotvec(-twist)).as_quat(), 1)))

    out = replace(study, poses=tuple(one(p) for p in study.poses))
    return out if any(both_held(p) for p in study.poses) else None


def scaled(curves=1.0, clamps=1.0, length=1.0, density=1.0):
    def clamp(c):
        return None if c is None else Clamp(clamps * c.position, c.quaternion)

    def made(study):
        def one(pose):
            own = {"start": clamp(pose.start), "end": clamp(pose.end), "curve": MeasuredCurve(curves * pose.curve.points)}
            return replace(pose, **own)

        factors = {"length": length, "length_density": density}
        cable = {**study.cable, **{name: factor * study.cable[name] for name, factor in factors.items()}}
        return replace(study, poses=tuple(map(one, study.poses)), cable=cable)

    return made


def gravity(other):
    return lambda study: replace(study, gravity=other(np.asarray(study.gravity)))


def _axes(axis, degrees):
    return turned(Rotation.from_euler(axis, degrees, degrees=True))


def all_clamps(change, *ends):
    return poses_changed(clamps_changed(change, ends or ("start", "end")))


def all_rolls(degrees, end):
    return poses_changed(only_held(clamps_changed(rolled(degrees), (end,))))


def one_roll(degrees):
    return poses_changed(only_held(clamps_changed(rolled(degrees), ("end",))), fit_pose(1))


# what was done: how, and words of which a right mend has one
KINDS = {
    "first two fitted poses exchanged": (swapped(two_fitted(True)), ("exchange their centre_curve",)),
    "last two fitted poses exchanged": (swapped(two_fitted(False)), ("exchange their centre_curve",)),
    "a fitted and a validate pose exchanged": (swapped(fitted_and_not), ("exchange their centre_curve",)),
    "clamps copied from another pose": (copied_clamps, ("look at its clamps", "multiply its end quaternion")),
    "a turn too many in one pose": (poses_changed(with_more_turns(1), fit_pose(0)), ("turns =",)),
    "a turn too few in one pose": (poses_changed(with_more_turns(-1), fit_pose(1)), ("turns =",)),
    "end rolled by half a turn in one pose": (one_roll(180), ("multiply its end quaternion",)),
    "end rolled by 90 degrees in one pose": (one_roll(90), ("multiply its end quaternion",)),
    "end rolled by 90 degrees in all poses": (all_rolls(90, "end"), ("multiply the end quaternions",)),
    "end rolled by half a turn in all poses": (all_rolls(180, "end"), ("multiply the end quaternions",)),
    "start rolled by -90 degrees in all poses": (all_rolls(-90, "start"), ("multiply the end quaternions",)),
    "sign of the rolls from pose to pose": (other_roll, ("turn the roll",)),
    "sign of the twist": (other_twist, ("turn the roll",)),
    "tangent is x": (all_clamps(_axes("y", -90)), ("x axis",)),
    "tangent is y": (all_clamps(_axes("x", 90)), ("y axis",)),
    "tangent is -z": (all_clamps(_axes("x", 180)), ("z axis", "multiply the start quaternions")),
    "tangent inward at the end": (all_clamps(_axes("x", 180), "end"), ("multiply the end quaternions",)),
    "one curve reversed": (poses_changed(reversed_curve, fit_pose(1)), ("reverse the order",)),
    "all curves reversed": (poses_changed(reversed_curve), ("reverse the order",)),
    "clamps exchanged in one pose": (poses_changed(exchanged_clamps, fit_pose(1)), ("exchange",)),
    "clamps exchanged in all poses": (poses_changed(exchanged_clamps), ("exchange",)),
    "quaternions scalar-last": (all_clamps(lambda c: np.roll(c.quaternion, -1)), ("[w, x, y, z]",)),
    "quaternions conjugated": (all_clamps(lambda c: c.quaternion * [1, -1, -1, -1]), ("signs of their x, y and z",)),
    "gravity upward": (gravity(lambda g: -g), ("write gravity",)),
    "gravity along another axis": (gravity(lambda g: np.roll(g, 1)), ("write gravity",)),
    "density in g/m": (scaled(density=1000.0), ("check the unit",)),
    "density in t/m": (scaled(density=0.001), ("check the unit",)),
    "density in lb/m": (scaled(density=POUNDS), ("check the unit", "looks like lb/m")),
    "curves in mm": (scaled(curves=MILLIMETRES), ("millimetres",)),
    "curves in cm": (scaled(curves=CENTIMETRES), ("centimetres",)),
    "curves in inches": (scaled(curves=INCHES), ("inches",)),
    "curves 2 % too large": (scaled(curves=BADLY), ("curves look",)),
    "clamps in mm": (scaled(clamps=MILLIMETRES), ("millimetres",)),
    "clamps in inches": (scaled(clamps=INCHES), ("inches",)),
    "clamps 2 % too large": (scaled(clamps=BADLY), ("positions look",)),
    "length in mm": (scaled(length=MILLIMETRES), ("millimetres",)),
    "length in cm": (scaled(length=CENTIMETRES), ("centimetres",)),
    "length in inches": (scaled(length=INCHES), ("inches",)),
}
NAMED, WARNED, TRACELESS, MISSED = "named", "warned", "without trace", "missed"


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
    from scan2flex_jax.fitting import fit  # noqa: PLC0415

    try:
        return fit(study, elements=ELEMENTS)
    except Scan2FlexError as fault:
        return str(fault)


def judged(study, clean, words, truth) -> dict:
    """The result for a mistaken study; ``clean`` is the fit before the mistake."""
    begin = perf_counter()
    found = fitted(study)
    seconds = round(perf_counter() - begin, 1)
    if isinstance(found, str):
        outcome = NAMED if any(w in found for w in words) else WARNED
        return {"outcome": outcome, "by": "refusal", "says": found[-300:], "seconds": seconds}
    checked = study_warnings(study)[:FIRST]
    lines = found.summary().splitlines()[1:FIRST]
    right = not found.mistakes or found.mistakes[0].after is None or found.mistakes[0].after < ALIKE * clean.rms()
    out = {"seconds": seconds, "says": [*checked[:1], *lines], "believable": found.believable, "valid": found.valid}
    out |= {"excludes the truth": excluded(found, truth), "doubted": bool(found.doubts or not found.believable)}
    by = [who for who, said in (("fit", lines), ("check", checked)) if any(w in line for w in words for line in said)]
    if by and right:
        return out | {"outcome": NAMED, "by": by[0]}
    if found.mistakes and same(found.mistakes[0].study, clean.study):
        return out | {"outcome": NAMED, "by": "fit"}
    if traceless(study, found, clean):
        return out | {"outcome": TRACELESS}
    if found.doubts or not found.believable:
        return out | {"outcome": WARNED}
    return out | {"outcome": MISSED, "explain": explained(study)}


def traceless(study, found, clean) -> bool:
    """Whether the shapes do not reveal the mistake: they fit the mistaken study as well, at the values of its fit or at
    stiffnesses in proportion to its weight."""
    off = [found.poses[p.name].modelled - clean.poses[p.name].modelled for p in clean.study.fit_poses]
    if not found.turned and alike(off, found.rms(), clean.rms()):
        return True
    weights = [s.cable["length_density"] * float(np.linalg.norm(s.gravity)) for s in (clean.study, study)]
    before = evaluated(clean.study, clean.minimum.shared)
    shared = clean.minimum.shared.copy()
    shared[: clean.problem.layout.unknowns] += np.log(weights[1] / weights[0])  # the unknowns of these studies are stiffnesses
    after = evaluated(study, shared, before.configuration)
    off = after.configuration.r - before.configuration.r
    return bool(after.solved and alike(off, *(float(np.sqrt(np.sum(e.residual**2))) for e in (after, before))))


def alike(off, residual, clean) -> bool:
    """Whether shapes and residuals differ by little, compared with the residual of the study without the mistake."""
    apart = float(np.sqrt(np.mean([np.sum(np.square(d), axis=-1) for d in off])))
    return apart < TRACE * clean and abs(residual / clean - 1.0) < TRACE


def evaluated(study, shared, start=None):
    """All poses of a study, validate poses too, at values of its unknowns."""
    from scan2flex_jax.fitting.problem import Problem  # noqa: PLC0415

    every = replace(study, poses=tuple(replace(p, role="fit") for p in study.poses))
    return Problem(every, ELEMENTS).evaluator(shared, start=start)


def same(mended, study) -> bool:
    """Whether a corrected study equals the study before the mistake, up to a roll common to both clamps of a pose."""
    pairs = list(zip(mended.poses, study.poses, strict=True))
    apart = [mended.gravity - study.gravity, mended.cable["length"] - study.cable["length"]]
    for a, b in pairs:
        apart.append(a.curve.points - b.curve.points)
        for one, other in ((a.start, b.start), (a.end, b.end)):
            apart += [] if one is None else [one.position - other.position, one.tangent - other.tangent]
        if both_held(b):
            p, q = (_rotation(x.start).inv() * _rotation(x.end) for x in (a, b))
            apart.append(np.linalg.norm((_roll(a, b) * p * _roll(a, b).inv() * q.inv()).as_rotvec()))
    return max(float(np.max(np.abs(x))) for x in apart) < 1e-3


def _roll(a, b):
    """The roll between the start clamps of a pose before and after."""
    return _rotation(b.start).inv() * _rotation(a.start)


def excluded(found, truth) -> bool | None:
    """Whether an interval excludes the truth; None without a truth."""
    known = {n: truth.get(f"true_{n}") for n in found.estimates}
    bars = [(e.low, known[n], e.high) for n, e in found.estimates.items() if known[n] is not None and e.low is not None]
    return any(not low <= true <= high for low, true, high in bars) if bars else None


def explained(study) -> dict:
    """The answer of `explain` to a mistake that nothing else reports."""
    from scan2flex_jax.diagnosis import explain  # noqa: PLC0415

    found = explain(study, elements=ELEMENTS, mesh=False)
    return {"verdict": found.verdict, "chosen": [r.kind for r in found.chosen]}


def accused(study) -> dict:
    """The result for a study without a mistake."""
    found = fitted(study)
    if isinstance(found, str):
        return {"says": found[-200:], "mistakes": []}
    return {"mistakes": [str(m) for m in found.mistakes], "rms over L": found.rms() / found.problem.length}


def summed(cases, silent) -> dict:
    """Counts of named mistakes and of false accusations."""
    rows = [case for study in cases.values() for case in study.values() if case is not None]
    counts = {outcome: sum(r["outcome"] == outcome for r in rows) for outcome in (NAMED, WARNED, TRACELESS, MISSED)}
    wrong = [r for r in rows if r["outcome"] in (TRACELESS, MISSED) and r.get("excludes the truth") and not r.get("doubted")]
    return {
        "kinds": len(KINDS), "made": len(rows), **counts,
        "named of those with a trace": counts[NAMED] / max(1, len(rows) - counts[TRACELESS]),
        "intervals without a warning that exclude the truth, with a trace": sum(r["outcome"] == MISSED for r in wrong),
        "the same without a trace": sum(r["outcome"] == TRACELESS for r in wrong),
        "physics named": sum(bool(r.get("explain", {}).get("chosen")) for r in rows),
        "without a mistake": len(silent), "accused": [n for n, r in silent.items() if r["mistakes"]],
    }  # fmt: skip


def main() -> None:
    """All mistakes of all studies, then the studies without one."""
    from scan2flex_jax.cli.setup import prepare_jax  # noqa: PLC0415

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--again", action="store_true", help="make recorded cases anew")
    again = parser.parse_args().again
    data = Path(os.environ.get("SCAN2FLEX_DATA", ""))
    if not (data / "practice").is_dir():
        sys.exit("name the folder that holds practice, textile-strip and black-wire in SCAN2FLEX_DATA")
    prepare_jax()
    path = RESULTS / "mistakes.json"
    known = json.loads(path.read_text())["results"] if path.exists() and not again else {"cases": {}, "silent": {}}
    cases, silent = known["cases"], known["silent"]
    for name, study in chosen(data).items():
        clean, mine = None, cases.setdefault(name, {})
        for kind, (change, words) in KINDS.items():
            if kind in mine:
                continue
            mistaken = change(study)
            clean = clean or (fitted(study) if mistaken is not None else None)
            mine[kind] = None if mistaken is None else judged(mistaken, clean, words, answer(data, name))
            sys.stdout.write(f"{name} | {kind} | {mine[kind]}\n")
            sys.stdout.flush()
            record("mistakes", {"cases": cases, "silent": silent, "table": summed(cases, silent)})
    for folder in [*sorted((data / "practice" / "cases").iterdir()), *(data / n for n in (*REAL, "red-wire"))]:
        study = load_study(folder)
        if folder.name not in silent and all(p.curve is not None for p in study.poses):
            silent[folder.name] = accused(study)
            sys.stdout.write(f"{folder.name} | nothing mistaken | {silent[folder.name]}\n")
            sys.stdout.flush()
            record("mistakes", {"cases": cases, "silent": silent, "table": summed(cases, silent)})


if __name__ == "__main__":
    main()
