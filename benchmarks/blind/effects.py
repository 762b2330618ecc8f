"""Physics beyond the baseline model: each kind of effect as a function that changes `Parts`.

An effect is a dictionary as in a study's `[[effect]]` table: `kind` and its parameters, in SI units. The first group is
the catalogue of the study format; the second, `HIDDEN`, lies outside of it; `SCATTER` differs from pose to pose and lies
under an effect. Per-pose parameters of these have one entry per pose. Spans are boxes with edges smoothed over 2 % of L;
dead loads keep their direction in the world.
"""

import numpy as np

from . import laws, rod
from .scene import Parts


def _natural_curvature(x, curvature):
    x.natural = x.natural + np.asarray(curvature)


def _kink(x, position, angle, width):
    x.natural = x.natural + x.box(position, width)[:, None] * np.asarray(angle) / width


def _anisotropic_bending(x, ratio, angle):
    x.ratio, x.angle = ratio, angle


def _bend_twist_coupling(x, coupling):
    x.coupling = np.asarray(coupling)


def _nonlinear_bending(x, slip_curvature, ratio):
    x.slip = laws.Slip(slip_curvature, ratio)


def _stiffness_profile(x, position, width, factor):
    profile = 1 + (factor - 1) * x.box(position, width)
    x.bend, x.twist = x.bend * profile, x.twist * profile


def _extensibility(x, axial_stiffness):
    x.axial = 1 / axial_stiffness


def _point_mass(x, position, mass):
    x.force = x.force + x.hat(position)[:, None] * (mass * x.gravity)


def _density_profile(x, position, width, factor):
    x.density = x.density * (1 + (factor - 1) * x.box(position, width))


def _uniform_load(x, force):
    x.line = x.line + np.asarray(force)


def _point_load(x, position, force):
    x.force = x.force + x.hat(position)[:, None] * np.asarray(force)


def _tether(x, position, anchor, stiffness, rest_length):
    x.tethers = [*x.tethers, (x.hat(position), np.asarray(anchor), stiffness, rest_length)]


def _support_plane(x, normal, offset):
    normal = np.asarray(normal) / np.linalg.norm(normal)
    weight, L = x.cable.density * np.linalg.norm(x.gravity), x.cable.length
    x.planes = [*x.planes, (normal, offset, weight / (rod.PLANE_SINK * L), rod.PLANE_SMOOTH * L)]


def _elastic_clamp(x, stiffness):
    x.grip = [1 / k for k in stiffness]


def _clamp_rotation(x, rotation):
    x.turn = [t + np.asarray(v) for t, v in zip(x.turn, rotation, strict=True)]


def _clamp_offset(x, offset):
    x.shift = [t + np.asarray(v) for t, v in zip(x.shift, offset, strict=True)]


def _length_error(x, length):
    """The length is read before all else, in `build`."""


def _scan_scale(x, factor):
    x.scale = factor


def _scan_offset(x, offset):
    x.offset = np.asarray(offset)


CATALOGUE = {
    "natural_curvature": _natural_curvature, "kink": _kink, "anisotropic_bending": _anisotropic_bending,
    "bend_twist_coupling": _bend_twist_coupling, "nonlinear_bending": _nonlinear_bending,
    "stiffness_profile": _stiffness_profile, "extensibility": _extensibility, "point_mass": _point_mass,
    "density_profile": _density_profile, "uniform_load": _uniform_load, "point_load": _point_load, "tether": _tether,
    "support_plane": _support_plane, "elastic_clamp": _elastic_clamp, "clamp_rotation": _clamp_rotation,
    "clamp_offset": _clamp_offset, "length_error": _length_error, "scan_scale": _scan_scale,
    "scan_offset": _scan_offset,
}  # fmt: skip


def _wave(x, waves, phase):
    return np.sin(2 * np.pi * waves * x.s / x.length + phase)


def _wavy_bending(x, amplitude, waves, phase):
    x.bend = x.bend * (1 + amplitude * _wave(x, waves, phase))


def _wavy_curvature(x, amplitude, waves, phase):
    x.natural = x.natural + _wave(x, waves, phase)[:, None] * np.asarray([*amplitude, 0.0])


def _wavy_mass(x, amplitude, waves, phase):
    x.density = x.density * (1 + amplitude * _wave(x, waves, phase))


def _taper_stiffness(x, exponent):
    profile = np.exp(exponent * (2 * x.s / x.length - 1))
    x.bend, x.twist = x.bend * profile, x.twist * profile


def _taper_mass(x, exponent):
    x.density = x.density * np.exp(exponent * (2 * x.s / x.length - 1))


def _pose_loads(x, harmonics):
    """Per pose, force densities (N/m) of `cos(k pi s / L)`, k = 0, 1, 2: `harmonics` is (P, 3, 3)."""
    x.line = x.line + np.einsum("pki,ks->psi", np.asarray(harmonics), cosines(x, 3))


def _pose_reseating(x, rotation):
    """Per pose and end, a rotation of the clamp in its own frame: (P, 2, 3)."""
    rotation = np.asarray(rotation)
    x.turn = [x.turn[0] + rotation[:, 0], x.turn[1] + rotation[:, 1]]


def _point_couple(x, position, couple):
    x.couple = x.couple + x.hat(position)[:, None] * np.asarray(couple)


def _bending_friction(x, moment, scale, sign):
    x.friction = laws.Friction(moment / x.cable.bending, scale, np.asarray(sign, float)[:, None])


def cosines(x, count):
    """`cos(k pi s / L)`, k = 0, 1, ..., at the sample points: (count, len(s))."""
    return np.cos(np.pi * np.arange(count)[:, None] * x.s / x.length)


def _pose_curvature(x, harmonics):
    """Per pose, natural curvature (1/m) in the material frame as a cosine series: `harmonics` is (P, K, 3)."""
    harmonics = np.asarray(harmonics)
    x.natural = x.natural + np.einsum("pki,ks->psi", harmonics, cosines(x, harmonics.shape[1]))


HIDDEN = {
    "wavy_bending": _wavy_bending, "wavy_curvature": _wavy_curvature, "wavy_mass": _wavy_mass,
    "taper_stiffness": _taper_stiffness, "taper_mass": _taper_mass, "pose_loads": _pose_loads,
    "pose_reseating": _pose_reseating, "point_couple": _point_couple, "bending_friction": _bending_friction,
}  # fmt: skip
SCATTER = {"pose_curvature": _pose_curvature, "pose_reseating": _pose_reseating}


def build(scene, effects, sigma):
    """The fields of the rod equations, and how the shape is seen: `(Fields, scale, offset)`."""
    lengths = [e["length"] for e in effects if e["kind"] == "length_error"]
    parts = Parts(scene, sigma, lengths[0] if lengths else scene.cable.length)
    for effect in effects:
        arguments = {name: value for name, value in effect.items() if name != "kind"}
        (CATALOGUE | HIDDEN | SCATTER)[effect["kind"]](parts, **arguments)
    return parts.fields(scene), parts.scale, parts.offset


def features(effects):
    """Where a mesh wants nodes: points, and spans (position, width)."""
    points = [e["position"] for e in effects if "position" in e and "width" not in e]
    spans = [(e["position"], e["width"]) for e in effects if "width" in e]
    return points, spans
