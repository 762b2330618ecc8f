"""The README's first screen: the first lines of a fit, and a real cable before and after.

    python -m benchmarks.front_page

Lines: the opening of the first fit of docs/first-cable.md, without the time. Picture (`docs/real-cable.png`): a wire on four
depth images (`benchmarks.kinect_wires`; picked points: github.com/qj25/adapteddlo_muj) with a guessed stiffness and fitted.
Its titles include the error of each pose predicted from the other three.
"""

import os
import re
import shutil
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from benchmarks import kinect_wires
from benchmarks.record import committed, record

PICTURE = Path(__file__).parents[1] / "docs" / "real-cable.png"
SCANS = Path(__file__).parents[1] / "docs" / "first-cable" / "scans"
NEW = ["--units", "mm", "--length", "1 m", "--mass", "200 g", "--convention", "kuka", "--tangent", "x", "--validate", "unseen"]
TITLE = ["--title", "My cable"]
WIRE = "white"
GUESS = 1e-3  # N m^2: the order of magnitude that a guess from thickness and feel may give, ten times too stiff
MEASURED = {"color": "#888888", "ls": "", "marker": "o", "ms": 3.5, "label": "measured", "zorder": 0}
BEFORE = {"color": "#2a5ca8", "ls": "--", "lw": 1.6, "label": f"before: guessed EI = {GUESS:g} N m²"}
AFTER = {"color": "#c1272d", "lw": 1.6, "label": "after: fit of the four poses"}


def first_lines() -> list[str]:
    """The output of the tutorial's first fit up to the errors of its poses, without its run time."""
    from typer.testing import CliRunner  # noqa: PLC0415

    from scan2flex_jax import fit, load_study  # noqa: PLC0415
    from scan2flex_jax.cli.app import app  # noqa: PLC0415

    with tempfile.TemporaryDirectory() as folder:
        scans = Path(shutil.copytree(SCANS, Path(folder) / "scans"))
        made = CliRunner().invoke(app, ["new", str(scans), *NEW, *TITLE, "--clamps", str(scans / "clamps.csv")])
        if made.exit_code:
            sys.exit(f"the tutorial's study was not made: {made.exception or made.output}")
        return opening(fit(load_study(scans)).summary())


def opening(summary: str) -> list[str]:
    """The lines of a fit up to its second empty line, without the time in the first."""
    head, *lines = summary.splitlines()
    empty = [i for i, line in enumerate(lines) if not line.strip()]
    return [re.sub(r", [0-9.]+ s$", "", head), *lines[: empty[1]]]


def wire(paths) -> dict:
    """Error over the length of each pose: with a guessed EI (N m^2), fitted, and predicted from the other three."""
    from scan2flex_jax.prediction import predict  # noqa: PLC0415

    whole = kinect_wires.study_of(WIRE, paths)
    guessed = {"bending_stiffness": GUESS, "torsional_stiffness": GUESS}
    before = predict(replace(whole, unknowns=(), cable={**whole.cable, **guessed}))
    found, poses, panels = kinect_wires.fitted(whole), {}, []
    for path in paths:
        pose = found.poses[path.stem]
        first = replace(pose, modelled=before[path.stem].points)
        unseen = kinect_wires.fitted(kinect_wires.study_of(WIRE, paths, unseen=path)).poses[path.stem]
        errors = {n: kinect_wires.node_error(p) for n, p in (("before", first), ("fitted", pose), ("left out", unseen))}
        poses[path.stem] = errors
        panels.append((path.stem, pose.measured, first.modelled, pose.modelled, errors))
    draw(panels)
    return {"wire": WIRE, "guess": GUESS, "bending_stiffness": found.estimates["bending_stiffness"].value, "poses": poses}


def draw(panels) -> None:
    """One panel a pose, as the camera saw it: measured, with the guess, and fitted."""
    import matplotlib as mpl  # noqa: PLC0415

    mpl.use("Agg")
    import matplotlib.pyplot as plt  # noqa: PLC0415

    from scan2flex_jax.plot import save  # noqa: PLC0415

    figure, axes = plt.subplots(2, 2, figsize=(8.2, 5.4), layout="constrained")
    for ax, (name, measured, before, after, errors) in zip(axes.flat, panels, strict=True):
        for points, style in ((before, BEFORE), (after, AFTER), (measured, MEASURED)):
            ax.plot(100 * points[:, 0], -100 * points[:, 1], **style)
        said = (f"{100 * error:.1f} % {when}" for when, error in errors.items())
        ax.set_title(f"{name}: off by {', '.join(said)}", fontsize=9)
        ax.set_aspect("equal", adjustable="datalim")
        ax.set(xlabel="across (cm)", ylabel="up (cm)")
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    save(figure, PICTURE, dpi=110)


def main() -> None:
    from scan2flex_jax.cli.setup import prepare_jax  # noqa: PLC0415

    folder = Path(os.environ.get("SCAN2FLEX_DATA", "")) / "wires-kinect"
    prepare_jax()
    if folder.is_dir():
        drawn = wire(sorted(folder.glob(f"{WIRE}*.csv")))
    else:
        sys.stderr.write("the picture stays as it is: SCAN2FLEX_DATA names no folder with wires-kinect\n")
        drawn = committed("front_page")["results"]["wire"]
    results = {"lines": first_lines(), "wire": drawn}
    record("front_page", results)
    sys.stdout.write("\n".join(results["lines"]) + f"\n{results['wire']}\n")


if __name__ == "__main__":
    main()
