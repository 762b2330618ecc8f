"""Programs kept between processes: the functions of the package as they were traced, so that no later process traces them.

JAX's cache keeps what XLA compiles, but a process must trace and lower a function to find it there: two fifths of the processor
time of a command with a filled cache. Here the traced function (StableHLO, by `jax.export`) is kept by what tracing depends on:
the source of the package and the versions of its libraries; the compiled solver, if installed (`CUSTOM_CALLS`); the function
and its arguments: arrays by shape and type, all else by value. A function whose arguments hold anything defined elsewhere, such
as an effect of the user's own, is traced in each process. Programs are kept only where a process asks for it (`keep`, as the
command line does): a function of the package that is replaced at run time would not be noticed.
"""

import contextlib
import hashlib
import importlib.metadata
import io
import pickle
import sys
import zlib
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from importlib.machinery import SourceFileLoader
from pathlib import Path
from threading import Lock
from typing import Any, Protocol, runtime_checkable

import equinox as eqx
import jax
import numpy as np

_PACKAGE = __name__.partition(".")[0]
_LIBRARIES = ("jax", "jaxlib", "equinox", "lineax", "optimistix", "numpy")  # what a traced function may depend on
_KNOWN = {_PACKAGE, *_LIBRARIES, "builtins", "collections", "copyreg", "functools", "operator"}


@runtime_checkable
class Entries(Protocol):
    """Bytes by key, such as `cache.Entries`."""

    def get(self, key: str) -> bytes | None:
        """The value of a key; None without one."""

    def put(self, key: str, value: bytes) -> None:
        """Keep a value; it may be lost."""


@dataclass(frozen=True)
class _Shape:
    """An array in an argument or a result: all of it that a program depends on."""

    shape: tuple[int, ...]
    dtype: np.dtype
    weak: bool

    @classmethod
    def of(cls, array: Any) -> "_Shape":
        return cls(*_typed(array))

    def struct(self) -> jax.ShapeDtypeStruct:
        return jax.ShapeDtypeStruct(self.shape, self.dtype, weak_type=self.weak)


def _typed(array: Any) -> tuple[tuple[int, ...], np.dtype, bool]:
    """Shape and type of an array."""
    return array.shape, array.dtype, getattr(array, "weak_type", False)


class UnkeptError(Exception):
    """A program that cannot be kept."""


class _Pickler(pickle.Pickler):
    """Pickles values by content alone, and refuses what is not defined in the package or its libraries."""

    def __init__(self, file: io.BytesIO):
        super().__init__(file, protocol=5)
        self.fast = True  # without a memo: equal values give equal bytes

    def reducer_override(self, value: Any) -> Any:
        owner = value if hasattr(value, "__qualname__") else type(value)  # a class or function, or a value of one
        if str(owner.__module__).partition(".")[0] not in _KNOWN:
            raise UnkeptError
        return NotImplemented


def _pickled(value: Any) -> bytes:
    out = io.BytesIO()
    try:
        _Pickler(out).dump(value)
    except Exception as error:  # what cannot be pickled, such as a closure, or is contained in itself
        raise UnkeptError from error
    return out.getvalue()


def version() -> bytes | None:
    """Digest of the package's source, the versions of its libraries and of Python; None for a package that is not loaded from
    source as it stands (by an import hook that instruments it, from an archive)."""
    spec = sys.modules[_PACKAGE].__spec__
    if spec is None or type(spec.loader) is not SourceFileLoader or spec.origin is None:
        return None
    digest, root = hashlib.sha256(), Path(spec.origin).parent
    for file in sorted(root.rglob("*.py")):
        digest.update(str(file.relative_to(root)).encode() + b"\0" + file.read_bytes() + b"\0")
    versions = [(name, importlib.metadata.version(name)) for name in _LIBRARIES]
    digest.update(repr((versions, sys.version)).encode())
    return digest.digest()


class Programs:
    """Compiled functions by key, loaded from `Entries` where they are kept there."""

    def __init__(self, entries: Entries, version: bytes):
        """``version``: digest of all that is common to the programs."""
        self._entries, self._version = entries, version
        self._loaded: dict[Any, _Run | None] = {}  # None: not to be kept
        self._locks: dict[Any, Lock] = defaultdict(Lock)

    def call(self, function: Callable, options: dict, args: tuple, kwargs: dict) -> Any:
        """What ``function`` returns, by its program compiled with ``options``; `UnkeptError` if it cannot be kept."""
        leaves, tree = jax.tree.flatten((args, kwargs))
        is_array = [eqx.is_array(leaf) for leaf in leaves]
        arrays = [leaf for leaf, array in zip(leaves, is_array, strict=True) if array]
        known = (function, tree, *(_typed(leaf) if array else leaf for leaf, array in zip(leaves, is_array, strict=True)))
        if known not in self._loaded:
            with self._locks[known]:  # another thread may be compiling it
                if known not in self._loaded:
                    run = self._found(function, options, tree, leaves)
                    result = None if run is None else run(arrays)
                    self._loaded[known] = run
                    if run is not None:
                        return result
        run = self._loaded[known]
        if run is None:
            raise UnkeptError
        return run(arrays)

    def forget(self) -> None:
        """Release the programs of this process; those kept stay."""
        for run in filter(None, self._loaded.values()):
            run.jitted.clear_cache()
        self._loaded.clear()

    def _found(self, function: Callable, options: dict, tree: Any, leaves: list) -> "_Run | None":
        """The program that is kept, or else the function traced, and kept; None if it cannot be kept."""
        shapes = [_Shape.of(leaf) if eqx.is_array(leaf) else leaf for leaf in leaves]
        try:
            key = f"program-{function.__name__}-{self._digest(function, tree, shapes)}"
            data = self._entries.get(key)
            program, result = _traced(function, tree, shapes) if data is None else pickle.loads(zlib.decompress(data))
        except UnkeptError:
            return None
        if data is None:
            self._entries.put(key, zlib.compress(pickle.dumps((program, result))))
        return _Run(program, result, function.__name__, options)

    def _digest(self, function: Callable, tree: Any, shapes: list) -> str:
        ours = function.__module__.partition(".")[0] == _PACKAGE
        if not ours or "<" in function.__qualname__ or hasattr(function, "__self__"):  # the values of a closure are unknown
            raise UnkeptError
        what = _pickled((function.__module__, function.__qualname__, jax.tree.unflatten(tree, shapes)))
        return hashlib.sha256(self._version + _context() + what).hexdigest()


def _traced(function: Callable, tree: Any, shapes: list) -> tuple[bytes, Any]:
    """The function of the arrays among its arguments, exported, and its result with `_Shape` for every array."""
    results: list[Any] = []

    def flat(*arrays):
        given = iter(arrays)
        args, kwargs = jax.tree.unflatten(tree, [next(given) if isinstance(leaf, _Shape) else leaf for leaf in shapes])
        result = function(*args, **kwargs)
        results.append(jax.tree.map(lambda leaf: _Shape.of(leaf) if eqx.is_array(leaf) else leaf, result))
        return [leaf for leaf in jax.tree.leaves(result) if eqx.is_array(leaf)]

    flat.__name__ = flat.__qualname__ = function.__name__
    allowed = [jax.export.DisabledSafetyCheck.custom_call(name) for name in _custom_calls()]
    try:
        exporting = jax.export.export(jax.jit(flat), disabled_checks=allowed)
        exported = exporting(*(leaf.struct() for leaf in shapes if isinstance(leaf, _Shape)))
        return bytes(exported.serialize()), results[-1]
    except Exception as error:  # a call that only this process knows, of Python or a library; or a mistake, made again without
        raise UnkeptError from error


class _Run:
    """An exported function, called with the list of its arrays."""

    def __init__(self, traced: bytes, result: Any, name: str, options: dict):
        exported = jax.export.deserialize(bytearray(traced))

        def flat(*arrays):
            return exported.call(*arrays)

        flat.__name__ = flat.__qualname__ = name
        # JAX binds results of exported functions to their device: unless it is named, arguments bound and not compile twice
        here = jax.sharding.SingleDeviceSharding(jax.devices()[0])
        self.jitted: Any = jax.jit(flat, in_shardings=here, compiler_options=options)
        leaves, tree = jax.tree.flatten(result)
        self._tree: Any = tree
        self._rest = [None if isinstance(leaf, _Shape) else (leaf,) for leaf in leaves]

    def __call__(self, arrays: list) -> Any:
        values = iter(self.jitted(*arrays))
        return self._tree.unflatten([next(values) if rest is None else rest[0] for rest in self._rest])


def _context() -> bytes:
    """What JAX traces for."""
    if jax.default_backend() != "cpu" or getattr(jax.config, "jax_disable_jit"):  # noqa: B009 - unknown to type checkers
        raise UnkeptError
    settings = [getattr(jax.config, name) for name in ("jax_enable_x64", "jax_default_matmul_precision")]
    return repr(settings + _custom_calls()).encode()


CUSTOM_CALLS: list[Callable[[], str | None]] = []
"""Custom calls of XLA that functions of the package may contain: each is registered and named; None if it is not installed."""


def _custom_calls() -> list[str]:
    return [name for name in (call() for call in CUSTOM_CALLS) if name is not None]


_programs: Programs | None = None


def keep(entries: Entries) -> None:
    """Keep the programs of `compilation.compiled` functions in ``entries`` from now on, in this process."""
    global _programs  # noqa: PLW0603 - one storage for a process
    own = version()
    _programs = None if own is None else Programs(entries, own)


def forget() -> None:
    """Release the programs that this process holds."""
    if _programs is not None:
        _programs.forget()


def call(function: Callable, options: dict, otherwise: Callable, args: tuple, kwargs: dict) -> Any:
    """What ``function`` returns: by its kept program, or by ``otherwise`` where programs are not kept, or not this one."""
    if _programs is not None:
        with contextlib.suppress(UnkeptError):
            return _programs.call(function, options, args, kwargs)
    return otherwise(*args, **kwargs)
