"""Text of a study where others take it for something else: as names of files, on a terminal, in a picture.

A pose may be called anything. As a file it stays inside its folder, is a name on every system, and is not that of another
pose; on a terminal it moves no cursor and rings no bell; in a picture it is no formula.
"""

import unicodedata
from collections.abc import Iterable

LONGEST = 100
"""Bytes of a file's stem: file systems take 255, and endings and the names of copies come on top."""
LONGEST_DRAWN = 300
"""Characters of a title; the layout of a figure takes longer with every one."""
_RESERVED = {"con", "prn", "aux", "nul", "conin$", "conout$"} | {f"{port}{i}" for port in ("com", "lpt") for i in range(10)}
_SEPARATING = set('/\\:*?"<>|')


def printable(text: str, keep: str = "\n\t") -> str:
    """``text`` for a terminal: control characters, changes of direction and lone surrogates are written out as escapes."""
    return "".join(c if c.isprintable() or c in keep else ascii(c)[1:-1] for c in text)


def drawn(text: str) -> str:
    """``text`` for matplotlib, which must not take it for a formula, nor for a label to hide, nor draw it for minutes."""
    text = text if len(text) <= LONGEST_DRAWN else f"{text[:LONGEST_DRAWN]}..."
    return (" " if text.startswith("_") else "") + printable(text, keep="\n").replace("$", r"\$")


def file_stem(name: str) -> str:
    """``name`` as the stem of a file; one that is a file name on every system stays as it is."""
    text = unicodedata.normalize("NFC", name)
    stem = _cut("".join(c if c.isprintable() and c not in _SEPARATING else "-" for c in text))
    if not any(c.isalnum() for c in stem):
        return "pose"
    first = unicodedata.normalize("NFKC", stem.split(".")[0]).strip().casefold()
    return f"pose-{stem}" if first in _RESERVED else stem


def _cut(stem: str) -> str:
    """No dot or blank at either end, no hyphen in front, where it would be an option of a command; not too long."""
    stem = stem.strip(" .").lstrip("- .~")
    return stem.encode()[:LONGEST].decode(errors="ignore").rstrip(" .")


def file_stems(names: Iterable[str], endings: tuple[str, ...]) -> dict[str, str]:
    """A stem for each name, so that no two of the files STEM + ending are one, on systems that know no case either."""
    taken: set[str] = set()
    stems: dict[str, str] = {}
    for name in names:
        stem, number = file_stem(name), 1
        while taken & (files := {_key(f"{_numbered(stem, number)}{ending}") for ending in endings}):
            number += 1
        taken |= files
        stems[name] = _numbered(stem, number)
    return stems


def _numbered(stem: str, number: int) -> str:
    return stem if number == 1 else f"{stem}-{number}"


def _key(file: str) -> str:
    """What two names have in common that are one file somewhere."""
    return unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", file).casefold())
