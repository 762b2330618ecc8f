"""The rods of MuJoCo 4: flex elements that make a discrete elastic rod with bending and twist, inextensible by constraint.

The rod is straight along the first clamp in the model's reference, which is its natural shape; its first edge is pinned. The
state begins on the start curve, with the twist angles of the edges against frames carried along without twist. At the other
clamp the last edge, and its twist, are held by an inertia of 1e9 times a vertex's: it does not move while the rest settles.
Vertices are damped in proportion to their mass, about critically for the slowest mode, and the integrator `discrete` takes
elasticity implicitly. The middle of the outer edge is in the clamp, as `scan2flex export` has it: an error of second order.
"""

import mujoco
import numpy as np

from benchmarks.peers.problems import end_twist, start_chain
from benchmarks.peers.rest import relax

_STEP = 1e-3  # of the slowest period
_CHECKS = 40  # a slowest period
_DAMPING = 1.5  # of the slowest angular frequency, 1/s
_HELD = 1e9  # times a vertex's mass
_RADIUS = 5e-3  # m: stiffnesses are moduli times the section's moments


def prepare(problem, elements):
    """The compiled model; solving resets its state."""
    ds, vertices, frames = start_chain(problem, elements)
    count = len(vertices)
    period = 2 * np.pi / problem.slowest
    step = _STEP * period
    model = mujoco.MjModel.from_xml_string(_xml(problem, ds, vertices[0], count, step))
    straight = vertices[0] + np.arange(count)[:, None] * ds * problem.start_frame[:, 2]
    slides, hinges = _degrees(model, count)
    mass = problem.density * ds
    for vertex in range(2, count):
        last = vertex == count - 1 and problem.free
        model.body_mass[model.jnt_bodyid[slides[vertex - 2][0]]] = (0.5 if last else 1.0) * mass
    dof = model.jnt_dofadr
    for joints in slides:
        for joint in joints:
            model.dof_damping[dof[joint]] = _DAMPING * problem.slowest * mass
    spin = mass * (0.5 * ds) ** 2  # inertia about the tangent: that of the motion alone
    for joint in hinges:
        model.dof_armature[dof[joint]] = spin
        model.dof_damping[dof[joint]] = _DAMPING * problem.slowest * spin
    qpos = model.qpos0.copy()
    for vertex in range(2, count):
        qpos[[model.jnt_qposadr[j] for j in slides[vertex - 2]]] = vertices[vertex] - straight[vertex]
    edges = len(frames)
    twist = end_twist(problem, np.diff(vertices, axis=0)) * np.linspace(0.0, 1.0, edges)
    for edge, joint in enumerate(hinges, start=1):
        qpos[model.jnt_qposadr[joint]] = twist[edge]
    if not problem.free:
        for joint in (*slides[-1], *slides[-2], hinges[-1]):
            model.dof_armature[dof[joint]] = _HELD * (spin if joint == hinges[-1] else mass)
    data = mujoco.MjData(model)
    mujoco.mj_setConst(model, data)
    s = np.append(np.arange(edges) * ds, problem.length)[: edges + (1 if problem.free else 0)]

    def points(data):
        mujoco.mj_kinematics(model, data)
        mujoco.mj_flex(model, data)
        now = data.flexvert_xpos.copy()
        middles = 0.5 * (now[1:] + now[:-1])
        return np.vstack([middles, now[-1:]]) if problem.free else middles

    def solve():
        mujoco.mj_resetData(model, data)
        data.qpos[:] = qpos
        return _settle(problem, model, data, points, s)

    return solve


def _settle(problem, model, data, points, s):
    """Relaxation of a model in the state ``data``; ``points(data)`` gives the nodes (m) that belong to ``s`` (m)."""
    step = model.opt.timestep
    steps = max(1, round(2 * np.pi / problem.slowest / _CHECKS / step))
    last = points(data)

    def advance():
        mujoco.mj_step(model, data, nstep=steps)

    def state():
        nonlocal last
        now = points(data)
        speed = np.linalg.norm(now - last, axis=1).max() / (steps * step)
        last = now
        warned = data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number
        return s, now, np.nan if warned else speed

    return relax(problem, advance, state, steps * step)


def _degrees(model, count):
    """Joints of the free vertices, three slides each, and hinges of the free edges, in order."""
    names = [model.joint(j).name for j in range(model.njnt)]
    slides = [j for j in range(model.njnt) if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE]
    hinges = [j for j, name in enumerate(names) if "twist" in name]
    if len(slides) != 3 * (count - 2) or len(hinges) != count - 2:
        raise RuntimeError(f"{count} vertices have {len(slides)} slides and {len(hinges)} twists: another MuJoCo than 4.0")
    return [slides[3 * k : 3 * k + 3] for k in range(count - 2)], hinges


def _xml(problem, ds, first, count, step):
    second = 0.25 * np.pi * _RADIUS**4
    along = problem.start_frame[:, 2]
    points = " ".join(repr(float(x)) for k in range(count) for x in first + k * ds * along)
    elements = " ".join(f"{k} {k + 1}" for k in range(count - 1))
    return f"""<mujoco><option gravity="0 0 {-problem.weight / problem.density!r}" timestep="{step!r}" integrator="discrete"
 solver="Newton"/><worldbody><flexcomp name="rod" type="direct" dim="1" dof="full" mass="{problem.density * problem.length!r}"
 radius="{_RADIUS}" point="{points}" element="{elements}"><edge equality="true" solref="{2 * step!r} 1"
 solimp="0.9999 0.9999 0.001 0.5 2"/><pin id="0 1"/><contact contype="0" conaffinity="0" selfcollide="none"/>
<elasticity young="{problem.bending / second!r}" shear="{problem.torsion / (2 * second)!r}"/></flexcomp></worldbody></mujoco>"""
