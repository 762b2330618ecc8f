"""Static equilibrium: starts, solvers, the answer with its verdict, and its derivatives."""

from scan2flex_jax.statics.newton import MixedNewton
from scan2flex_jax.statics.solve import DEFAULT_ELEMENTS, SENTENCES, Equilibrium, Verdict, equilibrium

__all__ = ["DEFAULT_ELEMENTS", "SENTENCES", "Equilibrium", "MixedNewton", "Verdict", "equilibrium"]
