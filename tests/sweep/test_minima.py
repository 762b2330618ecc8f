"""Minima of many fits in one program: those of the fits alone, none for a sample that did not converge."""

from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting.problem import Problem
from scan2flex_jax.study import Tolerance
from scan2flex_jax.sweep import draws, failed, grid, minima, noisy, sweep
from scan2flex_jax.sweep.task import NOT_CONVERGED, REFUSED
from tests.fitting import scenes

pytestmark = pytest.mark.slow
ELEMENTS = 20
STIFF = ("bending_stiffness", "torsional_stiffness")


@pytest.fixture(scope="module")
def study():
    return scenes.study_of(poses=("plane", "twist-90"))


def samples(*values):
    """Samples with these guesses of EI and GJ (N m^2)."""
    columns = zip(STIFF, np.transpose(values), strict=True)
    return draws(**{f"guess_{name}": (column, "N m^2") for name, column in columns})


def values(found):
    return np.stack([found[name].values for name in STIFF], axis=-1)


def test_guesses_lead_to_the_minimum_of_the_fit_or_to_none(study):
    task = minima(study, starts="guess", elements=ELEMENTS)
    found = sweep(task, samples((0.05, 0.5), (100.0, 0.01), (0.3, 0.1)), chunk=2)
    assert found["code"].values.tolist() == [0, NOT_CONVERGED, 0]
    assert failed(found) == {"draw=1": "the fit did not converge"}
    minimum = np.exp(Problem(study, ELEMENTS).minimise("least-squares").shared)
    np.testing.assert_allclose(values(found)[[0, 2]], [minimum, minimum], rtol=1e-3)  # held weakly where each begins
    for name in (*STIFF, "rms", "cost", "iterations"):
        assert np.isnan(found[name].values[1]) and np.all(np.isfinite(found[name].values[[0, 2]]))
    assert found["rms"].units == "m" and found["bending_stiffness"].units == "N m^2"


def test_curves_with_noise_and_what_cannot_share_the_program(study):
    """A sample with other tolerances is refused alone; the others are the minima of their own studies."""

    def change(study, sample):
        rough = noisy(study, 1e-3, int(sample["seed"]))
        return replace(rough, tolerance=Tolerance(length=1e-3)) if sample["seed"] == 2 else rough

    found = sweep(minima(study, change, elements=ELEMENTS), grid(seed=[1.0, 2.0, 3.0]))
    assert found["code"].values.tolist() == [0, REFUSED, 0]
    assert "sweep over fits" in failed(found)["seed=2"]
    for k, seed in ((0, 1), (2, 3)):
        alone = Problem(noisy(study, 1e-3, seed), ELEMENTS).minimise("least-squares")
        np.testing.assert_allclose(values(found)[k], np.exp(alone.shared), rtol=1e-8)
        np.testing.assert_allclose(found["cost"].values[k], alone.cost, rtol=1e-8)


def test_other_starts_are_one_sentence(study):
    with pytest.raises(Scan2FlexError, match="starts is 'own': give one of both, guess"):
        minima(study, starts="own")
