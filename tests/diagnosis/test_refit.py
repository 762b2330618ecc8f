"""Refits: what no pose feels does not move, and a repeated search goes on from what the last one found."""

import itertools
from types import SimpleNamespace

import jax
import numpy as np
import pytest

from scan2flex_jax.diagnosis import AheadCompiler, evidence, refit, search, stage
from scan2flex_jax.diagnosis.sensitivity import Bench, Component
from scan2flex_jax.diagnosis.slots import empty_slots_of
from scan2flex_jax.examples import example_path
from scan2flex_jax.fitting import fit
from scan2flex_jax.study import load_study

from . import scenes

COMPILED = "/jax/core/compile/backend_compile_duration"


@pytest.mark.parametrize("count", [1, 2])
def test_evidence_over_all_scales_is_the_mean_of_gaussian_integrals(count):
    """Effects of one amplitude each on a linear residual: the integral over amplitudes is known for every scale."""
    rng = np.random.default_rng(count)
    J, y, size = rng.standard_normal((30, count)), rng.standard_normal(30), np.full(count, 0.7)
    P = np.diag(1.0 / size**2)
    x = np.linalg.solve(J.T @ J + P, J.T @ y)
    numbers = SimpleNamespace(count=count, amplitudes=lambda k: np.array([k]))
    prior = SimpleNamespace(precision=np.diag(P), low=np.full(count, -np.inf), high=np.full(count, np.inf))

    def evidence_at(x):
        g = J.T @ (J @ x - y) + P @ x
        found = refit._over_scales(numbers, prior, J.T @ J + P, g, x, np.ones(count, bool), [None] * count)
        cost = np.sum((y - J @ x) ** 2) + x @ P @ x
        return 0.5 * (y @ y - cost) + found + 0.5 * np.log(np.linalg.det(P))

    ratios = []
    for scales in itertools.product(evidence.SCALES, repeat=count):
        C = np.eye(30) + J @ np.diag((np.array(scales) * size) ** 2) @ J.T
        ratios.append(np.exp(0.5 * y @ y - 0.5 * y @ np.linalg.solve(C, y) - 0.5 * np.linalg.slogdet(C)[1]))
    exact = np.log(np.mean(ratios))
    assert evidence_at(x) == pytest.approx(exact, abs=1e-9)
    short = np.full(count, 0.9 / np.sqrt(np.sum(J.T @ J + P)))  # from the minimum: the cost is higher by 0.81
    assert evidence_at(x + short) == pytest.approx(exact - 0.5 * 0.81, abs=1e-9)
    assert evidence_at(x + 2 * short) < exact - 0.5 * 4 * 0.81  # too far: no step is credited


def test_evidence_over_wider_scales_does_not_step_past_a_bound():
    """A tether's stiffness at zero: below zero, it could make up for any pull along a direction that the data hardly feel."""
    rng = np.random.default_rng(0)
    column = rng.standard_normal(40)
    J = np.column_stack([column, column + 1e-4 * rng.standard_normal(40)])
    P, x = np.diag([25.0, 25.0]), np.array([0.0, 0.8])
    numbers = SimpleNamespace(count=2, amplitudes=lambda k: np.arange(2))

    def scales(low):
        prior = SimpleNamespace(precision=np.diag(P), low=np.array([low, -np.inf]), high=np.full(2, np.inf))
        return refit._over_scales(numbers, prior, J.T @ J + P, np.zeros(2), x, np.ones(2, bool), [None])

    expected = []
    for t in evidence.SCALES:
        less = 25.0 * (1 - t**-2)
        gained = 0.5 * less * x[1] ** 2 * (1 + less / (J[:, 1] @ J[:, 1] + 25.0 / t**2))
        expected.append(gained - 2 * np.log(t) - 0.5 * np.linalg.slogdet(J.T @ J + P / t**2)[1])
    assert scales(0.0) == pytest.approx(evidence.averaged(expected), abs=1e-6)
    assert scales(-np.inf) > scales(0.0) + 10


def first_stage(study):
    fitted = fit(study, slots=empty_slots_of(study))
    signatures, beside = stage.signatures(Bench(fitted.problem, fitted.minimum), fitted.minimum, None)
    return signatures, stage.stage_of(signatures, beside)


@pytest.fixture(scope="module")
def wire():
    """The black wire: one pose in a plane, which says nothing of GJ."""
    return first_stage(load_study(example_path("black-wire")))[1]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["point_load", "uniform_load"])
def test_an_unidentifiable_stiffness_stays_at_the_baseline_fit(wire, kind):
    at = next(c.site for c in wire.components if c.kind == kind)
    size = wire.bench.context.force / (1.0 if kind == "point_load" else wire.bench.context.length)
    found = refit.refit(wire.bench, (Component(kind, at),), wire.law, wire.base.vector, [np.array([0.1, 0.0, -0.1]) * size])
    assert found.chi2 < 0.8 * wire.base.chi2
    labels = wire.bench.layout.labels
    GJ, EI = labels.index("torsional_stiffness"), labels.index("bending_stiffness")
    assert abs(found.vector[GJ] - wire.base.vector[GJ]) < 0.05
    assert np.sqrt(found.covariance[EI, EI]) < 1.0 < np.sqrt(found.covariance[GJ, GJ])


@pytest.mark.slow
def test_what_was_compiled_ahead_is_not_compiled_again():
    study, names, listening = scenes.study(), [], True
    ahead = AheadCompiler()
    ahead.start(study)
    ahead.wait(study)
    fit(study, slots=empty_slots_of(study))  # what the fit compiled serves all that comes after it

    def listen(event, seconds, **more):
        if event == COMPILED and listening:
            names.append(more.get("fun_name"))

    jax.monitoring.register_event_duration_secs_listener(listen)
    first_stage(study)
    listening = False
    assert not {"jit(_evaluate)", "jit(_scan)", "jit(_state)"} & set(names)


@pytest.mark.slow
def test_a_tether_that_only_pulls_is_no_likelier_than_a_point_load(wire):
    """The same shapes, with a stiffness at its bound of zero: hundreds of nats had come from a step below it."""
    found = {}
    for kind in ("tether", "point_load"):
        g = next(g for g, c in enumerate(wire.components) if c.kind == kind and abs(c.site["position"] - 0.57) < 0.05)
        found[kind] = search.relative(wire, [wire.components[g]], [stage.one_step(wire)[1][g]])
    assert found["tether"].chi2 == pytest.approx(found["point_load"].chi2, rel=1e-3)
    assert abs(found["tether"].log_evidence - found["point_load"].log_evidence) < 5
