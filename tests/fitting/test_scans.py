"""The fit of a study of scans: centre curves are extracted first. True shapes are those of the continuous equations."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from benchmarks import virtual_experiments as virtual
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.inference import fit
from scan2flex_jax.scan import scanner
from scan2flex_jax.study import Clamp, Study, StudyPose, Tolerance, Unknown
from tests.reference import cantilever, rotations

TRUE = virtual.PTFE.bending
PLAIN = Study("free", np.array([0.0, 0.0, -virtual.GRAVITY]), {}, (), unknowns=(Unknown("bending_stiffness"),))


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return virtual.study_of(virtual.PTFE, tmp_path_factory.mktemp("ptfe"), 1)


@pytest.fixture(scope="module")
def fitted(study):
    return fit(study)


def test_the_stiffness_of_the_virtual_cable_is_found(fitted):
    """A scan from two sides, with a table, clamp blocks and outliers: 1 %, inside the interval, 0.2 mm from the truth."""
    e = fitted.estimates["bending_stiffness"]
    assert fitted.converged and abs(e.value / TRUE - 1.0) < 0.01
    assert e.low < TRUE < e.high
    assert e.std < 0.01 * TRUE
    assert virtual.errors_along(virtual.PTFE, fitted, "sag", 0.0)["max_truth_mm"] < 0.2


def test_the_answer_says_that_curves_were_extracted(fitted):
    assert fitted.study.poses[0].curve is not None
    assert any("extracted from the scans" in s for s in fitted.sentences)


def test_a_study_without_a_radius_is_refused(study):
    with pytest.raises(Scan2FlexError, match="radius"):
        fit(replace(study, cable={k: v for k, v in study.cable.items() if k != "radius"}))


@pytest.mark.slow
def test_tolerances_of_the_clamps_are_priors_for_scans_too(study, fitted):
    e = fit(replace(study, tolerance=Tolerance(clamp_position=2e-4, clamp_rotation=0.01))).estimates["bending_stiffness"]
    assert e.low < TRUE < e.high
    assert e.std > fitted.estimates["bending_stiffness"].std


@pytest.mark.slow
@pytest.mark.parametrize("views", [1, 2])
def test_a_cable_with_a_free_end(tmp_path, views):
    """A heavy cantilever and a table under it, no guide points: found, fitted, inside the interval."""
    x = replace(virtual.PTFE, length=0.5, eyes=virtual.PTFE.eyes[:views])
    curve = cantilever.positions(x.length, x.bending, virtual.GRAVITY * x.density, 0.0, np.linspace(0.0, x.length, 401))
    clutter = [scanner.clamp_block(curve[0], -virtual.START[:, 2], x.radius), scanner.table(curve, x.radius)]
    seen = scanner.scan(curve, x.radius, np.array(x.eyes), x.sensor, 7, clutter=clutter)
    trimesh.PointCloud(seen.points).export(tmp_path / "hangs.ply")
    start = Clamp(np.zeros(3), rotations.quaternion(virtual.START))
    pose = StudyPose("hangs", "fit", start, None, scan=tmp_path / "hangs.ply", viewpoints=np.array(x.eyes))
    cable = {"length": x.length, "radius": x.radius, "length_density": x.density, "torsional_stiffness": x.torsion}
    cable |= {"shear_stiffness": virtual.RIGID, "axial_stiffness": virtual.RIGID}
    f = fit(replace(PLAIN, cable=cable, poses=(pose,), folder=tmp_path))
    e = f.estimates["bending_stiffness"]
    assert e.low < TRUE < e.high
    assert e.std < 0.02 * TRUE
    assert np.linalg.norm(f.poses["hangs"].modelled[-1] - curve[-1]) < 1e-3
