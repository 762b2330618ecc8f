"""`python -m scan2flex_jax.statics.kernel`: build the compiled solver and install it for this user."""

import sys

import jax

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.statics.kernel.build import build


def main() -> int:
    """Build; the exit code."""
    jax.config.update("jax_enable_x64", True)
    try:
        file = build()
    except Scan2FlexError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    sys.stdout.write(f"{file}\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
