"""Cables hung to rest in Newton and MuJoCo beside our own equilibria.

    python -m benchmarks.simulators      # pip install newton mujoco

Five cables of 1 m and 0.2 kg/m begin in our equilibrium and come to rest. In Newton (`to_newton`, `SolverVBD` on the CPU)
a step lasts 1/80 s over the number of links and has 20 iterations; whenever the kinetic energy falls, the velocities are
set to zero (kinetic damping), for 0.2 s. MuJoCo steps the exported model for 4 s. A distance is the largest of a link from its
node, over the length; our equilibrium has 160 elements. Its unit is the repeatability of two real cables: the RMS distance over
the length between two takes of one pose. Rows on record are kept.
"""

from dataclasses import replace
from importlib.metadata import version
from itertools import combinations, product

import numpy as np

from benchmarks.record import complete, record, recorded
from scan2flex_jax import Scan2FlexError, load_study, predict
from scan2flex_jax.cli.setup import prepare_jax
from scan2flex_jax.examples import example_path
from scan2flex_jax.export import export, to_newton
from scan2flex_jax.study.repeats import difference, repeats

CABLES = {  # EI and GJ (N m^2), natural curvature (1/m), pose
    "soft": (0.02, 0.05, None, "plane"),
    "stiff": (0.5, 1.25, None, "plane"),
    "twisted": (0.1, 0.25, None, "twist-90"),
    "naturally curved": (0.1, 0.25, (1.0, 0.0, 0.0), "aside-45"),
    "two bending stiffnesses": ((0.1, 0.2), 0.25, None, "aside-45"),
}
LINKS = (20, 40, 80)
REAL = ("bamboo-rod", "textile-strip")  # examples with poses taken twice
RATE, ITERATIONS, SECONDS = 80, 20, 0.2  # steps a second and link, iterations of a step, s


def cable(EI, GJ, curvature):
    """The simulated cable with these values; stretch and shear are not stated."""
    study = load_study(example_path("simulated-cable"))
    values = {name: study.cable[name] for name in ("length", "length_density")}
    values |= {"bending_stiffness": np.array(EI) if np.ndim(EI) else EI, "torsional_stiffness": GJ}
    values |= {} if curvature is None else {"natural_curvature": curvature}
    return replace(study, unknowns=(), cable=values)


def settled(builder, bodies, rate, seconds=SECONDS, iterations=ITERATIONS) -> np.ndarray:
    """Positions (n, 3) of ``bodies`` at rest, m: `SolverVBD` with kinetic damping, ``rate`` steps a second."""
    import newton  # noqa: PLC0415 - an optional package

    builder.color()
    model = builder.finalize(device="cpu")
    solver = newton.solvers.SolverVBD(model, iterations=iterations)
    now, then, control = model.state(), model.state(), model.control()
    mass, energy = model.body_mass.numpy()[bodies], 0.0
    for _ in range(round(seconds * rate)):
        now.clear_forces()
        solver.step(now, then, control, None, 1.0 / rate)
        now, then = then, now
        before, energy = energy, float(mass @ np.sum(now.body_qd.numpy()[bodies][:, :3] ** 2, axis=1))
        if energy < before:
            now.body_qd.zero_()
            energy = 0.0
    return now.body_q.numpy()[bodies][:, :3]


def in_newton(study, pose, links) -> np.ndarray:
    """Positions (n + 1, 3) of the links at rest, m."""
    import newton  # noqa: PLC0415

    builder = newton.ModelBuilder(gravity=tuple(map(float, study.gravity)))
    bodies, _ = to_newton(study, builder, pose=pose, elements=links)
    return settled(builder, bodies, RATE * links)


def in_mujoco(study, pose, links) -> np.ndarray:
    """Positions (n + 1, 3) of the links at rest, m."""
    import mujoco  # noqa: PLC0415

    model = mujoco.MjModel.from_xml_string(export(study, "mujoco", pose=pose, elements=links))
    data = mujoco.MjData(model)
    while data.time < 4.0:
        mujoco.mj_step(model, data)
    half = 0.5 * study.cable["length"] / links
    return np.array([b.xpos + half * b.xmat.reshape(3, 3)[:, 2] for b in (data.body(f"link{k}") for k in range(links + 1))])


TARGETS = {"newton": in_newton, "mujoco": in_mujoco}


def one(case) -> dict:
    """The figures of one cable in one simulator."""
    target, name, links = case
    EI, GJ, curvature, pose = CABLES[name]
    study = cable(EI, GJ, curvature)
    row = {"target": target, "cable": name, "links": links}
    try:
        there = TARGETS[target](study, pose, links)
    except Scan2FlexError as refused:
        return row | {"refused": str(refused)}
    points = predict(study, elements=160)[pose].points
    at = np.linspace(0, 160, links + 1).round().astype(int)
    off = np.linalg.norm(there - np.asarray(points)[at], axis=1) / study.cable["length"]
    return row | {"off": float(np.max(off))}


def repeatability(name: str) -> float:
    """RMS distance over the length between the takes of one pose, of an example."""
    study = load_study(example_path(name))
    off = [difference(study.pose(a), study.pose(b)) for group in repeats(study) for a, b in combinations(group, 2)]
    return float(np.sqrt(np.mean(np.square(off)))) / study.cable["length"]


def main() -> None:
    prepare_jax()
    known, versions = recorded("simulators"), {name: version(name) for name in TARGETS}
    same = all(known.get(name) == versions[name] for name in TARGETS)
    rows = {(r["target"], r["cable"], r["links"]): r for r in known["rows"]} if same else {}
    real = {name: repeatability(name) for name in REAL}

    keep = lambda: record("simulators", versions | {"repeatability": real, "rows": list(rows.values())})  # noqa: E731
    complete(rows, product(TARGETS, CABLES, LINKS), one, keep)
    keep()


if __name__ == "__main__":
    main()
