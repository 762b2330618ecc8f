"""Status of a solve, from the out-of-balance forces, the inertia of the Hessian and the mesh, independent of the solver."""

import equinox as eqx
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int

from scan2flex_jax.geometry.small import diagonal
from scan2flex_jax.rod.model import Rod
from scan2flex_jax.rod.support import lost
from scan2flex_jax.statics.balance import BALANCE, imbalance
from scan2flex_jax.statics.solver import Settled

TURN = 2.0  # rad between neighbouring nodes, above which the mesh cannot resolve the sense of the rotation
SKEW = 0.5  # largest non-constitutive shear of an element's chord; above it the mesh is too coarse (error 1e-2 L at 0.8)

SOLVED, MAX_STEPS_REACHED, NON_FINITE, UNSTABLE, UNBALANCED, TOO_COARSE, OFF_SUPPORT = range(7)
SENTENCES = {
    SOLVED: "stable equilibrium",
    MAX_STEPS_REACHED: "no equilibrium found within the allowed steps",
    NON_FINITE: "the solve met values that are not finite",
    UNSTABLE: "the equilibrium found is unstable",
    UNBALANCED: "the forces do not balance",
    TOO_COARSE: f"an element turns by more than {TURN} rad or is longer than the bends: more elements are needed",
    OFF_SUPPORT: "the cable does not cross a knife edge exactly once: it has slid off, or winds about it",
}


class Verdict(eqx.Module):
    """Status of a solve.

    ``code`` is one of the module's codes (0 solved); ``out_of_balance`` the largest residual force and moment on a node over
    the largest that the rod carries (-); ``negative`` the number of directions of negative curvature of the energy; ``steps``
    the number of solver steps. Scalars for one rod, with leading axes for a batch.
    """

    code: Int[Array, "*batch"]
    out_of_balance: Float[Array, "*batch"]
    negative: Int[Array, "*batch"]
    steps: Int[Array, "*batch"]

    @property
    def solved(self) -> Bool[Array, "*batch"]:
        """Whether this is a stable equilibrium."""
        return self.code == SOLVED

    @property
    def stable(self) -> Bool[Array, "*batch"]:
        """Whether the Hessian has no negative direction."""
        return self.negative == 0

    def sentence(self) -> str:
        """The status in words (of one rod, not of a batch)."""
        return SENTENCES[int(self.code)]


def judge(rod: Rod, found: Settled) -> Verdict:
    """Status of a solver's result."""
    d, c = found.derivatives, found.configuration
    left = imbalance(rod, d)
    turn = jnp.max(jnp.linalg.norm(d.elements.x[:, 3:], axis=1))
    shear = d.elements.x[:, :2] / rod.section.ds - rod.section.natural[:, :2]
    rigidity = diagonal(rod.section.stiffness)[:, :2]
    skew = jnp.max(jnp.abs(shear - d.elements.n[:, :2] / rigidity))
    finite = jnp.isfinite(left) & jnp.all(jnp.isfinite(c.r))
    code = jnp.select(  # during the iteration any element may be skew
        [~finite, turn > TURN, lost(rod, c.r), found.exhausted, skew > SKEW, found.negative > 0, ~(left < BALANCE)],
        [NON_FINITE, TOO_COARSE, OFF_SUPPORT, MAX_STEPS_REACHED, TOO_COARSE, UNSTABLE, UNBALANCED],
        SOLVED,
    )
    return Verdict(code, left, found.negative, found.steps)
