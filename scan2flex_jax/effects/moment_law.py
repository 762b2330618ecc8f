"""A moment law of any form: the tangent stiffness at points of a strain, the moment and the energy that follow from it.

``q`` (1/m) is the strain that the law acts on (curvature or twist), ``B`` (N m^2) the stiffness at zero strain. The law is the
tangent stiffness ``dm/dq = B factor(q)``: ``factor`` is 1 at zero, has a positive value at each point of a grid, is linear
in ``q^2`` between them (a law is odd, so its slope is even) and constant beyond the last. Moment and energy are its integrals,

    m(q) = B int_0^q factor dx,    U(q) = int_0^q m dx = q m(q) - B int_0^q x factor dx,

polynomials between the points. So ``m`` grows with ``q`` and ``U`` is convex, whatever the positive values; ``U`` is twice
continuously differentiable, at zero too, where it is a polynomial in ``u = q^2``. All factors 1: the linear law.

A fit estimates the logarithms of ``factor``. Their prior is a random walk along the grid from 0 at zero strain: its mean is the
linear law, and beyond the strains of the poses it goes on with the tangent stiffness where they end. ``B`` is the slope at zero
strain, which the walk leaves alone, so that the two are told apart. Reference: Flaschel, Kumar, De Lorenzis, "Unsupervised
discovery of interpretable hyperelastic constitutive laws" (2021).
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.entry import Context
from scan2flex_jax.rod.effect import AbstractEffect

WALK = 1.5  # standard deviation of log factor at the last point: slipping wires keep a fifth of their stiffness or less
_POINTS = 8  # of the grid of an effect that is searched for
_NEAR_ZERO = 1e-3  # of the largest strain: there other laws have their stiffness at zero strain
_SOFTEST = 1e-3  # tangent stiffness over that at zero strain: a law that is given may fall


def excess_energy(u: Float[Array, ""], at: Float[Array, " m"], factor: Float[Array, " m"]) -> Float[Array, ""]:
    """Energy over ``B`` (1/m^2) in addition to the quadratic ``u/2``, at ``u = q^2`` (1/m^2)."""
    first = u <= at[0] ** 2
    q = jnp.sqrt(jnp.where(first, at[0] ** 2, u))  # no square root at zero, where its derivatives have no limit
    low, a, b = _pieces(at, factor)

    def primitive(x):  # of (q - x) (a + b x^2)
        return x * (a * (q - 0.5 * x) + b * x * x * (q / 3.0 - 0.25 * x))

    past = jnp.where(q > at[-1], q - at[-1], 0.0)
    beyond = jnp.sum(primitive(_within(q, low, at)) - primitive(low)) + 0.5 * (factor[-1] - 1.0) * past * past
    return jnp.where(first, (factor[0] - 1.0) / at[0] ** 2 * u * u / 12.0, beyond)


def excess_moment(q: Float[Array, "..."], at: Float[Array, " m"], factor: Float[Array, " m"]) -> Float[Array, "..."]:
    """Moment over ``B`` (1/m) in addition to the linear ``q``, for ``q`` (1/m) of zero or more."""
    low, a, b = _pieces(at, factor)

    def primitive(x):  # of a + b x^2
        return x * (a + b * x * x / 3.0)

    past = jnp.where(q > at[-1], q - at[-1], 0.0)
    return jnp.sum(primitive(_within(q[..., None], low, at)) - primitive(low), axis=-1) + (factor[-1] - 1.0) * past


def tangent(q: Float[Array, "..."], at: Float[Array, " m"], factor: Float[Array, " m"]) -> Float[Array, "..."]:
    """Tangent stiffness over ``B`` (-)."""
    return jnp.interp(q**2, jnp.append(0.0, at) ** 2, jnp.append(1.0, factor))


def _pieces(at, factor):
    """Lower ends of the pieces of a law, and on each the coefficients of ``factor - 1 = a + b x^2``."""
    zero = jnp.zeros(1)
    low, excess = jnp.concatenate([zero, at[:-1]]), jnp.concatenate([zero, factor - 1.0])
    b = (excess[1:] - excess[:-1]) / (at * at - low * low)
    return low, excess[:-1] - b * low * low, b


def _within(x, low, high):
    """``x`` limited to a range; unlike that of `jnp.clip` the derivative belongs to one piece where two meet."""
    return jnp.where(x <= low, low, jnp.where(x > high, high, x))


def law(cls: Callable[..., AbstractEffect], grid: str, axis: int, most: Callable[[Context], float]) -> dict[str, Any]:
    """Fields of the catalogue entry of a law of strain ``axis``: a grid from zero to the strain ``most(context)`` (1/m), on it
    the steps of the random walk as amplitudes."""

    def points(site):
        return site["most"] * np.arange(1, _POINTS + 1) / _POINTS

    def like(effects, stiffness, site):
        stiffness = jnp.asarray(stiffness)

        def energy(q):
            strain = jnp.zeros(6).at[axis].set(q)
            return 0.5 * stiffness[axis, axis] * q**2 + sum(e.strain_energy(strain, stiffness) for e in effects)

        factor = jax.vmap(jax.hessian(energy))(jnp.append(_NEAR_ZERO * site["most"], points(site))) / stiffness[axis, axis]
        steps = np.diff(np.log(np.maximum(factor, _SOFTEST)))
        return steps if np.all(np.isfinite(steps)) else None

    return {
        "field": True,
        "late": True,  # room for its energy in the states of every search would slow all of them
        "amplitudes": tuple(f"step {k + 1}" for k in range(_POINTS)),
        "size": lambda c: np.full(_POINTS, WALK / np.sqrt(_POINTS)),  # as in a fit
        "like": like,
        "build": lambda a, site, c: (cls(**{grid: points(site), "factor": jnp.exp(jnp.cumsum(a))}),),
        "sites": lambda c: ({"most": most(c)},),
    }
