"""Reading of a study from its folder: `study.toml` and the files that it names.

`load_study` returns a `Study`, or raises one `StudyError` with the file, the key, the value found and the remedy. This
module converts TOML to the parts of a study, which check themselves, and adds the place in the file to their errors.
"""

import re
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Protocol, runtime_checkable

import numpy as np

from scan2flex_jax.study import values as v
from scan2flex_jax.study.curves import read_curve, read_guide_points, read_markers
from scan2flex_jax.study.declared import check_name
from scan2flex_jax.study.files import TOML_LIMIT, existing, read_text
from scan2flex_jax.study.kinds import TOLERANCE
from scan2flex_jax.study.model import Clamp, EffectDeclaration, Markers, MeasuredCurve, Study, StudyPose, Tolerance, Unknown
from scan2flex_jax.study.sense import Purpose, check_study
from scan2flex_jax.study.values import Where

FORMAT = "scan2flex-study/1"
STUDY_FILE = "study.toml"
_TOP = ("format", "title", "gravity", "cable", "tolerance", "unknown", "pose", "effect")
_POSE = (
    "name", "role", "start", "end", "turns", "centre_curve", "scan", "markers", "guide_points", "viewpoints", "noise",
    "repeat_of", "gravity", "time", "reset",
)  # fmt: skip
MOST_PARTS = 32
"""Parts of a dotted key. A study's keys have three at most, and the run time of tomllib grows with their square or cube."""
# possessive, for a search in linear time
_PART = r"""(?:[A-Za-z0-9_-]++|"[^"\\\n]*+(?:\\.[^"\\\n]*+)*+"|'[^'\n]*+')"""
_LONG_KEY = re.compile(rf"(?:^[ \t]*+\[{{0,2}}+|[{{,])[ \t]*+(?:{_PART}[ \t]*+\.[ \t]*+){{{MOST_PARTS}}}", re.MULTILINE)
_FILES = ("centre_curve", "scan", "markers", "guide_points")


@runtime_checkable
class StudyFiles(Protocol):
    """Source of the files named by a study: a folder, or the memory of a study about to be saved."""

    def curve(self, name: str, where: Where) -> MeasuredCurve:
        """The centre curve of this name."""

    def markers(self, name: str, where: Where) -> Markers:
        """The markers of this name."""

    def guide_points(self, name: str, where: Where) -> tuple[Annotated[np.ndarray, "k 3"], Path | None]:
        """The guide points of this name, and their file."""

    def scan(self, name: str, where: Where) -> Path:
        """The file of a point cloud."""


class FolderFiles:
    """The files in the folder of a study; `shown_folder` is the folder in the user's notation."""

    def __init__(self, folder: Path, shown_folder: Path):
        """Keep both."""
        self.folder = folder
        self.shown_folder = shown_folder

    def _where(self, name: str) -> Where:
        return Where(v.one_line(str(self.shown_folder / name), 300))

    def curve(self, name: str, where: Where) -> MeasuredCurve:
        """Read a CSV `x,y,z` or `s,x,y,z`."""
        return read_curve(existing(self.folder, name, where), self._where(name))

    def markers(self, name: str, where: Where) -> Markers:
        """Read a CSV `s,x,y,z`."""
        return read_markers(existing(self.folder, name, where), self._where(name))

    def guide_points(self, name: str, where: Where) -> tuple[Annotated[np.ndarray, "k 3"], Path | None]:
        """Read a CSV `x,y,z`."""
        path = existing(self.folder, name, where)
        return read_guide_points(path, self._where(name)), path

    def scan(self, name: str, where: Where) -> Path:
        """Check only that the file exists."""
        return existing(self.folder, name, where)


def load_study(folder_or_toml: str | Path, *, purpose: Purpose = "fit") -> Study:
    """Read and check a study.

    Args:
        folder_or_toml: The folder of the study, or its `study.toml`.
        purpose: "predict" takes poses that have no shape, only clamps (see `check_study`).

    Returns:
        The checked study, with the curves and markers that it names.

    Raises:
        StudyError: An invalid input: file, key, the value found and the remedy.

    Examples:
        >>> from scan2flex_jax.examples import example_path
        >>> [pose.name for pose in load_study(example_path("black-wire")).poses]
        ['turn-0', 'turn-360']
    """
    path = Path(folder_or_toml)
    try:
        if not path.exists():
            advice = f"name the folder that holds {STUDY_FILE}, or that file."
            raise Where(v.one_line(str(path), 300)).fail(f"there is no such file or folder: {advice}")
        path = path / STUDY_FILE if path.is_dir() else path
        folder = path.parent.resolve()
    except (OSError, ValueError, RuntimeError) as error:
        where = Where(v.one_line(str(path), 300))
        raise where.fail(f"the path cannot be opened ({v.one_line(str(error))}): name the study's folder.") from error
    where = Where(v.one_line(str(path), 300))
    missing = f"the folder holds no {path.name}: write one, or name another folder."
    data = _parse(read_text(path, TOML_LIMIT, where, missing), where)
    with np.errstate(all="ignore"):
        return read_tables(data, where, folder, FolderFiles(folder, path.parent), purpose)


def _parse(content: str, where: Where) -> dict[str, Any]:
    """The tree of a TOML text."""
    long_key = _LONG_KEY.search(content)
    if long_key is not None:
        line = content.count("\n", 0, long_key.start()) + 1
        raise where.fail(f"line {line} has a key of more than {MOST_PARTS} parts: write the study by the format.")
    try:
        return tomllib.loads(content)
    except RecursionError as error:
        raise where.fail("its lists or tables are nested too deeply: write the study by the format.") from error
    except ValueError as error:
        reason = v.one_line(str(error).rstrip("."), 200)
        raise where.fail(f"it is not TOML ({reason}): correct that place.") from error


def read_tables(data: dict[str, Any], where: Where, folder: Path | None, files: StudyFiles, purpose: Purpose = "fit") -> Study:
    """The checked study of a TOML tree; `where` is the file, `files` provides the files it names."""
    given = data.get("format")
    if given != FORMAT:
        found = "it is missing" if given is None else f"got {v.shown(given)}"
        raise where.at("format").fail(f'{found}: write format = "{FORMAT}".')
    v.allow(data, _TOP, where)
    gravity = v.required(data, "gravity", where, "gravity = [0.0, 0.0, -9.81]")
    cable = v.sub_table(v.required(data, "cable", where, "[cable] with its length"), where.at("cable"), "[cable]")
    tolerance = _tolerance(data.get("tolerance", {}), where.at("tolerance"))
    with where.placed():
        study = Study(data.get("title", ""), gravity, cable, (), tolerance, folder=folder)
    study = replace(
        study,
        poses=_poses(data, where, files),
        effects=_effects(data.get("effect", []), where.at("effect")),
    )
    study = replace(study, unknowns=_unknowns(study, data.get("unknown", {}), where.at("unknown")))
    with where.placed({"curve": "centre_curve"}):
        check_study(study, purpose)
    return study


def _tolerance(table: Any, where: Where) -> Tolerance:
    """`[tolerance]`: standard deviations; an omitted entry is exact."""
    table = v.sub_table(table, where, "[tolerance]")
    v.allow(table, TOLERANCE, where)
    with where.placed():
        return Tolerance(**table)


def _poses(data: dict[str, Any], where: Where, files: StudyFiles) -> tuple[StudyPose, ...]:
    """All `[[pose]]`, in the order of measurement."""
    here = where.at("pose")
    entries = v.tables(v.required(data, "pose", where, "[[pose]] with its clamps and its shape"), here)
    for i, entry in enumerate(entries):
        numbered = here.item(i + 1)
        v.pose_name(v.required(entry, "name", numbered, 'name = "sag"'), numbered.at("name"))
    return tuple(_pose(entry, here.item(entry["name"]), files) for entry in entries)


def _pose(table: dict[str, Any], where: Where, files: StudyFiles) -> StudyPose:
    """One `[[pose]]` with the files that it names: centre curve, scan, markers, guide points."""
    v.allow(table, _POSE, where)
    v.required(table, "role", where, 'role = "fit" or role = "validate"')
    held = "start = { position = [x, y, z], quaternion = [w, x, y, z] }"
    given = {key: value for key, value in table.items() if key not in _FILES}
    given["start"] = _clamp(v.required(table, "start", where, held), where.at("start"))
    if "end" in table:
        given["end"] = _clamp(table["end"], where.at("end"))
    names = {key: v.text(table[key], where.at(key)) for key in _FILES if key in table}
    if "centre_curve" in names:
        given["curve"] = files.curve(names["centre_curve"], where.at("centre_curve"))
    if "scan" in names:
        given["scan"] = files.scan(names["scan"], where.at("scan"))
    if "markers" in names:
        given["markers"] = files.markers(names["markers"], where.at("markers"))
    if "guide_points" in names:
        given["guide_points"], given["guide_points_path"] = files.guide_points(names["guide_points"], where.at("guide_points"))
    with where.placed():
        return StudyPose(**given)


def _clamp(table: Any, where: Where) -> Clamp:
    """A clamp; without a quaternion, a ball joint."""
    table = v.sub_table(table, where, "{ position = [x, y, z], quaternion = [w, x, y, z] }")
    v.allow(table, ("position", "quaternion"), where)
    v.required(table, "position", where, "position = [x, y, z] in metres")
    with where.placed():
        return Clamp(**table)


def _effects(entries: Any, where: Where) -> tuple[EffectDeclaration, ...]:
    """All `[[effect]]`."""
    effects = []
    for i, table in enumerate(v.tables(entries, where)):
        here = where.item(i + 1)
        kind = v.required(table, "kind", here, 'kind = "point_mass"')
        with here.placed():
            given = {key: value for key, value in table.items() if key not in ("kind", "poses")}
            effects.append(EffectDeclaration(kind, given, table.get("poses")))
    return tuple(effects)


def _unknowns(study: Study, table: Any, where: Where) -> tuple[Unknown, ...]:
    """The tables under `[unknown]`, for the study declared above them in the file.

    TOML writes an effect's parameter as `[unknown."point_mass.mass"]` or as the nested table `[unknown.point_mass.mass]`.
    """
    unknowns: list[Unknown] = []
    for name, body, here in _flat(v.sub_table(table, where, "[unknown.bending_stiffness]"), where):
        check_name(name, study, here)
        v.allow(body, ("guess", "range", "prior"), here)
        bounds = body.get("range", [None, None])
        if not isinstance(bounds, list) or len(bounds) != 2:
            raise here.at("range").fail(f"got {v.shown(bounds)}: write range = [low, high].")
        with here.placed({"low": "range", "high": "range"}):
            low, high = bounds
            unknowns.append(Unknown(name, body.get("guess"), low, high, body.get("prior")))
    return tuple(unknowns)


def _flat(table: dict[str, Any], where: Where) -> Iterator[tuple[str, dict[str, Any], Where]]:
    """Name, body and place of each unknown, with nested tables flattened."""
    example = "[unknown.bending_stiffness]"
    for name, entry in table.items():
        here = where.at(name)
        body = v.sub_table(entry, here, example)
        if any(isinstance(value, dict) for key, value in body.items() if key != "prior"):
            for parameter, inner in body.items():
                yield f"{name}.{parameter}", v.sub_table(inner, here.at(parameter), example), here.at(parameter)
        else:
            yield name, body, here
