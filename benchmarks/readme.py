"""The first screen of the README: the find of `scan2flex demo`, the first lines of a fit, and a real wire before and after.

    SCAN2FLEX_DATA=... python -m benchmarks.readme

Find (`docs/find.png`): measured and modelled shapes of the simulated cable with a sleeve that its study does not mention.
Lines: the opening of the first fit of docs/first-cable.md, without the time. Picture (`docs/real-cable.png`): a wire on four
depth images (`benchmarks.kinect_wires`) with a guessed stiffness and fitted; its titles include the error of each pose
predicted from the other three.
"""

import re
import shutil
import tempfile
import tomllib
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
from typer.testing import CliRunner

from benchmarks.kinect_wires import fitted, node_error, study_of, wires_folder
from benchmarks.record import record
from scan2flex_jax import explain, fit, load_study, plot
from scan2flex_jax.cli.app import app
from scan2flex_jax.cli.setup import prepare_jax
from scan2flex_jax.examples import example_path
from scan2flex_jax.prediction import predict

DOCS = Path(__file__).parents[1] / "docs"
NEW = ["--units", "mm", "--length", "1 m", "--mass", "200 g", "--convention", "kuka", "--tangent", "x", "--validate", "unseen"]
SHOWN = ("p3", "p5", "p7")  # poses of the find, the last one never fitted
WIRE = "white"
GUESS = 1e-3  # N m^2: the order of magnitude that a guess from thickness and feel may give, ten times too stiff
MEASURED = {"color": "#888888", "ls": "", "marker": "o", "ms": 3.5, "label": "measured", "zorder": 0}
BEFORE = {"color": "#2a5ca8", "ls": "--", "lw": 1.6, "label": f"before: guessed EI = {GUESS:g} N m²"}
AFTER = {"color": "#c1272d", "lw": 1.6, "label": "after: fit of the four poses"}


def find() -> dict:
    """Error (m) before and after, and the values found beside the true ones."""
    folder = example_path("hidden-sleeve")
    e, truth = explain(load_study(folder)), tomllib.loads((folder / "truth.toml").read_text())
    figure, axes = plt.subplots(1, len(SHOWN), figsize=(11, 3.6), layout="constrained")
    for ax, name in zip(axes, SHOWN, strict=True):
        plot.shapes(e, name, ax)
        p = e.poses[name]
        kind = "never fitted" if p.role == "validate" else "fitted"
        ax.set_title(f"{name}, {kind}: {1e3 * p.rms_before:.1f} mm, then {1e3 * p.rms:.1f} mm", fontsize=10, pad=22)
    plot.save(figure, DOCS / "find.png", dpi=110)
    effect, GJ = e.chosen[0], e.estimates["torsional_stiffness"].value
    return {
        "kind": effect.kind,
        "length": e.study.cable["length"],
        "position": [effect.parameters["position"], effect.std["position"], truth["effect"]["position"]],
        "fitted": [e.rms(after=False), e.rms()],
        "unseen": [e.rms("validate", after=False), e.rms("validate")],
        "GJ": [x / truth["cable"]["torsional_stiffness"] - 1 for x in (e.fit.estimates["torsional_stiffness"].value, GJ)],
    }


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
    paths = sorted(wires_folder().glob(f"{WIRE}*.csv"))
    record("readme", {"find": find(), "lines": first_lines(), "wire": wire(paths)})


if __name__ == "__main__":
    main()
