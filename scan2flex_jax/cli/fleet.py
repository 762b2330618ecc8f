"""One command for several studies: one after the other, or on worker processes of dask."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from scan2flex_jax.cli.options import BAD_INPUT, NOT_TO_BELIEVE
from scan2flex_jax.cli.terminal import complain, say
from scan2flex_jax.errors import Scan2FlexError

StudyFolders = Annotated[
    list[Path], typer.Argument(metavar="STUDY...", help="Folders of studies, with their study.toml.", show_default=False)
]
Workers = Annotated[
    int | None, typer.Option(min=1, help="Processes that share several studies.", show_default="one after the other")
]


def each(studies: list[Path], command: Callable[..., bool], workers: int | None, **files: Path | None) -> None:
    """Run ``command(study, say=..., **files)``, which returns whether its result is reliable, for every study.

    ``{}`` in the name of a file stands for the study's name. Of several studies a refused one does not stop the others; the
    exit code is then that of a refused input.
    """
    named = _named(studies, files)
    if len(studies) == 1:
        codes = [0 if command(studies[0], say=say, **named[0]) else NOT_TO_BELIEVE]
    else:
        calls, codes = [partial(_quietly, command, *both) for both in zip(studies, named, strict=True)], []
        for study, (texts, fault, code) in zip(studies, _results(calls, workers), strict=True):
            say(f"\n{study}\n")
            for text in texts:
                say(text)
            if fault:
                complain(fault)
            codes.append(code)
    if any(codes):
        raise typer.Exit(BAD_INPUT if BAD_INPUT in codes else NOT_TO_BELIEVE)


def _named(studies, files) -> list[dict[str, Path | None]]:
    """The files of each study."""
    names = [study.resolve().name for study in studies]
    for option, path in files.items():
        if path is not None and len(names) > 1 and "{}" not in str(path):
            raise Scan2FlexError(f"--{option} {path} is one for several studies: put {{}} where the study's name belongs.")
    if any(files.values()) and len({*names}) < len(names):
        raise Scan2FlexError(f"two studies are called {max(names, key=names.count)}: their files would be the same.")
    return [{option: path and Path(str(path).replace("{}", name)) for option, path in files.items()} for name in names]


def _quietly(command, study, files) -> tuple[list[str], str | None, int]:
    """What a command says, the sentence of a refusal, and its exit code."""
    texts: list[str] = []
    try:
        believed = command(study, say=texts.append, **files)
    except Scan2FlexError as error:
        return texts, str(error), BAD_INPUT
    return texts, None, 0 if believed else NOT_TO_BELIEVE


def _results(calls, workers):
    """The results in order, each as soon as it is there."""
    if workers is None:
        yield from (call() for call in calls)
        return
    try:
        from distributed import Client, KilledWorker, LocalCluster  # noqa: PLC0415  (an extra)
    except ImportError as error:
        raise Scan2FlexError("--workers needs dask: install it with pip install 'scan2flex_jax[sweep]'") from error
    options = {"threads_per_worker": 1, "memory_limit": None, "dashboard_address": None, "silence_logs": "ERROR"}
    with LocalCluster(n_workers=workers, **options) as cluster, Client(cluster) as client:
        for future in [client.submit(call, pure=False) for call in calls]:
            try:
                yield future.result()
            except KilledWorker:
                yield [], "its workers were lost again and again: give fewer --workers, for less memory", BAD_INPUT
