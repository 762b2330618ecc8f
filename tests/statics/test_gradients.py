"""Derivatives of an equilibrium against finite differences that know their noise.

Central differences over halved steps, extrapolated (Richardson); of the estimates the one that its neighbour confirms
best is taken. Everything is differentiated: each parameter of the cable, gravity, the clamps' places and rotations, and
the parameters of an effect; observed are positions, the reactions and the energy.
"""

from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree
from reference import clamped_cases

from scan2flex_jax.geometry import lie
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.energy import potential_energy
from scan2flex_jax.rod.model import CableModel, discretise
from scan2flex_jax.statics.solve import equilibrium

from . import cases

N = 20
# parameters with the size of a noticeable change; shear and axial stiffness are low enough to be felt
VALUES = {
    "cable": Cable(1.0, 0.2, (0.1, 0.14), 0.25, (300.0, 200.0), 400.0, (0.3, -0.2, 0.4), (1e-3, -2e-3, 3e-3)),
    "gravity": jnp.array([0.5, -0.3, -9.81]),
    "positions": jnp.array([[0.0, 0.0, 0.0], clamped_cases.CASES["P3"].end]),
    "turns": jnp.zeros((2, 3)),
    "effect": cases.PointForce(jnp.array(0.43), jnp.array([0.2, -0.3, 0.1])),
}
CENTRE, UNRAVEL = ravel_pytree(VALUES)
SIZES = np.where(np.abs(CENTRE) > 0, np.abs(CENTRE), 0.1)
FRAMES = jnp.array([clamped_cases.START_FRAME, clamped_cases.CASES["P3"].end_frame])


def names():
    """One name for each entry of the flat parameters."""
    paths = jax.tree_util.tree_flatten_with_path(VALUES)[0]
    return [f"{jax.tree_util.keystr(path)}[{i}]" for path, x in paths for i in range(np.size(x))]


def case(z):
    """Model and boundary at ``CENTRE + SIZES z``."""
    values = UNRAVEL(CENTRE + SIZES * z)
    rotation = jnp.stack([FRAMES[e] @ lie.so3_exp(values["turns"][e]) for e in (0, 1)])
    model = CableModel(values["cable"], values["gravity"], (values["effect"],))
    return model, Boundary(values["positions"], rotation, jnp.ones((2, 6)))


built = jax.jit(case)
zero = np.zeros(CENTRE.size)


@cache
def start():
    """The equilibrium at the centre, from which all others begin, so that they are on its branch."""
    model, boundary = built(zero)
    answer = cases.solved(model, boundary, N)
    assert answer.verdict.solved
    return answer.configuration


def observe(answer):
    force, moment = answer.reactions()
    return jnp.concatenate([answer.points[5:-1:5].ravel(), force.ravel(), moment.ravel(), answer.energy[None]])


observed = eqx.filter_jit(observe)


def outcome(z):
    """Observed values, traceable."""
    model, boundary = case(z)
    return observe(equilibrium(model, boundary, start=start(), elements=N))


def measured(z):
    """The same by the functions that are compiled already."""
    model, boundary = built(z)
    return np.asarray(observed(equilibrium(model, boundary, start=start(), elements=N)))


def richardson(direction):
    """Derivative along ``direction`` and its uncertainty, from steps 0.02 / 2^k extrapolated to zero."""
    steps = 0.02 * 0.5 ** np.arange(5)
    rows = [[(measured(h * direction) - measured(-h * direction)) / (2 * h)] for h in steps]
    best, spread = None, np.inf
    for i in range(1, len(rows)):
        for j in range(1, i + 1):
            rows[i].append(rows[i][j - 1] + (rows[i][j - 1] - rows[i - 1][j - 1]) / (4**j - 1))
            doubt = max(np.abs(rows[i][j] - rows[i][j - 1]).max(), np.abs(rows[i][j] - rows[i - 1][j - 1]).max())
            if doubt < spread:
                best, spread = rows[i][j], doubt
    return best, spread


@pytest.fixture(scope="module")
def forward():
    start()
    return np.asarray(jax.jit(jax.jacfwd(outcome))(zero))


@pytest.mark.parametrize("k", range(CENTRE.size), ids=names())
def test_jacfwd_matches_finite_differences(forward, k):
    slope, doubt = richardson(np.eye(CENTRE.size)[k])
    scale = np.abs(slope).max()
    assert doubt < 1e-6 * scale, "the finite difference is too noisy to judge"
    np.testing.assert_allclose(forward[:, k], slope, atol=1e-6 * scale)


def test_energy_slope_is_the_partial_one():
    """At an equilibrium the energy changes with a parameter as it does with the shape held (envelope theorem)."""
    model, boundary = built(zero)
    answer = equilibrium(model, boundary, start=start(), elements=N)

    def held(z):
        return potential_energy(answer.configuration, discretise(case(z)[0], boundary, N))

    names_of = names()
    inner = [k for k, name in enumerate(names_of) if "positions" not in name and "turns" not in name]
    slope = np.asarray(jax.jit(jax.grad(held))(zero))[inner]
    total = np.array([richardson(np.eye(CENTRE.size)[k])[0][-1] for k in inner])
    np.testing.assert_allclose(slope, total, atol=1e-7 * np.abs(total).max())
