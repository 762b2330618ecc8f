"""The samples of a sweep: an xarray dataset whose coordinates are the inputs, with their units.

A coordinate's first dimension is one of the sweep's; further dimensions belong to the input itself. So the inputs of `grid`,
each with a dimension of its own, are combined, and those of `draws` share one. Datasets merge, and are selected from, as usual:
``xarray.merge([grid(...), draws(...)])`` combines every point of the grid with every draw.
"""

from importlib import import_module
from itertools import product
from math import ceil, prod
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from scan2flex_jax.errors import Scan2FlexError

if TYPE_CHECKING:
    import xarray

Region = tuple[slice, ...]
"""A block of samples: one slice for each dimension of the sweep."""


def extra(library: str) -> Any:
    """A library of the extra ``sweep``, or one sentence on its installation."""
    try:
        return import_module(library)
    except ImportError as error:
        raise Scan2FlexError(f"this sweep needs {library}: install it with pip install 'scan2flex_jax[sweep]'") from error


def grid(**axes: ArrayLike | tuple[ArrayLike, str]) -> "xarray.Dataset":
    """Every combination of values: ``grid(length=([0.9, 1.0], "m"), friction=[0.1, 0.2])``; the unit may be left out."""
    coordinates = {}
    for name, given in axes.items():
        values, unit = _values(name, given)
        if values.ndim != 1:
            raise Scan2FlexError(f"{name!r} of a grid has shape {values.shape}: give plain numbers, or use draws")
        coordinates[name] = (name, values, {"units": unit})
    return extra("xarray").Dataset(coords=coordinates)


def draws(dim: str = "draw", **columns: ArrayLike | tuple[ArrayLike, str]) -> "xarray.Dataset":
    """Sample ``i`` has row ``i`` of every column, of any shape: ``draws(tilt=(rng.normal(size=(1000, 2, 3)), "rad"))``."""
    if dim in columns:
        raise Scan2FlexError(f"{dim!r} names both the dimension and a column: give the dimension another name")
    coordinates, counts = {}, set()
    for name, given in columns.items():
        values, unit = _values(name, given)
        counts.add(len(values))
        coordinates[name] = ((dim, *(f"{name}_{k}" for k in range(values.ndim - 1))), values, {"units": unit})
    if len(counts) > 1:
        raise Scan2FlexError(f"the columns of draws have {sorted(counts)} rows: give all of one length")
    return extra("xarray").Dataset(coords=coordinates)


def _values(name, given):
    values, unit = given if isinstance(given, tuple) and len(given) == 2 and isinstance(given[1], str) else (given, "-")
    return np.atleast_1d(_numbers(name, values)), unit


def _numbers(name, values):
    try:
        values = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise Scan2FlexError(f"the values of {name!r} must be numbers ({error})") from error
    if not values.size:
        raise Scan2FlexError(f"{name!r} has no values: give at least one")
    if not np.all(np.isfinite(values)):
        raise Scan2FlexError(f"{name!r} has values that are not finite: leave them out")
    return values


def checked(samples: Any) -> "xarray.Dataset":
    """The samples with all inputs as float64 coordinates with a unit."""
    xr = extra("xarray")
    if not isinstance(samples, xr.Dataset):
        raise Scan2FlexError(f"the samples are a {type(samples).__name__}: make them by grid(...) or draws(...)")
    given = samples.variables.items()
    if not samples.sizes:
        raise Scan2FlexError("the samples have no dimension: give at least one input with values along one")
    return xr.Dataset(coords={name: (x.dims, _numbers(name, x.values), {"units": "-", **x.attrs}) for name, x in given})


def sizes_of(samples: "xarray.Dataset") -> dict[str, int]:
    """The dimensions of the sweep: the first one of every input."""
    return {str(x.dims[0]): len(x) for x in samples.coords.values() if x.dims}


def inputs(samples: "xarray.Dataset", region: Region) -> dict[str, np.ndarray]:
    """The inputs of a block of samples, one row each, the last dimension fastest."""
    places = np.meshgrid(*(np.arange(s.start, s.stop) for s in region), indexing="ij")
    place = dict(zip(sizes_of(samples), (p.ravel() for p in places), strict=True))
    count = prod(s.stop - s.start for s in region)
    return {
        str(name): x.values[place[x.dims[0]]] if x.dims else np.full(count, x.values) for name, x in samples.coords.items()
    }


def block(sizes: tuple[int, ...], most: int) -> tuple[int, ...]:
    """The shape of a block of at most ``most`` samples: whole dimensions from the last on, as equal as can be."""
    shape: tuple[int, ...] = ()
    for n in reversed(sizes):
        room = max(most // prod(shape), 1)
        shape = (ceil(n / ceil(n / room)), *shape)
    return shape


def regions(sizes: tuple[int, ...], shape: tuple[int, ...]) -> list[Region]:
    """The blocks of this shape that make up the whole; those at the end may be smaller."""
    parts = [[slice(i, min(i + k, n)) for i in range(0, n, k)] for n, k in zip(sizes, shape, strict=True)]
    return list(product(*parts))
