"""Three wires picked on Kinect depth images: fitted on three poses each, and predicted in the fourth.

    SCAN2FLEX_DATA=... python -m benchmarks.kinect_wires      (the folder that holds `wires-kinect`)

Known are the weight per length and the length of 0.40 m; a pose's clamps are where its picks end, along the directions in
which they end, and free of twist. What the images do not tell has tolerances: directions, places, length (the camera's focal
length is nominal) and gravity, taken as the image's downward direction. The pose left out has no part in the fit, and none of
its tolerances are used: its clamps are taken as they were read. Nothing is rotated, scaled or stretched onto anything. "All
fitted" is the error of the four poses that a fit of all saw, with their tolerances used: what the published figures are
closest to. "Explained" is the pose left out, predicted with the effects that `explain` finds in the other three.

Published for these wires (Chen, Bretl, Pham, arXiv 2310.00911), mean node error over length, all poses known to the fit and
measured curves rotated and stretched onto the simulated chord: adapted discrete elastic rod 1.33, 2.44, 3.05 %, MuJoCo's
cable 1.62, 3.52, 4.28 % (white, black, red).
"""

import os
import sys
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from benchmarks.record import record

LENGTH, RADIUS, NOISE = 0.40, 0.002, 0.0023  # m
DENSITY = {"white": 0.01740, "black": 0.02718, "red": 0.02150}  # kg/m
PUBLISHED = {"white": (1.33, 1.62), "black": (2.44, 3.52), "red": (3.05, 4.28)}  # %
TOLERANCE = {"length": 0.02, "clamp_position": 0.004, "clamp_rotation": 0.15, "gravity": 0.1}
EI_OVER_GJ = 1.3  # of a solid round wire of Poisson's ratio 0.3; poses free of twist hardly feel it


@cache
def curve_of(path):
    """The centre curve through the picks of one image."""
    from benchmarks import kinect_picks  # noqa: PLC0415

    return kinect_picks.curve_from_picks(kinect_picks.read_picks(path), RADIUS, NOISE)


def pose_of(path, role):
    """A pose of the study from its picks: the curve, and clamps where it ends, without twist between them."""
    from scan2flex_jax.study import Clamp, MeasuredCurve, StudyPose  # noqa: PLC0415

    curve = curve_of(path)
    frames = transported(curve.tangents)
    clamps = [Clamp(curve.points[k], quaternion(frames[k])) for k in (0, -1)]
    return StudyPose(path.stem, role, *clamps, curve=MeasuredCurve(curve.points[:: max(1, len(curve.points) // 40)]))


def transported(tangents):
    """Frames (n, 3, 3) along a curve that do not turn about it."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415

    side = np.cross(tangents[0], np.eye(3)[np.argmin(np.abs(tangents[0]))])
    frame = np.column_stack([side / np.linalg.norm(side), np.cross(tangents[0], side / np.linalg.norm(side)), tangents[0]])
    out = [frame]
    for a, b in pairwise(tangents):
        axis = np.cross(a, b)
        sine = np.linalg.norm(axis)
        turn = Rotation.from_rotvec(axis / max(sine, 1e-300) * np.arctan2(sine, a @ b)).as_matrix()
        out.append(turn @ out[-1])
    return np.array(out)


def quaternion(frame):
    """Scalar first."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415

    return Rotation.from_matrix(frame).as_quat(scalar_first=True)


def along(points, count=41):
    """``count`` points at equal fractions of a polygon's length."""
    s = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
    at = np.linspace(0.0, s[-1], count)
    return np.stack([np.interp(at, s, x) for x in points.T], axis=1)


def study_of(wire, paths, unseen=None):
    """A wire's poses, one of them perhaps for validation only."""
    from scan2flex_jax.study import Study, Tolerance, Unknown  # noqa: PLC0415

    poses = tuple(pose_of(p, "validate" if p == unseen else "fit") for p in paths)
    cable = {"length": LENGTH, "radius": RADIUS, "length_density": DENSITY[wire], "torsional_stiffness": 1e-3 / EI_OVER_GJ}
    return Study(wire, [0.0, 9.81, 0.0], cable, poses, Tolerance(**TOLERANCE), (Unknown("bending_stiffness"),))


def fitted(wire, paths, unseen=None):
    """The fit of a wire's poses; an error's sentence where there is none."""
    from scan2flex_jax.errors import Scan2FlexError  # noqa: PLC0415
    from scan2flex_jax.fitting import fit  # noqa: PLC0415

    try:
        return fit(study_of(wire, paths, unseen))
    except Scan2FlexError as fault:
        return str(fault)


def explained(wire, paths, unseen) -> dict:
    """What `explain` makes of three poses, and the error in the fourth with it; none where that pose is not solved."""
    from scan2flex_jax.diagnosis import explain  # noqa: PLC0415

    e = explain(study_of(wire, paths, unseen))
    one = e.poses.get(unseen.stem)
    error = {"mean node error over length": node_error(one)} if one is not None and one.stable else {}
    return {"verdict": e.verdict, "added": [r.in_short() for r in e.added], "seconds": e.seconds} | error


def node_error(pose) -> float:
    """Mean distance over the length between nodes at equal fractions of both curves."""
    return float(np.linalg.norm(along(pose.modelled) - along(pose.measured), axis=1).mean() / LENGTH)


def left_out(wire, paths, unseen) -> dict:
    """The wire fitted without one pose, and that pose predicted."""
    f = fitted(wire, paths, unseen)
    if isinstance(f, str):
        return {"left out": unseen.stem, "solved": False, "why": f}
    one, e = f.poses[unseen.stem], f.estimates["bending_stiffness"]
    return {
        "left out": unseen.stem, "solved": one.stable, "bending_stiffness": e.value, "low": e.low, "high": e.high,
        "mean node error over length": node_error(one),
        "mean distance over length": float(np.mean(np.linalg.norm(one.residual, axis=1)) / LENGTH),
        "measured length": float(np.linalg.norm(np.diff(one.measured, axis=0), axis=1).sum()),
        "explained": explained(wire, paths, unseen),
    }  # fmt: skip


def all_fitted(wire, paths) -> dict:
    """The wire fitted on all poses."""
    f = fitted(wire, paths)
    if isinstance(f, str):
        return {"solved": False, "why": f}
    e = f.estimates["bending_stiffness"]
    errors = {n: node_error(p) for n, p in f.poses.items()}
    told = {"bending_stiffness": e.value, "low": e.low, "high": e.high, "mean node error over length": errors}
    return told | {"mean over poses": float(np.mean(list(errors.values())))}


def main() -> None:
    """All wires, all poses left out in turn."""
    from scan2flex_jax.cli.setup import prepare_jax  # noqa: PLC0415

    folder = Path(os.environ.get("SCAN2FLEX_DATA", "")) / "wires-kinect"
    if not folder.is_dir():
        sys.exit("the picked points are public in github.com/qj25/adapteddlo_muj: name the folder above them in SCAN2FLEX_DATA")
    prepare_jax()
    out = {}
    for wire in DENSITY:
        paths = sorted(folder.glob(f"{wire}*.csv"))
        rows, whole = [left_out(wire, paths, p) for p in paths], all_fitted(wire, paths)
        solved = [r for r in rows if r["solved"]]
        mean = {k: float(np.mean([r[k] for r in solved])) for k in ("mean node error over length", "mean distance over length")}
        after = [v for r in solved if (v := r["explained"].get("mean node error over length")) is not None]
        told = {"explained": float(np.mean(after)) if after else None, "explained and solved": len(after)}
        known = {"published, percent": PUBLISHED[wire]}
        out[wire] = {"all fitted": whole, "poses": rows, "solved": len(solved), **mean, **told, **known}
        found = [r.get("bending_stiffness") or r["why"] for r in rows]
        sys.stdout.write(f"{wire}: all fitted {whole}; left out in turn {mean} {found}; {told}\n")
        sys.stdout.write(f"{[r['explained'] for r in solved]}\n")
    record("kinect_wires", out)


if __name__ == "__main__":
    main()
