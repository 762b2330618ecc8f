"""Limits of measured files, in points and in bytes: a file beyond them is never read completely, and cannot fill the memory.

For more points, set ``SCAN2FLEX_MAX_POINTS``, which applies to scans and to curves.
"""

import os
from dataclasses import dataclass
from pathlib import Path

from scan2flex_jax.errors import Scan2FlexError, StudyError

VARIABLE = "SCAN2FLEX_MAX_POINTS"
SCAN_POINTS, CURVE_POINTS = 5_000_000, 1_000_000
BYTES_OF_A_POINT = 100  # a line of text with position, normal and colour; binary formats take a quarter of it
_HEADER = 1_000_000


@dataclass(frozen=True)
class Limit:
    """Largest number of points."""

    points: int

    @property
    def bytes(self) -> int:
        """Largest size of that many points, uncompressed, with a header."""
        return BYTES_OF_A_POINT * self.points + _HEADER

    @property
    def advice(self) -> str:
        """Advice for a larger file."""
        return f"thin it out, or set {VARIABLE} to more points."

    def sentence(self, content: str) -> str:
        """Message for a file of more ``content``, as in "9000000 points"."""
        most = f"{self.points} points ({self.bytes // 1_000_000} MB)"
        return f"it holds {content}, and at most {most} are read: {self.advice}"

    def check(self, path: Path, count: int, noun: str = "points") -> int:
        """``count``, which must be within the limit; raises `StudyError`."""
        if count > self.points:
            raise StudyError(path, None, self.sentence(f"{count} {noun}"))
        return count

    def check_bytes(self, path: Path, size: int) -> None:
        """Raise `StudyError` for a content of more bytes."""
        if size > self.bytes:
            raise StudyError(path, None, self.sentence(f"{size // 1_000_000} MB or more"))


def scan_limit(most: int = SCAN_POINTS) -> Limit:
    """The limit of a scan."""
    given = os.environ.get(VARIABLE, "").strip()
    if not given:
        return Limit(most)
    if not (given.isascii() and given.isdecimal() and 0 < int(given[:16]) < 10**12):
        raise Scan2FlexError(f"{VARIABLE} is {given[:40]!r}: set it to a whole number of points, as in {2 * SCAN_POINTS}.")
    return Limit(int(given))


def curve_limit() -> Limit:
    """The limit of a curve, and of every other table."""
    return scan_limit(CURVE_POINTS)
