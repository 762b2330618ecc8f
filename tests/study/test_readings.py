"""Angles, wrenches, changes and marks beside the axis: written and read back, described, and refused with one sentence."""

import numpy as np
import pytest

from scan2flex_jax.errors import StudyError
from scan2flex_jax.study import (
    Angle,
    Clamp,
    EffectDeclaration,
    Markers,
    Study,
    StudyPose,
    Wrench,
    check_study,
    describe,
    load_study,
    save_study,
)

NAN = np.nan
CLAMP = Clamp.of(([0, 0, 0], [0.5, 0.5, 0.5, 0.5]))
SLOPE = Angle(0.5, 0.1, 0.01, about=[0, 2, 0], zero=[1, 0, 0])
CHANGE = Angle(0.5, 0.1, 0.01, about=[0, 1, 0], of="d1")
FORCE = Wrench("start", force=[0, NAN, 3.0], force_noise=0.1, moment=[0, 0.1, 0], moment_noise=0.01, frame="clamp")


def study(*poses, **given):
    cable = {"length": 0.5, "length_density": 0.2, "torsional_stiffness": 1.0}
    return Study.from_arrays(cable, poses, ["bending_stiffness"], **given)


def pose(name="loaded", **given):
    return StudyPose(name, "fit", CLAMP, **given)


MARKS = Markers([[0.1, NAN, -0.01], [0.1, NAN, 0.02]], [0.5, 0.5], offset=[[0.01, 0.0], [-0.01, 0.0]])
WHOLE = study(pose("free"), pose(angle=[CHANGE], wrench=[FORCE], markers=MARKS, noise=1e-3, change_from="free"))


def test_they_are_written_and_read_back(tmp_path):
    toml = save_study(WHOLE, tmp_path / "one")
    assert load_study(toml) == WHOLE
    assert (tmp_path / "one" / "loaded-markers.csv").read_text().startswith("s,x,z,d1,d2\n")
    assert "force = [0.0, nan, 3.0]" in toml.read_text()


def test_a_pose_that_is_only_compared_is_not_fitted():
    check_study(WHOLE)
    assert [p.name for p in WHOLE.fit_poses] == ["loaded"]
    said = describe(WHOLE)
    assert "1 to fit" in said and "readings are changes from free" in said
    assert "0.1 +- 0.01 rad of d1 at s = 0.5 m about [0, 1, 0]" in said
    assert "[0, nan, 3] +- 0.1 N and [0, 0.1, 0] +- 0.01 N m of the start on the cable, in the axes of the clamp" in said


def test_the_axes_of_an_angle_are_of_any_length():
    np.testing.assert_allclose(Angle(0, 0, 1, about=[0, 3, 0], zero=[2, 5, 0]).axes[0], [0, 1, 0])
    assert np.cross(*SLOPE.axes[:2]) @ SLOPE.axes[0] == 0.0


@pytest.mark.parametrize(("make", "words"), [
    (lambda: Angle(0.5, 0.1, 0.01, about=[0, 0, 0]), "about: it has no length"),
    (lambda: Angle(0.5, 0.1, 0.01, about=[0, 1, 0], zero=[0, 2, 0]), "zero: it is along `about`"),
    (lambda: Angle(0.5, 0.1, -0.01, about=[0, 1, 0]), "noise: got -0.01"),
    (lambda: Angle(0.5, 0.1, 0.01, about=[0, 1, 0], of="d4"), 'of: got \'d4\': write "d1", "d2" or "d3"'),
    (lambda: Wrench("start"), "it has neither force nor moment"),
    (lambda: Wrench("start", force=[0, 0, 1]), "force_noise: it is missing"),
    (lambda: Wrench("start", force=[0, 0, 1], force_noise=0.1, moment_noise=0.1), "moment: it is missing"),
    (lambda: Wrench("start", force=[NAN] * 3, force_noise=0.1), "nan for a component that was not measured"),
    (lambda: Wrench("tip", force=[0, 0, 1], force_noise=0.1), 'end: got \'tip\': write "start" or "end"'),
    (lambda: pose(angle=[CHANGE]), "angle[1].zero: it is missing"),
    (lambda: pose(angle=0.1), "angle: got 0.1"),
    (lambda: pose(scan="a.ply", change_from="free"), "scan: a change is one of markers, angles and wrenches"),
])  # fmt: skip
def test_a_part_that_cannot_be_used(make, words):
    with pytest.raises(StudyError) as error:
        make()
    assert words in str(error.value)


@pytest.mark.parametrize(("whole", "words"), [
    (study(pose(angle=[Angle(500, 0.1, 0.01, [0, 1, 0], [1, 0, 0])])), "millimetres"),
    (study(pose(wrench=[Wrench("end", force=[0, 0, 1], force_noise=0.1)])), "the end of this pose is free"),
    (study(StudyPose("a", "fit", Clamp.of(([0, 0, 0], None)), CLAMP, wrench=[FORCE])), "is a ball joint, which has no moment"),
    (study(pose(angle=[CHANGE], change_from="none")), "no other pose is called 'none'"),
    (study(pose("a", angle=[CHANGE], change_from="b"), pose("b", angle=[CHANGE], change_from="a")), "holds changes itself"),
    (study(pose("free"), pose(angle=[SLOPE])), "pose[free]: it has no shape"),
    (study(
        pose("free"), pose(angle=[CHANGE], change_from="free"),
        effects=[EffectDeclaration("friction", {"share": 0.3, "slip_curvature": 1.0})],
    ), "has memory"),
])  # fmt: skip
def test_a_study_that_does_not_fit_together(whole, words):
    with pytest.raises(StudyError) as error:
        check_study(whole)
    assert words in str(error.value)
