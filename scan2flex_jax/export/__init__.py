"""The calibrated cable for simulators that users have: a MuJoCo model, a PyElastica script, plain JSON."""

from scan2flex_jax.export.cable import HungCable, hung
from scan2flex_jax.export.run import TO, export

__all__ = ["TO", "HungCable", "export", "hung"]
