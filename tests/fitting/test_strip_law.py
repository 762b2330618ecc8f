"""The law of a strip of fabric that yields beside its clamp: stiffness falls a hundredfold, and the descent follows."""

from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.inference.fitting import fit
from scan2flex_jax.study import EffectDeclaration, Unknown

from . import scenes

GRID = np.geomspace(0.5, 40.0, 12)  # 1/m


def photograph(name):
    """One photograph with a law declared, its pose fitted."""
    study = scenes.example("textile-strip")
    pose = replace(study.pose(name), role="fit")
    law = EffectDeclaration("bending_law", {"curvature": GRID})
    return replace(study, poses=(pose,), effects=(law,), unknowns=(*study.unknowns, Unknown("bending_law.factor")))


@pytest.mark.slow
def test_the_first_photograph_shows_softening():
    """The second one alone leaves it undecided between a law and a deviation of its own."""
    (law,) = fit(photograph("strip-a")).laws
    assert not law.linear
    softening = next(r for r in law.readings if r.name == "softening")
    assert softening.high < 0.2
    assert np.all(np.diff(law.moment) > 0)
