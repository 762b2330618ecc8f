"""Inference: from measured shapes to estimates with intervals, and to the physics that the model lacks.

One generative model: `program` (poses as a function of all parameters), `rows` (measured points), `priors`, `likelihood`,
`posterior` (a hypothesis at its mode), `determined` (what the poses determine), `settings` (every number that decides).
`fitting` is the sequence of `fit`: `mesh`, `branches` (full turns), `mistakes` (of the input), `belief`,
`estimate`, `law`, `influence`, `fit_result`, `answer`. `explaining` is that of `explain`: `variants`,
`search`, `decision`, `quantities`, `words`, `explanation`. `planning`: the next pose; `expecting`: what
poses will tell; `memory`: the test over orders of poses.
"""

from scan2flex_jax.inference.estimate import Estimate
from scan2flex_jax.inference.expecting import Expectation, Visible, expect
from scan2flex_jax.inference.explaining import explain
from scan2flex_jax.inference.explanation import Explanation, Hypothesis, PoseChange, Ranked
from scan2flex_jax.inference.fit_result import Fit, PoseFit
from scan2flex_jax.inference.fitting import METHODS, fit
from scan2flex_jax.inference.law import Law, Reading
from scan2flex_jax.inference.memory import MemoryTest, memory_test
from scan2flex_jax.inference.planning import Candidate, Plan, plan
from scan2flex_jax.inference.settings import Settings

__all__ = ["METHODS", "Candidate", "Estimate", "Expectation", "Explanation", "Fit", "Hypothesis", "Law", "MemoryTest", "Plan"]
__all__ += ["PoseChange", "PoseFit", "Ranked", "Reading", "Settings", "Visible", "expect", "explain", "fit"]
__all__ += ["memory_test", "plan"]
