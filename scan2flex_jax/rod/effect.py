"""The one extension point: an *effect* is physics that acts on the clamps, on the energy or on the observation.

Elasticity gives the sections of the rod, gravity loads them, and a kink, a clip or a badly read scale do no more than
that: each overrides the hooks it needs and leaves the rest. Hooks are pure JAX functions of the effect's own leaves, so
every parameter of an effect is differentiable, can be unknown in a fit and can be swept with `jax.vmap`; at its null
value an effect leaves the model exactly as it was.

Order of use: `cable`, `clamps`, `section`, `dead_load`, then inside the energy `strain_energy` and `node_potential`, and
after the equilibrium `observe`. Effects are applied in the order in which they are declared.
"""

from typing import ClassVar

import equinox as eqx
from jax import Array
from jaxtyping import Float

from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.cable import Cable


class Section(eqx.Module):
    """The rod's sections, one per element: ``s`` and ``ds`` its middle and length (m), ``stiffness`` the 6x6 matrix
    diag(GA1, GA2, EA, EI1, EI2, GJ) with couplings (N, N m, N m^2), ``natural`` = (Gamma_0, Omega_0) (-, 1/m),
    ``density`` (kg/m). ``within`` (N m^2) is the stiffness against what varies inside an element (`element_law`); None
    stands for that of ``stiffness``, and an effect that lays a spring between two elements keeps the material's."""

    s: Float[Array, " n"]
    ds: Float[Array, ""]
    stiffness: Float[Array, "n 6 6"]
    natural: Float[Array, "n 6"]
    density: Float[Array, " n"]
    within: Float[Array, "n 3 3"] | None = None


class Node(eqx.Module):
    """One node of the rod as `AbstractEffect.node_potential` sees it: position ``r`` (m), rotation ``R``, arc length ``s``
    (m), the length ``weight`` (m) of cable that it stands for, the element length ``ds`` (m), and the supports."""

    r: Float[Array, "3"]
    R: Float[Array, "3 3"]
    s: Float[Array, ""]
    weight: Float[Array, ""]
    ds: Float[Array, ""]
    boundary: Boundary


class AbstractEffect(eqx.Module):
    """Base of all effects; every hook is the identity (or adds nothing) unless an effect overrides it.

    An effect that studies and results name has a ``kind``, the ``place`` where it acts (``clamps``, ``energy`` or
    ``observation``) and ``words`` that say what it is.
    """

    kind: ClassVar[str]
    place: ClassVar[str]
    words: ClassVar[str]

    def cable(self, cable: Cable) -> Cable:
        """The cable with changed parameters."""
        return cable

    def clamps(self, boundary: Boundary) -> Boundary:
        """The supports as they really are."""
        return boundary

    def section(self, section: Section, length: Float[Array, ""]) -> Section:
        """Sections with changed stiffness, natural strain or density."""
        return section

    def dead_load(self, section: Section, gravity: Float[Array, "3"]):
        """Loads that keep their direction: a `rod.loads.DeadLoad`, or None."""
        return

    def strain_energy(self, strain: Float[Array, "6"], stiffness: Float[Array, "6 6"]):
        """Energy per length (J/m) beyond the quadratic one, of the strain in excess of the natural one."""
        return 0.0

    def node_potential(self, node: Node):
        """Energy (J) of one node in an outer field that is not a dead load."""
        return 0.0

    def observe(self, points: Float[Array, "*m 3"]) -> Float[Array, "*m 3"]:
        """Where the scanner sees points of the centre line (m)."""
        return points


def overriding(effects, hook: str) -> tuple:
    """Those of ``effects`` that bring their own ``hook``."""
    return tuple(e for e in effects if getattr(type(e), hook) is not getattr(AbstractEffect, hook))
