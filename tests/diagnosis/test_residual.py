"""The whitened residual of one law, as the model changes."""

from dataclasses import replace

import numpy as np
import pytest
from reference import rotations

from scan2flex_jax.diagnosis.residual import Complement, turned, whiten
from scan2flex_jax.diagnosis.sensitivity import Bench, Numbers
from scan2flex_jax.fitting import fit
from scan2flex_jax.fitting.discrepancy import usual_size
from scan2flex_jax.fitting.noise import Noise

from . import scenes

STEP = 1e-4  # of a logarithm


def test_normals_that_differ_by_a_turn_about_the_tangent_give_the_same_rows():
    rng = np.random.default_rng(0)
    onto = np.stack([rotations.exp(v) for v in rng.normal(size=(5, 3))])  # rows: two normals and the tangent
    rows = rng.normal(size=(5, 3, 2))
    spun = np.stack([rotations.about([0.0, 0.0, 1.0], a) for a in (0.0, 0.3, -1.2, 2.9, -3.1)])
    np.testing.assert_allclose(turned(spun @ rows, spun @ onto, onto), rows, atol=1e-14)
    tilt = np.stack([rotations.exp([a, b, 0.0]) for a, b in rng.normal(size=(5, 2))])  # the smallest turn of a tangent
    np.testing.assert_allclose(turned(spun @ rows, spun @ tilt @ onto, onto), rows, atol=1e-14)


@pytest.fixture(scope="module")
def curved():
    """A naturally curved cable fitted as a straight one: bench, parameters, shapes and the law of the residual."""
    fitted = fit(scenes.study(natural_curvature=(0.0, 1.0, 0.0)))
    bench = Bench(fitted.problem, fitted.minimum)
    vector = np.r_[fitted.minimum.shared, np.asarray(fitted.minimum.local).ravel()]
    numbers, shapes = Numbers(bench, ()), bench.shapes((), vector)
    scatter = bench.scatter((), vector, bench.start)
    complement = Complement(shapes, bench.real, numbers, vector, (), bench.context.length, scatter=scatter)
    law = complement.law(Noise(scenes.NOISE, scenes.NOISE, 0.1), usual_size(bench.start), scatter)
    assert law.curvature > 0
    return bench, vector, shapes, law


def error(curved, law):
    """Of each whitened column against central differences of the whitened residual, over the norm of the column."""
    bench, vector, shapes, _ = curved
    numbers, found = Numbers(bench, ()), []

    def white(x):
        return whiten(bench.shapes((), x), bench.real, numbers, x, law)

    J = whiten(shapes, bench.real, numbers, vector, law).J
    for k, e in enumerate(STEP * np.eye(len(vector))):
        change = (white(vector + e).r - white(vector - e).r) / (2 * STEP)
        found.append(np.linalg.norm(change - J[:, k]) / np.linalg.norm(J[:, k]))
    return found


def test_the_columns_are_the_derivatives_of_the_residual_under_one_law(curved):
    """The cost of a descent under a law is least where these are orthogonal to the residual. Evaluated at the arc lengths and
    normals of each model, the covariance changes with the parameters by more than the residual does."""
    *_, law = curved
    assert max(error(curved, law)) < 1e-3
    assert min(error(curved, replace(law, places=()))) > 1.0
