"""Interface of a rod solver: from a discrete rod and a start to a static equilibrium.

`MixedNewton` (`newton`) is the default; `ScaledMinimiser` (`scaled`) runs any optimistix minimiser. A user's own solver
is a subclass of `AbstractRodSolver`, passed as ``equilibrium(..., solver=MySolver())``.
"""

import abc

import equinox as eqx
from jax import Array
from jaxtyping import Bool, Int

from scan2flex_jax.rod.assembly import Derivatives
from scan2flex_jax.rod.model import Configuration, Rod

Steps = int | Int[Array, ""] | None


class Settled(eqx.Module):
    """Result of a rod solver.

    ``configuration``: the nodes, supported ends included. ``derivatives``: gradient (N, N m) and Hessian blocks at that
    configuration, of the energy itself (no damping, no predicted forces), from which the status and all derivatives of the
    equilibrium are computed. ``negative``: negative pivots of that Hessian. ``steps``: number of steps. ``exhausted``:
    whether the step limit was reached; ``derivatives`` may then belong to the step before.
    """

    configuration: Configuration
    derivatives: Derivatives
    negative: Int[Array, ""]
    steps: Int[Array, ""]
    exhausted: Bool[Array, ""]


class AbstractRodSolver(eqx.Module):
    """Base of all rod solvers: fields hold the tolerances, `settle` solves."""

    @abc.abstractmethod
    def settle(self, rod: Rod, start: Configuration, max_steps: Steps) -> Settled:
        """The equilibrium on the branch of ``start``, in at most ``max_steps`` steps (None: the solver's default).

        ``rod`` and ``start`` carry no derivatives: those of the equilibrium are computed from the result, so `settle` need
        not be differentiable. It is traced under `jax.jit` and `jax.vmap`, and never raises for a rod that it cannot solve.
        """
