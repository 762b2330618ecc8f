"""The program ``scan2flex``: its commands in the order in which a user meets them, its entry point and its exit codes.

Faults of the input and of files end in exit code 2 here; a command ends in 3 itself if its result is not reliable.
"""

import io
import os
import sys
import threading
from typing import Annotated

import typer
from typer.core import TyperGroup

from scan2flex_jax.cli import demo, explaining, extracting, fitting, making, measuring, sharing
from scan2flex_jax.cli.options import BAD_INPUT, EXIT_CODES
from scan2flex_jax.cli.terminal import close_output, complain, say, text_to_errors
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.version import __version__

_HELP = """Find the stiffness of a cable from its measured shapes.

Begin with a study: `scan2flex new DIR` makes one from scans or centre curves, `scan2flex check` describes it,
`scan2flex report` puts all results on one page.
"""


class _Commands(TyperGroup):
    """Ctrl-C (or the end of the input) at a prompt is an interrupt, as anywhere else."""

    def invoke(self, ctx):
        try:
            return super().invoke(ctx)
        except typer.Abort:
            raise KeyboardInterrupt from None


app = typer.Typer(
    cls=_Commands,
    help=_HELP,
    epilog=EXIT_CODES,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["--help", "-h"]},
)
for _command in (
    making.new, making.schema, measuring.pose, measuring.curve, measuring.check, extracting.extract,
    fitting.fit, explaining.explain, explaining.plan,
    sharing.report, fitting.simulate, sharing.export, demo.demo,
):  # fmt: skip
    app.command(epilog=EXIT_CODES)(_command)


def _said(version: bool) -> bool:
    if version:
        say(f"scan2flex_jax {__version__}")
        raise typer.Exit
    return version


@app.callback()
def _begin(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and exit.", callback=_said, is_eager=True)
    ] = False,
) -> None:
    text_to_errors(False)


def main() -> None:
    """Entry point: a fault of the input ends in one sentence and exit code 2."""
    try:
        _run()
    except SystemExit as end:
        if not any(t is not threading.main_thread() and not t.daemon for t in threading.enumerate()):
            raise
        # the output is complete: do not wait for a thread that still compiles ahead, which cannot be stopped
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        os._exit(end.code if isinstance(end.code, int) else int(end.code is not None))


def _run() -> None:
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # for names outside the terminal's encoding
    try:
        app()
    except Scan2FlexError as error:
        complain(str(error))
        sys.exit(BAD_INPUT)
    except OSError as error:  # a full disk has no name
        reason = error.strerror or str(error)
        complain(reason if error.filename is None else f"{error.filename}: {reason}")
        close_output()
        sys.exit(BAD_INPUT)
