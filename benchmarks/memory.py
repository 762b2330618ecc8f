"""Cables that remember, recovered from ordered poses of an independent solver with another law of friction.

`OPENBLAS_NUM_THREADS=1 python -m benchmarks.memory 40` (with more threads drawing takes several times longer) writes
`benchmarks/results/memory.json`; a run with the seed of the record continues it. Each
case is a plane cable in six to ten poses between clamps that move to and fro (`benchmarks.blind.hysteresis`: the friction of
Dahl and of Bouc and Wen in turn, neither of which is a Prandtl slider), with white noise of half a thousandth of its length;
every second case has no memory. Poses that would leave the plane are not drawn: the fit is one in space. The last pose is kept
from the fits. Cables of Dahl are also fitted with `dahl`, his own law: `--dahl` adds that to the cases on record.
"""

import sys
from dataclasses import replace

import jax
import numpy as np

from benchmarks.blind import hysteresis
from benchmarks.blind.hysteresis import BoucWen, Dahl, Grip
from benchmarks.record import complete, record, recorded
from scan2flex_jax.effects import Friction
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting.parameters import values_of
from scan2flex_jax.fitting.problem import Problem
from scan2flex_jax.inference import memory_test
from scan2flex_jax.inference.fitting import fitted
from scan2flex_jax.inference.memory import declaring
from scan2flex_jax.study import Clamp, EffectDeclaration, MeasuredCurve, Study, StudyPose, Unknown

jax.config.update("jax_enable_x64", True)
SEED, CASES, LENGTH, POINTS = 31, 40, 1.0, 60
LAWS = (Dahl, BoucWen)
NOISE = 5e-4  # of the length
CLEAR = 3.0  # times the noise: RMS that memory moves the poses by, above which it should be named
FEWEST, MOST = 6, 10


def clamp(grip: Grip) -> Clamp:
    """A clamp in the vertical plane of x and z, its d3 along the cable."""
    half = 0.5 * (0.5 * np.pi - grip.angle)
    return Clamp([grip.x, 0.0, grip.y], [np.cos(half), 0.0, np.sin(half), 0.0])


def study_of_chains(chains, grips, noise: float, seed: int, weight: float = 1.0, torsion: float = 0.05) -> Study:
    """The study of a cable in these poses, in their order, with white noise (m) on every coordinate."""
    rng, poses = np.random.default_rng(seed), []
    for i, (chain, grip) in enumerate(zip(chains, grips, strict=True)):
        s = np.linspace(0.0, chain.length, len(chain.points))
        at = np.linspace(0.02, 0.98, POINTS) * chain.length
        x, y = (np.interp(at, s, values) for values in chain.points.T)
        curve = np.column_stack([x, np.zeros(POINTS), y]) + noise * rng.normal(size=(POINTS, 3))
        ends = {"start": clamp(Grip(0.0, 0.0, 0.0)), "end": clamp(grip)}
        poses.append(StudyPose(f"p{i + 1}", "fit", **ends, curve=MeasuredCurve(curve), noise=noise))
    cable = {"length": chains[0].length, "length_density": weight / 9.81, "torsional_stiffness": torsion}
    return Study.from_arrays(cable, poses, ["bending_stiffness"], title="a cable that may remember")


def drawn(rng, remembers: bool, kind: type[Dahl] = Dahl):
    """Law, grips and chains of a case: clamps that go to and fro between near and far, bent one way and the other."""
    for _ in range(200):
        stiffness = rng.uniform(0.02, 0.08)
        law = kind(stiffness, rng.uniform(0.3, 0.7) if remembers else 0.0, rng.uniform(0.8, 3.0))
        count = int(rng.integers(FEWEST, MOST + 1))
        near = np.arange(count) % 2 == int(rng.integers(2))
        along = np.where(near, rng.uniform(0.35, 0.55, count), rng.uniform(0.6, 0.8, count))
        grips = [Grip(float(x), float(rng.uniform(-0.1, 0.1)), float(rng.uniform(-0.9, 0.9))) for x in along]
        try:
            chains = hysteresis.posed(LENGTH, 1.0, law, grips)
            fresh = hysteresis.without_memory(LENGTH, 1.0, law, grips)
        except np.linalg.LinAlgError:
            continue
        if chains is not None and fresh is not None and _planar(chains, law):
            moved = np.mean([np.sum((a.points - b.points) ** 2, axis=1) for a, b in zip(chains, fresh, strict=True)])
            return law, grips, chains, float(np.sqrt(moved))
    raise Scan2FlexError("no case was posed in two hundred draws")


def _planar(chains, law):
    """Whether every pose stays in its plane even where all slips that can: GJ is that of sticking layers."""
    return all(c.stays_plane((1 - law.share) * law.EI, law.EI) for c in chains)


def fitted_loop(kind_share: float, slip: float, EI: float, most: float) -> float:
    """Area (J/m) of the steady loop of the fitted sliders between ``-most`` and ``most`` (1/m): 4 k r (A - r) of each."""
    thresholds = slip * np.asarray(Friction(kind_share, slip).spread)
    pull = np.maximum(most - thresholds, 0.0) * thresholds
    return float(4.0 * kind_share * EI * np.mean(pull))


def one(i: int) -> dict:
    """Case ``i``: what was drawn, what the test says, and the errors of loop and prediction."""
    rng = np.random.default_rng((SEED, i))
    remembers = i % 2 == 0
    kind = LAWS[i // 2 % 2]
    law, grips, chains, moved = drawn(rng, remembers, kind)
    facts = {"case": i, "remembers": remembers, "law": kind.__name__, "poses": len(chains)}
    facts["moved over noise"] = moved / (NOISE * LENGTH)
    study = study_of_chains(chains, grips, NOISE * LENGTH, (SEED + 1) * 1000 + i, torsion=law.EI)
    last = replace(study.poses[-1], role="validate")
    try:
        answer = memory_test(replace(study, poses=study.poses[:-1]), seed=i)
        facts |= {"named": answer.named, "p_value": answer.p_value}
        seen = replace(study, poses=(*study.poses[:-1], last))
        _, plain = next_pose(seen)
        e, friction = next_pose(remembering(seen, answer.parameters))
    except Scan2FlexError as fault:
        return facts | {"failed": str(fault)}
    most = float(np.sqrt(np.mean([c.k**2 for c in chains])))
    area = fitted_loop(e["friction.share"], e["friction.slip_curvature"], e["bending_stiffness"], most)
    truth = law.loop_area(most) if remembers else 0.0
    return facts | {
        "loop": area, "true loop": truth, "loop error": abs(area / truth - 1) if truth else None,
        "next, plain": plain, "next, friction": friction,
    }  # fmt: skip


def next_pose(study: Study) -> tuple[dict[str, float], float]:
    """Estimates from the fitted poses, and the RMS distance (m) of the pose that was kept from them."""
    problem = Problem(study)
    minimum = problem.minimise("least-squares")
    values = {name: float(v) for name, v in values_of(problem.layout, minimum.shared[: problem.layout.unknowns]).items()}
    r, real = problem.predicted(minimum).residual[0], np.asarray(problem.held_out.mask[0]) > 0
    return values, float(np.sqrt(np.mean(np.sum(r[real] ** 2, axis=1))))


def remembering(study: Study, guess: dict | None = None) -> Study:
    """The study with friction declared, its parameters unknown."""
    names = ("share", "slip_curvature")
    unknowns = tuple(Unknown(f"friction.{name}", guess=None if guess is None else guess[name]) for name in names)
    return replace(study, effects=(EffectDeclaration("friction"),), unknowns=(*study.unknowns, *unknowns))


def by_dahl(i: int) -> dict:
    """Of case ``i`` of Dahl's the loop of the fit with his own law, and the log evidence over that of sliders (nats)."""
    law, grips, chains, _ = drawn(np.random.default_rng((SEED, i)), True, Dahl)
    study = study_of_chains(chains, grips, NOISE * LENGTH, (SEED + 1) * 1000 + i, torsion=law.EI)
    study = replace(study, poses=study.poses[:-1])
    fits = [fitted(declaring(study, kind), turns=False, mistakes=False) for kind in ("dahl", "friction")]
    e = {name: float(x.value) for name, x in fits[0].estimates.items()}
    most = float(np.sqrt(np.mean([c.k**2 for c in chains])))
    own = Dahl(e["bending_stiffness"], e["dahl.share"], e["dahl.slip_curvature"])
    ratio = own.loop_area(most) / law.loop_area(most)
    return {"loop over true, dahl": ratio, "gain over friction": fits[0].posterior.score - fits[1].posterior.score}


def summary(rows: list[dict]) -> dict:
    """Named where memory is clear, not named where there is none; errors of loops and predictions."""
    answered = [r for r in rows if "failed" not in r]
    clear = [r for r in answered if r["remembers"] and r["moved over noise"] > CLEAR]
    none = [r for r in answered if not r["remembers"]]

    def count(values):
        known = list(values)
        return [sum(known), len(known)]

    by_law = {law.__name__: count(r["loop error"] < 0.15 for r in clear if r["law"] == law.__name__) for law in LAWS}
    own = [r["loop over true, dahl"] for r in clear if "loop over true, dahl" in r]
    return {
        "cases": len(rows), "failed": len(rows) - len(answered),
        "named, memory clear": count(r["named"] for r in clear), "not named, no memory": count(not r["named"] for r in none),
        "loop area within 15 %": count(r["loop error"] < 0.15 for r in clear), "loop area within 15 %, by law": by_law,
        "loop area within 15 %, Dahl fitted with dahl": count(abs(x - 1) < 0.15 for x in own),
        "loop area over the true one, median": float(np.median([r["loop"] / r["true loop"] for r in clear])) if clear else None,
        "next pose better": count(r["next, friction"] < r["next, plain"] for r in clear),
    }  # fmt: skip


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 and sys.argv[1] != "--dahl" else CASES
    known = recorded("memory")
    rows = {r["case"]: r for r in known["cases"]} if known.get("seed") == SEED else {}

    keep = lambda: record("memory", {"seed": SEED, "cases": list(rows.values()), "summary": summary(list(rows.values()))})  # noqa: E731
    if "--dahl" not in sys.argv:
        complete(rows, range(count), one, keep)
    own = {i: r for i, r in rows.items() if r["remembers"] and r["law"] == "Dahl" and r["moved over noise"] > CLEAR}
    for i, row in own.items():
        if "loop over true, dahl" not in row:
            row.update(by_dahl(i))
            print(f"{i}: {row}", flush=True)
            keep()


if __name__ == "__main__":
    main()
