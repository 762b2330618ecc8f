"""Studies of real cables that come with the package; sources and licences stand in README.md beside this file."""

from pathlib import Path

from scan2flex_jax.errors import Scan2FlexError

_FOLDER = Path(__file__).parent


def example_names() -> tuple[str, ...]:
    """The names of the studies, in alphabetical order."""
    return tuple(sorted(path.parent.name for path in _FOLDER.glob("*/study.toml")))


def example_path(name: str) -> Path:
    """The folder of one study, to be read with `load_study`."""
    if name not in example_names():
        raise Scan2FlexError(f"No example is called {name!r}: use one of {', '.join(example_names())}.")
    return _FOLDER / name
