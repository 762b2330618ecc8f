"""The task of a sweep, and the status of every sample.

There are two kinds of task. `Calls`: a Python function of one sample, called for one sample after the other. `Traced`: a
traceable function, evaluated for several samples in one compiled call: sequentially on a CPU (`jax.lax.map`), where a
vectorised batch, which runs as long as its slowest sample, measured no faster; vectorised (`jax.vmap`) on other devices and
on a mesh. A failure in a sample stays there: its status names the cause, its values are NaN.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from time import perf_counter

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

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
VERDICT = {  # of every sample: unit and label
    "code": ("-", "0 solved, else what went wrong"),
    "verdict": ("-", "the code in words"),
    "stable": ("-", "whether no direction lowers the energy"),
    "steps": ("-", "steps of the solver, or equilibria of a fit"),
    "out_of_balance": ("-", "largest force left, scaled; NaN where nothing was solved"),
    "seconds": ("s", "wall clock; differs from run to run"),
}


@dataclass(frozen=True)
class Output:
    """One quantity that a task returns for every sample: its unit, the names of its own dimensions, and a label."""

    unit: str = "-"
    dims: tuple[str, ...] = ()
    label: str = ""


@dataclass(frozen=True)
class Outcome:
    """Result of a `Calls` task with a status, instead of bare values."""

    values: dict
    code: int = SOLVED
    sentence: str | None = None
    stable: bool = True
    steps: int = 0
    out_of_balance: float = np.nan


@dataclass(frozen=True)
class Batch:
    """Finished samples: their indices, values and status, stacked."""

    values: dict[str, np.ndarray]
    verdicts: dict[str, np.ndarray]


@dataclass(frozen=True)
class Calls:
    """``function(lane)`` returns a dictionary of ``outputs``, or an `Outcome`; an exception becomes the sample's status."""

    function: Callable
    outputs: dict[str, Output]
    defined_by: dict[str, object] = field(default_factory=dict)
    chunk: int = 8

    def parts(self) -> dict[str, object]:
        """The parts that define this task."""
        return self.defined_by or {"function": self.function}

    def batches(self, lanes: dict, count: int, at_once: int, mesh: Mesh | None) -> Iterator[Batch]:
        """One sample after the other."""
        if mesh is not None or at_once > 1:
            raise Scan2FlexError("a Python function takes one lane at a time: leave mesh and at_once out, start more processes")
        for i in range(count):
            begin = perf_counter()
            o = self._called({name: x[i] for name, x in lanes.items()})
            yield _batch([o.values], [o.code], [o.stable], [o.steps], [o.out_of_balance], perf_counter() - begin, o.sentence)

    def _called(self, lane) -> Outcome:
        try:
            o = self.function(lane)
            o = o if isinstance(o, Outcome) else Outcome(dict(o))
            if o.code == SOLVED and set(o.values) != set(self.outputs):
                raise TypeError(f"it gave {sorted(o.values)} where {sorted(self.outputs)} are declared")
        except Scan2FlexError as error:
            return Outcome({}, REFUSED, str(error), stable=False)
        except Exception as error:
            return Outcome({}, FAULT, f"{type(error).__name__}: {error}", stable=False)
        return o


class Traced:
    """``function(lane)`` returns ``(values, Verdict)`` under tracing; `equilibria` makes one."""

    chunk = 256

    def __init__(self, function: Callable, outputs: dict[str, Output], defined_by: dict[str, object] | None = None):
        """Set up without compilation."""
        self.function, self.outputs, self.defined_by = function, outputs, defined_by or {}
        self._single, self._vectorised = compiled(function), compiled(jax.vmap(function))

        def looped(lanes):
            return jax.lax.map(function, lanes)

        self._looped = compiled(looped)

    def parts(self) -> dict[str, object]:
        """The parts that define this task."""
        return self.defined_by or {"function": self.function}

    def batches(self, lanes: dict, count: int, at_once: int, mesh: Mesh | None) -> Iterator[Batch]:
        """``at_once`` samples per call; the last batch is padded with its last sample, so that one compilation serves."""
        loop = mesh is None and jax.default_backend() == "cpu"
        together = self._looped if loop else self._vectorised
        for first in range(0, count, at_once):
            which = np.minimum(np.arange(first, first + at_once), count - 1)
            begin = perf_counter()
            if at_once == 1 and mesh is None:
                values, v = jax.tree.map(lambda x: np.asarray(x)[None], self._single(_arrays(lanes, first)))
            else:
                values, v = jax.tree.map(np.asarray, together(_placed(_arrays(lanes, which), mesh)))
            real = min(at_once, count - first)
            values, v = jax.tree.map(lambda x, n=real: x[:n], (values, v))
            rows = [{name: x[i] for name, x in values.items()} if v.code[i] == SOLVED else {} for i in range(real)]
            yield _batch(rows, v.code, v.negative == 0, v.steps, v.out_of_balance, (perf_counter() - begin) / real)


def _arrays(lanes, which):
    return {name: jnp.asarray(x[which]) for name, x in lanes.items()}


def _placed(lanes, mesh):
    if mesh is None:
        return lanes
    over = NamedSharding(mesh, PartitionSpec(mesh.axis_names[0]))
    return jax.device_put(lanes, over)


def _batch(rows, code, stable, steps, out_of_balance, seconds, sentence=None) -> Batch:
    """Stacked samples; a solved sample with a NaN among its values counts as failed."""
    code = np.array(code, np.int32)
    rows = [{name: np.asarray(x, float) for name, x in row.items()} for row in rows]
    broken = np.array([any(np.any(np.isnan(x)) for x in row.values()) for row in rows])
    code[(code == SOLVED) & broken] = NON_FINITE
    names = {name for row in rows for name in row}
    text = [sentence if sentence and c != NON_FINITE else SENTENCES.get(int(c), f"code {c}") for c in code]
    verdicts = {
        "code": code,
        "verdict": np.array(text),
        "stable": np.array(stable, bool),
        "steps": np.array(steps, np.int32),
        "out_of_balance": np.array(out_of_balance, float),
        "seconds": np.full(len(code), seconds),
    }
    return Batch({name: stacked([row.get(name) for row in rows]) for name in names}, verdicts)


def stacked(rows) -> np.ndarray:
    """Rows of one shape, NaN for missing ones."""
    shape = next(row.shape for row in rows if row is not None)
    return np.stack([np.full(shape, np.nan) if row is None else row for row in rows])


def joined(batches: list[Batch]) -> Batch:
    """Batches one after the other; a quantity missing in a batch is NaN there."""
    shapes: dict[str, tuple[int, ...]] = {}
    for batch in batches:
        for name, x in batch.values.items():
            if shapes.setdefault(name, x.shape[1:]) != x.shape[1:]:
                raise Scan2FlexError(
                    f"{name} has shape {shapes[name]} in one lane and {x.shape[1:]} in another: make it the same in all"
                )
    values = {}
    for name, shape in shapes.items():
        parts = [b.values.get(name, np.full((len(b.verdicts["code"]), *shape), np.nan)) for b in batches]
        values[name] = np.concatenate(parts)
    return Batch(values, {name: np.concatenate([b.verdicts[name] for b in batches]) for name in VERDICT})
