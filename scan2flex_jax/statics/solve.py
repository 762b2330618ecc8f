"""The answer: a static equilibrium with its verdict, its section forces and its derivatives.

Derivatives of an equilibrium come from the implicit function theorem at the solution (`rod.assembly.newton_correction`):
forward, reverse and batched, with one factorisation that is already there, and a Jacobian for P parameters costs one
back-substitution with P right-hand sides. They are first derivatives; the solve itself is not differentiated.
"""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jax import Array
from jaxtyping import Bool, Float, Int

from scan2flex_jax.compilation import compiled
from scan2flex_jax.geometry import lie
from scan2flex_jax.geometry.small import matmul, matvec, vecmat
from scan2flex_jax.rod.assembly import derivatives, newton_correction, out_of_balance, section_forces
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.energy import potential_energy, supported
from scan2flex_jax.rod.model import CableModel, Configuration, Rod, discretise
from scan2flex_jax.statics import blocktridiagonal as bt
from scan2flex_jax.statics.newton import MixedNewton
from scan2flex_jax.statics.reference import bfgs_configuration
from scan2flex_jax.statics.starts import sagging_start

DEFAULT_ELEMENTS = 40
MAX_STEPS = 200
BALANCE = 1.0e-6  # scaled out-of-balance force of a solved rod; Newton leaves 1e-9, rounding with 2,000 elements 1e-8
_ROUNDING = 1.0e-8  # force, over the axial stiffness, that positions rounded to 1e-16 leave at a tolerance of BALANCE
TURN = 2.0  # rad between neighbouring nodes beyond which the mesh cannot tell one way round from the other
SKEW = 0.5  # slope of an element's chord beyond what shear does: elements longer than the bends, and 1e-2 L off at 0.8

SOLVED, MAX_STEPS_REACHED, NON_FINITE, UNSTABLE, UNBALANCED, TOO_COARSE = range(6)
SENTENCES = {
    SOLVED: "stable equilibrium",
    MAX_STEPS_REACHED: "no equilibrium found within the allowed steps",
    NON_FINITE: "the solve met values that are not finite",
    UNSTABLE: "the equilibrium found is unstable",
    UNBALANCED: "the forces do not balance",
    TOO_COARSE: f"an element turns by more than {TURN} rad or is longer than the bends: more elements are needed",
}


class Verdict(eqx.Module):
    """How well a rod was solved.

    ``code`` is one of the module's codes (0 solved); ``out_of_balance`` the largest force and moment left on a node, over
    the largest that the rod carries (-); ``negative`` the number of directions in which the energy falls; ``steps`` the
    solver's steps.
    """

    code: Int[Array, ""]
    out_of_balance: Float[Array, ""]
    negative: Int[Array, ""]
    steps: Int[Array, ""]

    @property
    def solved(self) -> Bool[Array, ""]:
        """Whether this is a stable equilibrium."""
        return self.code == SOLVED

    @property
    def stable(self) -> Bool[Array, ""]:
        """Whether the Hessian has no negative direction."""
        return self.negative == 0

    def sentence(self) -> str:
        """The verdict in words (of one rod, not of a batch)."""
        return SENTENCES[int(self.code)]


class Equilibrium(eqx.Module):
    """A static equilibrium of a rod. Everything but the verdict carries derivatives."""

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
        return potential_energy(self.configuration, self.rod)

    @property
    def observed(self) -> Float[Array, "nodes 3"]:
        """Nodes of the centre line as the scanner sees them (m)."""
        points = self.configuration.r
        for effect in self.rod.effects:
            points = effect.observe(points)
        return points

    def section_forces(self):
        """``(s, f, m)``: middles of the elements (m), force (N) and moment (N m) on the section there, in the scan frame.

        They act on the part before the section and are exerted by the part after it (paper, Eq. 3).
        """
        r, R = self.configuration
        n = section_forces(self.rod, self.configuration)

        def half(R0, r0, r1, R1):
            x = lie.se3_log(vecmat(r1 - r0, R0), matmul(R0.T, R1))
            return matmul(R0, lie.so3_exp(0.5 * x[3:]))

        middle = jax.vmap(half)(R[:-1], r[:-1], r[1:], R[1:])
        return self.rod.section.s, *(matvec(middle, part) for part in (n[:, :3], n[:, 3:]))

    def reactions(self):
        """``(force, moment)`` of shape (2, 3), N and N m, scan frame: what the supports exert on start and end."""
        R = self.configuration.R[jnp.array([0, -1])]
        g = out_of_balance(self.rod, self.configuration)[jnp.array([0, -1])]
        return matvec(R, g[:, :3]), matvec(R, g[:, 3:])


@compiled
def equilibrium(
    model: CableModel,
    boundary: Boundary,
    *,
    start: Configuration | None = None,
    turns: Int[Array, ""] | int = 0,
    elements: int = DEFAULT_ELEMENTS,
    solver: MixedNewton | optx.BFGS | None = None,
    max_steps: int = MAX_STEPS,
) -> Equilibrium:
    """The static equilibrium of ``model`` between the supports of ``boundary`` (paper, Section 5: (x, q0, qL) -> q*).

    ``start`` pins the branch; left out, it is a generic sag with ``turns`` full turns of twist. ``solver`` is `MixedNewton`
    (default) or `optimistix.BFGS`, the reference (`statics.reference`). Never raises for a solve that fails: read the
    `Verdict`. Differentiable in every array of ``model`` and ``boundary``.
    """
    rod = discretise(model, boundary, elements)
    frozen, gravity = jax.lax.stop_gradient((rod, model.gravity))
    if start is None:
        start = sagging_start(frozen.boundary, frozen.length, gravity, turns, elements)
    start = jax.lax.stop_gradient(start)
    if isinstance(solver, optx.BFGS):
        c, steps = bfgs_configuration(frozen, start)
        result, d, steps = optx.RESULTS.successful, derivatives(frozen, c), sum(steps)
        negative = bt.factor(d.diagonal, d.upper).negative
    else:
        solver = MixedNewton() if solver is None else solver
        found: optx.Solution = optx.minimise(potential_energy, solver, start, frozen, max_steps=max_steps, throw=False)
        c, result, d, steps = found.value, found.result, found.state.last, found.stats["num_steps"]
        negative = found.state.negative
    c, d = jax.lax.stop_gradient((supported(frozen, c), d))
    return Equilibrium(rod, _implicit(rod, c, d), _judge(frozen, c, d, negative, result, steps))


@eqx.filter_custom_jvp
def _implicit(rod, configuration, d):
    """The configuration found; its derivative with respect to ``rod`` is the equilibrium's (`newton_correction`)."""
    return configuration


@_implicit.def_jvp
def _implicit_jvp(primals, tangents):
    rod, configuration, d = primals
    solve = partial(bt.solve, bt.factor(d.diagonal, d.upper))
    arrays, static = eqx.partition(rod, eqx.is_inexact_array)
    moving = jax.tree.map(lambda x, t: jnp.zeros_like(x) if t is None else t, arrays, tangents[0], is_leaf=lambda x: x is None)
    moving = jax.tree.map(lambda x, t: None if x is None else t, arrays, moving, is_leaf=lambda x: x is None)

    def corrected(a):
        return newton_correction(eqx.combine(a, static), configuration, solve)

    return configuration, jax.jvp(corrected, (arrays,), (moving,))[1]


def _judge(rod, c, d, negative, result, steps):
    """The verdict; see `Verdict`."""
    softest = jnp.min(jnp.diagonal(rod.section.stiffness, axis1=1, axis2=2)[:, 3:])
    n, left = jnp.abs(d.elements.n), jnp.abs(d.gradient)
    moment = jnp.max(n[:, 3:]) + 1e-3 * softest / rod.length
    stiffest = jnp.max(rod.section.stiffness[:, 2, 2]) * jnp.maximum(1.0, rod.elements / DEFAULT_ELEMENTS)
    force = _ROUNDING * stiffest + jnp.max(n[:, :3]) + jnp.max(jnp.abs(rod.load.force)) + moment / rod.length
    left = jnp.maximum(jnp.max(left[:, :3]) / force, jnp.max(left[:, 3:]) / (moment + force * rod.length))
    turn = jnp.max(jnp.linalg.norm(d.elements.x[:, 3:], axis=1))
    shear = d.elements.x[:, :2] / rod.section.ds - rod.section.natural[:, :2]
    rigidity = jnp.diagonal(rod.section.stiffness, axis1=1, axis2=2)[:, :2]
    skew = jnp.max(jnp.abs(shear - d.elements.n[:, :2] / rigidity))
    finite = jnp.isfinite(left) & jnp.all(jnp.isfinite(c.r))
    reached = result == optx.RESULTS.nonlinear_max_steps_reached
    code = jnp.select(
        [~finite, turn > TURN, reached, skew > SKEW, negative > 0, ~(left < BALANCE)],  # on the way any element may be skew
        [NON_FINITE, TOO_COARSE, MAX_STEPS_REACHED, TOO_COARSE, UNSTABLE, UNBALANCED],
        SOLVED,
    )
    return Verdict(code, left, negative, jnp.asarray(steps))
