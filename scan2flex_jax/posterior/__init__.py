"""What the data say: one generative model, the hypotheses about what it lacks, and the decision between them.

`program` (poses as a function of all parameters), `rows` (measured points), `priors`, `likelihood`, `posterior` (a hypothesis
at its mode), `determined` (what the poses determine), `quantities` and `profile` (estimates with intervals, `law`, `loops`),
`branches` (full turns), `search` and its record (`recorded`), `belief`, `decision`, `settings` (every number that decides).
"""
