"""The command line ``scan2flex``: thin commands over the Python functions of the same names.

Exit codes: 0 done, 2 input that cannot be used (one sentence on standard error), 3 computed, but the answer must not be
believed (a pose that could not be solved). Nothing heavy is imported before a command needs it.
"""

from scan2flex_jax.cli.app import main

__all__ = ["main"]
