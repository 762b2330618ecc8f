"""The identity of a sweep: a fingerprint of all inputs of its numbers, so that a store is never continued as another sweep.

A key given by the caller with a hash of the arrays could not do this. The scene of `equilibria`, the change of `fits`, the
function of a task and its quantities are the caller's own code, most often a cell of a notebook. If the caller edits that code,
or a number from its closure or module, and runs the same line again, the key is unchanged: some samples of the store would
belong to one model and the rest to another, without a trace. So `digest` follows functions too: their instructions,
constants and defaults, and the values they refer to, through containers and dataclasses to the arrays.
A file named by a `Path` is hashed by content, a library by version.

Not covered: anything a function reads at run time, such as a file opened by name. Another version of Python compiles
other instructions, but the version of Python is part of the definition anyway.
"""

import dis
import functools
import hashlib
import importlib.metadata
import platform
import sys
import types
from dataclasses import fields, is_dataclass
from pathlib import Path

import jax
import numpy as np

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.version import __version__

LIBRARIES = ("jax", "jaxlib", "equinox", "optimistix", "numpy", "scipy")
_COUNTED_BY_VERSION = {"scan2flex_jax", "jaxtyping", *LIBRARIES, *sys.stdlib_module_names} - {"__main__"}
_PLAIN = (type(None), bool, int, float, complex, str, bytes)
_COMPUTING = ("geometry", "rod", "effects", "statics", "study", "scan", "fitting", "sweep")


def versions() -> dict[str, str]:
    """Versions of the computing parts: this package with its sources, the libraries, the interpreter and the kind of device."""
    own = f"{__version__}+{_sources()}"
    libraries = {name: importlib.metadata.version(name) for name in LIBRARIES}
    python = ".".join(platform.python_version_tuple()[:2])
    return {"scan2flex_jax": own, **libraries, "python": python, "device": jax.default_backend()}


@functools.cache
def _sources() -> str:
    """A hash of the sources of this package that compute, since a checkout changes under one version number."""
    folder, h = Path(__file__).parents[1], hashlib.sha256()
    for part in _COMPUTING:
        for path in sorted((folder / part).rglob("*.py")):
            h.update(path.relative_to(folder).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return h.hexdigest()[:12]


def digest(thing) -> str:
    """A fingerprint of ``thing``, the same in every process; raises `Scan2FlexError` for an opaque object."""
    h = hashlib.sha256()
    for piece in _pieces(thing, ()):
        h.update(piece if isinstance(piece, bytes) else piece.encode())
        h.update(b"\0")
    return h.hexdigest()[:16]


def _pieces(x, seen):
    """Bytes and texts that identify ``x``; ``seen`` holds the objects already visited."""
    if id(x) in seen:
        yield "again"
        return
    seen = (*seen, id(x))
    if isinstance(x, dict):
        yield f"dict:{len(x)}"
        for key in sorted(x, key=repr):
            yield from _pieces(key, seen)
            yield from _pieces(x[key], seen)
    elif isinstance(x, list | tuple):
        yield f"list:{len(x)}"
        for item in x:
            yield from _pieces(item, seen)
    elif is_dataclass(x) and not isinstance(x, type):
        yield f"object:{type(x).__qualname__}"
        for f in (f for f in fields(x) if f.compare):
            yield f.name
            yield from _pieces(getattr(x, f.name), seen)
    else:
        leaf = _leaf(x)
        yield from _callable_pieces(x, seen) if leaf is None else leaf


def _leaf(x) -> list | None:
    """The pieces of an object without members, or None."""
    if isinstance(x, _PLAIN):
        return [f"{type(x).__name__}:{x!r}"]
    if isinstance(x, np.ndarray | np.generic | jax.Array):
        array = np.ascontiguousarray(x)
        return [f"array:{array.dtype}:{np.shape(x)}", array.tobytes()]
    if isinstance(x, set | frozenset):
        return ["set:" + ",".join(sorted(digest(item) for item in x))]
    if isinstance(x, Path):
        return ["file:" + (hashlib.sha256(x.read_bytes()).hexdigest() if x.is_file() else x.name)]
    if isinstance(x, types.ModuleType):
        return [f"module:{x.__name__}"]
    return None


def _callable_pieces(x, seen):
    if isinstance(x, functools.partial):
        yield from _pieces(("partial", x.func, x.args, x.keywords), seen)
    elif isinstance(x, types.MethodType):
        yield from _pieces(("method", x.__func__, x.__self__), seen)
    elif (getattr(x, "__module__", None) or "").partition(".")[0] in _COUNTED_BY_VERSION and hasattr(x, "__qualname__"):
        yield f"named:{x.__module__}.{x.__qualname__}"
    elif isinstance(x, types.FunctionType):
        yield from _function_pieces(x, seen)
    elif isinstance(x, type | types.BuiltinFunctionType):
        yield f"named:{x.__module__}.{x.__qualname__}"
    elif callable(x) and hasattr(x, "__wrapped__"):
        yield from _pieces(x.__wrapped__, seen)
    else:
        what = type(x).__qualname__
        raise Scan2FlexError(f"a stored sweep cannot identify the content of a {what}: pass it as numbers or as a dataclass")


def _function_pieces(f, seen):
    """Instructions and constants of a function, its defaults, and the values from its closure and its module."""
    yield from _code_pieces(f.__code__, seen)
    yield from _pieces((f.__defaults__, f.__kwdefaults__), seen)
    for cell in f.__closure__ or ():
        yield from _pieces(cell.cell_contents, seen)
    for name in sorted(_names(f.__code__) & f.__globals__.keys()):
        yield name
        yield from _pieces(f.__globals__[name], seen)


def _code_pieces(code, seen):
    yield code.co_code
    yield ",".join(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _code_pieces(constant, seen)
        else:
            yield from _pieces(constant, seen)


def _names(code) -> set[str]:
    """Names that a function and its inner functions may look up."""
    own = {i.argval for i in dis.get_instructions(code) if i.opname in ("LOAD_GLOBAL", "LOAD_NAME")}
    return own.union(*(_names(c) for c in code.co_consts if isinstance(c, types.CodeType)))
