"""The generative model against closed forms: densities of dense normals, and derivatives of the program against differences."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.stats import multivariate_normal

from scan2flex_jax.effects.catalogue import catalogue, entry_of, fields, laws
from scan2flex_jax.posterior.likelihood import Likelihood, elpd, inverted, left_out
from scan2flex_jax.posterior.priors import Prior
from scan2flex_jax.posterior.program import Component, Index, Program
from scan2flex_jax.posterior.rows import BINS, Rows
from scan2flex_jax.posterior.settings import USUAL
from scan2flex_jax.study import MeasuredCurve, Tolerance

from . import scenes

COUNTS = (150, 150, 20)  # points of the curves: bins of five, which show the noise within, and rows that are padded
NAMES = ("level", "twist+", "aside")
TOLERANCE = Tolerance(clamp_position=5e-4, clamp_rotation=3e-3, gravity=2e-3, length=5e-4)
KINDS = tuple(e.kind for e in (*catalogue(), *fields(), *laws()))
SOLVED = 2e-8  # m: what the solver leaves


def curve(name, count, rng, plane=False):
    """So many points of a pose with noise; those of a ``plane`` have none across it."""
    at = np.linspace(0.02, 0.98, scenes.POINTS)
    points = CubicSpline(at, scenes.shape(name, plane))(np.linspace(0.02, 0.98, count))
    noise = scenes.NOISE * rng.standard_normal(points.shape)
    return MeasuredCurve(points * [1, 0, 1] + noise * [1, 0, 1] if plane else points + noise)


@pytest.fixture(scope="module")
def variant():
    rng, whole = np.random.default_rng(3), scenes.study(tolerance=TOLERANCE)
    poses = [replace(whole.pose(n), curve=curve(n, c, rng)) for n, c in zip(NAMES, COUNTS, strict=True)]
    return scenes.variant_of(replace(whole, poses=tuple(poses)))


@pytest.fixture(scope="module")
def linear(variant):
    """The model of a hypothesis of one effect, at a point where the priors pull."""
    components, rng = (Component("point_mass", {"position": 0.4}),), np.random.default_rng(5)
    n = Index(variant.program, components)
    x = np.r_[variant.empty.x, 1e-3, 0.4]
    x[n.shared : n.base] = rng.standard_normal(n.base - n.shared)
    return variant.linear(variant.program.shapes(components, x), x, components, Prior(variant.program, components))


def sizes(variant):
    """Sizes with and without a discrepancy, of rough and of smooth noise."""
    first = variant.likelihood.start(scenes.NOISE, 1.0)
    return [first + np.array(d) for d in (np.zeros(5), [0.3, -0.8, 0.4, -1.0, 1.5], [-0.5, 0.6, -0.6, -9.0, -2.0])]


def dense(likelihood, u, lin):
    """Mean and covariance of all rows: parameters of precision ``P`` about ``-P^-1 pull`` move the residual by ``X``."""
    P, N, _ = lin.X.shape
    X = np.zeros((P * N, len(lin.precision)))
    C, blocks = np.zeros((P * N, P * N)), likelihood.covariance(u, lin.Z)[0]
    for i, at in enumerate(lin.at):
        X[i * N : (i + 1) * N, at] = lin.X[i]
        C[i * N : (i + 1) * N, i * N : (i + 1) * N] = blocks[i]
    return X @ (lin.pull / lin.precision), C + X / lin.precision @ X.T


def test_the_rows_have_all_that_a_model_of_noise_needs(variant):
    rows = variant.rows
    assert rows.dof > 0 and rows.pad[2].sum() == 20 and np.all(rows.count[:2] == 5)
    assert variant.empty.index.local > 0 and variant.empty.index.shared > 2


@pytest.mark.parametrize("apart", [(), (1,)])
@pytest.mark.parametrize("k", range(3))
def test_the_gradient_of_the_likelihood_is_that_of_differences(variant, linear, k, apart):
    likelihood = Likelihood(variant.rows, variant.length, 3e-4, 1e-4, variant.likelihood.usual, USUAL, apart)
    u, h = sizes(variant)[k], 1e-3
    for shift in (True, False):
        _, exact = likelihood(u, linear, shift=shift)
        ways = h * np.eye(5)
        values = [[likelihood(u + s * way, linear, gradient=False, shift=shift) for s in (1, -1)] for way in ways]
        differences = np.array([(a - b) / (2 * h) for a, b in values])
        np.testing.assert_allclose(exact, differences, rtol=2e-5, atol=2e-3)


def test_the_likelihood_is_the_density_of_the_dense_normal(variant, linear):
    likelihood, own, other = variant.likelihood, [], []
    for u in sizes(variant):
        own.append(likelihood(u, linear, gradient=False) - likelihood.within(u)[0] - likelihood.prior(u)[0])
        other.append(multivariate_normal.logpdf(linear.r.ravel(), *dense(likelihood, u, linear)))
    np.testing.assert_allclose(np.diff(own), np.diff(other), rtol=1e-7, atol=1e-5)


def test_poses_left_out_have_the_conditional_density_of_the_dense_normal(variant, linear):
    likelihood, groups = variant.likelihood, [[0, 2], [1]]
    for u in sizes(variant):
        mean, S = dense(likelihood, u, linear)
        r, rows = linear.r.ravel(), np.arange(linear.r.size).reshape(linear.r.shape)
        expected = []
        for group in groups:
            a, b = rows[group].ravel(), np.delete(rows, group, axis=0).ravel()
            gain = np.linalg.solve(S[np.ix_(b, b)], S[np.ix_(b, a)]).T
            given = mean[a] + gain @ (r[b] - mean[b]), S[np.ix_(a, a)] - gain @ S[np.ix_(b, a)]
            expected.append(multivariate_normal.logpdf(r[a], *given) + 0.5 * len(a) * np.log(2 * np.pi))
        np.testing.assert_allclose(elpd(likelihood, linear, u, groups), expected, rtol=1e-7, atol=1e-5)
        own = np.sum(np.log(np.einsum("pnn->pn", likelihood.whitening(u, linear.Z))), axis=1)
        alone = left_out(linear, *likelihood.white(u, linear), groups)
        np.testing.assert_allclose(alone, expected - np.array([own[0] + own[2], own[1]]), rtol=1e-7, atol=1e-5)


def test_a_scaled_inverse_is_the_inverse():
    rng = np.random.default_rng(0)
    B = rng.standard_normal((6, 9)) * np.geomspace(1e-6, 1e6, 6)[:, None]
    log_det, inverse = inverted(B @ B.T)
    np.testing.assert_allclose(log_det, np.linalg.slogdet(B @ B.T)[1])
    scale = np.geomspace(1e-6, 1e6, 6)
    np.testing.assert_allclose(inverse @ B @ B.T * scale[:, None] / scale, np.eye(6), atol=1e-8)


@pytest.mark.parametrize(("kind", "site"), [("point_mass", {"position": 0.4}), ("kink", {"position": 0.55, "width": 0.05})])
def test_columns_are_differences_of_the_solved_residual(variant, kind, site):
    """Along an unknown, a parameter of one pose, an amplitude, and its place; for points on the shapes themselves, where the
    axes of a residual, which derivatives hold, have no part in it."""
    components = (Component(kind, site),)
    n = Index(variant.program, components)
    x = np.zeros(n.count)
    x[: n.base] = variant.empty.x
    x[n.amplitudes(0)] = 0.5 * components[0].entry.size(variant.context)
    x[n.site(0)] = [site[name] for name in components[0].moving]
    off = variant.program.shapes(components, x)
    given = variant.program.poses
    on = [p - np.einsum("mk,mkc->mc", s.residual, s.axes) for p, s in zip(given.points, off, strict=True)]
    program = Program(variant.problem, variant.minimum, replace(given, points=np.stack(on)))
    exact = program.shapes(components, x)
    steps = {0: 1e-3, n.shared + 4: 0.1, n.amplitudes(0)[0]: 0.02 * x[n.amplitudes(0)[0]], n.site(0)[0]: 1e-3}
    for k, step in steps.items():
        way = step * (np.arange(n.count) == k)
        up, down = (program.shapes(components, x + s * way) for s in (1, -1))
        found, wanted = [], []
        for i, shape in enumerate(exact):
            real, own = program.real[i], list(n.of_pose(i))
            found.append((up[i].residual - down[i].residual)[real] / (2 * step))
            column = shape.columns[real][..., own.index(k)] if k in own else np.zeros((real.sum(), 3))
            wanted.append(column)
        size = max(np.abs(w).max() for w in wanted)
        assert size > 0
        for a, b in zip(found, wanted, strict=True):
            np.testing.assert_allclose(a, b, atol=5e-3 * size + SOLVED / step)


def with_null(variant, kind, which):
    """An effect type at its first or last site, with zero amplitude: components and vector."""
    component = Component(kind, entry_of(kind).sites(variant.context)[which])
    n = Index(variant.program, (component,))
    x = np.zeros(n.count)
    x[: n.base] = variant.empty.x
    x[n.site(0)] = [float(component.site[name]) for name in component.moving]
    return component, n, x


def test_an_effect_of_zero_amplitude_is_no_effect(variant):
    program = variant.program
    without = program.shapes((), variant.empty.x)
    for kind, which in product(KINDS, (0, -1)):
        component, _, x = with_null(variant, kind, which)
        for found, base in zip(program.shapes((component,), x), without, strict=True):
            np.testing.assert_allclose(found.residual, base.residual, 0, 1e-12, err_msg=component.kind)  # rounding


def test_columns_of_the_catalogue_are_those_of_each_effect_in_its_hypothesis(variant):
    program, h = variant.program, variant.empty
    nulls = [with_null(variant, kind, which) for kind, which in product(KINDS, (0, -1))]
    columns, owner = program.columns((), h.x, h.configuration, [component for component, *_ in nulls])
    assert len(owner) == columns[0].shape[-1]
    for k, (component, n, x) in enumerate(nulls):
        for i, shape in enumerate(program.shapes((component,), x, h.configuration)):
            own = [list(n.of_pose(i)).index(a) for a in n.amplitudes(0)]
            expected, real = shape.columns[..., own], program.real[i]
            error = np.abs(expected - columns[i][..., owner == k])[real].max()
            assert error <= 1e-5 * np.abs(expected[real]).max() + 1e-12, component


def test_points_of_one_plane_have_one_normal():
    """Their exact zeros across it are no measurement; a model that leaves it is seen in a few rows."""
    rng, whole = np.random.default_rng(4), scenes.study(plane=True, tolerance=TOLERANCE)
    poses = [replace(p, curve=curve(p.name, c, rng, plane=True)) for p, c in zip(whole.poses[1:], COUNTS, strict=True)]
    plane = replace(whole, poses=tuple(poses))
    variant = scenes.variant_of(plane)
    program = variant.program
    shapes = program.shapes((), variant.empty.x)
    rows = Rows(shapes, program)
    assert (rows.count_of, rows.measured.sum(axis=1).tolist()) == ([BINS + 6, BINS + 6, 25], [BINS, BINS, 20])
    found = rows.of(shapes, [s.residual[:, :, None] for s in shapes])[2, :20, 0]
    np.testing.assert_allclose(np.abs(found), np.linalg.norm(shapes[2].residual[program.real[2]], axis=1), atol=1e-8)
    along_y = [s.axes[:, :, 1:2] for s in shapes]  # a displacement of 1 m across the plane
    np.testing.assert_allclose(np.abs(rows.of(shapes, along_y)[:, :, 0]), rows.across, atol=1e-8)
