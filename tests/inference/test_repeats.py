"""Scans of one pose again: they are no independent poses, and are left out together."""

from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.study import MeasuredCurve

from . import scenes

pytestmark = pytest.mark.slow


def test_repeats_are_left_out_together():
    """A wave of 1 mm in every pose, alike in its repeat: a pose is not predicted by its own repeat."""
    first, again = (replace(s, poses=s.poses[1:3]) for s in (scenes.study(seed=1), scenes.study(seed=2)))
    poses = []
    for i, (a, b) in enumerate(zip(first.poses, again.poses, strict=True)):
        wave = 1e-3 * np.outer(np.sin(np.linspace(0, (9 + 2 * i) * np.pi, scenes.POINTS)), [0, 1, 0])
        poses.append(replace(a, curve=MeasuredCurve(a.curve.points + wave)))
        poses.append(replace(b, name=f"{b.name} again", repeat_of=b.name, curve=MeasuredCurve(b.curve.points + wave)))
    said, unsaid = poses, [replace(p, repeat_of=None) for p in poses]  # these by their clamps
    for own in (said, unsaid):
        found = scenes.variant_of(replace(first, poses=tuple(own)))
        assert found.groups == [[0, 1], [2, 3]]
        assert found.empty.elpd.shape == (2,)
