"""The contents of a report: numbers and texts gathered from a fit or an explanation, for the figures and the page.

Texts of a study (title, names of poses) are kept unescaped: the layout escapes them.
"""

import hashlib
import platform
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib import metadata
from typing import cast

import numpy as np

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting.problem import FIT_ELEMENTS
from scan2flex_jax.inference import Explanation, Fit, Plan, PoseFit, plan
from scan2flex_jax.prediction import Prediction, predict
from scan2flex_jax.results.answer import Answer, moved_in_words
from scan2flex_jax.study.files import STUDY_FILE, read_text
from scan2flex_jax.study.model import MeasuredCurve, Study, relative_name
from scan2flex_jax.study.outputs import measured_files
from scan2flex_jax.study.values import Where
from scan2flex_jax.study.write import study_text

LIBRARIES = ("scan2flex_jax", "jax", "jaxlib", "equinox", "optimistix", "numpy", "scipy", "plotly")
_MOST_TEXT = 200_000  # bytes of a study.toml that the page repeats


@dataclass(frozen=True)
class Contents:
    """Contents of the page, the ``answer`` first; ``explanation`` and ``plan`` are None where they were not requested or not
    possible. ``poses``: of the fit or the explanation; measured only where nothing was solved. ``without``: by pose, change of
    the stiffnesses when it is left out, in words. ``predictions``: of the solved poses, for the section forces."""

    answer: Answer
    study: Study
    fit: Fit | None
    explanation: Explanation | None
    poses: Mapping[str, PoseFit]
    without: Mapping[str, str]
    predictions: Mapping[str, Prediction]
    plan: Plan | None
    sentences: tuple[str, ...]
    unsolved: tuple[str, ...]
    inputs: tuple[tuple[str, str], ...]
    versions: tuple[tuple[str, str], ...]
    toml: str
    elements: int

    @property
    def found(self) -> Fit | Explanation:
        """The subject of the page: the explanation, or else the fit."""
        return self.explanation or cast(Fit, self.fit)


def contents_of(subject: Fit | Explanation, *, next_pose: bool = True, progress=lambda message: None) -> Contents:
    """The contents of a report on ``subject``; solves its poses once more for the section forces."""
    explanation = subject if isinstance(subject, Explanation) else None
    fitted = subject.fit if isinstance(subject, Explanation) else subject
    study = fitted.study if fitted else subject.study
    progress("influence of each pose and of the stated values")
    influence = subject.influence if fitted else None
    without = {name: moved_in_words(influence, name) for name in subject.poses}
    progress("section forces")
    elements = fitted.problem.elements if fitted else FIT_ELEMENTS
    predictions, unsolved = dict[str, Prediction](), ()
    if fitted:
        predictions, unsolved = _predicted(subject.study if explanation else fitted.calibrated, subject.poses, elements)
    ranked = None
    if explanation and next_pose and explanation.decision is not None:
        progress("candidates for the next pose")
        ranked = plan(explanation)
    said = fitted.sentences if fitted else ()
    if explanation:
        said = (*explanation.sentences, *(f"baseline fit: {sentence}" for sentence in said))
    if explanation is None:
        progress("score of what may be missing")
    answer = subject.answer
    said = tuple(sentence for sentence in said if sentence not in answer.warnings)
    return Contents(
        answer, study, fitted, explanation, subject.poses or _measured(study), without, predictions, ranked, said, unsolved,
        _inputs(study), _versions(), _toml(study), elements,
    )  # fmt: skip


def _measured(study) -> dict[str, PoseFit]:
    """The measured curves of a study of which no pose was solved."""
    none, unknown = np.zeros((0, 3)), float("nan")
    curves = {p.name: (p.role, p.curve.points) for p in study.poses if p.curve is not None}
    return {
        name: PoseFit(role, unknown, unknown, False, measured=points, modelled=none, s=none[:, 0], residual=none)
        for name, (role, points) in curves.items()
    }


def _predicted(study, found, elements):
    """Predictions of the solved poses, on the branches of the fit, and sentences on poses that failed."""
    whole = []
    for pose in study.poses:
        modelled = found[pose.name].modelled if pose.name in found and found[pose.name].stable else None
        shape = replace(pose, markers=None, angle=(), wrench=(), change_from=None)  # of which the curve chooses the branch
        whole.append(pose if modelled is None else replace(shape, curve=MeasuredCurve(modelled)))
    try:
        predictions = predict(replace(study, poses=tuple(whole)), elements=elements)
    except Scan2FlexError as error:
        return {}, (str(error),)
    unsolved = tuple(f"{name}: {p.verdict.sentence()}" for name, p in predictions.items() if not p.verdict.solved)
    return {name: p for name, p in predictions.items() if p.verdict.solved}, unsolved


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
