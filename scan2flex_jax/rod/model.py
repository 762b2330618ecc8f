"""Discretisation: from a cable, its effects and its supports to the rod whose energy is minimised.

The rod has ``n`` elements of equal length ``ds = L/n``. Node ``i`` carries a frame ``(r_i, R_i)``. The strain of an element,
``xi = (Gamma + e3, Omega)``, is that of the helix ``ds xi = log(g_i^-1 g_{i+1})`` in SE(3), invariant under rigid motions.
With the law of `element_law`, positions are of fourth order in ``ds``.
Reference: Sonneville, Cardona, Bruls, "Geometrically exact beam finite element formulated on SE(3)" (2014).
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.compilation import lightly_compiled
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.cable import Cable, Quantity, rigid_stiffness
from scan2flex_jax.rod.effect import AbstractEffect, Section
from scan2flex_jax.rod.element_law import stiffness_within
from scan2flex_jax.rod.loads import DeadLoad, distributed_load
from scan2flex_jax.rod.reals import reals

_COARSE = 8  # elements for the sum of the loads


class Configuration(NamedTuple):
    """Nodes of the rod: positions ``r`` (m) and rotations ``R`` with columns d1, d2, d3."""

    r: Float[Array, "nodes 3"]
    R: Float[Array, "nodes 3 3"]


def _effects(effects):
    """The effects as a tuple with every number turned into an array, so that a float parameter is traced like any other."""
    if isinstance(effects, AbstractEffect):
        effects = (effects,)
    return jax.tree.map(lambda x: jnp.asarray(x, float) if _is_number(x) else x, tuple(effects))


def _is_number(x):
    return isinstance(x, int | float | np.ndarray) and not isinstance(x, bool)


class CableModel(eqx.Module):
    """A cable in a gravity field (m/s^2, scan frame) with the effects that act upon it: the model of all poses.

    ``gravity`` may be a list; ``effects`` one effect or several, whose parameters may be plain numbers; ``places``: those of
    the effects among the ones that a study declares, where a fit must tell effects of one kind apart; ``at_end``: which of the
    effects act at the end of the cable, whatever its length (`fitting.parameters`).

    Examples:
        >>> cable = Cable(length=1.0, length_density=0.2, bending_stiffness=0.1, torsional_stiffness=0.25)
        >>> CableModel(cable, gravity=[0.0, 0.0, -9.81]).gravity.tolist()
        [0.0, 0.0, -9.81]
    """

    cable: Cable
    gravity: Float[Array, "3"]
    effects: tuple[AbstractEffect, ...]
    places: Float[Array, " effects"] | None
    at_end: tuple[bool, ...] = eqx.field(static=True)

    def __init__(
        self, cable: Cable, gravity: Quantity, effects: AbstractEffect | Iterable[AbstractEffect] = (), *,
        places: Sequence[float] | None = None, at_end: Sequence[bool] = (),
    ) -> None:  # fmt: skip
        """Numbers of any kind become arrays; raises `Scan2FlexError` for a gravity that is not three of them."""
        self.cable, self.effects = cable, _effects(effects)
        self.places, self.at_end = None if places is None else jnp.asarray(places, float), tuple(at_end)
        self.gravity = jnp.asarray(reals(gravity, "CableModel: gravity", (3,)))


class Rod(eqx.Module):
    """The discrete rod in one pose; ``effects`` provide strain energies, node potentials and the observation."""

    section: Section
    load: DeadLoad
    boundary: Boundary
    effects: tuple[AbstractEffect, ...]

    @property
    def elements(self) -> int:
        """Number of elements."""
        return self.section.s.shape[0]

    @property
    def length(self) -> Float[Array, ""]:
        """Length between the supports (m)."""
        return self.section.ds * self.elements

    @property
    def node_s(self) -> Float[Array, " nodes"]:
        """Arc length of the nodes (m)."""
        return jnp.arange(self.elements + 1) * self.section.ds


def discretise(model: CableModel, boundary: Boundary, elements: int) -> Rod:
    """The rod of ``elements`` elements that ``model`` makes between the supports of ``boundary``."""
    for effect in model.effects:
        boundary = effect.clamps(boundary)
    section, load = _loaded_sections(model, elements)
    return Rod(section, load, boundary, model.effects)


def with_rigid(model: CableModel, names: Sequence[str]) -> CableModel:
    """The model with the named stiffnesses set to the `rigid_stiffness` of the cable's weight and dead loads."""
    if not names:
        return model
    rigid = rigid_stiffness(model.cable.length, model.cable.bending_stiffness, _dead_load(jax.lax.stop_gradient(model)))
    values = [jnp.broadcast_to(rigid, getattr(model.cable, name).shape) for name in names]
    return eqx.tree_at(lambda m: [getattr(m.cable, name) for name in names], model, values)


@lightly_compiled
def _dead_load(model):
    """Sum of the dead loads on the nodes (N)."""
    return jnp.sum(jnp.linalg.norm(_loaded_sections(model, _COARSE)[1].force, axis=1))


def _loaded_sections(model, elements):
    """Sections of the rod, and dead loads on its nodes."""
    cable = model.cable
    for effect in model.effects:
        cable = effect.cable(cable)
    section = _plain_section(cable, elements)
    for effect in model.effects:
        section = effect.section(section, cable.length)
    if section.within is None:
        section = replace(section, within=stiffness_within(section.stiffness))
    load = distributed_load(section, section.density[:, None] * model.gravity)
    for effect in model.effects:
        load = load + effect.dead_load(section, model.gravity)
    return section, load


def _plain_section(cable: Cable, n: int) -> Section:
    ds = cable.length / n
    diagonal = jnp.concatenate(
        [cable.shear_stiffness, cable.axial_stiffness[None], cable.bending_stiffness, cable.torsional_stiffness[None]]
    )
    natural = jnp.concatenate([cable.natural_stretch, cable.natural_curvature])
    return Section(
        s=(jnp.arange(n) + 0.5) * ds,
        ds=ds,
        stiffness=jnp.broadcast_to(jnp.diag(diagonal), (n, 6, 6)),
        natural=jnp.broadcast_to(natural, (n, 6)),
        density=jnp.broadcast_to(cable.length_density, (n,)),
    )
