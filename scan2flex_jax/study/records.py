"""Base of a study's records: fields checked by the keys of the format, equality by content, and immutable contents.

A frozen dataclass whose arrays and dicts refuse changes stays as checked; `dataclasses.replace` makes a changed copy,
which is checked again.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Annotated, Any, ClassVar, NoReturn, TypeVar, dataclass_transform, no_type_check

import numpy as np

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.study.kinds import ParameterFormat
from scan2flex_jax.study.values import Where, all_of_kind, of_kind, shown

_Record = TypeVar("_Record", bound="Record")


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def record(cls: type[_Record]) -> type[_Record]:
    """A frozen dataclass whose `__post_init__` takes any values, and rejects unusable ones with a sentence.

    Its annotations hold after conversion; a runtime check of the constructor's arguments against them would come too early."""
    made = dataclass(frozen=True, eq=False)(cls)
    no_type_check(made.__init__)
    return made


class Record:
    """A part of a study: `KEYS` check the fields of their names, `PARTS` are the classes of fields that are records (in a
    tuple: lists of records), and `AS` says how one is made. The reader and the writer work by them too."""

    KEYS: ClassVar[Mapping[str, ParameterFormat]] = {}
    PARTS: ClassVar[Mapping[str, type["Record"] | tuple[type["Record"]]]] = {}
    AS: ClassVar[str]
    __hash__ = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        """Check each field on its own, and keep read-only copies; then check them together."""
        where = Where(type(self).__name__)
        for one in fields(self):  # type: ignore[arg-type]
            value, here = getattr(self, one.name), where.at(one.name)
            if value is None and one.default is None:
                continue
            part = self.PARTS.get(one.name)
            if isinstance(part, tuple):
                keep(self, **{one.name: all_of_kind(value, part, here, part[0].AS)})
            elif part is not None:
                of_kind(value, part, here, part.AS)
            elif one.name in self.KEYS:
                keep(self, **{one.name: self.KEYS[one.name].take(value, here)})
            if one.name in ("name", "kind"):
                where = Where(f"{type(self).__name__} {shown(value)}")
        self._check(where)

    def _check(self, where: Where) -> None:
        """Check what its keys do not say."""

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
        return type(a) is type(b) and np.shape(a) == np.shape(b) and bool(np.array_equal(a, b, equal_nan=True))
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


def keep(instance: Any, **values: Any) -> None:
    """Set fields of a frozen dataclass during construction, to read-only copies of arrays and dicts."""
    for name, value in values.items():
        object.__setattr__(instance, name, _read_only(value))


def _read_only(value: Any) -> Any:
    if isinstance(value, dict):
        return ReadOnly({name: _read_only(entry) for name, entry in value.items()})
    if not isinstance(value, np.ndarray):
        return value
    array: Annotated[np.ndarray, "..."] = np.array(value, dtype=np.float64)
    array.flags.writeable = False
    return array
