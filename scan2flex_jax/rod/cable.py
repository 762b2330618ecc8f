"""The cable: material parameters of the quasi-static Cosserat rod (paper, Section 5.1).

Symbols: strains in material axes, ``Gamma = R^T r' - e3`` (shear about d1, d2, stretch about d3, -) and
``Omega`` with ``hat(Omega) = R^T R'`` (curvature about d1, d2, twist about d3, 1/m); their natural values
``Gamma_0, Omega_0``; stiffness ``K_Gamma = diag(GA1, GA2, EA)`` (N) and ``K_Omega = diag(EI1, EI2, GJ)`` (N m^2).

A cable without ``GA`` and ``EA`` is practically unshearable and inextensible (paper, Section 5.1), by `rigid_stiffness`,
which scales with the load: one fixed value (N) would stretch a heavy cable by more than a scanner's noise.
"""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Float

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.rod.reals import reals

_RIGID = 2.0e6  # times the forces in a cable: displacements below 1e-6 of the length, and six digits left in the tension
_BENDING_FORCES = 50.0  # times EI / L^2: the forces that bend a cable through several radians
_EARTH = 9.81  # m/s^2

Quantity = ArrayLike | Sequence[float]  # anything that becomes an array: a number, a list, an array of numpy or jax


class Cable(eqx.Module):
    """Material parameters, uniform along the cable. Every leaf is a float64 array and differentiable.

    Units are SI: length m, length_density kg/m, shear and axial stiffness N, bending and torsional stiffness N m^2,
    natural curvature 1/m about d1, d2, d3, natural stretch (-) along d1, d2, d3. A single shear or bending stiffness
    stands for both axes. Without ``shear_stiffness`` or ``axial_stiffness`` the cable is practically unshearable or
    inextensible under its own weight on Earth (`rigid_stiffness`).

    Examples:
        >>> cable = Cable(length=1.0, length_density=0.2, bending_stiffness=0.1, torsional_stiffness=0.25)
        >>> cable.bending_stiffness.tolist()
        [0.1, 0.1]
    """

    length: Float[Array, ""]
    length_density: Float[Array, ""]
    bending_stiffness: Float[Array, "2"]
    torsional_stiffness: Float[Array, ""]
    shear_stiffness: Float[Array, "2"]
    axial_stiffness: Float[Array, ""]
    natural_curvature: Float[Array, "3"]
    natural_stretch: Float[Array, "3"]

    def __init__(
        self,
        length: Quantity,
        length_density: Quantity,
        bending_stiffness: Quantity,
        torsional_stiffness: Quantity,
        shear_stiffness: Quantity | None = None,
        axial_stiffness: Quantity | None = None,
        natural_curvature: Quantity = 0.0,
        natural_stretch: Quantity = 0.0,
    ) -> None:
        """Numbers, lists or arrays, broadcast to the shapes of the fields; raises `Scan2FlexError` for anything else."""
        self.length = _array(length, "length", ())
        self.length_density = _array(length_density, "length_density", ())
        self.bending_stiffness = _array(bending_stiffness, "bending_stiffness", (2,))
        self.torsional_stiffness = _array(torsional_stiffness, "torsional_stiffness", ())
        weight = self.length_density * self.length * _EARTH
        rigid = rigid_stiffness(self.length, self.bending_stiffness, weight)
        self.shear_stiffness = _array(rigid if shear_stiffness is None else shear_stiffness, "shear_stiffness", (2,))
        self.axial_stiffness = _array(rigid if axial_stiffness is None else axial_stiffness, "axial_stiffness", ())
        self.natural_curvature = _array(natural_curvature, "natural_curvature", (3,))
        self.natural_stretch = _array(natural_stretch, "natural_stretch", (3,))

    def __check_init__(self):
        require_float64()

    def __repr__(self) -> str:
        """The values; of a traced or batched cable the types and shapes."""
        said = (f"{f.name}={_value(getattr(self, f.name))}" for f in dataclasses.fields(self))
        return f"Cable({', '.join(said)})"


def rigid_stiffness(length: Array, bending_stiffness: Array, force: Array) -> Float[Array, ""]:
    """Shear and axial stiffness (N) of a practically unshearable, inextensible cable: ``2e6 (force + 50 EI / L^2)``.

    ``force`` (N) is the total load: the weight and the forces on the cable. The remaining strain displaces no point by more
    than 1e-6 of the length, unless the cable is taut (tension above twice these forces). The value has no derivative, and
    derivatives of shapes are rounded to about 1e-6: give both stiffnesses before comparing them with finite differences.
    """
    bending = _BENDING_FORCES * jnp.max(bending_stiffness) / length**2
    return jax.lax.stop_gradient(jnp.asarray(_RIGID * (force + bending)))


def _value(leaf: object) -> str:
    """A leaf as a number or a list of them, where it is one."""
    small = isinstance(leaf, jax.Array | np.ndarray) and not isinstance(leaf, jax.core.Tracer) and leaf.size <= 3
    return str(np.asarray(leaf).tolist()) if small else eqx.tree_pformat(leaf)


def _array(value: Quantity, name: str, shape: tuple[int, ...]) -> Array:
    return jnp.broadcast_to(reals(value, f"Cable: {name}", *dict.fromkeys(((), shape))), shape)


def require_float64() -> None:
    """Refuse float32, which cannot hold an axial stiffness of 1e5 N and a bending stiffness of 1e-3 N m^2 in one system."""
    if not jax.config.jax_enable_x64:  # type: ignore[attr-defined]  # jax declares no options
        raise Scan2FlexError(
            "scan2flex_jax computes in float64 only: call jax.config.update('jax_enable_x64', True) before the first array"
            " (or set the environment variable JAX_ENABLE_X64=1)"
        )
