"""Compilation of the package's functions: XLA options measured to shorten the user's wait.

XLA's CPU fusion emitters take 1.4 times the compile time on graphs of many small-matrix operations, which run no faster
(jax 0.10.1). Versions of XLA without the option compile without it.
"""

from collections.abc import Callable
from functools import cache, wraps
from pathlib import Path
from typing import Any, TypeVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp

from scan2flex_jax import programs

try:
    from jax.extend.core import get_opaque_trace_state as _trace
except ImportError:  # before jax 0.10
    from jax.core import get_opaque_trace_state as _trace

with jax.ensure_compile_time_eval():
    _OUTSIDE = _trace()  # of any transformation

_Function = TypeVar("_Function", bound=Callable)
_OURS: list[Any] = []  # the jitted functions of the package
_MAPPED, _LIMIT = Path("/proc/self/maps"), Path("/proc/sys/vm/max_map_count")
_FULL = 0.5  # of the memory mappings that Linux grants a process: the rest is ample for one diagnosis

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
        top = _trace() == _OUTSIDE
        if not top and (in_parts or isinstance(jnp.zeros(()), jax.core.Tracer)):  # inside jit every operation is traced
            return function(*args, **kwargs)
        options = _options() | more if top else {}  # an eager transformation (`jax.grad`) takes no compiler options
        if top not in jitted:
            jitted[top] = eqx.filter_jit(function, compiler_options=options)  # type: ignore[call-overload]  # jax.jit's, not declared
            _OURS.append(jitted[top])
        return programs.call(function, options, jitted[top], args, kwargs) if top else jitted[top](*args, **kwargs)

    return cast(_Function, call)


def compiled(function: _Function) -> _Function:
    """`equinox.filter_jit` with the package's compiler options, chosen at the first call.

    Inside another compilation the function becomes part of it. An eager `jax.grad`, `jax.vmap` or similar takes no options, and
    compiles it without them.
    """
    return _compiled_with(function, {})


def composed(function: _Function) -> _Function:
    """`compiled` for a function made of compiled parts: an eager transformation sees the parts.

    Thus `jax.grad` of an equilibrium runs the already compiled solve, and compiles only its derivative rule.
    """
    return _compiled_with(function, {}, in_parts=True)


def lightly_compiled(function: _Function) -> _Function:
    """`compiled` without optimisation, for functions whose run time is negligible against their compilation."""
    return _compiled_with(function, {"xla_backend_optimization_level": 0})


def make_room(full: float = _FULL) -> bool:
    """Clear the package's compilation caches when the process uses more than ``full`` of vm.max_map_count.

    Every compiled function holds some memory mappings; above the limit of Linux the next one crashes the process, after about
    sixty diagnoses of studies in a row. Functions compiled by others are kept. Returns whether anything was cleared; on other
    systems the usage is unknown, and nothing is cleared.
    """
    try:
        with _MAPPED.open("rb") as maps:
            room = sum(1 for _ in maps) < full * int(_LIMIT.read_text())
    except (OSError, ValueError):
        return False
    if room:
        return False
    for function in _OURS:
        # `jax.clear_caches` would clear the caller's too, and a `jax.jit` of our own would lose the sentences of `eqx.error_if`
        function._cached.clear_cache()
    programs.forget()
    return True
