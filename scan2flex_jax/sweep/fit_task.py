"""Fits as the task of a sweep: from other guesses, with other clamps, noise or tolerances, per sample."""

from collections.abc import Callable
from functools import partial

import numpy as np

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting.parameters import layout_of
from scan2flex_jax.fitting.problem import FIT_ELEMENTS
from scan2flex_jax.inference import fit
from scan2flex_jax.statics.verdict import SOLVED
from scan2flex_jax.study.model import Study
from scan2flex_jax.study.sense import check_study
from scan2flex_jax.sweep.changes import guesses
from scan2flex_jax.sweep.task import NOT_CONVERGED, Outcome, Output, Task

_BARS = {"std": np.inf, "low": -np.inf, "high": np.inf}  # of a fit without an error bar: NaN is reserved for failures


def fits(
    study: Study,
    change: Callable | None = None,
    method: str = "least-squares",
    *,
    distance: str = "normal",
    elements: int = FIT_ELEMENTS,
) -> Task:
    """A task that fits ``change(study, sample)``; without ``change`` a sample gives guesses: ``guess_bending_stiffness``, ...

    Outputs: each unknown in its own unit, its ``_std``, ``_low`` and ``_high`` (95 %; infinite for a fit without an error
    bar), ``rms`` and ``rms_validate`` (m; infinite if a validation pose failed to solve), ``cost``, ``equilibria``,
    ``iterations``.
    """
    check_study(study)
    slots = layout_of(study).slots
    if not slots:
        raise Scan2FlexError("the study declares nothing under [unknown]: there is nothing to fit")
    own = change or guesses
    options = {"method": method, "distance": distance, "elements": elements}
    about = {"study": study, "change": own, "options": options}
    return Task(partial(_fitted, study, own, options), _outputs(study, slots), about=about)


def _fitted(study, change, options, sample) -> Outcome:
    """The numbers of a `Fit` and its status; the estimates are kept even if it did not converge."""
    f, values = fit(change(study, sample), **options), {}
    for name, e in f.estimates.items():
        values[name] = e.value
        for bar, unknown in _BARS.items():
            x = getattr(e, bar)
            values[f"{name}_{bar}"] = np.full(np.shape(e.value), unknown) if x is None else x
    values |= {"rms": f.rms(), "cost": f.cost, "equilibria": f.equilibria, "iterations": f.minimum.iterations}
    if f.study.validate_poses:
        rms = f.rms("validate")
        values["rms_validate"] = rms if np.isfinite(rms) else np.inf
    code = SOLVED if f.converged else NOT_CONVERGED
    stable = all(p.stable for p in f.poses.values() if p.role == "fit")
    left = float(np.max(f.minimum.evaluation.verdict.out_of_balance))
    return Outcome(values, code, stable=stable, steps=f.equilibria, out_of_balance=left)


def estimates(slots: tuple) -> dict[str, Output]:
    """What every fit gives: the unknowns, how near the shapes are, and the cost."""
    out = {s.name: Output(s.unit, (f"{s.name}_part",) if s.shape else (), f"estimate of {s.name}") for s in slots}
    out["rms"] = Output("m", (), "root mean square distance of the fitted poses")
    out["cost"] = Output("-", (), "weighted squares of residuals and priors")
    return out | {"iterations": Output("-", (), "iterations of all descents")}


def _outputs(study, slots) -> dict[str, Output]:
    out = estimates(slots)
    for slot in slots:
        out |= {f"{slot.name}_{bar}": Output(slot.unit, out[slot.name].dims) for bar in _BARS}
    out["equilibria"] = Output("-", (), "equilibria solved")
    if study.validate_poses:
        out["rms_validate"] = Output("m", (), "root mean square distance of the poses that were not fitted")
    return out
