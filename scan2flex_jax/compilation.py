"""How the package's functions are compiled: XLA options that were measured to make the user wait less.

XLA's CPU fusion emitters spend 1.4 times the compile time on graphs of many small-matrix operations and run no faster
(`benchmarks/equilibrium.py` records both). Versions of XLA that do not know the option compile without it.
"""

from functools import cache
from pathlib import Path
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp

try:  # no public way to ask costs less than an operation, and that is a tenth of a warm solve
    from jax._src.core import trace_state_clean as _outside
except ImportError:

    def _outside() -> bool:
        return False


_MAPPED, _LIMIT = Path("/proc/self/maps"), Path("/proc/sys/vm/max_map_count")
_FULL = 0.5  # of the memory mappings that Linux grants a process: what is left is ample for one diagnosis

_OPTIONS = {"xla_cpu_use_fusion_emitters": False}


@cache
def _options() -> dict:
    if jax.default_backend() != "cpu":
        return {}
    try:
        jax.jit(lambda x: x + 1, compiler_options=_OPTIONS)(jnp.zeros(()))
    except Exception:
        return {}
    return _OPTIONS


class compiled:  # noqa: N801 - used as a decorator
    """`equinox.filter_jit` with the package's compiler options, chosen at the first call."""

    _more: ClassVar[dict] = {}

    def __init__(self, function):
        """Nothing is compiled or configured yet."""
        self.function, self.jitted = function, None
        self.__doc__, self.__name__, self.__wrapped__ = function.__doc__, function.__name__, function

    def __call__(self, *args, **kwargs):
        """Call the compiled function; inside another compilation it is part of that one."""
        if not _outside() and isinstance(jnp.zeros(()), jax.core.Tracer):  # inside jit every operation is traced
            return self.function(*args, **kwargs)
        if self.jitted is None:
            options = {"compiler_options": _options() | self._more}
            self.jitted = eqx.filter_jit(self.function, **options)  # type: ignore[call-overload]  # jax.jit's, not declared
        return self.jitted(*args, **kwargs)


class lightly_compiled(compiled):  # noqa: N801 - used as a decorator
    """The same for functions that run in no time and only cost their compilation: without optimisation."""

    _more: ClassVar[dict] = {"xla_backend_optimization_level": 0}


def make_room(full: float = _FULL) -> bool:
    """Forget all compiled functions of the process when they hold more than ``full`` of the memory mappings that it may have.

    Each compiled function holds some; beyond Linux's limit the next one crashes the process, after some sixty studies that
    are explained one after the other. Whether they were forgotten; elsewhere than on Linux nothing is known, and nothing done.
    """
    try:
        with _MAPPED.open("rb") as maps:
            room = sum(1 for _ in maps) < full * int(_LIMIT.read_text())
    except (OSError, ValueError):
        return False
    if not room:
        jax.clear_caches()
    return not room
