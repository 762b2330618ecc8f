"""The damping of a descent: in a curved valley most steps go downhill, and a linear residual needs none."""

import numpy as np
import pytest

from scan2flex_jax.fitting.descent import Model, Point, Rules, descend
from scan2flex_jax.fitting.quadratic import GROWTH, Quadratic


class Valley(Model):
    """Rosenbrock's function of two parameters, with its minimum of zero at (1, 1)."""

    low, high = np.full(2, -np.inf), np.full(2, np.inf)

    def __init__(self, steep):
        """``steep``: the root of its coefficient, 10 in Rosenbrock's."""
        self.steep, self.costs = steep, []

    def at(self, x, start=None):
        r = np.array([self.steep * (x[1] - x[0] ** 2), 1.0 - x[0]])
        self.costs.append(float(r @ r))
        return Point(x, self.costs[-1], None, r)

    def about(self, point):
        J = np.array([[-2.0 * self.steep * point.x[0], self.steep], [-1.0, 0.0]])
        A = J.T @ J
        return Quadratic(point.x, A, J.T @ point.found, np.diag(A), np.ones(2, bool), noise=1e-9)

    def bounded(self, move, about):
        return move


@pytest.mark.parametrize(("steep", "most"), [(10.0, 40), (100.0, 120), (1000.0, 350)])
def test_most_steps_along_a_curved_valley_go_downhill(steep, most):
    """A damping that falls and rises tenfold is refused every second time: 43, 263 and 1427 evaluations."""
    valley = Valley(steep)
    rules = Rules(most=lambda cost: 1000, settled=lambda cost: 0.0, damping=1e-3, least=1e-12, give_up=1e12, closer=None)
    found = descend(valley, valley.at(np.array([-1.2, 1.0])), rules)
    assert found.converged and len(valley.costs) < most
    np.testing.assert_allclose(found.point.x, 1.0, atol=1e-4)
    best = np.minimum.accumulate(valley.costs)
    uphill = np.array(valley.costs[1:]) >= best[:-1]
    assert np.mean(uphill) < 0.35


def test_damping_falls_by_what_a_step_reaches_and_grows_faster_with_each_refusal():
    A, g = np.diag([2.0, 0.5]), np.array([1.0, -1.0])
    q = Quadratic(np.zeros(2), A, g, np.diag(A), np.ones(2, bool))
    step = q.solved(g, 0.0)
    foreseen = (2.0 * g + A @ step) @ step
    assert q.damped(0.3, GROWTH, foreseen, step) == (pytest.approx(0.1), GROWTH)  # as predicted
    assert q.damped(0.3, 8.0, 0.5 * foreseen, step) == (pytest.approx(0.3), GROWTH)  # half of it
    assert q.damped(0.3, GROWTH, 1.0, step) == (pytest.approx(0.6), 4.0)
    assert q.damped(0.6, 4.0, np.inf, step) == (pytest.approx(2.4), 8.0)  # no equilibrium there
    assert q.damped(0.3, 8.0, -1e300, 1e-200 * step) == (pytest.approx(0.1), GROWTH)  # far more than predicted
