"""The rule for values, intervals and what is not determined, which the fit and the loop share."""

import numpy as np
import pytest

from scan2flex_jax.fitting.parameters import Slot
from scan2flex_jax.inference.estimate import VAGUE, estimate_of

LOG = Slot("bending_stiffness", (), True, (-9.0,), (9.0,), 0, "N m^2")
PLAIN = Slot("natural_curvature", (2,), False, (-100.0,) * 2, (100.0,) * 2, 0, "1/m")


def test_a_positive_value_has_a_log_normal_interval():
    e = estimate_of(LOG, np.log([0.1]), np.array([0.2]))
    assert e.value == pytest.approx(0.1) and e.std == pytest.approx(0.02) and e.identifiable and not e.at_bound
    assert e.low == pytest.approx(0.1 * np.exp(-1.959964 * 0.2)) and e.high * e.low == pytest.approx(0.01)
    assert e.unit == "N m^2"


def test_a_vague_logarithm_is_not_determined_and_its_interval_withheld_where_asked():
    wide = np.array([1.001 * VAGUE])
    kept, withheld = estimate_of(LOG, np.zeros(1), wide, vaguest=5.0), estimate_of(LOG, np.zeros(1), wide)
    assert not kept.identifiable and kept.low is not None and kept.high == pytest.approx(np.exp(1.959964 * 1.001))
    assert not withheld.identifiable and withheld.std is None and withheld.low is None and withheld.high is None


def test_without_a_standard_error_there_is_a_value_alone():
    e = estimate_of(LOG, np.zeros(1), np.array([np.inf]), determined=True)
    assert e.value == 1.0 and e.std is None and not e.identifiable
    assert "std" not in e.to_json()


def test_an_interval_of_few_degrees_of_freedom_is_that_of_students_t():
    e = estimate_of(PLAIN, np.array([1.0, -2.0]), np.array([0.5, 5.0]), freedom=3.0)
    np.testing.assert_allclose(e.high - e.value, 3.182446 * np.array([0.5, 5.0]), rtol=1e-6)  # tables of the t distribution
    np.testing.assert_allclose(e.std, [0.5, 5.0])


def test_an_estimate_may_not_be_narrower_than_another():
    narrow, wide = (estimate_of(LOG, np.log([value]), np.array([std])) for value, std in ((0.1, 0.1), (0.08, 0.3)))
    both = narrow.including(wide)
    assert (both.value, both.low, both.high, both.std) == (narrow.value, wide.low, wide.high, wide.std)
    assert wide.including(narrow) == wide and both.identifiable and isinstance(both.low, float)
    two = estimate_of(PLAIN, np.array([1.0, -2.0]), np.array([0.5, 5.0]))
    other = estimate_of(PLAIN, np.array([0.0, -2.0]), np.array([0.5, 1.0]))
    np.testing.assert_allclose(two.including(other).low, [other.low[0], two.low[1]])
    np.testing.assert_allclose(two.including(other).high, [two.high[0], two.high[1]])
