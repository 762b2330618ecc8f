"""A cable whose axial and shear stiffness are left out: what it gives moves no point, and it is solved as quickly."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference import rotations
from reference.cantilever import chain

from scan2flex_jax import Cable, CableModel, Study, model_of
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.statics.solve import equilibrium
from scan2flex_jax.study import EffectDeclaration

NOTHING = 1e-6  # of the length
ALONG_X, DOWN = np.array([0.5, 0.5, 0.5, 0.5]), np.array([0.0, 1.0, 0.0, 0.0])
EARTH = jnp.array([0.0, 0.0, -9.81])
# length m, kg/m, EI, GJ (N m^2): 0.6 kg of cable, one that bends hardly, a rope whose bends are short
CABLES = {"heavy": (1.2, 0.5, 0.05, 0.04), "stiff": (0.4, 0.02, 0.5, 0.4), "rope": (2.0, 0.5, 1e-2, 1e-3)}


def between_clamps(length, density, EI, GJ, rigid=None):
    """A cable whose ends are level, 0.8 L apart, one of them rolled by 1 rad and aside."""
    roll = np.array([np.cos(0.5), np.sin(0.5), 0.0, 0.0])
    end = (jnp.array([0.8, 0.1, 0.05]) * length, jnp.array(rotations.multiply(roll, ALONG_X)))
    boundary = Boundary.of((jnp.zeros(3), jnp.array(ALONG_X)), end)
    return equilibrium(CableModel(Cable(length, density, EI, GJ, rigid, rigid), EARTH), boundary)


@pytest.mark.parametrize("name", CABLES)
def test_what_it_gives_moves_no_point(name):
    """Beside the limit: what is given is inverse to the stiffness, so a tenth of it is left at ten times the stiffness."""
    cable = CABLES[name]
    found = between_clamps(*cable)
    stiffer = between_clamps(*cable, 10 * float(Cable(*cable).axial_stiffness))
    limit = stiffer.points + (stiffer.points - found.points) / 9
    assert found.verdict.solved and stiffer.verdict.solved
    assert np.max(np.abs(found.points - limit)) < NOTHING * cable[0]


@pytest.mark.parametrize("name", CABLES)
def test_it_is_solved_in_as_many_steps(name):
    """As one of 1e5 N: the stiffness that holds motions without any stays below that of twisting a soft cable."""
    usual, rigid = (between_clamps(*CABLES[name], stiffness).verdict for stiffness in (1e5, None))
    assert rigid.solved and rigid.steps <= max(int(usual.steps), 6) + 4 <= 20


def study(*effects):
    """A cable of 0.6 kg that hangs straight down from a clamp."""
    pose = {"start": ([0.0, 0.0, 0.0], DOWN), "points": np.linspace([0, 0, 0], [0, 0, -1.2], 20)}
    known = {"length": 1.2, "length_density": 0.5, "bending_stiffness": 0.05, "torsional_stiffness": 0.04}
    return Study.from_arrays(known, [pose], effects=effects)


WEIGHT = EffectDeclaration("point_mass", {"position": 1.2, "mass": 8.0})


def test_a_heavy_cable_that_hangs_straight_keeps_its_length():
    boundary = Boundary.of((jnp.zeros(3), jnp.array(DOWN)), None)
    found = equilibrium(model_of(study()), boundary)
    assert found.verdict.solved
    np.testing.assert_allclose(found.points[-1], [0.0, 0.0, -1.2], atol=NOTHING * 1.2)


def test_a_heavy_chain_is_the_inextensible_catenary():
    """20 kg/m; what bending does is proportional to EI but next to the joints, and taken out by a second cable of half of it.

    A stiffness of 1e5 N would put the middle off by 1e-3 m.
    """
    ends = Boundary.of((jnp.zeros(3), None), (jnp.array([0.7, 0.0, 0.0]), None))
    found = [equilibrium(CableModel(Cable(1.0, 20.0, EI, EI), EARTH), ends) for EI in (0.04, 0.02)]
    assert all(e.verdict.solved for e in found)
    limp = 2 * np.asarray(found[1].points) - np.asarray(found[0].points)
    np.testing.assert_allclose(limp, chain(1.0, 0.7, np.asarray(found[0].s)), atol=5e-5)


def test_it_follows_the_forces_without_a_derivative():
    def axial(EI, density):
        return Cable(1.2, density, EI, 0.04).axial_stiffness

    np.testing.assert_allclose(axial(0.05, 0.5), 2e6 * (1.2 * 0.5 * 9.81 + 50 * 0.05 / 1.2**2))
    assert jax.grad(axial, argnums=(0, 1))(0.05, 0.5) == (0.0, 0.0)
    with_weight = model_of(study(WEIGHT)).cable.axial_stiffness
    np.testing.assert_allclose(with_weight - axial(0.05, 0.5), 2e6 * 8 * 9.81, rtol=1e-9)
    given = replace(study(), cable={**study().cable, "axial_stiffness": 3e4})
    assert float(model_of(given).cable.axial_stiffness) == 3e4
