"""Prediction: the shapes, section forces and clamp reactions of a study whose parameters are all known.

Forces are often the purpose of a calibration: a cable's pull on its connector, the bending moment at a clamp.
"""

import io
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from scipy.spatial import cKDTree

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting.evaluate import observed
from scan2flex_jax.fitting.parameters import model_of
from scan2flex_jax.fitting.poses import boundary_of, start_along
from scan2flex_jax.fitting.readings import Reading, change, readings_of, residuals_of, rows_of, stacked
from scan2flex_jax.geometry.curves import arc_length
from scan2flex_jax.names import file_stems
from scan2flex_jax.rod.energy import excess_strains
from scan2flex_jax.rod.memory import straightened
from scan2flex_jax.rod.model import CableModel
from scan2flex_jax.statics.balance import DEFAULT_ELEMENTS
from scan2flex_jax.statics.mesh import Mesh, shortest_bend
from scan2flex_jax.statics.solve import Equilibrium, equilibrium
from scan2flex_jax.statics.verdict import Verdict
from scan2flex_jax.study.mistakes import on_axis
from scan2flex_jax.study.model import Study
from scan2flex_jax.study.outputs import write_file
from scan2flex_jax.study.parts import Clamp, StudyPose
from scan2flex_jax.study.sense import check_study

_ENDINGS = (".csv", "-forces.csv")
_NOTHING = 1e-6  # of the reactions: an end that exerts no more is free
_FINEST = 4000  # points of a curve that is tested for self-penetration


@dataclass(frozen=True)
class Prediction:
    """One pose: nodes (m), section force (N) and moment (N m) in the scan frame, and support reactions.

    ``tangents``: unit vectors along the cable at the sections, from which `tension`, `shear`, `bending` and `torque` follow.
    ``bend_radius`` (m): the smallest, at the arc length ``bend_at``; infinite for a straight cable. ``touches``: arc lengths
    (m) of two places where the cable penetrates itself, which contact would prevent but the model ignores; None if there are
    none, or the study has no radius. ``mesh``: sentences on the number of elements. ``readings``: the angles and wrenches of
    the pose, measured and predicted.
    ``supports``: of each support between the ends its kind, the arc length (m) that it holds, and its force (N) on the cable.
    """

    s: np.ndarray
    points: np.ndarray
    section_s: np.ndarray
    force: np.ndarray
    moment: np.ndarray
    reaction_force: np.ndarray
    reaction_moment: np.ndarray
    tangents: np.ndarray
    bend_radius: float
    bend_at: float
    verdict: Verdict
    touches: tuple[float, float] | None = None
    mesh: tuple[str, ...] = ()
    readings: tuple[Reading, ...] = ()
    supports: tuple[tuple[str, float, np.ndarray], ...] = ()

    @property
    def tension(self) -> np.ndarray:
        """Force along the cable at the sections (N), negative in compression."""
        return np.sum(self.force * self.tangents, axis=1)

    @property
    def shear(self) -> np.ndarray:
        """Size of the force across the cable at the sections (N)."""
        return np.linalg.norm(self.force - self.tension[:, None] * self.tangents, axis=1)

    @property
    def torque(self) -> np.ndarray:
        """Moment about the cable at the sections (N m)."""
        return np.sum(self.moment * self.tangents, axis=1)

    @property
    def bending(self) -> np.ndarray:
        """Size of the bending moment at the sections (N m)."""
        return np.linalg.norm(self.moment - self.torque[:, None] * self.tangents, axis=1)

    def sentence(self) -> str:
        """The status in words, whether the cable passes through itself, and unusual numbers of elements."""
        said = [self.verdict.sentence()]
        if self.touches is not None:
            a, b = self.touches
            said.append(f"it passes through itself at s = {a:.3g} m and {b:.3g} m (contact with itself is not modelled)")
        return "; ".join((*said, *self.mesh))

    def lines(self) -> list[str]:
        """What a layout needs, in words: smallest bend radius, tension, and what each support exerts on the cable."""
        out = [
            f"smallest bend radius {self.bend_radius:.3g} m at s = {self.bend_at:.3g} m",
            f"tension {self.tension.min():.3g} to {self.tension.max():.3g} N (negative: compression)",
        ]
        forces = [f for *_, f in self.supports]
        most = max(map(np.linalg.norm, (self.reaction_force, self.reaction_moment, *forces)))
        for end, f, m in zip(("start", "end"), self.reaction_force, self.reaction_moment, strict=True):
            size = max(np.linalg.norm(f), np.linalg.norm(m))
            if size > _NOTHING * most:
                out.append(f"the {end} exerts {_vector(f)} N and {_vector(m)} N m on the cable")
        for kind, s, f in self.supports:
            out.append(f"the {kind.replace('_', ' ')} at s = {s:.4g} m exerts {_vector(f)} N on the cable")
        return [*out, *(one.sentence() for one in self.readings)]

    def to_json(self) -> dict:
        """Smallest bend radius (m) and its arc length, tension (N), reactions and status; shapes are written as CSV."""
        out = {"stable": bool(self.verdict.solved), "verdict": self.verdict.sentence()}
        out |= {} if self.touches is None else {"touches": list(self.touches)}
        out |= {"messages": list(self.mesh)} if self.mesh else {}
        if not out["stable"]:
            return out
        out |= {"readings": [one.to_json() for one in self.readings]} if self.readings else {}
        out |= {"bend_radius": self.bend_radius if np.isfinite(self.bend_radius) else None, "bend_at": self.bend_at}
        out |= {"tension": [float(self.tension.min()), float(self.tension.max())]}
        ends = zip(("start", "end"), self.reaction_force, self.reaction_moment, strict=True)
        out |= {e: {"force": f.tolist(), "moment": m.tolist()} for e, f, m in ends}
        supports = [{"kind": kind, "s": s, "force": f.tolist()} for kind, s, f in self.supports]
        return out | ({"supports": supports} if supports else {})


def settled(study: Study, pose: StudyPose, elements: int) -> tuple[CableModel, Equilibrium]:
    """Model and equilibrium of one study pose, on the branch nearest to its measured curve if there is one, and with memory
    after the poses before it."""
    if not study.history_dependent:
        return _settled(study, pose, elements)
    return next((model, e) for other, model, e in in_order(study, [elements] * len(study.poses)) if other is pose)


def in_order(study: Study, elements: Iterable[int]) -> Iterator[tuple[StudyPose, CableModel, Equilibrium]]:
    """Every pose of a study with its model and equilibrium, each after those before it; ``elements`` of each pose, alike for
    all with memory."""
    before, last = None, None
    for pose, count in zip(study.poses, elements, strict=True):
        held = 0.0 if last is None or last.time is None or pose.time is None else pose.time - last.time
        model, before = _settled(study, pose, count, before if study.history_dependent and not pose.reset else None, held)
        last = pose
        yield pose, model, before


def _settled(study, pose, elements, after=None, held=0.0):
    start, model = None, model_of(study, pose)
    if pose.curve is not None or on_axis(pose):
        start = start_along(study, pose, float(model.cable.length), elements)
    given = {"start": start, "turns": pose.turns, "elements": elements, "after": after, "held": held}
    effects = straightened(model.effects, elements) if pose.reset else model.effects
    return model, equilibrium(CableModel(model.cable, model.gravity, effects), boundary_of(pose), **given)


def predict(study: Study, *, elements: int | None = None) -> dict[str, Prediction]:
    """Shapes, section forces and reactions of all poses of a calibrated study, in their order if an effect has memory.

    Args:
        study: A study whose parameters all have values, such as ``fit(study).calibrated``. Poses need only clamps; a pose with
            a measured curve is solved on the branch nearest to it.
        elements: Elements of the rod; None: 40, or as many more as the bends of each pose need (`statics.mesh`).

    Returns:
        A `Prediction` for each pose, by name; a failed solve is reported in its status.

    Raises:
        StudyError: A parameter has neither a value nor a guess.

    Examples:
        >>> predict(fit(study).calibrated)["sag"].points  # doctest: +SKIP
    """
    check_study(study, "predict")
    radius = study.cable.get("radius")
    radius = None if radius is None else float(radius)
    meshes = _meshes(study, elements)
    settled_ = {pose.name: (model, e) for pose, model, e in in_order(study, [mesh.elements for mesh in meshes])}
    found = {}
    for pose, mesh in zip(study.poses, meshes, strict=True):
        one = _one_pose(*settled_[pose.name], radius, mesh)
        found[pose.name] = replace(one, readings=_readings(study, pose, settled_))
    return found


def _readings(study, pose, found) -> tuple[Reading, ...]:
    """The angles and wrenches of a pose, measured and predicted."""
    (model, e), other = found[pose.name], found.get(pose.change_from)
    rows = rows_of(study, pose, float(model.cable.length))
    if not rows or not bool(e.verdict.solved) or not (other is None or bool(other[1].verdict.solved)):
        return ()
    residual = residuals_of(rows, e, _view(model))
    if other is not None:
        residual = change(residual, residuals_of(rows, other[1], _view(other[0]), zero=True), stacked(rows)[0], np)
    return readings_of(study, pose, float(model.cable.length), residual)


def _view(model) -> np.ndarray:
    """The linear part (3, 3) of what the scanner makes of places."""
    return np.asarray(observed(model, jnp.eye(3)) - observed(model, jnp.zeros((1, 3)))).T


def touching(points: np.ndarray, radius: float) -> tuple[float, float] | None:
    """Arc lengths (m) of the two nearest places of a centre curve (n, 3) whose cross sections of ``radius`` (m) overlap.

    Places closer than four radii along the cable do not count: the sharpest possible bend makes half a turn in that length.
    """
    s = arc_length(points, np)
    if not s[-1] > 4.0 * radius > 0.0:
        return None
    fine = np.linspace(0.0, s[-1], int(min(_FINEST, max(len(s), 4.0 * s[-1] / radius))))
    dense = np.column_stack([np.interp(fine, s, x) for x in points.T])
    pairs = cKDTree(dense).query_pairs(2.0 * radius, output_type="ndarray")
    pairs = pairs[np.abs(fine[pairs[:, 0]] - fine[pairs[:, 1]]) > 4.0 * radius]
    if not len(pairs):
        return None
    nearest = pairs[np.argmin(np.linalg.norm(dense[pairs[:, 0]] - dense[pairs[:, 1]], axis=1))]
    return float(fine[nearest[0]]), float(fine[nearest[1]])


def _meshes(study, elements):
    """The mesh of each pose; with memory all have as many elements as the finest."""
    models = [(pose, model_of(study, pose)) for pose in study.poses]
    found = [
        Mesh(elements or DEFAULT_ELEMENTS, float(model.cable.length), float(shortest_bend(model, boundary_of(pose))))
        for pose, model in models
    ]
    if elements is None:
        found = [mesh._replace(elements=mesh.enough) for mesh in found]
    finest = max((mesh.elements for mesh in found), default=0)
    return [mesh._replace(elements=finest) for mesh in found] if study.history_dependent else found


def _one_pose(model, e, radius, mesh):
    section_s, force, moment = map(np.asarray, e.section_forces())
    push, turn = map(np.asarray, e.reactions())
    points = np.asarray(observed(model, e.points))
    touches = None if radius is None or not bool(e.verdict.solved) else touching(np.asarray(e.points), radius)
    tangents = np.diff(np.asarray(e.points), axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    sharpest, at = _sharpest(e)
    solved = (section_s, force, moment, push, turn, tangents, sharpest, at, e.verdict)
    held = [(e.rod.effects[i].kind, float(s), np.asarray(f)) for i, s, f in e.support_reactions()]
    return Prediction(np.asarray(e.s), points, *solved, touches, mesh.sentences(), supports=tuple(held))


def _sharpest(e):
    """Smallest bend radius (m) and its arc length (m), over the elements and, extrapolated, both ends."""
    section = e.rod.section
    bent, s = np.asarray(excess_strains(e.rod, e.configuration) + section.natural)[:, 3:5], np.asarray(section.s)
    ends = 1.5 * bent[[0, -1]] - 0.5 * bent[[1, -2]]
    curvature = np.linalg.norm(np.concatenate([ends[:1], bent, ends[1:]]), axis=1)
    k = int(np.argmax(curvature))
    at = np.r_[0.0, s, float(e.rod.length)]
    return float(1.0 / curvature[k]) if curvature[k] > 0 else float("inf"), float(at[k])


def posed(study: Study, clamps: Mapping[str, Clamp]) -> Study:
    """The cable of a study in poses of given clamps, named ``"POSE start"`` and ``"POSE end"`` (without it the end is free).

    Effects that act in some poses of the study only are left out. Raises `Scan2FlexError` for other names, and for a pose
    without a start.
    """
    ends: dict[str, dict[str, Clamp]] = {}
    for name, clamp in clamps.items():
        pose, _, end = name.rpartition(" ")
        if not pose or end not in ("start", "end"):
            raise Scan2FlexError(f"{name[:60]!r} is not the clamp of a pose: name each 'POSE start' or 'POSE end'.")
        ends.setdefault(pose, {})[end] = clamp
    if without := [pose for pose, held in ends.items() if "start" not in held]:
        raise Scan2FlexError(f"pose {without[0]!r} has no clamp at its start: add a row {without[0]!r} start.")
    poses = tuple(StudyPose(pose, "fit", held["start"], held.get("end")) for pose, held in ends.items())
    return replace(study, poses=poses, effects=tuple(e for e in study.effects if e.poses is None))


def csv_files(names: Iterable[str], folder: Path) -> dict[str, tuple[Path, Path]]:
    """The two files of each pose in ``folder``: shape and forces. Names that are invalid as file names are changed."""
    stems = file_stems(names, _ENDINGS)
    return {name: (folder / f"{stem}{_ENDINGS[0]}", folder / f"{stem}{_ENDINGS[1]}") for name, stem in stems.items()}


def write_csv(
    predictions: dict[str, Prediction], folder: str | Path, write: Callable[[Path, bytes], None] = write_file
) -> dict[str, tuple[Path, Path]]:
    """``NAME.csv`` with s,x,y,z (m) and ``NAME-forces.csv`` with s (m), force (N) and moment (N m) of every solved pose.

    Returns the files of each pose, named after the pose if its name is a valid file name. ``write(path, bytes)``
    writes a file; by default a study's own files are refused with a `StudyError`.
    """
    files = csv_files(predictions, Path(folder))
    for name, p in predictions.items():
        if not bool(p.verdict.solved):
            continue
        shape, forces = files[name]
        write(shape, _csv("s,x,y,z", np.column_stack([p.s, p.points])))
        table = np.column_stack([p.section_s, p.force, p.moment])
        write(forces, _csv("s,force_x,force_y,force_z,moment_x,moment_y,moment_z", table))
    return files


def _vector(values) -> str:
    """Three components with a common number of decimals: ``(0.12, 0.00, -1.96)``."""
    size = float(np.max(np.abs(values)))
    decimals = int(np.clip(2 - np.floor(np.log10(size)), 0, 9)) if size > 0 else 0
    return f"({', '.join(f'{v + 0.0:.{decimals}f}' for v in np.round(values, decimals) + 0.0)})"


def _csv(header: str, table: np.ndarray) -> bytes:
    text = io.StringIO()
    np.savetxt(text, table, fmt="%.9g", delimiter=",", header=header, comments="")
    return text.getvalue().encode("ascii")
