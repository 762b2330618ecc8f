"""Cables hung to rest in Newton beside our own equilibria.

    python -m benchmarks.newton [--links 20 40] [--record]      # pip install newton

Five cables of 1 m and 0.2 kg/m, added by `export.to_newton`, settle in `SolverVBD` on the CPU for a second and a half:
400 steps a second of 40 iterations, stretch and shear softened to 1 kN, bending and twist damped so that their strain decays in
0.05 s. A distance is the largest of a link from its node, over the length; our equilibrium has 160 elements.
"""

import argparse
import time
from dataclasses import replace

import numpy as np

from benchmarks.record import record
from scan2flex_jax import load_study, predict
from scan2flex_jax.cli.setup import prepare_jax
from scan2flex_jax.examples import example_path
from scan2flex_jax.export import to_newton

CABLES = {  # EI and GJ (N m^2), natural curvature (1/m), pose
    "soft": (0.02, 0.05, None, "plane"),
    "plane": (0.1, 0.25, None, "plane"),
    "stiff": (0.5, 1.25, None, "plane"),
    "twisted": (0.1, 0.25, None, "twist-90"),
    "naturally curved": (0.1, 0.25, (1.0, 0.0, 0.0), "aside-45"),
}
AXIAL, DECAY, STEP, SECONDS, ITERATIONS = 1e3, 0.05, 1 / 400, 1.5, 40  # N, s, s, s


def cable(EI, GJ, curvature):
    study = load_study(example_path("simulated-cable"))
    values = study.cable | {"bending_stiffness": EI, "torsional_stiffness": GJ}
    values |= {} if curvature is None else {"natural_curvature": curvature}
    return replace(study, unknowns=(), cable=values)


def hung(study, pose, links, EI, GJ) -> np.ndarray:
    """Positions (n + 1, 3) of the links at rest, in m."""
    import newton  # noqa: PLC0415 - an optional package

    builder, ds = newton.ModelBuilder(gravity=tuple(map(float, study.gravity))), study.cable["length"] / links
    damping = {"bend_damping": EI / ds * DECAY, "twist_damping": GJ / ds * DECAY}
    soft = {"stretch_stiffness": AXIAL / ds, "shear_stiffness": AXIAL / ds}
    bodies, _ = to_newton(study, builder, pose=pose, elements=links, **soft, **damping)
    builder.color()
    model = builder.finalize(device="cpu")
    solver = newton.solvers.SolverVBD(model, iterations=ITERATIONS)
    now, then, control = model.state(), model.state(), model.control()
    for _ in range(round(SECONDS / STEP)):
        now.clear_forces()
        solver.step(now, then, control, None, STEP)
        now, then = then, now
    return now.body_q.numpy()[bodies][:, :3]


def one(name, links) -> dict:
    """The figures of one cable."""
    EI, GJ, curvature, pose = CABLES[name]
    study, began = cable(EI, GJ, curvature), time.perf_counter()
    there = hung(study, pose, links, EI, GJ)
    points = predict(study, elements=160)[pose].points
    at = np.linspace(0, 160, links + 1).round().astype(int)
    off = np.linalg.norm(there - np.asarray(points)[at], axis=1) / study.cable["length"]
    return {"cable": name, "links": links, "off": float(np.max(off)), "seconds": time.perf_counter() - began}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--links", type=int, nargs="+", default=[20, 40])
    parser.add_argument("--record", action="store_true")
    given = parser.parse_args()
    prepare_jax()
    from importlib.metadata import version  # noqa: PLC0415

    rows = []
    for name in CABLES:
        for links in given.links:
            rows.append(one(name, links))
            print(rows[-1], flush=True)
    if given.record:
        record("newton", {"newton": version("newton"), "rows": rows})


if __name__ == "__main__":
    main()
