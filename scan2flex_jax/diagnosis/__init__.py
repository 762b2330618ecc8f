"""Which physics the model lacks: the residual of a fit, the effect that explains it, and the error before and after."""

from scan2flex_jax.diagnosis.planning import Plan, plan
from scan2flex_jax.diagnosis.result import Explanation, PoseChange, Ranked
from scan2flex_jax.diagnosis.run import explain

__all__ = ["Explanation", "Plan", "PoseChange", "Ranked", "explain", "plan"]
