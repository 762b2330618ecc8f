"""Where a sweep is kept while it grows: one file for each chunk of lanes, each put there in one step.

    definition.json    what the sweep is (fingerprints and versions), its outputs, and how lanes are cut into chunks
    lanes.nc           the labelled inputs, and the order in which lanes are taken
    chunk-00017.nc     the lanes of one chunk that is done
    sweep.nc           the whole, once every chunk is there

The files are netCDF 3, which xarray reads and writes without a further library. A process that is killed leaves whole chunks
only, and at most a file of its own whose name begins with a dot, which nobody reads.
"""

import contextlib
import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.study.files import write_atomic
from scan2flex_jax.study.outputs import write_json_atomic
from scan2flex_jax.sweep.labelled import filled, xarray
from scan2flex_jax.sweep.task import VERDICT, Batch, Output

FORMAT = "scan2flex-sweep/1"
_AGAIN = "remove it, and the sweep does its lanes again"
_ANEW = "choose another folder, or remove this one and begin again"
_CHUNK = re.compile(r"chunk-(\d+)\.nc")


class Memory:
    """The same without a folder: chunks live as long as the sweep."""

    def __init__(self, definition: dict, bare, order: np.ndarray):
        """Nothing is done yet."""
        self.outputs = {name: Output(o["unit"], tuple(o["dims"]), o["label"]) for name, o in definition["outputs"].items()}
        self.bare, self.order, self.size = bare, order, definition["chunk"]
        self.kept: dict[int, Batch] = {}

    @property
    def count(self) -> int:
        """Number of chunks."""
        return -(-len(self.order) // self.size)

    def lanes(self, k: int) -> np.ndarray:
        """Places of the lanes of chunk ``k``."""
        return self.order[k * self.size : (k + 1) * self.size]

    def done(self) -> set[int]:
        """Chunks that are there."""
        return set(self.kept)

    def put(self, k: int, batch: Batch) -> None:
        """Keep a chunk."""
        self.kept[k] = batch

    def get(self, k: int) -> Batch:
        """A chunk that is there."""
        return self.kept[k]

    def dataset(self):
        """What there is, as a dataset."""
        return filled(self.bare, self.outputs, [(self.lanes(k), self.get(k)) for k in sorted(self.done())])

    def finish(self, found) -> None:
        """Nothing to write."""


class Store(Memory):
    """Chunks in a folder that several processes and hosts may share."""

    def __init__(self, folder: Path, definition: dict, bare, order: np.ndarray):
        """The folder's own sweep, as `create` or `open_store` found it."""
        super().__init__(definition, bare, order)
        self.folder, self.definition = folder, definition

    def done(self) -> set[int]:
        """Chunks that are there."""
        found = (_CHUNK.fullmatch(path.name) for path in self.folder.iterdir())
        return {int(m[1]) for m in found if m}

    def put(self, k: int, batch: Batch) -> None:
        """Write a chunk, in one step."""
        xr = xarray()
        parts = {}
        for name, x in {**batch.values, **batch.verdicts}.items():
            own = tuple(f"{name}_{i}" for i in range(x.ndim - 1))
            parts[name] = (("lane", *own), x)
        chunk = xr.Dataset(parts, {"lane": self.lanes(k).astype(np.int32)}, {"of": self.definition["fingerprint"]})
        _write(self._path(k), chunk)

    def get(self, k: int) -> Batch:
        """Read a chunk."""
        with _told(self._path(k), _AGAIN):
            return self._batch(k)

    def _batch(self, k: int) -> Batch:
        chunk = xarray().load_dataset(self._path(k), engine="scipy")
        if chunk.attrs.get("of") != self.definition["fingerprint"] or not np.array_equal(chunk["lane"], self.lanes(k)):
            raise Scan2FlexError(f"{self._path(k)} belongs to another sweep: remove it, or choose another folder")
        arrays = {str(name): x.values for name, x in chunk.data_vars.items()}
        verdicts = {name: arrays.pop(name) for name in VERDICT}
        verdicts["verdict"] = verdicts["verdict"].astype(str)
        return Batch(arrays, verdicts)

    def finish(self, found) -> None:
        """Write the whole, if it is not there yet."""
        path = self.folder / "sweep.nc"
        if not path.exists():
            _write(path, found)

    def _path(self, k):
        return self.folder / f"chunk-{k:05d}.nc"


def create(folder: Path, definition: dict, bare, order: np.ndarray) -> Store:
    """The store of this sweep in ``folder``: a new one, or the one that is there if it is the same sweep."""
    folder = folder.resolve()
    if (folder / "definition.json").exists():
        with _told(folder / "definition.json", _ANEW):
            _same(folder, _definition(folder), definition)
        return Store(folder, definition, bare, order)
    if folder.exists() and not folder.is_dir():
        raise Scan2FlexError(f"{folder} is a file: a sweep is kept in a folder")
    there = sorted(path.name for path in folder.iterdir()) if folder.exists() else []
    strangers = [name for name in there if not name.startswith(".") and name != "lanes.nc"]
    if strangers:
        raise Scan2FlexError(f"{folder} holds {strangers[0]} and no sweep: choose an empty folder")
    _write(folder / "lanes.nc", bare.assign(order=("lane", order.astype(np.int32))))
    write_json_atomic(folder / "definition.json", definition)
    return Store(folder, definition, bare, order)


def open_sweep(folder: str | Path) -> Any:
    """The dataset of a stored sweep, done or still growing: lanes that are not there yet say "not run yet"."""
    folder = Path(folder).resolve()
    definition = _definition(folder)
    with _told(folder / "lanes.nc", _ANEW):
        bare = xarray().load_dataset(folder / "lanes.nc", engine="scipy")
        order = np.asarray(bare["order"].values, int)
    with _told(folder, _ANEW):
        return Store(folder, definition, bare.drop_vars("order"), order).dataset()


def _definition(folder):
    path = folder / "definition.json"
    try:
        definition = json.loads(path.read_text())
    except (OSError, ValueError, RecursionError) as error:
        raise Scan2FlexError(f"{path}: cannot be read as the definition of a sweep ({error})") from error
    if not isinstance(definition, dict) or definition.get("format") != FORMAT:
        raise Scan2FlexError(f"{path}: format is not {FORMAT!r}: this is no sweep of this version of the package")
    return definition


def _same(folder, there, wanted):
    """Refuse to go on with another sweep, and say what is different."""
    for name, version in wanted["versions"].items():
        if there["versions"].get(name) != version:
            raise Scan2FlexError(
                f"{folder} holds a sweep made with {name} {there['versions'].get(name)}, and this is {version}:"
                " choose another folder, or finish it with what began it"
            )
    for name, fingerprint in wanted["defined_by"].items():
        if there["defined_by"].get(name) != fingerprint:
            raise Scan2FlexError(f"{folder} holds another sweep (its {name} differ): choose another folder")
    if there["fingerprint"] != wanted["fingerprint"]:
        raise Scan2FlexError(f"{folder} holds another sweep: choose another folder")


def _write(path, dataset):
    try:
        write_atomic(path, bytes(dataset.to_netcdf(engine="scipy")))
    except OSError as error:
        raise Scan2FlexError(f"{path}: cannot be written ({error.strerror}): check the folder and the disk") from error


@contextlib.contextmanager
def _told(path, advice):
    """One sentence for whatever a broken file does to those who read it."""
    try:
        yield
    except Scan2FlexError:
        raise
    except Exception as error:  # the library's reader fails in its own ways, far from the cause
        reason = " ".join(f"{type(error).__name__} {error}".split())[:120]
        raise Scan2FlexError(f"{path}: cannot be read ({reason}): {advice}") from error
