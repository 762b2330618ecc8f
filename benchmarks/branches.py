"""Random twisted studies: does a fit find the measured branch, and does it doubt a wrong one?

`python -m benchmarks.branches` makes studies of three poses by the package's own equilibrium (80 elements, from the generic
start, turns -1 to 1), with white noise that no study states and clamps that are off within their declared tolerances, fits
each for EI and GJ, and compares the estimates with the truth in standard errors (z, of the logarithm). A study depends on its
number and the seed alone. Recorded studies are kept, so that an interrupted run continues; `--again` repeats them. The record
is `benchmarks/results/branches.json`; another `--seed` has its own, for fresh studies after a change that these suggested.
"""

import argparse
import json
from time import perf_counter

import jax
import jax.numpy as jnp
import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation

from benchmarks.record import RESULTS, record
from scan2flex_jax import Boundary, Cable, CableModel, Scan2FlexError, Study, equilibrium, fit
from scan2flex_jax.study import Tolerance

SEED, STUDIES, POSES = 19, 200, 3
ELEMENTS, POINTS, DENSITY = 80, 60, 0.2  # kg/m
TOLERANCE = Tolerance(clamp_position=5e-4, clamp_rotation=0.01)  # m, rad
SURE = 4.0  # standard errors by which a believed estimate may not be off
UNKNOWNS = {"bending_stiffness": "EI", "torsional_stiffness": "GJ"}
jax.config.update("jax_enable_x64", True)

ALONG = Rotation.from_quat([0.5, 0.5, 0.5, 0.5])  # d3 = +x


def drawn(number: int, seed: int = SEED) -> tuple[Study, dict]:
    """Study ``number`` of a seed with its truth: stiffnesses (N m^2), length and noise (m), turns."""
    rng = np.random.default_rng([seed, number])
    length = rng.uniform(0.7, 1.4)
    weight = 9.81 * DENSITY * length**3
    EI = weight * np.exp(rng.uniform(np.log(0.02), np.log(0.2)))
    truth = {"EI": EI, "GJ": EI * np.exp(rng.uniform(np.log(0.2), np.log(2.0)))}
    truth |= {"length": length, "noise": rng.uniform(2e-4, 1e-3)}
    model = CableModel(Cable(length, DENSITY, truth["EI"], truth["GJ"]), jnp.array([0.0, 0.0, -9.81]))
    poses = []
    while len(poses) < POSES:
        clamps, turns = _clamps(rng, length), int(rng.integers(-1, 2))
        true = Boundary.of(*((_clamp(*_moved(rng, *c))) for c in clamps))
        e = equilibrium(model, true, turns=turns, elements=ELEMENTS)
        if bool(e.verdict.solved):
            curve = CubicHermiteSpline(np.asarray(e.s), e.points, e.configuration.R[:, :, 2])
            points = curve(np.linspace(0.02, 0.98, POINTS) * length)
            points = points + truth["noise"] * rng.standard_normal(points.shape)
            start, end = (_clamp(*c) for c in clamps)
            poses.append({"points": points, "start": start, "end": end, "turns": turns})
    cable = {"length": length, "length_density": DENSITY}
    return Study.from_arrays(cable, poses, list(UNKNOWNS), title=f"study {number}", tolerance=TOLERANCE), truth | {
        "turns": [p["turns"] for p in poses]
    }


def _clamps(rng, length):
    """Two clamps along x, each tilted at random; the far one aside and rolled by any angle."""
    tilts = [Rotation.from_rotvec(0.15 * rng.standard_normal(3)) for _ in range(2)]
    roll = Rotation.from_rotvec([rng.uniform(-np.pi, np.pi), 0.0, 0.0])
    far = length * np.array([rng.uniform(0.5, 0.8), *rng.uniform(-0.15, 0.15, 2)])
    return (np.zeros(3), tilts[0] * ALONG), (far, tilts[1] * roll * ALONG)


def _moved(rng, position, rotation):
    """A clamp off by its tolerances."""
    turn = rotation * Rotation.from_rotvec(TOLERANCE.clamp_rotation * rng.standard_normal(3))
    return position + TOLERANCE.clamp_position * rng.standard_normal(3), turn


def _clamp(position, rotation):
    return position, np.roll(rotation.as_quat(), 1)


def fitted(number: int, seed: int = SEED) -> dict:
    """The fit of one study, and the truth."""
    study, truth = drawn(number, seed)
    begin = perf_counter()
    try:
        found = fit(study)
    except Scan2FlexError as error:
        return {"truth": truth, "refused": str(error)[:300], "seconds": perf_counter() - begin}
    out = {"truth": truth, "believed": found.believable, "rms": found.rms(), "equilibria": found.equilibria}
    out |= {"seconds": perf_counter() - begin, "turned": list(found.turned), "says": list(found.sentences)}
    for name, letters in UNKNOWNS.items():
        e = found.estimates[name]
        known = e.identifiable and e.low is not None
        spread = np.log(e.high / e.low) / (2 * 1.959964) if known else None
        out[letters] = {"value": e.value, "z": np.log(e.value / truth[letters]) / spread if known else None}
    return out


def summary(studies: dict) -> dict:
    """Counts over all studies: refused, believed, and for the believed ones the errors of the estimates."""
    believed = [s for s in studies.values() if s.get("believed")]
    out = {"studies": len(studies), "refused": sum("refused" in s for s in studies.values()), "believed": len(believed)}
    out["turned"] = sum(bool(s.get("turned")) for s in studies.values())
    for letters in UNKNOWNS.values():
        z = np.abs([s[letters]["z"] for s in believed if s[letters]["z"] is not None])
        figures = {"determined": len(z), "covered": int(np.sum(z < 1.96)), "beyond": int(np.sum(z > SURE))}
        out[letters] = figures | {"largest": float(np.max(z, initial=0.0))}
    return out


def numbers(said: str) -> range:
    """Numbers of studies: "7" or "0-39"."""
    first, _, last = said.partition("-")
    return range(int(first), int(last or first) + 1)


def recorded(name: str) -> dict:
    """The recorded studies, by number."""
    path = RESULTS / f"{name}.json"
    return json.loads(path.read_text())["results"]["studies"] if path.exists() else {}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", help=f"numbers of studies, as 7 or 0-39; all {STUDIES} unless given")
    parser.add_argument("--again", action="store_true", help="fit studies that were recorded too")
    parser.add_argument("--seed", type=int, default=SEED, help="of the random studies; another one has a record of its own")
    a = parser.parse_args()
    name = "branches" if a.seed == SEED else f"branches-{a.seed}"
    studies = recorded(name)
    for number in numbers(a.only or f"0-{STUDIES - 1}"):
        if a.again or str(number) not in studies:
            studies[str(number)] = row = fitted(number, a.seed)
            studies = dict(sorted(studies.items(), key=lambda item: int(item[0])))
            record(name, {"summary": summary(studies), "studies": studies})
            print(number, _line(row), flush=True)


def _line(row) -> str:
    """The result of one study, in a line."""
    if "refused" in row:
        return f"refused: {row['refused']}"
    off = {k: "not determined" if row[k]["z"] is None else f"z {row[k]['z']:+.1f}" for k in UNKNOWNS.values()}
    z = ", ".join(f"{k} {row[k]['value']:.4g} ({said})" for k, said in off.items())
    return f"{'believed' if row['believed'] else 'not believed'}: {z}, rms {row['rms'] / row['truth']['noise']:.1f} of noise"


if __name__ == "__main__":
    main()
