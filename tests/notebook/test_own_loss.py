"""A study as a traced function, for a loss of one's own."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from scan2flex_jax import Scan2FlexError, boundary_of, equilibrium, fit, load_study, model_of, residual_function
from scan2flex_jax.examples import example_path

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def study():
    return load_study(example_path("simulated-cable"))


@pytest.fixture(scope="module")
def ready(study):
    return residual_function(study)


@pytest.fixture(scope="module")
def result(study):
    return fit(study)


def test_residuals_are_those_of_the_fit(ready, result):
    """At the fit's estimates, each point's distance is the fit's."""
    function, _ = ready
    x = jnp.log(jnp.array([float(result.estimates[name].value) for name in function.values(np.zeros(2))]))
    distances = jnp.linalg.norm(function(x).reshape(-1, 3), axis=1)
    expected = np.concatenate([np.linalg.norm(p.residual, axis=1) for p in result.poses.values() if p.role == "fit"])
    np.testing.assert_allclose(distances, expected, atol=1e-7)


def test_labels_name_every_number(ready):
    function, start = ready
    assert function.labels == ("log bending_stiffness", "log torsional_stiffness")
    assert start.shape == (2,)
    values = function.values(start)
    assert set(values) == {"bending_stiffness", "torsional_stiffness"}
    assert values["bending_stiffness"] == pytest.approx(np.exp(start[0]))


def test_a_loss_of_ones_own_is_differentiated(ready):
    function, start = ready

    def huber(x):
        d = jnp.linalg.norm(function(x).reshape(-1, 3) + 1e-9, axis=1) / 1e-3
        return jnp.sum(jnp.where(d < 1.0, 0.5 * d**2, d - 0.5))

    (_, slope), h = jax.value_and_grad(huber)(start), 1e-4
    e = jnp.array([1.0, 0.0])
    assert slope[0] == pytest.approx(float((huber(start + h * e) - huber(start - h * e)) / (2 * h)), rel=1e-4)


def test_a_noise_brings_in_the_priors(study):
    near = replace(study, tolerance=replace(study.tolerance, length=1e-3, gravity=0.01, clamp_rotation=0.01))
    plain, start = residual_function(near)
    scaled, more = residual_function(near, noise=2e-3)
    count = len(near.fit_poses)
    assert len(more) == len(start) + 3 + 12 * count == len(scaled.labels)
    points = plain(start)
    both = scaled(more.at[len(start)].set(0.0))
    np.testing.assert_allclose(both[: len(points)], points / 2e-3, rtol=1e-9)
    moved = scaled(more.at[len(start)].set(1.5))
    np.testing.assert_allclose(moved[len(points) :], np.eye(len(more) - len(start))[0] * 1.5)
    assert np.abs(moved[: len(points)] - both[: len(points)]).max() > 0.01


def test_a_pose_that_has_no_equilibrium_is_turned_down(ready):
    function, start = ready
    limp = start - 20.0
    assert not np.all(function.verdicts(limp).solved)
    assert np.isinf(jnp.sum(function(limp) ** 2))


def test_model_and_supports_of_a_study(study, result):
    known = result.calibrated
    model, boundary = model_of(known), boundary_of(known.poses[0])
    e = equilibrium(model, boundary, turns=study.poses[0].turns)
    assert e.verdict.solved
    assert float(model.cable.length) == study.cable["length"]


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"distance": "nearest"}, "distance is 'nearest': give one of closest, integrated"),
        ({"noise": -1.0}, "noise is -1.0: give a positive number in m"),
    ],
)
def test_wrong_options_are_one_sentence(study, options, sentence):
    with pytest.raises(Scan2FlexError, match=sentence):
        residual_function(study, **options)


def test_a_vector_of_another_length_is_one_sentence(ready):
    with pytest.raises(Scan2FlexError, match=r"x has shape \(3,\): give 2 numbers"):
        ready[0](jnp.zeros(3))
