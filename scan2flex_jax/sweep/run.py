"""The sweep: samples in chunks of similar cost, each stored as soon as it is done; several processes share the chunks.

Samples are independent, so processes need no communication: process ``i`` of ``n`` takes every n-th chunk, and a process that
has finished continues with the missing chunks, from the back. A chunk computed twice is the same chunk. A lost process loses
only its current chunk, which the others, or the next start, compute again.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from time import perf_counter
from typing import Any

import jax
import numpy as np
from jax.sharding import AxisType, Mesh
from numpy.typing import ArrayLike

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.rod.cable import require_float64
from scan2flex_jax.sweep.definition import digest, versions
from scan2flex_jax.sweep.labelled import skeleton, xarray
from scan2flex_jax.sweep.lanes import Lanes
from scan2flex_jax.sweep.store import FORMAT, Memory, create
from scan2flex_jax.sweep.task import FAULT, Calls, Traced, joined

_IN_ONE_CALL = 16  # samples on a CPU: starting a call costs a third of a solve, and small batches are padded


def sweep(
    task: Calls | Traced,
    lanes: Lanes,
    *,
    store: str | Path | None = None,
    chunk: int | None = None,
    at_once: int | None = None,
    cost: Callable[[dict], float] | ArrayLike | None = None,
    mesh: Mesh | None = None,
    share: tuple[int, int] | None = None,
    longest: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> Any:
    """Evaluate ``task`` for every sample; returns an `xarray.Dataset` over the samples' dimensions, with a status per sample.

    ``store``: a folder that keeps each chunk of ``chunk`` samples once it is done; the same call continues from there.
    ``at_once``: samples in one compiled call of a traced task, sequential on a CPU and vectorised on other devices or
    a ``mesh`` (default: several on a CPU, one per device of a CPU mesh, a whole chunk on other devices). ``cost``: expected
    cost of a sample, as a function of it or as numbers; samples of similar cost share a chunk, the expensive ones first.
    ``mesh``: from `device_mesh`.
    ``share``: ``(i, n)``, this process and the number of processes that share the store (default: from `jax.distributed`).
    ``longest``: seconds after which no further chunk is started; samples not reached are marked, and the same call continues.
    ``progress`` is called with a line of text after every chunk and occasionally inside one.
    """
    xarray()
    require_float64()
    size = task.chunk if chunk is None else int(chunk)
    if size < 1 or (at_once is not None and at_once < 1):
        raise Scan2FlexError("chunk and at_once count lanes: give 1 or more")
    at_once = _at_once(task, min(size, lanes.count), at_once, mesh)
    order = _order(lanes, cost)
    i, n = share or (jax.process_index(), jax.process_count())
    if not 0 <= i < n:
        raise Scan2FlexError(f"share {(i, n)} is no share: give (i, n) with i from 0 to n - 1")
    if n > 1 and store is None:
        raise Scan2FlexError("several processes share a sweep through its store: give a folder that all of them see")
    if store is None:
        kept = Memory({"outputs": _plain(task.outputs), "chunk": size}, skeleton(lanes), order)
    else:
        kept = create(Path(store), _definition(task, lanes, size, at_once, order), skeleton(lanes), order)
    tell = _Progress(kept, lanes.count, progress or (lambda line: None))
    for k in _mine(kept, i, n):
        if longest is not None and tell.spent() > longest:
            break
        kept.put(k, _chunk(task, lanes.take(kept.lanes(k)), len(kept.lanes(k)), at_once, mesh, tell))
        tell.chunk(k)
    found = kept.dataset()
    if i == 0 and len(kept.done()) == kept.count:
        kept.finish(found)
    return found


def device_mesh(devices: Sequence[jax.Device] | None = None) -> Mesh:
    """This process's devices in a row, as a mesh for the solvers (their axes must be of type Auto)."""
    devices = jax.local_devices() if devices is None else devices
    return jax.make_mesh((len(devices),), ("lane",), axis_types=(AxisType.Auto,), devices=devices)


def _at_once(task, size, at_once, mesh) -> int:
    """Samples per call, for a chunk of ``size``."""
    if mesh is not None:
        here = set(jax.local_devices())
        if len(mesh.axis_names) != 1 or mesh.axis_types != (AxisType.Auto,) or not set(mesh.devices.flat) <= here:
            raise Scan2FlexError("a sweep runs on one axis of type Auto over this process's own devices: use device_mesh()")
    width = 1 if mesh is None else mesh.size
    if at_once is None and (isinstance(task, Calls) or (mesh is not None and jax.default_backend() == "cpu")):
        at_once = width
    elif at_once is None:
        at_once = min(size, _IN_ONE_CALL) if jax.default_backend() == "cpu" else -(-size // width) * width
    if at_once % width:
        raise Scan2FlexError(f"at_once is {at_once} on a mesh of {width} devices: give a multiple of {width}")
    return at_once


def _order(lanes, cost) -> np.ndarray:
    """Indices of the samples, expensive ones first; in their own order without a cost."""
    if cost is None:
        return np.arange(lanes.count)
    if callable(cost):
        cost = [float(cost({name: x[i] for name, x in lanes.take(slice(None)).items()})) for i in range(lanes.count)]
    cost = np.asarray(cost, float).ravel()
    if cost.shape != (lanes.count,) or not np.all(np.isfinite(cost)):
        raise Scan2FlexError(f"cost has {len(cost)} values, or some that are not finite: give one number for each lane")
    return np.argsort(-cost, kind="stable")


def _plain(outputs):
    return {name: {**asdict(o), "dims": list(o.dims)} for name, o in outputs.items()}


def _definition(task, lanes, size, at_once, order) -> dict:
    """The definition that a store must hold to be continued."""
    parts = {name: digest(part) for name, part in task.parts().items()}
    parts |= {"lanes": digest((lanes.dims, lanes.inputs)), "order of lanes": digest(order), "lanes at once": str(at_once)}
    out = {"format": FORMAT, "chunk": size, "defined_by": parts, "versions": versions(), "outputs": _plain(task.outputs)}
    return out | {"fingerprint": digest(out)}


def _mine(kept, i, n) -> Iterator[int]:
    """Chunks to do, in turn: this process's own, then the missing ones, from the back."""
    for k in range(i, kept.count, n):
        if k not in kept.done():
            yield k
    if n > 1:
        for k in reversed(range(kept.count)):
            if k not in kept.done():
                yield k


def _chunk(task, lanes, count, at_once, mesh, tell):
    batches = []
    for batch in task.batches(lanes, count, at_once, mesh):
        batches.append(batch)
        tell.lanes(batch)
    whole = joined(batches)
    if tell.first and np.all(whole.verdicts["code"] == FAULT):
        raise Scan2FlexError(f"every lane of the first chunk failed: {whole.verdicts['verdict'][0]}")
    return whole


class _Progress:
    """Progress lines of a sweep: samples done, failures, and an estimate of the remaining time."""

    def __init__(self, kept, count, say):
        self.kept, self.count, self.say = kept, count, say
        self.before = sum(len(kept.lanes(k)) for k in kept.done())
        self.first = self.before == 0
        self.run = self.failed = 0
        self.began = self.said = perf_counter()

    def lanes(self, batch):
        self.run += len(batch.verdicts["code"])
        self.failed += int(np.sum(batch.verdicts["code"] != 0))
        if perf_counter() - self.said > 1.0:
            self.line()

    def spent(self) -> float:
        return perf_counter() - self.began

    def chunk(self, k):
        self.first = False
        self.line(f"chunk {k + 1} of {self.kept.count} kept, ")

    def line(self, head=""):
        self.said = perf_counter()
        spent = self.spent()
        left = max(self.count - self.before - self.run, 0) * spent / max(self.run, 1)
        text = f"{head}{self.before + self.run} of {self.count} lanes, {self.failed} failed, {spent:.0f} s"
        self.say(f"{text}, about {left:.0f} s to go" if left else text)
