"""Which physics the model lacks: the residual of a fit, the effect that explains it, and the error before and after."""

from scan2flex_jax.explain.plan import Plan, plan
from scan2flex_jax.explain.result import Explanation, PoseChange, Ranked
from scan2flex_jax.explain.run import explain

__all__ = ["Explanation", "Plan", "PoseChange", "Ranked", "explain", "plan"]
