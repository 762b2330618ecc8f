"""Exceptions of the package: every message is one sentence with the value found and the remedy."""

from collections.abc import Mapping


class Scan2FlexError(Exception):
    """Base of all errors that the package raises deliberately; its message is one sentence for the user."""


class NotSettledError(Scan2FlexError):
    """Poses without a stable equilibrium: the sentence, the advice, and the `reasons` by pose name."""

    def __init__(self, sentence: str, advice: str, reasons: Mapping[str, str]):
        """Keep the parts; `reasons` are the status of each solve, in words."""
        self.sentence = sentence
        self.advice = advice
        self.reasons = dict(reasons)
        super().__init__(sentence, advice, self.reasons)

    def __str__(self) -> str:
        """Sentence (POSE: reason; ...): what to do."""
        why = "; ".join(f"{name}: {reason}" for name, reason in self.reasons.items())
        return f"{self.sentence}{f' ({why})' if why else ''}: {self.advice}"


class StudyError(Scan2FlexError):
    """A study on disk that cannot be used: the file, the key in it, and one sentence.

    `key` is None if the whole file is at fault.

    Examples:
        >>> print(StudyError("study.toml", "cable.length", "it is missing: give its value."))
        study.toml: cable.length: it is missing: give its value.
    """

    def __init__(self, file: object, key: str | None, sentence: str):
        """Keep the three parts; `file` may be a path."""
        self.file = str(file)
        self.key = key
        self.sentence = sentence
        super().__init__(self.file, key, sentence)

    def __str__(self) -> str:
        """FILE: KEY: sentence."""
        return ": ".join(part for part in (self.file, self.key, self.sentence) if part is not None)


class SettingsError(Scan2FlexError, ValueError):
    """A setting that cannot be used; the sentence names it."""
