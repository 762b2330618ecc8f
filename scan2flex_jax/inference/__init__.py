"""Inference: hypotheses about a study, one generative model with one score for all of them, and the decisions of `explain`.

`program`: poses as a function of all parameters; `rows`: measured points; `priors`, `likelihood`: the model; `posterior`: a
hypothesis at its mode; `search`, `variants`: what is tried; `decision`, `settings`: eight decisions and every number in them;
`quantities`, `result`, `words`: what is reported; `run`: the sequence of `explain`; `planning`: the next pose; `memory`: the
test over the order of poses.
"""

from scan2flex_jax.inference.memory import MemoryTest, memory_test
from scan2flex_jax.inference.planning import Candidate, Plan, plan
from scan2flex_jax.inference.result import Explanation, Hypothesis, PoseChange, Ranked
from scan2flex_jax.inference.run import explain
from scan2flex_jax.inference.settings import ExplainSettings

__all__ = ["Candidate", "ExplainSettings", "Explanation", "Hypothesis", "MemoryTest", "Plan", "PoseChange", "Ranked"]
__all__ += ["explain", "memory_test", "plan"]
