"""Conversion of a caller's numbers to a float64 array, with one sentence for anything else."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from scan2flex_jax.errors import Scan2FlexError

_SHOWN = 60  # longest excerpt of the value in a message
_WORDS = {(): "one real number", (4,): "a quaternion [w, x, y, z]", (3, 3): "a 3x3 matrix with columns d1, d2, d3"}


def reals(x: Any, name: str, *shapes: tuple[int, ...]) -> Array | np.ndarray:
    """``x`` as a float64 array with one of ``shapes``; a JAX array if ``x`` is or contains one (traced or not), else numpy's.

    Raises `Scan2FlexError` under the name ``name``; a bool is not a number. Values that are not finite pass: the solve
    reports them.
    """
    traced = any(isinstance(leaf, Array) for leaf in jax.tree.leaves(x))
    try:
        found = jnp.asarray(x) if traced else np.asarray(x)
    except (TypeError, ValueError) as error:  # lists of several lengths
        raise Scan2FlexError(f"{name} is {_shown(x)}: give {_wanted(shapes)}.") from error
    if not (np.issubdtype(found.dtype, np.floating) or np.issubdtype(found.dtype, np.integer)):
        raise Scan2FlexError(f"{name} is {_shown(x)}: give {_wanted(shapes)}.")
    if found.shape not in shapes:
        raise Scan2FlexError(f"{name} has shape {found.shape}: give {_wanted(shapes)}.")
    return found.astype(float)


def _shown(x: Any) -> str:
    text = "".join(c if c.isprintable() else " " for c in repr(x)[: 4 * _SHOWN])
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


def _wanted(shapes: tuple[tuple[int, ...], ...]) -> str:
    """The shapes in words."""
    return " or ".join(_WORDS.get(shape, f"{' x '.join(map(str, shape))} real numbers") for shape in shapes)
