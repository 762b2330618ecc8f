"""Compiling ahead: what a diagnosis will run beyond its plain fit, compiled in a thread beside that fit.

XLA compiles outside of Python's lock, so on two cores most of the loop's compilation costs the user no time. The thread
works on one pose of the study at values of no meaning; whatever goes wrong there comes up again, in words, where it counts.
The evaluation of a pose itself is compiled by the fit (`slots.empty_slots_of`), and serves the search as it is.
"""

import contextlib
import threading
from dataclasses import replace
from typing import Any

import numpy as np

from scan2flex_jax.compilation import make_room
from scan2flex_jax.diagnosis.gates import mesh_error
from scan2flex_jax.diagnosis.sensitivity import Bench, all_components
from scan2flex_jax.fitting.evaluate import Evaluation
from scan2flex_jax.fitting.least_squares import Minimum
from scan2flex_jax.fitting.parameters import layout_of
from scan2flex_jax.fitting.run import FIT_ELEMENTS, Problem

_STARTED: dict[tuple, threading.Thread] = {}


def compile_ahead(study, elements: int = FIT_ELEMENTS, *, mesh: bool = True) -> threading.Thread:
    """Start compiling what `explain` needs for studies like this one; once per kind of study and process.

    Wait with ``join`` before running the same functions: a function compiled twice at once is compiled twice.
    """
    if not any(thread.is_alive() for thread in _STARTED.values()) and make_room():
        _STARTED.clear()
    key = (layout_of(study), tuple(e.kind for e in study.effects), study.clamped_ends, elements, mesh)
    if key not in _STARTED:
        one = replace(study, poses=study.fit_poses[:1])
        _STARTED[key] = threading.Thread(target=_run_through, args=(one, elements, mesh))  # a daemon in XLA aborts the exit
        _STARTED[key].start()
    return _STARTED[key]


def _run_through(study, elements, mesh):
    with contextlib.suppress(Exception):  # a thread's traceback would tell the user nothing that the fit does not say
        problem = Problem(study, elements)
        minimum = _anywhere(problem)
        bench, vector = Bench(problem, minimum), np.r_[minimum.shared, minimum.local.ravel()]
        bench.catalogue_tangents(vector, all_components(bench.context), problem.poses.start, 0)
        if mesh:
            mesh_error(problem, minimum)


def _anywhere(problem) -> Minimum:
    """The measured curves themselves in place of a fit."""
    poses, layout = problem.poses, problem.layout
    shared = np.r_[problem.starts()[-1], np.zeros(layout.shared - layout.unknowns)]
    nothing = np.zeros((poses.count, poses.mask.shape[1], 3))
    unknown: Any = None  # no verdict
    evaluation = Evaluation(nothing, None, poses.expected, poses.start, unknown)
    return Minimum(shared, np.zeros((poses.count, layout.local)), evaluation, np.inf, 0, False)
