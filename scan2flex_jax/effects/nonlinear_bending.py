"""Nonlinear bending: the section softens beyond a curvature of slip (wires that slide on each other, a textile).

Moment ``EI k [ratio + (1 - ratio)/sqrt(1 + (k/slip)^2)]`` along the curvature vector, with the curvature k (1/m) in
excess of the natural one, ``slip_curvature`` (1/m), and ``ratio`` (-) of the stiffness far above the slip curvature to
that below it. The energy in addition to the quadratic one, with ``u = (k/slip)^2``, is

``EI (1 - ratio) [slip^2 (sqrt(1 + u) - 1) - k^2/2] = -1/2 EI (1 - ratio) slip^2 (u/(1 + sqrt(1 + u)))^2``,

even in k and free of cancellation. With two bending stiffnesses ``k' K k`` replaces ``EI k^2``. Null: ratio 1.
"""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.entry import CatalogueEntry, SameShapes
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.rod.effect import AbstractEffect


class NonlinearBending(AbstractEffect):
    """Softening above ``slip_curvature`` (1/m) down to ``ratio`` (-) of the initial stiffness."""

    kind: ClassVar[str] = "nonlinear_bending"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "bending softens beyond a curvature of slip"
    slip_curvature: Float[Array, ""] = parameter("1/m", domain="positive")
    ratio: Float[Array, ""] = parameter("-", domain="nonnegative")

    def strain_energy(self, strain: Float[Array, "6"], stiffness: Float[Array, "6 6"]) -> Float[Array, ""]:
        """Energy per length (J/m) in addition to the quadratic one."""
        bending, curvature = stiffness[3:5, 3:5], strain[3:5]
        EI = 0.5 * (bending[0, 0] + bending[1, 1])
        u = curvature @ bending @ curvature / (EI * self.slip_curvature**2)
        soft = u / (1.0 + jnp.sqrt(1.0 + u))
        return -0.5 * EI * (1.0 - self.ratio) * (self.slip_curvature * soft) ** 2


_SLIPS = np.geomspace(0.1, 2.0, 7)  # of the largest curvature: thresholds of slip to scan
_LOOSE = 0.5  # part of the bending stiffness that slip removes


def _most_bent(c):
    """Largest curvature (1/m) of the shapes; a small one if they are straight."""
    return max(c.curvature_range[1], 0.1 / c.length)


def _loose_wires(a, site, c, places):
    """Further start after a strongly softening law: stiff cores that slip early, equally stiff at the largest curvature."""
    most = _most_bent(c)

    def secant(lost, slip):
        return 1.0 - lost + lost * min(slip / most, 1.0)

    if a[0] < _LOOSE:
        return []
    early = {"slip_curvature": 0.2 * most}
    return [(np.array([0.9]), early, {"bending_stiffness": secant(a[0], site["slip_curvature"]) / secant(0.9, 0.2 * most)})]


ENTRY = CatalogueEntry(
    NonlinearBending, ("1 - ratio",),
    lambda c: np.array([0.5]),  # between a slight slip and loose wires, both of which are common
    build=lambda a, site, c: (NonlinearBending(site["slip_curvature"], 1.0 - a[0]),),
    sites=lambda c: tuple({"slip_curvature": k} for k in _SLIPS * _most_bent(c)),
    moving={"slip_curvature": lambda c: (0.2 * (_SLIPS[0] * _most_bent(c)), _SLIPS[-1] * _most_bent(c))},
    one_sided=(True,), bounds_of=lambda c: (np.zeros(1), np.ones(1)), other_starts=_loose_wires,
    signature="strongly bent poses look softer than gently bent ones; the misfit sits where the cable is bent most",
    settle="scan poses whose largest curvature is well below and well above the slip curvature",
    same_shapes=(SameShapes("bending_stiffness", "a slip curvature far above or far below all curvatures"),),
)  # fmt: skip
