"""Abaqus: the unloaded cable as a mesh of beams with `*BEAM GENERAL SECTION`, one element set for each run of equal sections.

Nodes are on the unloaded curve, so that a natural curvature is in the geometry. ``A`` is the area of the drawn radius; moduli
``E = EA/A``, ``G = GA/A`` and moments ``I = EI/E``, ``J = GJ/G`` give the calibrated stiffness, and ``DENSITY`` the mass per
length. A moment law that is not linear takes ``SECTION=NONLINEAR GENERAL`` with tables of moment over curvature or twist
(``*M1``, ``*M2``, ``*TORQUE``), elastic, and odd in their strain. Abaqus applies a law to each bending axis by itself, ours to
the curvature in any direction: both agree where a pose bends in one plane.

Source: Abaqus Keywords Guide 2024, *BEAM GENERAL SECTION, *M1, *TORQUE, *TRANSVERSE SHEAR STIFFNESS, *MASS.
"""

import numpy as np

from scan2flex_jax.export.cable import BENDINGS, CURVED, DENSITY, GIVES, LAWS, MASSES, NATURAL, STIFFNESS, HungCable, printable
from scan2flex_jax.export.usd import unloaded

HOLDS = frozenset({BENDINGS, CURVED, DENSITY, GIVES, MASSES, NATURAL, STIFFNESS, *LAWS})


def to_abaqus(cable: HungCable) -> str:
    """The mesh and its sections as text of an input file; raises `Scan2FlexError` for a cable that they cannot represent."""
    curved = bool(np.any(cable.natural[:, 3:5]))
    cable.require("Abaqus", HOLDS - {BENDINGS} if curved else HOLDS)
    rest = unloaded(cable)
    tangents = 0.5 * (rest[1:, :, 2] + rest[:-1, :, 2])
    steps = cable.element_length * tangents / np.linalg.norm(tangents, axis=1, keepdims=True)
    nodes = np.concatenate([cable.position[:1], cable.position[0] + np.cumsum(steps, axis=0)])
    lines = [f"** {printable(cable.title)}: the unloaded cable; units N, m, kg, s", *(f"** {r}" for r in cable.remarks)]
    lines += ["*NODE, NSET=CABLE", *(f"{k + 1}, {_row(r)}" for k, r in enumerate(nodes))]
    for number, run in enumerate(cable.runs, 1):
        name = f"CABLE-{number}"
        lines.append(f"*ELEMENT, TYPE=B31, ELSET={name}")
        lines += [f"{k + 1}, {k + 1}, {k + 2}" for k in range(run.start, run.stop)]
        lines += _section(cable, run, name, rest[0, :, 0])
    for k, mass in enumerate(cable.point_masses):
        if mass:
            lines += [f"*ELEMENT, TYPE=MASS, ELSET=MASS-{k + 1}", f"{cable.elements + k + 1}, {k + 1}"]
            lines += [f"*MASS, ELSET=MASS-{k + 1}", _row([mass])]
    return "\n".join(lines) + "\n"


def _section(cable, run, name, axis):
    """The section of one element set; ``axis`` is d1, the first axis of the section."""
    K, area = np.diag(cable.stiffness[run.start]), np.pi * cable.drawn_radius**2
    E, G = K[2] / area, K[0] / area
    of_section = [area, K[3] / E, 0.0, K[4] / E, K[5] / G]
    density = f"{cable.density[run.start] / area:.9g}"
    shear = ["*TRANSVERSE SHEAR STIFFNESS", _row([K[0], K[1]])]
    if not cable.laws:
        head = f"*BEAM GENERAL SECTION, ELSET={name}, SECTION=GENERAL, DENSITY={density}"
        return [head, _row(of_section), _row(axis), _row([E, G]), *shear]
    head = f"*BEAM GENERAL SECTION, ELSET={name}, SECTION=NONLINEAR GENERAL, DENSITY={density}"
    laws = {"M1": ("bending", K[3]), "M2": ("bending", K[4]), "TORQUE": ("twist", K[5])}
    lines = [head, _row(of_section), _row(axis), "*AXIAL, LINEAR", _row([K[2]])]
    for keyword, (law, stiffness) in laws.items():
        if law in cable.laws:
            q, m = cable.laws[law][0], cable.laws[law][1][run.start]
            lines.append(f"*{keyword}, ELASTIC")
            lines += [_row(pair) for pair in zip(np.r_[-m[:0:-1], m], np.r_[-q[:0:-1], q], strict=True)]
        else:
            lines += [f"*{keyword}, LINEAR", _row([stiffness])]
    return [*lines, *shear]


def _row(values) -> str:
    return ", ".join(f"{float(v) + 0.0:.9g}" for v in values)
