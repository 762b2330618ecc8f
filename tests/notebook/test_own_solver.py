"""A solver of one's own, and those of optimistix, solve rods; each with its own tolerances and steps."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest

from scan2flex_jax import AbstractRodSolver, MixedNewton, Scan2FlexError, Settled, equilibrium, solve_rod
from scan2flex_jax.rod.assembly import derivatives
from scan2flex_jax.rod.energy import retract, supported
from scan2flex_jax.rod.model import discretise
from scan2flex_jax.statics import blocktridiagonal as bt
from scan2flex_jax.statics.verdict import MAX_STEPS_REACHED

from . import rods

MODEL, BOUNDARY = rods.scene(rods.HERE)


def solved(**options):
    return equilibrium(MODEL, BOUNDARY, elements=rods.ELEMENTS, **options)


@pytest.fixture(scope="module")
def newton():
    found = solved()
    assert found.verdict.solved
    return found


class PlainNewton(AbstractRodSolver):
    """Newton without any safeguard, from a start whose stretching is right."""

    atol: float = 1e-9

    def settle(self, rod, start, max_steps):
        def advance(carry):
            c, _, steps = carry
            d = derivatives(rod, c)
            twist, _ = bt.factor_and_solve(d.diagonal, d.upper, -d.gradient[..., None])
            return retract(c, twist[..., 0]), jnp.max(jnp.abs(twist)), steps + 1

        most = 30 if max_steps is None else max_steps
        begin = (supported(rod, start), jnp.array(1.0), jnp.array(0))
        c, size, steps = jax.lax.while_loop(lambda x: (x[1] > self.atol) & (x[2] < most), advance, begin)
        d = derivatives(rod, c)
        return Settled(c, d, bt.factor(d.diagonal, d.upper).negative, steps, size > self.atol)


def test_an_own_solver_is_used(newton):
    near = newton.configuration._replace(r=newton.points + 1e-7 * jnp.sin(jnp.arange(rods.ELEMENTS + 1.0))[:, None])
    found = solved(start=near, solver=PlainNewton())
    assert found.verdict.solved
    assert int(found.verdict.steps) < 10
    np.testing.assert_allclose(found.points, newton.points, atol=1e-9)


@pytest.mark.slow
def test_its_derivatives_are_those_of_the_default_solver(newton):
    def height(x, solver):
        return rods.found(x, start=newton.configuration, solver=solver).points[6, 2]

    own, default = (jax.grad(height)(jnp.zeros(6), solver) for solver in (PlainNewton(), None))
    np.testing.assert_allclose(own, default, atol=1e-9)


def test_steps_and_tolerance_are_limited_and_told(newton):
    few = solved(max_steps=2)
    assert int(few.verdict.steps) == 2 and int(few.verdict.code) == MAX_STEPS_REACHED
    loose = solved(solver=MixedNewton(atol=1e-2))
    assert int(loose.verdict.steps) < int(newton.verdict.steps)


def test_what_is_no_solver_is_one_sentence(as_a_user_runs_it):
    with pytest.raises(Scan2FlexError, match="solver is LevenbergMarquardt: give None, an AbstractRodSolver"):
        solved(solver=optx.LevenbergMarquardt(1e-8, 1e-8))
    with pytest.raises(Scan2FlexError, match="solver is str"):
        solved(solver="bfgs")


def test_throw_raises_one_sentence():
    with pytest.raises(Scan2FlexError, match="the rod was not solved: no equilibrium found within the allowed steps"):
        solved(max_steps=2, throw=True)
    assert solved(throw=True).verdict.solved


@pytest.mark.slow
def test_throw_raises_inside_a_compiled_function():
    run = eqx.filter_jit(lambda n: solved(max_steps=n, throw=True).points)
    with pytest.raises(Exception, match="the rod was not solved: no equilibrium found within the allowed steps"):
        run(2)


def test_a_rod_is_solved_without_its_model(newton):
    rod = discretise(MODEL, BOUNDARY, rods.ELEMENTS)
    np.testing.assert_allclose(solve_rod(rod).points, newton.points, atol=1e-9)
    softer = eqx.tree_at(lambda r: r.section.stiffness, rod, 0.9 * rod.section.stiffness)
    assert solve_rod(softer).points[6, 2] < newton.points[6, 2]
