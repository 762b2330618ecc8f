"""A solve that starts at a neighbouring solution goes all the way, however short it is."""

import equinox as eqx
import numpy as np
import pytest

from . import cases


def changed(model, part, share):
    """The model with the stiffness or the density of its cable larger by ``share``."""
    return eqx.tree_at(lambda m: getattr(m.cable, part), model, replace_fn=lambda value: value * (1.0 + share))


@pytest.mark.parametrize("share", [1e-9, 1e-6, 1e-3])
def test_no_part_of_a_short_way_is_missing(share):
    """Against the solution from the generic start, which is far, up to rounding; at the solution, a step and a look."""
    model, boundary = cases.reference_case("P3")
    old = cases.solved(model, boundary)
    assert int(cases.solved(model, boundary, start=old.configuration).verdict.steps) == 2
    for part in ("bending_stiffness", "torsional_stiffness", "length_density"):
        new = cases.solved(changed(model, part, share), boundary, start=old.configuration)
        far = cases.solved(changed(model, part, share), boundary)
        way = np.max(np.abs(np.asarray(far.points - old.points)))
        left = np.max(np.abs(np.asarray(new.points - far.points)))
        assert left < 1e-3 * way + 1e-12, (part, left / way)
