"""The task of a sweep, evaluated for a block of samples, with a status for each.

A Python function is called for one sample after the other. A traced one is evaluated for several samples in one compiled call:
sequentially on a CPU (`jax.lax.map`), where a vectorised batch, which runs as long as its slowest sample, measured no faster;
vectorised (`jax.vmap`) elsewhere, over all devices. A failure in a sample stays there: its status names the cause.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import ceil
from time import perf_counter
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import AxisType, NamedSharding, PartitionSpec

from scan2flex_jax.compilation import compiled
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.statics.verdict import NON_FINITE, SOLVED
from scan2flex_jax.statics.verdict import SENTENCES as OF_EQUILIBRIA

NOT_RUN, NOT_CONVERGED, REFUSED, FAULT = -1, 20, 21, 22
SENTENCES = OF_EQUILIBRIA | {
    NOT_RUN: "not run yet",
    NOT_CONVERGED: "the fit did not converge",
    REFUSED: "the input was refused",
    FAULT: "the function failed",
}
STATUS = {  # of every sample: unit, label, and the value of one that was not run
    "code": ("-", "0 solved, else what went wrong", NOT_RUN),
    "verdict": ("-", "the code in words", SENTENCES[NOT_RUN]),
    "stable": ("-", "whether no direction lowers the energy", False),
    "steps": ("-", "steps of the solver, or equilibria of a fit", 0),
    "out_of_balance": ("-", "largest force left, scaled; NaN where nothing was solved", np.nan),
    "seconds": ("s", "wall clock; differs from run to run", 0.0),
}
_IN_ONE_CALL = 16  # samples on a CPU: starting a call costs a third of a solve, and the last call is padded


def empty(name: str) -> Any:
    """The value of an output or a status of a sample that was not run."""
    return STATUS[name][2] if name in STATUS else np.nan


Columns = dict[str, np.ndarray]
"""The outputs and the status of a block of samples, one row each."""


def not_run(shape: int | tuple[int, ...]) -> Columns:
    """The status of samples that were not run."""
    return {name: np.full(shape, x, object if isinstance(x, str) else None) for name, (*_, x) in STATUS.items()}


def in_words(code: int) -> str:
    """The status of a sample; of a code of the user's own, its number."""
    return SENTENCES.get(code, f"code {code}")


@dataclass(frozen=True)
class Output:
    """One quantity that a task returns for every sample: its unit, the names of its own dimensions, and a label."""

    unit: str = "-"
    dims: tuple[str, ...] = ()
    label: str = ""


@dataclass(frozen=True)
class Outcome:
    """Outputs of a Python function with a status, instead of bare outputs; ``code`` 0 is solved."""

    values: dict
    code: int = SOLVED
    sentence: str | None = None
    stable: bool = True
    steps: int = 0
    out_of_balance: float = np.nan


@dataclass(frozen=True, eq=False)
class Task:
    """``function(sample)`` and the ``outputs`` that it returns; a sample is a dictionary of inputs.

    Args:
        function: Returns a dictionary of the outputs, or an `Outcome`; an exception becomes the sample's status. If it is
            ``traced`` by JAX, it returns ``(outputs, Verdict)``.
        outputs: What is returned, by name.
        traced: Whether JAX traces the function, for many samples in one compiled call.
        prepare: Of a traced function: makes the arrays that it takes from a sample, outside of the tracing, in the same shapes
            for every sample. A `Scan2FlexError` becomes the sample's status.
        about: What a store of the sweep is recognised by (numbers, arrays, studies, functions); the function by default.
    """

    function: Callable
    outputs: dict[str, Output]
    traced: bool = False
    prepare: Callable[[dict], Any] | None = None
    about: dict[str, Any] = field(default_factory=dict)

    @property
    def chunk(self) -> int:
        """Samples of one block, unless the user states it."""
        if not self.traced:
            return 8
        return 4096 if jax.default_backend() == "gpu" else 256


def evaluate(task: Task, samples: Columns, width: int, devices: Sequence[jax.Device] | None = None) -> Columns:
    """Outputs and status of a block of samples; ``width``: the samples of a full block, so that one compilation serves all."""
    count = len(next(iter(samples.values())))
    columns = _traced(task, samples, count, width, devices) if task.traced else _called(task, samples, count)
    code, outputs = columns["code"], [columns[name] for name in task.outputs if name in columns]
    broken = np.any([np.isnan(x).reshape(count, -1).any(axis=1) for x in outputs], axis=0) & (code == SOLVED)
    code[broken] = NON_FINITE
    columns["verdict"][broken] = in_words(NON_FINITE)
    return columns


def _called(task, samples, count) -> Columns:
    outcomes, seconds = [], []
    for k in range(count):
        begin = perf_counter()
        outcomes.append(_outcome(task, {name: x[k] for name, x in samples.items()}))
        seconds.append(perf_counter() - begin)
    columns = {}
    for name in task.outputs:
        rows = [o.values.get(name) for o in outcomes]
        shapes = sorted({x.shape for x in rows if x is not None})
        if len(shapes) > 1:
            raise another_shape(name, *shapes[:2])
        if shapes:
            columns[name] = np.stack([np.full(shapes[0], np.nan) if x is None else x for x in rows])
    status = {name: np.array([getattr(o, name) for o in outcomes]) for name in ("code", "stable", "steps", "out_of_balance")}
    verdict = np.array([o.sentence or in_words(o.code) for o in outcomes], object)
    return columns | status | {"verdict": verdict, "seconds": np.array(seconds)}


def _outcome(task, sample) -> Outcome:
    try:
        o = task.function(sample)
        o = o if isinstance(o, Outcome) else Outcome(dict(o))
        if o.code == SOLVED and set(o.values) != set(task.outputs):
            raise TypeError(f"it gave {sorted(o.values)} where {sorted(task.outputs)} are declared")
        return replace(o, values={name: np.asarray(x, float) for name, x in o.values.items()})
    except Scan2FlexError as error:
        return Outcome({}, REFUSED, str(error), stable=False)
    except Exception as error:
        return Outcome({}, FAULT, f"{type(error).__name__}: {error}", stable=False)


def another_shape(name: str, one: tuple[int, ...], other: tuple[int, ...]) -> Scan2FlexError:
    """An output whose shape differs among samples."""
    return Scan2FlexError(f"{name} has shape {one} in one sample and {other} in another: make it the same in all")


def _traced(task, samples, count, width, devices) -> Columns:
    begin = perf_counter()
    given, refused = _prepared(task, samples, count)
    solved = np.delete(np.arange(count), list(refused))
    columns = not_run(count)
    columns["code"][:] = REFUSED
    columns["verdict"][list(refused)] = list(refused.values())
    if len(solved):
        outputs, v = _solved(task.function, given, len(solved), width, devices)
        columns["code"][solved], columns["stable"][solved] = v.code, v.negative == 0
        columns["steps"][solved], columns["out_of_balance"][solved] = v.steps, v.out_of_balance
        codes, which = np.unique(v.code, return_inverse=True)  # a million samples have a few sentences
        columns["verdict"][solved] = np.array([in_words(code) for code in codes.tolist()], object)[which]
        for name, x in outputs.items():
            columns[name] = np.full((count, *x.shape[1:]), np.nan)
            columns[name][solved[v.code == SOLVED]] = x[v.code == SOLVED]
    return columns | {"seconds": np.full(count, (perf_counter() - begin) / count)}


def _prepared(task, samples, count) -> tuple[Any, dict[int, str]]:
    """The arrays of the samples, stacked, without those that were refused, and why, by place."""
    if task.prepare is None:
        return samples, {}
    rows, refused = [], {}
    for i in range(count):
        try:
            rows.append(task.prepare({name: x[i] for name, x in samples.items()}))
        except Scan2FlexError as error:
            refused[i] = str(error)
    return jax.tree.map(lambda *x: np.stack(x), *rows) if rows else (), refused


def _solved(function, given, count, width, devices):
    """``function`` of all samples, in calls of one size; the last call is padded with its last sample."""
    loop = devices is None and jax.default_backend() == "cpu"
    devices = [None] if loop else devices or jax.local_devices()
    size = ceil(width / ceil(width / _IN_ONE_CALL)) if loop else ceil(width / len(devices)) * len(devices)
    program, parts = _program(function, loop), []
    for first in range(0, count, size):
        which = np.minimum(np.arange(first, first + size), count - 1)
        arrays = jax.tree.map(lambda x, which=which: jnp.asarray(x[which]), given)
        parts.append(jax.tree.map(np.asarray, program(arrays if loop else jax.device_put(arrays, _spread(devices)))))
    return jax.tree.map(lambda *x: np.concatenate(x)[:count], *parts)


@lru_cache(maxsize=8)
def _program(function, loop):
    return compiled((lambda samples: jax.lax.map(function, samples)) if loop else jax.vmap(function))


def _spread(devices) -> NamedSharding:
    """Over devices in a row; the solvers work neither inside `shard_map` nor on axes of another type than Auto."""
    mesh = jax.make_mesh((len(devices),), ("sample",), axis_types=(AxisType.Auto,), devices=devices)
    return NamedSharding(mesh, PartitionSpec("sample"))
