"""What the package raises: every message is one sentence that says what was got and what to do."""


class Scan2FlexError(Exception):
    """Base of all errors that the package raises on purpose; its message is one sentence for the user."""


class StudyError(Scan2FlexError):
    """A study on disk that cannot be used: which file, which key in it, and one sentence about it.

    `key` is None where the whole file is at fault.
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
