"""Answers of this package to the data set: a plain fit, a fit that is told the true effect types, and `explain`.

A plain fit finds EI and GJ and knows nothing else. An oracle is told which effects act, and which way a plane faces; strength
and place are unknown to it, and only its start is the truth. Outside the package's effect types it answers as the plain fit.
The `explain` answers are those of a user of `scan2flex explain`.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from scan2flex_jax.inference import explain
from scan2flex_jax.inference.fitting import fitted
from scan2flex_jax.prediction import predict
from scan2flex_jax.study import Clamp, EffectDeclaration, MeasuredCurve, Study, StudyPose, Unknown, load_study
from scan2flex_jax.study.kinds import kind_format

ELEMENTS = 80
_TOLD = ("normal",)  # a direction: three numbers that are estimated one by one do not stay a unit vector
STIFFNESSES = ("bending_stiffness", "torsional_stiffness")


def plain(study: Study, asked: dict, truth: dict) -> dict:
    """The answer of a plain fit."""
    return _answered(*_fitted(study), asked)


def oracle(study: Study, asked: dict, truth: dict) -> dict:
    """The answer of a fit that is told the effect types."""
    effects = truth["effects"] if truth["class"] in ("one", "two") else []
    told, unknowns = [], []
    for effect in map(_with_unit_normal, effects):
        form = kind_format(effect["kind"])
        free = [p.name for p in form.parameters if p.estimable and p.name in effect and p.name not in _TOLD]
        told.append(EffectDeclaration(form.kind, {p.name: effect[p.name] for p in form.parameters if p.name not in free}))
        unknowns += [Unknown(f"{form.kind}.{name}", guess=effect[name]) for name in free]
    told_study = replace(study, effects=(*study.effects, *told), unknowns=(*study.unknowns, *unknowns))
    kinds = [e["kind"] for e in effects]
    named = {"named": kinds, "missing": bool(truth["truth"]) or truth["class"] == "off"}
    return named | _answered(*_fitted(told_study), asked)


def _with_unit_normal(effect):
    if "normal" not in effect:
        return effect
    size = float(np.linalg.norm(effect["normal"]))
    return effect | {"normal": [x / size for x in effect["normal"]]}


def explained(study: Study, asked: dict, truth: dict) -> dict:
    """The answer of `explain`."""
    e = explain(study)
    chosen = [c.kind for c in e.chosen]
    ties = {k for r in e.ranking if r.verdict == "tied" for k in (r.kind, *r.tied_with)}
    said = {"named": chosen if e.verdict in ("explained", "partly explained") else [], "tied": sorted({*chosen, *ties})}
    return said | {"missing": e.verdict != "no missing effect"} | _answered(e.estimates, e.study, asked)


BY = {"plain": plain, "oracle": oracle, "explain": explained}


def answer(folder: Path, name: str, by: str) -> dict:
    """The answer to one case of the data set in ``folder``, or the fault that prevented it."""
    case, truth = folder / "cases" / name, json.loads((folder / "answers" / f"{name}.json").read_text())
    try:
        return BY[by](load_study(case), json.loads((case / "asked.json").read_text()), truth)
    except Exception as fault:  # a benchmark counts failures
        return {"fault": f"{type(fault).__name__}: {fault}"[:300]}


def _fitted(study):
    found = fitted(study, turns=False, mistakes=False)
    return found.estimates, found.calibrated


def _answered(estimates, cable, asked):
    """Stiffnesses with their intervals, and the shapes that are asked for."""
    out = {}
    for name in STIFFNESSES:
        e = estimates.get(name)
        if e is not None and np.ndim(e.value) == 0:
            out[name] = {k: float(v) for k in ("value", "low", "high") if (v := getattr(e, k)) is not None and np.isfinite(v)}
    unseen = {}
    poses = tuple(StudyPose(n, "fit", **_ends(p), **_roughly(p)) for n, p in asked["unseen"].items())
    posed = replace(cable, poses=poses, effects=_effects(cable, asked))
    for name, shape in predict(posed, elements=ELEMENTS).items():
        at, points = asked["unseen"][name].get("arc_length"), shape.points
        if bool(shape.verdict.solved):
            unseen[name] = (points if at is None else np.stack([np.interp(at, shape.s, x) for x in points.T], axis=1)).tolist()
    return out | {"unseen": unseen}


def _ends(pose):
    return {k: Clamp(np.array(pose[k]["position"]), pose[k].get("quaternion")) for k in ("start", "end") if k in pose}


def _roughly(pose):
    """The equilibrium among several that is asked for."""
    return {"curve": MeasuredCurve(np.array(pose["roughly"]))} if "roughly" in pose else {}


def _effects(cable, asked):
    """Those of all poses, and the known ones of the poses that are asked for."""
    own = [EffectDeclaration(e["kind"], {k: v for k, v in e.items() if k != "kind"}, (name,))
           for name, pose in asked["unseen"].items() for e in pose.get("effect", [])]  # fmt: skip
    return (*(e for e in cable.effects if e.poses is None), *own)
