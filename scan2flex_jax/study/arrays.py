"""Conversion of points and arc lengths, as arrays of any library, to checked float64 arrays."""

from typing import Annotated, Any

import numpy as np

from scan2flex_jax.study.values import LARGEST, Where, as_array, shown


def measured_columns(value: Any, where: Where) -> tuple[Annotated[np.ndarray, "n 3"], Annotated[np.ndarray, "3"]]:
    """`points` of which some coordinates were not measured, NaN in all of them, and the mask of those that were."""
    table = np.array(value, float) if np.ndim(value) == 2 and np.shape(value)[-1] == 3 else np.zeros((1, 3))
    seen = ~np.all(np.isnan(table), axis=0)
    if np.all(seen) or not np.any(seen):
        return points(value, 1, where), seen
    table[:, ~seen] = np.arange(len(table))[:, None]  # neighbours may share the coordinate that was measured
    table = points(table, 1, where).copy()
    table[:, ~seen] = np.nan
    return table, seen


def points(value: Any, fewest: int, where: Where) -> Annotated[np.ndarray, "n 3"]:
    """At least `fewest` points, one per row: all finite, and no two neighbours equal."""
    table = _table(value, where, "points in metres, one row [x, y, z] for each: an array of shape (n, 3)")
    if table.ndim != 2 or table.shape[1] != 3:
        turned = table.ndim == 2 and table.shape[0] == 3
        advice = "transpose it, so that each row is a point" if turned else "give one row [x, y, z] for each point"
        raise where.fail(f"got an array of shape {table.shape}: {advice}.")
    if len(table) < fewest:
        raise where.fail(f"got {len(table)} point{'s' * (len(table) != 1)}: give at least {fewest}.")
    bad = np.flatnonzero(~np.all(np.abs(table) <= LARGEST, axis=1))
    if len(bad):
        raise where.fail(f"point {int(bad[0]) + 1} is {shown(table[bad[0]].tolist())}: give finite numbers in metres.")
    same = np.flatnonzero(np.all(table[1:] == table[:-1], axis=1))
    if len(same):
        i = int(same[0])
        raise where.fail(f"points {i + 1} and {i + 2} are the same, {shown(table[i].tolist())}: leave one out.")
    return table


def arc_lengths(value: Any, count: int, where: Where) -> Annotated[np.ndarray, " n"]:
    """The arc lengths (m) of `count` points, strictly increasing."""
    s = _table(value, where, f"one arc length in metres for each point: an array of shape ({count},)")
    if s.shape != (count,):
        raise where.fail(f"got an array of shape {s.shape}: give one arc length for each of the {count} points.")
    if not np.all(np.abs(s) <= LARGEST):
        raise where.fail("an arc length is not finite: give a number in metres for every point.")
    back = np.flatnonzero(np.diff(s) <= 0)
    if len(back):
        i = int(back[0])
        raise where.fail(
            f"s does not grow from point {i + 1} ({s[i]:g} m) to point {i + 2} ({s[i + 1]:g} m): "
            "order the points from start to end."
        )
    return s


def growing(value: Any, count: int, where: Where, unit: str) -> Annotated[np.ndarray, " n"]:
    """`count` finite numbers, strictly increasing."""
    grid = _table(value, where, f"one number in {unit} for each point: an array of shape ({count},)")
    if grid.shape != (count,):
        raise where.fail(f"got an array of shape {grid.shape}: give a plain list of {count} numbers.")
    if not np.all(np.abs(grid) <= LARGEST):
        raise where.fail(f"a number is not finite: give numbers in {unit}.")
    back = np.flatnonzero(np.diff(grid) <= 0)
    if len(back):
        i = int(back[0])
        raise where.fail(f"it does not grow from entry {i + 1} ({grid[i]:g}) to entry {i + 2} ({grid[i + 1]:g}): sort it.")
    return grid


def _table(value: Any, where: Where, wanted: str) -> Annotated[np.ndarray, "..."]:
    """An array of real numbers in float64."""
    try:
        table = as_array(value)
    except (TypeError, ValueError) as error:  # ragged lists, tracers of JAX
        raise where.fail(f"got {shown(value)}: give {wanted}.") from error
    if table.dtype.kind not in "iuf":
        what = shown(value) if table.ndim == 0 else f"an array of {table.dtype}"
        raise where.fail(f"got {what}: give {wanted}.")
    return table.astype(np.float64, copy=False)
