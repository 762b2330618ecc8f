"""A MuJoCo model: a chain of rigid links with springs in their joints, hanging in one pose.

Links are as in `export.cable`: link k is centred on node k; its body has the axes d1, d2, d3. A joint is three hinges with
the stiffness EI1/ds, EI2/ds, GJ/ds; their spring references give the natural curvature. Angles of successive hinges differ
from the rotation vector by half their products: alternating the orders x, y, z and z, y, x from joint to joint cancels that
difference, and shapes stay of second order. Hinges are read by every version of MuJoCo (the cable plugin was removed in 4.0).

The model as loaded hangs in our equilibrium: bodies are placed there, and ``ref`` counts the angles of their hinges from the
straight cable. The axis of a hinge is given in the axes of the placed body, which the later hinges of the joint have turned.

Stretch and shear are rigid; a cable that stretches is refused. The end is a weld to the world, soft as all constraints
of MuJoCo are; ``solimp`` makes it nearly as stiff as possible. Armature keeps the joints stable at the model's timestep, and
damping lets the cable settle; neither changes the equilibrium, and dynamics are not calibrated. Contact is disabled: it is not
modelled.
"""

import xml.etree.ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from scan2flex_jax.export.cable import BENDINGS, CURVED, DENSITY, MASSES, NATURAL, SHEARS, STIFFNESS, HungCable, printable

HOLDS = frozenset({BENDINGS, CURVED, DENSITY, MASSES, NATURAL, SHEARS, STIFFNESS})

_STEP = 1e-3  # s
_STABLE = 16.0  # armature over stiffness times step^2: the fastest mode of a chain of such joints then turns by 0.5 rad a step
_SETTLE = 0.05  # s, in which the strain of a joint decays
_ORDERS = ("XYZ", "ZYX")  # intrinsic, as hinges of one body follow each other


def to_mujoco(cable: HungCable) -> str:
    """The model as XML text; raises `Scan2FlexError` for a cable that such a chain cannot represent."""
    cable.require("MuJoCo", HOLDS, ball_joints=False)
    ds = cable.element_length
    root = ET.Element("mujoco", model=_printable(cable.title or "cable"))
    for remark in (f"loaded in pose {cable.pose}; armature and damping are not calibrated", *cable.remarks):
        root.append(ET.Comment(_printable(f" {remark} ")))
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    ET.SubElement(
        root, "option", gravity=_text(cable.gravity), timestep=f"{_STEP:g}", integrator="implicitfast", solver="Newton"
    )
    world = ET.SubElement(root, "worldbody")
    links = list(Rotation.from_matrix(cable.rotation))
    start = cable.position[0] - 0.5 * ds * cable.rotation[0, :, 2]
    body = ET.SubElement(world, "body", name="link0", pos=_text(start), quat=_quaternion(links[0]))
    _link(body, 0, cable)
    for k in range(1, cable.elements + 1):
        turn = links[k - 1].inv() * links[k]
        body = ET.SubElement(body, "body", name=f"link{k}", pos=_text([0, 0, ds]), quat=_quaternion(turn))
        _joints(body, k, cable, turn)
        _link(body, k, cable)
    if cable.held[1, 0]:
        ET.SubElement(body, "site", name="end", pos=_text([0, 0, 0.5 * ds]))
        ET.SubElement(world, "site", name="clamp", pos=_text(cable.position[-1]), quat=_quaternion(links[-1]))
        hard = {"solref": f"{2 * _STEP:g} 1", "solimp": "0.9999 0.9999 0.001 0.5 2"}
        ET.SubElement(ET.SubElement(root, "equality"), "weld", {"site1": "end", "site2": "clamp", **hard})
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _joints(body, k, cable, turn):
    """Add the three hinges before link k, with the stiffness of their element, at their angles in the pose."""
    order, ds = _ORDERS[k % 2], cable.element_length
    stiffness = dict(zip("XYZ", np.diag(cable.stiffness[k - 1])[3:] / ds, strict=True))
    armature = _STABLE * float(np.max(cable.stiffness[:, [3, 4, 5], [3, 4, 5]])) / ds * _STEP**2
    relaxed = Rotation.from_rotvec(ds * cable.natural[k - 1, 3:]).as_euler(order)
    angles = turn.as_euler(order)
    for i, (axis, angle, spring) in enumerate(zip(order, angles, relaxed, strict=True)):
        numbers = {
            "stiffness": stiffness[axis], "damping": _SETTLE * stiffness[axis], "springref": spring, "ref": angle,
            "armature": armature,
        }  # fmt: skip
        behind = Rotation.from_euler(order[i + 1 :], angles[i + 1 :]) if order[i + 1 :] else Rotation.identity()
        unit = _text(behind.inv().apply([float(axis == name) for name in "XYZ"]))
        written = {key: repr(float(value)) for key, value in numbers.items()}
        ET.SubElement(body, "joint", {"type": "hinge", "name": f"joint{k}{axis.lower()}", "axis": unit, **written})


def _link(body, k, cable):
    """Add the geometry and mass of a link, half of it at the ends, and the point masses on it."""
    ds, last = cable.element_length, cable.elements
    low, high = (0.5 * ds if k == 0 else 0.0), (0.5 * ds if k == last else ds)
    ends = _text([0, 0, low, 0, 0, high])
    density = np.mean(cable.density[max(k - 1, 0) : k + 1])
    none = {"contype": "0", "conaffinity": "0"}
    size, mass = repr(float(cable.drawn_radius)), repr(float(density * (high - low)))
    ET.SubElement(body, "geom", {"type": "capsule", "size": size, "fromto": ends, "mass": mass, **none})
    for place, hung in cable.masses:
        if round(place / ds) == k:
            at = _text([0, 0, place - (k - 0.5) * ds])
            ET.SubElement(body, "geom", {"type": "sphere", "size": size, "pos": at, "mass": repr(float(hung)), **none})


def _quaternion(rotation) -> str:
    return _text(rotation.as_quat(scalar_first=True))


def _text(values) -> str:
    return " ".join(repr(float(v) + 0.0) for v in values)


def _printable(text: str) -> str:
    """Text valid in XML: no control characters, and no end of a comment."""
    return printable(text).replace("--", "- -").rstrip("-")[:200]
