"""Validate poses that a refitted law cannot solve from the measured curve are continued from the baseline model."""

from types import SimpleNamespace

import numpy as np

from scan2flex_jax.diagnosis import report
from scan2flex_jax.diagnosis.refit import Refit
from scan2flex_jax.diagnosis.residual import Law
from scan2flex_jax.diagnosis.sensitivity import Component
from scan2flex_jax.fitting.noise import Noise
from scan2flex_jax.rod.model import Configuration
from scan2flex_jax.statics.verdict import MAX_STEPS_REACHED, SOLVED

REACH = 0.3  # of an amplitude, that a solve of the stub goes in one stride


class Stub:
    """A bench of two poses: the first is always solved, the second only from the solution of an amplitude near by."""

    prior = SimpleNamespace(at=np.zeros(0, int), mean=np.zeros(0), std=np.zeros(0))
    layout = SimpleNamespace(shared=1, local=0, prior=prior)
    poses = SimpleNamespace(count=2)

    def shapes(self, components, vector, start=None, derivative=True):
        amplitude, out = vector[1], []
        for i in range(2):
            before = 0.0 if start is None else start.r[i, 0, 0]
            ok = i == 0 or abs(amplitude - before) < REACH
            at = amplitude if ok else before
            configuration = Configuration(np.full((1, 3), at), np.eye(3)[None])
            verdict = SimpleNamespace(code=np.array(SOLVED if ok else MAX_STEPS_REACHED))
            out.append(SimpleNamespace(verdict=verdict, residual=np.zeros((1, 3)), configuration=configuration))
        return out


def refit(components, vector):
    return Refit(
        components=components, vector=np.array(vector), shapes=[], cost=0.0, chi2=0.0, log_marginal=0.0, log_evidence=0.0,
        covariance=np.zeros((0, 0)), converged=True, law=Law(Noise(1.0, 1.0, 1.0)),
    )  # fmt: skip


def solved(shapes):
    return [int(shape.verdict.code) == SOLVED for shape in shapes]


def test_a_pose_that_is_not_solved_is_continued_from_the_plain_rod():
    bench, plain = Stub(), refit((), [0.5])
    law = refit((Component("scan_scale", {}),), [0.7, 1.0])
    assert solved(report.predicted(bench, law)) == [True, False]
    shapes = report.predicted(bench, law, plain)
    assert solved(shapes) == [True, True]
    assert shapes[1].configuration.r[0, 0] == 1.0
