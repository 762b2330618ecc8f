"""Density taper: the mass per length grows from start to end by ``exp(taper (2 s/L - 1))``. ``taper`` (-) is half the
logarithm of the ratio at the two ends; the middle is unchanged. Null: 0.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.entry import CatalogueEntry
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.rod.effect import AbstractEffect, Section


class DensityTaper(AbstractEffect):
    """Mass per length times ``exp(taper (2 s/L - 1))``."""

    kind: ClassVar[str] = "density_taper"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "mass per length grows from start to end"
    taper: Float[Array, ""] = parameter("-")

    def section(self, section: Section, length: Float[Array, ""]) -> Section:
        """Sections with tapered density."""
        factor = jnp.exp(self.taper * (2.0 * section.s / length - 1.0))
        return eqx.tree_at(lambda x: x.density, section, section.density * factor)


ENTRY = CatalogueEntry(
    DensityTaper, ("taper",),
    lambda c: np.array([0.25]),  # half that of the stiffness: EI of a solid section goes with the square of its mass
    bounds_of=lambda c: (np.full(1, -3.0), np.full(1, 3.0)),
    signature="the lowest point lies towards one end of the cable, whichever way round it hangs",
    settle="find the cable's centre of mass on an edge",
)  # fmt: skip
