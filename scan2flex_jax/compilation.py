"""How the package's functions are compiled: XLA options that were measured to make the user wait less.

XLA's CPU fusion emitters spend 1.4 times the compile time on graphs of many small-matrix operations and run no faster
(`benchmarks/equilibrium.py` records both). Versions of XLA that do not know the option compile without it.
"""

from collections.abc import Callable
from functools import cache, wraps
from pathlib import Path
from typing import Any, TypeVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp

try:  # no public way to ask costs less than an operation, and that is a tenth of a warm solve
    from jax._src.core import trace_state_clean as _outside
except ImportError:

    def _outside() -> bool:
        return False


_Function = TypeVar("_Function", bound=Callable)
_OURS: list[Any] = []  # the jitted functions of the package
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


def _compiled_with(function: _Function, more: dict, in_parts: bool = False) -> _Function:
    jitted: dict[bool, Callable] = {}

    @wraps(function)
    def call(*args, **kwargs):
        top = _outside()
        if not top and (in_parts or isinstance(jnp.zeros(()), jax.core.Tracer)):  # inside jit every operation is traced
            return function(*args, **kwargs)
        if top not in jitted:  # an eager transformation (`jax.grad`) takes no compiler options
            options = {"compiler_options": _options() | more} if top else {}
            jitted[top] = eqx.filter_jit(function, **options)  # type: ignore[call-overload]  # jax.jit's, not declared
            _OURS.append(jitted[top])
        return jitted[top](*args, **kwargs)

    return cast(_Function, call)


def compiled(function: _Function) -> _Function:
    """`equinox.filter_jit` with the package's compiler options, chosen at the first call.

    Inside another compilation the function is part of that one; inside an eager `jax.grad`, `jax.vmap` and the like, which take
    no options, it is compiled without them.
    """
    return _compiled_with(function, {})


def composed(function: _Function) -> _Function:
    """The same for a function of compiled parts: an eager transformation meets the parts.

    So `jax.grad` of an equilibrium runs the solve that is compiled already, and compiles the rule of its derivative alone.
    """
    return _compiled_with(function, {}, in_parts=True)


def lightly_compiled(function: _Function) -> _Function:
    """`compiled` for functions that run in no time and only cost their compilation: without optimisation."""
    return _compiled_with(function, {"xla_backend_optimization_level": 0})


def make_room(full: float = _FULL) -> bool:
    """Forget what the package has compiled when the process holds more than ``full`` of the memory mappings it may have.

    Each compiled function holds some; beyond Linux's limit the next one crashes the process, after some sixty studies that are
    explained one after the other. Functions that others compiled stay. Whether anything was forgotten; elsewhere than on Linux
    nothing is known, and nothing done.
    """
    try:
        with _MAPPED.open("rb") as maps:
            room = sum(1 for _ in maps) < full * int(_LIMIT.read_text())
    except (OSError, ValueError):
        return False
    if room:
        return False
    for function in _OURS:
        function._cached.clear_cache()  # equinox has no public way; `jax.clear_caches` would clear the caller's functions too
    return True
