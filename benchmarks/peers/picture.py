"""The work-precision picture: error over processor seconds, one panel for each problem."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.ticker import NullFormatter

from benchmarks.peers.compare import OURS, usable

FILE = Path(__file__).parents[2] / "docs" / "peers.png"
_STYLE = {
    OURS: ("#c1272d", "o"),
    "scan2flex_jax, BFGS": ("#e8939a", "o"),
    "solve_bvp": ("#222222", "s"),
    "PyElastica": ("#2a6fbb", "^"),
    "MuJoCo flex": ("#d08c00", "<"),
}


def draw(rows, file=FILE) -> None:
    """Each run is a point; a line joins the runs of one peer from coarse to fine."""
    good = usable(rows)
    problems = list(dict.fromkeys(r["problem"] for r in good))
    size = (4.6 * len(problems), 4.4)
    figure, axes = plt.subplots(1, len(problems), figsize=size, sharex=True, sharey=True, layout="constrained", squeeze=False)
    axes = axes[0]
    for ax, problem in zip(axes, problems, strict=True):
        for peer, (colour, marker) in _STYLE.items():
            own = [r for r in good if r["peer"] == peer and r["problem"] == problem]
            best = [min((r for r in own if r["size"] == n), key=_worth) for n in dict.fromkeys(r["size"] for r in own)]
            if best:
                x, y = [r["seconds"] for r in best], [r["error"] for r in best]
                ax.plot(x, y, color=colour, marker=marker, ms=5, lw=1.3 if peer != OURS else 2.2, label=peer)
        ax.set(xscale="log", yscale="log", title=problem, xlabel="processor time (s)")
        ax.xaxis.set_minor_formatter(NullFormatter())
        ax.grid(True, which="major", color="#dddddd", lw=0.6)
    axes[0].set_ylabel("largest node error / length")
    handles = {label: line for ax in axes for line, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=5, frameon=False, fontsize=9)
    figure.savefig(file, dpi=140)
    plt.close(figure)


def _worth(row):
    """Of the tolerances of rest, the first whose error is within a tenth of the last one's would do: error, then time."""
    return round(row["error"], 4 if row["error"] > 1e-3 else 12), row["seconds"]
