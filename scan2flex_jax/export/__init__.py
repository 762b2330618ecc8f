"""Export of the calibrated cable to MuJoCo, PyElastica, OpenUSD (for Newton) and plain JSON: one file per format."""

from scan2flex_jax.export.cable import HungCable
from scan2flex_jax.export.hanging import hung
from scan2flex_jax.export.run import TO, export

__all__ = ["TO", "HungCable", "export", "hung"]
