"""Constitutive law of a finite-length element, condensed from the section law: energy, force and tangent stiffness.

Between given end frames the strain of a rod is not constant: without loads inside, the section force ``n = (f, m)`` turns
with the material axes, ``m' = -A n`` with ``A n = e3 x f + Omega x m``, and the strain follows. The complementary energy of
that variation makes the element softer than its sections,

    C_eff = K^-1 + ds^2/12 A' K_Omega^-1 A,   K_Omega^-1 = the block of bending and torsion in K^-1,

which agrees with the exact energy up to ``ds^4``. For shear forces this is MacNeal's residual bending flexibility
``1/GA + ds^2/(12 EI)`` ("A simple quadrilateral shell element", 1978), which makes plane shapes converge with the fourth
power of ``ds``; the term in ``Omega`` does so for twisted ones, measured for ratios of the stiffnesses from 1 to 125.
Where EI and GJ change along the element as ``exp(g s)``, the strain changes with the compliance too: ``A n + g m`` takes the
place of ``A n``, and ``K`` is the mean stiffness of the element. As a compliance it is positive at every strain, whereas the
expansion of the energy itself is not bounded below for ``GJ >> EI``. It is not convex: where one stiffness is far below the
others, the solver stiffens the elements until it is near a solution (`statics.newton`).

All quantities derive from ``phi(e) = max over n of n'e - n' C_eff n / 2`` with 3x3 inverses, since the second term has
rank three. Where elements are longer than the bends, their shear strains are bends inside them: the share ``_bowed`` of these
shortens the element by its chord and bow, ``(1/2 + 1/10) gamma^2``, so that a limp cable hangs as a chain of any element does.
Effects add their own laws in the mean strain with that stretch, those with memory given the state of each element.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.geometry.lie import HATS, hat
from scan2flex_jax.geometry.small import cross, diagonal, diagonal_matrix, matmul, matvec, vecdot, vecmat
from scan2flex_jax.rod.effect import overriding
from scan2flex_jax.rod.memory import AbstractMemory, memories


def element_energy(rod, excess: Float[Array, "n 6"]) -> Float[Array, " n"]:
    """Energy per length (J/m) of the elements at mean excess strains (-, 1/m)."""
    extra, left = _extra_law(rod)

    def energy(e, natural, K, within, g, left):
        own, _ = _straightened(e, K, within, rod.section.ds)
        n, _ = _force(own, natural, K, within, g, rod.section.ds)
        return 0.5 * vecdot(n, own) + (extra(own, K, left) if extra else 0.0)

    return jax.vmap(energy)(excess, *_law(rod), left)


def element_forces(rod, excess: Float[Array, "n 6"]) -> Float[Array, "n 6"]:
    """Force and moment (N, N m) of the elements, work-conjugate to their mean strain; paper, Eq. 3 for short elements."""
    extra, left = _extra_law(rod)

    def force(e, natural, K, within, g, left):
        own, slope = _straightened(e, K, within, rod.section.ds)
        n, y = _force(own, natural, K, within, g, rod.section.ds)
        n = n.at[3:].add(-cross(n[3:], y))
        n = n + jax.grad(extra)(own, K, left) if extra else n
        return n.at[:2].add(n[2] * slope)

    return jax.vmap(force)(excess, *_law(rod), left)


def element_stiffness(rod, excess: Float[Array, "n 6"]) -> Float[Array, "n 6 6"]:
    """Tangent stiffness (N, N m, N m^2) of the elements to their mean strain: the second derivative of the energy."""
    extra, left = _extra_law(rod)

    def stiffness(e, natural, K, within, g, left):
        ds = rod.section.ds
        own, slope = _straightened(e, K, within, ds)
        n, y = _force(own, natural, K, within, g, ds)
        M = hat(n[3:])
        C = ds**2 / 12.0 * _inverse(within)
        # d(C_eff n)/de at fixed n, then the Schur complement of the stationary n
        W = _embed(hat(y)) - jnp.pad(matmul(_turning(e, natural, g).T, C, M), ((0, 0), (3, 0)))
        kept = np.eye(6) - W
        S = matmul(kept.T, _relaxed(own, natural, K, within, g, ds), kept) - _embed(matmul(M.T, C, M))
        tension = n[2]
        if extra:
            tension, S = tension + jax.grad(extra)(own, K, left)[2], S + jax.hessian(extra)(own, K, left)
        turn = np.eye(6) + np.eye(6)[2][:, None] * jnp.pad(slope, (0, 4))
        return matmul(turn.T, S, turn) + _tensioned(tension, K, within, ds)

    return jax.vmap(stiffness)(excess, *_law(rod), left)


def _law(rod) -> tuple[Array, Array, Array, Array | None]:
    s = rod.section
    return s.natural, s.stiffness, s.within, s.growth


_LEAST = 5.0  # compression times ds^2/EI at which the stiffness to shear is halved
_BOWED = 1.2  # twice (1/2 + 1/10): chord over its part along the frames, and the bow of a cubic over its chord


def _bowed(K, within, ds):
    """Share of each shear strain that is bending inside the element, not shear of the section."""
    bending = jnp.stack([within[1, 1], within[0, 0]])
    return 1.0 / (1.0 + 12.0 * bending / (ds**2 * diagonal(K)[:2]))


def _straightened(e, K, within, ds):
    """The strain with the stretch of the bowed element, and its slope in the two shear strains."""
    slope = _BOWED * _bowed(K, within, ds) ** 2 * e[:2]
    return e.at[2].add(0.5 * vecdot(slope, e[:2])), slope


def tension_stiffness(rod, of_strains: Float[Array, " n"], predicted: Float[Array, " n"]) -> Float[Array, "n 6 6"]:
    """Change of the tangent stiffness (N) of bowed elements by a ``predicted`` tension (N) in place of that ``of_strains``.

    A predicted compression is limited to half of what elements bear, which no solution comes near.
    """

    def change(own, tension, K, within):
        ds = rod.section.ds
        least = -_LEAST * jnp.minimum(within[0, 0], within[1, 1]) / ds**2
        return _tensioned(jnp.maximum(tension, least) - own, K, within, ds)

    return jax.vmap(change)(of_strains, predicted, rod.section.stiffness, rod.section.within)


def _tensioned(tension, K, within, ds):
    return tension * diagonal_matrix(jnp.pad(_BOWED * _bowed(K, within, ds) ** 2, (0, 4)))


def _extra_law(rod):
    """The energy of all effects as a function of strain, stiffness and state of an element (None without any), and the states
    of all elements."""
    remembered = memories(rod.effects)
    laws = [law for law in overriding(rod.effects, "strain_energy") if not isinstance(law, AbstractMemory)]

    def energy(e, K, left):
        own = sum(law.strain_energy(e, K) for law in laws)
        return own + sum(m.energy_given(e, K, q) for m, q in zip(remembered, left, strict=True))

    return energy if laws or remembered else None, tuple(m.before(rod.elements) for m in remembered)


def stiffness_within(K: Float[Array, "n 6 6"]) -> Float[Array, "n 3 3"]:
    """Bending and torsional stiffness (N m^2) against strain variation inside an element: at zero force, since the moment
    varies and the force does not."""
    return K[:, 3:, 3:] - matmul(K[:, 3:, :3], jax.vmap(_inverse)(K[:, :3, :3]), K[:, :3, 3:])


def _turning(e, natural, g):
    """Matrix ``A`` of the change per length of the moment over the stiffness, from force and moment."""
    turn = hat(e[3:] + natural[3:])
    return jnp.concatenate([HATS[2], turn if g is None else turn + g * np.eye(3)], axis=1)


def _softening(e, natural, K, within, g, ds):
    """``(A K, M)`` of the Woodbury form ``K_eff = K - K A' M^-1 A K``."""
    A = _turning(e, natural, g)
    AK = matmul(A, K)
    return AK, 12.0 / ds**2 * within + matmul(AK, A.T)


def _force(e, natural, K, within, g, ds):
    """``n = K_eff e`` and ``y = ds^2/12 K_Omega^-1 A n``."""
    AK, M = _softening(e, natural, K, within, g, ds)
    y = matvec(_inverse(M), matvec(AK, e))
    return matvec(K, e) - vecmat(y, AK), y


def _relaxed(e, natural, K, within, g, ds):
    AK, M = _softening(e, natural, K, within, g, ds)
    return K - matmul(AK.T, _inverse(M), AK)


def _embed(block):
    return jnp.pad(block, ((3, 0), (3, 0)))


def _inverse(K: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    """Inverse by the adjugate: cheaper than a library call for nine numbers."""
    rows = cross(jnp.roll(K, -1, axis=0), jnp.roll(K, -2, axis=0))
    return rows.T / vecdot(K[0], rows[0])
