"""The reference solutions that other programs are measured against agree with the closed forms and solvers of the tests."""

import json
from pathlib import Path

import numpy as np
import pytest
from reference import elastica

from benchmarks.peers import compare, continuum, problems
from benchmarks.peers.bench import Process

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


def test_ratios_compare_with_our_fastest_run_beside_it_that_is_as_accurate():
    """The other record of our own solver, made earlier at another speed of the machine, plays no part."""
    errors, seconds = {10: 1e-3, 20: 1e-5, 40: 1e-6}, {"10": 1.0, "20": 2.0, "40": 3.0}
    rows = [
        {"peer": compare.OURS, "problem": "a", "size": n, "error": error, "seconds": 0.1, "beside": {}}
        for n, error in errors.items()
    ]
    rows.append({"peer": "other", "problem": "a", "size": 20, "error": 1e-4, "seconds": 8.0, "beside": seconds})
    rows.append({"peer": "other", "problem": "a", "size": 40, "failed": "did not settle"})
    assert [r["seconds"] for r in compare.with_the_least(rows)[:4]] == [0.1, 0.1, 0.1, 8.0]
    rows[1]["seconds"] = 5.0  # a slow spell
    assert compare.with_the_least(rows)[1]["seconds"] == 2.0
    ratios = compare.ratios(rows)
    found = ratios["other"]
    assert found["seconds over ours at equal accuracy"] == {"least": 4.0, "median": 4.0, "of": 1}
    assert found["error over ours at equal mesh"]["least"] == pytest.approx(10.0)
    assert (found["runs"], found["failed"], found["runs more accurate than any of ours"]) == (1, 1, 0)
    watched = compare.watched({"ratios": ratios, "fits": {"Nelder-Mead": {"seconds over the first": 20.0}}})
    assert sorted(watched.values()) == pytest.approx([0.05, 0.1, 0.25])  # ours over theirs: smaller is better


def test_two_processes_are_asked_in_turn_and_a_peer_that_is_not_there_says_so():
    with_scipy = Process("solve_bvp")
    assert with_scipy.about["versions"]["scipy"] and with_scipy.ready
    for _ in range(2):  # asked again it repeats what it has
        answer = with_scipy.ask("level", 1e-2)
        assert answer["found"][0]["seconds"] > 0 and answer["repeats"] >= 3
        assert 10 < answer["memory_MB"] < 500  # of this process, not of the one that started it
    with_scipy.close()
    gone = Process("solve_bvp", interpreter="/bin/false")
    assert "ended with code 1" in gone.about["failed"] and "failed" in gone.ask("level", 1e-2)
