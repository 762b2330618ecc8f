"""The cable as a material: moduli that give its stiffness in a program that takes a solid circle of its outer diameter.

CATIA, Isaac Lab, SOFA's BeamAdapter and others take a diameter and a Young's modulus. One modulus cannot give bending and
stretch of a cable, whose wires slide: ``E_bend = 4 EI/(pi r^4)`` is the one for shapes, ``E_stretch = EA/(pi r^2)``.

The cable of Ansys Motion is a beam of one isotropic material whose stiffness is multiplied by three factors (Ansys Motion 2025
R1, Beta Features, 14.1 *Cable Definition*): ``motion_...`` for a material of ``E_stretch`` and Poisson's ratio `_RATIO`.
"""

import numpy as np

from scan2flex_jax.export.cable import GIVES, HungCable, printable

_RATIO = 0.3
_ROWS = (
    ("diameter", "m", "outer diameter"),
    ("length", "m", "length"),
    ("density", "kg/m^3", "mass per length over the area of the outer diameter"),
    ("E_bend", "Pa", "Young's modulus for bending, 4 EI/(pi r^4)"),
    ("G_twist", "Pa", "shear modulus for twist, 2 GJ/(pi r^4)"),
    ("E_stretch", "Pa", "Young's modulus for stretch, EA/(pi r^2)"),
    ("G_shear", "Pa", "shear modulus for shear, GA/(pi r^2)"),
    ("poisson_ratio", "-", "E_bend/(2 G_twist) - 1; rarely that of a material: give E and G where both are taken"),
    ("motion_bar", "-", f"Ansys Motion, Bar Scale Factor for a material of E_stretch and Poisson's ratio {_RATIO}"),
    ("motion_bending", "-", "its Bending Scale Factor"),
    ("motion_torsional", "-", "its Torsional Scale Factor"),
)


def moduli(cable: HungCable) -> dict[str, float]:
    """Diameter, density and moduli by name; raises `Scan2FlexError` for a cable that is no uniform, straight, isotropic rod."""
    cable.require("a material", frozenset({GIVES}))
    r, K = cable.drawn_radius, np.diag(cable.softened[0])
    area, bend, twist = np.pi * r**2, 4.0 * K[3] / (np.pi * r**4), 2.0 * K[5] / (np.pi * r**4)
    stretch, ratio = K[2] / area, bend / (2.0 * twist) - 1.0
    factors = (1.0, bend / stretch, 2.0 * (1.0 + _RATIO) * twist / stretch)
    values = (2.0 * r, cable.length, cable.density[0] / area, bend, twist, stretch, K[0] / area, ratio, *factors)
    return {name: float(v) for (name, _, _), v in zip(_ROWS, values, strict=True)}


def to_moduli(cable: HungCable) -> str:
    """The moduli as a table, one ``name = value  # unit: meaning`` a line (valid TOML)."""
    values = moduli(cable)
    lines = [f"# {printable(line)}" for line in (cable.title, *cable.remarks)]
    return "\n".join([*lines, *(f"{name} = {values[name]:.9g}  # {unit}: {said}" for name, unit, said in _ROWS)]) + "\n"
