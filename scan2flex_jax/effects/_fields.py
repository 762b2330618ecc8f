"""Fields of effects: float64 arrays of one declared shape, so that every parameter is a differentiable leaf."""

import equinox as eqx
import jax.numpy as jnp

INERT = 0.0  # an end without a clamp has this value, which does nothing


def parameter(*shape: int, default=None):
    """A field that holds an array of ``shape``; ``default`` may be a scalar that fills it."""

    def convert(x):
        return jnp.broadcast_to(jnp.asarray(x, float), shape)

    return eqx.field(converter=convert) if default is None else eqx.field(converter=convert, default=default)


def places():
    """A field that holds growing arc lengths, or None: evenly from 0 to L."""
    return eqx.field(converter=lambda s: None if s is None else jnp.asarray(s, float), default=None)


def values(*trailing: int):
    """A field that holds rows of shape ``trailing``, as many as are given."""

    def convert(x):
        x = jnp.asarray(x, float)
        return x if x.ndim > len(trailing) else jnp.broadcast_to(x, (1, *trailing))

    return eqx.field(converter=convert)
