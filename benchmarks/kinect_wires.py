"""Three wires picked on Kinect depth images: all four poses fitted, and each predicted from the other three.

    SCAN2FLEX_DATA=... python -m benchmarks.kinect_wires      (the folder that holds `wires-kinect`)

The curves are the picks, 11 to 16 a pose, moved by the radius away from the camera; clamps are at their ends, along the
directions there. What the images do not determine has tolerances: directions, places, the length (the camera's focal length is
nominal), gravity (the image's downward direction), and the roll of the clamps. A pose left out is solved with its clamps as
read and without roll, and with clamps, length and gravity fitted to it within the tolerances. docs/accuracy.md has the results
beside the published ones (Chen, Bretl, Pham, arXiv 2310.00911).
"""

import os
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from benchmarks.curves import arc_lengths, carried
from benchmarks.record import record
from scan2flex_jax import plot
from scan2flex_jax.cli.setup import prepare_jax
from scan2flex_jax.convert.curves import read_foreign_points
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.inference import fit
from scan2flex_jax.prediction import predict
from scan2flex_jax.scan.extraction import extract
from scan2flex_jax.study import Clamp, MeasuredCurve, Study, StudyPose, Tolerance, Unknown

LENGTH, RADIUS, NOISE = 0.40, 0.002, 0.0023  # m
DENSITY = {"white": 0.01740, "black": 0.02718, "red": 0.02150}  # kg/m
PUBLISHED = {"white": (1.33, 1.62), "black": (2.44, 3.52), "red": (3.05, 4.28)}  # %
TOLERANCE = {"length": 0.02, "clamp_position": 0.004, "clamp_rotation": 0.15, "clamp_roll": 3.0, "gravity": 0.1}
FOCAL, CENTRE = 504.0, (320.0, 288.0)  # pixels: the nominal Azure Kinect, 640 x 576 narrow view
STIFFNESSES = ("bending_stiffness", "torsional_stiffness")
PICTURE = Path(__file__).parents[1] / "docs" / "real-cable.png"
GUESS = 1e-3  # N m^2: the order of magnitude that a guess from thickness and feel may give, ten times too stiff
MEASURED = {"color": "#888888", "ls": "", "marker": "o", "ms": 3.5, "label": "measured", "zorder": 0}
BEFORE = {"color": "#2a5ca8", "ls": "--", "lw": 1.6, "label": f"before: guessed EI = {GUESS:g} N m²"}
AFTER = {"color": "#c1272d", "lw": 1.6, "label": "after: fit of the four poses"}
HELD = 1e-3  # relative standard deviation of a bending stiffness that is known from other poses


def read_picks(path: str | Path) -> Float[np.ndarray, "n 3"]:
    """Rows of ``u, v, depth in mm`` without a header, in order along the cable."""
    picks = 1e3 * read_foreign_points(Path(path), units="mm")
    if not (picks[:, 2] > 0).all():
        raise Scan2FlexError(f"{path} must hold columns u, v, depth in mm with positive depth")
    return picks


def deproject(picks: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Points (m) in the camera's frame: x = (u - c_u) z / f, y = (v - c_v) z / f, z the depth."""
    z = 1e-3 * picks[:, 2:]
    return np.concatenate([(picks[:, :2] - CENTRE) * z / FOCAL, z], axis=1)


@cache
def curve_of(path):
    """The centre curve through the picks of one image."""
    points = deproject(read_picks(path))
    return extract(points, RADIUS, guide_points=points, viewpoints=np.zeros((1, 3)), noise=NOISE)


def pose_of(path, role):
    """A pose of the study from its picks, with clamps where they end, without twist between them."""
    points, tangents = axis_points(path), curve_of(path).tangents
    frames = carried(tangents, first_frame(tangents[0]))
    clamps = [Clamp(points[k], Rotation.from_matrix(frames[k]).as_quat(scalar_first=True)) for k in (0, -1)]
    return StudyPose(path.stem, role, *clamps, curve=MeasuredCurve(points))


def axis_points(path):
    """The picks (n, 3), m, moved from the surface that the camera sees to the axis."""
    points = deproject(read_picks(path))
    return points * (1.0 + RADIUS / np.linalg.norm(points, axis=1, keepdims=True))


def first_frame(tangent):
    """A frame with d3 along a tangent, of any roll."""
    side = np.cross(tangent, np.eye(3)[np.argmin(np.abs(tangent))])
    frame = np.column_stack([side, np.cross(tangent, side), tangent])
    return frame / np.linalg.norm(frame, axis=0)


def along(points, count=41):
    """``count`` points at equal fractions of a polygon's length."""
    s = arc_lengths(points)
    at = np.linspace(0.0, s[-1], count)
    return np.stack([np.interp(at, s, x) for x in points.T], axis=1)


def study_of(wire, paths, unseen=None):
    """A wire's poses, one of them perhaps for validation only."""
    poses = tuple(pose_of(p, "validate" if p == unseen else "fit") for p in paths)
    cable = {"length": LENGTH, "radius": RADIUS, "length_density": DENSITY[wire]}
    return Study(wire, [0.0, 9.81, 0.0], cable, poses, Tolerance(**TOLERANCE), tuple(map(Unknown, STIFFNESSES)))


def fitted(study):
    """The fit of a study, or the sentence of its error."""
    try:
        return fit(study)
    except Scan2FlexError as fault:
        return str(fault)


def within_tolerances(study, unseen) -> dict:
    """The error of a pose with the cable of ``study``, known from others, while its clamps, length and gravity are fitted."""
    EI = study.cable["bending_stiffness"]
    held = Unknown("bending_stiffness", guess=EI, prior={"mean": EI, "std": HELD * EI})
    f = fitted(replace(study, poses=(pose_of(unseen, "fit"),), unknowns=(held,)))
    return {"failed": f} if isinstance(f, str) else {"mean node error over length": node_error(f.poses[unseen.stem])}


def node_error(pose) -> float:
    """Mean distance over the length between nodes at equal fractions of both curves."""
    return float(np.linalg.norm(along(pose.modelled) - along(pose.measured), axis=1).mean() / LENGTH)


def left_out(wire, paths, unseen) -> dict:
    """The wire fitted without one pose, and that pose predicted."""
    f = fitted(study_of(wire, paths, unseen))
    if isinstance(f, str):
        return {"left out": unseen.stem, "solved": False, "why": f}
    one, e = f.poses[unseen.stem], f.estimates["bending_stiffness"]
    return {
        "left out": unseen.stem, "solved": one.stable, "bending_stiffness": e.value, "low": e.low, "high": e.high,
        "mean node error over length": node_error(one), "within tolerances": within_tolerances(f.calibrated, unseen),
    }  # fmt: skip


def all_fitted(f) -> dict:
    """The figures of the fit of a wire on all poses."""
    if isinstance(f, str):
        return {"solved": False, "why": f}
    e, twist = f.estimates["bending_stiffness"], f.estimates["torsional_stiffness"]
    errors = {n: node_error(p) for n, p in f.poses.items()}
    return {
        "bending_stiffness": e.value, "low": e.low, "high": e.high, "mean node error over length": errors,
        "torsional_stiffness": twist.value, "believable": f.believable, "sentences": f.sentences,
        "mean over poses": float(np.mean(list(errors.values()))),
    }  # fmt: skip


def mean_errors(solved) -> dict:
    """Means over the poses left out, each with the number of poses that it is of."""
    out = {}
    kinds = {"as read": solved, "within tolerances": [r["within tolerances"] for r in solved]}
    for kind, entries in kinds.items():
        errors = [e["mean node error over length"] for e in entries if "mean node error over length" in e]
        out[kind] = {"mean": float(np.mean(errors)) if errors else None, "worst": max(errors, default=None), "of": len(errors)}
    return out


def wires_folder() -> Path:
    folder = Path(os.environ.get("SCAN2FLEX_DATA", "")) / "wires-kinect"
    if not folder.is_dir():
        sys.exit("the picked points are public in github.com/qj25/adapteddlo_muj: name the folder above them in SCAN2FLEX_DATA")
    return folder


def picture(f, rows) -> None:
    """The poses of a fit: measured, with a guessed stiffness, and fitted; their titles have the errors of `left_out` too."""
    unseen = {r["left out"]: r["mean node error over length"] for r in rows}
    before = predict(replace(f.study, unknowns=(), cable={**f.study.cable, **dict.fromkeys(STIFFNESSES, GUESS)}))
    figure, axes = plt.subplots(2, 2, figsize=(8.2, 5.4), layout="constrained")
    for ax, (name, after) in zip(axes.flat, f.poses.items(), strict=True):
        first = replace(after, modelled=before[name].points)
        errors = {"before": node_error(first), "fitted": node_error(after), "left out": unseen[name]}
        for points, style in ((first.modelled, BEFORE), (after.modelled, AFTER), (after.measured, MEASURED)):
            ax.plot(100 * points[:, 0], -100 * points[:, 1], **style)
        ax.set_title(f"{name}: off by {', '.join(f'{100 * e:.1f} % {n}' for n, e in errors.items())}", fontsize=9)
        ax.set_aspect("equal", adjustable="datalim")
        ax.set(xlabel="across (cm)", ylabel="up (cm)")
    figure.legend(*axes.flat[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    plot.save(figure, PICTURE, dpi=110)


def main() -> None:
    """All wires, all poses left out in turn."""
    folder, out = Path(os.environ.get("SCAN2FLEX_DATA", "")) / "wires-kinect", {}
    if not folder.is_dir():
        sys.exit("the picked points are public in github.com/qj25/adapteddlo_muj: name the folder above them in SCAN2FLEX_DATA")
    prepare_jax()
    mpl.use("Agg")
    for wire in DENSITY:
        paths = sorted(folder.glob(f"{wire}*.csv"))
        rows, whole = [left_out(wire, paths, p) for p in paths], fitted(study_of(wire, paths))
        means = mean_errors([r for r in rows if r["solved"]])
        out[wire] = {"all fitted": all_fitted(whole), "poses": rows, **means, "published, percent": PUBLISHED[wire]}
        print(f"{wire}: all fitted {out[wire]['all fitted']}; left out in turn {means}", flush=True)
        if wire == "white":
            picture(whole, rows)
    record("kinect_wires", out)


if __name__ == "__main__":
    main()
