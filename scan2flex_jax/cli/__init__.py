"""The command line ``scan2flex``: thin commands over the Python functions of the same names.

Each module holds the commands of one step; `options` holds the shared options and the list of the exit codes, which every help
page shows; `app` and the commands choose the code. Heavy libraries are imported inside the command that needs them.
"""

from scan2flex_jax.cli.app import main

__all__ = ["main"]
