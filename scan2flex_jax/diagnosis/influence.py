"""Sensitivities of the estimates given the effects of a refit, to first order, as in `fitting.influence`."""

import numpy as np

from scan2flex_jax.diagnosis.prior import Prior
from scan2flex_jax.diagnosis.refit import Refit, configurations
from scan2flex_jax.diagnosis.residual import whiten
from scan2flex_jax.diagnosis.sensitivity import Bench, Numbers
from scan2flex_jax.diagnosis.stage import Stage
from scan2flex_jax.fitting.influence import Influence, Linear, changed_studies, influence_of


def influence_of_refit(stage: Stage, found: Refit) -> Influence:
    """The influence at a refit, with its effects and its law of the residual; solves all poses twice more."""
    bench, problem = stage.bench, stage.bench.problem
    numbers, prior = Numbers(bench, found.components), Prior(bench, found.components, found.wider)
    white = whiten(found.shapes, bench.real, numbers, found.vector, found.law)
    precision = prior.precision + prior.width
    precision[numbers.nuisance] = 0.0  # their priors are rows of J
    held = prior.frozen | (found.vector <= prior.low) | (found.vector >= prior.high)
    J = np.where(held, 0.0, white.J)
    linear = Linear(white.r, J, tuple(white.rows), np.where(held, 1.0, precision))
    changes = {}
    for name, study, step in changed_studies(problem.study):
        other = Bench(problem.with_study(study), bench.minimum)
        shapes = other.shapes(found.components, found.vector, configurations(found.shapes))
        if all(int(s.verdict.code) == 0 and np.all(np.isfinite(s.residual)) for s in shapes):
            moved = [(new.residual - old.residual)[:, :, None] for new, old in zip(shapes, found.shapes, strict=True)]
            changes[name] = white.stack(moved)[:, 0] / step

    def distance(i, r):
        return float(np.sqrt(white.squares(i, r) / len(white.metrics[i].factor)))

    logs = problem.logs()[: problem.layout.unknowns]
    poses = [p.name for p in problem.study.fit_poses]
    return influence_of(linear, problem.layout.labels, logs, poses, distance, changes)
