"""Hooks of an effect, physics that acts on the clamps, on the energy or on the observation (its entry: `effects.entry`).

Every effect changes the cable, the supports, the sections, the loads, the energy or the observation, and overrides only the
hooks it needs. Hooks are pure JAX functions of the effect's own leaves, so every parameter of an effect is differentiable,
can be an unknown of a fit and can be swept with `jax.vmap`; at its null value an effect leaves the model exactly
unchanged.

Order of use: `cable`, `clamps`, `section`, `dead_load`, then inside the energy `strain_energy` and `node_potential`, and
after the equilibrium `observe`. Effects are applied in the order in which they are declared.

A new effect type needs a catalogue entry as well (`effects.entry`).
"""

from typing import ClassVar

import equinox as eqx
from jax import Array
from jaxtyping import Float

from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.cable import Cable


class Section(eqx.Module):
    """The rod's sections, one per element: midpoint ``s`` and length ``ds`` (m), ``stiffness`` the 6x6 matrix
    diag(GA1, GA2, EA, EI1, EI2, GJ) with couplings (N, N m, N m^2), ``natural`` = (Gamma_0, Omega_0) (-, 1/m),
    ``density`` (kg/m). ``within`` (N m^2) is the stiffness against strain variation inside an element (`element_law`); None
    derives it from ``stiffness``. An effect that models a spring between two elements keeps the material's. ``growth`` (1/m) is
    the slope of the logarithm of EI and GJ where these change smoothly along an element, whose ``stiffness`` is their mean."""

    s: Float[Array, " n"]
    ds: Float[Array, ""]
    stiffness: Float[Array, "n 6 6"]
    natural: Float[Array, "n 6"]
    density: Float[Array, " n"]
    within: Float[Array, "n 3 3"] | None = None
    growth: Float[Array, " n"] | None = None


class Node(eqx.Module):
    """One node of the rod, the argument of `AbstractEffect.node_potential`: position ``r`` (m), rotation ``R``, arc length
    ``s`` (m), its share ``weight`` (m) of the cable length, the element length ``ds`` (m), and the supports."""

    r: Float[Array, "3"]
    R: Float[Array, "3 3"]
    s: Float[Array, ""]
    weight: Float[Array, ""]
    ds: Float[Array, ""]
    boundary: Boundary


class AbstractEffect(eqx.Module):
    """Base of all effects; every hook is the identity (or adds nothing) unless an effect overrides it.

    An effect used in studies and results declares its ``kind``, the ``place`` where it acts (``clamps``, ``energy`` or
    ``observation``) and its description ``words``.
    """

    kind: ClassVar[str]
    place: ClassVar[str]
    words: ClassVar[str]

    def cable(self, cable: Cable) -> Cable:
        """The cable with changed parameters."""
        return cable

    def clamps(self, boundary: Boundary) -> Boundary:
        """The true supports, given the measured ones."""
        return boundary

    def section(self, section: Section, length: Float[Array, ""]) -> Section:
        """Sections with changed stiffness, natural strain or density."""
        return section

    def dead_load(self, section: Section, gravity: Float[Array, "3"]):
        """Loads that keep their direction: a `rod.loads.DeadLoad`, or None."""
        return

    def strain_energy(self, strain: Float[Array, "6"], stiffness: Float[Array, "6 6"]):
        """Energy per length (J/m) added to the quadratic one, as a function of the strain in excess of the natural one."""
        return 0.0

    def node_potential(self, node: Node):
        """Energy (J) of one node in an outer field that is not a dead load."""
        return 0.0

    def observe(self, points: Float[Array, "*m 3"]) -> Float[Array, "*m 3"]:
        """Points of the centre line (m) as the scanner sees them."""
        return points


def overriding(effects, hook: str) -> tuple:
    """The effects that override ``hook``."""
    return tuple(e for e in effects if getattr(type(e), hook) is not getattr(AbstractEffect, hook))
