"""What a fit may move: logarithms, vectors, parameters of effects, ranges, and tolerances as priors."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scan2flex_jax.fitting import residual_function
from scan2flex_jax.fitting.parameters import layout_of, model_at, start_vector, template, values_of
from scan2flex_jax.inference import fit
from scan2flex_jax.study import EffectDeclaration, Tolerance, Unknown, load_study, save_study

from . import scenes

MASS = EffectDeclaration("point_mass", {"position": 0.4})
GRIP = EffectDeclaration("clamp_rotation", {})
FIELD = EffectDeclaration("curvature_profile", {"s": [0.1, 0.5, 0.9]})
YIELD = EffectDeclaration("elastic_clamp", {})
SLIGHT = Tolerance(clamp_position=1e-3, clamp_rotation=0.02)


def test_tolerances_stand_behind_the_unknowns():
    tolerance = Tolerance(length=2e-3, gravity=0.01, clamp_rotation=0.02)
    study = scenes.study_of(tolerance=tolerance)
    layout = layout_of(study)
    assert (layout.unknowns, layout.shared, layout.local) == (2, 5, 12)
    model = model_at(layout, template(study), np.array([0.0, 0.0, 1.0, 1.0, 0.0]))
    np.testing.assert_allclose(model.cable.length, 1.002)
    np.testing.assert_allclose(np.linalg.norm(model.gravity), 9.81, rtol=1e-12)
    np.testing.assert_allclose(np.arccos(-model.gravity[2] / 9.81), 0.01, rtol=1e-6)
    unknown_length = scenes.study_of([*scenes.BOTH, Unknown("length", guess=1.0)], tolerance=tolerance)
    assert layout_of(unknown_length).length_tolerance == 0.0  # an unknown has no prior


def test_vector_unknowns():
    unknowns = [Unknown("bending_stiffness", guess=np.array([0.1, 0.1])), Unknown("natural_curvature")]
    study = scenes.study_of(unknowns)
    truth = {"bending_stiffness": np.array([0.1, 0.13]), "natural_curvature": np.array([0.4, -0.3, 0.5])}
    f = fit(scenes.measured(study, scenes.exact_curves(study, truth)), elements=scenes.ELEMENTS)
    np.testing.assert_allclose(f.estimates["bending_stiffness"].value, truth["bending_stiffness"], rtol=1e-4)
    np.testing.assert_allclose(f.estimates["natural_curvature"].value, truth["natural_curvature"], atol=1e-3)
    assert f.correlation.shape == (5, 5) and f.estimates["natural_curvature"].unit == "1/m"


@pytest.mark.parametrize(
    ("unknown", "shape"),
    [
        (Unknown("natural_curvature", guess=0.1), (3,)),
        (Unknown("curvature_profile.curvature", guess=0.1), (3, 3)),
        (Unknown("curvature_profile.curvature", guess=[0.1, 0.0, 0.2]), (3, 3)),
        (Unknown("clamp_rotation.rotation", guess=[0.1, 0.0, 0.2]), (2, 3)),
        (Unknown("bending_stiffness", guess=0.1), ()),
        (Unknown("bending_stiffness", guess=0.1, low=[0.01, 0.02], high=1.0), (2,)),
        (Unknown("bending_stiffness", prior={"mean": [0.1, 0.2], "std": 0.01}), (2,)),
    ],
    ids=lambda x: getattr(x, "name", x),
)
def test_one_number_may_stand_for_all_entries_and_stays_a_start(unknown, shape):
    study = scenes.study_of([unknown], effects=[e for e in (GRIP, FIELD) if unknown.name.startswith(e.kind)])
    layout = layout_of(study)
    (slot,) = layout.slots
    assert slot.shape == shape and len(slot.low) == slot.size
    start = start_vector(study, layout, {})
    assert model_at(layout, template(study), start) is not None
    np.testing.assert_allclose(values_of(layout, start)[slot.name], np.broadcast_to(study.start_value(slot.name), shape))


def test_a_field_along_the_cable(tmp_path):
    name = "curvature_profile.curvature"
    study = scenes.study_of((Unknown("bending_stiffness"), Unknown(name)), effects=[FIELD])
    truth = {"bending_stiffness": 0.1, name: np.array([[0.5, -0.2, 0.1], [-0.3, 0.4, 0.0], [0.2, 0.1, -0.3]])}
    f = fit(scenes.measured(study, scenes.exact_curves(study, truth)), elements=scenes.ELEMENTS)
    np.testing.assert_allclose(f.estimates["bending_stiffness"].value, 0.1, rtol=1e-3)
    np.testing.assert_allclose(f.estimates[name].value, truth[name], atol=0.01)
    assert f.estimates[name].unit == "1/m" and len(f.labels) == 10
    line = next(line for line in scenes.summary_of(f).splitlines() if name in line)
    assert line.count("[") == 9 and line.endswith("1/m")  # an interval for each of nine numbers
    save_study(f.calibrated, tmp_path)
    again = load_study(tmp_path)
    assert again == f.calibrated
    np.testing.assert_array_equal(again.effects[0].parameters["s"], [0.1, 0.5, 0.9])


def test_parameters_of_effects():
    unknowns = [Unknown("bending_stiffness"), Unknown("point_mass.mass"), Unknown("clamp_rotation.rotation")]
    study = scenes.study_of(unknowns, effects=[MASS, GRIP])
    rotation = np.array([[0.03, -0.02, 0.05], [-0.04, 0.02, 0.01]])
    truth = {"bending_stiffness": scenes.EI, "point_mass.mass": 0.03, "clamp_rotation.rotation": rotation}
    f = fit(scenes.measured(study, scenes.exact_curves(study, truth)), elements=scenes.ELEMENTS)
    np.testing.assert_allclose(f.estimates["bending_stiffness"].value, scenes.EI, rtol=1e-4)
    np.testing.assert_allclose(f.estimates["point_mass.mass"].value, 0.03, rtol=1e-3)
    found = f.estimates["clamp_rotation.rotation"]
    tangents = [Rotation.from_rotvec(x).apply([0.0, 0.0, 1.0]) for x in (found.value, rotation)]  # whatever the common roll
    np.testing.assert_allclose(*tangents, atol=5e-4)
    np.testing.assert_allclose(np.diff(found.value[:, 2]), np.diff(rotation[:, 2]), atol=1.5e-3)  # twist
    assert not found.identifiable  # an isotropic cable that is rolled in both clamps looks the same
    assert any("rotation[2]" in s and "rotation[5]" in s for s in f.sentences), f.sentences


@pytest.fixture(scope="module")
def tilted_clamps():
    """Fits of shapes whose clamps are off by the tolerance at random: as if they were exact, and with the tolerance."""
    plain, loose = scenes.study_of(), scenes.study_of(tolerance=SLIGHT)
    pairs = []
    for seed in range(8):
        local = np.random.default_rng(seed).standard_normal((3, 12))
        curves = scenes.exact_curves(loose, scenes.TRUE, local)
        both = (scenes.measured(s, curves, 3e-4, seed) for s in (plain, loose))
        pairs.append([fit(s, elements=scenes.ELEMENTS) for s in both])
    return pairs


@pytest.mark.slow
def test_tolerances_absorb_errors_of_clamps(tilted_clamps):
    """Errors in units of the quoted standard error: as large as quoted with the tolerance, and no bias."""
    logs = np.array([[np.log(f[1].estimates[n].value / v) for n, v in scenes.TRUE.items()] for f in tilted_clamps])
    quoted = np.array([[f[1].estimates[n].std / f[1].estimates[n].value for n in scenes.TRUE] for f in tilted_clamps])
    z = logs / quoted
    assert np.all(np.abs(z) < 4.0), z
    assert np.all(np.sqrt(np.mean(z**2, axis=0)) < 1.9), z  # chi-squared of 8: 1.8 is its 99.9 % point
    assert np.all(np.abs(np.mean(z, axis=0)) < 3.5 / np.sqrt(len(z))), z


@pytest.mark.slow
def test_exact_clamps_would_be_overconfident(tilted_clamps):
    """The same shapes without the tolerance: residuals far above the noise, the estimate further off."""
    off = np.array([[abs(f.estimates["bending_stiffness"].value / scenes.EI - 1) for f in pair] for pair in tilted_clamps])
    assert np.sqrt(np.mean(off[:, 0] ** 2)) > np.sqrt(np.mean(off[:, 1] ** 2))
    assert all(exact.rms() > 1.5 * loose.rms() for exact, loose in tilted_clamps)


def test_range_is_kept_and_the_bound_is_flagged(tmp_path):
    """A range above the truth: the estimate lies on its lower bound, says so, stays there whichever pose is left out, and the
    calibrated study, with that value, can be read."""
    study = scenes.study_of([Unknown("bending_stiffness", low=0.104, high=1.0), Unknown("torsional_stiffness")])
    curves = scenes.exact_curves(scenes.study_of(), scenes.TRUE)
    f = fit(scenes.measured(study, curves, 1e-4), elements=scenes.ELEMENTS)
    held = f.estimates["bending_stiffness"]
    assert held.at_bound and 0.104 <= held.value < 0.104 * (1 + 1e-9)
    assert not f.estimates["torsional_stiffness"].at_bound
    assert any("bending_stiffness lies at a bound" in s for s in f.sentences)
    assert "AT A BOUND" in scenes.summary_of(f)
    np.testing.assert_array_equal(f.influence.moved[:, 0], 0.0)
    save_study(f.calibrated, tmp_path)
    assert load_study(tmp_path).start_value("bending_stiffness") == held.value


def test_guess_outside_the_default_range_is_brought_inside():
    study = scenes.study_of([Unknown("bending_stiffness", guess=1e9), Unknown("torsional_stiffness", guess=0.2)])
    layout = layout_of(study)
    assert start_vector(study, layout, {})[0] == layout.slots[0].high[0]


@pytest.mark.parametrize(("free", "row"), [("start", 1), ("end", 0)])
def test_effect_of_the_only_clamped_end(free, row):
    """A ball joint at the other end of every pose: the one value of the grip belongs to the end that is clamped."""
    study = scenes.study_of([Unknown("clamp_rotation.rotation"), Unknown("elastic_clamp.stiffness")], effects=[GRIP, YIELD])
    joint = [replace(p, **{free: replace(getattr(p, free), quaternion=None)}) for p in study.poses]
    study = replace(study, poses=tuple(joint))
    layout = layout_of(study)
    assert [slot.shape for slot in layout.slots] == [(1, 3), (1,)]
    turn, stiffness = np.array([0.1, -0.2, 0.3]), 0.7
    for effect in model_at(layout, template(study), np.array([*turn, np.log(stiffness)])).effects:
        if effect.kind == "clamp_rotation":
            np.testing.assert_allclose(effect.rotation[row], turn)
        else:
            np.testing.assert_allclose(effect.stiffness[row], stiffness)
            assert effect.stiffness[1 - row] == np.inf


def test_a_study_as_a_function_assumes_the_same_stiffness():
    """The stiffness of a cable that is left out follows its loads there too."""
    study = scenes.study_of(effects=[EffectDeclaration("point_mass", {"position": 0.4, "mass": 0.5})])
    known = {k: v for k, v in study.cable.items() if k not in ("axial_stiffness", "shear_stiffness")}
    function, _ = residual_function(scenes.replace(study, cable=known))
    assert function.layout.rigid == ("axial_stiffness", "shear_stiffness")
