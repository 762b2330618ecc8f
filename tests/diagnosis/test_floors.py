"""The floor of a model: refit and law of the residual in turn (`diagnosis.floors`)."""

from types import SimpleNamespace

import numpy as np
import pytest

from scan2flex_jax.diagnosis import floors
from scan2flex_jax.diagnosis.refit import Refit
from scan2flex_jax.diagnosis.residual import Law
from scan2flex_jax.diagnosis.stage import Signatures
from scan2flex_jax.fitting import noise
from scan2flex_jax.fitting.noise import Noise

SENSOR = 4e-4  # m


def ended(nats, noise, cost=1.0):
    found = object.__new__(Refit)
    found.log_marginal, found.cost, found.law = nats, cost, Law(Noise(noise, 1e-2 * noise, 0.05), 0.2)
    return found


@pytest.fixture
def repeated(monkeypatch):
    """Repeats a refit that ended ``first`` and would end ``second``: the kept one, and the noises from which each began."""

    def repeat(first, second, sharp=True, alike=0.0):
        ends, begun = iter((first, second)), []

        def alternated(of, found, start):
            begun.append(start.total)
            return next(ends)

        monkeypatch.setattr(floors, "_alternated", alternated)
        monkeypatch.setattr(floors, "again", lambda bench, found, law, most: found)
        monkeypatch.setattr(noise, "white_noise", lambda pose: pose)
        study = SimpleNamespace(fit_poses=(SENSOR, 0.5 * SENSOR, 40 * SENSOR))
        bench = SimpleNamespace(problem=SimpleNamespace(study=study), context=SimpleNamespace(length=1.0))
        of = object.__new__(Signatures)
        of.bench, of.alike = bench, alike
        return floors.own_floor(of, object.__new__(Refit), Noise(0.01, 0.0, 0.1), plain=True, sharp=sharp), begun

    return repeat


def test_a_noise_far_above_the_sensor_s_is_tried_again_from_that(repeated):
    """The refit of a tether had settled on 6.6 mm of noise, where neighbouring points show 0.4 mm: 179 nats behind."""
    blunt, sharp = ended(150.0, 6.6e-3), ended(329.0, 4.4e-4)
    found, begun = repeated(blunt, sharp)
    assert found is sharp
    np.testing.assert_allclose(begun[1], np.sqrt(2.0) * SENSOR)
    assert repeated(ended(340.0, 6.6e-3), sharp)[0].log_marginal == 340.0


def test_nothing_is_repeated_where_the_noise_is_the_sensor_s_or_is_not_known(repeated):
    never = ended(1e9, 1e-5)
    blunt, unsolved = ended(0.0, 1e-2), ended(0.0, 1e-2, cost=np.inf)
    for first, more in ((ended(0.0, 1.9 * SENSOR), {}), (unsolved, {}), (blunt, {"sharp": False}), (blunt, {"alike": 1e-4})):
        found, begun = repeated(first, never, **more)
        assert found is first and len(begun) == 1
