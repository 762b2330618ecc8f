"""The command line ``scan2flex``: thin commands over the Python functions of the same names.

`options` has the exit codes, which every help page shows, and what commands share; a module holds the commands of one step.
Nothing heavy is imported before a command needs it.
"""

from scan2flex_jax.cli.app import main

__all__ = ["main"]
