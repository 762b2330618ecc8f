"""The one Levenberg-Marquardt: minima, bounds, curved valleys, other branches and lost causes, on small known problems."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from scan2flex_jax.fitting.descent import Model, Point, Quadratic, Rules, descend

FREE = np.full(2, np.inf)
RULES = Rules(most=lambda cost: 200, settled=lambda cost: 1e-14, damping=1e-3, least=1e-12, give_up=1e12, closer=None)


class Wall(Model):
    """``r = (x - 1, 1)`` with a wall: it has no value above ``x = 0.5``, so that a descent stalls before the minimum at 1."""

    low, high = -FREE[:1], FREE[:1]

    def at(self, x, start=None):
        r, J = np.array([x[0] - 1.0, 1.0]), np.array([[1.0], [0.0]])
        return Point(x, float(r @ r) if x[0] <= 0.5 else np.inf, None, None, r, J)

    def about(self, point):
        A, g = point.jacobian.T @ point.jacobian, point.jacobian.T @ point.residual
        return Quadratic(point.x, A, g, np.diag(A), np.array([True]), noise=1.0)

    def bounded(self, move, about):
        return move


class Valley(Model):
    """Rosenbrock's curved valley, ``r = (10 (y - x^2), 1 - x)``, whose minimum 0 is at (1, 1); counts its evaluations."""

    def __init__(self, low=-FREE, high=FREE, branch=0.0):
        """``branch`` is added to the cost of whatever is not solved from the measured curves."""
        self.low, self.high, self.branch, self.count = low, high, branch, 0

    def at(self, x, start=None):
        self.count += 1
        r, J = np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]]), np.array([[-20 * x[0], 10.0], [-1.0, 0.0]])
        return Point(x, float(r @ r) + (self.branch if start else 0.0), "continued", None, r, J)

    def about(self, point):
        A, g, x = point.jacobian.T @ point.jacobian, point.jacobian.T @ point.residual, point.x
        held = ((x <= self.low) & (g > 0)) | ((x >= self.high) & (g < 0))
        return Quadratic(x, A, g, np.diag(A), ~held, noise=1e-9)

    def bounded(self, move, about):
        return move


BEGIN = np.array([-1.2, 1.0])


def test_a_stalled_descent_has_not_converged():
    """Damping shrinks the steps until the cost no longer changes, half a standard error short of the minimum."""
    wall, judged = Wall(), replace(RULES, judged=True)
    found = descend(wall, wall.at(np.array([0.0])), judged)
    assert 0.0 < found.point.x[0] <= 0.5
    assert found.stalled and not found.converged


def test_a_step_of_a_tenth_of_a_standard_error_has_converged():
    """Half a standard error off is no minimum, a twentieth is one; with exact data rounding errors stand in for the noise."""
    def off(x, noise=1.0, rounding=0.0):
        one = np.ones((1, 1))
        return Quadratic(np.array([x]), one, np.array([x - 1.0]), np.ones(1), np.array([True]), noise, rounding).converged()

    assert not off(0.5) and off(0.95)
    assert not off(0.95, noise=1e-3)
    assert off(1.0 - 1e-12, noise=1e-30, rounding=1e-18) and not off(1.0 - 1e-6, noise=1e-30, rounding=1e-18)


def test_the_step_is_that_of_the_normal_equations_in_both_namespaces():
    """With a parameter at its bound, an undetermined one and unequal units, damped and undamped."""
    rng = np.random.default_rng(3)
    J = rng.standard_normal((12, 5)) * np.array([1.0, 1e3, 1e-3, 1.0, 1.0])
    J[:, 4] = J[:, 3]
    A, g, free = J.T @ J, J.T @ rng.standard_normal(12), np.array([True, False, True, True, True])
    for damping in (0.0, 0.1):
        host, traced = (Quadratic(np.zeros(5), A, g, np.diag(A), free, xp=xp).solved(g, damping) for xp in (np, jnp))
        inside = np.ix_(free, free)
        S = np.sqrt(np.diag(A)[free])
        dense = np.linalg.lstsq(A[inside] / np.outer(S, S) + damping * np.eye(4), -g[free] / S, rcond=1e-12)[0] / S
        np.testing.assert_allclose(host[free], dense, rtol=1e-9)
        np.testing.assert_allclose(traced, host, rtol=1e-9, atol=1e-15)
        assert host[1] == 0.0


def test_bent_steps_follow_the_valley_in_fewer_iterations():
    plain, bent = (descend(Valley(), Valley().at(BEGIN), replace(RULES, bend=bend)) for bend in (False, True))
    assert bent.converged and bent.iterations < plain.iterations


def test_a_parameter_pushed_outwards_stays_at_its_bound():
    """With x below 0.5 the least cost is 0.25, at y = 0.25."""
    valley = Valley(high=np.array([0.5, np.inf]))
    found = descend(valley, valley.at(BEGIN), RULES)
    assert found.converged and found.point.x[0] == 0.5
    assert found.point.x[1] == pytest.approx(0.25) and found.point.cost == pytest.approx(0.25)


def test_a_closer_branch_from_the_measured_curves_is_followed():
    valley = Valley(branch=3.0)
    begun = valley.at(BEGIN, "continued")
    there, back = (descend(valley, begun, replace(RULES, closer=closer)) for closer in (None, lambda cost: 1e-6 * cost))
    assert there.point.cost == pytest.approx(3.0) and back.point.cost == pytest.approx(0.0, abs=1e-10)


def test_a_cost_out_of_reach_is_given_up():
    """A step promises at most the whole cost: far above the cost to beat it is followed, below zero never reached."""
    valley = Valley(branch=1e6)
    found = descend(valley, valley.at(BEGIN, "continued"), replace(RULES, hopeless=10.0))
    assert not found.converged and found.iterations == 3
