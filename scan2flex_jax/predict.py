"""Prediction: the shapes, section forces and clamp reactions of a study whose parameters are all known.

Forces are why people want the parameters: a cable's pull on its connector, the bending moment at a clamp.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scan2flex_jax.equilibrium.solve import Verdict, equilibrium
from scan2flex_jax.errors import StudyError
from scan2flex_jax.fit.evaluate import observed, one
from scan2flex_jax.fit.parameters import layout_of, model_at, start_vector, template
from scan2flex_jax.fit.poses import boundary_of, poses_of


@dataclass(frozen=True)
class Prediction:
    """One pose: nodes (m), sections with force (N) and moment (N m) in the scan frame, and what the supports exert."""

    s: np.ndarray
    points: np.ndarray
    section_s: np.ndarray
    force: np.ndarray
    moment: np.ndarray
    reaction_force: np.ndarray
    reaction_moment: np.ndarray
    verdict: Verdict

    def to_json(self) -> dict:
        """Reactions and verdict; shapes go to CSV."""
        out = {"stable": bool(self.verdict.solved), "verdict": self.verdict.sentence()}
        if not out["stable"]:
            return out
        ends = zip(("start", "end"), self.reaction_force, self.reaction_moment, strict=True)
        return out | {e: {"force": f.tolist(), "moment": m.tolist()} for e, f, m in ends}


def model_of(study):
    """The study's model with every unknown at its value or guess; raises `StudyError` where one has neither."""
    for unknown in study.unknowns:
        if study.start_value(unknown.name) is None:
            where = (study.folder / "study.toml") if study.folder else "study"
            raise StudyError(
                where, f"unknown.{unknown.name}", "has no value to simulate with: give a guess, or fit the study first."
            )
    layout = layout_of(study)
    x = np.concatenate([start_vector(study, layout, {}), np.zeros(layout.shared - layout.unknowns)])
    return model_at(layout, template(study), x)


def settled(pose, model, elements: int):
    """The equilibrium of one study pose, on the branch nearest to its measured curve where it has one."""
    start = None
    if pose.curve is not None:
        start = one(poses_of([pose], float(model.cable.length), elements).start, 0)
    return equilibrium(model, boundary_of(pose), start=start, turns=pose.turns, elements=elements)


def predict(study, *, elements: int = 40) -> dict[str, Prediction]:
    """Predictions of all poses by name. A pose with a measured curve is solved on the branch nearest to it."""
    model = model_of(study)
    return {pose.name: _one_pose(pose, model, elements) for pose in study.poses}


def _one_pose(pose, model, elements):
    e = settled(pose, model, elements)
    s, f, m = e.section_forces()
    reaction = e.reactions()
    points = np.asarray(observed(model, e.points))
    return Prediction(*(np.asarray(a) for a in (e.s, points, s, f, m, *reaction)), e.verdict)


def write_csv(predictions: dict[str, Prediction], folder: Path) -> None:
    """``NAME.csv`` with s,x,y,z and ``NAME-forces.csv`` with s and the components of force and moment."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, p in predictions.items():
        if not bool(p.verdict.solved):
            continue
        _write(folder / f"{name}.csv", "s,x,y,z", np.column_stack([p.s, p.points]))
        table = np.column_stack([p.section_s, p.force, p.moment])
        _write(folder / f"{name}-forces.csv", "s,force_x,force_y,force_z,moment_x,moment_y,moment_z", table)


def _write(path, header, table):
    part = path.with_name(path.name + ".part")
    np.savetxt(part, table, fmt="%.9g", delimiter=",", header=header, comments="")
    part.replace(path)
