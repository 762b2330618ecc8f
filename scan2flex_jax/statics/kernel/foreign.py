"""A function of Python as a custom call of XLA: what its interface in C (`xla/ffi/api/c_api.h`) passes to a handler.

No compiler is needed: the structures are read with `ctypes`. In newer versions of XLA they only grow at their ends.
"""

import ctypes
from collections.abc import Callable
from typing import NamedTuple

import jax

_INTERNAL = 13  # XLA_FFI_Error_Code_INTERNAL
_ERROR_CREATE, _STREAM_GET = 0, 4  # places among the functions of the interface
_Pointer, _Size = ctypes.c_void_p, ctypes.c_size_t
_KEPT: list = []  # XLA calls these for the rest of the process


def _structure(name: str, *fields: tuple) -> type[ctypes.Structure]:
    """A structure with the head that all have."""
    head = (("struct_size", _Size), ("extension", _Pointer))
    return type(name, (ctypes.Structure,), {"_fields_": [*head, *fields]})


_Version = _structure("_Version", ("major", ctypes.c_int), ("minor", ctypes.c_int))
_Api = _structure("_Api", ("version", _Version), ("internal", _Pointer), ("functions", _Pointer * (_STREAM_GET + 1)))
_Buffer = _structure(
    "_Buffer", ("dtype", ctypes.c_int), ("data", _Pointer), ("rank", ctypes.c_int64), ("dims", ctypes.POINTER(ctypes.c_int64))
)
_Buffers = _structure(
    "_Buffers", ("size", ctypes.c_int64), ("types", _Pointer), ("all", ctypes.POINTER(ctypes.POINTER(_Buffer)))
)
_Frame = _structure(
    "_Frame", ("api", ctypes.POINTER(_Api)), ("context", _Pointer), ("stage", ctypes.c_int), ("given", _Buffers),
    ("results", _Buffers),
)  # fmt: skip
_Error = _structure("_Error", ("message", ctypes.c_char_p), ("code", ctypes.c_int))
_Stream = _structure("_Stream", ("context", _Pointer), ("stream", _Pointer))


class _Metadata(ctypes.Structure):
    _fields_ = (("struct_size", _Size), ("version", _Version), ("traits", ctypes.c_uint32), ("state", ctypes.c_int64))


class _Extension(ctypes.Structure):
    _fields_ = (("struct_size", _Size), ("type", ctypes.c_int), ("next", _Pointer), ("metadata", ctypes.POINTER(_Metadata)))


class Array(NamedTuple):
    """An array of a call: its address, on the device, and its shape."""

    address: int
    shape: tuple[int, ...]


class Call(NamedTuple):
    """Arguments and results of a call, and the stream (of CUDA) on which it is expected."""

    arrays: list[Array]
    stream: Callable[[], int]


def register(name: str, function: Callable[[Call], None], platform: str) -> None:
    """Make ``function`` the custom call ``name`` on a platform; its exceptions become errors of the computation."""

    def handle(frame):
        call = frame.contents
        if call.extension:  # XLA asks for the version only, once
            metadata, own = _Extension.from_address(call.extension).metadata.contents, call.api.contents.version
            metadata.version.major, metadata.version.minor, metadata.traits = own.major, own.minor, 0
            if metadata.struct_size >= ctypes.sizeof(_Metadata):
                metadata.state = 0
            return None
        try:
            function(Call([*_arrays(call.given), *_arrays(call.results)], lambda: _stream(call)))
        except Exception as error:
            return _failed(call, f"{type(error).__name__}: {error}")
        return None

    kept = ctypes.CFUNCTYPE(_Pointer, ctypes.POINTER(_Frame))(handle)
    _KEPT.append(kept)
    jax.ffi.register_ffi_target(name, jax.ffi.pycapsule(kept), platform=platform)


def _arrays(buffers):
    for i in range(buffers.size):
        b = buffers.all[i].contents
        yield Array(b.data or 0, tuple(b.dims[: b.rank]))


def _function(call, place):
    return ctypes.CFUNCTYPE(_Pointer, _Pointer)(call.api.contents.functions[place])


def _stream(call):
    asked = _Stream(ctypes.sizeof(_Stream), None, call.context, None)
    if _function(call, _STREAM_GET)(ctypes.addressof(asked)):
        raise RuntimeError("XLA has no stream for this call")
    return asked.stream or 0


def _failed(call, message):
    error = _Error(ctypes.sizeof(_Error), None, message.encode(), _INTERNAL)
    return _function(call, _ERROR_CREATE)(ctypes.addressof(error))
