"""MuJoCo's cable: rigid links on ball joints with the plugin `mujoco.elasticity.cable`, which MuJoCo 4 no longer has.

Only the rest counts, so the joints are damped in proportion to their stiffness, about critically for the slowest mode, and
`implicitfast` takes that damping implicitly, which carries steps far beyond the explicit limit. The first link is part of the
world. At the other clamp the last link is welded to it; constraints are soft in MuJoCo, and this one is as hard as it gets.
With a whole link fixed in the clamp the error is of first order; ``centred`` puts the link's middle there.
"""

import mujoco
import numpy as np

from benchmarks.peers.continuum import quaternion
from benchmarks.peers.problems import start_chain
from benchmarks.peers.solvers.mujoco_rest import settle

PLUGIN = "mujoco.elasticity.cable"
_STEP = 2e-3  # of the slowest period
_DAMPING = 0.75  # of the critical one of the slowest mode
_ARMATURE = 4.0  # of a joint's stiffness times the squared step: an inertia that changes the motion alone
_RADIUS = 5e-3  # m: stiffnesses are moduli times the section's moments
_TO_LINK = np.eye(3)[:, [2, 0, 1]]  # columns: x along d3, y along d1, z along d2


def missing() -> str | None:
    """Why this version of MuJoCo will not do."""
    if int(mujoco.__version__.split(".")[0]) >= 4:
        return "MuJoCo 4 has no cable plugin: name an interpreter with 3.17 or older by --python 'MuJoCo cable=PATH'"
    return None


def prepare(problem, elements, centred=False):
    """The compiled model; solving resets its state."""
    ds, vertices, frames = start_chain(problem, elements, centred)
    period = 2 * np.pi / problem.slowest
    step = _STEP * period
    model = mujoco.MjModel.from_xml_string(_xml(problem, ds, vertices, frames, centred, step))
    bodies = np.array([model.body(f"link{k}").id for k in range(len(frames))])
    tip = model.site("tip").id
    s = np.arange(len(frames) + 1) * ds if not centred else np.append(np.arange(len(frames)) * ds, problem.length)
    s = s[: len(s) if problem.free or not centred else -1]

    def points(data):
        mujoco.mj_kinematics(model, data)
        starts = data.xpos[bodies]
        ends = np.vstack([starts[1:], data.site_xpos[tip]])
        if not centred:
            return np.vstack([starts, ends[-1:]])
        middles = 0.5 * (starts + ends)
        return np.vstack([middles, ends[-1:]]) if problem.free else middles

    def solve():
        data = mujoco.MjData(model)
        return settle(problem, model, data, points, s)

    return solve


def _xml(problem, ds, vertices, frames, centred, step):
    second = 0.25 * np.pi * _RADIUS**4
    slow = 2 * _DAMPING / problem.slowest
    damping = slow * problem.bending / ds
    armature = _ARMATURE * max(problem.bending, problem.torsion) / ds * step**2
    links = [R @ _TO_LINK for R in frames]
    count, body, close = len(frames), "", ""
    for k in range(count):
        if k == 0:
            place = f'pos="{_text(vertices[0])}" quat="{_text(quaternion(links[0]))}"'
        else:
            place = f'pos="{ds!r} 0 0" quat="{_text(quaternion(links[k - 1].T @ links[k]))}"'
        half = centred and (k == 0 or (k == count - 1 and not problem.free))
        low = 0.5 * ds if half and k == 0 else 0.0
        high = 0.5 * ds if half and k > 0 else ds
        joint = "" if k == 0 else f'<joint type="ball" damping="{damping!r}" armature="{armature!r}"/>'
        body += f"""<body name="link{k}" {place}>{joint}<plugin instance="cable"/>
<geom type="capsule" fromto="{low!r} 0 0 {high!r} 0 0" size="{_RADIUS}" mass="{problem.density * (high - low)!r}"
 contype="0" conaffinity="0"/>"""
        close += "</body>"
    held = 0.5 * ds if centred else ds
    body += f'<site name="tip" pos="{ds!r} 0 0"/><site name="end" pos="{held!r} 0 0"/>'
    world = equality = ""
    if not problem.free:
        world = f'<site name="clamp" pos="{_text(problem.end)}" quat="{_text(quaternion(links[-1]))}"/>'
        hard = f'solref="{2 * step!r} 1" solimp="0.9999 0.9999 0.001 0.5 2"'
        equality = f'<equality><weld site1="end" site2="clamp" {hard}/></equality>'
    gravity = -problem.weight / problem.density
    return f"""<mujoco><option gravity="0 0 {gravity!r}" timestep="{step!r}" integrator="implicitfast"/>
<extension><plugin plugin="{PLUGIN}"><instance name="cable"><config key="bend" value="{problem.bending / second!r}"/>
<config key="twist" value="{problem.torsion / (2 * second)!r}"/><config key="flat" value="true"/>
<config key="vmax" value="0"/></instance></plugin></extension>
<worldbody>{world}{body}{close}</worldbody>{equality}</mujoco>"""


def _text(values):
    return " ".join(repr(float(v) + 0.0) for v in values)
