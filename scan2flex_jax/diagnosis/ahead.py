"""Compilation ahead of time: the functions of the search, compiled in a thread during the baseline fit.

XLA releases Python's lock while it compiles, so on two cores most of this compilation costs no time. A library call must not
start threads unasked: the caller makes an `AheadCompiler` and passes it to `explain`, as the command line does. The functions
run once, on one pose of the study with placeholder values. The baseline fit itself compiles the evaluation of a pose
(`slots.empty_slots_of`), which the search reuses.
"""

import threading
from concurrent.futures import Future
from dataclasses import replace
from typing import Any

import numpy as np

from scan2flex_jax.diagnosis.gates import mesh_error
from scan2flex_jax.diagnosis.sensitivity import Bench, all_components
from scan2flex_jax.fitting.evaluate import Evaluation
from scan2flex_jax.fitting.least_squares import Minimum
from scan2flex_jax.fitting.parameters import layout_of
from scan2flex_jax.fitting.problem import FIT_ELEMENTS, Problem
from scan2flex_jax.study.model import Study


class AheadCompiler:
    """Compiles the functions of `explain` in threads, once for all studies that share them.

    A thread in XLA cannot be stopped, and the interpreter waits for it at exit.
    """

    def __init__(self) -> None:
        """No compilation is started yet."""
        self._begun: dict[tuple, Future[None]] = {}

    def start(self, study: Study, elements: int = FIT_ELEMENTS, *, mesh: bool = True) -> None:
        """Start compiling for studies like this one, unless already started; returns at once."""
        key = _compiled_by(study, elements, mesh)
        if key in self._begun:
            return
        work = self._begun[key] = Future()
        one = replace(study, poses=study.fit_poses[:1])
        threading.Thread(target=_run, args=(work, one, elements, mesh)).start()  # a daemon in XLA aborts the exit

    def wait(self, study: Study, elements: int = FIT_ELEMENTS, *, mesh: bool = True) -> None:
        """Wait for the compilation for studies like this one. Call it before running the same functions, which would otherwise
        be compiled a second time. Re-raises an exception of the thread; a function left out compiles at its first run."""
        work = self._begun.get(_compiled_by(study, elements, mesh))
        if work is not None:
            work.result()


def _compiled_by(study: Study, elements: int, mesh: bool) -> tuple:
    """Key of the compiled functions."""
    acting = study.acting(study.fit_poses[0] if study.fit_poses else None)
    return layout_of(study), tuple(effect.kind for effect in acting), study.clamped_ends, elements, mesh


def _run(work: Future, study: Study, elements: int, mesh: bool) -> None:
    try:
        _run_through(study, elements, mesh)
    except Exception as fault:
        work.set_exception(fault)
    else:
        work.set_result(None)


def _run_through(study: Study, elements: int, mesh: bool) -> None:
    """Run each function of a diagnosis once."""
    problem = Problem(study, elements)
    minimum = _anywhere(problem)
    bench, vector = Bench(problem, minimum), np.r_[minimum.shared, minimum.local.ravel()]
    bench.catalogue_tangents(vector, all_components(bench.context), problem.poses.start, 0)
    if mesh:
        mesh_error(problem, minimum)


def _anywhere(problem: Problem) -> Minimum:
    """A placeholder for the fit: the measured curves."""
    poses, layout = problem.poses, problem.layout
    shared = np.r_[problem.starts()[-1], np.zeros(layout.shared - layout.unknowns)]
    nothing = np.zeros((poses.count, poses.mask.shape[1], 3))
    unknown: Any = None  # no status
    evaluation = Evaluation(nothing, None, np.asarray(poses.expected), poses.start, unknown)
    return Minimum(shared, np.zeros((poses.count, layout.local)), evaluation, np.inf, 0, False)
