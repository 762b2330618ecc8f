"""Sections along the cable from a table: `[cable] section = "section.csv"`.

The CSV has a column ``s`` (m) and any of ``bending_stiffness`` (N m^2), ``torsional_stiffness`` (N m^2) and ``length_density``
(kg/m), or what calipers give: ``diameter`` of a solid circle, with ``inner_diameter`` of a tube, or ``across_flats`` of a
hexagon (m), of which stiffness goes with the fourth and mass with the second power. A quantity that `[cable]` states, or that
is unknown, scales its column, which is then relative to the middle of the cable (the mass: to its mean); else the column is
absolute.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from scan2flex_jax.study.curves import read_csv
from scan2flex_jax.study.model import EffectDeclaration
from scan2flex_jax.study.values import Where

_STATED = {"bending_stiffness": "bending", "torsional_stiffness": "torsion", "length_density": "density"}
_HEADERS = ("s,bending_stiffness", "s,diameter", "s,bending_stiffness,torsional_stiffness",
            "s,bending_stiffness,torsional_stiffness,length_density", "s,bending_stiffness,length_density",
            "s,torsional_stiffness", "s,torsional_stiffness,length_density", "s,length_density", "s,diameter,inner_diameter",
            "s,across_flats")  # fmt: skip


def sections(
    path: Path, where: Where, cable: dict[str, Any], unknown: Iterable[str]
) -> tuple[EffectDeclaration, dict[str, Any]]:
    """The sections of a file as an effect, and `[cable]` with the values that it gives absolutely; ``unknown``: names below
    `[unknown]`."""
    names, table = read_csv(path, _HEADERS, where)
    columns = {name: table[:, i] for i, name in enumerate(names)}
    s = columns.pop("s")
    if len(s) < 2 or np.any(np.diff(s) <= 0.0):
        raise where.at("s").fail("its arc lengths do not grow: write two rows or more, from start to end.")
    for name, values in columns.items():
        if not np.all(np.isfinite(values)) or np.any(values <= 0.0):
            raise where.at(name).fail("it has a value that is not positive: write positive numbers.")
    if np.any(columns.get("inner_diameter", np.zeros(1)) >= columns.get("diameter", np.inf)):
        raise where.at("inner_diameter").fail("the tube is wider inside than outside: exchange the columns.")
    found = {_STATED[name]: values for name, values in columns.items() if name in _STATED}
    outer = columns.get("diameter", columns.get("across_flats"))
    if outer is not None:  # sections of one material, up to a factor
        inner = columns.get("inner_diameter", np.zeros_like(outer))
        found = {"bending": outer**4 - inner**4, "density": outer**2 - inner**2}
    even = np.ones(len(s))
    profile = {"bending": found.get("bending", even), "density": found.get("density", even)}
    profile |= {"torsion": found.get("torsion", profile["bending"])}
    length, stated = cable.get("length"), {*cable, *unknown}
    for name in (name for name in columns if name in _STATED and name not in stated):
        if length is None:
            raise where.at(name).fail(f"its size needs the length of the cable: state length, or {name}, under [cable].")
        fine = np.linspace(0.0, length, 2001)
        along = np.exp(np.interp(fine, s, np.log(columns[name])))
        cable = {**cable, name: float(np.trapezoid(along, fine) / length if name == "length_density" else along[1000])}
    return EffectDeclaration("section_profile", {"s": s, **profile}), cable
