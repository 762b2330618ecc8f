"""What estimates rest on, to first order: each pose against refits without it, length and mass against refits with others."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from scan2flex_jax.inference import fit
from scan2flex_jax.study import EffectDeclaration, Tolerance

from . import scenes

NOISE = 2e-4


@cache
def study(poses=scenes.NAMES, tolerance=scenes.EXACT):
    made = scenes.to_fit(scenes.study_of(poses=poses, tolerance=tolerance))
    return scenes.measured(made, scenes.exact_curves(made, scenes.TRUE), NOISE, seed=3, stated=NOISE)


@cache
def fitted(tolerance=scenes.EXACT):
    return fit(study(tolerance=tolerance), elements=scenes.ELEMENTS)


def logs(f):
    return np.log([f.estimates[label].value for label in f.labels])


TOLERANT = Tolerance(length=5e-4, clamp_position=2e-4, clamp_rotation=2e-3)


@pytest.mark.parametrize(
    "tolerance", [scenes.EXACT, pytest.param(TOLERANT, marks=pytest.mark.slow)], ids=["exact", "tolerances"]
)
def test_a_pose_moves_the_estimates_as_a_refit_without_it(tolerance):
    whole = fitted(tolerance)
    found = whole.influence
    assert found.poses == tuple(whole.poses)
    for i, name in enumerate(found.poses):
        rest = replace(whole.study, poses=tuple(replace(p, role="validate" if p.name == name else "fit")
                                                for p in whole.study.poses))  # fmt: skip
        again = fit(rest, elements=scenes.ELEMENTS)
        std = np.array([again.estimates[label].std / again.estimates[label].value for label in again.labels])
        assert np.max(np.abs(found.moved[i])) > 0
        np.testing.assert_allclose(found.moved[i], logs(again) - logs(whole), atol=0.05 * std.max())
        if tolerance is scenes.EXACT:  # beside a tolerance a validate pose is predicted at the nominal clamps, as this one is
            assert found.left_out[i] == pytest.approx(again.poses[name].rms, rel=0.01)


@pytest.mark.parametrize("name", ["length", "length_density"])
def test_stated_values_move_the_estimates_as_a_refit_with_others(name):
    """A change of the length below the noise, which leaves the noise as it is estimated."""
    whole = fitted()
    found = whole.influence
    step = 2e-4
    other = replace(whole.study, cable={**whole.study.cable, name: whole.study.cable[name] * (1 + step)})
    moved = logs(fit(other, elements=scenes.ELEMENTS)) - logs(whole)
    np.testing.assert_allclose(found.stated[name], moved / step, rtol=0.02, atol=0.02)


def test_a_known_force_in_place_of_the_mass():
    """A weight ten times the cable's: the mass per length hardly counts any more."""
    weight = EffectDeclaration("point_mass", {"position": 0.5, "mass": 2.0})
    made = scenes.study_of(poses=("plane", "aside-45"), effects=[weight])
    whole = fit(scenes.measured(made, scenes.exact_curves(made, scenes.TRUE), 1e-4), elements=scenes.ELEMENTS)
    assert np.all(np.abs(whole.influence.stated["length_density"]) < 0.5)


def test_what_a_single_pose_determines_is_not_determined_without_it():
    """Torsion shows in the twisted pose alone; without the only other pose the bending stiffness is known still."""
    made = study(poses=("plane", "twist-90"))
    whole = fit(made, elements=scenes.ELEMENTS)
    found = whole.influence
    assert np.isnan(found.of_pose("twist-90")["torsional_stiffness"])
    assert np.isfinite(found.of_pose("twist-90")["bending_stiffness"])
    assert all(np.isfinite(v) for v in found.of_pose("plane").values())
    assert np.isfinite(found.left_out[0]) and np.isnan(found.left_out[1])
    assert found.of_pose("nowhere") == {}
