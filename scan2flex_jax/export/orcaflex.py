"""OrcaFlex: line types and a line of sections in a text data file (YAML), one section for each run of equal sections.

Units are OrcaFlex's SI: m, te, kN. The line is straight at rest; its ends, drag and environment are those of the model that
the file is read into. Source: OrcaFlex 11.6 help, *Text data files*, *Line type data*.
"""

import json

import numpy as np

from scan2flex_jax.export.cable import BENDINGS, DENSITY, GIVES, STIFFNESS, HungCable, printable

HOLDS = frozenset({BENDINGS, DENSITY, GIVES, STIFFNESS})
_KILO = 1e-3  # kN of N, te of kg


def to_orcaflex(cable: HungCable) -> str:
    """The line types as YAML; raises `Scan2FlexError` for a cable that they cannot represent."""
    cable.require("OrcaFlex", HOLDS)
    title, ds = printable(cable.title or "cable"), cable.element_length
    names = [f"{title} {k}" for k in range(1, len(cable.runs) + 1)]
    lines = [f"# {remark}" for remark in ("units: m, te, kN, kN m^2, te/m", *cable.remarks)]
    lines += ["UnitsSystem: SI", "LineTypes:"]
    for name, run in zip(names, cable.runs, strict=True):
        K = _KILO * np.diag(cable.stiffness[run.start])
        values = {
            "Category": "General", "OD": 2.0 * cable.drawn_radius, "ID": 0.0,
            "MassPerUnitLength": _KILO * cable.density[run.start], "EIx": K[3], "EIy": K[4], "EA": K[2], "GJ": K[5],
        }  # fmt: skip
        lines.append(f"  - Name: {json.dumps(name)}")
        lines += [f"    {key}: {v if isinstance(v, str) else f'{v:.9g}'}" for key, v in values.items()]
    lines += ["Lines:", f"  - Name: {json.dumps(title)}", "    IncludeTorsion: Yes"]
    lines.append("    LineType, Length, TargetSegmentLength:")
    for name, run in zip(names, cable.runs, strict=True):
        lines.append(f"      - [{json.dumps(name)}, {ds * (run.stop - run.start):.9g}, {ds:.9g}]")
    return "\n".join(lines) + "\n"
