"""Undeclared weights at the tips of real cables: are they found, with which mass, and is the prediction of unseen poses better?

    git clone https://github.com/sebtiburzio/PAC_model_matlab
    git clone https://github.com/sebtiburzio/floating_PAC_model
    python -m benchmarks.tip_weights PAC_model_matlab [--parameters floating_PAC_model] [--json FILE] [--only orange]

Four cables, each without and with a weight in the fitting at its free end, 23 static poses of each series: the clamp turned in
a vertical plane, a marker in the middle and one at the end (MSc thesis TU Delft, arXiv 2402.16114). The repositories have no
licence, so nothing of them is kept here: the record holds what this package makes of them.

How a row is read (x to the side, z up, metres, radians): the clamp is turned by `Gamma` about y from a cable that hangs down,
`X, Z` are the markers in the turned frame, at L/2 and L. The baseline fit checks this reading: with the other sign of
`Gamma`, or of gravity, it must be worse (`reading` in the record). Poses are planar, so GJ is a given number without
influence on them. By angle, every third pose is fitted from the first on; the others have no part in anything but `validate`.
Poses stand in the order of the file, to both sides by turns and further each time, which is that of no column: it is taken for
the order of measurement, and effects with memory need it.

Nine questions per cable, each with the noise of a marker unstated and as 1 mm:

* `without`: what is missing when only the fitting is on (it is known, 0.03 kg of point mass at the tip);
* `carried over`: prediction of the poses with the weight by the answer to that, nothing fitted;
* `with`: the weight on and undeclared, EI and the effects from `without` as an experimenter would carry them over;
* `with, alone`: the same poses with nothing carried over;
* `both`: both series in one study, the weight an unknown point mass that acts in its own poses;
* `both, softening`: the same with bending that softens with curvature, which bears on the mass;
* `both, friction`: the same with inner friction, each series from a cable without history on;
* `both, as found`: the same with the effects of `without` in place of a uniform natural curvature, their values unknown;
* `known weight`: both series, the weight declared and the cable never weighed.
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
from benchmarks.unknowns import freed

CABLES = ("orange", "black", "orange_short", "black_short")
FALLEN = 0.3  # of the length: a pose further off than this has fallen over to another branch
FOLDER = "fixed_base/data_in/0802-equilibrium_data"
EVERY = 3  # of the poses, sorted by angle, is fitted
NOISE = {"noise unstated": None, "noise 1 mm": 1e-3}
GRAVITY = 9.81
GJ = 0.1  # N m^2
# Starts, curvatures in 1/m
STARTS = {"nonlinear_bending": {"slip_curvature": 2.0, "ratio": 0.6}, "friction": {"share": 0.4, "slip_curvature": 0.7}}
CARRIED = 0.04  # relative standard deviation with which EI is carried over to another series
TOGETHER = {
    "both": {},
    "both, softening": {"beside": "nonlinear_bending"},
    "both, friction": {"beside": "friction"},
    "known weight": {"known_weight": True},
}
HANGING = np.array([[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])  # columns d1, d2, d3: down; d2 = y bends it in plane


@dataclass(frozen=True)
class Series:
    """One cable with one weight: what is stated of it (kg, kg, m, m, 1/m, N m^2), and per pose its rank by angle, angle (rad)
    and markers (n, 2, 2)."""

    name: str
    mass: float
    end_mass: float
    length: float
    diameter: float
    rest_curvature: float
    bending_stiffness: float
    ranks: np.ndarray
    angles: np.ndarray
    markers: np.ndarray


def read(cable, weighted, measured: Path, stated: Path) -> Series:
    """A series of the clones in the order of its file; its rest curvature is the authors', averaged along the cable, its
    bending stiffness the authors' stiffness against curvature times the length, times that length."""
    name = f"{cable}_{'' if weighted else 'un'}weighted"
    table = measured / FOLDER / f"{name}_equilibria" / "theta_equilibria.csv"
    numbers = stated / "object_parameters" / f"{name}.txt"
    for path in (table, numbers):
        if not path.is_file():
            sys.exit(f"{path} is missing: name the clones of PAC_model_matlab and, with --parameters, floating_PAC_model")
    mass, end_mass, length, diameter, k, constant, linear, *_ = map(float, numbers.read_text().strip().split(","))
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    markers = [[[float(row[f"{axis}_{place}"]) for axis in "XZ"] for place in ("mid", "end")] for row in rows]
    angles = np.array([float(row["Gamma"]) for row in rows])
    bent = (constant + linear / 2) / length
    ranks = np.argsort(np.argsort(angles))
    return Series(name, mass, end_mass, length, diameter, bent, k * length, ranks, angles, np.array(markers))


def turned(angle):
    """Rotation about y."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def poses_of(series: Series, noise, sign=1.0) -> list[dict]:
    """The poses as `Study.from_arrays` takes them; ``sign`` turns the angles round."""
    from scan2flex_jax.study import Markers  # noqa: PLC0415 - the environment must be set first

    out, s = [], [series.length / 2, series.length]
    for k, angle, seen in zip(series.ranks.tolist(), series.angles, series.markers, strict=True):
        R = turned(sign * angle)
        points = np.stack([seen[:, 0], np.zeros(2), seen[:, 1]], axis=1) @ R.T
        role = "validate" if k % EVERY else "fit"
        held = {"start": ([0.0, 0.0, 0.0], R @ HANGING), "markers": Markers(points, s)}
        out.append({"name": f"{series.name}-{k:02d}", "role": role, "noise": noise, **held})
    return out


def cable_of(series: Series) -> dict:
    """The stated properties of a cable."""
    known = {"length": series.length, "radius": series.diameter / 2, "length_density": series.mass / series.length}
    return known | {"torsional_stiffness": GJ}


def study_of(series: Series, fitting: float, noise, unknowns=("bending_stiffness",), effects=(), **reading):
    """One series, its fitting (kg) declared at the tip."""
    from scan2flex_jax.study import EffectDeclaration, Study  # noqa: PLC0415

    held = EffectDeclaration("point_mass", {"position": series.length, "mass": fitting})
    gravity = [0.0, 0.0, -GRAVITY * reading.pop("down", 1.0)]
    poses = poses_of(series, noise, **reading)
    return Study.from_arrays(
        cable_of(series), poses, unknowns, title=series.name, gravity=gravity, effects=(held, *effects)
    )  # fmt: skip


def carried_over(told: dict) -> dict:
    """EI with its prior, and the effects, of an explanation of the series without the weight (`of_explanation`)."""
    from scan2flex_jax.study import Unknown  # noqa: PLC0415

    EI = told["estimates"]["bending_stiffness"]["value"]
    return {"unknowns": [Unknown("bending_stiffness", prior={"mean": EI, "std": CARRIED * EI})], "effects": added(told)}


def added(told: dict) -> tuple:
    """The effects of an explanation as declarations."""
    from scan2flex_jax.study import EffectDeclaration  # noqa: PLC0415

    return tuple(EffectDeclaration(c["kind"], c["parameters"]) for c in told.get("added", []))


def predicted(study, EI: float) -> dict:
    """Distances (m) of the markers of a study from the cable of this EI: RMS of each role, and of the poses never seen
    the median and those that fall over."""
    from scan2flex_jax.prediction import predict  # noqa: PLC0415

    known = replace(study, cable=study.cable | {"bending_stiffness": EI}, unknowns=())
    errors: dict[str, dict] = {"fit": {}, "validate": {}}
    for pose, shape in zip(known.poses, predict(known).values(), strict=True):
        at = [np.interp(pose.markers.arc_length, shape.s, x) for x in shape.points.T]
        off = np.sum((np.transpose(at) - pose.markers.points) ** 2, axis=1)
        errors[pose.role][pose.name] = float(np.sqrt(np.mean(off)))
    out = {f"rms_{role}": float(np.sqrt(np.mean(np.square(list(e.values()))))) for role, e in errors.items()}
    length, unseen = float(known.cable["length"]), errors["validate"]
    fallen = [name for name, error in unseen.items() if error > FALLEN * length]
    return {"after": out, "median of poses never seen": float(np.median(list(unseen.values()))), "fallen over": fallen}


def complete(answers: dict, without: Series, weighed: Series, noise) -> None:
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
        seen = predicted(study_of(series, without.end_mass, noise, effects=effects), EI)
        told |= {k: v for k, v in seen.items() if k != "after"}


def together(without: Series, with_weight: Series, noise, known_weight=False, beside=None, told=None):
    """Both series in one study: natural curvature and an effect ``beside`` it, or the effects ``told`` of the series without
    the weight, with unknown values, and the weight's mass or, where it is known, the cable's.

    Two point masses cannot share an unknown's name, so the fitting is declared as the dead load that it is.
    """
    from scan2flex_jax.study import EffectDeclaration, Study, Unknown  # noqa: PLC0415

    L, extra = without.length, with_weight.end_mass - without.end_mass
    cable, unknowns = cable_of(without), ["bending_stiffness"]
    weight = {"position": L, "mass": extra}
    if known_weight:
        unknowns.append(Unknown("length_density", guess=cable["length_density"]))
    else:
        weight.pop("mass")
        unknowns.append(Unknown("point_mass.mass", guess=extra))
    heavy = poses_of(with_weight, noise)
    heavy[0]["reset"] = True
    effects = [
        EffectDeclaration("point_load", {"position": L, "force": [0.0, 0.0, -GRAVITY * without.end_mass]}),
        EffectDeclaration("point_mass", weight, tuple(p["name"] for p in heavy)),
    ]
    curved = {"kind": "natural_curvature", "parameters": {"curvature": [0.0, without.rest_curvature, 0.0]}}
    told = told or {"added": [curved, *([{"kind": beside, "parameters": STARTS[beside]}] if beside else [])]}
    effects += added(told)
    unknowns += [unknown for c in told["added"] for unknown in freed(c["kind"], c["parameters"])]
    poses = [*poses_of(without, noise), *heavy]
    return Study.from_arrays(cable, poses, unknowns, title=f"{without.name}, both", effects=effects)


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


def reading(series: Series) -> dict:
    """RMS distance (m) of the baseline fit with either sign of the angles and of gravity."""
    from scan2flex_jax.fitting import fit  # noqa: PLC0415

    out = {}
    for words, how in {"as read": {}, "angles reversed": {"sign": -1.0}, "gravity upward": {"down": -1.0}}.items():
        told = asked(lambda how=how: fit(study_of(series, series.end_mass, None, **how)), of_fit)
        out[words] = told.get("after", told)
    return out


def questions(without: Series, weighed: Series, noise, out: dict) -> None:
    """All of one cable, into ``out``; answers that are there are kept."""
    from scan2flex_jax.fitting import fit  # noqa: PLC0415
    from scan2flex_jax.inference import explain  # noqa: PLC0415

    def ask(words, call, tell):
        if words not in out:
            out[words] = asked(call, tell)
            sys.stderr.write(f"{without.name}, {words}: {line(out[words], fitting)}\n")

    fitting = without.end_mass
    ask("without", lambda: explain(study_of(without, fitting, noise)), of_explanation)
    told = out["without"]
    if told.get("estimates"):
        known, EI = carried_over(told), told["estimates"]["bending_stiffness"]["value"]
        ask("carried over", lambda: predicted(study_of(weighed, fitting, noise, **known), EI), lambda told, _: told)
        ask("with", lambda: explain(study_of(weighed, fitting, noise, **known)), of_explanation)
    ask("with, alone", lambda: explain(study_of(weighed, fitting, noise)), of_explanation)
    for words, how in TOGETHER.items():
        ask(words, lambda how=how: fit(together(without, weighed, noise, **how)), of_fit)
    if {c["kind"] for c in told.get("added", [])} - {"natural_curvature"}:  # which is what `both` has
        ask("both, as found", lambda: fit(together(without, weighed, noise, told=told)), of_fit)


def line(told, fitting) -> str:
    """One answer in words."""
    if "failed" in told:
        return f"FAILED {told['failed']}"
    parts = [told.get("verdict", "fitted"), *(named(c, fitting) for c in told.get("added", []))]
    parts += [f"{n} {e['value']:.4g} ({e.get('low')} to {e.get('high')})" for n, e in told.get("estimates", {}).items()
              if np.ndim(e["value"]) == 0]  # fmt: skip
    for when in ("before", "after"):
        rms = told.get(when, {})
        millimetres = [f"{role} {1e3 * rms[key]:.1f}" for role in ("fit", "left_out", "validate")
                       if (key := f"rms_{role}") in rms]  # fmt: skip
        parts += [f"{when}: {', '.join(millimetres)} mm"] if millimetres else []
    return "; ".join(parts)


def named(chosen, fitting) -> str:
    """A chosen effect with 95 % intervals; of a point mass with the fitting that was declared."""
    parts, std = [], chosen.get("std", {})
    for name, value in chosen["parameters"].items():
        half = 1.96 * np.asarray(std.get(name, np.nan), float)
        more = fitting if name == "mass" else 0.0
        parts.append(f"{name} {np.round(np.asarray(value) + more, 4)} +- {np.round(half, 4)}")
    return f"{chosen['kind']}: {', '.join(parts)}"


def main() -> None:
    """All selected cables; results of an earlier run in the file are kept."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clone", type=Path, help="work tree of PAC_model_matlab")
    parser.add_argument("--parameters", type=Path, help="work tree of floating_PAC_model; left out: it lies beside the other")
    parser.add_argument("--json", type=Path, help="results so far: a run that was stopped goes on from it")
    parser.add_argument("--only", choices=CABLES, nargs="+", default=CABLES, help="some of the cables")
    parser.add_argument("--noise", choices=NOISE, nargs="+", default=NOISE, help="one of the noises")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/tip_weights.json")
    args = parser.parse_args()
    from scan2flex_jax.cli.setup import prepare_jax  # noqa: PLC0415

    prepare_jax()
    stated = args.parameters or args.clone.resolve().parent / "floating_PAC_model"
    out = json.loads(args.json.read_text()) if args.json and args.json.exists() else {}
    for cable in args.only:
        without, weighed = (read(cable, weighted, args.clone, stated) for weighted in (False, True))
        entry = out[cable] = {"reading": {}} | out.get(cable, {}) | {"stated": stated_of(without, weighed)}
        entry["reading"] = entry["reading"] or reading(without)
        for words in args.noise:
            questions(without, weighed, NOISE[words], entry.setdefault(words, {}))
            complete(entry[words], without, weighed, NOISE[words])
            if args.json:
                args.json.write_text(json.dumps(out, indent=1) + "\n")
    if args.record:
        record("tip_weights", {"source": "github.com/sebtiburzio/PAC_model_matlab, floating_PAC_model"} | out)


def stated_of(without: Series, weighed: Series) -> dict:
    """Values stated by the authors, for comparison."""
    bent = {s.name: s.rest_curvature for s in (without, weighed)}
    stiff = {s.name: s.bending_stiffness for s in (without, weighed)}
    masses = {s.name: s.end_mass for s in (without, weighed)}
    return {"length": without.length, "mass": without.mass, "end_mass": masses, "rest_curvature": bent,
            "bending_stiffness": stiff}  # fmt: skip


if __name__ == "__main__":
    main()
