"""The noise estimate: the restricted likelihood against its dense form, and known noise found again.

Known scatter: the inverse of the Fisher information ``1/2 tr(C^-1 C_i C^-1 C_j)`` per normal, in logarithms.
"""

from typing import NamedTuple

import numpy as np
import pytest

from scan2flex_jax.fitting.discrepancy import Discrepancy, foreshortening, most_likely_part, plane_normal
from scan2flex_jax.fitting.likelihood import (
    NoisePrior,
    Residual,
    RestrictedLikelihood,
    estimate_noise,
    in_plane_normal,
    noise_and_discrepancy,
    restricted_likelihood,
)
from scan2flex_jax.fitting.noise import Noise, logarithms, matern, most_likely, nearest, white_noise
from scan2flex_jax.fitting.settings import FitSettings, NoiseSettings

LENGTH, POINTS, POSES, DRAWS = 1.0, 64, 3, 12
S = LENGTH * np.linspace(0.01, 0.99, POINTS)
TRUE = np.array([2.0e-4, 4.0e-4, 0.07])  # white, correlated (m), correlation length (m)


def kernel(s, length):
    """Matern-3/2, written by itself."""
    d = np.abs(np.subtract.outer(s, s)) * 3**0.5 / length
    return np.exp(-d) * (1 + d)


def covariance(log):
    white, correlated, length = np.exp(log)
    return white**2 * np.eye(POINTS) + correlated**2 * kernel(S, length)


def known_scatter():
    """Standard deviations of the three logarithms, from all normals of all poses."""
    h, C = 1e-5, covariance(np.log(TRUE))
    sides = [[covariance(np.log(TRUE) + side * e) for side in (h, -h)] for e in np.eye(3)]
    slopes = [np.linalg.solve(C, up - down) / (2 * h) for up, down in sides]
    fisher = np.array([[0.5 * np.trace(a @ b) for a in slopes] for b in slopes]) * 2 * POSES
    return np.sqrt(np.diag(np.linalg.inv(fisher)))


def sensitivities(columns):
    """Smooth columns (POINTS, 2, columns), as those of a rod's parameters."""
    if columns == 0:
        return np.zeros((POINTS, 2, 0))
    waves = np.stack([np.sin(np.pi * (k + 1) * S / LENGTH) for k in range(columns)], axis=1).reshape(POINTS, 1, columns)
    return np.concatenate([waves, -0.5 * waves], axis=1)


def draw(rng, columns, explained):
    root = np.linalg.cholesky(covariance(np.log(TRUE)))
    X = sensitivities(columns)
    return [(S, root @ rng.standard_normal((POINTS, 2)) + X @ explained, X) for _ in range(POSES)]


def residuals(curves, Z=None):
    """What the likelihood takes, from arc lengths, residuals of both normals and their columns."""

    def three(x):
        return np.concatenate([x, np.zeros_like(x[:, :1])], axis=1)

    return [Residual(s, three(r), three(X), np.arange(X.shape[-1]), None if Z is None else three(Z)) for s, r, X in curves]


def test_kernel():
    np.testing.assert_allclose(matern(S, 0.07), kernel(S, 0.07), rtol=1e-12)
    np.testing.assert_allclose(Noise(*TRUE).covariance(S), covariance(np.log(TRUE)), rtol=1e-12)
    assert Noise(3.0, 4.0, 1.0).total == 5.0


def test_an_error_alike_along_a_pose_is_no_smooth_noise():
    """It falls off over 0.7 of the pose; the other sizes are found as though it were not there, and without it smooth noise
    is. A constant is a draw of it, and nine parts in ten of its variance are a constant and a slope."""
    noise = Noise(*TRUE, alike=2e-3)
    C = noise.covariance(S) - Noise(*TRUE).covariance(S)
    apart = (S[:, None] - S[None, :]) / (0.7 * np.ptp(S))
    np.testing.assert_allclose(C, 4e-6 * np.exp(-0.5 * apart**2), rtol=1e-6, atol=1e-15)
    line = np.linalg.qr(np.stack([np.ones_like(S), S], axis=1))[0]
    assert np.trace(line.T @ C @ line) > 0.9 * np.trace(C)
    assert np.all(np.isfinite(noise.covariance(S[:1])))
    rng, pure = np.random.default_rng(12), Noise(4e-4, 1e-6, 0.1)
    poses = []
    for _ in range(8):
        r = pure.white * rng.standard_normal((len(S), 3)) + noise.alike * rng.standard_normal(3)
        poses.append(Residual(S, r, np.zeros((len(S), 3, 0)), np.zeros(0, int)))

    def negative(found, u):
        priors = 0.02 * (u[1] - u[0]) ** 2 + 1e3 * max(0.0, u[2] - np.log(0.5)) ** 2
        return restricted_likelihood(poses, found, np.zeros(0), np.zeros(0)) + priors

    known, unknown = (most_likely(negative, 1e-3, 1.0, alike) for alike in (noise.alike, 0.0))
    assert known.white == pytest.approx(pure.white, rel=0.1)
    assert known.correlated < 0.5 * pure.white
    assert unknown.correlated > 2 * pure.white
    assert nearest(negative, known, 1.0).alike == known.moved(np.zeros(3)).alike == noise.alike


def test_restricted_likelihood_is_the_dense_one():
    rng = np.random.default_rng(1)
    curves = draw(rng, 2, np.zeros(2))
    r = np.concatenate([c[1][:, k] for c in curves for k in (0, 1)])
    X = np.concatenate([c[2][:, k] for c in curves for k in (0, 1)])
    noises, values = [Noise(*TRUE), Noise(5e-4, 1e-4, 0.2)], []
    for noise in noises:
        C = np.kron(np.eye(2 * POSES), noise.covariance(S))
        A = X.T @ np.linalg.solve(C, X)
        rest = r - X @ np.linalg.solve(A, X.T @ np.linalg.solve(C, r))
        values.append(0.5 * (np.linalg.slogdet(C)[1] + np.linalg.slogdet(A)[1] + r @ np.linalg.solve(C, rest)))
    free = np.zeros(2)
    ours = [restricted_likelihood(residuals(curves), n, free, free) for n in noises]
    np.testing.assert_allclose(ours[1] - ours[0], values[1] - values[0], rtol=1e-9)


def test_restricted_likelihood_with_discrepancy_is_the_dense_one():
    """Woodbury's identity and priors of the numbers, against covariance matrices that are written out."""
    rng = np.random.default_rng(2)
    curves, b, prior = draw(rng, 2, np.zeros(2)), 0.3, np.array([0.0, 4.0e5])
    Z, pull, values = 1e-3 * rng.standard_normal((POINTS, 2, 5)), prior * np.array([0.0, 1.0e-3]), []
    noises = [Noise(*TRUE), Noise(5e-4, 1e-4, 0.2)]
    for noise in noises:
        flat = b * np.concatenate(list(Z.transpose(1, 0, 2)))
        C = np.kron(np.eye(2), noise.covariance(S)) + flat @ flat.T
        A, g, value = np.diag(prior), pull.copy(), 0.0
        for _, *both in curves:
            r, X = np.concatenate(list(both[0].T)), np.concatenate(list(both[1].transpose(1, 0, 2)))
            A, g = A + X.T @ np.linalg.solve(C, X), g + X.T @ np.linalg.solve(C, r)
            value += 0.5 * (np.linalg.slogdet(C)[1] + r @ np.linalg.solve(C, r))
        values.append(value + 0.5 * np.linalg.slogdet(A)[1] - 0.5 * g @ np.linalg.solve(A, g))
    ours = [restricted_likelihood(residuals(curves, Z), n, prior, pull, b) for n in noises]
    np.testing.assert_allclose(ours[1] - ours[0], values[1] - values[0], rtol=1e-9)


def smooth_columns(count=6):
    """What a random curvature does to a clamped cable: waves that vanish at both ends, (POINTS, 2, 2 count) in m per 1/m."""
    waves = np.stack([np.sin(np.pi * (k + 1) * S / LENGTH) * 0.05 / (k + 1) ** 2 for k in range(count)], axis=1)
    return np.einsum("mk,ab->mabk", waves, np.eye(2)).reshape(POINTS, 2, 2 * count)


def drawn_with_discrepancy(size, seed, poses=8):
    rng, Z, empty = np.random.default_rng(seed), smooth_columns(), np.zeros((POINTS, 2, 0))
    drawn = [size * Z @ rng.standard_normal(Z.shape[-1]) for _ in range(poses)]
    drawn = [moved + 3e-4 * rng.standard_normal((POINTS, 2)) for moved in drawn]
    return [(S, r, empty) for r in drawn]


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 2))])
def test_discrepancy_is_found_again(seed):
    """Eight poses with twelve directions each: the size is known to 1/sqrt(2 * 96) = 7 %, and the noise to far less."""
    curves = drawn_with_discrepancy(0.2, seed)
    alone = estimate_noise(residuals(curves), LENGTH)
    noise, size, _ = noise_and_discrepancy(residuals(curves, smooth_columns()), alone, LENGTH, None, 0.1)
    np.testing.assert_allclose(size, 0.2, rtol=0.25)
    np.testing.assert_allclose(noise.total, 3e-4, rtol=0.15)
    assert alone.total > 5e-4


@pytest.mark.parametrize("stated", [None, 3e-4])
@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 2))])
def test_no_discrepancy_is_found_where_there_is_none(seed, stated):
    curves = drawn_with_discrepancy(0.0, seed)
    alone = estimate_noise(residuals(curves), LENGTH, stated)
    noise, size, _ = noise_and_discrepancy(residuals(curves, smooth_columns()), alone, LENGTH, stated, 0.1)
    assert size == 0.0 and noise is alone


def test_errors_of_the_mesh_are_below_the_noise_that_is_assumed():
    """Residuals of 1e-9 m, as where curves come from a simulator, are no sensor's: the white part is 1e-5 of the length."""
    curves = [(s, 1e-9 / 3e-4 * r, X) for s, r, X in drawn_with_discrepancy(0.0, 0)]
    noise = estimate_noise(residuals(curves), LENGTH)
    assert noise.white == pytest.approx(1e-5 * LENGTH) and noise.assumed(LENGTH)
    assert not estimate_noise(residuals(drawn_with_discrepancy(0.0, 0)), LENGTH).assumed(LENGTH)


def test_most_likely_part_of_a_residual_is_the_discrepancy():
    """Against the dense formula ``K (K + C)^-1 r``; far above the noise it is the discrepancy itself."""
    rng, Z, noise = np.random.default_rng(6), smooth_columns(), Noise(3e-4, 1e-4, 0.1)
    true = 0.2 * Z @ rng.standard_normal(Z.shape[-1])
    r = true + 3e-4 * rng.standard_normal((POINTS, 2))
    flat = np.concatenate(list(0.2 * Z.transpose(1, 0, 2)))
    K, C = flat @ flat.T, np.kron(np.eye(2), noise.covariance(S))
    dense = (K @ np.linalg.solve(K + C, np.concatenate(list(r.T)))).reshape(2, POINTS).T
    found = most_likely_part(0.2, np.concatenate([Z, Z[:, :1]], axis=1), r, noise.covariance(S))
    np.testing.assert_allclose(found, dense, atol=1e-12)
    moved = Discrepancy(0.2, LENGTH, (), (found,))
    np.testing.assert_allclose(moved.rms, np.sqrt(np.mean(np.sum(true**2, axis=1))), rtol=0.05)
    assert Discrepancy().rms == 0.0


def test_points_of_a_picture_lie_in_one_plane():
    """Aside from the plane of a photograph nothing was measured; gravity across that plane would move the cable out of it."""
    rng = np.random.default_rng(0)
    flat = rng.standard_normal((40, 3)) * [1.0, 0.0, 1.0]
    np.testing.assert_allclose(np.abs(plane_normal(flat, np.array([0.0, 0.0, -9.81]))), [0.0, 1.0, 0.0], atol=1e-12)
    assert plane_normal(flat, np.array([0.0, -9.81, 0.0])) is None
    assert plane_normal(flat + 1e-4 * rng.standard_normal((40, 3)), np.array([0.0, 0.0, -9.81])) is None


def test_a_flat_residual_counts_its_own_plane_alone():
    """The likelihood of residuals in one plane is that of their components in it, however the normals turn along the curve, as
    those of a model that buckles out of the plane do, and whatever the residual across the plane."""
    rng = np.random.default_rng(5)
    r, X = 3e-4 * rng.standard_normal(POINTS), np.sin(S)[:, None]
    angle = np.linspace(0.3, 1.9, POINTS)
    axes = np.zeros((POINTS, 3, 3))  # the tangent is y, the plane x y
    axes[:, 0], axes[:, 1], axes[:, 2] = [np.stack(np.broadcast_arrays(*v), axis=-1) for v in (
        (np.cos(angle), 0.0, np.sin(angle)), (-np.sin(angle), 0.0, np.cos(angle)), (0.0, 1.0, 0.0)
    )]  # fmt: skip
    u = in_plane_normal(axes, np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(np.einsum("mc,mci->mi", u, axes[:, :2])[:, 1:], 0.0, atol=1e-12)
    across = np.einsum("mci,i->mc", axes, [0.0, 0.0, 1e-2])
    residual = np.column_stack([r[:, None] * u, np.zeros(POINTS)]) + across
    columns = np.concatenate([X[:, None, :] * u[:, :, None], np.zeros((POINTS, 1, 1))], axis=1)
    flat = Residual(S, residual, columns, np.arange(1)).in_plane(u)
    noise, one = Noise(*TRUE), np.zeros(1)
    C = noise.covariance(S)
    A, g = X.T @ np.linalg.solve(C, X), X.T @ np.linalg.solve(C, r)
    dense = 0.5 * (np.linalg.slogdet(C)[1] + r @ np.linalg.solve(C, r) + np.log(A[0, 0]) - g[0] ** 2 / A[0, 0])
    np.testing.assert_allclose(restricted_likelihood([flat], noise, one, one), dense, rtol=1e-9)


def test_foreshortening_of_an_arc():
    """A straight cable bent to an arc of curvature k goes aside by k s^2/2 and nearer by k^2 s^3/6: two thirds of d^2/s."""
    s, k = np.array([0.3, 0.6, 1.0]), 0.2
    columns = np.zeros((3, 3, 1))
    columns[:, 0, 0] = s**2 / 2
    np.testing.assert_allclose(foreshortening(k, columns, s), k**2 * s**3 / 4, rtol=1e-12)
    assert np.all(np.abs(foreshortening(k, columns, s) / (k**2 * s**3 / 6) - 1.5) < 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("columns", [0, 3])
def test_known_noise_is_found_again(columns):
    """The mean over draws is unbiased within its scatter (and a tenth for the weak priors), the scatter is the known one;
    what the sensitivities explain, here ten times the noise, changes nothing."""
    found = []
    for seed in range(DRAWS):
        curves = draw(np.random.default_rng(seed), columns, 5e-3 * np.ones(columns))
        noise = estimate_noise(residuals(curves), LENGTH)
        found.append(np.log([noise.white, noise.correlated, noise.correlation_length]))
    scatter, error = known_scatter(), np.mean(found, axis=0) - np.log(TRUE)
    assert np.all(np.abs(error) < 3.5 * scatter / np.sqrt(DRAWS) + 0.1), error
    ratio = np.std(found, axis=0, ddof=1) / scatter
    assert np.all((ratio > 0.4) & (ratio < 1.8)), ratio


def test_white_noise_is_called_white():
    rng = np.random.default_rng(3)
    curves = [(S, 3e-4 * rng.standard_normal((POINTS, 2)), np.zeros((POINTS, 2, 0))) for _ in range(POSES)]
    noise = estimate_noise(residuals(curves), LENGTH)
    assert noise.correlated < 0.4 * noise.white
    np.testing.assert_allclose(noise.total, 3e-4, rtol=0.1)


class Curve(NamedTuple):
    """What a pose tells of its noise."""

    points: np.ndarray
    noise: float | None = None

    @property
    def curve(self):
        return self


@pytest.mark.parametrize("uneven", [0.0, 0.4, 0.8])
@pytest.mark.parametrize(("sigma", "within"), [(0.0, 0.0), (1e-5, 0.03), (1e-4, 0.03), (5e-4, 0.05), (5e-3, 0.2)])
def test_uneven_points_are_no_noise(uneven, sigma, within):
    """A helix at points some 5 mm apart, at distances that vary: its noise is found again, also where it is far smaller."""
    rng = np.random.default_rng(5)
    found = []
    for _ in range(10):
        s = (np.arange(200) + uneven * rng.uniform(-0.5, 0.5, 200)) / 200
        helix = np.stack([0.25 * np.cos(3 * s), 0.25 * np.sin(3 * s), 0.4 * s], axis=1)
        found.append(white_noise(Curve(helix + sigma * rng.standard_normal(helix.shape))))
    assert np.mean(found) == pytest.approx(sigma, rel=within, abs=1e-7)


def test_white_noise_of_few_or_repeated_points():
    line = np.linspace([0.0, 0.0, 0.0], [1.0, 0.5, 0.2], 30)
    repeated = np.repeat(line, 2, axis=0)
    assert white_noise(Curve(repeated)) < 1e-12
    assert white_noise(Curve(line[:4])) == np.inf
    assert white_noise(Curve(np.repeat(line[:2], 10, axis=0))) == np.inf
    assert white_noise(Curve(line[:4], noise=2e-4)) == 2e-4


def test_stated_noise_is_held():
    """Residuals three times as large as stated: the total stays near what the user says."""
    rng = np.random.default_rng(4)
    curves = [(S[:6], 6e-4 * rng.standard_normal((6, 2)), np.zeros((6, 2, 0)))]
    free, held = estimate_noise(residuals(curves), LENGTH), estimate_noise(residuals(curves), LENGTH, stated=2e-4)
    assert held.total < 0.75 * free.total
    assert held.total > 2e-4


def test_priors_of_the_noise_are_arguments():
    """The likelihood with a prior is their sum; a scan's noise, a stated one and one with a discrepancy have their own."""
    noise = Noise(3e-4, 4e-4, 0.07 * LENGTH)
    u = logarithms(noise)
    spread = 0.02 * np.log(4 / 3) ** 2
    own = {"length": LENGTH, "shortest": 0.01, "settings": NoiseSettings(correlation_spread=0.6, longest_correlation=0.3)}
    assert NoisePrior(**own, stated=None, scanner=False)(noise, u) == pytest.approx(spread)
    scanner = 0.5 * (np.log(0.5) / np.log(5)) ** 2  # a total of 0.5 mm, where 1 mm is usual
    assert NoisePrior(**own, stated=None, scanner=True)(noise, u) == pytest.approx(spread + scanner)
    assert NoisePrior(**own, stated=None, scanner=False)(noise, u, discrepancy=True) == pytest.approx(spread + scanner)
    stated = NoisePrior(**own, stated=1e-3, scanner=True)
    assert stated(noise, u) == stated(noise, u, True) == pytest.approx(spread + 0.5 * (np.log(0.5) / 0.15) ** 2)
    poses, free = residuals(draw(np.random.default_rng(5), 2, np.zeros(2))), np.zeros(2)
    both, alone = RestrictedLikelihood(poses, stated, free, free), restricted_likelihood(poses, noise, free, free)
    assert both(noise, u) == pytest.approx(alone + stated(noise, u))


def test_a_noise_beyond_those_of_scans_is_penalised_with_a_discrepancy_only():
    settings = NoiseSettings(most_noise=2e-3)
    large = Noise(2 * settings.most_noise * LENGTH, 1e-4, 0.07 * LENGTH)
    prior = NoisePrior(LENGTH, None, 0.01, scanner=True, settings=settings)
    extra = prior(large, logarithms(large), True) - prior(large, logarithms(large))
    assert extra == pytest.approx(1e2 * np.log(large.total / settings.most_noise) ** 2)


def test_settings_decide_the_estimates_of_noise_and_discrepancy():
    """A discrepancy that is found by default does not gain 1e6 nats; a stated noise holds to within its spread."""
    moved, clean = (residuals(drawn_with_discrepancy(size, 0, poses=2), smooth_columns()) for size in (0.2, 0.0))
    alone, strict = Noise(3e-4, 1e-3, 0.1), FitSettings(discrepancy_gain=1e6)
    assert noise_and_discrepancy(moved, alone, LENGTH, None, 0.1)[1] > 0.05
    assert noise_and_discrepancy(moved, alone, LENGTH, None, 0.1, strict)[:2] == (alone, 0.0)
    held, free = (estimate_noise(clean, LENGTH, 1e-4, FitSettings(stated_spread=spread)).total for spread in (1e-3, 10.0))
    assert held < 1.2e-4 and free > 2e-4
