"""A PyElastica script: a Cosserat rod with the calibrated stiffness, held at both clamps, settling under gravity.

PyElastica's rod has positions at nodes and frames on elements. As in `export.cable`, its element k is centred on our node k:
the rod is one element longer than the cable, half an element beyond each clamp, and those end elements are fixed.
The script is self-contained: it includes all numbers, and ``python FILE`` settles the cable and writes its centre line.
"""

import json

import numpy as np

from scan2flex_jax.export.cable import COUPLED, FEATURES, HungCable, printable

HOLDS = frozenset(FEATURES) - {COUPLED}

_SCRIPT = '''"""A cable with the stiffness that was measured from its shapes, for PyElastica (pip install pyelastica).

`python {file}` lets it settle under gravity and writes its centre line to settled.csv (m).
Units are SI. Damping is there to settle and is not calibrated; self-contact is not modelled.
"""

# {remarks}

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
        density=np.mean(CABLE["masses"]) / (ds * np.pi * radius**2), youngs_modulus=1e6, shear_modulus=1e6,
    )
    shear, bend = np.array(CABLE["shear"]), np.array(CABLE["bend"])  # N of every element, N m^2 of every joint
    rod.shear_matrix[:], rod.bend_matrix[:] = shear.transpose(1, 2, 0), bend.transpose(1, 2, 0)
    rod.rest_sigma[:], rod.rest_kappa[:] = np.array(CABLE["rest_sigma"]).T, np.array(CABLE["rest_kappa"]).T
    rod.position_collection[:] = position
    rod.director_collection[:] = directors
    rod.mass[:] = CABLE["masses"]  # kg, of every node
    scene = Scene()
    scene.append(rod)
    ends = (0, 1, -2, -1) if CABLE["clamped_end"] else (0, 1)
    scene.constrain(rod).using(
        ea.FixedConstraint,
        constrained_position_idx=ends,
        constrained_director_idx=(0, -1) if CABLE["clamped_end"] else (0,),
    )
    scene.add_forcing_to(rod).using(ea.GravityForces, acc_gravity=np.array(CABLE["gravity"]))
    # A thin section turns much faster than it moves: larger rotational inertia allows longer steps, at the same equilibrium.
    mass, stiffest = min(CABLE["masses"][2:-2]), np.max(shear) / ds
    inertia = 2.0 * max(np.max(bend) / ds, 0.25 * np.max(shear) * ds) * mass / stiffest
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


def to_pyelastica(cable: HungCable, file: str = "cable.py") -> str:
    """The script as text; raises `Scan2FlexError` for a cable that PyElastica's rod cannot represent."""
    cable.require("PyElastica", HOLDS, ball_joints=False)
    ds, d3, r, K = cable.element_length, cable.rotation[:, :, 2], cable.position, cable.softened
    reach = 0.5 * ds * d3[[0, -1]]
    inner = 0.5 * (r[1:] + r[:-1])
    nodes = np.concatenate([r[:1] - reach[:1], r[:1] + reach[:1], inner[1:-1], r[-1:] - reach[1:], r[-1:] + reach[1:]])
    half = 0.5 * cable.link_masses
    data = {
        "title": cable.title,
        "pose": cable.pose,
        "masses": (np.append(half, 0.0) + np.insert(half, 0, 0.0)).tolist(),
        "radius": cable.drawn_radius,
        "element_length": ds,
        "shear": _at_nodes(K[:, :3, :3]).tolist(),
        "bend": K[:, 3:, 3:].tolist(),
        "rest_sigma": _at_nodes(cable.natural[:, :3]).tolist(),
        "rest_kappa": cable.natural[:, 3:].tolist(),
        "gravity": cable.gravity.tolist(),
        "position": nodes.tolist(),
        "directors": np.swapaxes(cable.rotation, 1, 2).tolist(),
        "clamped_end": bool(cable.held[1, 0]),
    }
    remarks = "\n# ".join(printable(remark) for remark in cable.remarks) or "All numbers are those of the study."
    return _SCRIPT.format(file=file, remarks=remarks, data=json.dumps(data, allow_nan=False), seconds=_SECONDS)


def _at_nodes(values):
    """Means of the values of neighbouring elements: PyElastica's elements are centred on our nodes."""
    return 0.5 * (np.concatenate([values[:1], values]) + np.concatenate([values, values[-1:]]))
