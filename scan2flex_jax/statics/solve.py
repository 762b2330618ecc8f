"""Static equilibrium with its status, section forces and derivatives.

`solve_rod` solves a discrete rod; `equilibrium` discretises a cable between its supports and calls `solve_rod`. Derivatives
of any order come from the implicit function theorem at the solution (`implicit`), forward, reverse and batched; the solve
itself is not differentiated.
"""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jax import Array
from jaxtyping import Float, Int

from scan2flex_jax.compilation import compiled, composed
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.geometry import lie
from scan2flex_jax.geometry.small import matmul, matvec, vecmat
from scan2flex_jax.rod.assembly import out_of_balance, section_forces
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.energy import potential_energy, strains
from scan2flex_jax.rod.memory import Left, left_by, memories, remembering
from scan2flex_jax.rod.model import CableModel, Configuration, Rod, discretise
from scan2flex_jax.rod.support import AbstractSupport, Guide, support_reactions
from scan2flex_jax.statics.arguments import check_start, whole_number
from scan2flex_jax.statics.balance import DEFAULT_ELEMENTS, FEWEST_ELEMENTS
from scan2flex_jax.statics.implicit import settled
from scan2flex_jax.statics.kernel.solver import default_solver
from scan2flex_jax.statics.scaled import ScaledMinimiser
from scan2flex_jax.statics.solver import AbstractRodSolver, Steps
from scan2flex_jax.statics.verdict import SENTENCES, Verdict, judge

Solver = AbstractRodSolver | optx.AbstractMinimiser | None


class Equilibrium(eqx.Module):
    """A static equilibrium of a rod. Every field except the verdict is differentiable."""

    rod: Rod
    configuration: Configuration
    verdict: Verdict

    @property
    def s(self) -> Float[Array, " nodes"]:
        """Arc length of the nodes (m)."""
        return self.rod.node_s

    @property
    def points(self) -> Float[Array, "nodes 3"]:
        """Nodes of the centre line (m)."""
        return self.configuration.r

    @property
    def energy(self) -> Float[Array, ""]:
        """Potential energy (J)."""
        return _energy(self.configuration, self.rod)

    @property
    def observed(self) -> Float[Array, "nodes 3"]:
        """Nodes of the centre line as the scanner sees them (m)."""
        points = self.configuration.r
        for effect in self.rod.effects:
            points = effect.observe(points)
        return points

    def section_forces(self) -> tuple[Float[Array, " n"], Float[Array, "n 3"], Float[Array, "n 3"]]:
        """``(s, f, m)``: midpoints of the elements (m), force (N) and moment (N m) on the section there, in the scan frame.

        They are exerted by the part after the section on the part before it (paper, Eq. 3).
        """
        return self.rod.section.s, *_section_forces(self.rod, self.configuration)

    def reactions(self) -> tuple[Float[Array, "2 3"], Float[Array, "2 3"]]:
        """``(force, moment)`` of the supports on start and end, N and N m, scan frame."""
        return _reactions(self.rod, self.configuration)

    def support_reactions(self) -> tuple[tuple[int, Float[Array, ""], Float[Array, "3"]], ...]:
        """Of each support between the ends: its place among the effects, the arc length that it holds (m), and its force (N) on
        the cable in the scan frame."""
        places = [i for i, effect in enumerate(self.rod.effects) if isinstance(effect, AbstractSupport)]
        at, force = _support_reactions(self.rod, self.configuration) if places else ((), ())
        return tuple(zip(places, at, force, strict=True))

    def leaves(self, held: Float[Array, ""] | float = 0.0) -> Left:
        """State of every effect with memory when the pose is left after ``held`` (s); empty without such effects."""
        return _left(self.rod, self.configuration, jnp.asarray(held, float))


_energy = compiled(potential_energy)


@compiled
def _section_forces(rod, configuration):
    r, R = configuration
    n = section_forces(rod, configuration)

    def half(R0, r0, r1, R1):
        x = lie.se3_log(vecmat(r1 - r0, R0), matmul(R0.T, R1))
        return matmul(R0, lie.so3_exp(0.5 * x[3:]))

    middle = jax.vmap(half)(R[:-1], r[:-1], r[1:], R[1:])
    return matvec(middle, n[:, :3]), matvec(middle, n[:, 3:])


@compiled
def _left(rod, configuration, held):
    return left_by(rod, strains(rod, configuration) - rod.section.natural, held)


_support_reactions = compiled(support_reactions)


@compiled
def _reactions(rod, configuration):
    rod = replace(rod, effects=tuple(e for e in rod.effects if not isinstance(e, Guide)))  # what they hold, the support exerts
    ends = jnp.array([0, -1])
    R, g = configuration.R[ends], out_of_balance(rod, configuration)[ends]
    return matvec(R, g[:, :3]), matvec(R, g[:, 3:])


def solve_rod(
    rod: Rod,
    start: Configuration | None = None,
    *,
    turns: Int[Array, ""] | int = 0,
    solver: Solver = None,
    max_steps: Steps = None,
    throw: bool = False,
) -> Equilibrium:
    """The static equilibrium of a discrete rod (paper, Section 5: (x, q0, qL) -> q*).

    Differentiable to any order in every array of ``rod``.

    Args:
        rod: Sections, loads and supports, from `discretise`.
        start: Initial configuration, which selects the branch; by default a sag along the resultant of the dead loads.
        turns: Full turns of twist of the default start.
        solver: `MixedNewton` (default; compiled on a GPU, or where `statics.kernel` is installed), another `AbstractRodSolver`,
            or an optimistix minimiser, which is run by `ScaledMinimiser`, each with its own tolerances.
        max_steps: Largest number of steps; None is the solver's default.
        throw: Raise if the solve fails. Otherwise the failure stands in the `Verdict` of the result, so that one rod of a
            batch does not affect the others.

    Returns:
        Nodes, section forces, reactions, and the status of the solve.

    Raises:
        Scan2FlexError: Arguments of a wrong shape; with ``throw``, a failed solve (under `jax.jit` equinox's own error).
    """
    whole_number(rod.elements, "the number of elements of the rod", FEWEST_ELEMENTS)
    check_start(start, rod.elements + 1, turns)
    found = _solve_rod(rod, start, turns, _rod_solver(solver), _allowed(max_steps))
    return _raised(found) if throw else found


def equilibrium(
    model: CableModel,
    boundary: Boundary,
    *,
    start: Configuration | None = None,
    turns: Int[Array, ""] | int = 0,
    elements: int = DEFAULT_ELEMENTS,
    solver: Solver = None,
    max_steps: int | None = None,
    throw: bool = False,
    after: Equilibrium | None = None,
    held: Float[Array, ""] | float = 0.0,
) -> Equilibrium:
    """The static equilibrium of ``model`` between the supports of ``boundary``: `solve_rod` of ``elements`` elements.

    Differentiable to any order in every array of ``model`` and ``boundary``.

    Args:
        model: Cable, gravity and effects.
        boundary: The supports of both ends.
        start: Initial configuration, which selects the branch; by default a sag along gravity.
        turns: Full turns of twist of the default start.
        elements: Elements of the rod.
        solver: `MixedNewton` (default), another `AbstractRodSolver`, or an optimistix minimiser.
        max_steps: Largest number of steps; None is the solver's default.
        throw: Raise if the solve fails; otherwise the failure stands in the verdict of the result.
        after: The pose before, for a model with memory (`friction`, `relaxation`); by default this is the first pose.
        held: How long (s) the pose before was held.

    Returns:
        Nodes (m), section forces (N) and moments (N m), reactions, and the status of the solve.

    Raises:
        Scan2FlexError: Arguments of a wrong shape; with ``throw``, a failed solve (under `jax.jit` equinox's own error).

    Examples:
        >>> cable = Cable(length=1.0, length_density=0.2, bending_stiffness=0.1, torsional_stiffness=0.25)
        >>> along_x = [0.5, 0.5, 0.5, 0.5]
        >>> clamps = Boundary.of(([0, 0, 0], along_x), ([0.6, 0, 0], along_x))
        >>> e = equilibrium(CableModel(cable, gravity=[0.0, 0.0, -9.81]), clamps)
        >>> bool(e.verdict.solved), round(float(e.points[20, 2]), 2)
        (True, -0.35)
    """
    elements = whole_number(elements, "elements", FEWEST_ELEMENTS)
    check_start(start, elements + 1, turns)
    model = model if after is None else _following(model, after, held, elements)
    found = _equilibrium(model, boundary, start, turns, elements, _rod_solver(solver), _allowed(max_steps))
    return _raised(found) if throw else found


def _following(model, after, held, elements):
    """The model with the state that the pose before left."""
    kinds = [[type(m) for m in memories(effects)] for effects in (model.effects, after.rod.effects)]
    if kinds[0] != kinds[1] or after.rod.elements != elements:
        raise Scan2FlexError("after is an equilibrium of another model or mesh: give the pose before of this one.")
    return CableModel(model.cable, model.gravity, remembering(model.effects, after.leaves(held)))


@composed
def _equilibrium(model, boundary, start, turns, elements, solver, max_steps):
    return _solved(_discretised(model, boundary, elements), start, turns, model.gravity, solver, max_steps)


@composed
def _solve_rod(rod, start, turns, solver, max_steps):
    return _solved(rod, start, turns, jnp.sum(rod.load.force, axis=0), solver, max_steps)


def _solved(rod, start, turns, down, solver, max_steps):
    start, down = jax.lax.stop_gradient((start, down))
    found = settled(rod, start, turns, down, solver, max_steps)
    return Equilibrium(rod, found.configuration, _judged(*jax.lax.stop_gradient((rod, found))))


_discretised, _judged = compiled(discretise), compiled(judge)


def _raised(found: Equilibrium) -> Equilibrium:
    """The equilibrium; raises if the solve failed."""
    code = found.verdict.code
    if not isinstance(code, jax.core.Tracer):
        bad = [int(c) for c in code.ravel() if c != 0]
        if bad:
            raise Scan2FlexError(f"the rod was not solved: {SENTENCES[bad[0]]}")
        return found
    sentences = [f"the rod was not solved: {SENTENCES[i]}" for i in range(1, len(SENTENCES))]
    return eqx.branched_error_if(found, code != 0, code - 1, sentences)


def _allowed(max_steps: Steps) -> Steps:
    return max_steps if max_steps is None or isinstance(max_steps, jax.Array) else whole_number(max_steps, "max_steps")


def _rod_solver(solver: object) -> AbstractRodSolver:
    """The rod solver for a user's ``solver``: None, a rod solver, or an optimistix minimiser."""

    if solver is None:
        return default_solver()
    if isinstance(solver, AbstractRodSolver):
        return solver
    if isinstance(solver, optx.AbstractMinimiser):
        return ScaledMinimiser(solver)
    raise Scan2FlexError(
        f"solver is {type(solver).__name__}: give None, an AbstractRodSolver (MixedNewton, ScaledMinimiser), or an optimistix"
        " minimiser such as optimistix.BFGS(rtol=1e-8, atol=1e-8)"
    )
