"""The sweep: blocks of samples, in this process or on the workers of a dask client, labelled and stored as they come."""

import pickle
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

import jax
import numpy as np

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.rod.cable import require_float64
from scan2flex_jax.sweep.samples import Region, block, checked, extra, inputs, regions, sizes_of
from scan2flex_jax.sweep.store import begun, opened
from scan2flex_jax.sweep.task import FAULT, NOT_RUN, STATUS, Columns, Output, Task, another_shape, evaluate, not_run

if TYPE_CHECKING:
    import xarray
    from distributed import Client

_AXES = {"axis": ["x", "y", "z"], "end": ["start", "end"]}


def sweep(
    task: Task,
    samples: "xarray.Dataset",
    *,
    store: str | Path | None = None,
    client: "Client | None" = None,
    chunk: int | None = None,
    devices: Sequence[jax.Device] | None = None,
    longest: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> "xarray.Dataset":
    """Evaluate ``task`` for every sample.

    Args:
        task: From `fits`, `minima`, `equilibria`, or a `Task` of your own.
        samples: From `grid` or `draws`.
        store: Folder (or address that zarr knows) of a zarr store that keeps each finished chunk; the same call continues from
            there.
        client: A `dask.distributed.Client`, whose workers evaluate the samples; by default this process does.
        chunk: Largest number of samples that are evaluated and stored together: 8 by default, of a traced task 256, and 4096 on
            a GPU. On an accelerator they are one vectorised call.
        devices: Devices of this process over which a traced task is vectorised; by default a loop on a CPU, and all local
            devices elsewhere.
        longest: Seconds after which no further chunk is begun; samples not reached are marked, and the same call continues.
        progress: Called with a line of text after every chunk.

    Returns:
        A dataset over the samples' dimensions: the outputs, and for every sample ``code`` (0 solved), ``verdict`` (in words),
        ``stable``, ``steps``, ``out_of_balance``, ``seconds``. Samples that failed or were not run are NaN.

    Raises:
        Scan2FlexError: The store holds another sweep, a library is missing, an argument is not as above, the function fails for
            every sample of the first chunk, or workers are lost again and again.
    """
    require_float64()
    samples = checked(samples)
    if (chunk is not None and chunk < 1) or (devices is not None and not devices):
        raise Scan2FlexError("chunk and devices: give 1 or more")
    if devices is not None and (client is not None or not task.traced):
        raise Scan2FlexError("devices are for a traced task in this process: leave them out")
    found = _blank(samples, task.outputs)
    sizes = found["code"].shape
    shape, kept = block(sizes, chunk or task.chunk), None
    if store is not None:
        kept = opened(store, task, found, shape)
        shape = kept.block
        found, damaged = kept.load()
        for sentence in damaged:
            warnings.warn(f"{sentence}; its samples are computed anew", stacklevel=2)
    before = _done(found)
    missing = [region for region in regions(sizes, shape) if np.any(found["code"].values[region] == NOT_RUN)]
    began = perf_counter()
    for region, columns in _evaluated(task, samples, missing, int(np.prod(shape)), client, devices):
        if not _done(found) and np.all(columns["code"] == FAULT):
            raise Scan2FlexError(f"every sample of the first chunk failed: {columns['verdict'][0]}")
        _fill(found, region, columns, task.outputs)
        if kept is not None:
            kept.keep(found, region)
        spent = perf_counter() - began
        if progress:
            progress(_line(found, before, spent))
        if longest is not None and spent > longest:
            break
    return _labelled(found)


def open_sweep(store: str | Path) -> "xarray.Dataset":
    """The dataset of a stored sweep, complete or still growing: samples that are not there yet are marked "not run yet".

    Raises:
        Scan2FlexError: There is no sweep, or a file of it is damaged.
    """
    kept = begun(store)
    if kept is None:
        raise Scan2FlexError(f"{store} holds no sweep")
    found, damaged = kept.load()
    if damaged:
        raise Scan2FlexError(f"{damaged[0]}: run the sweep again, which computes its samples anew")
    return _labelled(found)


def failed(found: "xarray.Dataset") -> dict[str, str]:
    """Every sample that is not solved, by name, with its status in words."""
    dims, out = found["code"].dims, {}
    for place in np.argwhere(found["code"].values != 0):
        at = zip(dims, place, strict=True)
        out[", ".join(f"{d}={found[d].values[k]:g}" for d, k in at)] = str(found["verdict"].values[tuple(place)])
    return out


def _blank(samples, outputs: dict[str, Output]):
    """The dataset with nothing run; outputs with dimensions of their own are added when their shape is known."""
    sizes = sizes_of(samples)
    if wrong := (outputs.keys() & {*samples.variables, *STATUS}) | (samples.variables.keys() & STATUS.keys()):
        raise Scan2FlexError(f"{min(wrong)!r} is an output of the sweep and an input, or a part of the status: rename one")
    found = samples.copy()
    for name, x in not_run(tuple(sizes.values())).items():
        unit, label, _ = STATUS[name]
        found[name] = (tuple(sizes), x, {"units": unit, "long_name": label})
    for name, output in outputs.items():
        if not output.dims:
            _add(found, name, output, ())
    return found


def _add(found, name, output, shape):
    about = {"units": output.unit} | ({"long_name": output.label} if output.label else {})
    code = found["code"]
    found[name] = ((*code.dims, *output.dims), np.full((*code.shape, *shape), np.nan), about)


def _done(found) -> int:
    return int(np.sum(found["code"].values != NOT_RUN))


def _fill(found, region, columns: Columns, outputs):
    block = found["code"].values[region].shape
    for name, x in columns.items():
        if name not in found:
            _add(found, name, outputs[name], x.shape[1:])
        there = found[name].values
        if there.shape[len(block) :] != x.shape[1:]:
            raise another_shape(name, there.shape[len(block) :], x.shape[1:])
        there[region] = x.reshape(*block, *x.shape[1:])


def _line(found, before, spent) -> str:
    code = found["code"].values
    done, bad = _done(found), int(np.sum(code > 0))
    left = (code.size - done) * spent / (done - before)
    text = f"{done} of {code.size} samples, {bad} failed, {spent:.0f} s"
    return f"{text}, about {left:.0f} s to go" if left else text


def _labelled(found):
    """The outputs before the status, plain text, and the names of axes and ends as coordinates."""
    verdict = found["verdict"]
    places = {sentence: i for i, sentence in enumerate(dict.fromkeys(verdict.values.flat))}  # each is made once
    which = np.fromiter(map(places.get, verdict.values.flat), int, verdict.size).reshape(verdict.shape)
    found["verdict"] = verdict.copy(data=np.array(list(places), str).take(which))
    order = [*(name for name in found if name not in STATUS), *STATUS]
    found = extra("xarray").Dataset({name: found[name] for name in order}, found.coords)
    return found.assign_coords({d: names for d, names in _AXES.items() if found.sizes.get(d) == len(names)})


def _evaluated(task, samples, missing, width, client, devices) -> Iterator[tuple[Region, Columns]]:
    """Blocks as they are finished."""
    if client is None:
        for region in missing:
            yield region, evaluate(task, inputs(samples, region), width, devices)
        return
    distributed = extra("distributed")
    if not isinstance(client, distributed.Client):
        raise Scan2FlexError(f"the client is a {type(client).__name__}: give a dask.distributed.Client")
    try:
        packed = client.submit(bytes, extra("cloudpickle").dumps(task), pure=False)
    except Exception as error:  # of what a task may hold
        raise Scan2FlexError(f"the task cannot be sent to a worker: {error}") from error
    futures = {client.submit(_on_worker, packed, inputs(samples, region), width, pure=False): region for region in missing}
    try:
        for future in distributed.as_completed(list(futures)):
            yield futures.pop(future), future.result()
    except distributed.KilledWorker as error:
        raise Scan2FlexError(f"workers were lost again and again ({error}): a store keeps what is finished") from error
    finally:
        client.cancel(list(futures))


_ONE = threading.Lock()  # threads of a worker take turns: JAX uses the processors itself


def _on_worker(packed, samples, width) -> Columns:
    with _ONE:
        return evaluate(_unpacked(packed), samples, width)


@lru_cache(maxsize=4)
def _unpacked(packed) -> Task:
    """The task, once in each process: a copy for each chunk would be compiled anew."""
    jax.config.update("jax_enable_x64", True)
    return pickle.loads(packed)
