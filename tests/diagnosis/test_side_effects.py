"""Side effects of a call of `explain`: none, unless it gets an `AheadCompiler`."""

import threading
from dataclasses import replace
from importlib import import_module

import jax
import jax.numpy as jnp
import pytest

from scan2flex_jax import compilation
from scan2flex_jax.diagnosis import AheadCompiler, ahead, explain
from scan2flex_jax.errors import NotSettledError, Scan2FlexError
from scan2flex_jax.examples import example_path
from scan2flex_jax.study import load_study

run = import_module("scan2flex_jax.diagnosis.run")


@pytest.fixture
def study():
    return load_study(example_path("black-wire"))


@pytest.fixture
def started(monkeypatch):
    """Threads that were started, in place of running them."""
    names = []
    monkeypatch.setattr(threading.Thread, "start", lambda thread: names.append(thread.name))
    return names


def nothing_fitted(study, **options):
    raise Scan2FlexError("the poses have settled for something else")


def test_a_library_call_starts_no_thread(study, started, monkeypatch):
    monkeypatch.setattr(run, "baseline_fit", nothing_fitted)
    with pytest.raises(Scan2FlexError, match="something else"):
        explain(study)
    assert started == []
    with pytest.raises(Scan2FlexError, match="something else"):
        explain(study, ahead=AheadCompiler())
    assert len(started) == 1


@pytest.mark.slow
def test_a_whole_explanation_leaves_threads_and_compiled_functions_as_they_were(study):
    traced = []

    @jax.jit
    def own(x):
        traced.append(x)
        return 2.0 * x

    own(jnp.ones(3))
    before = threading.enumerate()
    explain(study, mesh=False)
    own(jnp.ones(3))
    assert len(traced) == 1
    assert threading.enumerate() == before


def test_room_is_made_by_the_caller_s_thread_alone(study, monkeypatch):
    """Functions that are compiled ahead must not be forgotten on the way."""
    made = []
    monkeypatch.setattr(run, "make_room", lambda: made.append(threading.current_thread()))
    monkeypatch.setattr(compilation, "make_room", lambda: pytest.fail("a thread made room"))
    monkeypatch.setattr(run, "baseline_fit", nothing_fitted)
    monkeypatch.setattr(ahead, "_run_through", lambda *args: None)
    for compiler in (None, AheadCompiler()):
        with pytest.raises(Scan2FlexError):
            explain(study, ahead=compiler)
    assert made == [threading.main_thread()]


def test_a_fault_of_compiling_ahead_is_raised_where_it_is_waited_for(study, monkeypatch):
    monkeypatch.setattr(ahead, "_run_through", lambda *args: 1 / 0)
    compiler, said = AheadCompiler(), []
    compiler.start(study)
    with pytest.raises(ZeroDivisionError):
        compiler.wait(study)
    run._wait(compiler, study, run.FIT_ELEMENTS, True, said.append)
    assert "ZeroDivisionError: division by zero" in said[-1]


def test_studies_that_share_what_is_compiled_are_compiled_once(study, started):
    compiler = AheadCompiler()
    compiler.start(study)
    compiler.start(replace(study, title="again"))
    assert len(started) == 1
    compiler.start(study, 80)
    assert len(started) == 2
    compiler.wait(study, 160)  # never begun: nothing to wait for


def test_poses_that_do_not_settle_are_an_answer_and_other_refusals_are_not(study, monkeypatch):
    """By the type of the error: words of a message decide nothing."""

    def unsolved(study, **options):
        raise NotSettledError("no values let every pose rest", "check the clamps", {"hang": "the forces do not balance"})

    monkeypatch.setattr(run, "baseline_fit", unsolved)
    found = explain(study)
    assert found.verdict == "not in equilibrium"
    assert found.sentences == ("no values let every pose rest (hang: the forces do not balance): check the clamps",)
    assert found.fit is None and found.to_json()["messages"] == list(found.sentences)
    monkeypatch.setattr(run, "baseline_fit", nothing_fitted)
    with pytest.raises(Scan2FlexError, match="settled"):
        explain(study)


def test_scans_that_do_not_settle_are_an_answer_too(study, monkeypatch):
    """The fit to the points themselves, which comes first for scans, has the same verdict."""

    def unsolved(study, elements, say):
        raise NotSettledError("no pose settled on the way of the direct fit", "fit the curves", {})

    monkeypatch.setattr(run, "_on_axes", unsolved)
    assert explain(study).sentences == ("no pose settled on the way of the direct fit: fit the curves",)
