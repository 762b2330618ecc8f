"""The fit that knows the background: what it leaves is what the covariance of noise and background predicts."""

import pytest

from benchmarks.background_ideal import fitted, table, wanted
from benchmarks.blind import background


def test_what_is_left_agrees_with_the_covariance():
    """A scale of a scan over a background of 1 % of the length, and over a noise a twentieth of it."""
    key = (20261212, 20, 0)
    answer = background.make_case(key, ("scan_scale",), 250)[1]["answer"]
    assert wanted(answer) and answer["background"] > 10 * answer["noise_rms"]
    found = fitted(None, answer)
    assert 0.9 < found["left_of_expected"] < 1.1  # its scatter is sqrt(2 / 1,500) = 0.04
    assert found["size_off_by"] < 0.02 and found["validate_over_attained"] < 1.3
    assert found["expected_size"] == 1.0  # a scale is known far better than to 15 %


@pytest.mark.slow
def test_sizes_that_only_the_ratio_of_load_and_stiffness_determines_are_not_expected():
    """A uniform load: its sum with the weight over EI is all that the shapes tell, so EI and the load are open together."""
    key = (20261214, 7, 0)
    answer = background.make_case(key, ("uniform_load",), 250)[1]["answer"]
    found = fitted(None, answer)
    assert found["expected_error_of_EI"] > 0.2
    assert found["expected_size"] < 0.5
    assert found["size_off_by"] < 0.02  # by its start at the truth alone


def test_a_tether_is_left_out_and_a_fault_counts_as_missed():
    assert not wanted({"kinds": ["tether"]}) and not wanted({"kinds": []}) and wanted({"kinds": ["kink"]})
    expected = {"expected_size": 0.8, "expected_validate": 0.6}
    rows = [{"size_off_by": 0.1, "validate_over_attained": 1.2} | expected, {"fault": "not solved"} | expected]
    told = table(rows)
    assert told["faults"] == 1
    assert told["size_within_15_percent"] == told["validate_within_1.3"] == {"share": 0.5, "of": 2}
    assert told["expected_size_within_15_percent"]["share"] == pytest.approx(0.8)
