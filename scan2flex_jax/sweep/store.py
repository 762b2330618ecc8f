"""A sweep on disk: a zarr store that is written block by block, with checksums by zarr's own codec.

The status ``code`` of a block is written last: a block without it was not computed. zarr replaces files in one step, so a kill
loses only the current block. An attribute of the group holds what the sweep is recognised by.
"""

import hashlib
import inspect
import sys
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.statics.verdict import SOLVED
from scan2flex_jax.study.model import Study
from scan2flex_jax.sweep.samples import Region, extra, regions
from scan2flex_jax.sweep.task import NOT_RUN, STATUS, Task, empty
from scan2flex_jax.version import __version__

if TYPE_CHECKING:
    import xarray

_KEY = "scan2flex_sweep"
_NUMBERS = (bool, int, float, complex, str, tuple, np.ndarray, Study)  # of a function's surroundings


class Store:
    """The zarr group of a sweep, with arrays in blocks of samples."""

    def __init__(self, place: str | Path, group: Any):
        """An existing one."""
        self.place, self.group = place, group
        self.block = tuple(group.attrs[_KEY]["block"])

    def load(self) -> tuple["xarray.Dataset", list[str]]:
        """The samples with the finished blocks, all else as not run; and a sentence for each damaged block."""
        with _said(self.place):
            return self._load()

    def _load(self):
        stored = extra("xarray").open_zarr(self.place, consolidated=False, chunks=None)
        found, damaged, code = stored.coords.to_dataset().load(), [], stored["code"]
        found.attrs.clear()
        for name, x in stored.items():
            found[name] = (x.dims, np.full(x.shape, empty(name), object if name == "verdict" else x.dtype), x.attrs)
        for region in regions(code.shape, self.block):
            try:
                rows = {name: x.values for name, x in stored.isel(dict(zip(code.dims, region, strict=True))).items()}
                solved = rows["code"] == SOLVED
                lost = any(np.any(np.isnan(x[solved])) for name, x in rows.items() if name not in STATUS)
                fault = "a file is not there" if lost else ""  # which reads as NaN
            except Exception as error:  # of the codecs, far from the cause
                fault = "its checksum differs" if "checksum" in str(error) else _line(error)
            if fault:
                place = [s.start // k for s, k in zip(region, self.block, strict=True)]
                damaged.append(f"{self.place}: chunk {place} is damaged ({fault})")
            elif not np.any(rows["code"] == NOT_RUN):
                for name, x in rows.items():
                    found[name].values[region] = x
        return found, damaged

    def keep(self, found: "xarray.Dataset", region: Region) -> None:
        """Write a block of samples, its ``code`` last."""
        with _said(self.place):
            for name in sorted(map(str, found.data_vars), key="code".__eq__):
                self.array(found[name])[region] = found[name].values[region]

    def array(self, x: "xarray.DataArray") -> Any:
        """The stored array of a variable; a new one if it is not there."""
        name, codecs = str(x.name), extra("zarr.codecs")
        if name in self.group:
            return self.group[name]
        return self.group.create_array(
            name,
            shape=x.shape,
            dtype=str if name == "verdict" else x.dtype,
            chunks=x.shape if name in x.coords else (*self.block, *x.shape[len(self.block) :]),
            compressors=(codecs.ZstdCodec(), codecs.Crc32cCodec()),
            fill_value=empty(name),
            dimension_names=x.dims,
            attributes=x.attrs,
        )


def opened(place: str | Path, task: Task, blank: "xarray.Dataset", block: tuple[int, ...]) -> Store:
    """The store of this sweep at ``place``: a new one in blocks of this shape, or the existing one if it is the same sweep."""
    identity = _identity(task, blank)
    store = begun(place)
    if store is None:
        there = sorted(path.name for path in Path(place).iterdir()) if Path(place).is_dir() else []
        if there:
            raise Scan2FlexError(f"{place} holds {there[0]} and no sweep: choose an empty folder")
        about = {_KEY: {**identity, "block": list(block)}, "coordinates": " ".join(map(str, blank.coords))}
        with _said(place):
            store = Store(place, extra("zarr").create_group(place, attributes=about))
    before = store.group.attrs[_KEY]
    names = sorted({*before, *identity} - {"block"})
    if other := [name for name in names if before.get(name) != identity.get(name)]:
        raise Scan2FlexError(f"{place} holds another sweep (not the same {', '.join(other)}): choose another folder")
    with _said(place):
        for x in blank.coords.values():
            store.array(x)[...] = x.values
        for x in blank.values():
            store.array(x)
    return store


def begun(place: str | Path) -> Store | None:
    """The store of a sweep that was begun; None where there is nothing of zarr."""
    zarr = extra("zarr")
    if Path(place).is_file():
        raise Scan2FlexError(f"{place} is a file: a sweep is kept in a folder")
    with _said(place):
        try:
            group = zarr.open_group(place, mode="r+")
        except FileNotFoundError:
            return None
        if _KEY not in group.attrs:
            raise Scan2FlexError(f"{place} holds other data and no sweep: choose an empty folder")
        return Store(place, group)


@contextmanager
def _said(place):
    """One sentence for what zarr and xarray raise of damaged files and full disks, far from the cause."""
    try:
        yield
    except Scan2FlexError:
        raise
    except Exception as error:
        raise Scan2FlexError(f"{place}: cannot be read or written as a sweep ({_line(error)})") from error


def _line(error):
    return " ".join(f"{type(error).__name__} {error}".split())[:120]


def _identity(task, samples) -> dict[str, str]:
    """What a sweep is recognised by: digests of the samples and of what the task says of itself, and the package's version."""
    inputs = {name: (x.dims, x.values, x.attrs["units"]) for name, x in samples.coords.items()}
    parts = {"samples": inputs, "outputs": task.outputs, **(task.about or {"function": task.function})}
    digests = {name: hashlib.sha256(_text(part).encode()).hexdigest()[:16] for name, part in parts.items()}
    return {"version of scan2flex_jax": __version__, **digests}


def _text(x) -> str:
    """What an object says of itself; a function by its source and the numbers that it takes from its surroundings."""
    if isinstance(x, dict):
        return str({name: _text(value) for name, value in x.items()})
    if isinstance(x, list | tuple):
        return str([_text(value) for value in x])
    if isinstance(x, partial):
        return _text(("partial", x.func, x.args, x.keywords))
    if inspect.isfunction(x):
        around = inspect.getclosurevars(x)
        named = {**around.globals, **around.nonlocals}
        try:
            source = inspect.getsource(x)
        except (OSError, TypeError):  # typed at a prompt
            source = x.__qualname__
        return source + _text({name: value for name, value in sorted(named.items()) if isinstance(value, _NUMBERS)})
    with np.printoptions(threshold=sys.maxsize, floatmode="unique"):
        return repr(x).replace(str(x.folder), "") if isinstance(x, Study) and x.folder else repr(x)
