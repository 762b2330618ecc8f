"""Checks of a solve's arguments before compilation: one sentence in place of a failure inside a trace."""

import operator
from typing import Any

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.rod.model import Configuration
from scan2flex_jax.rod.reals import reals


def check_start(start: Any, nodes: int, turns: Any) -> None:
    """Raise `Scan2FlexError` unless start is a configuration of ``nodes`` nodes (or None) and turns is a number."""
    reals(turns, "turns", ())
    if start is None:
        return
    if not isinstance(start, Configuration):
        raise Scan2FlexError(f"start is {type(start).__name__}: give a Configuration, as another equilibrium has it, or None.")
    reals(start.r, "the positions of start", (nodes, 3))
    reals(start.R, "the rotations of start", (nodes, 3, 3))


def whole_number(value: Any, name: str, least: int = 1) -> int:
    """A whole number (numpy's included) of at least ``least``; raises `Scan2FlexError`."""
    try:
        number = least - 1 if isinstance(value, bool) else operator.index(value)
    except TypeError:
        number = least - 1
    if number < least:
        shown = " ".join(repr(value).split())[:60]
        raise Scan2FlexError(f"{name} is {shown}: give a whole number of at least {least}.")
    return number
