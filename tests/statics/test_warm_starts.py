"""A solve that starts at a neighbouring solution goes all the way, however short it is."""

import equinox as eqx
import numpy as np
import pytest

from . import cases

POSES = ("P1", "P2", "P3")


def changed(model, part, share):
    """The model with the stiffness or the density of its cable larger by ``share``."""
    return eqx.tree_at(lambda m: getattr(m.cable, part), model, replace_fn=lambda value: value * (1.0 + share))


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("share", [1e-9, 1e-6, 1e-3])
def test_no_part_of_a_short_way_is_missing(pose, share):
    """Against the solution from the generic start, which is far, up to rounding."""
    model, boundary = cases.reference_case(pose)
    old = cases.solved(model, boundary)
    for part in ("bending_stiffness", "torsional_stiffness", "length_density"):
        new = cases.solved(changed(model, part, share), boundary, start=old.configuration)
        far = cases.solved(changed(model, part, share), boundary)
        way = np.max(np.abs(np.asarray(far.points - old.points)))
        left = np.max(np.abs(np.asarray(new.points - far.points)))
        assert left < 1e-3 * way + 1e-12, (part, left / way)


@pytest.mark.parametrize("pose", POSES)
def test_a_start_at_the_solution_takes_one_step_and_a_look(pose):
    model, boundary = cases.reference_case(pose)
    e = cases.solved(model, boundary)
    assert int(cases.solved(model, boundary, start=e.configuration).verdict.steps) == 2
