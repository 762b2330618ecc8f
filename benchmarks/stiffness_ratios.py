"""Error of the elements where bending and torsional stiffnesses differ, against the continuous rod.

`python -m benchmarks.stiffness_ratios` solves two twisted clamped cables (poses P2 and P3 of the tests, 1 m, 0.2 kg/m) with
stiffness ratios from 1 to 125 by collocation (`tests/reference/cosserat_bvp.py`, which shares no code with the package) and
with 20, 40 and 80 elements, from the reference's own frames. Four families of ratio r, in N m^2:

    GJ/EI           EI = 0.1, GJ = 0.1 r                    EI2/EI1         EI1 = GJ = 0.1, EI2 = 0.1 r
    EI/GJ           EI = 0.1, GJ = 0.1 / r                  EI2/EI1, soft   EI1 = GJ = 0.1 / r, EI2 = 0.1

Errors are largest distances of nodes, in parts of the length: with the law of the elements (`rod.element_law`), and with the
*stiffened* one, which the solver uses far from a solution and which was the law at every strain before. The record is
`benchmarks/results/stiffness_ratios.json`, the table in docs/accuracy.md.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.record import record
from scan2flex_jax import Boundary, Cable, CableModel
from scan2flex_jax.rod.model import Configuration, discretise
from scan2flex_jax.statics.newton import stiffened
from scan2flex_jax.statics.solve import solve_rod
from tests.reference import clamped_cases, cosserat_bvp

RATIOS, MESHES, POSES = (1, 2, 5, 8, 15, 25, 50, 125), (20, 40, 80), ("P2", "P3")
FAMILIES = {
    "GJ/EI": lambda r: (0.1, 0.1, 0.1 * r),
    "EI/GJ": lambda r: (0.1, 0.1, 0.1 / r),
    "EI2/EI1": lambda r: (0.1, 0.1 * r, 0.1),
    "EI2/EI1, soft": lambda r: (0.1 / r, 0.1, 0.1 / r),
}
RIGID = 1.0e8  # N: stretches the cables, which the reference has inextensible, by 2e-8
jax.config.update("jax_enable_x64", True)


def references(pose: str, family: str) -> dict[int, cosserat_bvp.Equilibrium]:
    """The continuous rod at each of `RATIOS`."""
    return dict(zip(RATIOS, clamped_cases.with_ratios(pose, [FAMILIES[family](r) for r in RATIOS]), strict=True))


def errors(exact: cosserat_bvp.Equilibrium) -> dict[str, list]:
    """Largest distance of a node (parts of L) on each mesh, with both laws, None if not solved; and the steps of the law."""
    rod = exact.rod
    model = CableModel(Cable(rod.length, rod.weight / 9.81, rod.K[:2], rod.K[2], RIGID, RIGID), jnp.array([0.0, 0.0, -9.81]))
    clamps = Boundary.of((np.zeros(3), rod.start_frame), (np.array(rod.end, float), rod.end_frame))
    out: dict[str, list] = {"error": [], "stiffened": [], "steps": []}
    for n in MESHES:
        nodes = np.linspace(0.0, rod.length, n + 1)
        own = Configuration(jnp.array(exact.positions(nodes)), jnp.array(exact.frames(nodes)))
        discrete = discretise(model, clamps, n)
        stiff = eqx.tree_at(lambda r: r.section.within, discrete, stiffened(discrete, jnp.array(False))[0])
        for name, given in (("error", discrete), ("stiffened", stiff)):
            e = solve_rod(given, own)
            off = float(np.max(np.linalg.norm(np.asarray(e.points) - own.r, axis=1))) / rod.length
            out[name].append(off if bool(e.verdict.solved) else None)
            if name == "error":
                out["steps"].append(int(e.verdict.steps))
    return out


def main() -> None:
    results: dict[str, dict] = {"meshes": list(MESHES), "poses": list(POSES), "families": {}}
    for family in FAMILIES:
        own: dict[str, dict] = {str(ratio): {} for ratio in RATIOS}
        for pose in POSES:
            for ratio, exact in references(pose, family).items():
                own[str(ratio)][pose] = found = errors(exact)
                print(family, pose, ratio, found, flush=True)
        results["families"][family] = own
        record("stiffness_ratios", results)


if __name__ == "__main__":
    main()
