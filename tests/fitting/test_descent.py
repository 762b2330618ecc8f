"""The one Levenberg-Marquardt: minima, bounds, curved valleys, other branches and lost causes, on small known problems."""

from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.fitting.descent import Model, Point, Quadratic, Rules, descend

FREE = np.full(2, np.inf)
RULES = Rules(
    most=lambda cost: 200, settled=lambda cost: 1e-14, damping=1e-3, least=1e-12, give_up=1e12, stuck_converges=False,
    closer=None,
)  # fmt: skip


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
        return Quadratic(x, A, g, np.diag(A), ~held)

    def bounded(self, move, about):
        return move


BEGIN = np.array([-1.2, 1.0])


def test_the_minimum_of_a_curved_valley():
    valley = Valley()
    found = descend(valley, valley.at(BEGIN), RULES)
    assert found.converged
    np.testing.assert_allclose(found.point.x, [1.0, 1.0], atol=1e-6)


def test_a_refused_step_shows_how_the_valley_bends():
    """A long step along its floor climbs the wall, and the same step bent stays on the floor."""
    start, one = np.zeros(2), replace(RULES, most=lambda cost: 1, damping=1e-9)
    plain, bent = (descend(Valley(), Valley().at(start), replace(one, bend=bend)).point for bend in (False, True))
    assert plain.x is start, "the step was refused"
    np.testing.assert_allclose(bent.x, [1.0, 1.0], atol=1e-6)


def test_bent_steps_follow_the_valley_in_fewer_iterations():
    plain, bent = (descend(Valley(), Valley().at(BEGIN), replace(RULES, bend=bend)) for bend in (False, True))
    assert bent.converged and bent.iterations < plain.iterations


def test_a_bound_holds_what_wants_to_leave():
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


def test_an_unsolved_start_stays_where_it_is():
    found = descend(Valley(), Point(BEGIN, np.inf, None), RULES)
    assert not found.converged and found.iterations == 0 and found.point.x is BEGIN


def test_iterations_are_counted_and_bounded():
    valley = Valley()
    found = descend(valley, valley.at(BEGIN), replace(RULES, most=lambda cost: 2))
    assert found.iterations == 2 and not found.converged and valley.count == 3
