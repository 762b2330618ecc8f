"""Export of the calibrated cable to MuJoCo, PyElastica, OpenUSD and JSON, a file per format, and to a builder of Newton."""

from scan2flex_jax.export.cable import HungCable
from scan2flex_jax.export.hanging import hung
from scan2flex_jax.export.newton import to_newton
from scan2flex_jax.export.run import TO, export

__all__ = ["TO", "HungCable", "export", "hung", "to_newton"]
