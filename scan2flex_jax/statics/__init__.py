"""Static equilibrium: starts, solvers, the solution with its status, and its derivatives."""

from scan2flex_jax.statics.balance import DEFAULT_ELEMENTS
from scan2flex_jax.statics.newton import MixedNewton
from scan2flex_jax.statics.scaled import ScaledMinimiser
from scan2flex_jax.statics.solve import Equilibrium, equilibrium, solve_rod
from scan2flex_jax.statics.solver import AbstractRodSolver, Settled
from scan2flex_jax.statics.verdict import SENTENCES, Verdict

__all__ = [
    "DEFAULT_ELEMENTS",
    "SENTENCES",
    "AbstractRodSolver",
    "Equilibrium",
    "MixedNewton",
    "ScaledMinimiser",
    "Settled",
    "Verdict",
    "equilibrium",
    "solve_rod",
]
