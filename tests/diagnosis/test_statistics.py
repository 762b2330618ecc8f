"""The statistics on synthetic numbers: only linear algebra, no cable."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from scan2flex_jax.diagnosis import confirm, evidence, families, pairs, score, verdict
from scan2flex_jax.diagnosis.refit import Refit
from scan2flex_jax.diagnosis.residual import Law, orthonormal, signature_basis
from scan2flex_jax.fitting.noise import Noise

ROWS = 120


def groups(rng, count=12, width=2, one_sided=False):
    base = orthonormal(rng.standard_normal((ROWS, 3)))
    sided = (one_sided,) * width
    return base, [score.group_of(k, rng.standard_normal((ROWS, width)), np.ones(width), base, sided) for k in range(count)]


def test_false_alarms_come_at_the_stated_rate():
    rng = np.random.default_rng(1)
    base, many = groups(rng)
    gains = {"field": families.family_of("field", rng.standard_normal((ROWS, 8)), base).gain}

    def noise(n):
        y = rng.standard_normal((ROWS, n))
        return y - base @ (base.T @ y)

    draws, trials = noise(300), 300
    p = np.array([score.global_test(many, gains, y, draws, ROWS - 3).p_value for y in noise(trials).T])
    for level in (0.05, 0.2):
        assert abs(np.mean(p <= level) - level) < 4 * np.sqrt(level * (1 - level) / trials)


def test_a_strong_effect_is_found_in_its_group():
    rng = np.random.default_rng(2)
    base, many = groups(rng)
    y = many[5].X @ np.array([1.0, -1.0]) + rng.standard_normal(ROWS)
    y, draws = (v - base @ (base.T @ v) for v in (y, rng.standard_normal((ROWS, 200))))
    found = score.global_test(many, {}, y, draws, ROWS - 3)
    assert found.best == 5
    assert found.p_value < 0.01


def test_a_one_sided_effect_of_the_wrong_sign_counts_nothing():
    rng = np.random.default_rng(3)
    _, many = groups(rng, 1, 1, one_sided=True)
    y = many[0].X[:, :1]
    assert score.statistics(many, y)[0, 0] > 0
    assert score.statistics(many, -y)[0, 0] == 0


def test_evidence_is_the_ratio_of_gaussian_likelihoods():
    rng = np.random.default_rng(4)
    X, y = rng.standard_normal((20, 3)), rng.standard_normal(20)
    ratios = []
    for scale in evidence.SCALES:
        with_effect = np.eye(20) + scale**2 * X @ X.T
        ratios.append(np.exp(-0.5 * (y @ np.linalg.solve(with_effect, y) + np.linalg.slogdet(with_effect)[1]) + 0.5 * y @ y))
    assert evidence.log_evidence(X.T @ X, X.T @ y) == pytest.approx(np.log(np.mean(ratios)))


def test_one_sided_evidence_is_that_of_half_the_prior():
    A, b = np.array([[4.0]]), np.array([3.0])
    a, t = np.linspace(0, 12, 200001), np.array(evidence.SCALES)[:, None]
    density = np.mean(2 * np.exp(-0.5 * (a / t) ** 2) / (np.sqrt(2 * np.pi) * t), axis=0)
    exact = np.log(np.trapezoid(density * np.exp(b[0] * a - 0.5 * A[0, 0] * a**2), a))
    assert evidence.log_evidence(A, b, (True,)) == pytest.approx(exact, abs=1e-6)


def test_an_exact_scan_leaves_evidence_finite():
    """Signatures a billion times the noise and nearly parallel: rounding must not turn a variance negative."""
    rng = np.random.default_rng(7)
    x = 1e9 * rng.standard_normal(50)
    X = np.stack([x, x * (1 + 1e-12)], axis=1)
    y = X @ [1.0, 0.5]
    found = evidence.log_evidence(X.T @ X, X.T @ y, (True, True))
    assert found == pytest.approx(0.5 * y @ y, rel=1e-3)


def test_an_effect_of_three_times_its_size_loses_less_than_a_normal_prior_would_take():
    A, strong = np.array([[1e4]]), np.array([3e4])  # seen to a hundredth of its size, and three times as large
    normal = 0.5 * strong @ np.linalg.solve(np.eye(1) + A, strong) - 0.5 * np.log(1 + 1e4)
    assert normal + 1.5 < evidence.log_evidence(A, strong) < normal + 4.5


def test_pairs_from_the_gram_matrix_are_those_of_brute_force():
    rng = np.random.default_rng(5)
    _, many = groups(rng, 8)
    y = many[1].X @ [0.7, 0.2] + many[6].X @ [-0.4, 0.6] + rng.standard_normal(ROWS)
    kinds = list("abcdefgh")
    singles = np.array([evidence.log_evidence(g.X.T @ g.X, g.X.T @ y) for g in many])
    found = pairs.best_pairs(many, y, singles, kinds)
    brute = {}
    for i in range(8):
        for j in range(i):
            X = np.column_stack([many[i].X, many[j].X])
            brute[frozenset((i, j))] = evidence.log_evidence(X.T @ X, X.T @ y)
    assert frozenset(found[0][1:]) == max(brute, key=brute.get) == frozenset((1, 6))
    assert found[0][0] == pytest.approx(max(brute.values()))


def test_discrepancy_fields_gain_by_structure_only():
    rng = np.random.default_rng(6)
    field = families.family_of("field", rng.standard_normal((ROWS, 6)), np.zeros((ROWS, 0)))
    noise = rng.standard_normal((ROWS, 200))
    assert np.mean(field.gain(noise) > 3.0) < 0.05
    assert field.gain(3.0 * field.U[:, :3].sum(axis=1, keepdims=True) + noise[:, :1])[0] > 3.0


def test_the_basis_of_signatures_carries_them():
    rng = np.random.default_rng(7)
    base = orthonormal(rng.standard_normal((ROWS, 2)))
    S = rng.standard_normal((ROWS, 4)) @ rng.standard_normal((4, 30))
    basis = signature_basis(S, base)
    left = S - base @ (base.T @ S)
    assert basis.shape[1] == 4
    np.testing.assert_allclose(basis @ (basis.T @ left), left, atol=1e-8)


@pytest.mark.parametrize(("lead", "words"), [(6.0, "named"), (4.0, "favoured"), (2.0, "tied")])
def test_the_lead_decides_the_word(lead, words):
    candidates = [verdict.Candidate(("a",), 20.0 - lead), verdict.Candidate(("b",), 20.0)]
    assert verdict.leading(candidates) == words
    assert verdict.ties(candidates) == ([1, 0] if words == "tied" else [1])


@pytest.mark.parametrize(
    ("p_value", "p_after", "evidences", "expected"),
    [
        (0.3, 0.5, (20.0,), "no missing effect"),
        (0.001, 0.5, (20.0, 5.0), "explained"),
        (0.001, 0.5, (20.0, 18.5), "tied"),
        (0.001, 0.001, (20.0, 5.0), "unexplained"),
        (0.04, 0.5, (-2.0,), "unexplained"),
    ],
)
def test_the_verdict_of_the_whole(p_value, p_after, evidences, expected):
    candidates = [verdict.Candidate((str(i),), e) for i, e in enumerate(evidences)]
    before, after = (score.Test(p, np.zeros(0), np.zeros(0), 0, {}) for p in (p_value, p_after))
    assert verdict.whole(before, after, candidates) == expected


def test_an_effect_of_another_size_in_each_pose_explains_nothing():
    one = [verdict.Candidate(("kink",), 40.0)]
    before, after = (score.Test(p, np.zeros(0), np.zeros(0), 0, {}) for p in (0.01, 0.5))
    two = [verdict.Candidate(("kink", "point_mass"), 40.0)]
    for effects in (one, two):
        assert verdict.whole(before, after, effects, constancy=0.5) == "explained"
        assert verdict.whole(before, after, effects, constancy=0.003) == "explained"  # a true blind effect: 0.0037
        assert verdict.whole(before, after, effects, constancy=0.0003) == "unexplained"


def test_a_field_that_is_as_likely_ties_with_an_effect_and_a_far_likelier_one_takes_its_place():
    one = [verdict.Candidate(("kink",), 40.0)]
    before, after = (score.Test(p, np.zeros(0), np.zeros(0), 0, {}) for p in (0.01, 0.5))
    assert verdict.whole(before, after, one, field=30.0) == "explained"
    assert verdict.whole(before, after, one, field=38.0) == "tied"  # the kind may be a part of it
    assert verdict.whole(before, after, one, field=50.0) == "tied"
    assert verdict.whole(before, after, one, field=70.0) == "unexplained"


def test_an_effect_that_predicts_unseen_poses_far_worse_explains_nothing():
    one = [verdict.Candidate(("kink",), 40.0)]
    before, after = (score.Test(p, np.zeros(0), np.zeros(0), 0, {}) for p in (0.01, 0.5))
    assert verdict.whole(before, after, one, unseen=1.5) == "explained"
    assert verdict.whole(before, after, one, unseen=2.5) == "unexplained"


def test_an_exact_class_is_a_tie_whatever_sizes_were_assumed():
    twist = verdict.Candidate(("natural_curvature",), 20.0, chi2=100.0, same_shapes=("clamp_rotation",))
    roll = verdict.Candidate(("clamp_rotation",), 10.0, chi2=101.0)
    assert verdict.leading([twist, roll]) == "tied"
    other = verdict.Candidate(("clamp_rotation",), 10.0, chi2=120.0)
    assert verdict.leading([twist, other]) == "named"


@pytest.mark.parametrize("between", [0.0, 3.0])
def test_intervals_widen_to_the_scatter_between_poses(monkeypatch, between):
    """Of a mean over poses of as many points the scatter gives the textbook variance of a mean of their means."""
    rng, poses, points = np.random.default_rng(4), 6, 20
    y = rng.standard_normal((poses, points)) + between * rng.standard_normal((poses, 1))
    own = np.var(y.mean(axis=1), ddof=1) / poses
    rows = np.split(np.arange(poses * points), poses)
    white = SimpleNamespace(r=(y - y.mean()).ravel(), J=np.ones((poses * points, 1)), rows=rows)
    monkeypatch.setattr(confirm, "_white", lambda stage, found: white)
    given = 1.0 / (poses * points)
    law, rest = Law(Noise(1e-3, 0.0, 0.1), curvature=1.0), {"cost": 0.0, "chi2": 0.0, "log_marginal": 0.0, "log_evidence": 0.0}
    found = Refit(
        components=(), vector=np.zeros(1), shapes=[], covariance=np.array([[given]]), converged=True, law=law, **rest
    )  # fmt: skip
    assert confirm.inflation(None, found) == pytest.approx([np.sqrt(max(own / given, 1.0))])
    assert confirm.inflation(None, replace(found, law=replace(law, curvature=0.0))) == [1.0]
