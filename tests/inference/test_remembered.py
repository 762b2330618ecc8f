"""Memory that a study does not declare: how it acts to first order, and what `explain` answers about it."""

from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.effects import Friction, Relaxation
from scan2flex_jax.inference import explain
from scan2flex_jax.inference.settings import USUAL
from scan2flex_jax.inference.variants import _natural

from .test_memory import study_with

K = np.diag([1e5, 1e5, 1e4, 0.02, 0.02, 0.015])


def natural(effect, path, reset=(False, False), held=(0.0, 0.0)):
    """Natural curvature about d2 of one element for poses of these curvatures."""
    excess = np.zeros((len(path), 1, 6))
    excess[:, 0, 4] = path
    return np.asarray(_natural(effect, excess, np.tile(K, (len(path), 1, 1, 1)), np.array(held), np.array(reset)))[:, 0, 4]


def test_a_slider_acts_like_the_natural_curvature_that_it_takes_off_the_moment():
    """Of share 1 it leaves the moment EI clip(k - q, -slip, slip) of EI k: the difference is that of a natural curvature."""
    effect = Friction(1.0, 1.0, spread=(1.0,), rounding=1e-9)
    np.testing.assert_allclose(natural(effect, [3.0, 1.0]), [2.0, 2.0], atol=1e-7)  # it pulls back with all its force
    np.testing.assert_allclose(natural(effect, [1.0, 3.0]), [0.0, 2.0], atol=1e-7)
    np.testing.assert_allclose(natural(effect, [3.0, 1.0], reset=(False, True)), [2.0, 0.0], atol=1e-7)


def test_relaxation_acts_like_the_part_of_the_last_bend_that_crept_away():
    found = natural(Relaxation(1.0, 60.0), [2.0, 0.5], held=(60.0, 0.0))
    np.testing.assert_allclose(found, [0.0, 2.0 * (1.0 - np.exp(-1.0))])


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.6, 0.0])
def test_friction_of_another_solver_is_found_and_none_where_there_is_none(share):
    """The friction of Dahl, about one axis: named by its law, and not tied with that of sliders."""
    found = explain(study_with(share), mesh=False, settings=replace(USUAL, most_effects=1))  # sets are not the question here
    kinds = {k for r in found.chosen for k in (r.kind, *r.tied_with)}
    assert kinds == ({"dahl"} if share else set()), (found.verdict, kinds)
    assert (found.verdict == "no missing effect") is (share == 0)
    if share:
        (effect,) = found.study.effects
        assert effect.parameters["share"] == pytest.approx(share, abs=0.02)
        assert [loop.of for loop in found.loops] == ["bending"]  # a plane cable has no twist
