"""Physics beyond the plain rod: one file per kind, each an effect of the rod's extension point.

`effect_of` makes the effect that a study declares, `parameters_of` writes it back, `ordered` brings several into the
order that the format means. A new kind of one's own is one file that ends in `catalogue.add_kind` (docs/adding-an-effect.md);
one of the package is such a file too, with its format in `study.kinds` and its line in `catalogue.EFFECTS`.
"""

from scan2flex_jax.effects._registry import effect_class, effect_of, kinds, ordered, parameters_of, register_effect
from scan2flex_jax.effects.anisotropic_bending import AnisotropicBending as AnisotropicBending
from scan2flex_jax.effects.bend_twist_coupling import BendTwistCoupling as BendTwistCoupling
from scan2flex_jax.effects.catalogue import EFFECTS
from scan2flex_jax.effects.clamp_offset import ClampOffset as ClampOffset
from scan2flex_jax.effects.clamp_rotation import ClampRotation as ClampRotation
from scan2flex_jax.effects.curvature_profile import CurvatureProfile as CurvatureProfile
from scan2flex_jax.effects.density_profile import DensityProfile as DensityProfile
from scan2flex_jax.effects.density_taper import DensityTaper as DensityTaper
from scan2flex_jax.effects.distributed_load import DistributedLoad as DistributedLoad
from scan2flex_jax.effects.elastic_clamp import ElasticClamp as ElasticClamp
from scan2flex_jax.effects.elastic_support import ElasticSupport as ElasticSupport
from scan2flex_jax.effects.extensibility import Extensibility as Extensibility
from scan2flex_jax.effects.kink import Kink as Kink
from scan2flex_jax.effects.length_error import LengthError as LengthError
from scan2flex_jax.effects.memory_set import MemorySet as MemorySet
from scan2flex_jax.effects.natural_curvature import NaturalCurvature as NaturalCurvature
from scan2flex_jax.effects.nonlinear_bending import NonlinearBending as NonlinearBending
from scan2flex_jax.effects.point_load import PointLoad as PointLoad
from scan2flex_jax.effects.point_mass import PointMass as PointMass
from scan2flex_jax.effects.scan_offset import ScanOffset as ScanOffset
from scan2flex_jax.effects.scan_scale import ScanScale as ScanScale
from scan2flex_jax.effects.stiffness_profile import StiffnessProfile as StiffnessProfile
from scan2flex_jax.effects.stiffness_taper import StiffnessTaper as StiffnessTaper
from scan2flex_jax.effects.support_plane import SupportPlane as SupportPlane
from scan2flex_jax.effects.tension_stiffening import TensionStiffening as TensionStiffening
from scan2flex_jax.effects.tension_twist_coupling import TensionTwistCoupling as TensionTwistCoupling
from scan2flex_jax.effects.tether import Tether as Tether
from scan2flex_jax.effects.uniform_load import UniformLoad as UniformLoad

__all__ = ["effect_class", "effect_of", "kinds", "ordered", "parameters_of", "register_effect"]
__all__ += [_class.__name__ for _class, _ in EFFECTS]
