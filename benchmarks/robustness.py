"""Cables and poses outside the intended range: each is solved, or refused with a reason.

`python -m benchmarks.robustness` solves every case and, if a shape was found, fits the stiffnesses to that shape. An outcome is
"solved" (a stable equilibrium, all finite; a fit that is believed), "refused" (with the sentence), or "failure": a traceback, a
number that is not finite, a length that no force explains, or a confident fit of a wrong value. The record is
`benchmarks/results/robustness.json`.
"""

import traceback
from dataclasses import dataclass
from time import perf_counter

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.record import complete, record
from scan2flex_jax import Boundary, Cable, CableModel, Scan2FlexError, Study, equilibrium, fit

jax.config.update("jax_enable_x64", True)

ALONG, UP = [0.5, 0.5, 0.5, 0.5], [1.0, 0.0, 0.0, 0.0]  # d3 = +x; d3 = +z
SOLVED, REFUSED, FAILURE = "solved", "refused", "failure"
STEEL = {"density": 0.617, "EI": 103.0, "GJ": 78.5, "EA": 1.65e7}  # a rod of 10 mm
FIT_WITHIN = 0.05  # relative error of the fitted EI above which a fit that calls itself determined is a failure


@dataclass(frozen=True)
class Case:
    """One cable (m, kg/m, N m^2, N) from a clamp at the origin along ``first`` to one at ``to`` (None: free) along ``last``."""

    length: float = 1.0
    density: float = 0.2
    EI: float = 0.1
    GJ: float = 0.25
    EA: float = 1.0e5
    to: tuple | None = (0.6, 0.0, 0.0)
    first: tuple = tuple(ALONG)
    last: tuple = tuple(ALONG)
    turns: int = 0
    elements: int = 40
    gravity: float = 9.81


def cases() -> dict[str, Case]:
    """All cases by what they are."""
    out = {
        "steel rod of 10 mm, bent to 0.6 L": Case(**STEEL),
        "steel rod of 10 mm, almost straight": Case(**STEEL, to=(0.999, 0.0, 0.0)),
        "steel rod of 10 mm, twisted by a turn": Case(**STEEL, turns=1),
        "chain: EI = GJ = 1e-6": Case(EI=1e-6, GJ=1e-6),
        "chain: EI = GJ = 1e-5, 200 elements": Case(EI=1e-5, GJ=1e-5, elements=200),
        "chain: EI = GJ = 1e-4": Case(EI=1e-4, GJ=1e-4),
        "chain hanging from a clamp along x": Case(EI=1e-6, GJ=1e-6, to=None),
        "50 m, EI 10": Case(length=50.0, density=1.0, EI=10.0, GJ=10.0, to=(30.0, 0.0, 0.0)),
        "50 m, EI 10, 400 elements": Case(length=50.0, density=1.0, EI=10.0, GJ=10.0, to=(30.0, 0.0, 0.0), elements=400),
        "50 m, EI 1000": Case(length=50.0, density=1.0, EI=1000.0, GJ=1000.0, to=(30.0, 0.0, 0.0)),
        "5 cm, EI 1e-4": Case(length=0.05, density=0.02, EI=1e-4, GJ=1e-4, to=(0.03, 0.0, 0.0)),
        "5 cm, EI 1e-7": Case(length=0.05, density=0.001, EI=1e-7, GJ=1e-7, to=(0.03, 0.0, 0.0)),
        "20 turns of twist, 40 elements": Case(turns=20),
        "20 turns of twist, 200 elements": Case(turns=20, elements=200),
        "20 turns of twist, soft in twist": Case(turns=20, GJ=0.001, elements=200),
        "5 turns of twist": Case(turns=5, elements=100),
        "clamps at distance L": Case(to=(1.0, 0.0, 0.0)),
        "clamps at distance L, turned by 90 degrees": Case(to=(1.0, 0.0, 0.0), last=tuple(UP)),
        "clamps 1.001 L apart": Case(to=(1.001, 0.0, 0.0)),
        "clamps 1.05 L apart": Case(to=(1.05, 0.0, 0.0)),
        "clamps 3 L apart": Case(to=(3.0, 0.0, 0.0)),
        "clamps in one place": Case(to=(0.0, 0.0, 0.0)),
        "clamps in one place, opposite": Case(to=(0.0, 0.0, 0.0), last=(0.5, 0.5, -0.5, -0.5)),
        "no gravity": Case(gravity=0.0),
        "100 times gravity": Case(gravity=981.0),
        "upright from the floor, free end": Case(to=None, first=tuple(UP), EI=0.01),
        "axial stiffness 1e9": Case(EA=1e9),
        "axial stiffness 10": Case(EA=10.0),
    }
    out |= {f"{n} elements": Case(elements=n) for n in (8, 16, 250, 1000)}
    aside = {"to": (0.6, 0.2, 0.0), "last": (0.0, 2**-0.5, 0.0, 2**-0.5)}
    for power in (-4, -2, 2, 4):
        out[f"GJ/EI = 1e{power}"] = Case(GJ=0.1 * 10.0**power)
        out[f"GJ/EI = 1e{power}, twisted by a quarter"] = Case(GJ=0.1 * 10.0**power, **aside)
    return out


def _scene(case):
    cable = Cable(case.length, case.density, case.EI, case.GJ, axial_stiffness=case.EA, shear_stiffness=case.EA)
    end = None if case.to is None else (case.to, case.last)
    return CableModel(cable, jnp.array([0.0, 0.0, -case.gravity])), Boundary.of(([0.0] * 3, case.first), end)


def solved(case: Case) -> dict:
    """The case through `equilibrium`."""
    model, boundary = _scene(case)
    e = equilibrium(model, boundary, turns=case.turns, elements=case.elements)
    points, v = np.asarray(e.points), e.verdict
    out = {"steps": int(v.steps), "says": v.sentence(), "out_of_balance": float(v.out_of_balance)}
    if not bool(v.solved):
        return out | {"outcome": REFUSED}
    numbers = [points, *map(np.asarray, e.section_forces()), *map(np.asarray, e.reactions())]
    finite = all(np.all(np.isfinite(x)) for x in numbers)
    stretch = float(np.sum(np.linalg.norm(np.diff(points, axis=0), axis=1))) / case.length - 1.0
    pulled = float(np.max(np.linalg.norm(numbers[2], axis=1))) / case.EA
    sound = finite and stretch < 0.01 + 2.0 * pulled  # else longer than its forces can make it
    out |= {"outcome": SOLVED if sound else FAILURE, "stretch of the polygon": stretch, "force over EA": pulled}
    return out | {"points": points}


def study_of(case: Case, points: np.ndarray) -> Study:
    """The case as a study with ``points`` as its centre curve, which asks for both stiffnesses."""
    cable = {"length": case.length, "length_density": case.density, "axial_stiffness": case.EA, "shear_stiffness": case.EA}
    pose = {"name": "one", "points": points, "turns": case.turns, "start": ([0.0] * 3, case.first)}
    pose |= {} if case.to is None else {"end": (case.to, case.last)}
    return Study.from_arrays(
        cable, [pose], ["bending_stiffness", "torsional_stiffness"], gravity=[0.0, 0.0, -case.gravity]
    )  # fmt: skip


def fitted(case: Case, points) -> dict:
    """A fit to the shape that was found: it recovers the value, or reports it as not determined."""
    found = fit(study_of(case, points), elements=case.elements)
    EI = found.estimates["bending_stiffness"]
    error, sure = float(EI.value) / case.EI - 1.0, EI.identifiable and found.believable
    wrong = not np.isfinite(error) or (sure and not EI.at_bound and abs(error) > FIT_WITHIN)
    outcome = FAILURE if wrong else SOLVED if sure else REFUSED
    return {"outcome": outcome, "says": " ".join(found.sentences)[:300], "relative error of EI": error}


def attempted(step, *arguments) -> dict:
    """A step with its time; an exception is a failure."""
    begin = perf_counter()
    try:
        out = step(*arguments)
    except Scan2FlexError as error:
        out = {"outcome": REFUSED, "says": str(error)}
    except Exception:
        out = {"outcome": FAILURE, "says": traceback.format_exc().strip().splitlines()[-1]}
    return out | {"seconds": round(perf_counter() - begin, 2)}


def run(case: Case, fits: bool = True) -> dict:
    """The equilibrium of a case, and the fit to its shape."""
    found = attempted(solved, case)
    points = found.pop("points", None)
    return {"equilibrium": found} | ({"fit": attempted(fitted, case, points)} if points is not None and fits else {})


def main() -> None:
    rows: dict[str, dict] = {}
    every = cases()

    def keep():
        outcomes = [r["outcome"] for row in rows.values() for r in row.values()]
        record("robustness", {"cases": rows, "outcomes": {o: outcomes.count(o) for o in (SOLVED, REFUSED, FAILURE)}})

    complete(rows, every, lambda name: run(every[name]), keep)


if __name__ == "__main__":
    main()
