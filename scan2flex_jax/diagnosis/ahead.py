"""Compiling ahead: what a diagnosis will run beyond its plain fit, compiled in a thread beside that fit.

XLA compiles outside of Python's lock, so on two cores most of the loop's compilation costs the user no time. A thread is a side
effect that a library call must not have: whoever wants it makes an `AheadCompiler` and hands it to `explain`, as the command
line does. The work is done on one pose of the study at values of no meaning. The evaluation of a pose itself is compiled by
the fit (`slots.empty_slots_of`), and serves the search as it is.
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
    """Compiles in threads what `explain` needs; once for all studies that share what is compiled.

    A thread in XLA cannot be stopped, and the interpreter waits for it at exit.
    """

    def __init__(self) -> None:
        """Nothing is compiled yet."""
        self._begun: dict[tuple, Future[None]] = {}

    def start(self, study: Study, elements: int = FIT_ELEMENTS, *, mesh: bool = True) -> None:
        """Begin compiling for studies like this one, unless that was begun before; returns at once."""
        key = _compiled_by(study, elements, mesh)
        if key in self._begun:
            return
        work = self._begun[key] = Future()
        one = replace(study, poses=study.fit_poses[:1])
        threading.Thread(target=_run, args=(work, one, elements, mesh)).start()  # a daemon in XLA aborts the exit

    def wait(self, study: Study, elements: int = FIT_ELEMENTS, *, mesh: bool = True) -> None:
        """Wait for what was begun for studies like this one, before the same functions are run: one that is compiled twice at
        once is compiled twice. Raises what the work raised; whatever it left uncompiled is compiled when it is first run."""
        work = self._begun.get(_compiled_by(study, elements, mesh))
        if work is not None:
            work.result()


def _compiled_by(study: Study, elements: int, mesh: bool) -> tuple:
    """What the compiled functions depend on."""
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
    """The functions of a diagnosis, once each."""
    problem = Problem(study, elements)
    minimum = _anywhere(problem)
    bench, vector = Bench(problem, minimum), np.r_[minimum.shared, minimum.local.ravel()]
    bench.catalogue_tangents(vector, all_components(bench.context), problem.poses.start, 0)
    if mesh:
        mesh_error(problem, minimum)


def _anywhere(problem: Problem) -> Minimum:
    """The measured curves themselves in place of a fit."""
    poses, layout = problem.poses, problem.layout
    shared = np.r_[problem.starts()[-1], np.zeros(layout.shared - layout.unknowns)]
    nothing = np.zeros((poses.count, poses.mask.shape[1], 3))
    unknown: Any = None  # no verdict
    evaluation = Evaluation(nothing, None, np.asarray(poses.expected), poses.start, unknown)
    return Minimum(shared, np.zeros((poses.count, layout.local)), evaluation, np.inf, 0, False)
