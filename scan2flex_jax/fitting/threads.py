"""One BLAS thread: for matrices of some 70 rows, several threads are slower than one."""

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

_Arguments = ParamSpec("_Arguments")
_Answer = TypeVar("_Answer")


def on_one_blas_thread(function: Callable[_Arguments, _Answer]) -> Callable[_Arguments, _Answer]:
    """The function with BLAS limited to one thread while it runs (`threadpoolctl` declares no types: its own decorator would
    hide the signature from type checkers)."""

    @wraps(function)
    def call(*args: _Arguments.args, **kwargs: _Arguments.kwargs) -> _Answer:
        with threadpool_limits(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return call
