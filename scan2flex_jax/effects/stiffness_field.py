"""Stiffness field: EI and GJ vary along the cable, as those of a rod, a stem or a catheter do.

They are ``exp(f(s))`` times those of the cable, ``f`` a smooth curve (natural cubic spline) through ``log_factor`` (-) at
places ``s`` (m), shifted so that it is zero in the middle: the EI and GJ of the cable are those of its middle. The mass per
length goes with the stiffness to the power of ``density_power``, the mass of the whole cable is kept: 0 leaves it even, 1/2 is
that of solid sections of one material. Null: ``log_factor`` the same everywhere.

Where ``log_factor`` is estimated, its prior is that of `geometry.fields.middle_root`: even growth from end to end by any factor
up to some hundreds, and waves about it, smooth over a quarter of the length, by a factor of 1.6.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.entry import CatalogueEntry
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.effects.spans import element_means, grown, spline
from scan2flex_jax.geometry.fields import POINTS, middle_root
from scan2flex_jax.rod.effect import AbstractEffect, Section

_SOLID = 0.5  # density power: EI goes with the fourth power of a solid section's diameter, its mass with the second
_PLACES = np.delete(np.linspace(0.0, 1.0, POINTS), POINTS // 2)  # without the middle, where the field is zero
_ROOT = np.insert(middle_root(_PLACES), POINTS // 2, 0.0, axis=0)


class StiffnessField(AbstractEffect):
    """EI and GJ times ``exp(log_factor)`` (-) at places ``s`` (m), over that of the middle; mass along with them."""

    kind: ClassVar[str] = "stiffness_field"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "stiffness varies along the cable"
    s: Float[Array, " m"] | None = parameter("m", per_point=True, domain="along_cable", estimable=False, default=None)
    log_factor: Float[Array, " m"] = parameter("-", per_point=True, smooth=1.0)
    density_power: Float[Array, ""] = parameter("-", estimable=False, optional=True)

    def section(self, section: Section, length: Float[Array, ""]) -> Section:
        """Sections with the stiffness of the field, and the mass that goes with it."""
        at = jnp.linspace(0.0, 1.0, self.log_factor.shape[0]) * length if self.s is None else self.s
        values = self.log_factor[:, None]

        def field(s):
            curve = spline(jnp.append(s, 0.5 * length), at, values)[:, 0]
            return curve[:-1] - curve[-1]

        share = element_means(section, lambda s: jnp.exp(self.density_power * field(s)))
        section = eqx.tree_at(lambda x: x.density, section, section.density * share / jnp.mean(share))
        return grown(section, field)


ENTRY = CatalogueEntry(
    StiffnessField, tuple(f"component {k + 1}" for k in range(POINTS - 1)),
    size=lambda c: np.ones(POINTS - 1),  # independent components of the field
    build=lambda a, site, c: (StiffnessField(
        log_factor=jnp.asarray(_ROOT) @ a, density_power=jnp.asarray(_SOLID), s=jnp.linspace(0.0, 1.0, POINTS) * c.length,
    ),),
    bounds_of=lambda c: (np.full(POINTS - 1, -20.0), np.full(POINTS - 1, 20.0)),
    varies=True,
    signature="parts of the cable bend more than others, in every pose",
    settle="measure the diameter along the cable",
)  # fmt: skip
