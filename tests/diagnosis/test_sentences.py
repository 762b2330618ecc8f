"""Sentences on the conditions under which an explanation holds."""

from types import SimpleNamespace

import numpy as np
import pytest

from scan2flex_jax.diagnosis import sentences
from scan2flex_jax.diagnosis.residual import Law
from scan2flex_jax.diagnosis.settings import USUAL
from scan2flex_jax.diagnosis.stage import Signatures
from scan2flex_jax.fitting.noise import Noise


def found(left, noise, radius=0.004, stated=None):
    """A search over one pose of 20 points with an error ``left`` (m) of the baseline model."""
    residual = np.zeros((20, 3))
    residual[:, 0] = left
    solved = SimpleNamespace(code=np.array(0))
    shapes = [SimpleNamespace(residual=residual, verdict=solved, s=np.linspace(0, 1, 20))]
    context = SimpleNamespace(length=1.0, radius_or_guess=radius)
    bench = SimpleNamespace(real=[np.ones(20, bool)], context=context)
    of = object.__new__(Signatures)
    of.stated, of.settings, of.bench = stated, USUAL, bench
    stage = SimpleNamespace(bench=bench, noise=noise, base=SimpleNamespace(shapes=shapes), settings=USUAL, of=of)
    return SimpleNamespace(stage=stage, best=SimpleNamespace(law=Law(noise)))


@pytest.mark.parametrize(("left", "doubted"), [(1.5e-4, True), (2.0e-3, False)])
def test_a_residual_below_the_error_of_scans_is_doubted(left, doubted):
    said = sentences.if_fine(found(left, Noise(1e-4, 1e-5, 0.05)))
    assert bool(said) == doubted
    assert not doubted or "0.15 mm, 4 % of the radius" in said[0]


@pytest.mark.parametrize(
    ("noise", "stated", "conditional"),
    [
        (Noise(1e-3, 1e-2, 0.3), None, True),
        (Noise(1e-3, 1e-2, 0.3), 5e-3, False),  # the user has said how the scan errs
        (Noise(1e-3, 1e-3, 0.3), None, False),
    ],
)
def test_smooth_errors_as_large_as_shapes_are_a_condition(noise, stated, conditional):
    said = sentences._if_noise(found(1e-2, noise, stated=stated))
    assert bool(said) == conditional
    assert not conditional or "14.2 mm RMS, alike over 300 mm" in said[0]


@pytest.mark.parametrize(("now", "goes"), [(1e-3, "falls from 3.00 to 1.00 mm"), (5e-3, "rises from 3.00 to 5.00 mm")])
def test_an_error_that_rises_is_not_said_to_fall(now, goes):
    figures = {"rms_before": 3e-3, "rms": now, "left_out_before": None, "left_out": None}
    pose = SimpleNamespace(role="fit", residual=np.zeros((20, 3)), **figures)
    (said,) = sentences.before_and_after({"p1": pose}, [SimpleNamespace(kind="tether")], established=False)
    assert said == f"with tether the error {goes}; this best model is not established"


def test_validate_poses_are_told_and_those_that_get_much_worse_are_named():
    def pose(role, before, after):
        figures = {"rms_before": before, "rms": after, "left_out_before": None, "left_out": None}
        return SimpleNamespace(role=role, residual=np.zeros((20, 3)), **figures)

    poses = {"p1": pose("fit", 9e-3, 1e-3), "p2": pose("validate", 4e-3, 3e-3), "p3": pose("validate", 3e-3, 40e-3)}
    said, worse = sentences.before_and_after(poses, [SimpleNamespace(kind="tether")], established=True)
    assert said == "with tether the error falls from 9.00 to 1.00 mm, in validate poses from 3.54 to 28.36 mm"
    assert worse == "much worse with tether, perhaps on another branch: p3 (3.0 to 40.0 mm)"
    lost = poses | {"p3": pose("validate", 3e-3, np.nan)}  # without an equilibrium
    (said,) = sentences.before_and_after(lost, [SimpleNamespace(kind="tether")], established=True)
    assert said == "with tether the error falls from 9.00 to 1.00 mm"


@pytest.mark.parametrize(
    ("nats", "scatter", "said"),
    [
        (-3.5, {"kink": 0.66}, "the likeliest, kink, is no likelier than the baseline model, predicts poses left out no better "
         "than the baseline model and differs in size between poses (kink by 66 %)"),
        (4.2, {}, "the likeliest, kink, leads by only 4.2 nats and predicts poses left out no better than the baseline model"),
        (9.0, {}, "the likeliest, kink, predicts poses left out no better than the baseline model"),
    ],
)  # fmt: skip
def test_the_reasons_against_the_likeliest_effect_make_one_sentence(monkeypatch, nats, scatter, said):
    """A lead of -3.5 nats was told as "leads by only -3.5 nats"."""
    monkeypatch.setattr(sentences.confirm, "compared", lambda *models: SimpleNamespace(ratio=1.1, better=False))
    stage = SimpleNamespace(settings=USUAL, bench=SimpleNamespace(poses=SimpleNamespace(count=2)))
    best = SimpleNamespace(kinds=("kink",), log_evidence=nats)
    about = SimpleNamespace(best=best, stage=stage, scatter=scatter, baseline=None)
    assert sentences._not_enough(about) == (said,)
