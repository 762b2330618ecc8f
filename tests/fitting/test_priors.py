"""What other measurements say: priors of unknowns, a mass per length that is known only nearly, a roll that is not known."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np

from scan2flex_jax import Tolerance, Unknown, fit, load_study, residual_function, save_study
from scan2flex_jax.fitting.parameters import boundary_at, layout_of
from scan2flex_jax.fitting.poses import boundary_of
from scan2flex_jax.study import describe

from . import scenes

DENSITY = 0.2  # kg/m, of the example
NOISE = 1e-4


def exact(study, local=None):
    """The study with the curves of the true stiffnesses."""
    return scenes.measured(study, scenes.exact_curves(study, scenes.TRUE, local), stated=NOISE)


def weighed_badly(factor, std):
    """The density is unknown and another measurement says that it is ``factor`` times the true one."""
    prior = {"mean": factor * DENSITY, "std": std}
    study = exact(scenes.study_of(axial_stiffness=1e7))  # so stiff that curves without noise do not show the density by stretch
    cable = {k: v for k, v in study.cable.items() if k != "length_density"}
    return replace(study, cable=cable, unknowns=(*study.unknowns, Unknown("length_density", prior=prior)))


def test_a_prior_of_the_density_scales_every_stiffness():
    found = fit(weighed_badly(1.1, 0.01 * DENSITY), elements=scenes.ELEMENTS).estimates
    np.testing.assert_allclose(found["length_density"].value, 1.1 * DENSITY, rtol=2e-4)
    for name, truth in scenes.TRUE.items():
        np.testing.assert_allclose(found[name].value, 1.1 * truth, rtol=2e-3)
        np.testing.assert_allclose(found[name].std / found[name].value, 0.01 / 1.1, rtol=0.05)
        assert found[name].identifiable


def test_a_prior_and_the_poses_are_weighed_by_their_precision():
    free = exact(scenes.study_of())
    open_fit = fit(free, elements=scenes.ELEMENTS)
    std = open_fit.estimates["torsional_stiffness"].std
    mean = scenes.GJ + 3 * std
    told = {"torsional_stiffness": Unknown("torsional_stiffness", prior={"mean": mean, "std": std})}
    found = fit(replace(free, unknowns=tuple(told.get(u.name, u) for u in free.unknowns)), elements=scenes.ELEMENTS)
    assert scenes.GJ < found.estimates["torsional_stiffness"].value < mean
    assert found.estimates["torsional_stiffness"].std < std


def test_a_positive_quantity_has_the_log_normal_prior_of_its_mean_and_deviation():
    study = scenes.study_of([Unknown("bending_stiffness", prior={"mean": 0.1, "std": 0.05}), Unknown("natural_curvature")])
    prior = layout_of(study).prior
    draws = np.exp(prior.mean[0] + prior.std[0] * np.random.default_rng(0).standard_normal(400_000))
    np.testing.assert_allclose([draws.mean(), draws.std()], [0.1, 0.05], rtol=0.01)
    assert prior.at.tolist() == [0]
    assert study.start_value("bending_stiffness") == 0.1


def test_the_residual_function_ends_on_the_priors():
    study = weighed_badly(1.0, 0.01 * DENSITY)
    function, start = residual_function(replace(study, tolerance=Tolerance(length=1e-3)), noise=NOISE)
    prior = function.layout.prior
    moved = start.at[2].set(prior.mean[0] + 2 * prior.std[0]).at[3].set(0.5)
    np.testing.assert_allclose(function(moved)[-2:], [2.0, 0.5], rtol=1e-9)


def test_a_roll_leaves_the_tangent_where_it_was():
    study = scenes.study_of(tolerance=Tolerance(clamp_rotation=0.02, clamp_roll=3.0))
    layout = layout_of(study)
    said = boundary_of(study.poses[0])
    rolled = boundary_at(layout, said, jnp.zeros((2, 6)).at[:, 5].set(0.7).ravel())
    both = boundary_at(layout, said, jnp.zeros((2, 6)).at[:, 5].set(0.7).at[:, 3].set(1.5).ravel())
    for end in (0, 1):
        np.testing.assert_allclose(rolled.rotation[end, :, 2], said.rotation[end, :, 2], atol=1e-12)
        turn = said.rotation[end].T @ rolled.rotation[end]
        np.testing.assert_allclose(np.arctan2(turn[1, 0], turn[0, 0]), 2.1, rtol=1e-12)
        tangents = both.rotation[end, :, 2] @ said.rotation[end, :, 2]
        np.testing.assert_allclose(np.arccos(np.clip(tangents, -1, 1)), 0.03, rtol=1e-6)


def test_an_unknown_roll_does_not_turn_into_a_stiffness():
    loose = Tolerance(clamp_rotation=1e-3, clamp_roll=3.0)
    study = scenes.study_of((Unknown("bending_stiffness"),), tolerance=loose)
    local = np.zeros((3, 12))
    local[:, 11] = [0.2, -0.15, 0.1]  # 0.6, -0.45 and 0.3 rad of the end clamps
    rolled = scenes.measured(study, scenes.exact_curves(study, {"bending_stiffness": scenes.EI}, local), stated=NOISE)
    lines = []
    found = fit(rolled, elements=scenes.ELEMENTS, progress=lines.append)
    np.testing.assert_allclose(found.estimates["bending_stiffness"].value, scenes.EI, rtol=0.01)
    assert found.rms() < 3 * NOISE
    assert lines[-1] == "noise, discrepancy and parameters together"


def test_they_are_described_and_written_back(tmp_path):
    study = weighed_badly(1.0, 0.002)
    study = replace(study, tolerance=Tolerance(clamp_rotation=0.01, clamp_roll=0.0, length_density=0.0))
    save_study(study, tmp_path)
    again = load_study(tmp_path)
    assert again == study and again.tolerance.clamp_roll == 0.0 and again.unknowns[2].prior == {"mean": 0.2, "std": 0.002}
    said = describe(replace(study, tolerance=Tolerance(clamp_roll=3.0, length_density=0.002)))
    nearly = ("clamp_roll               3 rad", "length_density           0.002 kg/m")
    for words in ("measured elsewhere as 0.2 +- 0.002", *nearly):
        assert words in said
