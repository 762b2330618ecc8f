"""Hooks of an effect, physics that acts on the clamps, on the energy or on the observation (its entry: `effects.entry`).

Every effect changes the cable, the supports, the sections, the loads, the energy or the observation, and overrides only the
hooks it needs. Hooks are pure JAX functions of the effect's own leaves, so every parameter of an effect is differentiable,
can be an unknown of a fit and can be swept with `jax.vmap`; at its null value an effect leaves the model exactly
unchanged.

Order of use: `cable`, `clamps`, `section`, `dead_load`, then inside the energy `strain_energy`, `node_potential` and
`element_potential`, and after the equilibrium `observe`. Effects are applied in the order in which they are declared.

A new effect type needs a catalogue entry as well (`effects.entry`).
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

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


class Element(eqx.Module):
    """One element of the rod, the argument of `AbstractEffect.element_potential`: positions ``r`` (m), rotations ``R`` and arc
    lengths ``s`` (m) of its two nodes, its length ``ds`` (m), whether it is the ``first`` or the ``last`` one, the mean
    ``bending`` stiffness of the rod (N m^2), and the supports."""

    r: Float[Array, "2 3"]
    R: Float[Array, "2 3 3"]
    s: Float[Array, "2"]
    first: Bool[Array, ""]
    last: Bool[Array, ""]
    ds: Float[Array, ""]
    bending: Float[Array, ""]
    boundary: Boundary

    def share(self, position: Float[Array, ""]) -> tuple[Float[Array, ""], Bool[Array, ""]]:
        """``(u, own)``: how far along the element the arc length ``position`` (m) is (0..1), and whether it is in this one."""
        own = ((self.s[0] <= position) | self.first) & ((position < self.s[1]) | self.last)
        return jnp.where(own, (position - self.s[0]) / self.ds, 0.5), own

    def point(self, u: Float[Array, ""]) -> Float[Array, "3"]:
        """Point of the centre line (m): the cubic Hermite curve of the dead loads (`rod.loads`)."""
        h01 = u**2 * (3.0 - 2.0 * u)
        slope = (u**3 - 2.0 * u**2 + u) * self.R[0, :, 2] + (u**3 - u**2) * self.R[1, :, 2]
        return self.r[0] + h01 * (self.r[1] - self.r[0]) + self.ds * slope

    def tangent(self, u: Float[Array, ""]) -> Float[Array, "3"]:
        """Derivative of `point` by arc length (-)."""
        slope = (3.0 * u**2 - 4.0 * u + 1.0) * self.R[0, :, 2] + (3.0 * u**2 - 2.0 * u) * self.R[1, :, 2]
        return 6.0 * u * (1.0 - u) * (self.r[1] - self.r[0]) / self.ds + slope

    def arm(self, u: Float[Array, ""], lever: Float[Array, "3"]) -> Float[Array, "3"]:
        """A material vector ``lever`` (along d1, d2, d3) of the section at ``u`` in the scan frame, in the unit of the
        lever."""
        across = lever.at[2].set(0.0)
        return (1.0 - u) * self.R[0] @ across + u * self.R[1] @ across + lever[2] * self.tangent(u)


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

    def element_potential(self, element: Element):
        """Energy (J) of one element in an outer field: of what acts at a place between two nodes."""
        return 0.0

    def observe(self, points: Float[Array, "*m 3"]) -> Float[Array, "*m 3"]:
        """Points of the centre line (m) as the scanner sees them."""
        return points


def overriding(effects, hook: str) -> tuple:
    """The effects that override ``hook``."""
    return tuple(e for e in effects if getattr(type(e), hook) is not getattr(AbstractEffect, hook))
