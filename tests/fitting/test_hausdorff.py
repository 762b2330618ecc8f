"""The Hausdorff distance as what a fit minimises."""

import numpy as np
import pytest

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.inference import fit

from . import scenes


@pytest.mark.slow
def test_it_brings_the_largest_distance_down():
    """On noisy shapes the fit to the largest distance has a smaller one. It rests on a point or two: a poor estimator, off by
    some per cent where least squares are off by tenths of one."""
    study = scenes.study_of([scenes.BOTH[0]], poses=("plane",))
    noisy = scenes.measured(study, scenes.exact_curves(study, {"bending_stiffness": scenes.EI}), 2e-4)
    least, worst = (fit(noisy, "nelder-mead", distance=d, elements=scenes.ELEMENTS) for d in ("normal", "hausdorff"))
    assert worst.poses["plane"].worst < least.poses["plane"].worst
    assert worst.poses["plane"].rms > least.poses["plane"].rms
    assert worst.estimates["bending_stiffness"].value == pytest.approx(scenes.EI, rel=0.1)
    assert np.isfinite(worst.estimates["bending_stiffness"].std)
    assert any("about the values of this method and distance" in s for s in worst.sentences)


def test_it_has_no_least_squares():
    with pytest.raises(Scan2FlexError, match="nelder-mead"):
        fit(scenes.study_of(), distance="hausdorff")
