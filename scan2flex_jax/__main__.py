"""``python -m scan2flex_jax`` is the command line ``scan2flex``."""

from scan2flex_jax.cli import main

if __name__ == "__main__":
    main()
