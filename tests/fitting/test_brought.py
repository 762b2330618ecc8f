"""Studies as people bring them: hair, chains, power lines, rulers with a battery, a wing with weights; each with its right
answer from a closed form or a measurement."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scan2flex_jax import EffectDeclaration, Markers, Scan2FlexError, Study, StudyError, Unknown, fit, load_study, save_study
from scan2flex_jax.fitting.problem import Problem
from scan2flex_jax.posterior import branches
from tests.reference.cantilever import chain

from . import scenes

G = 9.81
LEVEL = [0.5**0.5, 0.0, 0.5**0.5, 0.0]  # d3 along x
BENDING = "bending_stiffness"


def sagged(x, EI, weight, length, loads=()):
    """Deflection (m, downward) of a cantilever at ``x`` by small-deflection beam theory: its weight per length (N/m), and loads
    ``(a, N)`` at distances ``a``."""
    own = weight * x**2 * (6 * length**2 - 4 * length * x + x**2) / (24 * EI)
    return own + sum(P * (x**2 * (3 * a - x) if x < a else a**2 * (3 * x - a)) / (6 * EI) for a, P in loads)


def ruler(loads, unknowns, declared, at=(0.2, 0.3), EI=0.05, length=0.3, density=1e-4):
    """A cantilever of which only the heights of two points were measured, in one pose for each of ``loads``."""
    poses = []
    for i, some in enumerate(loads):
        z = [-sagged(s, EI, density * G, length, some) for s in at]
        points = np.column_stack([np.full((2, 2), np.nan), z])
        poses.append({"name": f"b{i}", "start": ([0, 0, 0], LEVEL), "markers": Markers(points, list(at)), "noise": 1e-6})
    cable = {"length": length, "length_density": density, "torsional_stiffness": EI}
    return Study.from_arrays(cable, poses, unknowns, effects=declared)


PLACES, MASSES = (0.10, 0.16, 0.24), (1e-3, 1.5e-3, 2e-3)  # m, kg: deflections below 0.5 % of the length
BATTERIES = [[(a, m * G)] for a, m in zip(PLACES, MASSES, strict=True)]
KNOWN = [EffectDeclaration("point_mass", {"position": 0.30, "mass": 2e-3}, ("b3",))]
FULL = [*BATTERIES, [(0.30, 2e-3 * G)]]


@pytest.mark.slow
@pytest.mark.parametrize(("known", "sought"), [(("position", "mass"), None), (("position",), "mass"), (("mass",), "position")])
def test_batteries_of_known_mass_or_at_known_places(known, sought):
    """Heights alone tell the stiffness, and beside it the masses or the places of the batteries, each their own."""
    true = {"position": PLACES, "mass": MASSES, None: ()}
    declared = [EffectDeclaration("point_mass", {key: true[key][i] for key in known}, (f"b{i}",)) for i in range(3)]
    names = [f"point_mass[{i + 1}].{sought}" for i in range(len(true[sought]))]
    found = fit(ruler(FULL, [BENDING, *names], declared + KNOWN))
    np.testing.assert_allclose([found.estimates[n].value for n in names], true[sought], rtol=3e-3)
    assert sought == "position" or found.estimates[BENDING].value == pytest.approx(0.05, rel=1e-3)
    assert sought or (found.converged and found.rms() < 1e-6)
    assert sought != "mass" or "mass (point mass 2)" in found.summary()


def test_one_mass_that_several_places_share():
    """A battery at another place in each pose; the effect that states its mass is none of them."""
    shared = [[(a, 2e-3 * G)] for a in PLACES]
    declared = [EffectDeclaration("point_mass", {"position": a}, (f"b{i}",)) for i, a in enumerate(PLACES)]
    study = ruler([*shared, FULL[-1]], [BENDING, "point_mass.mass"], declared + KNOWN)
    assert study.effects_of("point_mass.mass") == (0, 1, 2)
    found = fit(study)
    assert found.estimates["point_mass.mass"].value == pytest.approx(2e-3, rel=3e-3)
    assert fit(found.calibrated).estimates["point_mass.mass"].value == pytest.approx(2e-3, rel=3e-3)


@pytest.mark.parametrize(("names", "said"), [
    (("point_mass[5].mass",), "nothing is called 'point_mass[5].mass'"),
    ((*(f"point_mass[{i}].mass" for i in (1, 2, 3, 4)), "point_mass.mass"), "of its own number"),
    ((), "point_mass needs its mass"),
])  # fmt: skip
def test_names_of_several_effects_that_cannot_be_meant(names, said):
    declared = [EffectDeclaration("point_mass", {"position": a}, (f"b{i}",)) for i, a in enumerate((*PLACES, 0.3))]
    with pytest.raises(StudyError, match=said.replace("[", r"\[").replace("]", r"\]")):
        fit(ruler(FULL, [BENDING, *names], declared))


def test_several_effects_and_some_coordinates_survive_the_disk(tmp_path):
    declared = [EffectDeclaration("point_mass", {"position": a}, (f"b{i}",)) for i, a in enumerate(PLACES)]
    study = ruler(FULL, [BENDING, "point_mass[2].mass", "point_mass.mass"], declared + KNOWN)
    save_study(study, tmp_path)
    assert (tmp_path / "b0-markers.csv").read_text().startswith("s,z\n")
    again = load_study(tmp_path)
    assert again == study and again.effects_of("point_mass.mass") == (0, 2)


def test_a_hair():
    """EI 4.7e-9 N m^2, 5.4e-6 kg/m, 20 mm: its tip sags by 1.1 % of the length."""
    study = ruler([[]], [BENDING], (), at=(0.012, 0.02), EI=4.7e-9, length=0.02, density=5.4e-6)
    found = fit(study)
    assert found.estimates[BENDING].value == pytest.approx(4.7e-9, rel=2e-3)
    assert not found.estimates[BENDING].at_bound


def catenary(span, length, noise, count=40, seed=3):
    """Points (m) on a chain between two hooks on one level, and their noise."""
    exact = chain(length, span, np.linspace(0.015, 0.985, count) * length)
    return exact + noise * np.random.default_rng(seed).standard_normal(exact.shape)


def hung(spans, length, noise, **cable):
    poses = [{"points": catenary(x, length, noise, seed=i), "start": ([0, 0, 0], None), "end": ([x, 0, 0], None)}
             for i, x in enumerate(spans)]  # fmt: skip
    return Study.from_arrays(cable, poses, ["length"])


@pytest.mark.slow
def test_the_length_of_a_power_line():
    found = fit(hung((200.0, 199.9), 200.5, 0.03, length_density=1.63, bending_stiffness=3e3, torsional_stiffness=2e3))
    e = found.estimates["length"]
    assert e.value == pytest.approx(200.5, abs=4 * e.std) and e.std < 1e-4 * 200.5
    assert found.believable


@pytest.mark.slow
def test_a_chain_too_limp_for_any_mesh_is_no_mistake_of_its_weight():
    with pytest.raises(Scan2FlexError, match="no equilibrium found") as fault:
        fit(hung((0.8,), 1.0, 1e-4, length_density=1.0, bending_stiffness=1e-12, torsional_stiffness=1e-12), elements=40)
    assert "g/m" not in str(fault.value)


def test_an_unknown_length_starts_from_the_curves_and_keeps_the_turns():
    """From a start of another length this study was solved with two turns too many."""
    cable = {k: v for k, v in scenes.example().cable.items() if k != "length"}
    study = replace(scenes.example(), cable=cable, unknowns=(Unknown("length"), *scenes.BOTH))
    found = fit(study)
    assert found.estimates["length"].value == pytest.approx(1.0, abs=1e-3)
    assert found.turned == () and all(p.turns == 0 for p in found.calibrated.poses)
    (slot,) = (slot for slot in found.problem.layout.slots if slot.name == "length")
    np.testing.assert_allclose(np.exp([slot.low[0], slot.high[0]]), [0.5, 10.0], rtol=1e-3)  # of the curves' 1 m


def test_turns_that_are_not_needed_are_given_back():
    """A cable that passes over itself loses two turns: both numbers give the same shape, and the stated one stands."""
    study = scenes.study_of()
    study = scenes.measured(study, scenes.exact_curves(study, scenes.TRUE))
    turned = Problem(branches.with_turns(study, {"twist-90": -2}), scenes.ELEMENTS)
    near = turned.minimise("least-squares", start=np.log(list(scenes.TRUE.values())))
    assert branches.distances(near.evaluation, turned.poses)[1] < 1e-6
    problem, minimum, _ = branches.on_its_branches(turned, near, "least-squares", lambda _: None, declared=study)
    assert [p.turns for p in problem.study.fit_poses] == [0, 0, 0] and minimum.converged


WING = Path(os.environ.get("SCAN2FLEX_DATA", "")) / "very-flexible-wing" / "bending-bare.csv"


@pytest.mark.skipif(not WING.is_file(), reason="SCAN2FLEX_DATA names no folder with the wing's weights (AIAA Journal 60, 2022)")
def test_the_first_weights_on_a_wing_predict_the_others():
    """Tip displacements up to 39 % of 0.55 m, against the unloaded wing; an elastica with EI from the first four rows misses
    the last by 5.4 mm (`solve_bvp`)."""
    length, rows = 0.55, np.loadtxt(WING, delimiter=",", skiprows=1)
    poses = [{"name": f"{m:g} kg", "role": "fit" if m <= 0.6 else "validate", "start": ([0, 0, 0], LEVEL),
              "markers": Markers([[np.nan, np.nan, z]], [length])} for m, z in rows]  # fmt: skip
    weights = [EffectDeclaration("point_mass", {"position": length, "mass": m}, (f"{m:g} kg",)) for m, _ in rows if m]
    sag = Unknown("scan_offset.offset", prior={"mean": [0.0, 0.0, 0.0], "std": 0.03})  # the unloaded wing's
    cable = {"length": length, "length_density": 0.321 / length, "torsional_stiffness": 7.5}
    found = fit(Study.from_arrays(cable, poses, [BENDING, sag], effects=[*weights, EffectDeclaration("scan_offset")]))
    assert found.estimates[BENDING].value == pytest.approx(4.28, rel=0.03)
    assert max(p.worst for p in found.poses.values()) < 5.4e-3
