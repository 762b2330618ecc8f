"""The number of elements of a fit, such that none is longer than the bends of its cable (`statics.mesh`).

The stiffness, and so the length of the bends, is known only after the fit: it is repeated with more elements where the bends of
its result, or of its start if no pose of it could be solved, are too short for those that it had.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from scan2flex_jax.errors import NotSettledError
from scan2flex_jax.fitting import mistakes
from scan2flex_jax.fitting.branches import ASTRAY, distances
from scan2flex_jax.fitting.evaluate import one
from scan2flex_jax.fitting.least_squares import Minimum, Progress
from scan2flex_jax.fitting.parameters import model_at
from scan2flex_jax.fitting.problem import FIT_ELEMENTS, Problem
from scan2flex_jax.statics.mesh import Mesh, shortest_bend
from scan2flex_jax.study.mistakes import Mistake


def mesh_at(problem: Problem, shared: np.ndarray) -> Mesh:
    """The elements of a problem, and the shortest bend of its poses at shared numbers."""
    bends = []
    for poses in [problem.poses, *([problem.held_out] if problem.held_out else [])]:
        for i in sorted({poses.group.index(g) for g in poses.group}):
            model = model_at(problem.layout, poses.template(i), jnp.asarray(shared))
            boundary = jax.tree.map(jnp.asarray, one(poses.boundary, i))
            bends.append((float(shortest_bend(model, boundary)), float(model.cable.length)))
    bend, length = min(bends, key=lambda pair: pair[0] / pair[1])
    return Mesh(problem.elements, length, bend)


class Found(NamedTuple):
    """Result of a stage of a fit: the problem, its minimum, likely mistakes of the input, and a sentence on turns that are
    about as likely, if there are any."""

    problem: Problem
    minimum: Minimum
    mistakes: tuple[Mistake, ...] = ()
    doubt: str = ""


Stage = Callable[[Problem, Found | None], Found]
"""A stage of a fit: from the problem, and the result of the stage before, to its own result."""


def on_enough_elements(
    make: Callable[[int], Problem], stages: Sequence[Stage], elements: int | None, progress: Progress
) -> tuple[Found, Mesh]:
    """The result of the last of ``stages``, with the `Mesh`.

    With ``elements`` None the stages begin anew with more elements if the bends at the result of one need them; with a number,
    that many are used. ``make(n)`` is the problem with ``n`` elements. Raises `NotSettledError`, with a likely mistake of the
    input if there is one.
    """
    n, solved = elements or FIT_ELEMENTS, 0
    while True:
        problem = make(n)
        problem.evaluator.equilibria = solved
        found, problem, mesh = _through(stages, problem, elements is None, progress)
        if found is not None:
            return found, mesh
        n, solved = mesh.enough, problem.evaluator.equilibria
        progress(f"again with {n} elements")


def _through(stages, problem, refining, progress) -> tuple[Found | None, Problem, Mesh]:
    """``(result, problem, mesh)`` of the last stage; of the stage that needs more elements, None in place of its result."""
    found = None
    for stage in stages:
        try:
            found = stage(problem, found)
        except NotSettledError as fault:
            mesh = _mesh_of_starts(problem)
            if not refining or mesh.enough <= problem.elements:
                raise (_too_limp(fault, mesh) or mistakes.instead_of(fault, problem, progress)) from fault
            return None, problem, mesh
        problem, mesh = found.problem, mesh_at(found.problem, found.minimum.shared)
        if refining and mesh.enough > problem.elements and _worth(found, stage is stages[-1]):
            return None, problem, mesh
    return found, problem, mesh


def _too_limp(fault: NotSettledError, mesh: Mesh) -> NotSettledError | None:
    """The fault of a cable whose bends are shorter than the elements, which no correction of the input solves."""
    if mesh.size <= mesh.bend:
        return None
    stiff = f"write a stiffness {(mesh.size / mesh.bend) ** 2:.2g} times as large or more"
    advice = f"the cable is too limp for {mesh.elements} elements: {stiff}, which moves a hanging cable only near its clamps"
    return NotSettledError(fault.sentence, advice, fault.reasons)


def _worth(found: Found, last: bool) -> bool:
    """Whether the values of a stage are worth a finer mesh: those of a minimum far from the curves are not while a later stage
    may find another, nor those of a study with mistakes."""
    near = np.all(distances(found.minimum.evaluation, found.problem.poses.mask) < ASTRAY * found.problem.length)
    return not found.mistakes and (last or bool(near))


def _mesh_of_starts(problem: Problem) -> Mesh:
    """The mesh of a problem that could not be solved, with the shortest bend at the starts of its fit."""
    nuisance = np.zeros(problem.layout.shared - problem.layout.unknowns)
    return min((mesh_at(problem, np.r_[x, nuisance]) for x in problem.starts()), key=lambda mesh: mesh.bend)
