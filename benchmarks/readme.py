"""The first screen of the README: the first lines of a fit, and a real wire before and after.

    SCAN2FLEX_DATA=... python -m benchmarks.readme

Lines: the opening of the first fit of docs/first-cable.md, without the time. Picture (`docs/real-cable.png`): a wire on four
depth images (`benchmarks.kinect_wires`) with a guessed stiffness and fitted; its titles include the error of each pose
predicted from the other three.
"""

import re
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
from typer.testing import CliRunner

from benchmarks.kinect_wires import fitted, node_error, study_of, wires_folder
from benchmarks.record import record
from scan2flex_jax import fit, load_study, plot
from scan2flex_jax.cli.app import app
from scan2flex_jax.cli.setup import prepare_jax
from scan2flex_jax.prediction import predict

DOCS = Path(__file__).parents[1] / "docs"
NEW = ["--units", "mm", "--length", "1 m", "--mass", "200 g", "--convention", "kuka", "--tangent", "x", "--validate", "unseen"]
WIRE = "white"
GUESS = 1e-3  # N m^2: the order of magnitude that a guess from thickness and feel may give, ten times too stiff
MEASURED = {"color": "#888888", "ls": "", "marker": "o", "ms": 3.5, "label": "measured", "zorder": 0}
BEFORE = {"color": "#2a5ca8", "ls": "--", "lw": 1.6, "label": f"before: guessed EI = {GUESS:g} N m²"}
AFTER = {"color": "#c1272d", "lw": 1.6, "label": "after: fit of the four poses"}


def first_lines() -> list[str]:
    """The output of the tutorial's first fit up to the errors of its poses."""
    with tempfile.TemporaryDirectory() as folder:
        scans = Path(shutil.copytree(DOCS / "first-cable" / "scans", Path(folder) / "scans"))
        words = ["new", str(scans), *NEW, "--title", "My cable", "--clamps", str(scans / "clamps.csv")]
        CliRunner().invoke(app, words, catch_exceptions=False)
        return opening(fit(load_study(scans)).summary())


def opening(summary: str) -> list[str]:
    """The lines of a fit up to its second empty line, without the time in the first."""
    head, *lines = summary.splitlines()
    empty = [i for i, line in enumerate(lines) if not line.strip()]
    return [re.sub(r", [0-9.]+ s$", "", head), *lines[: empty[1]]]


def wire(paths) -> dict:
    """Error over the length of each pose: with a guessed EI (N m^2), fitted, and predicted from the other three."""
    whole = study_of(WIRE, paths)
    guessed = {"bending_stiffness": GUESS, "torsional_stiffness": GUESS}
    before, found = predict(replace(whole, unknowns=(), cable={**whole.cable, **guessed})), fitted(whole)
    figure, axes = plt.subplots(2, 2, figsize=(8.2, 5.4), layout="constrained")
    poses = {}
    for ax, path in zip(axes.flat, paths, strict=True):
        after = found.poses[path.stem]
        first = replace(after, modelled=before[path.stem].points)
        unseen = fitted(study_of(WIRE, paths, unseen=path)).poses[path.stem]
        errors = {n: node_error(p) for n, p in (("before", first), ("fitted", after), ("left out", unseen))}
        for points, style in ((first.modelled, BEFORE), (after.modelled, AFTER), (after.measured, MEASURED)):
            ax.plot(100 * points[:, 0], -100 * points[:, 1], **style)
        ax.set_title(f"{path.stem}: off by {', '.join(f'{100 * e:.1f} % {n}' for n, e in errors.items())}", fontsize=9)
        ax.set_aspect("equal", adjustable="datalim")
        ax.set(xlabel="across (cm)", ylabel="up (cm)")
        poses[path.stem] = errors
    figure.legend(*axes.flat[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    plot.save(figure, DOCS / "real-cable.png", dpi=110)
    return {"wire": WIRE, "guess": GUESS, "bending_stiffness": found.estimates["bending_stiffness"].value, "poses": poses}


def main() -> None:
    prepare_jax()
    mpl.use("Agg")
    record("readme", {"lines": first_lines(), "wire": wire(sorted(wires_folder().glob(f"{WIRE}*.csv")))})


if __name__ == "__main__":
    main()
