"""An exported cable comes to rest in the simulator that it was exported for. Needs that simulator and numpy, and no JAX.

    python benchmarks/settling.py mujoco cable.xml

Prints JSON: the middles of the links (m), the fastest motion that is left (m/s, rad/s; null where the simulator reports none),
and the simulator's version. Ends with code 3 and a sentence where the simulator is not installed.
"""

import importlib.metadata
import json
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

PACKAGES = {"mujoco": "mujoco", "pyelastica": "pyelastica", "usd": "newton"}
"""The package that runs each format."""
MISSING = 3
MUJOCO_SECONDS = 4.0
STEP, ITERATIONS, SECONDS = 1e-3, 10, 0.3  # of Newton
SETTLE = 0.05  # s, in which the strain of a joint of Newton decays
SOFTER = 0.01  # of EA and GA: in single precision Newton's solver does not settle the stiff cable


def in_mujoco(file: Path):
    """Middles (n + 1, 3) of the links, and the fastest joint (rad/s)."""
    import mujoco  # noqa: PLC0415 (each simulator is imported where it runs)

    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    while data.time < MUJOCO_SECONDS:
        mujoco.mj_step(model, data)
    links = [data.body(f"link{k}") for k in range(model.nbody - 1)]
    half = 0.5 * np.linalg.norm(links[2].xpos - links[1].xpos)
    return np.array([b.xpos + half * b.xmat.reshape(3, 3)[:, 2] for b in links]), float(np.abs(data.qvel).max())


def in_pyelastica(file: Path):
    """Middles of the elements, from the table that the exported script writes."""
    with TemporaryDirectory() as folder:
        subprocess.run([sys.executable, str(file.resolve())], cwd=folder, check=True, stdout=subprocess.DEVNULL)
        return np.loadtxt(Path(folder) / "settled.csv", delimiter=",", skiprows=1), None


def in_newton(file: Path):
    """Middles of the segments, and their largest velocity (m/s, rad/s)."""
    import newton  # noqa: PLC0415 (each simulator is imported where it runs)

    model, bodies = _newton_model(file)
    solver, control = newton.solvers.SolverVBD(model, iterations=ITERATIONS), model.control()
    now, after = model.state(), model.state()
    for _ in range(round(SECONDS / STEP)):
        now.clear_forces()
        solver.step(now, after, control, None, STEP)
        now, after = after, now
    return now.body_q.numpy()[bodies][:, :3], float(np.abs(now.body_qd.numpy()[bodies]).max())


def _newton_model(file):
    """The finalised model and the bodies of the cable, the end segments fixed."""
    import newton  # noqa: PLC0415 (each simulator is imported where it runs)
    import warp as wp  # noqa: PLC0415

    builder = newton.ModelBuilder()
    found = builder.add_usd(str(file), return_deformable_results=True)
    bodies, joints = found["path_cable_map"]["/World/Cable"]
    for k in (bodies[0], bodies[-1]):
        builder.body_mass[k] = builder.body_inv_mass[k] = 0.0
        builder.body_inertia[k] = builder.body_inv_inertia[k] = wp.mat33(0.0)
    builder.color()
    model = builder.finalize()
    ke, kd = model.joint_target_ke.numpy(), np.zeros_like(model.joint_target_kd.numpy())
    start = model.joint_qd_start.numpy()
    for joint in joints:  # shear, shear, stretch, bending, bending, twist
        k = start[joint]
        ke[k : k + 3] *= SOFTER
        kd[k + 3 : k + 6] = SETTLE * ke[k + 3 : k + 6]
    model.joint_target_ke.assign(ke)
    model.joint_target_kd.assign(kd)
    return model, bodies


SETTLED = {"mujoco": in_mujoco, "pyelastica": in_pyelastica, "usd": in_newton}


def main() -> None:
    target, file = sys.argv[1], Path(sys.argv[2])
    try:
        version = importlib.metadata.version(PACKAGES[target])
    except importlib.metadata.PackageNotFoundError:
        sys.stderr.write(f"{PACKAGES[target]} is not installed for {sys.executable}\n")
        raise SystemExit(MISSING) from None
    points, speed = SETTLED[target](file)
    sys.stdout.write("\n" + json.dumps({"points": points.tolist(), "speed": speed, "version": version}) + "\n")


if __name__ == "__main__":
    main()
