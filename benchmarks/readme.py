"""The first screen of the README: what `scan2flex demo` finds, and the first lines of a fit.

`python -m benchmarks.readme [rod] [find] [lines]`. Rod (`docs/rod.png`): the stiffness along a bamboo rod from how it droops,
beside calipers. Find (`docs/find.png`): measured and modelled shapes of the simulated cable with a sleeve that its study does
not mention. Lines: the opening of the first fit of docs/first-cable.md, without the time. The picture of a real
wire is made by `benchmarks.kinect_wires`.
"""

import re
import shutil
import sys
import tempfile
import tomllib
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from typer.testing import CliRunner

from benchmarks.record import record, recorded
from scan2flex_jax import explain, fit, load_study, plot
from scan2flex_jax.cli.app import app
from scan2flex_jax.cli.demo import PLACES, calipers
from scan2flex_jax.cli.setup import prepare_jax
from scan2flex_jax.examples import example_path

DOCS = Path(__file__).parents[1] / "docs"
NEW = ["--units", "mm", "--length", "1 m", "--mass", "200 g", "--convention", "kuka", "--tangent", "x", "--validate", "unseen"]
SHOWN = ("p3", "p5", "p7")  # poses of the find, the last one never fitted


def find() -> dict:
    """Error (m) before and after, and the estimates beside the true values."""
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


def rod() -> dict:
    """Error (m) before and after, what was found, and EI (N m^2) with its band beside that of the calipers."""
    folder = example_path("bamboo-rod")
    e, (s, EI) = explain(load_study(folder)), calipers(folder)
    plot.save(plot.varied(e, {"calipers": (s[s >= 0], EI[s >= 0])}), DOCS / "rod.png", dpi=110)
    true, (found, low, high) = np.exp(np.interp(PLACES, s, np.log(EI))), e.along.at(np.array(PLACES))
    return {
        "verdict": e.verdict,
        "found": [list(h.names) for h in (e.decision.best, *e.decision.tied)],
        "unseen": [e.rms("validate", after=False), e.rms("validate")],
        "at": list(PLACES), "EI": found.tolist(), "low": low.tolist(), "high": high.tolist(), "calipers": true.tolist(),
    }  # fmt: skip


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


def main() -> None:
    prepare_jax()
    mpl.use("Agg")
    parts = {"rod": rod, "find": find, "lines": first_lines}
    wanted = sys.argv[1:] or list(parts)
    record("readme", recorded("readme") | {name: parts[name]() for name in wanted})


if __name__ == "__main__":
    main()
