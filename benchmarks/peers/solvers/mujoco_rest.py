"""A MuJoCo model left to move until it rests, and its vertices or middles on the way: for the cable and the flex rod."""

import mujoco
import numpy as np

from benchmarks.peers.solvers.rest import relax

_CHECKS = 40  # a slowest period


def settle(problem, model, data, points, s):
    """`rest.relax` of a model in the state ``data``; ``points(data)`` gives the nodes (m) that belong to ``s`` (m)."""
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
