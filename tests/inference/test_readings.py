"""The search, the plan, the expectation and the report of a study whose poses have readings that are no points."""

from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax import Unknown, expect, explain, plan, report
from tests.fitting.test_readings import EI, ELEMENTS, study

pytestmark = pytest.mark.slow


def test_nothing_is_missing_where_all_readings_fit():
    e = explain(study(), elements=ELEMENTS)
    assert e.verdict == "no missing effect"
    poses = e.to_json()["poses"]
    assert [len(poses[name]["readings"]) for name in ("twisted", "6 N", "by 12 N")] == [2, 4, 3]
    assert "rms" not in poses["6 N"] and np.isfinite(poses["twisted"]["rms"])
    ranked = plan(e)
    assert any(c.parameters > 0 for c in ranked.candidates)
    assert "force at the start, axes of the scan" in report(e, elements=ELEMENTS)


def test_what_a_wrench_will_tell():
    """Of a pose with angles and a wrench alone nothing else is measured in simulation."""
    guessed = replace(study(("bent",), ("bending_stiffness",)), unknowns=(Unknown("bending_stiffness", guess=EI),))
    found = expect(guessed, elements=ELEMENTS)
    std = found.estimates["bending_stiffness"].std
    slopes = [0.01 / abs(one.value) for one in guessed.pose("6 N").angle]  # of each angle, which is in proportion to 1 / EI
    assert std / EI == pytest.approx(1 / np.sqrt(sum(1 / s**2 for s in slopes)), rel=0.1)
