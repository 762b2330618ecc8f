"""The law of an element: one energy, its own derivatives, positive for any stiffness, the section's for short elements."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from scan2flex_jax.rod.element_law import element_energy, element_forces, element_stiffness, stiffness_within

from .scenes import Hardening, random_rod

LAW = (Hardening(jnp.array(0.2)),)


@jax.jit
def law(rod, excess):
    return element_energy(rod, excess), element_forces(rod, excess), element_stiffness(rod, excess)


@jax.jit
def differentiated(rod, excess):
    def total(e):
        return jnp.sum(element_energy(rod, e))

    def forces(e):
        return jax.grad(total)(e)

    # elements know nothing of each other, so one direction for all gives a column of each
    columns = jax.vmap(lambda d: jax.jvp(forces, (excess,), (jnp.broadcast_to(d, excess.shape),))[1])(jnp.eye(6))
    return forces(excess), jnp.moveaxis(columns, 0, 2)


def strains(seed, rod, size=0.8):
    return jnp.array(size * np.random.default_rng(seed).normal(size=(rod.elements, 6)))


@pytest.mark.parametrize(
    ("effects", "growth"), [((), 0.0), (LAW, 0.0), ((), 3.0)], ids=["linear", "with a law of an effect", "stiffness that grows"]
)
@pytest.mark.parametrize("seed", [0, 1])
def test_forces_and_stiffness_are_derivatives_of_the_energy(effects, growth, seed):
    """For full random stiffness matrices, natural strains and large strains."""
    rod, _ = random_rod(seed, effects)
    if growth:
        slopes = growth * jnp.linspace(-1.0, 1.0, rod.elements)
        rod = eqx.tree_at(lambda r: r.section.growth, rod, slopes, is_leaf=lambda x: x is None)
    excess = strains(seed, rod)
    _, forces, stiffness = law(rod, excess)
    exact_forces, exact_stiffness = differentiated(rod, excess)
    np.testing.assert_allclose(forces, exact_forces, atol=1e-12 * np.abs(exact_forces).max())
    np.testing.assert_allclose(stiffness, exact_stiffness, atol=1e-12 * np.abs(exact_stiffness).max())
    np.testing.assert_allclose(stiffness, jnp.swapaxes(stiffness, 1, 2), atol=1e-12 * np.abs(stiffness).max())


def diagonal_rod(EI, GJ, GA=1e5):
    """The random rod's sections without couplings."""
    rod, _ = random_rod(7)
    K = jnp.broadcast_to(jnp.diag(jnp.array([GA, GA, GA, EI, EI, GJ])), (rod.elements, 6, 6))
    return eqx.tree_at(lambda r: (r.section.stiffness, r.section.within), rod, (K, stiffness_within(K)))


@pytest.mark.parametrize("ratio", [1e-4, 1.0, 1e4])
def test_energy_is_never_negative(ratio):
    """GJ/EI over eight decades; strains from small to far beyond what a mesh may hold. Without shear, by which a bowed element
    is longer than its chord, never more than the section's."""
    rod = diagonal_rod(0.1, 0.1 * ratio)
    for size in (1e-3, 0.1, 1.0, 10.0, 100.0):
        for seed in range(5):
            excess = strains(seed, rod, size)
            assert np.all(law(rod, excess)[0] > 0.0)
            straight = excess.at[:, :2].set(0.0)
            section = 0.5 * jnp.einsum("ni,nij,nj->n", straight, rod.section.stiffness, straight)
            assert np.all(law(rod, straight)[0] <= section * (1 + 1e-12))


def test_short_elements_have_the_law_of_the_section():
    """``n = K e`` and the stiffness ``K`` for ``ds`` to zero, approached with its square."""
    rod, _ = random_rod(3)
    excess, K = strains(3, rod), rod.section.stiffness
    off = []
    for ds in (1e-2, 5e-3, 2.5e-3, 1e-7):
        _, forces, stiffness = law(eqx.tree_at(lambda r: r.section.ds, rod, jnp.array(ds)), excess)
        off.append([np.abs(forces - jnp.einsum("nij,nj->ni", K, excess)).max(), np.abs(stiffness - K).max()])
    assert np.all(np.log2(np.divide(off[:2], off[1:3])) > 1.9)
    assert np.all(np.array(off[3]) < 1e-11)


def test_law_of_an_effect_adds_to_that_of_the_section():
    """For short elements: the gradient of the effect's own energy beside ``K e``."""
    rod, _ = random_rod(4, LAW)
    rod, excess = eqx.tree_at(lambda r: r.section.ds, rod, jnp.array(1e-7)), strains(4, rod)
    own = jax.vmap(jax.grad(LAW[0].strain_energy))(excess, rod.section.stiffness)
    plain = jnp.einsum("nij,nj->ni", rod.section.stiffness, excess)
    np.testing.assert_allclose(law(rod, excess)[1], plain + own, atol=1e-11)


@pytest.mark.parametrize("GJ", [0.0008, 0.1, 12.5])
def test_shear_flexibility_of_a_plane_element(GJ):
    """A straight element under a transverse force: 1/GA + ds^2/(12 EI), MacNeal's residual bending flexibility."""
    rod = diagonal_rod(0.1, GJ, 50.0)
    rod = eqx.tree_at(lambda r: r.section.natural, rod, jnp.zeros((rod.elements, 6)))
    stiffness = law(rod, jnp.zeros((rod.elements, 6)))[2]
    np.testing.assert_allclose(1 / stiffness[:, 0, 0], 1 / 50.0 + 0.3**2 / (12 * 0.1), rtol=1e-12)
    np.testing.assert_allclose(stiffness[:, 2, 2], 50.0, rtol=1e-12)


@pytest.mark.parametrize("tension", [-0.5, 0.5, 5.0])
def test_a_tension_stiffens_an_element_as_a_beam_column(tension):
    """Both ends turned alike from the chord by a small angle: their moment is 2 EI/h phi^2 tanh(phi)/(phi - tanh(phi)) of the
    angle with phi = h sqrt(T/EI) and h half the length (Timoshenko and Gere, 1961), up to phi^4/400 of it."""
    EI, ds = 0.1, 0.3
    rod = diagonal_rod(EI, EI, 1e9)
    rod = eqx.tree_at(lambda r: r.section.natural, rod, jnp.zeros((rod.elements, 6)))
    stretched = jnp.zeros((rod.elements, 6)).at[:, 2].set(tension / 1e9)
    found = ds * (law(rod, stretched)[2][:, 0, 0] - tension)
    phi = 0.5 * ds * np.sqrt(complex(tension / EI))
    exact = (4.0 * EI / ds * phi**2 * np.tanh(phi) / (phi - np.tanh(phi))).real
    np.testing.assert_allclose(found, exact, rtol=abs(phi) ** 4 / 400.0)
