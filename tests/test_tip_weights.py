"""How a table of markers becomes a study: frames, signs, roles, and what two series say together. Nothing is solved."""

import numpy as np
import pytest

from benchmarks import tip_weights as tw
from scan2flex_jax.study.sense import check_study

LENGTH = 0.8


def clone(folder, rows):
    """Two series of a cable that nobody has, in the folders of the two repositories."""
    for name, end in (("black_unweighted", 0.02), ("black_weighted", 0.12)):
        table = folder / "measured" / tw.FOLDER / f"{name}_equilibria"
        table.mkdir(parents=True)
        head = "Gamma,Theta0,Theta1,X_mid,Z_mid,X_end,Z_end\n"
        (table / "theta_equilibria.csv").write_text(head + "".join(",".join(map(str, row)) + "\n" for row in rows))
        numbers = folder / "stated" / "object_parameters" / f"{name}.txt"
        numbers.parent.mkdir(parents=True, exist_ok=True)
        numbers.write_text(f"0.4,{end},{LENGTH},0.02,0.1,0.2,1.2,0.03\n")
    return folder / "measured", folder / "stated"


@pytest.fixture
def series(tmp_path):
    """A stiff cable: its markers stay on the clamp's axis, whatever the angle."""
    angles = (0.0, 0.5 * np.pi, -0.5 * np.pi, 0.3, -0.3, 1.0, -1.0)
    folders = clone(tmp_path, [(angle, 0, 0, 0.0, -LENGTH / 2, 0.0, -LENGTH) for angle in angles])
    return [tw.read("black", weighted, *folders) for weighted in (False, True)]


def test_what_is_stated_is_read_with_its_units(series):
    without, weighed = series
    assert (without.end_mass, weighed.end_mass) == (0.02, 0.12)
    assert without.rest_curvature == pytest.approx((0.2 + 1.2 / 2) / LENGTH)  # the mean of an affine curvature
    assert tw.cable_of(without)["length_density"] == pytest.approx(0.5)
    assert without.bending_stiffness == pytest.approx(0.1 * LENGTH)
    assert without.ranks.tolist() == [3, 6, 0, 4, 2, 5, 1]  # the poses keep the order of the file


def test_the_cable_leaves_along_its_tangent_and_a_positive_angle_turns_it_to_minus_x(series):
    study = tw.study_of(series[0], 0.02, None)
    for pose, angle in zip(study.poses, series[0].angles, strict=True):
        assert pose.markers.points[-1] == pytest.approx(LENGTH * pose.start.tangent, abs=1e-12)
        assert pose.markers.points[-1] == pytest.approx([-LENGTH * np.sin(angle), 0, -LENGTH * np.cos(angle)], abs=1e-12)
        assert pose.markers.arc_length == pytest.approx([LENGTH / 2, LENGTH])


def test_a_clamp_turned_level_sees_gravity_pull_along_its_x(series):
    """At +90 degrees the axis x of the turned frame points down: a marker with positive X has sagged."""
    assert tw.turned(np.pi / 2) @ [1.0, 0.0, 0.0] == pytest.approx([0.0, 0.0, -1.0])


def test_positive_curvature_about_d2_bends_a_hanging_cable_to_minus_x():
    d2, d3 = tw.HANGING[:, 1], tw.HANGING[:, 2]
    assert np.linalg.det(tw.HANGING) == pytest.approx(1.0)
    assert np.cross(d2, d3) == pytest.approx([-1.0, 0.0, 0.0])  # d3' = kappa_2 d2 x d3


def test_every_third_pose_by_angle_is_fitted(series):
    roles = {p.name[-2:]: p.role for p in tw.study_of(series[0], 0.02, None).poses}
    assert list(roles) == ["03", "06", "00", "04", "02", "05", "01"]
    assert [rank for rank, role in roles.items() if role == "fit"] == ["03", "06", "00"]


@pytest.mark.parametrize("how", tw.TOGETHER.values(), ids=tw.TOGETHER)
def test_both_series_make_one_study(series, how):
    study = tw.together(*series, None, **how)
    check_study(study)
    load, weight, curved, *more = study.effects
    known_weight = how.get("known_weight", False)
    assert load.parameters["force"] == pytest.approx([0, 0, -9.81 * 0.02])
    assert set(weight.poses) == {p.name for p in study.poses if p.name.startswith("black_weighted")}
    assert curved.kind == "natural_curvature"
    asked = "length_density" if known_weight else "point_mass.mass"
    own = {f"{e.kind}.{name}" for e in more for name in tw.STARTS[e.kind]}
    assert {e.kind for e in more} == {how["beside"]} if "beside" in how else not more
    assert set(study.unknown_names) == {"bending_stiffness", asked, "natural_curvature.curvature"} | own
    assert [p.reset for p in study.poses] == [False] * 7 + [True] + [False] * 6  # each series without history before it
    if known_weight:
        assert weight.parameters["mass"] == pytest.approx(0.1)


def test_both_series_are_joined_with_the_effects_found_in_one(series):
    kink = {"kind": "kink", "parameters": {"position": 0.3, "angle": [0.0, 0.5, 0.0], "width": 0.1}}
    study = tw.together(*series, None, told={"added": [kink]})
    check_study(study)
    assert [e.kind for e in study.effects] == ["point_load", "point_mass", "kink"]
    unknowns = {u.name: u.guess for u in study.unknowns}
    assert unknowns["kink.angle"] == pytest.approx([0.0, 0.5, 0.0])
    assert "natural_curvature.curvature" not in unknowns


def test_a_folder_that_is_no_clone_is_named(tmp_path):
    with pytest.raises(SystemExit, match=r"theta_equilibria\.csv is missing: name the clones"):
        tw.read("black", True, tmp_path, tmp_path)
