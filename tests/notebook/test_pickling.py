"""What a notebook sends to other processes, or keeps in a file: results, studies, cables and errors are pickled and copied."""

import copy
import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from scan2flex_jax import Boundary, Cable, CableModel, StudyError, equilibrium, fit, load_study
from scan2flex_jax.errors import NotSettledError
from scan2flex_jax.examples import example_path
from tests.reporting.scenes import explained

WAYS = {"pickle": lambda thing: pickle.loads(pickle.dumps(thing)), "deepcopy": copy.deepcopy}


@pytest.fixture(params=WAYS.values(), ids=WAYS)
def again(request):
    """A way to a second one of a thing."""
    return request.param


@pytest.fixture(scope="module")
def study():
    return load_study(example_path("simulated-cable"))


@pytest.fixture(scope="module")
def fitted(study):
    """A fit that was watched: what it told its progress to is no part of it."""
    return fit(study, progress=[].append)


@pytest.fixture(scope="module")
def rod():
    """A cable between two clamps: what `equilibrium` takes."""
    cable = Cable(length=0.9, length_density=0.05, bending_stiffness=0.02, torsional_stiffness=0.015)
    level = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # d3 along x
    held = Boundary.of((np.zeros(3), level), (np.array([0.6, 0.0, 0.0]), level))
    return CableModel(cable, jnp.array([0.0, 0.0, -9.81])), held


def alike(one, other) -> bool:
    """Whether two trees of arrays hold the same."""
    leaves = zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True)
    return jax.tree.structure(one) == jax.tree.structure(other) and all(np.array_equal(a, b) for a, b in leaves)


def test_cables(again, rod):
    assert alike(again(rod), rod)


def test_a_fit_and_what_goes_on_from_it(again, fitted):
    other = again(fitted)
    assert other.to_json() == fitted.to_json()
    assert other.summary() == fitted.summary()
    assert other.calibrated == fitted.calibrated
    evaluation = other.problem.evaluator(other.minimum.shared, other.minimum.local)
    np.testing.assert_allclose(evaluation.residual, fitted.minimum.evaluation.residual, atol=1e-8)


def test_an_explanation(again, fitted):
    explanation = explained(fitted)
    assert again(explanation).to_json() == explanation.to_json()


def test_an_equilibrium(again, rod):
    solved = equilibrium(*rod)
    other = again(solved)
    assert alike(other, solved)
    assert other.verdict.sentence() == solved.verdict.sentence()


@pytest.mark.parametrize(
    "error",
    [
        StudyError("study.toml", "cable.length", "is no number."),
        NotSettledError("no pose settled", "check the clamps", {"sag": "the forces do not balance"}),
    ],
    ids=lambda error: type(error).__name__,
)
def test_errors_keep_their_fields(again, error):
    other = again(error)
    assert type(other) is type(error)
    assert (str(other), vars(other)) == (str(error), vars(error))


def test_functions_and_answers_go_through_processes(rod, monkeypatch, tmp_path):
    """Processes of the kind that every system has (spawn): equilibria one way, a study's error back."""
    monkeypatch.setenv("JAX_ENABLE_X64", "1")
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", jax.config.jax_compilation_cache_dir)
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        solved = pool.submit(equilibrium, *rod)
        refused = pool.submit(load_study, tmp_path)
        np.testing.assert_allclose(solved.result().points, equilibrium(*rod).points, atol=1e-9)
        fault = refused.exception()
    assert isinstance(fault, StudyError)
    assert fault.file.endswith("study.toml")
