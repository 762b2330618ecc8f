"""The reference solutions that other programs are measured against agree with the closed forms and solvers of the tests."""

import json
from pathlib import Path

import numpy as np
import pytest
from reference import elastica

from benchmarks.peers import compare, continuum, problems

VALUES = Path(__file__).parent / "reference" / "values"


@pytest.mark.parametrize(("name", "case"), [("level", "P1"), ("twisted", "P2")])
def test_clamped_problems_are_the_poses_of_the_tests(name, case):
    """Two collocations that share no code; the values are stored with 12 decimals."""
    known = json.loads((VALUES / f"{case}.json").read_text())
    curve = continuum.solve(problems.PROBLEMS[name], 1e-6)
    assert np.linalg.norm(curve.at(np.array(known["s"])) - np.array(known["positions"]), axis=1).max() < 1e-7
    assert continuum.shooting_miss(curve) < 1e-5


def test_cantilever_against_shooting():
    """Stretch and shear (1e5 N) move the tip by 1e-5 of the length; the shooting has neither."""
    p = problems.PROBLEMS["cantilever"]
    drop, x, _ = elastica.heavy_cantilever(p.weight * p.length**3 / p.bending)
    tip = continuum.solve(p._replace(stretching=1e12), 1e-6).at([p.length])[0]
    np.testing.assert_allclose(tip, [x, 0.0, -drop], atol=1e-7)


@pytest.mark.parametrize("centred", [False, True])
@pytest.mark.parametrize("name", problems.PROBLEMS)
def test_start_chains_have_equal_links_and_go_through_the_clamps(name, centred):
    p = problems.PROBLEMS[name]
    ds, vertices, frames = problems.start_chain(p, 12, centred)
    links = np.diff(vertices, axis=0)
    np.testing.assert_allclose(np.linalg.norm(links, axis=1), ds, rtol=1e-8)
    np.testing.assert_allclose(frames[:, :, 2], links / ds, atol=1e-7)
    np.testing.assert_allclose(frames[0], p.start_frame, atol=1e-12)
    inside = 0.5 * ds if centred else 0.0
    np.testing.assert_allclose(vertices[0] + inside * links[0] / ds, 0.0, atol=1e-12)
    if not p.free:
        np.testing.assert_allclose(frames[-1], p.end_frame, atol=1e-7)
        np.testing.assert_allclose(vertices[-1] - inside * links[-1] / ds, p.end, atol=1e-12)


def test_ratios_compare_with_our_fastest_run_that_is_as_accurate():
    rows = [
        {"peer": compare.OURS, "problem": "a", "size": 10, "error": 1e-3, "seconds": 1.0, "memory_MB": 1},
        {"peer": compare.OURS, "problem": "a", "size": 20, "error": 1e-5, "seconds": 2.0, "memory_MB": 1},
        {"peer": "other", "problem": "a", "size": 20, "error": 1e-4, "seconds": 8.0, "memory_MB": 1},
        {"peer": "other", "problem": "a", "size": 40, "failed": "did not settle"},
    ]
    found = compare.ratios(rows)["other"]
    assert found["seconds over ours at equal accuracy"]["least"] == 4.0
    assert found["error over ours at equal mesh"]["least"] == pytest.approx(10.0)
    assert found["failed"] == 1
    worse = {"other": found | {"error over ours at equal mesh": {"least": 5.0, "median": 5.0, "of": 1}}}
    assert len(compare.fallen({"other": found}, worse)) == 1
    assert compare.fallen({"other": found}, {"other": found}) == []
