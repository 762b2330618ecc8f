"""Scores of cases with a background: sizes, names, intervals, and what a table counts."""

import numpy as np
import pytest

from benchmarks import background_score, blind_score, coverage, scan_alarms, tables
from benchmarks.blind import effects

NULLS = {
    "natural_curvature": {"curvature": [0, 0, 0]}, "kink": {"angle": [0, 0, 0]}, "point_mass": {"mass": 0},
    "anisotropic_bending": {"ratio": 1, "angle": 0.3}, "bend_twist_coupling": {"coupling": [0, 0]},
    "nonlinear_bending": {"ratio": 1}, "stiffness_profile": {"factor": 1}, "extensibility": {"axial_stiffness": np.inf},
    "density_profile": {"factor": 1}, "uniform_load": {"force": [0, 0, 0]}, "point_load": {"force": [0, 0, 0]},
    "tether": {"stiffness": 0}, "elastic_clamp": {"stiffness": [np.inf, np.inf]}, "clamp_rotation": {"rotation": [[0, 0, 0]]},
    "clamp_offset": {"offset": [[0, 0, 0]]}, "length_error": {"length": 0.9}, "scan_scale": {"factor": 1},
    "scan_offset": {"offset": [0, 0, 0]},
}  # fmt: skip


@pytest.mark.parametrize("kind", background_score.SIZES)
def test_a_size_is_zero_where_the_effect_is_absent(kind):
    assert np.all(np.asarray(background_score.SIZES[kind](NULLS[kind], 0.9), float) == 0.0)


def test_every_kind_but_a_plane_has_a_size():
    assert {*background_score.SIZES, "support_plane"} == set(effects.CATALOGUE)
    assert background_score.size_off_by("support_plane", {}, {}, 1.0) is None


def test_sizes_are_compared_as_vectors_from_zero():
    off = background_score.size_off_by
    assert off("length_error", {"length": 1.011}, {"length": 1.010}, 1.0) == pytest.approx(0.1)
    assert off("scan_scale", {"factor": 0.98}, {"factor": 1.02}, 1.0) == pytest.approx(2.0)
    assert off("clamp_rotation", {"rotation": [[0.1, 0, 0]]}, {"rotation": [[0.1, 0, 0], [0, 0, 0]]}, 1.0) == 0.0
    turned = {"ratio": 0.5, "angle": 0.2 + np.pi / 2}
    assert off("anisotropic_bending", turned, {"ratio": 2.0, "angle": 0.2}, 1.0) == pytest.approx(0.0, abs=1e-12)


def answer(kinds=("point_mass",), **more):
    mass = {"kind": "point_mass", "position": 0.5, "mass": 0.10}
    known = {"kinds": list(kinds), "accept": list(kinds), "background": 0.004, "attained_validate": 0.005, "true_length": 1.0}
    known |= {"true_bending_stiffness": 1.0, "true_torsional_stiffness": 2.0, "plain_over_noise": 9.0}
    return known | {"effect": [mass] if kinds else []} | more


def result(verdict, mass=0.11, chosen=True, **more):
    EI, GJ = {"low": 0.9, "high": 1.1}, {"low": 2.1, "high": 2.3}
    one = [{"kind": "point_mass", "parameters": {"position": 0.5, "mass": mass}}] if chosen else []
    told = {"verdict": verdict, "chosen": one, "estimates": {"bending_stiffness": EI, "torsional_stiffness": GJ}}
    told |= {"plain_estimates": {"bending_stiffness": GJ, "torsional_stiffness": {"identifiable": False}}}
    told |= {"before": {"rms_fit": 0.1, "rms_validate": 0.1}, "after": {"rms_fit": 0.005, "rms_validate": 0.006}}
    return told | {"discrepancy": {"rms": 0.006}} | more


def test_a_row_says_what_was_asked_for():
    row = blind_score.score(result("partly explained"), answer())
    assert row["class"] == "background one"
    assert row["named"]
    assert row["size_off_by"] == pytest.approx(0.1)
    assert row["validate_over_attained"] == pytest.approx(1.2)
    assert row["discrepancy_over_true"] == pytest.approx(1.5)
    assert (row["covers_bending_stiffness"], row["covers_torsional_stiffness"]) == (True, False)
    assert row["plain_covers_bending_stiffness"] is False
    assert "plain_covers_torsional_stiffness" not in row  # withheld


@pytest.mark.parametrize(("found", "covers"), [((2.0, 0.1), True), ((0.5, 0.1 + np.pi / 2), False)], ids=["turned", "as drawn"])
def test_the_same_anisotropic_cable_may_be_told_by_its_other_axis(found, covers):
    """EI = 2 about one axis and 1 about the other: the interval [0.9, 1.1] is that of the second."""
    true = {"kind": "anisotropic_bending", "ratio": 0.5, "angle": 0.1 + np.pi / 2}
    known = answer(["anisotropic_bending"], effect=[true], true_bending_stiffness=2.0)
    told = [{"kind": "anisotropic_bending", "parameters": dict(zip(("ratio", "angle"), found, strict=True))}]
    row = blind_score.score(result("partly explained") | {"chosen": told}, known)
    assert row["covers_bending_stiffness"] is covers
    assert row["size_off_by"] == pytest.approx(0.0, abs=1e-12)


def test_parameters_are_counted_one_by_one_against_their_intervals():
    mass = {"parameters": {"position": 0.52, "mass": 0.11}, "std": {"position": 0.011, "mass": 0.004}}
    assert background_score.within_errors(mass, {"kind": "point_mass", "position": 0.5, "mass": 0.1}) == (2, 1)
    assert background_score.within_errors({"parameters": mass["parameters"]}, {"kind": "point_mass", "position": 0.5}) == (0, 0)
    both = {"parameters": {"rotation": [[0.1, 0, 0], [0, 0, 0]]}, "std": {"rotation": [[0.1, 0.1, 0.1], [0.1, 0.1, 0.1]]}}
    assert background_score.within_errors(both, {"kind": "clamp_rotation", "rotation": [[0.1, 0, 0]]}) == (0, 0)
    turned = {"parameters": {"ratio": 0.5, "angle": 0.2 - np.pi / 2}, "std": {"ratio": 0.01, "angle": 0.01}}
    for true in ({"ratio": 2.0, "angle": 0.2}, {"ratio": 0.5, "angle": 0.2 + np.pi / 2}):
        assert background_score.within_errors(turned, {"kind": "anisotropic_bending"} | true) == (2, 2)


def test_partly_explained_is_a_name_that_can_be_wrong():
    kink = [{"kind": "kink", "parameters": {"position": 0.5, "angle": [0, 0, 1], "width": 0.1}}]
    row = blind_score.score(result("partly explained", chosen=False) | {"chosen": kink}, answer())
    assert row["named_and_wrong"]
    assert not row["in_tie_set"]
    assert not blind_score.score(result("tied", chosen=False) | {"chosen": kink}, answer())["named_and_wrong"]


def test_the_table_counts_misses_against_all_cases():
    right, late = result("explained"), result("partly explained", mass=0.2)
    blind = result("unexplained", chosen=False, after={"rms_validate": 0.1})
    alone, alarm = result("no missing effect", chosen=False), result("partly explained")
    rows = [blind_score.score(r, answer()) for r in (right, late, blind, {"fault": "E: it broke"})]
    rows += [blind_score.score(r, answer(kinds=())) for r in (alone, alarm)]
    table = blind_score.table(rows)
    assert table["background_cases"] == 6
    assert table["background_alone_named"] == {"share": 0.5, "of": 2}
    assert table["background_in_tie_set"] == {"share": 0.5, "of": 4}
    assert table["background_size_within_15_percent"] == {"share": 0.25, "of": 4}
    assert table["background_validate_within_1.3"] == {"share": 0.5, "of": 4}
    assert table["background_coverage_95_plain_fit_alone"] == {"share": 0.0, "of": 2}
    assert table["truth_in_tie_set"]["of"] == 0  # pure cases are counted apart


def test_every_line_of_the_page_is_in_the_table():
    assert {key for key, *_ in tables._BACKGROUND} < set(background_score.table([]))


def test_coverage_tells_warned_and_withheld_values_apart():
    EI = {"value": 1.0, "std": 0.1, "low": 0.8, "high": 1.2}
    good = {"kinds": [], "background": 0.004, "believable": True, "covers_bending_stiffness": True}
    rows = [
        good | {"estimates": {"bending_stiffness": EI}},
        good | {"believable": False, "covers_bending_stiffness": False, "estimates": {"bending_stiffness": EI}},
        {"kinds": ["kink"], "background": 0.004, "fault": "not solved"},
    ]
    for row in rows[:2]:
        row["estimates"]["torsional_stiffness"] = {}
    table = coverage.table(rows)
    assert table["faults"] == 1
    assert table["alone_bending_stiffness"] == {
        "share": 0.5, "of": 2, "without_warning": {"share": 1.0, "of": 1}, "withheld": 0, "median_relative_std": 0.1,
    }  # fmt: skip
    assert table["alone_torsional_stiffness"]["withheld"] == 2
    assert table["with_effect_bending_stiffness"]["of"] == 0


def test_scans_count_alarms_and_agreement_with_curves():
    def told(verdict, *kinds):
        return {"verdict": verdict, "chosen": [{"kind": k} for k in kinds]}

    stiff = {"bending_stiffness": {"low": 0.1, "high": 0.19}, "torsional_stiffness": {"value": 1.0}}
    clear, mass = told("no missing effect"), told("explained", "point_mass")
    rows = {
        "n1": {"kinds": [], "scan": clear | {"estimates": stiff}, "curve": clear, "true": {"bending_stiffness": 0.2}},
        "n2": {"kinds": [], "scan": told("unexplained"), "curve": clear},
        "e1": {"kinds": ["point_mass"], "scan": mass, "curve": mass},
        "e2": {"kinds": ["kink"], "scan": told("tied", "kink"), "curve": told("explained", "kink")},
        "e3": {"kinds": ["tether"], "scan": {"verdict": "fault"}, "curve": clear},
    }
    table = scan_alarms.table(rows)
    assert table["alarms_scan"] == {"share": 0.5, "of": 2}
    assert table["alarms_curve"] == {"share": 0.0, "of": 2}
    assert table["covered_scan"] == {"share": 0.0, "of": 1} and table["covered_curve"]["of"] == 0
    assert table["named_as_from_curves"] == table["answered_as_from_curves"] == {"share": pytest.approx(1 / 3), "of": 3}
    assert table["right_curve"] == {"share": pytest.approx(2 / 3), "of": 3}
