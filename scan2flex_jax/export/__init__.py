"""The calibrated cable for simulators that users have: MuJoCo, PyElastica, OpenUSD for Newton, and plain JSON."""

from scan2flex_jax.export.cable import HungCable
from scan2flex_jax.export.hanging import hung
from scan2flex_jax.export.run import TO, export

__all__ = ["TO", "HungCable", "export", "hung"]
