"""Base of a study's records: equality by content, and immutable contents.

A frozen dataclass whose arrays and dicts refuse changes stays as checked; `dataclasses.replace` makes a changed copy,
which is checked again.
"""

from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from typing import Annotated, Any, NoReturn, TypeVar, no_type_check

import numpy as np

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.study.values import Where, shown

_Kind = TypeVar("_Kind")


def converting(record: type[_Kind]) -> type[_Kind]:
    """A dataclass whose `__post_init__` takes any values, and rejects unusable ones with a sentence.

    Its annotations hold after conversion; a runtime check of the constructor's arguments against them would come too early.
    """
    no_type_check(record.__init__)
    return record


class Compared:
    """Equality by content, for dataclasses that hold arrays."""

    __hash__ = None  # type: ignore[assignment]

    def __eq__(self, other: object) -> bool:
        return same(self, other)


def same(a: Any, b: Any) -> bool:
    """Equal in type, shape and every number; dataclasses field by field."""
    if is_dataclass(a):
        compared = [f.name for f in fields(a) if f.compare]
        return type(a) is type(b) and all(same(getattr(a, name), getattr(b, name)) for name in compared)
    if isinstance(a, dict):
        return isinstance(b, dict) and a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, tuple):
        return isinstance(b, tuple) and len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        numbers = np.asarray(a).dtype.kind == "f"
        return np.shape(a) == np.shape(b) and type(a) is type(b) and bool(np.array_equal(a, b, equal_nan=numbers))
    return bool(a == b)


class ReadOnly(dict[str, Any]):
    """A dict that cannot be changed in place, so that its contents stay as checked."""

    def _refuse(self, *_: object, **__: object) -> NoReturn:
        raise Scan2FlexError(
            "a study is not changed in place: make a copy, as in replace(study, cable={**study.cable, 'length': 0.9}), "
            "with replace from dataclasses."
        )

    __setitem__ = __delitem__ = __ior__ = update = pop = popitem = setdefault = clear = _refuse

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled by its contents: the default would fill an empty dict."""
        return type(self), (dict(self),)


def read_only(array: Annotated[np.ndarray, "..."]) -> Annotated[np.ndarray, "..."]:
    """A read-only copy."""
    array = np.array(array, dtype=np.float64)
    array.flags.writeable = False
    return array


def read_only_value(value: Any) -> Any:
    """A float as it is, or a read-only copy of an array."""
    return value if isinstance(value, float) else read_only(value)


def keep(instance: Any, **values: Any) -> None:
    """Set fields of a frozen dataclass during construction."""
    for name, value in values.items():
        object.__setattr__(instance, name, value)


def of_kind(value: Any, kind: type | tuple[type, ...], where: Where, example: str) -> Any:
    """`value`, which must be an instance of `kind`."""
    if not isinstance(value, kind):
        raise where.fail(f"got {shown(value)}: give {example}.")
    return value


def table_of(value: Any, where: Where, example: str) -> dict[str, Any]:
    """The contents of a mapping whose keys are texts."""
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise where.fail(f"got {shown(value)}: give a dict, as in {example}.")
    return dict(value)


def all_of_kind(values: Any, kind: type | tuple[type, ...], where: Where, example: str) -> tuple[Any, ...]:
    """Every entry of a list or tuple, each an instance of `kind`."""
    single = isinstance(values, str | Mapping) or not isinstance(values, Iterable) or getattr(values, "ndim", 1) == 0
    if single or isinstance(values, kind):
        raise where.fail(f"got {shown(values)}: give a list, as in [{example}].")
    return tuple(of_kind(entry, kind, where.item(i + 1), example) for i, entry in enumerate(values))
