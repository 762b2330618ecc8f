"""Physics beyond the baseline model: one file per effect type, each a subclass of the rod's extension point.

`effect_of` builds the effect that a study declares, `parameters_of` writes it back, `ordered` sorts several into the order
that the format defines. A new effect type is one file: its class with the units and shapes of its parameters, and its
catalogue entry. A user's own file ends in `add_kind` (docs/adding-an-effect.md); one of the package has its line in
`catalogue.EFFECTS`.

Modules: `catalogue` the list; `entry` the fields of an entry; `builders`, `spans`, `moment_law` and `sliders` code shared by
several effects; `format` parameter fields of a class; `conversion` from a study and back.
"""

from scan2flex_jax.effects.anisotropic_bending import AnisotropicBending as AnisotropicBending
from scan2flex_jax.effects.bend_twist_coupling import BendTwistCoupling as BendTwistCoupling
from scan2flex_jax.effects.bending_law import BendingLaw as BendingLaw
from scan2flex_jax.effects.catalogue import EFFECTS, add_kind, effect_class, kinds, register_effect
from scan2flex_jax.effects.clamp_offset import ClampOffset as ClampOffset
from scan2flex_jax.effects.clamp_rotation import ClampRotation as ClampRotation
from scan2flex_jax.effects.conversion import effect_of, ordered
from scan2flex_jax.effects.curvature_profile import CurvatureProfile as CurvatureProfile
from scan2flex_jax.effects.dahl import Dahl as Dahl
from scan2flex_jax.effects.density_profile import DensityProfile as DensityProfile
from scan2flex_jax.effects.density_taper import DensityTaper as DensityTaper
from scan2flex_jax.effects.distributed_load import DistributedLoad as DistributedLoad
from scan2flex_jax.effects.elastic_clamp import ElasticClamp as ElasticClamp
from scan2flex_jax.effects.elastic_support import ElasticSupport as ElasticSupport
from scan2flex_jax.effects.entry import CatalogueEntry
from scan2flex_jax.effects.extensibility import Extensibility as Extensibility
from scan2flex_jax.effects.format import parameter, parameters_of
from scan2flex_jax.effects.friction import Friction as Friction
from scan2flex_jax.effects.kink import Kink as Kink
from scan2flex_jax.effects.knife_edge import KnifeEdge as KnifeEdge
from scan2flex_jax.effects.length_error import LengthError as LengthError
from scan2flex_jax.effects.memory_set import MemorySet as MemorySet
from scan2flex_jax.effects.moment import Moment as Moment
from scan2flex_jax.effects.natural_curvature import NaturalCurvature as NaturalCurvature
from scan2flex_jax.effects.nonlinear_bending import NonlinearBending as NonlinearBending
from scan2flex_jax.effects.point_load import PointLoad as PointLoad
from scan2flex_jax.effects.point_mass import PointMass as PointMass
from scan2flex_jax.effects.relaxation import Relaxation as Relaxation
from scan2flex_jax.effects.scan_offset import ScanOffset as ScanOffset
from scan2flex_jax.effects.scan_scale import ScanScale as ScanScale
from scan2flex_jax.effects.section_profile import SectionProfile as SectionProfile
from scan2flex_jax.effects.stiffness_field import StiffnessField as StiffnessField
from scan2flex_jax.effects.stiffness_profile import StiffnessProfile as StiffnessProfile
from scan2flex_jax.effects.stiffness_taper import StiffnessTaper as StiffnessTaper
from scan2flex_jax.effects.support import Support as Support
from scan2flex_jax.effects.support_plane import SupportPlane as SupportPlane
from scan2flex_jax.effects.tension_stiffening import TensionStiffening as TensionStiffening
from scan2flex_jax.effects.tension_twist_coupling import TensionTwistCoupling as TensionTwistCoupling
from scan2flex_jax.effects.tether import Tether as Tether
from scan2flex_jax.effects.torsion_friction import TorsionFriction as TorsionFriction
from scan2flex_jax.effects.torsion_law import TorsionLaw as TorsionLaw
from scan2flex_jax.effects.uniform_load import UniformLoad as UniformLoad

__all__ = ["CatalogueEntry", "add_kind", "effect_class", "effect_of", "kinds", "ordered", "parameter", "parameters_of"]
__all__ += ["register_effect"]
__all__ += [entry.effect.__name__ for entry in EFFECTS]
