"""Effect objects of declared effects.

A class has one field per parameter of the format, of the same name; a parameter with one value per end is an array with
leading axis 2 (start, end), in which an end without a clamp holds an inactive value.
"""

from collections.abc import Iterable, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from scan2flex_jax.effects.catalogue import effect_class
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.rod.effect import AbstractEffect
from scan2flex_jax.study.kinds import ENDS, KindFormat, ParameterFormat, kind_format

INERT = 0.0  # inactive value at an end without a clamp


def effect_of(kind: str, parameters: dict[str, Any], clamped_ends: Sequence[str] = ENDS) -> AbstractEffect:
    """The effect that a study declares.

    ``parameters`` as in the format (arrays may carry derivatives); a parameter with a value per end has as many rows as there
    are ``clamped_ends``, or two.
    """
    cls, format = effect_class(kind), kind_format(kind)
    missing = [p.name for p in format.parameters if p.name not in parameters and not p.optional]
    unknown = [name for name in parameters if name not in format.names]
    if missing or unknown:
        fault = f"lacks {', '.join(missing)}" if missing else f"has no parameter {', '.join(unknown)}"
        raise Scan2FlexError(f"The effect {kind} {fault}: give {', '.join(format.names)}.")
    counts = {p.name: len(np.atleast_1d(parameters[p.name])) for p in format.parameters if p.per_point}
    if len(set(counts.values())) > 1:
        given = ", ".join(f"{count} of {name}" for name, count in counts.items())
        raise Scan2FlexError(f"The effect {kind} has {given}: give as many of each.")
    inert = getattr(cls, "inert", INERT)
    stated = [p for p in format.parameters if p.name in parameters]
    return cls(**{p.name: _given(p, parameters[p.name], clamped_ends, inert, format) for p in stated})


def ordered(effects: Iterable[AbstractEffect]) -> tuple[AbstractEffect, ...]:
    """Effects in the order of application that the format defines, independent of the order of declaration.

    Offsets of a clamp before its rotation, stiffnesses before their couplings, the elastic clamp last, the scale of
    a scan before its shift; otherwise as declared.
    """
    return tuple(sorted(effects, key=lambda effect: getattr(type(effect), "rank", 0)))


def _given(parameter: ParameterFormat, value: Any, clamped_ends: Sequence[str], inert: float, format: KindFormat):
    """The field of one parameter: its value, expanded to both ends if it has one per end."""
    value = jnp.asarray(value, float)
    shapes = parameter.shapes(len(clamped_ends), value.shape[0] if value.ndim else 0)
    if value.shape not in shapes:
        wanted = " or ".join(map(str, shapes))
        raise Scan2FlexError(f"{format.kind}.{parameter.name} has shape {value.shape}: give {wanted}.")
    if parameter.per_end and value.shape[0] == 1:
        row = ENDS.index(clamped_ends[0]) if clamped_ends else 0
        return jnp.full((2, *parameter.shape), inert).at[row].set(value[0])
    return value
