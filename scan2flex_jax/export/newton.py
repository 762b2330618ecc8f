"""The calibrated cable in a `newton.ModelBuilder`, and as a material of Isaac Lab.

Links, rest shape and rigidities are those of `export.usd` (Newton 1.8 gives both the same joints); a clamped end is a link
without mass, which Newton does not move. Stiffness that varies along the cable is set joint by joint: the file has one.

Of `effects.dahl` a joint, whose strain is the angle ``ds x``, takes

    elastic stiffness (1 - share) B/ds, dahl_eps_max = ds slip share/(1 - share), dahl_tau = ds slip

(Newton 1.8, `SolverVBD`: torque ``k a + sigma``, ``tau dsigma = k eps_max da - sigma |da|`` of an angle ``a``, in bending and
twist). Newton begins without friction in whatever pose the rod has: one that friction held is left by it.
"""

from importlib import import_module
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.export.cable import DAHL, STIFFNESS
from scan2flex_jax.export.hanging import hung
from scan2flex_jax.export.moduli import moduli
from scan2flex_jax.export.usd import HOLDS as IN_FILES
from scan2flex_jax.export.usd import closed, rest_points, unloaded
from scan2flex_jax.study.model import Study

HOLDS = IN_FILES | {STIFFNESS, DAHL}
_FULL = 1.0 - 1e-6  # largest share of friction: Newton wants some elastic stiffness


def to_newton(study: Study, builder: Any, *, pose: str | None = None, elements: int = 40, **options: Any) -> tuple[list, list]:
    """Add the calibrated cable of a study to a Newton model, hanging in one pose.

    Args:
        study: A study whose parameters all have values, such as ``fit(study).calibrated``.
        builder: A `newton.ModelBuilder`. Its gravity is left as it is: that of the study must be set there.
        pose: The name of a pose; None: the first one.
        elements: Joints of the chain; it has one more link.
        options: Further arguments of `newton.ModelBuilder.add_rod`, such as ``label``, ``color``, ``bend_damping``.

    Returns:
        Indices of the bodies and of the joints of the rod, in order from the start.

    Raises:
        Scan2FlexError: Newton is not installed, a parameter has no value, the pose is not solved, or a rod of Newton cannot
            represent the cable.

    Examples:
        >>> builder = newton.ModelBuilder(gravity=(0.0, 0.0, -9.81))  # doctest: +SKIP
        >>> bodies, joints = to_newton(fit(study).calibrated, builder, elements=40)  # doctest: +SKIP
    """
    try:
        newton, warp = import_module("newton"), import_module("warp")
    except ImportError as error:
        raise Scan2FlexError("Newton is not installed: pip install newton.") from error
    cable = hung(study, pose, elements)
    cable.require("Newton", HOLDS)
    rest, stiffness = unloaded(cable), cable.softened.copy()
    friction = dict(cable.effects).get(DAHL, {"share": 0.0, "slip_curvature": 1.0})
    share = min(friction["share"], _FULL)
    stiffness[:, 3:, 3:] *= 1.0 - share
    K = stiffness[0]
    rod = newton.Rod(
        closed(cable), quaternions=_xyzw(cable.rotation), rest_points=rest_points(cable, rest), rest_quaternions=_xyzw(rest),
        radius=cable.drawn_radius, stretch_rigidity=K[2, 2], shear_rigidity=K[0, 0], bend_rigidity=K[3, 3],
        twist_rigidity=K[5, 5],
    )  # fmt: skip
    bodies, joints = builder.add_rod(rod=rod, **options)
    ds = cable.element_length
    for joint, k in zip(joints, stiffness, strict=True):
        at = builder.joint_qd_start[joint]  # shear twice, stretch, bending twice, twist
        builder.joint_target_ke[at : at + 6] = (k[[0, 0, 2, 3, 3, 5], [0, 0, 2, 3, 3, 5]] / ds).tolist()
    if share:
        newton.solvers.SolverVBD.register_custom_attributes(builder)
        slip = ds * friction["slip_curvature"]
        for name, value in (("dahl_eps_max", slip * share / (1.0 - share)), ("dahl_tau", slip)):
            attribute = builder.custom_attributes[f"vbd:{name}"]
            attribute.values = {**(attribute.values or {}), **dict.fromkeys(joints, value)}
    for body, mass in zip(bodies, cable.link_masses, strict=True):
        _weigh(builder, body, float(mass))
    for body, held, at in ((bodies[0], cable.held[0], cable.position[0]), (bodies[-1], cable.held[-1], cable.position[-1])):
        if held.all():
            _weigh(builder, body, 0.0)
        elif held.any():
            place = warp.transform(warp.vec3(*map(float, at)), warp.quat_identity())
            builder.add_joint_ball(parent=-1, child=body, parent_xform=place)
    return bodies, joints


def _xyzw(rotation) -> np.ndarray:
    return Rotation.from_matrix(rotation).as_quat()


def _weigh(builder, body, mass: float) -> None:
    """Give a body a mass (kg), and the rotational inertia of its shape with it; 0: it does not move."""
    factor = mass / builder.body_mass[body] if builder.body_mass[body] else 0.0
    builder.body_mass[body] = mass
    builder.body_inertia[body] = builder.body_inertia[body] * factor
    builder.body_inv_mass[body] = 1.0 / mass if mass else 0.0
    builder.body_inv_inertia[body] = builder.body_inv_inertia[body] * (1.0 / factor if factor else 0.0)


def isaac_lab_material(study: Study, *, pose: str | None = None, elements: int = 40) -> dict[str, float]:
    """The arguments of Isaac Lab's ``CableMaterialCfg`` for the calibrated cable.

    Isaac Lab takes a modulus (Pa) where Newton has a stiffness: those of `export.moduli`, with which Newton has the calibrated
    stiffness whatever the radius.

    Returns:
        ``thickness`` (m), ``density`` (kg/m^3), ``stretch_stiffness``, ``shear_stiffness``, ``bend_stiffness`` and
        ``twist_stiffness`` (Pa).

    Raises:
        Scan2FlexError: A parameter has no value, the pose is not solved, or the material cannot represent the cable.
    """
    m = moduli(hung(study, pose, elements))
    names = {"thickness": "diameter", "density": "density", "stretch_stiffness": "E_stretch", "shear_stiffness": "G_shear",
             "bend_stiffness": "E_bend", "twist_stiffness": "G_twist"}  # fmt: skip
    return {name: m[own] for name, own in names.items()}
