"""MoorDyn v2 and CableDyn: the cable as a row of LINE TYPES.

MoorDyn's lines bend, but neither twist nor carry compression: GJ is only in a comment, and the row is for cables that hang in
tension. Hydrodynamic coefficients are zero, for air. CableDyn reads the row of MoorDyn too, and assumes ``GJ = EI/1.3`` there;
its own row of 14 columns has GA and GJ, and rotary inertias per length, here those of a full circle. Its coupling of tension
and twist (``GJ|K``, since 0.4) is not written: how it defines ``K`` was found in no document.

Sources: MoorDyn documentation, *The V2 Input File*, Line Types; CableDyn, *Deck format reference*, LINE TYPES.
"""

import re

import numpy as np

from scan2flex_jax.export.cable import GIVES, HungCable, printable

HOLDS = frozenset({GIVES})


def to_moordyn(cable: HungCable) -> str:
    """The section as text; raises `Scan2FlexError` for a cable that is no uniform, straight, isotropic line."""
    cable.require("MoorDyn", HOLDS)
    K = np.diag(cable.stiffness[0])
    values = (2.0 * cable.drawn_radius, cable.density[0], K[2], -1.0, K[3], 0.0, 0.0, 0.0, 0.0)
    said = (f"length {cable.length:.9g} m; GJ {K[5]:.9g} N m^2, which MoorDyn does not use; no compression", *cable.remarks)
    head = "Diam Mass/m EA BA/-zeta EI Cd Ca CdAx CaAx", "(m) (kg/m) (N) (N-s/-) (N-m^2) (-) (-) (-) (-)"
    return _table(cable.title, *head, values, said)


def to_cabledyn(cable: HungCable) -> str:
    """The section as text with GA and GJ; raises `Scan2FlexError` as `to_moordyn`."""
    cable.require("CableDyn", HOLDS)
    K, d, m = np.diag(cable.stiffness[0]), 2.0 * cable.drawn_radius, cable.density[0]
    values = (d, m, K[2], -1.0, K[3], K[0], K[5], m * d**2 / 16.0, m * d**2 / 8.0, 0.0, 0.0, 0.0, 0.0)
    head = (
        "Diam MassDenInAir EA BA EI GAs GJ Irt Irn Cd_n Cd_t Ca_n Ca_t",
        "(m) (kg/m) (N) (-) (N-m2) (N) (N-m2) (kg-m) (kg-m) (-) (-) (-) (-)",
    )
    return _table(cable.title, *head, values, (f"length {cable.length:.9g} m", *cable.remarks))


def _table(title, columns, units, values, said):
    name = re.sub(r"[^\w.-]+", "_", title).strip("_")[:60] or "cable"
    lines = [
        "---------------------- LINE TYPES ----------------------", f"TypeName {columns}", f"(name) {units}",
        f"{name} {' '.join(f'{v:.9g}' for v in values)}  # {printable('; '.join(said))}",  # a table has no lines of comment
    ]  # fmt: skip
    return "\n".join(lines) + "\n"
