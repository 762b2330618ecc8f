"""Colours, legends and names that all plots share, and the writing of a figure."""

import io
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.names import drawn
from scan2flex_jax.study.outputs import write_file

if TYPE_CHECKING:  # for annotations only: drawing needs no import of these types
    from scan2flex_jax.inference import Explanation, Fit

MEASURED, BAND, MODELLED, BEFORE = "#555d66", "#dddddd", "#c1272d", "#e9a13b"
PALE: dict[str, Any] = {"lw": 4.0, "alpha": 0.55, "solid_capstyle": "round"}  # before, under a thin line of after
BROADEST = 7.0  # points: a line where the cable is stiffest
COLUMNS = 3  # of panels in a figure, and of a legend
_ROW, _HANDLE, _LONGEST = 64, 6, 28  # characters of a row of a legend, of a line in it, and of the name of a pose


def chosen(fit: "Fit | Explanation", pose: str | None) -> list[str]:
    """The names of one pose or of all; raises `Scan2FlexError`."""
    if pose is not None and pose not in fit.poses:
        raise Scan2FlexError(f"no pose is called {pose!r}: the poses are {', '.join(fit.poses)}")
    return list(fit.poses) if pose is None else [pose]


def legend(ax: Axes) -> int:
    """A legend above the axes, off the data, in as many columns as fit; its number of rows, 0 without labels."""
    labels = ax.get_legend_handles_labels()[1]
    if not labels:
        return 0
    columns = int(np.clip(_ROW // (max(map(len, labels)) + _HANDLE), 1, COLUMNS))
    ax.legend(frameon=False, fontsize=8, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2, ncols=columns)
    return -(-len(labels) // columns)


def named(name: str, words: str = "") -> str:
    """A pose name with words appended, shortened to the width of a panel."""
    return drawn((name if len(name) <= _LONGEST else f"{name[:_LONGEST]}...") + words)


def spaced(kind: str) -> str:
    """The name of an effect type in words."""
    return kind.replace("_", " ")


def save(figure: Figure, file: str | Path, dpi: float = 150, write: Callable[[Path, bytes], object] = write_file) -> None:
    """Write a figure in one step, in the format of the file's extension: a reader sees the old file or the new one, complete.

    A study's own files are refused. ``write(path, bytes)`` writes the picture.
    """
    path, picture = Path(file), io.BytesIO()
    kinds = figure.canvas.get_supported_filetypes()
    kind = path.suffix.lstrip(".").lower() or "png"
    if kind not in kinds:
        raise Scan2FlexError(f"{path.name} is not a picture: name a file that ends in .png, .svg or .pdf")
    figure.savefig(picture, format=kind, dpi=dpi)
    write(path if path.suffix else path.with_suffix(".png"), picture.getvalue())
