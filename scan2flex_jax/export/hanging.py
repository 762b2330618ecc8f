"""From a study to a `HungCable`: the equilibrium of one pose, and the feature that each effect causes."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from scan2flex_jax.compilation import lightly_compiled
from scan2flex_jax.effects import parameters_of
from scan2flex_jax.effects.point_load import PointLoad
from scan2flex_jax.effects.point_mass import PointMass
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.export.cable import GIVES, LAWS, MASSES, THIN, HungCable, features_of
from scan2flex_jax.fitting.parameters import model_of
from scan2flex_jax.fitting.poses import boundary_of
from scan2flex_jax.prediction import settled
from scan2flex_jax.rod.effect import AbstractEffect, Section, overriding
from scan2flex_jax.rod.model import CableModel, Configuration, Rod, discretise
from scan2flex_jax.statics.solve import Equilibrium
from scan2flex_jax.study.model import Study, StudyPose

_ROWS, _GENTLEST = 40, 1e-4  # of a table of moments; its first strain over the last
_OF_THE_CABLE = ("cable", "clamps", "section", "dead_load", "strain_energy", "node_potential", "element_potential")


def hung(study: Study, pose: str | None = None, elements: int = 40) -> HungCable:
    """The cable of a study whose parameters all have values, in one pose; raises `Scan2FlexError` if it cannot be solved."""
    chosen = study.poses[0] if pose is None else study.pose(pose)
    model, e = settled(study, chosen, elements)
    if not bool(e.verdict.solved):
        raise Scan2FlexError(f"pose {chosen.name!r} could not be solved ({e.verdict.sentence()}): export another pose.")
    return described(study, chosen, model, e.rod, e.configuration, _strain(e))


def lying(study: Study, pose: str | None = None, elements: int = 40) -> HungCable:
    """The cable straight, without an equilibrium: for targets that take its sections alone."""
    chosen = study.poses[0] if pose is None else study.pose(pose)
    model = model_of(study, chosen)
    rod = discretise(model, boundary_of(chosen), elements)
    r = rod.node_s[:, None] * jnp.array([0.0, 0.0, 1.0])
    return described(study, chosen, model, rod, Configuration(r, jnp.broadcast_to(jnp.eye(3), (elements + 1, 3, 3))), 0.0)


def described(
    study: Study, pose: StudyPose, model: CableModel, rod: Rod, configuration: Configuration, strain: float
) -> HungCable:
    """The numbers of a rod in a configuration; ``strain`` (-) bounds its stretch and shear."""
    section, radius = rod.section, None if study.cable.get("radius") is None else float(study.cable["radius"])
    r, R = map(np.asarray, configuration)
    K, natural, density = map(np.asarray, (section.stiffness, section.natural, section.density))
    return HungCable(
        study.title, pose.name, float(rod.length), np.asarray(model.gravity), radius,
        K, natural, density, np.asarray(rod.node_s), r, R, np.asarray(rod.boundary.held), _beyond(model), study.assumed_rigid,
        tuple((float(x.position), float(x.mass)) for x in model.effects if isinstance(x, PointMass)),
        tuple(x.kind for x in model.effects if not any(overriding((x,), hook) for hook in _OF_THE_CABLE)),
        tuple((x.kind, parameters_of(x, study.clamped_ends)) for x in model.effects),
        strain, _sources(model, section), _laws(model, section, radius),
    )  # fmt: skip


def _beyond(model: CableModel) -> tuple[str, ...]:
    """Types of effects that are neither in the sections, nor in the supports, nor in the observation."""
    hooks = ("strain_energy", "node_potential", "element_potential", "dead_load")
    found = (effect for hook in hooks for effect in overriding(model.effects, hook))
    return tuple(dict.fromkeys(f"{e.kind} with an offset" if _on_an_arm(e) else e.kind for e in found))


def _on_an_arm(effect: AbstractEffect) -> bool:
    return isinstance(effect, PointMass | PointLoad) and effect.offset is not None


def _laws(model: CableModel, section: Section, radius: float | None) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Moments (n, k) in N m over strains (k,) in 1/m, up to a bend of twice the radius, where they are not linear."""
    effects = [e for e in overriding(model.effects, "strain_energy") if e.kind in LAWS]
    if not effects:
        return {}
    top = 0.5 / (THIN * float(model.cable.length) if radius is None else radius)
    q = np.r_[0.0, np.geomspace(_GENTLEST * top, top, _ROWS)]
    out = {}
    for name, entry in (("bending", 3), ("twist", 5)):
        moment = np.asarray(_moments(effects, q, section.stiffness, entry))
        if not np.allclose(moment, np.asarray(section.stiffness)[:, entry, entry, None] * q):
            out[name] = q, moment
    return out


@lightly_compiled
def _moments(effects, q, stiffness, entry):
    """Moments (n, k) in N m over strains ``q`` (k,) of an ``entry``: sections of ``stiffness`` (n, 6, 6) with energy laws."""

    def energy(x, K):
        strain = jnp.zeros(6).at[entry].set(x)
        return 0.5 * strain @ K @ strain + sum(e.strain_energy(strain, K) for e in effects)

    return jax.vmap(jax.vmap(jax.grad(energy), (0, None)), (None, 0))(q, stiffness)


def _strain(e: Equilibrium) -> float:
    """Bound of the stretch and shear of the pose (-)."""
    _, force, _ = e.section_forces()
    softest = np.min(np.linalg.eigvalsh(np.asarray(e.rod.section.stiffness)[:, :3, :3]), axis=1)
    return float(np.max(np.linalg.norm(np.asarray(force), axis=1) / softest))


def _sources(model: CableModel, section: Section) -> dict[str, tuple[str, ...]]:
    """Effect types by the feature that each gives to the sections of a straight, uniform, isotropic rod."""
    K = jnp.mean(section.stiffness, axis=0)
    diagonal = jnp.diag(jnp.stack([K[0, 0], K[0, 0], K[2, 2], K[3, 3], K[3, 3], K[5, 5]]))
    bare = eqx.tree_at(
        lambda x: (x.stiffness, x.natural, x.density), section,
        (jnp.broadcast_to(diagonal, section.stiffness.shape), jnp.zeros_like(section.natural),
         jnp.full_like(section.density, jnp.mean(section.density))),
    )  # fmt: skip
    brought: dict[str, list[str]] = {MASSES: [PointMass.kind]}
    for effect in overriding(model.effects, "cable"):
        if effect.cable(model.cable).axial_stiffness != model.cable.axial_stiffness:
            brought.setdefault(GIVES, []).append(effect.kind)
    for effect in overriding(model.effects, "section"):
        changed = effect.section(bare, model.cable.length)
        for feature in features_of(*map(np.asarray, (changed.stiffness, changed.natural, changed.density))):
            brought.setdefault(feature, []).append(effect.kind)
    return {feature: tuple(kinds) for feature, kinds in brought.items()}
