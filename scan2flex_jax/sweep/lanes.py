"""The samples ("lanes") of a sweep: the varied inputs, over labelled axes, with units.

A sample is a dictionary from the name of each input to its value. `grid` makes every combination of its axes, one
dimension each; `draws` takes row ``i`` of every column as sample ``i``, along a single dimension.
"""

from dataclasses import dataclass, field
from math import prod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from scan2flex_jax.errors import Scan2FlexError


@dataclass(frozen=True, init=False)
class Axis:
    """Values of one input and their unit; rows of any shape in `draws`, plain numbers in `grid`."""

    values: np.ndarray
    unit: str

    def __init__(self, values: ArrayLike, unit: str = "-"):
        """A read-only float64 copy."""
        try:
            copy = np.array(values, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise Scan2FlexError(f"the values of an axis must be numbers ({error})") from error
        copy.flags.writeable = False
        object.__setattr__(self, "values", copy)
        object.__setattr__(self, "unit", unit)


@dataclass(frozen=True)
class Lanes:
    """Samples in the order of ``dims`` (last fastest): each input has one value, or row of values, per sample."""

    dims: dict[str, int]
    inputs: dict[str, Axis]
    coordinates: dict[str, Axis] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Number of samples."""
        return prod(self.dims.values())

    def take(self, which: int | slice | np.ndarray) -> dict[str, np.ndarray]:
        """The inputs of a subset of samples, stacked."""
        return {name: axis.values[which] for name, axis in self.inputs.items()}

    def name(self, i: int) -> str:
        """Name of a sample: ``bending_stiffness=0.1, torsional_stiffness=10`` or ``draw=17``."""
        places = np.unravel_index(i, tuple(self.dims.values()))
        at = zip(self.dims, places, strict=True)
        return ", ".join(f"{d}={self.coordinates[d].values[k]:g}" if d in self.coordinates else f"{d}={k}" for d, k in at)


def grid(**axes: Any) -> Lanes:
    """Every combination of the axes' values: ``grid(length=Axis([0.9, 1.0], "m"), density=Axis([0.2, 0.3], "kg/m"))``."""
    for name, axis in axes.items():
        _check(name, axis)
        if axis.values.ndim != 1:
            raise Scan2FlexError(f"axis {name!r} of a grid has shape {axis.values.shape}: give plain numbers, or use draws")
    if not axes:
        raise Scan2FlexError("a grid needs an axis: give at least one")
    mesh = np.meshgrid(*(a.values for a in axes.values()), indexing="ij")
    inputs = {name: Axis(m.ravel(), a.unit) for (name, a), m in zip(axes.items(), mesh, strict=True)}
    return Lanes({name: len(a.values) for name, a in axes.items()}, inputs, dict(axes))


def draws(dim: str = "draw", **columns: Any) -> Lanes:
    """Sample ``i`` has row ``i`` of every column: ``draws(tilt=Axis(rng.normal(size=(1000, 2, 3)), "rad"))``."""
    for name, axis in columns.items():
        _check(name, axis)
    counts = {len(axis.values) for axis in columns.values()}
    if len(counts) != 1:
        raise Scan2FlexError(f"the columns of draws have {sorted(counts)} rows: give at least one, all of one length")
    if dim in columns:
        raise Scan2FlexError(f"{dim!r} names both the dimension and a column: give the dimension another name")
    return Lanes({dim: counts.pop()}, dict(columns))


def _check(name, axis):
    if not isinstance(axis, Axis):
        raise Scan2FlexError(f"{name!r} is a {type(axis).__name__}: give an Axis with values and unit")
    if axis.values.ndim < 1 or not axis.values.size:
        raise Scan2FlexError(f"axis {name!r} has no values: give at least one")
    if not np.all(np.isfinite(axis.values)):
        raise Scan2FlexError(f"axis {name!r} has values that are not finite: leave them out")
