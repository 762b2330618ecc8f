"""Section profile: EI, GJ and mass per length along the cable from a table, as calipers or a data sheet give them.

The rows of ``bending``, ``torsion`` and ``density`` (in any unit) at places ``s`` (m) are relative: EI and GJ of the cable are
those of its middle, and the mass of the whole cable is kept. Between rows their logarithms are linear, beyond the last they are
constant. A study takes it from a file (`[cable] section`, `study.section`); nothing searches for it. Null: even columns.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.entry import CatalogueEntry
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.effects.spans import element_means, grown
from scan2flex_jax.rod.effect import AbstractEffect, Section


class SectionProfile(AbstractEffect):
    """EI and GJ in proportion to ``bending`` and ``torsion`` (-), mass per length to ``density`` (-), at places ``s`` (m)."""

    kind: ClassVar[str] = "section_profile"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "sections along the cable as declared"
    s: Float[Array, " m"] | None = parameter("m", per_point=True, domain="along_cable", estimable=False, default=None)
    bending: Float[Array, " m"] = parameter("-", per_point=True, domain="positive", estimable=False)
    torsion: Float[Array, " m"] = parameter("-", per_point=True, domain="positive", estimable=False)
    density: Float[Array, " m"] = parameter("-", per_point=True, domain="positive", estimable=False)

    def section(self, section: Section, length: Float[Array, ""]) -> Section:
        """Sections with the stiffness and mass of the table."""
        at = jnp.linspace(0.0, 1.0, self.bending.shape[0]) * length if self.s is None else self.s

        def log(values):
            middle = jnp.interp(0.5 * length, at, jnp.log(values))
            return lambda s: jnp.interp(s, at, jnp.log(values)) - middle

        twist = element_means(section, lambda s: jnp.exp(log(self.torsion)(s) - log(self.bending)(s)))
        share = element_means(section, lambda s: jnp.exp(log(self.density)(s)))
        section = grown(section, log(self.bending))
        root = jnp.where(jnp.arange(6) == 5, jnp.sqrt(twist)[:, None], 1.0)
        K = section.stiffness * root[:, :, None] * root[:, None, :]
        return eqx.tree_at(lambda x: (x.stiffness, x.density), section, (K, section.density * share / jnp.mean(share)))


def _tapered(factor, length):
    return SectionProfile(bending=factor, torsion=factor, density=jnp.ones(2), s=jnp.array([0.0, length]))


ENTRY = CatalogueEntry(
    SectionProfile, ("taper",),
    lambda c: np.ones(1),
    build=lambda a, site, c: (_tapered(jnp.exp(jnp.array([-a[0], a[0]])), c.length),),
    searched=False,
    signature="the cable bends where its section is thin",
    settle="measure the section along the cable",
)  # fmt: skip
