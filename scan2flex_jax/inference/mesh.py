"""The number of elements of a fit, such that none is longer than the bends of its cable (`statics.mesh`).

The stiffness, and so the length of the bends, is known only after the fit: it is repeated with more elements where the bends of
its result, or of its start if no pose of it could be solved, are too short for those that it had. The error of the mesh that
remains would pass for missing physics: `explain` solves the shapes of a fit with twice the elements (`mesh_error`).
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from scan2flex_jax.compilation import lightly_compiled
from scan2flex_jax.errors import NotSettledError
from scan2flex_jax.fitting.evaluate import one
from scan2flex_jax.fitting.least_squares import Minimum, Progress
from scan2flex_jax.fitting.parameters import boundary_at, model_at
from scan2flex_jax.fitting.problem import FIT_ELEMENTS, Problem
from scan2flex_jax.fitting.threads import each_pose
from scan2flex_jax.inference import mistakes
from scan2flex_jax.posterior.branches import ASTRAY, distances
from scan2flex_jax.posterior.settings import Settings
from scan2flex_jax.rod.memory import remembering
from scan2flex_jax.rod.model import CableModel
from scan2flex_jax.statics.mesh import Mesh, shortest_bend
from scan2flex_jax.statics.solve import equilibrium
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
    make: Callable[[int], Problem], stages: Sequence[Stage], elements: int | None, progress: Progress, settings: Settings
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
        found, problem, mesh = _through(stages, problem, elements is None, progress, settings)
        if found is not None:
            return found, mesh
        n, solved = mesh.enough, problem.evaluator.equilibria
        progress(f"again with {n} elements")


def _through(stages, problem, refining, progress, settings) -> tuple[Found | None, Problem, Mesh]:
    """``(result, problem, mesh)`` of the last stage; of the stage that needs more elements, None in place of its result."""
    found = None
    for stage in stages:
        try:
            found = stage(problem, found)
        except NotSettledError as fault:
            mesh = _mesh_of_starts(problem)
            if not refining or mesh.enough <= problem.elements:
                raise mistakes.instead_of(fault, problem, progress, settings, _too_limp(fault, mesh)) from fault
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
    near = np.all(distances(found.minimum.evaluation, found.problem.poses) < ASTRAY * found.problem.length)
    return not found.mistakes and (last or bool(near))


def _mesh_of_starts(problem: Problem) -> Mesh:
    """The mesh of a problem that could not be solved, with the shortest bend at the starts of its fit."""
    nuisance = np.zeros(problem.layout.shared - problem.layout.unknowns)
    return min((mesh_at(problem, np.r_[x, nuisance]) for x in problem.starts()), key=lambda mesh: mesh.bend)


def mesh_error(problem, minimum) -> np.ndarray:
    """Largest displacement (m) of a node of each pose with twice the elements; NaN without an equilibrium."""
    before = problem.evaluator.states_before(minimum.shared, minimum.local, minimum.evaluation.configuration)

    def of_pose(i):
        model = model_at(problem.layout, problem.poses.template(i), jnp.asarray(minimum.shared))
        if before[i]:  # each half of an element has the history of the whole
            halves = tuple(np.repeat(left, 2, axis=0) for left in before[i])
            model = CableModel(model.cable, model.gravity, remembering(model.effects, halves))
        stated = jax.tree.map(jnp.asarray, one(problem.poses.boundary, i))
        boundary = boundary_at(problem.layout, stated, jnp.asarray(minimum.local[i]))
        c = one(minimum.evaluation.configuration, i)
        e = _equilibrium(model, boundary, _doubled(c), 2 * problem.elements)
        error = np.max(np.linalg.norm(np.asarray(e.points)[::2] - c.r, axis=1))
        return error if bool(e.verdict.solved) else np.nan

    return np.array(each_pose(of_pose, problem.poses.count))


@lightly_compiled
def _equilibrium(model, boundary, start, elements):
    return equilibrium(model, boundary, start=start, elements=elements)


def _doubled(c):
    """The configuration with a node added at the middle of each element."""
    a, b = Rotation.from_matrix(c.R[:-1]), Rotation.from_matrix(c.R[1:])
    r, R = (np.repeat(x, 2, axis=0)[:-1] for x in (c.r, c.R))
    r[1::2], R[1::2] = 0.5 * (c.r[:-1] + c.r[1:]), (a * (a.inv() * b) ** 0.5).as_matrix()
    return type(c)(r, R)
