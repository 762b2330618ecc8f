"""Does Newton hang an exported cable as we do? Needs `newton[importers]` and no JAX; a CPU will do (kernels compile once).

    scan2flex export STUDY --to usd  -o cable.usda --pose NAME --elements 20
    scan2flex export STUDY --to json -o cable.json --pose NAME --elements 20
    python benchmarks/exports.py cable.usda cable.json

Prints the largest distance of the settled segments from our nodes, over the length of the cable.
"""

import argparse
import json
from pathlib import Path

import numpy as np

STEP, ITERATIONS, SECONDS = 1e-3, 10, 0.3
SETTLE = 0.05  # s, in which the strain of a joint decays
SOFTER = 0.01  # of EA and GA: in single precision the solver does not settle the stiff cable


def rod_of(file):
    """The finalised model and the bodies of the cable, the end segments fixed."""
    import newton  # noqa: PLC0415 (only this benchmark needs it)
    import warp as wp  # noqa: PLC0415

    builder = newton.ModelBuilder()
    found = builder.add_usd(str(file), return_deformable_results=True)
    bodies, _ = found["path_cable_map"]["/World/Cable"]
    for k in (bodies[0], bodies[-1]):
        builder.body_mass[k] = builder.body_inv_mass[k] = 0.0
        builder.body_inertia[k] = builder.body_inv_inertia[k] = wp.mat33(0.0)
    builder.color()
    model = builder.finalize()
    ke, kd = model.joint_target_ke.numpy(), np.zeros_like(model.joint_target_kd.numpy())
    start = model.joint_qd_start.numpy()
    for joint in found["path_cable_map"]["/World/Cable"][1]:  # shear, shear, stretch, bending, bending, twist
        k = start[joint]
        ke[k : k + 3] *= SOFTER
        kd[k + 3 : k + 6] = SETTLE * ke[k + 3 : k + 6]
    model.joint_target_ke.assign(ke)
    model.joint_target_kd.assign(kd)
    return model, bodies


def settled(file):
    """Middles (m) of the segments, and their largest velocity (m/s, rad/s)."""
    import newton  # noqa: PLC0415 (only this benchmark needs it)

    model, bodies = rod_of(file)
    solver, control = newton.solvers.SolverVBD(model, iterations=ITERATIONS), model.control()
    now, after = model.state(), model.state()
    for _ in range(round(SECONDS / STEP)):
        now.clear_forces()
        solver.step(now, after, control, None, STEP)
        now, after = after, now
    return now.body_q.numpy()[bodies][:, :3], float(np.abs(now.body_qd.numpy()[bodies]).max())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("stage", type=Path)
    parser.add_argument("ours", type=Path)
    given = parser.parse_args()
    ours = json.loads(given.ours.read_text())
    points, speed = settled(given.stage)
    away = np.linalg.norm(points - np.array(ours["pose"]["position"]), axis=1).max() / ours["length"]
    print(f"{len(points) - 1} elements: {away:.1e} of the length away, fastest {speed:.1e} (m/s, rad/s)")


if __name__ == "__main__":
    main()
