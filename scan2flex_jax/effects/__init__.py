"""Physics beyond the plain rod: one file per kind, each an effect of the rod's extension point.

`effect_of` makes the effect that a study declares, `parameters_of` writes it back, `ordered` brings several into the
order that the format means. A new kind of one's own is one file that ends in `catalogue.add_kind` (docs/adding-an-effect.md);
one of the package has its class here, its format in `study.kinds` and its entry in `_materials`, `_loads` or `_ends`.
"""

from scan2flex_jax.effects._registry import effect_class, effect_of, kinds, ordered, parameters_of, register_effect
from scan2flex_jax.effects.anisotropic_bending import AnisotropicBending
from scan2flex_jax.effects.bend_twist_coupling import BendTwistCoupling
from scan2flex_jax.effects.clamp_offset import ClampOffset
from scan2flex_jax.effects.clamp_rotation import ClampRotation
from scan2flex_jax.effects.curvature_profile import CurvatureProfile
from scan2flex_jax.effects.density_profile import DensityProfile
from scan2flex_jax.effects.density_taper import DensityTaper
from scan2flex_jax.effects.distributed_load import DistributedLoad
from scan2flex_jax.effects.elastic_clamp import ElasticClamp
from scan2flex_jax.effects.elastic_support import ElasticSupport
from scan2flex_jax.effects.extensibility import Extensibility
from scan2flex_jax.effects.kink import Kink
from scan2flex_jax.effects.length_error import LengthError
from scan2flex_jax.effects.memory_set import MemorySet
from scan2flex_jax.effects.natural_curvature import NaturalCurvature
from scan2flex_jax.effects.nonlinear_bending import NonlinearBending
from scan2flex_jax.effects.point_load import PointLoad
from scan2flex_jax.effects.point_mass import PointMass
from scan2flex_jax.effects.scan_offset import ScanOffset
from scan2flex_jax.effects.scan_scale import ScanScale
from scan2flex_jax.effects.stiffness_profile import StiffnessProfile
from scan2flex_jax.effects.stiffness_taper import StiffnessTaper
from scan2flex_jax.effects.support_plane import SupportPlane
from scan2flex_jax.effects.tension_stiffening import TensionStiffening
from scan2flex_jax.effects.tension_twist_coupling import TensionTwistCoupling
from scan2flex_jax.effects.tether import Tether
from scan2flex_jax.effects.uniform_load import UniformLoad

_ALL = (
    NaturalCurvature, Kink, AnisotropicBending, BendTwistCoupling, NonlinearBending, StiffnessProfile, Extensibility,
    PointMass, DensityProfile, UniformLoad, PointLoad, Tether, SupportPlane, ElasticClamp, ClampRotation, ClampOffset,
    LengthError, ScanScale, ScanOffset, StiffnessTaper, DensityTaper, TensionTwistCoupling, TensionStiffening,
    ElasticSupport, MemorySet, DistributedLoad, CurvatureProfile,
)  # fmt: skip
for _class in _ALL:
    register_effect(_class)

__all__ = ["effect_class", "effect_of", "kinds", "ordered", "parameters_of", "register_effect"]
__all__ += [_class.__name__ for _class in _ALL]
