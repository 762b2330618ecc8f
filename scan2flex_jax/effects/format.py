"""Parameter fields of an effect class, and the file format derived from them: name, unit, shape and domain.

A field made with `parameter` can be declared in a study under ``[[effect]]``, and `format_of` collects those of a class; `leaf`
and `rows` make fields outside the format. All of them are float64 arrays of a declared shape, so that each is a differentiable
leaf. `study.kinds` reads the package's formats from a table, because it reads studies without JAX: ``python -m
scan2flex_jax.effects`` writes that table from the classes.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import MISSING
from typing import Any, cast, get_args

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.rod.effect import AbstractEffect
from scan2flex_jax.rod.memory import AbstractMemory
from scan2flex_jax.study.kinds import ENDS, Domain, KindFormat, Memory, ParameterFormat, Place

_FORMAT = "parameter of the format"  # key in the metadata of a field


def parameter(
    unit: str,
    *shape: int,
    default: Any = MISSING,
    domain: str = "any",
    per_end: bool = False,
    per_point: bool = False,
    estimable: bool = True,
    walk: float = 0.0,
    smooth: float = 0.0,
    optional: bool = False,
) -> Any:
    """A field that a study may declare: its ``unit``, the shape of one value, and the rest as in `ParameterFormat`.

    ``per_end``: the field has leading axis 2 (start, end). ``per_point``: its number of rows is arbitrary. A ``default`` may
    be a scalar that fills the field, or None, which stays None; such a field is keyword-only. That of an ``optional`` one is 0
    unless given.
    Raises `Scan2FlexError` for an unknown domain.
    """
    _check("domain of a parameter", domain, get_args(Domain))
    said = {
        "unit": unit, "shape": shape, "domain": domain, "per_end": per_end, "per_point": per_point, "estimable": estimable,
        "walk": walk, "smooth": smooth, "optional": optional,
    }  # fmt: skip
    default = 0.0 if optional and default is MISSING else default
    convert = _of_rows(shape) if per_point else _of_shape((2, *shape) if per_end else shape)
    return eqx.field(converter=convert, default=default, kw_only=default is None, metadata={_FORMAT: said})


def leaf(*shape: int, default: Any = MISSING) -> Any:
    """A field that holds an array of ``shape``; ``default`` may be a scalar that fills it."""
    return eqx.field(converter=_of_shape(shape), default=default)


def rows(*trailing: int) -> Any:
    """A field of any number of rows of shape ``trailing``."""
    return eqx.field(converter=_of_rows(trailing))


def _of_shape(shape):
    return lambda x: None if x is None else jnp.broadcast_to(jnp.asarray(x, float), shape)


def _of_rows(trailing):
    def convert(x):
        if x is None:
            return None
        x = jnp.asarray(x, float)
        return x if x.ndim > len(trailing) else jnp.broadcast_to(x, (1, *trailing))

    return convert


def _check(what, given, choices):
    if given not in choices:
        raise Scan2FlexError(f"The {what} is {given!r}: use one of {', '.join(choices)}.")


def format_of(cls: type[AbstractEffect]) -> KindFormat | None:
    """The format of an effect class; None for a class without a `parameter`, which no study can declare.

    Raises `Scan2FlexError` for a class that lacks ``kind``, ``place`` or ``words``, for an unknown place, and for
    other fields without a default.
    """
    found = dataclasses.fields(cls)
    parameters = tuple(ParameterFormat(f.name, **f.metadata[_FORMAT]) for f in found if _FORMAT in f.metadata)
    for name in ("kind", "place", "words") if parameters else ("kind",):
        if not isinstance(getattr(cls, name, None), str):
            raise Scan2FlexError(f"The effect class {cls.__name__} has no text `{name}`: give it one.")
    if not parameters:
        return None
    _check(f"place of {cls.__name__}", cls.place, get_args(Place))
    for f in found:
        if _FORMAT not in f.metadata and f.default is MISSING:
            raise Scan2FlexError(
                f"{cls.__name__}.{f.name} is no parameter of the format and has no default: make it a `parameter`, or give one."
            )
    memory = cls.needs if issubclass(cls, AbstractMemory) else "none"
    _check(f"memory of {cls.__name__}", memory, get_args(Memory))
    return KindFormat(cls.kind, cast(Place, cls.place), parameters, cls.words, cast(Memory, memory))


def parameters_of(
    effect: AbstractEffect, clamped_ends: Sequence[str] = ENDS, cls: type[AbstractEffect] | None = None, context: Any = None
) -> dict[str, Any]:
    """The parameters of an effect in the format's types, floats and numpy arrays: its fields, or what it has ``reported``.

    ``cls`` is the class that a study declares where the effect is of another one; ``context`` its `Context` then.
    """
    form = format_of(cls or type(effect))
    names = () if form is None else form.names
    fields = effect.reported(context) if hasattr(effect, "reported") else {n: getattr(effect, n) for n in names}
    left_out = () if form is None else tuple(p.name for p in form.parameters if p.optional and fields.get(p.name) is None)
    fields = {name: x for name, x in fields.items() if name not in left_out}
    rows = [ENDS.index(end) for end in clamped_ends]
    per_end = () if form is None else tuple(p.name for p in form.parameters if p.per_end)
    arrays = {name: np.asarray(x)[rows] if name in per_end else np.asarray(x) for name, x in fields.items()}
    return {name: float(x) if x.ndim == 0 else x for name, x in arrays.items()}
