"""Text of a study in special contexts: file names, terminals, figures.

A pose may have any name. As a file name it stays inside its folder, is valid on every system, and differs from that of
every other pose; on a terminal it contains no control characters; in a figure it is not parsed as a formula.
"""

import unicodedata
from collections.abc import Iterable

LONGEST = 100
"""Bytes of a file's stem: file systems allow 255, which include extensions and the names of copies."""
LONGEST_DRAWN = 300
"""Characters of a title; the layout time of a figure grows with each."""
_RESERVED = {"con", "prn", "aux", "nul", "conin$", "conout$"} | {f"{port}{i}" for port in ("com", "lpt") for i in range(10)}
_SEPARATING = set('/\\:*?"<>|')


def printable(text: str, keep: str = "\n\t") -> str:
    """``text`` for a terminal: control characters, changes of direction and lone surrogates are escaped."""
    return "".join(c if c.isprintable() or c in keep else ascii(c)[1:-1] for c in text)


def drawn(text: str) -> str:
    """``text`` for matplotlib, which must not parse it as a formula or a hidden label, nor draw it for minutes."""
    text = text if len(text) <= LONGEST_DRAWN else f"{text[:LONGEST_DRAWN]}..."
    return (" " if text.startswith("_") else "") + printable(text, keep="\n").replace("$", r"\$")


def file_stem(name: str) -> str:
    """``name`` as the stem of a file; a name that is valid on every system is unchanged."""
    text = unicodedata.normalize("NFC", name)
    stem = "".join(c if c.isprintable() and c not in _SEPARATING else "-" for c in text)
    stem = stem.strip(" .").lstrip("- .~")  # no dot or blank at either end, no hyphen that makes it an option of a command
    stem = stem.encode()[:LONGEST].decode(errors="ignore").rstrip(" .")
    if not any(c.isalnum() for c in stem):
        return "pose"
    first = unicodedata.normalize("NFKC", stem.split(".")[0]).strip().casefold()
    return f"pose-{stem}" if first in _RESERVED else stem


def file_stems(names: Iterable[str], endings: tuple[str, ...]) -> dict[str, str]:
    """A stem for each name, such that no two of the files STEM + ending coincide, on case-insensitive systems either."""
    taken: set[str] = set()
    stems: dict[str, str] = {}
    for name in names:
        stem = first = file_stem(name)
        number = 1
        while taken & (files := {_key(stem + ending) for ending in endings}):
            number += 1
            stem = f"{first}-{number}"
        taken |= files
        stems[name] = stem
    return stems


def _key(file: str) -> str:
    """A key that is equal for two names of one file on some system."""
    return unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", file).casefold())
