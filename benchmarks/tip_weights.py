"""Undeclared weights at the tips of real cables: are they found, with which mass, and is the prediction of unseen poses better?

    git clone https://github.com/sebtiburzio/PAC_model_matlab
    git clone https://github.com/sebtiburzio/floating_PAC_model
    python -m benchmarks.tip_weights PAC_model_matlab [--parameters floating_PAC_model] [--json FILE] [--only orange] [--record]

Four cables, each without and with a weight in the fitting at its free end, 23 static poses of each series: the clamp turned in
a vertical plane, a marker in the middle and one at the end (MSc thesis TU Delft, arXiv 2402.16114). The repositories have no
licence, so nothing of them is kept here: the record holds what this package makes of them.

How a row is read (x to the side, z up, metres, radians): the clamp is turned by `Gamma` about y from a cable that hangs down,
`X, Z` are the markers in the turned frame, at L/2 and L. Poses are planar, so GJ is given and without influence on them. By
angle, every third pose is fitted from the first on; the others are `validate`. Poses stand in the order of the file, to both
sides by turns and further each time: it is taken for the order of measurement, and effects with memory need it.

Five questions per cable, the noise of a marker unstated:

* `without`: what is missing when only the fitting is on (it is known, 0.03 kg of point mass at the tip);
* `carried over`: prediction of the poses with the weight by the answer to that, nothing fitted;
* `with`: the weight on and undeclared, EI and the effects from `without` as an experimenter would carry them over;
* `with, alone`: the same poses with nothing carried over;
* `both`: both series in one study, with the effects of `without`, their values unknown; the weight is an unknown point mass
  that acts in its own poses.
"""

import argparse
import csv
import json
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import numpy as np

from benchmarks.record import record
from scan2flex_jax.cli.setup import prepare_jax
from scan2flex_jax.inference import explain, fit
from scan2flex_jax.prediction import predict
from scan2flex_jax.study import EffectDeclaration, Markers, Study, Unknown
from scan2flex_jax.study.kinds import kind_format

CABLES = ("orange", "black", "orange_short", "black_short")
FALLEN = 0.3  # of the length: a pose further off than this has fallen over to another branch
FOLDER = "fixed_base/data_in/0802-equilibrium_data"
EVERY = 3  # of the poses, sorted by angle, is fitted
GRAVITY = 9.81
GJ = 0.1  # N m^2
CARRIED = 0.04  # relative standard deviation with which EI is carried over to another series
HANGING = np.array([[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])  # columns d1, d2, d3: down; d2 = y bends it in plane


@dataclass(frozen=True)
class Series:
    """One cable with one weight (kg, m, 1/m); per pose its rank by angle, angle (rad) and markers (n, 2, 2)."""

    name: str
    mass: float
    end_mass: float
    length: float
    diameter: float
    rest_curvature: float
    ranks: np.ndarray
    angles: np.ndarray
    markers: np.ndarray


def read(cable, weighted, measured: Path, stated: Path) -> Series:
    """A series of the clones in the order of its file; its rest curvature is the authors', averaged along the cable."""
    name = f"{cable}_{'' if weighted else 'un'}weighted"
    table = measured / FOLDER / f"{name}_equilibria" / "theta_equilibria.csv"
    numbers = stated / "object_parameters" / f"{name}.txt"
    for path in (table, numbers):
        if not path.is_file():
            sys.exit(f"{path} is missing: name the clones of PAC_model_matlab and, with --parameters, floating_PAC_model")
    mass, end_mass, length, diameter, _, constant, linear, *_ = map(float, numbers.read_text().strip().split(","))
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    markers = [[[float(row[f"{axis}_{place}"]) for axis in "XZ"] for place in ("mid", "end")] for row in rows]
    angles = np.array([float(row["Gamma"]) for row in rows])
    bent = (constant + linear / 2) / length
    ranks = np.argsort(np.argsort(angles))
    return Series(name, mass, end_mass, length, diameter, bent, ranks, angles, np.array(markers))


def turned(angle):
    """Rotation about y."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def poses_of(series: Series) -> list[dict]:
    """The poses as `Study.from_arrays` takes them."""
    out, s = [], [series.length / 2, series.length]
    for k, angle, seen in zip(series.ranks.tolist(), series.angles, series.markers, strict=True):
        R = turned(angle)
        points = np.stack([seen[:, 0], np.zeros(2), seen[:, 1]], axis=1) @ R.T
        role = "validate" if k % EVERY else "fit"
        held = {"start": ([0.0, 0.0, 0.0], R @ HANGING), "markers": Markers(points, s)}
        out.append({"name": f"{series.name}-{k:02d}", "role": role, **held})
    return out


def cable_of(series: Series) -> dict:
    """The stated properties of a cable."""
    known = {"length": series.length, "radius": series.diameter / 2, "length_density": series.mass / series.length}
    return known | {"torsional_stiffness": GJ}


def study_of(series: Series, fitting: float, unknowns=("bending_stiffness",), effects=()):
    """One series, its fitting (kg) declared at the tip."""
    held = EffectDeclaration("point_mass", {"position": series.length, "mass": fitting})
    return Study.from_arrays(cable_of(series), poses_of(series), unknowns, title=series.name, effects=(held, *effects))


def freed(kind: str, values: dict) -> tuple:
    """The parameters of an effect that can be estimated as unknowns that start at these ``values``."""
    estimable = {p.name for p in kind_format(kind).parameters if p.estimable}
    return tuple(Unknown(f"{kind}.{name}", guess=value) for name, value in values.items() if name in estimable)


def carried_over(told: dict) -> dict:
    """EI with its prior, and the effects, of an explanation of the series without the weight (`of_explanation`)."""
    EI = told["estimates"]["bending_stiffness"]["value"]
    return {"unknowns": [Unknown("bending_stiffness", prior={"mean": EI, "std": CARRIED * EI})], "effects": added(told)}


def added(told: dict) -> tuple:
    """The effects of an explanation as declarations."""
    return tuple(EffectDeclaration(c["kind"], c["parameters"]) for c in told.get("added", []))


def predicted(study, EI: float) -> dict:
    """Distances (m) of the markers of a study from the cable of this EI: RMS of each role, and of the held-out poses
    the median and those that fall over."""
    known = replace(study, cable=study.cable | {"bending_stiffness": EI}, unknowns=())
    errors: dict[str, dict] = {"fit": {}, "validate": {}}
    for pose, shape in zip(known.poses, predict(known).values(), strict=True):
        at = [np.interp(pose.markers.arc_length, shape.s, x) for x in shape.points.T]
        off = np.sum((np.transpose(at) - pose.markers.points) ** 2, axis=1)
        errors[pose.role][pose.name] = float(np.sqrt(np.mean(off)))
    out = {f"rms_{role}": float(np.sqrt(np.mean(np.square(list(e.values()))))) for role, e in errors.items()}
    length, unseen = float(known.cable["length"]), errors["validate"]
    fallen = [name for name, error in unseen.items() if error > FALLEN * length]
    return {"after": out, "median of held-out poses": float(np.median(list(unseen.values()))), "fallen over": fallen}


def complete(answers: dict, without: Series, weighed: Series) -> None:
    """Each answer of `explain` with its predictions of the poses never fitted."""
    carried: tuple = ()
    for words, series in (("without", without), ("carried over", weighed), ("with", weighed), ("with, alone", weighed)):
        told = answers.get(words, {})
        if "failed" in told or not (words == "carried over" or "estimates" in told):
            continue
        own = added(told)
        effects = own if words == "with, alone" else (*carried, *own)
        carried = own if words == "without" else carried
        EI = answers["without" if words == "carried over" else words]["estimates"]["bending_stiffness"]["value"]
        seen = predicted(study_of(series, without.end_mass, effects=effects), EI)
        told |= {k: v for k, v in seen.items() if k != "after"}


def together(without: Series, weighed: Series, told: dict):
    """Both series in one study, with the effects of the explanation ``told`` and the mass of the weight unknown.

    Two point masses cannot share an unknown's name, so the fitting is declared as the dead load that it is.
    """
    heavy = poses_of(weighed)
    heavy[0]["reset"] = True
    load = {"position": without.length, "force": [0.0, 0.0, -GRAVITY * without.end_mass]}
    weight = EffectDeclaration("point_mass", {"position": without.length}, tuple(p["name"] for p in heavy))
    effects = (EffectDeclaration("point_load", load), weight, *added(told))
    unknowns = ["bending_stiffness", Unknown("point_mass.mass", guess=weighed.end_mass - without.end_mass)]
    unknowns += [unknown for c in told["added"] for unknown in freed(c["kind"], c["parameters"])]
    return Study.from_arrays(
        cable_of(without), [*poses_of(without), *heavy], unknowns, title=f"{without.name}, both", effects=effects
    )  # fmt: skip


def of_explanation(found, seconds) -> dict:
    """The figures of an explanation."""
    told = found.to_json()
    kept = ("verdict", "estimates", "before", "after", "discrepancy", "noise", "test", "settle")
    out = {key: told[key] for key in kept if key in told} | {"added": [r.in_short() for r in found.chosen]}
    out |= {"seconds": seconds, "sentences": list(found.sentences)}
    return out | {"ranking": told.get("ranking", [])[:5]}


def of_fit(found, seconds) -> dict:
    """The figures of a fit; RMS distances in m."""
    told = found.to_json()
    out = {key: told[key] for key in ("estimates", "noise", "discrepancy") if key in told}
    after = {f"rms_{role}": found.rms(role) for role in ("fit", "validate") if np.isfinite(found.rms(role))}
    return out | {"after": after, "sentences": list(found.sentences), "valid": found.valid, "seconds": seconds}


def asked(call, tell) -> dict:
    """The figures of `call()`, or the sentence with which it failed."""
    began = perf_counter()
    try:
        found = call()
    except Exception as fault:  # a benchmark counts failures
        return {"failed": f"{type(fault).__name__}: {fault}"[:300], "seconds": perf_counter() - began}
    return tell(found, perf_counter() - began)


def questions(without: Series, weighed: Series, out: dict) -> None:
    """All of one cable, into ``out``; answers that are there are kept."""

    def ask(words, call, tell):
        if words not in out:
            out[words] = asked(call, tell)
            sys.stderr.write(f"{without.name}, {words}: {out[words]}\n")

    fitting = without.end_mass
    ask("without", lambda: explain(study_of(without, fitting)), of_explanation)
    told = out["without"]
    if told.get("estimates"):
        known, EI = carried_over(told), told["estimates"]["bending_stiffness"]["value"]
        ask("carried over", lambda: predicted(study_of(weighed, fitting, **known), EI), lambda told, _: told)
        ask("with", lambda: explain(study_of(weighed, fitting, **known)), of_explanation)
    ask("with, alone", lambda: explain(study_of(weighed, fitting)), of_explanation)
    if told.get("added"):
        ask("both", lambda: fit(together(without, weighed, told)), of_fit)
    complete(out, without, weighed)


def main() -> None:
    """All selected cables; results of an earlier run in the file are kept."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clone", type=Path, help="work tree of PAC_model_matlab")
    parser.add_argument("--parameters", type=Path, help="work tree of floating_PAC_model; left out: it lies beside the other")
    parser.add_argument("--json", type=Path, help="results so far: a run that was stopped goes on from it")
    parser.add_argument("--only", choices=CABLES, nargs="+", default=CABLES, help="some of the cables")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/tip_weights.json")
    args = parser.parse_args()
    prepare_jax()
    stated = args.parameters or args.clone.resolve().parent / "floating_PAC_model"
    out = json.loads(args.json.read_text()) if args.json and args.json.exists() else {}
    for cable in args.only:
        without, weighed = (read(cable, weighted, args.clone, stated) for weighted in (False, True))
        questions(without, weighed, out.setdefault(cable, {}))
        if args.json:
            args.json.write_text(json.dumps(out, indent=1) + "\n")
    if args.record:
        record("tip_weights", out)


if __name__ == "__main__":
    main()
