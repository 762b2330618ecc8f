"""What a rod solver is: from a discrete rod and a start to a configuration at rest.

`MixedNewton` (`newton`) is the default, `ScaledMinimiser` (`scaled`) lets any optimistix minimiser solve rods. A solver of
one's own is a subclass of `AbstractRodSolver`, given as ``equilibrium(..., solver=MySolver())``.
"""

import abc

import equinox as eqx
from jax import Array
from jaxtyping import Bool, Int

from scan2flex_jax.rod.assembly import Derivatives
from scan2flex_jax.rod.model import Configuration, Rod


class Settled(eqx.Module):
    """What a rod solver returns.

    ``configuration``: the nodes, supported ends included. ``derivatives``: gradient (N, N m) and Hessian blocks at that
    configuration, of the energy itself (no damping, no predicted forces); the verdict and all derivatives of the
    equilibrium rest on them. ``negative``: negative pivots of that Hessian. ``steps``: the solver's steps. ``exhausted``:
    whether it stopped for want of steps; ``derivatives`` may then belong to the step before.
    """

    configuration: Configuration
    derivatives: Derivatives
    negative: Int[Array, ""]
    steps: Int[Array, ""]
    exhausted: Bool[Array, ""]


class AbstractRodSolver(eqx.Module):
    """Base of all rod solvers: fields hold the tolerances, `settle` solves."""

    @abc.abstractmethod
    def settle(self, rod: Rod, start: Configuration, max_steps: int | None) -> Settled:
        """The rod at rest, on the branch of ``start``, in at most ``max_steps`` steps (None: the solver's own allowance).

        ``rod`` and ``start`` carry no derivatives: those of the equilibrium are made from the answer, so `settle` need not be
        differentiable. It is traced under `jax.jit` and `jax.vmap`, and never raises for a rod that it cannot solve.
        """
