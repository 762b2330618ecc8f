"""The whitened residual of one law, as the model changes."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from reference import rotations

from scan2flex_jax.diagnosis.residual import Complement, Law, turned, whiten
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


def test_a_photograph_says_nothing_of_the_residual_across_its_plane():
    """Whichever way the normals of a model turn along the cable, as those of one that buckles out of the plane do."""
    s, rng = np.linspace(0.0, 1.0, 9), np.random.default_rng(1)
    turns, real = rng.uniform(-3.0, 3.0, (2, len(s))), np.ones(len(s), bool)
    plane = np.column_stack([np.sin(2.0 * s), np.zeros_like(s)])  # in the plane and across it

    def rows(angle, across):
        c, sn = np.cos(angle), np.sin(angle)
        axes = np.zeros((len(s), 3, 3))  # rows: the normals, turned about the tangent y, and the tangent
        axes[:, 0, 0], axes[:, 0, 2], axes[:, 1, 0], axes[:, 1, 2], axes[:, 2, 1] = c, -sn, sn, c, 1.0
        residual = np.einsum("mij,mj->mi", axes, np.column_stack([plane[:, 0], np.zeros_like(s), across]))
        shape = SimpleNamespace(s=s, residual=residual, axes=axes, marked=None)
        (metric,) = Law(Noise(1e-3, 2e-3, 0.1), across=np.array([0.0, 0.0, 1.0])).metrics([shape], [real])
        assert metric.rows == len(s)
        return metric.white(residual[:, :, None])[:, 0]

    first = np.abs(rows(turns[0], np.zeros_like(s)))
    for angle, across in ((np.zeros_like(s), np.zeros_like(s)), (turns[1], 5.0 * s)):
        np.testing.assert_allclose(np.abs(rows(angle, across)), first, atol=1e-9 * np.max(first))


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
