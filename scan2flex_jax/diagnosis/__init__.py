"""Missing physics: test of the residual of a fit, search for the effect that explains it, and the error before and after."""

from scan2flex_jax.diagnosis.ahead import AheadCompiler
from scan2flex_jax.diagnosis.memory import MemoryTest, memory_test
from scan2flex_jax.diagnosis.planning import Candidate, Plan, plan
from scan2flex_jax.diagnosis.result import Explanation, PoseChange, Ranked
from scan2flex_jax.diagnosis.run import explain
from scan2flex_jax.diagnosis.settings import DiagnosisSettings

__all__ = ["AheadCompiler", "Candidate", "DiagnosisSettings", "Explanation", "MemoryTest", "Plan", "PoseChange", "Ranked"]
__all__ += ["explain", "memory_test", "plan"]
