"""A PyElastica script: a Cosserat rod with the calibrated stiffness, held at both clamps, settling under gravity.

PyElastica's rod has positions at nodes and frames on elements. As in `export.cable` its element k is centred on our node k:
the rod is one element longer than the cable, half an element beyond each clamp, and those end elements are fixed.
The script stands alone: numbers are written into it, ``python FILE`` settles the cable and writes its centre line.
"""

import json

import numpy as np

from scan2flex_jax.export.cable import HungCable

_SCRIPT = '''"""A cable with the stiffness that was measured from its shapes, for PyElastica (pip install pyelastica).

`python {file}` lets it settle under gravity and writes its centre line to settled.csv (m).
Units are SI. Damping is there to settle and is not calibrated; self-contact is not modelled.
"""

import json

import elastica as ea
import numpy as np

CABLE = json.loads({data!r})
TITLE, POSE = CABLE["title"], CABLE["pose"]


class Scene(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping):
    """One rod in the world."""


def build(damping=8.0):
    """The scene, its rod and a stable time step (s). damping: 1/s, of all velocities."""
    position = np.array(CABLE["position"]).T  # (3, elements + 1)
    directors = np.array(CABLE["directors"]).transpose(1, 2, 0)  # rows d1, d2, d3
    count, ds = directors.shape[2], CABLE["element_length"]
    radius = CABLE["radius"]
    rod = ea.CosseratRod.straight_rod(
        count, position[:, 0], directors[2, :, 0], directors[0, :, 0], count * ds, radius,
        density=CABLE["length_density"] / (np.pi * radius**2), youngs_modulus=1e6, shear_modulus=1e6,
    )
    K = CABLE["stiffness"]  # shear d1, d2, stretch (N), bending d1, d2, twist (N m^2)
    rod.shear_matrix[:] = np.diag(K[:3])[:, :, None]
    rod.bend_matrix[:] = np.diag(K[3:])[:, :, None]
    rod.rest_sigma[:] = np.array(CABLE["natural"][:3])[:, None]
    rod.rest_kappa[:] = np.array(CABLE["natural"][3:])[:, None]
    rod.position_collection[:] = position
    rod.director_collection[:] = directors
    if not CABLE["clamped_end"]:  # the cable ends in the middle of the last element: take the weight beyond from its nodes
        rod.mass[-2:] = CABLE["length_density"] * ds * np.array([0.875, 0.125])
    scene = Scene()
    scene.append(rod)
    ends = (0, 1, -2, -1) if CABLE["clamped_end"] else (0, 1)
    scene.constrain(rod).using(
        ea.FixedConstraint,
        constrained_position_idx=ends,
        constrained_director_idx=(0, -1) if CABLE["clamped_end"] else (0,),
    )
    scene.add_forcing_to(rod).using(ea.GravityForces, acc_gravity=np.array(CABLE["gravity"]))
    # A thin section turns much faster than it moves: more rotational inertia, which no equilibrium feels, allows longer steps.
    mass, stiffest = CABLE["length_density"] * ds, max(K[:3]) / ds
    inertia = 2.0 * max(max(K[3:]) / ds, 0.25 * max(K[:2]) * ds) * mass / stiffest
    rod.mass_second_moment_of_inertia[:] = inertia * np.eye(3)[:, :, None]
    rod.inv_mass_second_moment_of_inertia[:] = np.eye(3)[:, :, None] / inertia
    step = 0.4 * np.sqrt(mass / stiffest)
    scene.dampen(rod).using(ea.AnalyticalLinearDamper, damping_constant=damping, time_step=step)
    scene.finalize()
    return scene, rod, step


def centre_line(rod):
    """Points of the centre line (m) at arc lengths 0, ds, .., L: the middles of the elements."""
    return 0.5 * (rod.position_collection[:, 1:] + rod.position_collection[:, :-1]).T


def settle(seconds={seconds:g}, damping=8.0):
    """The rod after so many seconds."""
    scene, rod, step = build(damping)
    ea.integrate(ea.PositionVerlet(), scene, seconds, int(np.ceil(seconds / step)), progress_bar=False)
    return rod


if __name__ == "__main__":
    np.savetxt("settled.csv", centre_line(settle()), delimiter=",", header="x,y,z", comments="")
'''
_SECONDS = 3.0
_SOFTER = 100.0  # times: assumed stiffness of shear and stretch, which would make time steps a tenth as long


def to_pyelastica(cable: HungCable, file: str = "cable.py") -> str:
    """The script as text; raises `Scan2FlexError` for a cable that is not uniform."""
    K, natural, density = cable.uniform("PyElastica")
    soft = ["shear_stiffness" in cable.assumed] * 2 + ["axial_stiffness" in cable.assumed] + [False] * 3
    K = np.where(soft, K / _SOFTER, K)
    ds = cable.length / cable.elements
    d3 = cable.rotation[:, :, 2]
    r, reach = cable.position, 0.5 * ds * d3[[0, -1]]
    inner = 0.5 * (r[1:] + r[:-1])
    nodes = np.concatenate([r[:1] - reach[:1], r[:1] + reach[:1], inner[1:-1], r[-1:] - reach[1:], r[-1:] + reach[1:]])
    data = {
        "title": cable.title,
        "pose": cable.pose,
        "length_density": density,
        "radius_is_measured": cable.radius is not None,  # else for pictures: nothing below depends on it
        "radius": cable.drawn_radius,
        "element_length": ds,
        "stiffness": K.tolist(),
        "natural": natural.tolist(),
        "gravity": cable.gravity.tolist(),
        "position": nodes.tolist(),
        "directors": np.swapaxes(cable.rotation, 1, 2).tolist(),
        "clamped_end": bool(cable.held[1, 0]),
    }
    return _SCRIPT.format(file=file, data=json.dumps(data, allow_nan=False), seconds=_SECONDS)
