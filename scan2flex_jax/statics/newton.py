"""A structured Newton method for the rod.

Each step solves the block-tridiagonal system with the geometric stiffness at *predicted* section forces (mixed
stress-strain step, `rod.assembly`), so that the nearly rigid stretching does not shorten the steps. Negative curvature is
handled by adaptive regularisation. The factorisation gives the inertia of the Hessian; while it is indefinite, a bending
stiffness is added to all sections (never a stretching one, whose predicted forces must stay right) and reduced again as the
solve converges. A solve that makes two small steps while the unregularised Hessian has a negative direction has reached a
saddle (one such step can be due to badly predicted forces or to those of the start): it is pushed off along that direction,
towards the side of the start. A second right-hand side tracks the direction by inverse iteration. There is no line search:
the energy along the way carries little information in a curved valley, and stability is tested at the end.

Where one of bending and torsional stiffness is far below the others, the law of the elements (`rod.element_law`) is far from
convex at the strains of the first steps. Elements are then stiffer against strain variation until the steps are small
(`stiffened`): of 200 random cables with ratios up to 1e4, 198 are solved from the generic start, and 192 without it.
"""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int

from scan2flex_jax.geometry.small import diagonal, diagonal_matrix, matvec, vecmat
from scan2flex_jax.rod.assembly import (
    Derivatives,
    Elements,
    derivatives,
    free_motions,
    no_derivatives,
    strain_increment,
    to_nodes,
)
from scan2flex_jax.rod.energy import retract, supported
from scan2flex_jax.rod.model import Configuration, Rod
from scan2flex_jax.rod.support import supports
from scan2flex_jax.statics import blocktridiagonal as bt
from scan2flex_jax.statics.solver import AbstractRodSolver, Settled, Steps

MAX_STEPS = 200
_LONGEST = 0.8  # largest motion of one node in one step: rad, or relative to the length
_PUSH = 0.2  # the same for a push off a saddle
_SETTLED = 1.0e-2  # two steps below this at an indefinite Hessian indicate a saddle; a single one may be due to wrong forces
_LEFT = 0.03  # of the largest force: jump between elements at a solution, due to the use of half-way frames
_EVEN, _DOUBLED = 8.0, 38.0  # sum of the three stiffnesses over one, above which that one is raised, and where it is doubled
_ROTATION = (0.0, 0.0, 0.0, 1.0, 1.0, 1.0)
_HOLD = 1.0e-13  # stiffness that pins zero-energy modes, over the largest of the rod: above rounding, below physics
_FIRST, _GROW, _SHRINK, _NONE = 0.05, 4.0, 4.0, 1.0e-2  # regularising bending stiffness, in units of `lendable_stiffness`


class NewtonState(eqx.Module):
    """State between steps: the derivatives at the last configuration, predicted section forces and forces of supports, the
    softest mode, the regularising stiffness ``lent``, whether the last step that moved was small (``settling``), whether the
    elements have their ``own`` law or a stiffened one, and whether all is ``finite``. After the last step, which does not move,
    ``last`` belongs to the solution."""

    last: Derivatives
    forces: Float[Array, "n 6"]
    pulls: Float[Array, "supports 3"]
    mode: Float[Array, "nodes 6"]
    start: Float[Array, "nodes 3"]
    lent: Float[Array, ""]
    first: Bool[Array, ""]
    was_indefinite: Bool[Array, ""]
    settling: Bool[Array, ""]
    size: Float[Array, ""]
    own: Bool[Array, ""]
    negative: Int[Array, ""]
    done: Bool[Array, ""]
    finite: Bool[Array, ""]


class MixedNewton(AbstractRodSolver):
    """Newton's method with mixed stress-strain steps.

    Converged when an unregularised step with known section forces moved no node by more than ``atol`` (rad, or relative to
    the length): convergence is then quadratic, and the remaining error of the order of its square. The first step knows the
    forces if the start is close to a solution. A final step without motion checks that the Hessian is positive definite and
    leaves the derivatives at the solution in the state.
    """

    atol: float = 1.0e-7

    def settle(self, rod: Rod, start: Configuration, max_steps: Steps = None) -> Settled:
        """See `AbstractRodSolver.settle`; ``max_steps`` is `MAX_STEPS` unless given."""
        most = MAX_STEPS if max_steps is None else max_steps

        def unsettled(carry):
            _, state, steps = carry
            return ~state.done & (steps < most) & state.finite

        def advance(carry):
            y, state, steps = carry
            return *self.step(rod, y, state), steps + 1

        y, state, steps = jax.lax.while_loop(unsettled, advance, (start, self.begin(rod, start), jnp.array(0)))
        return Settled(supported(rod, y), state.last, state.negative, steps, ~state.done & state.finite)

    def begin(self, rod: Rod, start: Configuration) -> NewtonState:
        """State before the first step, with unknown section forces."""
        empty = no_derivatives(rod)
        wave = jnp.sin(jnp.arange(6.0 * (rod.elements + 1)) ** 2).reshape(-1, 6)
        no, one = jnp.array(False), jnp.array(1.0)
        return NewtonState(
            empty, empty.elements.n, jnp.zeros((len(supports(rod)), 3)), wave * free_motions(rod), start.r,
            0.0 * one, ~no, no, no, one, ~no, jnp.array(0), no, ~no,
        )  # fmt: skip

    def step(self, rod: Rod, y: Configuration, state: NewtonState) -> tuple[Configuration, NewtonState]:
        """One factorisation: a step if the Hessian is positive definite, more regularisation if not."""
        y = supported(rod, y)
        looking = state.size < self.atol
        within, own = stiffened(rod, state.own)
        law = eqx.tree_at(lambda r: r.section.within, rod, within)
        predicted = partial(self._forces, rod, y, state, looking), lambda own: jnp.where(looking, own, state.pulls)
        d = derivatives(law, y, state.lent * lendable_stiffness(rod), *predicted)
        # rounding must not dominate a zero-energy mode (a rod that spins between ball joints)
        diagonal = d.diagonal + _hold(rod, d.diagonal) + _lent_hold(rod, state.lent)
        followed = lent_forces(rod, lendable_stiffness(rod), d.elements, state.mode) * free_motions(rod)
        both, negative = bt.factor_and_solve(diagonal, d.upper, jnp.stack([-d.gradient, followed], axis=-1))
        twist, mode = both[..., 0], both[..., 1]
        mode = mode / _size(rod, mode)
        size = _size(rod, twist)
        definite = (negative == 0) & jnp.isfinite(size)
        done = looking & definite
        small = size < _SETTLED
        close = _handed_on(rod, y, d.elements.n)
        known = ~state.first | close
        push = definite & state.was_indefinite & small & state.settling
        newton = definite & ~push & (state.lent == 0.0) & known
        home = jnp.sum(mode[:, :3] * vecmat(state.start - y.r, y.R))
        push_twist = jnp.where(home < 0, -_PUSH, _PUSH) * mode
        twist = jnp.where(push, push_twist, jnp.minimum(1.0, _LONGEST / size) * twist)
        twist = jnp.where(definite & ~done, twist, 0.0)
        moved = retract(y, twist)
        increment = matvec(d.elements.K, strain_increment(rod, d.elements, twist))
        less = jnp.where(state.lent < _NONE, 0.0, state.lent / _SHRINK)
        state = NewtonState(
            last=d,
            forces=jnp.where(definite, d.elements.n + increment, state.forces),
            pulls=jnp.where(definite, d.springs.forces(twist), state.pulls) if d.springs else state.pulls,
            mode=jnp.where(jnp.isfinite(mode), mode, state.mode),
            start=state.start,
            lent=jnp.where(definite, less, jnp.maximum(_GROW * state.lent, _FIRST)),
            first=state.first & ~definite,
            was_indefinite=~definite,
            settling=jnp.where(definite, small & ~push, state.settling),
            size=jnp.where(newton & own, size, 1.0),
            own=jnp.where(state.first, close, state.own) | (newton & small),
            negative=negative,
            done=done,
            finite=jnp.all(jnp.isfinite(moved.r)) & jnp.all(jnp.isfinite(moved.R)),
        )
        return moved, state

    @staticmethod
    def _forces(rod, y, state, looking, n):
        """Section forces of the geometric stiffness: those of the strains at a solution and close to one; at another start
        without those of stretching, which there carry no information."""
        of_start = jnp.where(_handed_on(rod, y, n), n, n.at[:, :3].set(0.0))
        return jnp.where(looking, n, jnp.where(state.first, of_start, state.forces))


def _handed_on(rod, y, n):
    """Whether forces are continuous across elements up to the dead load between them, as they are close to a solution."""
    f = 0.5 * (matvec(y.R[:-1], n[:, :3]) + matvec(y.R[1:], n[:, :3]))
    left = f[1:] - f[:-1] + rod.load.force[1:-1]
    return jnp.max(jnp.abs(left), initial=0.0) <= _LEFT * jnp.max(jnp.abs(f))


def stiffened(rod: Rod, own: Bool[Array, ""]) -> tuple[Float[Array, "n 3 3"], Bool[Array, ""]]:
    """``(stiffness, own)``: stiffness against strain variation (N m^2), larger than that of the elements where one component is
    far below the others, or their own if ``own``; and whether it is their own."""
    within = jnp.asarray(rod.section.within)
    parts = diagonal(within)
    excess = jnp.sum(parts, axis=1, keepdims=True) / parts - _EVEN
    more = jnp.where(own, 0.0, parts * jnp.maximum(excess / (_DOUBLED - _EVEN), 0.0) ** 4)
    return within + diagonal_matrix(more), jnp.all(more == 0.0)


def lendable_stiffness(rod: Rod) -> Float[Array, "6 6"]:
    """Bending and torsional stiffness (N m^2) of the size of the softer one, plus a tenth of weight times squared length."""
    own = jnp.mean(diagonal(rod.section.stiffness)[:, 3:], axis=0).min()
    weight = jnp.sum(jnp.linalg.norm(rod.load.force, axis=1)) * rod.length**2
    return diagonal_matrix(jnp.array(_ROTATION)) * (own + 0.1 * weight)


def _hold(rod, diagonal):
    """Small stiffness that lifts zero-energy modes above rounding. It is equal for rad and for displacement relative to an
    element, since turning stretches an element by no more: a nearly inextensible rod is far softer in turning."""
    ds = rod.section.ds
    unit = jnp.array([1.0, 1.0, 1.0, ds, ds, ds]) / ds
    largest = jnp.max(jnp.abs(diagonal) / jnp.outer(unit, unit))
    return _HOLD * largest * diagonal_matrix(unit**2)


def _lent_hold(rod, lent):
    """Regularisation of the rigid motions that supports along the cable leave free, which no bending stiffness raises: springs
    (N/m, N m/rad) on the nodes that carry what the lent bending stiffness does over the length. None between clamps."""
    if not supports(rod):
        return 0.0
    L = rod.length
    unit = jnp.array([1.0, 1.0, 1.0, L, L, L]) / L
    return lent * lendable_stiffness(rod)[5, 5] / (L * (rod.elements + 1)) * diagonal_matrix(unit**2)


def lent_forces(
    rod: Rod, stiffness: Float[Array, "6 6"], elements: Elements, mode: Float[Array, "nodes 6"]
) -> Float[Array, "nodes 6"]:
    """Forces of the regularising ``stiffness`` under a motion of the nodes. With them inverse iteration follows the motion of
    largest energy decrease per bending, not one that merely costs little energy, such as spinning."""
    far = vecmat(matvec(stiffness, strain_increment(rod, elements, mode)), elements.T)
    return to_nodes(-vecmat(far, elements.A), far)


def _size(rod, twist):
    """Largest motion of a node: rad, or relative to the length."""
    return jnp.maximum(jnp.max(jnp.abs(twist[:, :3])) / rod.length, jnp.max(jnp.abs(twist[:, 3:])))
