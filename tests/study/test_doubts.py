"""What `check` doubts before any fit: a weight, a radius, a direction of gravity or a scan that no cable has."""

import numpy as np
import pytest

from scan2flex_jax.errors import Scan2FlexError, StudyError
from scan2flex_jax.examples import example_names, example_path
from scan2flex_jax.study import load_study, study_warnings
from scan2flex_jax.study.scans import scan_facts
from tests.study.samples import STUDY, curve, write_sample


def doubts(folder, old, new):
    """The warnings of the sample with one piece of its text exchanged."""
    assert old in STUDY
    write_sample(folder, STUDY.replace(old, new))
    return " ".join(study_warnings(load_study(folder)))


def test_a_cable_heavier_than_cables_is_doubted(tmp_path):
    """0.336 kg/m written in g/m; and 2 kg/m, which a radius of 4 mm could hold only of 40,000 kg/m^3."""
    assert "weighs" not in doubts(tmp_path, "length_density = 0.336", "length_density = 0.9")
    assert "weighs 336 kg/m: check the unit" in doubts(tmp_path, "length_density = 0.336", "length_density = 336.0")
    assert "weighs 2 kg/m" in doubts(tmp_path, "length_density = 0.336", "length_density = 2.0")


def test_a_cable_that_stands_against_gravity_is_doubted(tmp_path):
    assert "point the right way" not in doubts(tmp_path, "-9.81]", "-9.81]")
    assert "point the right way" in doubts(tmp_path, "-9.81]", "9.81]")


@pytest.mark.parametrize("name", example_names())
def test_the_examples_are_not(name):
    said = " ".join(study_warnings(load_study(example_path(name))))
    assert "weighs" not in said
    assert "right way" not in said


def test_a_radius_in_millimetres_is_refused(tmp_path):
    with pytest.raises(StudyError, match=r"cable.radius: the radius is 4 m on a cable of at most 0.906 m: write both"):
        doubts(tmp_path, "radius = 0.004", "radius = 4.0")


def test_a_scan_tells_its_points_and_its_size(tmp_path):
    points = curve(50)
    np.savetxt(tmp_path / "sag.xyz", points)
    count, size = scan_facts(tmp_path / "sag.xyz")
    assert count == 50
    np.testing.assert_allclose(size, np.ptp(points, axis=0))
    (tmp_path / "sag.ply").write_text("hello")
    with pytest.raises(Scan2FlexError, match=r"cannot be read as a point cloud .*: export it again"):
        scan_facts(tmp_path / "sag.ply")
    with pytest.raises(Scan2FlexError, match="is not there"):
        scan_facts(tmp_path / "nowhere.ply")
