"""Numbers and help text of the exit codes (`app` and the commands choose one), shared options and shared steps."""

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from scan2flex_jax.cli import searches
from scan2flex_jax.cli.setup import progress
from scan2flex_jax.cli.terminal import printable, say, text_to_errors
from scan2flex_jax.errors import Scan2FlexError

BAD_INPUT, NOT_TO_BELIEVE = 2, 3
PICTURES = (".png", ".svg", ".pdf")
EXIT_CODES = (
    "Exit codes: 0 done; 1 a fault of the program itself; 2 input or options that cannot be used, one sentence on standard "
    "error; 3 computed, and `reliable?` is answered no; 130 interrupted."
)


def file_to_write(path: Path | None) -> Path | None:
    """The file that an option names (``-``: standard output); one that cannot be written is refused at once."""
    if path == Path("-"):
        text_to_errors(True)
    elif path is not None:
        if path.is_dir():
            raise Scan2FlexError(f"{path} is a folder: name a file in it.")
        folder_to_write(path.parent if not _stream(path) else None)
    return path


def _stream(path: Path) -> bool:
    """Whether a path is a device or a pipe, which may be written although its folder may not."""
    from scan2flex_jax.study.files import is_stream, writing_error  # noqa: PLC0415

    try:
        return is_stream(path)
    except NotADirectoryError:
        return False  # refused with its folder
    except (OSError, ValueError) as error:
        raise writing_error(path, error) from error


def folder_to_write(path: Path | None) -> Path | None:
    """The folder that an option names; it need not exist, but it must be possible to create it."""
    if path is not None:
        there = next(p for p in (path, *path.absolute().parents) if p.exists() or p.is_symlink())
        if not there.is_dir():
            raise Scan2FlexError(f"{there} is not a folder: name another place for {path.name}.")
        if not os.access(there, os.W_OK | os.X_OK):
            raise Scan2FlexError(f"{there} is not writable: name another place.")
    return path


def begun(study: Path, force: bool, *files: Path | None, **options):
    """The study in a folder, read with the ``options`` of `load_study`, and the command's outputs, which claim ``files``."""
    from scan2flex_jax.study import load_study  # noqa: PLC0415
    from scan2flex_jax.study.outputs import Outputs  # noqa: PLC0415

    loaded = load_study(study, **options)
    outputs = Outputs(loaded, source=study, force=force)
    outputs.claim(*files)
    return loaded, outputs


def other_folder(save: Path | None, study: Path | None) -> None:
    """Refuse to save estimates into the folder of the study that they were found from."""
    if save is not None and study is not None and save.resolve() == study.resolve():
        raise Scan2FlexError(f"--save {save} is the folder of the study itself, which stays as you wrote it: name another one.")


def saved(study, folder: Path, say=say) -> Path:
    """Save a study, and say under which name a study.toml that was there is kept."""
    from scan2flex_jax.study import save_study  # noqa: PLC0415

    before = set(folder.glob("study.toml.bak*"))
    toml = save_study(study, folder)
    for kept in sorted(set(folder.glob("study.toml.bak*")) - before):
        say(f"the study.toml that was there is kept as {kept}, with its comments")
    return toml


def picture_to_write(path: Path | None) -> Path | None:
    """The picture that an option names."""
    if path is not None and path.suffix.lower() not in PICTURES:
        raise Scan2FlexError(f"{path.name} is not a picture: name a file that ends in {', '.join(PICTURES)}.")
    return file_to_write(path)


StudyFolder = Annotated[Path, typer.Argument(help="Folder of a study, with its study.toml.")]
JsonFile = Annotated[
    Path | None,
    typer.Option(
        "--json",
        help="Write the result here, as JSON; - is standard output, with all text on standard error.",
        callback=file_to_write,
    ),
]
Force = Annotated[
    bool, typer.Option("--force", help="Replace results that are there already; files of a study are never replaced.")
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress on standard error.")]
Elements = Annotated[
    int | None,
    typer.Option(min=8, max=5000, help="Elements of the rod.", show_default="40, or more for short bends"),
]


def choices(*names: str):
    """Completion of an option's value by the shell."""
    return lambda incomplete: [name for name in names if name.startswith(incomplete)]


def one_of(*names: str):
    """Settings of an option with one of these values: completion, and refusal of any other before the command begins."""

    def check(name: str | None) -> str | None:
        if name is not None and name not in names:
            raise Scan2FlexError(f"{name[:60]!r} is not known: use one of {', '.join(names)}.")
        return name

    return {"autocompletion": choices(*names), "callback": check}


def interactive() -> bool:
    """Whether standard input is a terminal, so that the user can be prompted."""
    return sys.stdin.isatty()


def explained(study, elements: int | None, folder: Path | None, quiet: bool = False, say=say, *, again: bool = False):
    """Explain a study, from a search that is kept in the ``folder`` unless ``again``, and print the summary."""
    with progress(f"explaining {study.title}", quiet) as tell:
        result = searches.explained(study, elements, tell, folder, again=again)
    say(result.summary())
    return result


def extracted(study, quiet: bool = False):
    """``(study with curves, curves by pose)``."""
    from scan2flex_jax.scan import extract_study  # noqa: PLC0415

    with progress("extracting centre curves", quiet) as tell:
        return extract_study(study, progress=lambda name, i, n: tell(f"{name} ({i} of {n})"))


def drawing():
    """The module `plot`, with a backend that needs no screen."""
    import matplotlib as mpl  # noqa: PLC0415

    mpl.use("Agg")
    from scan2flex_jax import plot  # noqa: PLC0415

    return plot


def explanation_pictures(folder: Path) -> tuple[Path, Path]:
    """The files that `draw_explanation` writes."""
    return folder / "explanation.png", folder / "shapes.png"


def draw_explanation(result, folder: Path, write) -> None:
    """Pictures of the evidence, the residuals and the shapes, written by ``write(path, bytes)``."""
    plot = drawing()
    for figure, file in zip((plot.explained(result), plot.overview(result)), explanation_pictures(folder), strict=True):
        plot.save(figure, file, write=write)


def asked_or_refused(question: str, option: str, check, default: str | None = None):
    """``check(answer)`` of the answer to a prompt; without a terminal, an error that names the option."""
    if not interactive():
        raise Scan2FlexError(f"{question} is not known: give {option}.")
    while True:
        answer = typer.prompt(printable(question[0].upper() + question[1:]), default=default, show_default=bool(default))
        try:
            return check(answer)
        except Scan2FlexError as error:
            say(f"  {error}", err=True)
