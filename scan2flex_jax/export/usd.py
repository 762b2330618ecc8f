"""An OpenUSD file: the cable as a curve deformable, which Newton imports as a rod, hanging in one pose.

The prim ``/World/Cable`` is a linear `BasisCurves` with the schemas of the AOUSD proposal for deformable physics
(`PhysicsCurvesDeformableSimAPI`, `PhysicsCurvesDeformableMaterialAPI`): Newton converts it to a chain of capsules joined by
springs of EA/ds, GA/ds, EI/ds, GJ/ds. No release of OpenUSD registers these schemas yet; Newton reads them by name.

The curve's segments are the links of `export.cable`: segment k is centred on node k, so the curve begins and ends half an
element beyond the cable. Normals are d2: a body of Newton then has the axes d1, d2, d3. ``restShapePoints`` and
``restNormals`` give the unloaded cable with its natural curvature; ``masses`` are those of the segments, in kg.

A support ties sites of the end segment to bodies that do not move, each by a `PhysicsAttachment`. Three sites, one of them off
the axis, make a clamp; one makes a ball joint. Newton's importer makes a ball joint of each, and warns of two between the same
bodies; the world counts as one, to which it ties the cable's first link by a free joint: hence a body for each site. Units are
SI, as the stage metadata and the doc of attributes state.
"""

import json

import numpy as np
from scipy.spatial.transform import Rotation

from scan2flex_jax.export.cable import CURVED, DENSITY, GIVES, MASSES, NATURAL, HungCable, printable

HOLDS = frozenset({CURVED, DENSITY, GIVES, MASSES, NATURAL})
_TANGENT, _NORMAL = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
_UNITS = {"curvesStretchStiffness": "EA, N", "curvesShearStiffness": "GA, N", "curvesBendStiffness": "EI, N m^2",
          "curvesTwistStiffness": "GJ, N m^2"}  # fmt: skip
_CLOSING = 50  # iterations that close the chain, each of which leaves a small part of the gap
_SINGLE = 3.0e38  # largest number of a USD float


def to_usd(cable: HungCable) -> str:
    """The stage as USDA text; raises `Scan2FlexError` for a cable that is not a uniform, isotropic curve deformable."""
    cable.require("USD", HOLDS)
    K = cable.softened[0]
    values = dict(zip(_UNITS, (K[2, 2], K[0, 0], K[3, 3], K[5, 5]), strict=True))
    points, rest = closed(cable), unloaded(cable)
    lines = [
        *_head(cable), *_scene(cable.gravity), *_material(values), *_supports(cable),
        *_prim(
            'def BasisCurves "Cable"',
            [
                'uniform token type = "linear"',
                'uniform token wrap = "nonperiodic"',
                f"int[] curveVertexCounts = [{len(points)}]",
                f"point3f[] points = {_tuples(points)}",
                f'normal3f[] normals = {_tuples(_normals(cable.rotation))} (\n    interpolation = "vertex"\n)',
                f'float[] widths = [{_number(2.0 * cable.drawn_radius)}] (\n    interpolation = "constant"\n)',
                f"float3[] extent = {_tuples(_extent(points, cable.drawn_radius))}",
                "rel material:binding:physics = </World/CableMaterial>",
                f"point3f[] physics:restShapePoints = {_tuples(rest_points(cable, rest))}",
                f"normal3f[] physics:restNormals = {_tuples(_normals(rest))}",
                f"float[] physics:masses = [{', '.join(map(_number, cable.link_masses))}]",
                'uniform token physics:masses:elementType = "segment"',
                f"float[] physics:thicknesses = [{_number(2.0 * cable.drawn_radius)}]",
                'uniform token physics:thicknesses:elementType = "constant"',
            ],
            schemas=("PhysicsCurvesDeformableSimAPI", "MaterialBindingAPI"),
        ),
        "}",
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def _head(cable):
    """Stage metadata, with title, pose and assumptions as documentation."""
    axis = "Y" if abs(cable.gravity[1]) > np.max(np.abs(cable.gravity[[0, 2]])) else "Z"
    said = [f"{cable.title}: pose {cable.pose}, begun in equilibrium. Units are SI: m, kg, s, N, N m^2.", *cable.remarks]
    return [
        "#usda 1.0", "(", '    defaultPrim = "World"', f"    doc = {json.dumps(printable(' '.join(said)))}",
        "    kilogramsPerUnit = 1", "    metersPerUnit = 1", f'    upAxis = "{axis}"', ")", "",
        'def Xform "World"', "{",
    ]  # fmt: skip


def _scene(gravity):
    size = float(np.linalg.norm(gravity))
    down = gravity / size if size else np.array([0.0, 0.0, -1.0])
    return _prim(
        'def PhysicsScene "PhysicsScene"',
        [f"vector3f physics:gravityDirection = {_tuple(down)}", f"float physics:gravityMagnitude = {_number(size)}"],
    )


def _material(values):
    written = [f'float physics:{name} = {_number(value)} (doc = "{_UNITS[name]}")' for name, value in values.items()]
    return _prim('def Material "CableMaterial"', written, schemas=("PhysicsMaterialAPI", "PhysicsCurvesDeformableMaterialAPI"))


def _chain(start, tangents, ds):
    """Points (n + 2, 3) of a curve of equal segments along unit ``tangents``; ``start`` is the centre of the first segment."""
    return np.cumsum(np.concatenate([[start - 0.5 * ds * tangents[0]], ds * tangents]), axis=0)


def rest_points(cable: HungCable, rest: np.ndarray) -> np.ndarray:
    """Points (n + 2, 3) of the unloaded curve, from the rotations of its segments."""
    return _chain(cable.position[0], rest[:, :, 2], cable.element_length)


def closed(cable: HungCable) -> np.ndarray:
    """The curve in the pose, with segments of exactly the element length: otherwise a stiff cable would start with a jerk.

    Its tangents are those of the nodes, with a second-order rotation so that the last segment is centred on the end.
    """
    ds, tangents = cable.element_length, cable.rotation[:, :, 2].copy()
    given, gap = tangents[1:-1].copy(), np.zeros(3)
    for _ in range(_CLOSING):
        away = cable.position[-1] - cable.position[0] - ds * (0.5 * (tangents[0] + tangents[-1]) + tangents[1:-1].sum(axis=0))
        gap += away / (ds * len(given))
        tangents[1:-1] = (given + gap) / np.linalg.norm(given + gap, axis=1, keepdims=True)
    return _chain(cable.position[0], tangents, ds)


def _normals(rotation):
    return np.concatenate([rotation[:, :, 1], rotation[-1:, :, 1]])


def unloaded(cable: HungCable) -> np.ndarray:
    """Rotations (n + 1, 3, 3) of the segments under no load, the first as in the pose."""
    turns = Rotation.from_rotvec(cable.element_length * cable.natural[:, 3:])
    out = [Rotation.from_matrix(cable.rotation[0])]
    for turn in turns:
        out.append(out[-1] * turn)
    return np.array([turned.as_matrix() for turned in out])


def _supports(cable):
    """Supports as sites on the end segments: `(u, s, t)` is the weight of the first point, and m along normal and binormal."""
    out, ds = [], cable.element_length
    for name, segment, held in (("Start", 0, cable.held[0]), ("End", cable.elements, cable.held[-1])):
        if not held[0]:
            continue
        sites = [(0.5, 0.0, 0.0)] if not held[3] else [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.5, ds, 0.0)]
        axes = cable.rotation[-1 if segment else 0]
        at = cable.position[-1 if segment else 0]
        for k, site in enumerate(sites):
            world = at + axes @ ((0.5 - site[0]) * ds * _TANGENT + site[1] * _NORMAL)
            out += _prim(
                f'def Xform "{name}{k}"',
                [
                    "bool physics:kinematicEnabled = true", f"double3 xformOp:translate = {_tuple(world)}",
                    'uniform token[] xformOpOrder = ["xformOp:translate"]',
                ],
                schemas=("PhysicsRigidBodyAPI",),
            )  # fmt: skip
            out += _prim(
                f'def PhysicsAttachment "{name}{k}Tie"',
                [
                    "rel physics:src0 = </World/Cable>", 'uniform token physics:type0 = "segment"',
                    f"int[] physics:indices0 = [{segment}]", f"vector3f[] physics:coords0 = {_tuples([site])}",
                    f"rel physics:src1 = </World/{name}{k}>", 'uniform token physics:type1 = "xform"',
                    "bool physics:attachmentEnabled = true",
                ],
            )  # fmt: skip
    return out


def _prim(head, lines, schemas=()):
    """The lines of one prim below the root."""
    applied = ", ".join(f'"{name}"' for name in schemas)
    body = [f"    {line}" for entry in lines for line in entry.split("\n")]
    listed = ["(", f"    prepend apiSchemas = [{applied}]", ")"] if schemas else []
    return [f"    {line}" for line in (head, *listed, "{", *body, "}")]


def _extent(points, radius):
    return np.array([points.min(axis=0) - radius, points.max(axis=0) + radius])


def _tuples(rows):
    return f"[{', '.join(map(_tuple, rows))}]"


def _tuple(row):
    return f"({', '.join(map(_number, row))})"


def _number(value) -> str:
    """A number for a USD float: nine digits, limited to the largest float."""
    return f"{min(float(value), _SINGLE) + 0.0:.9g}"
