"""The contents of a report: numbers and texts gathered from a fit or an explanation, for the figures and the page.

Texts of a study (title, names of poses) are kept unescaped: the layout escapes them.
"""

import hashlib
import platform
from dataclasses import dataclass, replace
from importlib import metadata

import numpy as np

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting.problem import FIT_ELEMENTS
from scan2flex_jax.inference import Explanation, Fit, Plan, plan
from scan2flex_jax.inference.answer import Answer, digits_of, moved_in_words
from scan2flex_jax.prediction import predict
from scan2flex_jax.study.files import STUDY_FILE, read_text
from scan2flex_jax.study.model import MeasuredCurve, Study, relative_name
from scan2flex_jax.study.outputs import measured_files
from scan2flex_jax.study.values import Where
from scan2flex_jax.study.write import study_text

LIBRARIES = ("scan2flex_jax", "jax", "jaxlib", "equinox", "optimistix", "numpy", "scipy", "plotly")
_MOST_TEXT = 200_000  # bytes of a study.toml that the page repeats


@dataclass(frozen=True)
class PoseView:
    """One pose: ``measured`` and ``modelled`` (m), arc length ``s`` (m) and ``distance`` (m) of the measured points, sorted by
    ``s``; residual after and before (m) where both are known, and the figures of the tables; ``without``: change of the
    stiffnesses when the pose is left out, in words."""

    name: str
    role: str
    measured: np.ndarray
    modelled: np.ndarray | None = None
    s: np.ndarray | None = None
    distance: np.ndarray | None = None
    residual: np.ndarray | None = None
    before: np.ndarray | None = None
    rms: float = float("nan")
    worst: float = float("nan")
    rms_before: float | None = None
    left_out_before: float | None = None
    left_out: float | None = None
    stable: bool = False
    clamps: tuple = ()
    without: str = ""


@dataclass(frozen=True)
class SectionView:
    """Along one pose: middles of the elements ``s`` (m), tension and shear force (N), bending moment and torque (N m), and the
    reactions of the supports."""

    name: str
    s: np.ndarray
    tension: np.ndarray
    shear: np.ndarray
    bending: np.ndarray
    torque: np.ndarray
    reaction_force: np.ndarray
    reaction_moment: np.ndarray


@dataclass(frozen=True)
class EstimateView:
    """One estimated number with its interval and, for an explanation, its value in the baseline fit."""

    name: str
    unit: str
    value: float
    low: float | None
    high: float | None
    identifiable: bool
    at_bound: bool
    before: float | None = None

    @property
    def digits(self) -> int:
        """Number of significant digits that resolve the interval."""
        bounds = (np.nan, np.nan) if self.low is None or self.high is None else (self.low, self.high)
        return digits_of(self.value, *bounds, least=4)


@dataclass(frozen=True)
class Contents:
    """Contents of the page, the ``answer`` first; ``explanation`` and ``plan`` are None where they were not requested or not
    possible."""

    answer: Answer
    study: Study
    fit: Fit | None
    explanation: Explanation | None
    poses: tuple[PoseView, ...]
    estimates: tuple[EstimateView, ...]
    sections: tuple[SectionView, ...]
    plan: Plan | None
    sentences: tuple[str, ...]
    unsolved: tuple[str, ...]
    inputs: tuple[tuple[str, str], ...]
    versions: tuple[tuple[str, str], ...]
    toml: str
    elements: int


def contents_of(subject: Fit | Explanation, *, next_pose: bool = True, progress=lambda message: None) -> Contents:
    """The contents of a report on ``subject``; solves its poses once more for the section forces."""
    explanation = subject if isinstance(subject, Explanation) else None
    fitted = subject.fit if isinstance(subject, Explanation) else subject
    study = fitted.study if fitted else subject.study
    progress("influence of each pose and of the stated values")
    influence = subject.influence if fitted else None
    poses = tuple(_pose_view(study.pose(name), p, moved_in_words(influence, name)) for name, p in subject.poses.items())
    if not poses:
        measured = [(p, p.curve.points) for p in study.poses if p.curve is not None]
        poses = tuple(PoseView(p.name, p.role, points, clamps=_clamps(p)) for p, points in measured)
    progress("section forces")
    elements = fitted.problem.elements if fitted else FIT_ELEMENTS
    sections, unsolved = ((), ())
    if fitted:
        sections, unsolved = _sections(subject.study if explanation else fitted.calibrated, subject.poses, elements)
    ranked = None
    if explanation and next_pose and explanation.decision is not None:
        progress("candidates for the next pose")
        ranked = plan(explanation)
    said = fitted.sentences if fitted else ()
    if explanation:
        said = (*explanation.sentences, *(f"baseline fit: {sentence}" for sentence in said))
    answer = subject.answer
    said = tuple(sentence for sentence in said if sentence not in answer.warnings)
    return Contents(
        answer, study, fitted, explanation, poses, _estimates(subject, fitted), sections, ranked, said, unsolved,
        _inputs(study), _versions(), _toml(study), elements,
    )  # fmt: skip


def _pose_view(pose, found, without) -> PoseView:
    order = np.argsort(found.s, kind="stable")
    known = {"before": found.residual_before[order]} if hasattr(found, "residual_before") else {}
    known |= {k: getattr(found, k) for k in ("rms_before", "left_out", "left_out_before") if hasattr(found, k)}
    distance = np.linalg.norm(found.residual[order], axis=1)
    return PoseView(
        pose.name, found.role, found.measured[order], found.modelled if found.stable else None, found.s[order],
        distance if found.stable else np.full(len(order), np.nan), found.residual[order], rms=found.rms, worst=found.worst,
        stable=found.stable, clamps=_clamps(pose), without=without, **known,
    )  # fmt: skip


def _clamps(pose):
    """Position and tangent (None for a ball joint) of each clamped end."""
    return tuple((clamp.position, clamp.tangent) for clamp in (pose.start, pose.end) if clamp is not None)


def _sections(study, found, elements):
    """Section forces of the solved poses, on the branches of the fit, and sentences on poses that failed."""
    whole = []
    for pose in study.poses:
        modelled = found[pose.name].modelled if pose.name in found and found[pose.name].stable else None
        shape = replace(pose, markers=None, angle=(), wrench=(), change_from=None)  # of which the curve chooses the branch
        whole.append(pose if modelled is None else replace(shape, curve=MeasuredCurve(modelled)))
    try:
        predictions = predict(replace(study, poses=tuple(whole)), elements=elements)
    except Scan2FlexError as error:
        return (), (str(error),)
    views, unsolved = [], []
    for name, p in predictions.items():
        if not bool(p.verdict.solved):
            unsolved.append(f"{name}: {p.verdict.sentence()}")
            continue
        t = np.diff(p.points, axis=0)
        t /= np.linalg.norm(t, axis=1, keepdims=True)
        tension, torque = np.sum(p.force * t, axis=1), np.sum(p.moment * t, axis=1)
        shear = np.linalg.norm(p.force - tension[:, None] * t, axis=1)
        bending = np.linalg.norm(p.moment - torque[:, None] * t, axis=1)
        views.append(SectionView(name, p.section_s, tension, shear, bending, torque, p.reaction_force, p.reaction_moment))
    return tuple(views), tuple(unsolved)


def _estimates(subject, fitted):
    rows = []
    for name, e in (subject.estimates if fitted else {}).items():
        before = fitted.estimates[name].value if subject is not fitted else None
        many = np.ndim(e.value) > 0
        for i, value in enumerate(np.ravel(e.value)):
            low, high, old = (None if v is None else float(np.ravel(v)[i]) for v in (e.low, e.high, before))
            label = f"{name}[{i}]" if many else name
            rows.append(
                EstimateView(label, "" if e.unit == "-" else e.unit, float(value), low, high, e.identifiable, e.at_bound, old)
            )
    return tuple(rows)


def _versions():
    found = []
    for name in LIBRARIES:
        try:
            found.append((name, metadata.version(name)))
        except metadata.PackageNotFoundError:
            continue
    return (*found, ("Python", platform.python_version()), ("machine", f"{platform.system()} {platform.machine()}"))


def _inputs(study):
    """Names inside the study's folder and SHA-256 of all files that were read."""
    if study.folder is None:
        return ()
    found = []
    for path in dict.fromkeys(measured_files(study)):
        if path.is_file():
            with path.open("rb") as stream:
                digest = hashlib.file_digest(stream, "sha256").hexdigest()
            found.append((relative_name(study.folder, path).as_posix(), digest))
    return tuple(found)


def _toml(study) -> str:
    """The study.toml as it was read, with its comments; for a study made in memory, the one that it would be saved as."""
    path = None if study.folder is None else study.folder / STUDY_FILE
    if path is not None and path.is_file():
        return read_text(path, 10_000_000, Where(str(path)), "the file is gone.")[:_MOST_TEXT]
    return study_text(study)[:_MOST_TEXT]
