"""Export of the calibrated cable to MuJoCo, PyElastica, OpenUSD and JSON, to a builder of Newton, to Isaac Lab."""

from scan2flex_jax.export.cable import HungCable
from scan2flex_jax.export.hanging import hung
from scan2flex_jax.export.newton import isaac_lab_material, to_newton
from scan2flex_jax.export.run import TO, export

__all__ = ["TO", "HungCable", "export", "hung", "isaac_lab_material", "to_newton"]
