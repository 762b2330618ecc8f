"""Threads within one call: BLAS on one, poses on one for each core.

BLAS is slower on several threads than on one for matrices of some 70 rows. Poses are independent, and XLA runs outside of
Python's lock: on two cores six poses take 0.6 of the time. The threads end with the call that began them.
"""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import ParamSpec, TypeVar

import jax
from threadpoolctl import threadpool_limits

_Arguments = ParamSpec("_Arguments")
_Answer = TypeVar("_Answer")
_POOL: ContextVar[ThreadPoolExecutor | None] = ContextVar("pool of threads for poses", default=None)
_MOST = 8  # threads: beyond, the part under Python's lock takes over


def threaded(function: Callable[_Arguments, _Answer]) -> Callable[_Arguments, _Answer]:
    """The function with BLAS on one thread, and `each_pose` on several, while it runs.

    A function so decorated may call another one: they share the threads. (`threadpoolctl` declares no types: its own decorator
    would hide the signature from type checkers.)
    """

    @wraps(function)
    def call(*args: _Arguments.args, **kwargs: _Arguments.kwargs) -> _Answer:
        with threadpool_limits(limits=1, user_api="blas"), _threads():
            return function(*args, **kwargs)

    return call


def each_pose(work: Callable[[int], _Answer], count: int) -> list[_Answer]:
    """``work(i)`` of the poses 0 to ``count`` - 1, in their order; on threads within a `threaded` call.

    The results do not depend on the threads. The first exception is raised. ``work`` must not change what other poses read.
    """
    pool = _POOL.get()
    if pool is None or count < 2:
        return [work(i) for i in range(count)]
    return list(pool.map(work, range(count)))


@contextmanager
def _threads() -> Iterator[None]:
    count = min(_cores(), _MOST)
    if _POOL.get() is not None or count < 2:
        yield
        return
    with ThreadPoolExecutor(count, "pose", _settings_of_caller, _caller()) as pool:
        before = _POOL.set(pool)
        try:
            yield
        finally:
            _POOL.reset(before)


def _caller() -> tuple:
    """JAX's settings that a caller may have chosen for this thread alone (`with jax.enable_x64(True):`)."""
    return jax.config.jax_enable_x64, jax.config.jax_default_device  # type: ignore[attr-defined]  # made at import


def _settings_of_caller(precise: bool, device: object) -> None:
    """Settings of a new thread, for as long as it lives."""
    jax.enable_x64(precise).__enter__()
    jax.default_device(device).__enter__()


def _cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
