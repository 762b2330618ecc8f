"""The result of a sweep as an xarray dataset: labelled dimensions, units on everything, the status of every sample.

Samples that failed or were not run yet are NaN, with the reason in `code` and `verdict`.
"""

from typing import Any

import numpy as np

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.sweep.lanes import Lanes
from scan2flex_jax.sweep.task import NOT_RUN, SENTENCES, VERDICT, Batch, Output, joined

_AXES = {"axis": ["x", "y", "z"], "end": ["start", "end"]}
_EMPTY = {"code": NOT_RUN, "verdict": SENTENCES[NOT_RUN], "stable": False, "steps": 0, "out_of_balance": np.nan, "seconds": 0.0}


def xarray():
    """The library, or one sentence on its installation."""
    try:
        import xarray as library  # noqa: PLC0415  (an extra: only sweeps need it)
    except ImportError as error:
        raise Scan2FlexError("a sweep needs xarray: install it with pip install 'scan2flex_jax[sweep]'") from error
    return library


def skeleton(lanes: Lanes):
    """The dataset of the inputs alone."""
    xr = xarray()
    dims, sizes = tuple(lanes.dims), tuple(lanes.dims.values())
    coords: dict[str, tuple] = {d: (d, np.arange(n)) for d, n in lanes.dims.items() if d not in lanes.coordinates}
    coords |= {d: (d, a.values, {"units": a.unit}) for d, a in lanes.coordinates.items()}
    for name, axis in lanes.inputs.items():
        if name not in lanes.coordinates:
            own = tuple(f"{name}_{k}" for k in range(axis.values.ndim - 1))
            coords[name] = ((*dims, *own), axis.values.reshape(*sizes, *axis.values.shape[1:]), {"units": axis.unit})
    return xr.Dataset(coords=coords, attrs={"dims": " ".join(dims)})


def filled(bare, outputs: dict[str, Output], parts: list[tuple[np.ndarray, Batch]]):
    """``bare`` filled with finished samples: ``parts`` are their indices in the order of the samples, and the batches."""
    xr = xarray()
    dims = bare.attrs["dims"].split()
    sizes = tuple(bare.sizes[d] for d in dims)
    count = int(np.prod(sizes))
    places = np.concatenate([np.asarray(p, int) for p, _ in parts]) if parts else np.zeros(0, int)
    whole = joined([batch for _, batch in parts]) if parts else Batch({}, {})
    found = xr.Dataset(attrs={k: v for k, v in bare.attrs.items() if k != "dims"}).assign_coords(bare.coords)
    found.attrs["lane_dims"] = " ".join(dims)
    for name, output in outputs.items():
        if name in whole.values:
            x = np.full((count, *whole.values[name].shape[1:]), np.nan)
            x[places] = whole.values[name]
            own = output.dims
        elif not output.dims:
            x, own = np.full(count, np.nan), ()
        else:
            continue  # no sample has set its shape
        _check_name(found, name)
        about = {"units": output.unit} | ({"long_name": output.label} if output.label else {})
        found[name] = ((*dims, *own), x.reshape(*sizes, *x.shape[1:]), about)
    for name, (unit, label) in VERDICT.items():
        x = np.full(count, _EMPTY[name], dtype=object if name == "verdict" else None)
        x = x.astype(whole.verdicts[name].dtype) if name in whole.verdicts and name != "verdict" else x
        x[places] = whole.verdicts.get(name, [])
        x = x.astype(str) if name == "verdict" else x
        found[name] = (tuple(dims), x.reshape(sizes), {"units": unit, "long_name": label})
    return found.assign_coords({d: names for d, names in _AXES.items() if found.sizes.get(d) == len(names)})


def _check_name(found, name):
    if name in found.variables or name in VERDICT:
        raise Scan2FlexError(f"{name!r} is an output of the sweep and an input, or a part of the verdict: rename one")


def failed(found: Any) -> dict[str, str]:
    """Every sample that is not solved, by name, with its status in words."""
    dims = found.attrs["lane_dims"].split()
    codes, words = found["code"].transpose(*dims).values, found["verdict"].transpose(*dims).values
    out = {}
    for place in np.argwhere(codes != 0):
        at = zip(dims, place, strict=True)
        out[", ".join(f"{d}={found[d].values[k]:g}" for d, k in at)] = str(words[tuple(place)])
    return out
