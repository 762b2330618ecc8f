"""The store of a growing sweep: one file per chunk of samples, each written in one step.

    definition.json    the identity of the sweep (fingerprints and versions), its outputs, and the division into chunks
    lanes.nc           the labelled inputs, and the order of the samples
    chunk-00017.nc     the samples of one finished chunk
    sweep.nc           the whole, once every chunk is there

The files are netCDF 3, which xarray reads and writes without a further library. Each one except `sweep.nc`, which is meant for
others, ends with the SHA-256 of its content, and the definition contains its own: a store whose bytes have changed is not
read. A damaged chunk counts as missing. A killed process leaves only complete chunks, and at most one file of its own whose
name begins with a dot, which is never read.
"""

import contextlib
import hashlib
import io
import json
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.study.files import write_atomic
from scan2flex_jax.study.outputs import write_json_atomic
from scan2flex_jax.sweep.labelled import filled, xarray
from scan2flex_jax.sweep.task import VERDICT, Batch, Output

FORMAT = "scan2flex-sweep/2"
_EARLIER = "scan2flex-sweep/1"
_MARK = b"\nsha256:"  # between a file and its checksum
_AGAIN = "run the sweep again, which computes its lanes anew"
_ANEW = "choose another folder, or remove this one and begin again"
_CHUNK = re.compile(r"chunk-(\d+)\.nc")


class Memory:
    """The store in memory, without a folder: chunks live as long as the sweep."""

    def __init__(self, definition: dict, bare, order: np.ndarray):
        """Start without chunks."""
        self.outputs = {name: Output(o["unit"], tuple(o["dims"]), o["label"]) for name, o in definition["outputs"].items()}
        self.bare, self.order, self.size = bare, order, definition["chunk"]
        self.kept: dict[int, Batch] = {}

    @property
    def count(self) -> int:
        """Number of chunks."""
        return -(-len(self.order) // self.size)

    def lanes(self, k: int) -> np.ndarray:
        """Indices of the samples of chunk ``k``."""
        return self.order[k * self.size : (k + 1) * self.size]

    def done(self) -> set[int]:
        """Chunks that exist."""
        return set(self.kept)

    def put(self, k: int, batch: Batch) -> None:
        """Keep a chunk."""
        self.kept[k] = batch

    def get(self, k: int) -> Batch:
        """An existing chunk."""
        return self.kept[k]

    def dataset(self):
        """The existing chunks as a dataset."""
        return filled(self.bare, self.outputs, [(self.lanes(k), self.get(k)) for k in sorted(self.done())])

    def finish(self, found) -> None:
        """Nothing to write."""


class Store(Memory):
    """Chunks in a folder that several processes and hosts may share."""

    def __init__(self, folder: Path, definition: dict, bare, order: np.ndarray, *, going_on: bool = False):
        """The folder's own sweep, from `create` or `open_sweep`; if it is `going_on`, damaged chunks are computed again."""
        super().__init__(definition, bare, order)
        self.folder, self.definition, self.going_on = folder, definition, going_on
        self._whole: set[int] = set()
        self._damaged: set[int] = set()

    def done(self) -> set[int]:
        """Chunks that exist. If the sweep continues, a damaged one is reported, and counts as missing."""
        found = (_CHUNK.fullmatch(path.name) for path in self.folder.iterdir())
        there = {int(m[1]) for m in found if m}
        if not self.going_on:
            return there
        for k in there - self._whole - self._damaged:
            try:
                _checked(self._path(k))
                self._whole.add(k)
            except (OSError, Scan2FlexError) as error:
                warnings.warn(f"{error}; its lanes are computed anew", stacklevel=2)
                self._damaged.add(k)
        return there - self._damaged

    def put(self, k: int, batch: Batch) -> None:
        """Write a chunk, in one step."""
        xr = xarray()
        parts = {}
        for name, x in {**batch.values, **batch.verdicts}.items():
            own = tuple(f"{name}_{i}" for i in range(x.ndim - 1))
            parts[name] = (("lane", *own), x)
        chunk = xr.Dataset(parts, {"lane": self.lanes(k).astype(np.int32)}, {"of": self.definition["fingerprint"]})
        _write(self._path(k), chunk)
        self._damaged.discard(k)

    def get(self, k: int) -> Batch:
        """Read a chunk."""
        with _told(self._path(k), _AGAIN):
            return self._batch(k)

    def _batch(self, k: int) -> Batch:
        chunk = _load(self._path(k))
        if chunk.attrs.get("of") != self.definition["fingerprint"] or not np.array_equal(chunk["lane"], self.lanes(k)):
            raise Scan2FlexError(f"{self._path(k)} belongs to another sweep: remove it, or choose another folder")
        arrays = {str(name): x.values for name, x in chunk.data_vars.items()}
        verdicts = {name: arrays.pop(name) for name in VERDICT}
        verdicts["verdict"] = verdicts["verdict"].astype(str)
        return Batch(arrays, verdicts)

    def finish(self, found) -> None:
        """Write the whole dataset, unless it exists."""
        path = self.folder / "sweep.nc"
        if not path.exists():
            _write(path, found, check=False)

    def _path(self, k):
        return self.folder / f"chunk-{k:05d}.nc"


def create(folder: Path, definition: dict, bare, order: np.ndarray) -> Store:
    """The store of this sweep in ``folder``: a new one, or the existing one if it is the same sweep."""
    folder = folder.resolve()
    if (folder / "definition.json").exists():
        with _told(folder / "definition.json", _ANEW):
            _same(folder, _definition(folder), definition)
        return Store(folder, definition, bare, order, going_on=True)
    if folder.exists() and not folder.is_dir():
        raise Scan2FlexError(f"{folder} is a file: a sweep is kept in a folder")
    there = sorted(path.name for path in folder.iterdir()) if folder.exists() else []
    strangers = [name for name in there if not name.startswith(".") and name != "lanes.nc"]
    if strangers:
        raise Scan2FlexError(f"{folder} holds {strangers[0]} and no sweep: choose an empty folder")
    _write(folder / "lanes.nc", bare.assign(order=("lane", order.astype(np.int32))))
    write_json_atomic(folder / "definition.json", {**definition, "sha256": _digest_of(definition)})
    return Store(folder, definition, bare, order, going_on=True)


def open_sweep(folder: str | Path) -> Any:
    """The dataset of a stored sweep, complete or still growing: samples that are not there yet are marked "not run yet"."""
    folder = Path(folder).resolve()
    definition = _definition(folder)
    with _told(folder / "lanes.nc", _ANEW):
        bare = _load(folder / "lanes.nc")
        order = np.asarray(bare["order"].values, int)
    with _told(folder, _ANEW):
        return Store(folder, definition, bare.drop_vars("order"), order).dataset()


def _definition(folder):
    path = folder / "definition.json"
    try:
        definition = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise Scan2FlexError(f"{path}: cannot be read as the definition of a sweep ({error})") from error
    found = definition.pop("format", None) if isinstance(definition, dict) else None
    if found == _EARLIER:
        raise Scan2FlexError(f"{path}: an earlier version wrote this sweep, without checksums: read its sweep.nc, or {_ANEW}")
    if found != FORMAT:
        raise Scan2FlexError(f"{path}: format is not {FORMAT!r}: this is no sweep of this version of the package")
    digest = definition.pop("sha256", None)
    definition = {"format": FORMAT, **definition}
    if digest != _digest_of(definition):
        raise Scan2FlexError(f"{path}: it is damaged (its checksum differs): {_ANEW}")
    return definition


def _digest_of(definition: dict) -> str:
    return hashlib.sha256(json.dumps(definition, sort_keys=True).encode()).hexdigest()


def _same(folder, there, wanted):
    """Refuse to continue another sweep, and report the difference."""
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


def _write(path, dataset, check=True):
    data = bytes(dataset.to_netcdf(engine="scipy"))
    ending = _MARK + hashlib.sha256(data).hexdigest().encode() if check else b""
    try:
        write_atomic(path, data + ending)
    except OSError as error:
        raise Scan2FlexError(f"{path}: cannot be written ({error.strerror}): check the folder and the disk") from error


def _checked(path) -> bytes:
    """The netCDF in a file, with its checksum verified."""
    data, mark, digest = path.read_bytes().rpartition(_MARK)
    if not mark or digest.decode("ascii", errors="replace") != hashlib.sha256(data).hexdigest():
        raise Scan2FlexError(f"{path}: it is damaged (its checksum differs)")
    return data


def _load(path):
    try:
        data = _checked(path)
    except Scan2FlexError as error:
        raise Scan2FlexError(f"{error}: {_AGAIN if _CHUNK.fullmatch(path.name) else _ANEW}") from error
    return xarray().load_dataset(io.BytesIO(data), engine="scipy")


@contextlib.contextmanager
def _told(path, advice):
    """One sentence for any exception that reading a broken file raises."""
    try:
        yield
    except Scan2FlexError:
        raise
    except Exception as error:  # the library's reader raises various exceptions, far from the cause
        reason = " ".join(f"{type(error).__name__} {error}".split())[:120]
        raise Scan2FlexError(f"{path}: cannot be read ({reason}): {advice}") from error
