"""Plain JSON: the stiffness matrices of every element, natural strain, density, and the shape in every solved pose."""

import json

import numpy as np
from scipy.spatial.transform import Rotation

from scan2flex_jax.export.cable import HungCable
from scan2flex_jax.version import __version__

FORMAT = "scan2flex-cable/1"
_MEANING = {
    "units": "SI: m, kg, N, rad; stiffness in N (shear along d1, d2, stretch along d3) and N m^2 (bending about d1, d2, twist)",
    "stiffness": "one 6x6 matrix per element: [force, moment] = K ([Gamma, Omega] - natural_strain), in material axes",
    "quaternion": "scalar first, turns material vectors into the scan frame; d3 is the tangent",
    "held": "1 where the support of start and end prevents a motion: three translations, three rotations",
    "beyond": "effects that stiffness, natural strain and density do not represent; a simulator must add them",
    "effects": "all effects of the cable and its scans with their parameters, as study.toml declares them (SI; null: infinite)",
    "remarks": "assumptions, and effects left out of the numbers above",
}


def to_json(cable: HungCable) -> str:
    """The cable as JSON text."""
    mid = 0.5 * (cable.s[1:] + cable.s[:-1])
    quaternion = Rotation.from_matrix(cable.rotation).as_quat(scalar_first=True)
    found = {
        "format": FORMAT,
        "scan2flex_jax": __version__,
        "title": cable.title,
        "meaning": _MEANING,
        "length": cable.length,
        "gravity": cable.gravity.tolist(),
        **({} if cable.radius is None else {"radius": cable.radius}),
        "elements": {
            "s": mid.tolist(),
            "density": cable.density.tolist(),
            "natural_strain": cable.natural.tolist(),
            "stiffness": cable.stiffness.tolist(),
        },
        "pose": {
            "name": cable.pose,
            "held": cable.held.tolist(),
            "s": cable.s.tolist(),
            "position": cable.position.tolist(),
            "quaternion": quaternion.tolist(),
        },
        "beyond": list(cable.beyond),
        "effects": [{"kind": kind, **{k: _plain(v) for k, v in given.items()}} for kind, given in cable.effects],
        "remarks": cable.remarks if cable.radius is not None else cable.remarks[1:],
    }
    return json.dumps(found, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _plain(value):
    """A number or an array for JSON: null for an infinite one."""
    return [_plain(v) for v in value] if np.ndim(value) else float(value) if np.isfinite(value) else None
