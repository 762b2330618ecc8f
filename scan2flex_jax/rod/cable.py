"""The cable: material parameters of the quasi-static Cosserat rod (paper, Section 5.1).

Symbols: strains in material axes, ``Gamma = R^T r' - e3`` (shear about d1, d2, stretch about d3, -) and
``Omega`` with ``hat(Omega) = R^T R'`` (curvature about d1, d2, twist about d3, 1/m); their natural values
``Gamma_0, Omega_0``; stiffness ``K_Gamma = diag(GA1, GA2, EA)`` (N) and ``K_Omega = diag(EI1, EI2, GJ)`` (N m^2).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from scan2flex_jax.errors import Scan2FlexError

NEARLY_RIGID = 1.0e5  # N: shear and axial stiffness of a cable seen to be nearly inextensible (paper, Section 5.1)


def _as(shape):
    return lambda x: jnp.broadcast_to(jnp.asarray(x, float), shape)


class Cable(eqx.Module):
    """Material parameters, uniform along the cable. Every leaf is a float64 array and differentiable.

    Units are SI: length m, length_density kg/m, shear and axial stiffness N, bending and torsional stiffness N m^2,
    natural curvature 1/m about d1, d2, d3, natural stretch (-) along d1, d2, d3. A single shear or bending stiffness
    stands for both axes.
    """

    length: Float[Array, ""] = eqx.field(converter=_as(()))
    length_density: Float[Array, ""] = eqx.field(converter=_as(()))
    bending_stiffness: Float[Array, "2"] = eqx.field(converter=_as((2,)))
    torsional_stiffness: Float[Array, ""] = eqx.field(converter=_as(()))
    shear_stiffness: Float[Array, "2"] = eqx.field(converter=_as((2,)), default=NEARLY_RIGID)
    axial_stiffness: Float[Array, ""] = eqx.field(converter=_as(()), default=NEARLY_RIGID)
    natural_curvature: Float[Array, "3"] = eqx.field(converter=_as((3,)), default=0.0)
    natural_stretch: Float[Array, "3"] = eqx.field(converter=_as((3,)), default=0.0)

    def __check_init__(self):
        require_float64()


def require_float64() -> None:
    """Refuse single precision: an axial stiffness of 1e5 N beside a bending stiffness of 1e-3 N m^2 leaves it no digits."""
    if not jax.config.jax_enable_x64:  # type: ignore[attr-defined]  # jax declares no options
        raise Scan2FlexError(
            "scan2flex_jax computes in float64 only: call jax.config.update('jax_enable_x64', True) before the first array"
            " (or set the environment variable JAX_ENABLE_X64=1)"
        )
