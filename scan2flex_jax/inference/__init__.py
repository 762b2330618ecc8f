"""Inference: from measured shapes to estimates with intervals, and to the physics that the model lacks.

The commands: `fitting` (`fit`) and `explaining` (`explain`, with its `variants`), `mesh` and `mistakes` (stages of both),
`planning` (the next pose), `expecting` (what poses will tell), `memory` (the test over orders of poses). What the data say of a
hypothesis is in `posterior`, what is said to the user in `results`.
"""

from scan2flex_jax.inference.expecting import Expectation, Visible, expect
from scan2flex_jax.inference.explaining import explain
from scan2flex_jax.inference.fitting import METHODS, fit
from scan2flex_jax.inference.memory import MemoryTest, memory_test
from scan2flex_jax.inference.planning import Candidate, Plan, plan
from scan2flex_jax.posterior.estimate import Estimate
from scan2flex_jax.posterior.law import Law, Reading
from scan2flex_jax.posterior.settings import Settings
from scan2flex_jax.results.explanation import Explanation, Hypothesis, PoseChange, Ranked
from scan2flex_jax.results.fit_result import Fit, PoseFit

__all__ = ["METHODS", "Candidate", "Estimate", "Expectation", "Explanation", "Fit", "Hypothesis", "Law", "MemoryTest", "Plan"]
__all__ += ["PoseChange", "PoseFit", "Ranked", "Reading", "Settings", "Visible", "expect", "explain", "fit"]
__all__ += ["memory_test", "plan"]
