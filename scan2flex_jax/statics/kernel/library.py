"""Where the compiled solver lies, under which key, and whether it is there.

The key holds all that the library was made from: the package's files, the versions of JAX, the processor. After an update of
any of them the old library is not found, and solves fall back on JAX until it is built again. It lies with the compiled
functions of the program, in ``$SCAN2FLEX_CACHE`` or ``scan2flex`` under the user's cache folder. ``SCAN2FLEX_KERNEL=off``
switches it off.
"""

import ctypes
import hashlib
import os
import platform
from functools import cache
from importlib.metadata import version
from pathlib import Path

import jax

SWITCH, FOLDER = "SCAN2FLEX_KERNEL", "SCAN2FLEX_CACHE"
_FUNCTION, _PACKAGE = "scan2flex_settle", Path(__file__).parents[2]
_REGISTERED: set[str] = set()  # XLA refuses a second time
_SOURCES = ("geometry/*.py", "rod/*.py", "statics/newton.py", "statics/blocktridiagonal.py", "statics/kernel/*.*")


def key() -> str:
    """What a library has to be made from to fit this installation, as sixteen hexadecimal digits."""
    digest = hashlib.sha256(f"{jax.__version__} {version('jaxlib')} {platform.platform()} {_processor()}".encode())
    for pattern in _SOURCES:
        for path in sorted(_PACKAGE.glob(pattern)):
            digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def path() -> Path:
    """The file of the library, whether it is there or not."""
    given = os.environ.get(FOLDER, "off")
    cached = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "scan2flex"
    return (cached if given == "off" else Path(given)) / f"settle-{key()}.so"


def switched_off() -> bool:
    """Whether the user wants no compiled solver."""
    return os.environ.get(SWITCH) == "off"


@cache
def target() -> str | None:
    """The name of the custom call of the installed library; None without one. Decided once in a process."""
    if switched_off():
        return None
    try:
        file = path()
        return register(file) if file.exists() and ours(file) else None
    except (OSError, RuntimeError):  # no home, or a library of another system
        return None


def register(file: Path) -> str:
    """Load a library and register its function with XLA; the name of the custom call, which depends on the file's contents."""
    name = f"{_FUNCTION}_{hashlib.sha256(file.read_bytes()).hexdigest()[:16]}"
    if name not in _REGISTERED:
        function = getattr(ctypes.CDLL(str(file)), _FUNCTION)
        jax.ffi.register_ffi_target(name, jax.ffi.pycapsule(function), platform="cpu")
        _REGISTERED.add(name)
    return name


def ours(file: Path) -> bool:
    """Whether this user or the administrator wrote the file: it is machine code."""
    return not hasattr(os, "geteuid") or file.stat().st_uid in (0, os.geteuid())


def _processor():
    """The instructions that the processor knows: a library for another one may end the process."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    return next((x for x in lines if x.startswith(("flags", "Features"))), platform.processor())
