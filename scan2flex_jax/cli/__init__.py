"""The command line ``scan2flex``: thin commands over the Python functions of the same names.

Each module holds the commands of one step; `options` holds the exit codes, which every help page shows, and the shared options.
Heavy libraries are imported inside the command that needs them.
"""

from scan2flex_jax.cli.app import main

__all__ = ["main"]
