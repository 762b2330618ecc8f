"""MoorDyn v2, and CableDyn, which reads its decks: the cable as a row of LINE TYPES.

MoorDyn's lines bend, but neither twist nor carry compression: GJ is only in a comment, and the row is for cables that hang in
tension. Hydrodynamic coefficients are zero, for air. Source: MoorDyn documentation, *The V2 Input File*, Line Types.
"""

import re

import numpy as np

from scan2flex_jax.export.cable import GIVES, HungCable, printable

HOLDS = frozenset({GIVES})


def to_moordyn(cable: HungCable) -> str:
    """The section as text; raises `Scan2FlexError` for a cable that is no uniform, straight, isotropic line."""
    cable.require("MoorDyn", HOLDS)
    K, name = np.diag(cable.stiffness[0]), re.sub(r"[^\w.-]+", "_", cable.title).strip("_")[:60] or "cable"
    values = (2.0 * cable.drawn_radius, cable.density[0], K[2], -1.0, K[3], 0.0, 0.0, 0.0, 0.0)
    said = (f"length {cable.length:.9g} m; GJ {K[5]:.9g} N m^2, which MoorDyn does not use; no compression", *cable.remarks)
    lines = [
        "---------------------- LINE TYPES ----------------------",
        "TypeName Diam Mass/m EA BA/-zeta EI Cd Ca CdAx CaAx",
        "(name) (m) (kg/m) (N) (N-s/-) (N-m^2) (-) (-) (-) (-)",
        f"{name} {' '.join(f'{v:.9g}' for v in values)}  # {printable('; '.join(said))}",  # a table has no lines of comment
    ]
    return "\n".join(lines) + "\n"
