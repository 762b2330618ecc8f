"""A sweep gives what its lanes give alone, with a verdict for every one and labels on everything."""

from dataclasses import replace

import jax
import numpy as np
import pytest
import xarray as xr

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.inference import fit
from scan2flex_jax.statics.solve import equilibrium
from scan2flex_jax.statics.verdict import SOLVED
from scan2flex_jax.sweep import (
    Axis,
    Calls,
    Outcome,
    Output,
    device_mesh,
    draws,
    equilibria,
    failed,
    fits,
    grid,
    noisy,
    random_turns,
    sweep,
    turned,
)
from scan2flex_jax.sweep.task import FAULT, REFUSED
from tests.fitting import scenes as studies

from . import scenes


@pytest.fixture(scope="module")
def swept():
    lines = []
    return sweep(scenes.hanging_cables(), scenes.CLAMPS_APART, chunk=4, progress=lines.append), lines


@pytest.mark.slow
def test_every_lane_is_the_equilibrium_alone(swept):
    found, _ = swept
    for span in scenes.SPANS[:2]:
        for stiffness in scenes.STIFFNESSES:
            model, boundary = scenes.hanging({"span": span, "bending_stiffness": stiffness})
            e = equilibrium(model, boundary, elements=scenes.ELEMENTS, max_steps=60)
            lane = found.sel(span=span, bending_stiffness=stiffness)
            assert int(lane.code) == SOLVED and bool(lane.stable) and int(lane.steps) == int(e.verdict.steps)
            np.testing.assert_allclose(lane["points"], e.points, atol=1e-12)
            np.testing.assert_allclose(lane["energy"], e.energy, rtol=1e-12)
            np.testing.assert_allclose(lane["reaction_force"], e.reactions()[0], rtol=1e-7, atol=1e-9)


@pytest.mark.slow
def test_clamps_too_far_apart_fail_alone_and_are_named(swept):
    found, _ = swept
    names = {f"span=1.5, bending_stiffness={x:g}" for x in scenes.STIFFNESSES}
    assert set(failed(found)) == names
    assert all("equilibrium" in words or "balance" in words or "finite" in words for words in failed(found).values())
    bad = found["code"].values != SOLVED
    for name in scenes.QUANTITIES:
        nan = np.isnan(found[name].values).reshape(bad.size, -1)
        assert np.all(nan[bad.ravel()]) and not np.any(nan[~bad.ravel()])


@pytest.mark.slow
def test_labels_units_and_progress(swept):
    found, lines = swept
    assert isinstance(found, xr.Dataset)
    assert found["points"].dims == ("span", "bending_stiffness", "node", "axis")
    assert found["reaction_force"].sel(end="start", axis="z").dims == ("span", "bending_stiffness")
    assert all("units" in found[name].attrs for name in found.data_vars)
    assert found["points"].units == "m" and found["span"].units == "m" and found["energy"].units == "J"
    assert any("chunk 2 of 2 kept, 6 of 6 lanes, 2 failed" in line for line in lines)


@pytest.mark.slow
def test_a_vectorised_batch_gives_what_the_loop_gives(swept):
    """On a mesh, in the order of cost, with a last batch that is filled up: only rounding differs, and a failed lane harms no
    other."""
    found, _ = swept
    order = {"cost": lambda lane: -lane["bending_stiffness"]}
    batched = sweep(scenes.hanging_cables(), scenes.CLAMPS_APART, at_once=4, mesh=device_mesh(), **order)
    np.testing.assert_array_equal(batched["code"], found["code"])
    for name in scenes.QUANTITIES:
        np.testing.assert_allclose(batched[name], found[name], rtol=1e-6, atol=1e-9)


def test_what_a_function_raises_is_its_lane_verdict():
    def root(lane):
        if lane["x"] == 2:
            raise Scan2FlexError("two is refused")
        if lane["x"] == 3:
            raise ValueError("three is a fault")
        if lane["x"] == 4:
            return {"root": np.nan}
        if lane["x"] == 5:
            return Outcome({"root": 9.0}, 20, steps=7)
        return {"root": np.sqrt(lane["x"])}

    found = sweep(Calls(root, {"root": Output("m")}), grid(x=Axis([0, 1, 2, 3, 4, 5])), chunk=3)
    np.testing.assert_array_equal(found["code"], [0, 0, REFUSED, FAULT, 2, 20])
    assert failed(found)["x=2"] == "two is refused" and failed(found)["x=3"] == "ValueError: three is a fault"
    np.testing.assert_array_equal(found["root"], [0, 1, np.nan, np.nan, np.nan, 9])
    assert not bool(found["stable"].sel(x=3)) and int(found["steps"].sel(x=5)) == 7


def test_a_function_that_never_works_is_no_result():
    with pytest.raises(Scan2FlexError, match="every lane of the first chunk failed: KeyError"):
        sweep(Calls(lambda lane: {"y": lane["z"]}, {"y": Output()}), grid(x=Axis([1.0, 2.0])))


def test_draws_have_one_dimension_and_their_inputs_as_coordinates():
    tilts = np.random.default_rng(0).normal(size=(5, 2, 3))
    task = Calls(lambda lane: {"size": np.linalg.norm(lane["tilt"])}, {"size": Output("rad")})
    found = sweep(task, draws(tilt=Axis(tilts, "rad")), chunk=2)
    np.testing.assert_allclose(found["size"], np.linalg.norm(tilts, axis=(1, 2)))
    np.testing.assert_array_equal(found["tilt"], tilts)
    assert found["size"].dims == ("draw",) and found["tilt"].units == "rad"


@pytest.mark.slow
def test_fits_from_guesses_are_the_fits_alone():
    study = replace(studies.example(), poses=studies.example().fit_poses)
    lanes = grid(guess_bending_stiffness=Axis([0.05, 0.2], "N m^2"), guess_torsional_stiffness=Axis([0.3], "N m^2"))
    found = sweep(fits(study), lanes)
    assert not failed(found)
    for EI in (0.05, 0.2):
        alone = fit(studies.guessed(study, bending_stiffness=EI, torsional_stiffness=0.3))
        lane = found.sel(guess_bending_stiffness=EI).isel(guess_torsional_stiffness=0)
        assert float(lane["bending_stiffness"]) == alone.estimates["bending_stiffness"].value
        assert float(lane["torsional_stiffness_std"]) == alone.estimates["torsional_stiffness"].std
        assert int(lane["steps"]) == alone.equilibria and bool(lane["stable"])
        assert float(lane["rms"]) == alone.rms() and 0 <= float(lane["out_of_balance"]) < 1e-6


@pytest.mark.slow
def test_a_guess_for_a_known_quantity_is_refused():
    lanes = grid(guess_length=Axis([1.0], "m"))
    said = failed(sweep(fits(studies.example()), lanes))["guess_length=1"]
    assert said == "'guess_length' is no guess for an unknown of the study: they are bending_stiffness, torsional_stiffness"


def test_turned_clamps_and_noise():
    """A turn about d3 leaves the tangent, one about d1 tilts it by its angle; noise is stated, and its size is right."""
    study = studies.example()
    turns = np.zeros((len(study.poses), 2, 3))
    turns[0, 0, 2], turns[0, 1, 0] = 0.3, 0.1
    pose = turned(study, turns).poses[0]
    np.testing.assert_allclose(pose.start.tangent, study.poses[0].start.tangent, atol=1e-12)
    np.testing.assert_allclose(pose.end.tangent @ study.poses[0].end.tangent, np.cos(0.1), rtol=1e-12)
    rough = noisy(study, 1e-3, seed=1)
    moved = np.concatenate([(a.curve.points - b.curve.points).ravel() for a, b in zip(rough.poses, study.poses, strict=True)])
    assert abs(np.std(moved) / 1e-3 - 1) < 0.1 and all(p.noise == 1e-3 for p in rough.poses)
    angles = np.linalg.norm(random_turns(2000, 3, 0.05), axis=-1)
    assert angles.max() <= 0.05 and abs(random_turns(2000, 3, 0.05).std() / (0.05 / 3) - 1) < 0.02


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (grid, "at least one"),
        (lambda: grid(x=[1.0]), "give an Axis"),
        (lambda: grid(x=Axis([])), "no values"),
        (lambda: grid(x=Axis([1.0, np.inf])), "not finite"),
        (lambda: grid(x=Axis(np.eye(2))), "use draws"),
        (lambda: Axis(["a"]), "must be numbers"),
        (lambda: draws(a=Axis([1.0]), b=Axis([1.0, 2.0])), "one length"),
        (lambda: draws(draw=Axis([1.0])), "another name"),
        (lambda: equilibria(scenes.hanging, ("ponits",)), "no known quantity"),
        (lambda: fits(studies.study_of(())), "nothing to fit"),
        (lambda: sweep(scenes.squares()[0], grid(x=Axis([1.0])), chunk=0), "1 or more"),
        (lambda: sweep(*scenes.squares(), at_once=2), "one lane at a time"),
        (lambda: sweep(*scenes.squares(), cost=[1.0]), "one number for each lane"),
        (lambda: turned(studies.example(), np.zeros((2, 3))), "a vector for each end"),
        (lambda: sweep(*scenes.squares(), share=(2, 2)), "no share"),
        (lambda: sweep(*scenes.squares(), share=(0, 2)), "through its store"),
        (lambda: sweep(scenes.squares()[0], grid(square=Axis([1.0]), x=Axis([1.0]))), "rename one"),
        (lambda: sweep(scenes.hanging_cables(), scenes.CLAMPS_APART, mesh=jax.make_mesh((1,), ("lane",))), "device_mesh"),
    ],
)
def test_bad_input_is_one_sentence(make, said):
    with pytest.raises(Scan2FlexError, match=said):
        make()
