"""What the poses cannot determine is said in words, and gets no error bar."""

from pathlib import Path

import numpy as np
import pytest

from scan2flex_jax.inference import fit
from scan2flex_jax.study import EffectDeclaration, Markers, Study, Tolerance, Unknown, load_study
from tests.reference import rotations

from . import scenes

DATA = Path(__file__).parents[1] / "data"


def test_only_the_ratio_to_the_density():
    study = scenes.study_of([Unknown("length_density", guess=0.3), *scenes.BOTH])
    curves = scenes.exact_curves(study, scenes.TRUE | {"length_density": 0.2})
    f = fit(scenes.measured(study, curves, 3e-4), elements=scenes.ELEMENTS)
    assert any(
        "only the ratio of bending_stiffness and torsional_stiffness to the density are determined" in s for s in f.sentences
    ), f.sentences
    assert not any(e.identifiable for e in f.estimates.values())
    density = f.estimates["length_density"].value
    for name, value in scenes.TRUE.items():
        np.testing.assert_allclose(f.estimates[name].value / density, value / 0.2, rtol=2e-2)
    assert "NOT DETERMINED" in scenes.summary_of(f)


def test_a_shape_that_no_stiffness_moves_is_no_mistaken_reading():
    """A cantilever bent by nature to a circle of 1 m, without gravity; its tip is read to six digits."""
    bent = EffectDeclaration("natural_curvature", {"curvature": [0.0, 1.0, 0.0]})
    tip = Markers([[np.round(np.sin(1.0), 6), np.nan, np.round(np.cos(1.0) - 1.0, 6)]], [1.0])
    pose = {"name": "tip", "start": ([0.0, 0.0, 0.0], [np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0]), "markers": tip}
    cable = {"length": 1.0, "length_density": 0.2, "torsional_stiffness": 0.1}
    study = Study.from_arrays(cable, [pose], [Unknown("bending_stiffness")], effects=(bent,), gravity=np.zeros(3))
    f = fit(study, elements=scenes.ELEMENTS)
    assert f.rms() < 1e-6 and not f.estimates["bending_stiffness"].identifiable
    assert not f.reservation and "these poses do not determine EI" in f.answer.belief


@pytest.mark.parametrize("noise", [0.0, 3e-4])
def test_a_plane_pose_has_no_information_on_torsion(noise):
    study = scenes.study_of(poses=("plane",))
    f = fit(scenes.measured(study, scenes.exact_curves(study, scenes.TRUE), noise), elements=scenes.ELEMENTS)
    assert f.estimates["bending_stiffness"].identifiable
    bending = f.estimates["bending_stiffness"]
    assert abs(bending.value - scenes.EI) < 4 * bending.std + 1e-4 * scenes.EI
    assert not f.estimates["torsional_stiffness"].identifiable
    assert any("torsional_stiffness" in s and "not determined" in s for s in f.sentences), f.sentences


def test_natural_curvature_in_the_plane_of_a_clamped_pose_is_invisible():
    """Its work is -EI k0 times the angle between the clamps, which is given: the shape does not know it."""
    unknowns = [Unknown("bending_stiffness", guess=np.array([0.1, 0.1])), Unknown("natural_curvature")]
    study = scenes.study_of(unknowns, poses=("plane",))
    truth = {"bending_stiffness": np.array([0.1, 0.1]), "natural_curvature": np.zeros(3)}
    f = fit(scenes.measured(study, scenes.exact_curves(study, truth), 3e-4), elements=scenes.ELEMENTS)
    d1 = rotations.matrix(study.poses[0].start.quaternion)[:, 0]
    across = 0 if abs(d1[1]) > 0.9 else 1  # the axis that is normal to the plane x-z
    assert any(f"natural_curvature[{across}]" in s for s in f.sentences), f.sentences
    assert not f.estimates["natural_curvature"].identifiable
    assert f.estimates["natural_curvature"].std is None


def test_what_a_plane_pose_does_not_feel_keeps_its_ratio_to_what_it_feels():
    """Stiffer in bending alone, the rod would buckle out of its plane on the way, and the fit end where it does."""
    soft = {"bending_stiffness": scenes.EI / 50, "torsional_stiffness": scenes.EI / 50}
    study = scenes.guessed(scenes.study_of(poses=("plane",)), **soft)
    found = fit(study)
    EI, GJ = (found.estimates[name] for name in ("bending_stiffness", "torsional_stiffness"))
    assert found.converged
    assert EI.value == pytest.approx(scenes.EI, rel=1e-3)
    at = np.exp(found.posterior.variant.minimum.shared)  # that of the distances, before noise and priors are weighed
    assert at[1] == pytest.approx(at[0], rel=1e-6)
    assert not GJ.identifiable


def test_a_span_over_the_whole_cable_is_a_factor_on_its_stiffness():
    """EI, GJ and the factor are known as two products; the place and width of such a span mean nothing."""
    guesses = {"position": 0.5, "width": 1.4, "factor": 1.1}
    unknowns = [*scenes.BOTH, *(Unknown(f"stiffness_profile.{n}", guess=g) for n, g in guesses.items())]
    study = scenes.study_of(unknowns, effects=[EffectDeclaration("stiffness_profile", {})])
    truth = scenes.TRUE | {f"stiffness_profile.{n}": g for n, g in (guesses | {"factor": 1.0}).items()}
    f = fit(scenes.measured(study, scenes.exact_curves(study, truth), 3e-4), elements=scenes.ELEMENTS)
    factor = f.estimates["stiffness_profile.factor"].value
    for name, e in f.estimates.items():
        assert not e.identifiable and e.low is None, name
        if name in scenes.TRUE:
            assert e.value * factor == pytest.approx(scenes.TRUE[name], rel=0.02)
    assert any("covers the whole cable" in s for s in f.sentences), f.sentences


def test_what_a_tolerance_has_in_common_is_in_the_intervals():
    """EI and GJ per mass are known far better than the mass: correlated by more than 0.999, each is known to its tolerance."""
    study = scenes.study_of(tolerance=Tolerance(length_density=0.02 * 0.2))
    f = fit(scenes.measured(study, scenes.exact_curves(study, scenes.TRUE), 2e-5, stated=2e-5), elements=scenes.ELEMENTS)
    assert f.correlation[0, 1] > 0.999
    for name, value in scenes.TRUE.items():
        e = f.estimates[name]
        assert e.identifiable and e.std / e.value == pytest.approx(0.02, rel=0.2)
        assert e.low < value < e.high


@pytest.mark.slow
def test_minima_far_apart_that_fit_as_well_are_said():
    """A rod whose stiffness falls fifty-fold, as a taper and a span; a descent from guesses ends in a span over all of it."""
    f = fit(load_study(DATA / "tapered-rod"))
    assert f.rms("fit") < 1e-3
    (said,) = f.in_doubt
    assert said.startswith("other values fit about as well") and "stiffness_profile.position" in said
    assert f.answer.tone == "fair" and "other values" in f.answer.belief
    assert f.estimates["stiffness_profile.width"].value < 0.9
    assert not f.estimates["bending_stiffness"].identifiable
