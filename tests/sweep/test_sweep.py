"""A sweep gives what its samples give alone, with a verdict for every one and labels on everything."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr

from scan2flex_jax import plot
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.inference import fit
from scan2flex_jax.statics.solve import equilibrium
from scan2flex_jax.statics.verdict import SOLVED
from scan2flex_jax.sweep import Outcome, Output, Task, draws, equilibria, failed, fits, grid, noisy, random_turns, sweep, turned
from scan2flex_jax.sweep.task import FAULT, NOT_RUN, REFUSED
from tests.fitting import scenes as studies

from . import scenes

mpl.use("Agg")


@pytest.fixture(scope="module")
def swept():
    lines = []
    return sweep(scenes.hanging_cables(), scenes.CLAMPS_APART, chunk=4, progress=lines.append), lines


@pytest.mark.slow
def test_every_sample_is_the_equilibrium_alone(swept):
    found, _ = swept
    for span in scenes.SPANS:
        for stiffness in scenes.STIFFNESSES[:2]:
            model, boundary = scenes.hanging({"span": span, "bending_stiffness": stiffness})
            e = equilibrium(model, boundary, elements=scenes.ELEMENTS, max_steps=60)
            sample = found.sel(span=span, bending_stiffness=stiffness)
            assert int(sample.code) == SOLVED and bool(sample.stable) and int(sample.steps) == int(e.verdict.steps)
            np.testing.assert_allclose(sample["points"], e.points, atol=1e-12)
            np.testing.assert_allclose(sample["energy"], e.energy, rtol=1e-12)
            np.testing.assert_allclose(sample["reaction_force"], e.reactions()[0], rtol=1e-7, atol=1e-9)


@pytest.mark.slow
def test_cables_too_limp_fail_alone_and_are_named(swept):
    found, _ = swept
    names = {f"span={x:g}, bending_stiffness=1e-06" for x in scenes.SPANS}
    assert set(failed(found)) == names
    assert all("equilibrium" in words or "elements" in words for words in failed(found).values())
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
    assert any("6 of 6 samples, 2 failed" in line for line in lines)


@pytest.mark.slow
def test_a_vectorised_batch_gives_what_the_loop_gives(swept):
    """With a last batch that is filled up: only rounding differs, and a failed sample harms no other."""
    found, _ = swept
    batched = sweep(scenes.hanging_cables(), scenes.CLAMPS_APART, chunk=4, devices=jax.local_devices())
    np.testing.assert_array_equal(batched["code"], found["code"])
    for name in scenes.QUANTITIES:
        np.testing.assert_allclose(batched[name], found[name], rtol=1e-6, atol=1e-9)


def test_what_a_function_raises_is_the_status_of_its_sample():
    def root(sample):
        if sample["x"] == 2:
            raise Scan2FlexError("two is refused")
        if sample["x"] == 3:
            raise ValueError("three is a fault")
        if sample["x"] == 4:
            return {"root": np.nan}
        if sample["x"] == 5:
            return Outcome({"root": 9.0}, 20, steps=7)
        return {"root": np.sqrt(sample["x"])}

    found = sweep(Task(root, {"root": Output("m")}), grid(x=[0, 1, 2, 3, 4, 5]), chunk=3)
    np.testing.assert_array_equal(found["code"], [0, 0, REFUSED, FAULT, 2, 20])
    assert failed(found)["x=2"] == "two is refused" and failed(found)["x=3"] == "ValueError: three is a fault"
    np.testing.assert_array_equal(found["root"], [0, 1, np.nan, np.nan, np.nan, 9])
    assert not bool(found["stable"].sel(x=3)) and int(found["steps"].sel(x=5)) == 7


def test_a_function_that_never_works_is_no_result():
    with pytest.raises(Scan2FlexError, match="every sample of the first chunk failed: KeyError"):
        sweep(Task(lambda sample: {"y": sample["z"]}, {"y": Output()}), grid(x=[1.0, 2.0]))


def test_draws_have_one_dimension_and_their_inputs_as_coordinates():
    tilts = np.random.default_rng(0).normal(size=(5, 2, 3))
    task = Task(lambda sample: {"size": np.linalg.norm(sample["tilt"])}, {"size": Output("rad")})
    found = sweep(task, draws(tilt=(tilts, "rad")), chunk=2)
    np.testing.assert_allclose(found["size"], np.linalg.norm(tilts, axis=(1, 2)))
    np.testing.assert_array_equal(found["tilt"], tilts)
    assert found["size"].dims == ("draw",) and found["tilt"].units == "rad"


def test_a_grid_and_draws_merge_to_every_combination():
    samples = xr.merge([grid(scale=[1.0, 10.0]), draws(row=([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]], "m"))])
    task = Task(lambda sample: {"sum": sample["scale"] * sample["row"].sum()}, {"sum": Output("m")})
    np.testing.assert_array_equal(sweep(task, samples)["sum"], [[3.0, 7.0, 11.0], [30.0, 70.0, 110.0]])
    np.testing.assert_array_equal(sweep(task, samples.isel(scale=1, draw=slice(1, None)))["sum"], [70.0, 110.0])


def test_an_output_has_one_shape():
    for chunk in (1, 8):
        with pytest.raises(Scan2FlexError, match="make it the same in all"):
            sweep(Task(lambda s: {"y": np.ones(int(s["x"]))}, {"y": Output("-", ("k",))}), grid(x=[1.0, 2.0]), chunk=chunk)


@pytest.mark.slow
def test_fits_from_guesses_are_the_fits_alone():
    study = replace(studies.example(), poses=studies.example().fit_poses)
    samples = grid(guess_bending_stiffness=([0.05, 0.2], "N m^2"), guess_torsional_stiffness=([0.3], "N m^2"))
    found = sweep(fits(study), samples)
    assert not failed(found)
    for EI in (0.05, 0.2):
        alone = fit(studies.guessed(study, bending_stiffness=EI, torsional_stiffness=0.3))
        sample = found.sel(guess_bending_stiffness=EI).isel(guess_torsional_stiffness=0)
        assert float(sample["bending_stiffness"]) == alone.estimates["bending_stiffness"].value
        assert float(sample["torsional_stiffness_std"]) == alone.estimates["torsional_stiffness"].std
        assert int(sample["steps"]) == alone.equilibria and bool(sample["stable"])
        assert float(sample["rms"]) == alone.rms() and 0 <= float(sample["out_of_balance"]) < 1e-6


@pytest.mark.slow
def test_a_guess_for_a_known_quantity_is_refused():
    samples = grid(guess_length=([1.0], "m"))
    said = failed(sweep(fits(studies.example()), samples))["guess_length=1"]
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


def test_a_plain_function_of_an_equilibrium_is_a_number_without_a_unit():
    task = equilibria(scenes.hanging, {"lowest": lambda e: jnp.min(e.points[:, 2])}, elements=scenes.ELEMENTS, max_steps=60)
    found = sweep(task, grid(span=([0.6], "m"), bending_stiffness=([0.2], "N m^2")))
    standard = sweep(scenes.hanging_cables(), grid(span=([0.6], "m"), bending_stiffness=([0.2], "N m^2")))
    assert float(found["lowest"].squeeze()) == pytest.approx(float(standard["points"].isel(axis=2).min()))
    assert found["lowest"].attrs.get("units", "-") == "-"
    assert equilibria(scenes.hanging, "points").outputs.keys() == {"points"}


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: sweep(scenes.squares()[0], grid()), "at least one"),
        (lambda: sweep(scenes.squares()[0], {"x": [1.0]}), "make them by grid"),
        (lambda: grid(x=[]), "no values"),
        (lambda: grid(x=[1.0, np.inf]), "not finite"),
        (lambda: grid(x=np.eye(2)), "use draws"),
        (lambda: grid(x=["a"]), "must be numbers"),
        (lambda: draws(a=[1.0], b=[1.0, 2.0]), "one length"),
        (lambda: draws(draw=[1.0]), "another name"),
        (lambda: equilibria(scenes.hanging, ("ponits",)), "no known quantity"),
        (lambda: fits(studies.study_of(())), "nothing to fit"),
        (lambda: sweep(scenes.squares()[0], grid(x=[1.0]), chunk=0), "1 or more"),
        (lambda: sweep(*scenes.squares(), devices=jax.local_devices()), "for a traced task"),
        (lambda: sweep(scenes.hanging_cables(), scenes.CLAMPS_APART, devices=[]), "1 or more"),
        (lambda: turned(studies.example(), np.zeros((2, 3))), "a vector for each end"),
        (lambda: sweep(scenes.squares()[0], grid(square=[1.0], x=[1.0])), "rename one"),
    ],
)
def test_bad_input_is_one_sentence(make, said):
    with pytest.raises(Scan2FlexError, match=said):
        make()


def test_basins_show_ends_and_failures_and_nothing_where_no_fit_was_run():
    def estimate(sample):
        EI, GJ = sample["guess_bending_stiffness"], sample["guess_torsional_stiffness"]
        if EI > 1.0 and GJ > 1.0:
            raise Scan2FlexError("no equilibrium")
        right = EI < 1.0
        return {"bending_stiffness": 0.1 if right else 0.2, "torsional_stiffness": 0.25, "cost": float(not right)}

    outputs = dict.fromkeys(("bending_stiffness", "torsional_stiffness", "cost"), Output())
    guesses = (np.geomspace(0.01, 100.0, 5), "N m^2")
    found = sweep(Task(estimate, outputs), grid(guess_bending_stiffness=guesses, guess_torsional_stiffness=guesses))
    found["code"][0, 0] = NOT_RUN
    for name in outputs:
        found[name][0, 0] = np.nan
    ax = plot.basins(found)
    crosses = ax.lines[0].get_xydata()
    assert len(crosses) == 4 and np.all(crosses > 1.0)
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["0.1, 0.25 (9)", "0.2, 0.25 (11)"]
    plt.close("all")
