"""Minima of fits as the task of a sweep: many fits in one compiled call, without statistics.

The estimates are those of `fits` where the study has no priors. Intervals and the noise are left out: they take most of the
time of a `fit`.
"""

from collections.abc import Callable
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting.problem import FIT_ELEMENTS, Problem
from scan2flex_jax.fitting.traced import minimise, padded_starts, traced_problem
from scan2flex_jax.statics.verdict import SOLVED, Verdict
from scan2flex_jax.study.model import Study
from scan2flex_jax.sweep.changes import guesses
from scan2flex_jax.sweep.fit_task import estimates
from scan2flex_jax.sweep.task import NOT_CONVERGED, Task

_STARTS = {"both": slice(None), "guess": slice(1)}


def minima(
    study: Study,
    change: Callable | None = None,
    *,
    noise: float | None = None,
    starts: str = "both",
    distance: str = "normal",
    elements: int = FIT_ELEMENTS,
) -> Task:
    """A task that finds the minimum of ``change(study, sample)``; without ``change`` a sample gives guesses: ``guess_NAME``.

    Outputs: each unknown in its own unit, ``rms`` (m), ``cost`` and ``iterations``. A sample that did not converge has none:
    its status says so.

    Args:
        study: One cable; its ``fit`` poses need a centre curve or markers.
        change: May change guesses, poses, curves and noise, but not what is unknown, nor the tolerances, effects or number of
            poses: such samples are refused, and `fits` takes them.
        noise: Standard deviation of one coordinate (m), the weight of residuals against priors; by default the stated one.
        starts: "both" begins, as `fit` does, where the shapes fit better: at the guess or at the package's own start, and at
            the other one too in doubt; "guess" begins at the guess alone.
        distance: Of curves: "normal" or "integrated".
        elements: Elements of the rod.

    Raises:
        Scan2FlexError: As `traced_problem`, or ``starts`` is none of these.
    """
    if starts not in _STARTS:
        raise Scan2FlexError(f"starts is {starts!r}: give one of {', '.join(_STARTS)}.")
    traced = partial(traced_problem, noise=noise, elements=elements, distance=distance)
    ready, _ = traced(study)
    slots = ready.function.layout.slots
    given, fixed = eqx.partition(ready, eqx.is_array_like)
    problem, shapes = Problem(study, elements, distance), _shapes(given)

    def of_guess(sample):
        both = problem.both_starts(guesses(study, sample))
        return {"starts": padded_starts(ready, both)[_STARTS[starts]]}

    own = change or guesses

    def of_change(sample):
        changed, both = traced(own(study, sample))
        arrays, other = eqx.partition(changed, eqx.is_array_like)
        if _shapes(arrays) != shapes or not eqx.tree_equal(other, fixed):
            raise Scan2FlexError(_OTHER)
        return {"starts": both[_STARTS[starts]], "problem": arrays}

    def one(sample):
        found = minimise(eqx.combine(sample.get("problem", given), fixed), sample["starts"])
        values = {s.name: s.value(found.x[s.at : s.at + s.size]) for s in slots}
        return values | {name: getattr(found, name) for name in ("rms", "cost", "iterations")}, _verdict(found)

    about = {"study": study, "change": own, "options": (noise, starts, distance, elements)}
    prepare = of_guess if change is None else of_change
    return Task(one, estimates(slots), traced=True, prepare=prepare, about=about)


_OTHER = "the sample has other unknowns, tolerances, effects or poses than the study: sweep over fits, which takes any study"


def _shapes(arrays):
    """Tree, shapes and types of the arrays, which are compiled."""
    leaves, tree = jax.tree.flatten(arrays)
    return tree, [(np.shape(x), np.asarray(x).dtype) for x in leaves]


def _verdict(found) -> Verdict:
    """Of the worst pose; of the descent where all poses are solved."""
    v = found.verdict
    code = jnp.where((v.code == SOLVED) & ~found.converged, NOT_CONVERGED, v.code)
    return Verdict(code, v.out_of_balance, v.negative, found.evaluations)
