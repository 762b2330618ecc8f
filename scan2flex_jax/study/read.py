"""Read a study from its folder: `study.toml` and the files that it names.

`load_study` returns a `Study`, or raises one `StudyError` that names the file and the key, says what was got and what
to do. First each value is checked by itself, here; then what the values say together, in `sense`.
"""

import tomllib
from pathlib import Path
from typing import Annotated, Any, Protocol, runtime_checkable

import numpy as np

from scan2flex_jax.study import values as v
from scan2flex_jax.study.curves import read_curve, read_guide_points
from scan2flex_jax.study.declared import read_effects, read_unknowns
from scan2flex_jax.study.files import TOML_LIMIT, existing, read_text
from scan2flex_jax.study.kinds import CABLE, TOLERANCE
from scan2flex_jax.study.model import Clamp, MeasuredCurve, Study, StudyPose, Tolerance, Value
from scan2flex_jax.study.sense import check_curve, check_study
from scan2flex_jax.study.values import Where

FORMAT = "scan2flex-study/1"
STUDY_FILE = "study.toml"
MOST_TURNS = 1000
_TOP = ("format", "title", "gravity", "cable", "tolerance", "unknown", "pose", "effect")
_POSE = (
    "name", "role", "start", "end", "turns", "centre_curve", "scan", "guide_points", "viewpoints", "noise", "repeat_of",
)  # fmt: skip


@runtime_checkable
class StudyFiles(Protocol):
    """Where the files that a study names come from: a folder, or the memory that is about to be saved."""

    def curve(self, name: str, where: Where) -> MeasuredCurve:
        """The centre curve of this name."""

    def guide_points(self, name: str, where: Where) -> tuple[Annotated[np.ndarray, "k 3"], Path | None]:
        """The guide points of this name, and their file."""

    def scan(self, name: str, where: Where) -> Path:
        """The file of a point cloud."""


class FolderFiles:
    """The files in the folder of a study; `shown_folder` is the folder as the user named it."""

    def __init__(self, folder: Path, shown_folder: Path):
        """Keep both."""
        self.folder = folder
        self.shown_folder = shown_folder

    def _where(self, name: str) -> Where:
        return Where(v.one_line(str(self.shown_folder / name), 300))

    def curve(self, name: str, where: Where) -> MeasuredCurve:
        """Read a CSV `x,y,z` or `s,x,y,z`."""
        return read_curve(existing(self.folder, name, where), self._where(name))

    def guide_points(self, name: str, where: Where) -> tuple[Annotated[np.ndarray, "k 3"], Path | None]:
        """Read a CSV `x,y,z`."""
        path = existing(self.folder, name, where)
        return read_guide_points(path, self._where(name)), path

    def scan(self, name: str, where: Where) -> Path:
        """Only see that the file is there."""
        return existing(self.folder, name, where)


def load_study(folder_or_toml: str | Path) -> Study:
    """Read and check a study, given its folder or its `study.toml`; raises `StudyError`."""
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
        return read_tables(data, where, folder, FolderFiles(folder, path.parent))


def _parse(content: str, where: Where) -> dict[str, Any]:
    """The tree of a TOML text."""
    try:
        return tomllib.loads(content)
    except RecursionError as error:
        raise where.fail("its lists or tables are nested too deeply: write the study by the format.") from error
    except ValueError as error:
        reason = v.one_line(str(error).rstrip("."), 200)
        raise where.fail(f"it is not TOML ({reason}): correct that place.") from error


def read_tables(data: dict[str, Any], where: Where, folder: Path | None, files: StudyFiles) -> Study:
    """The checked study that a TOML tree says; `where` is the file, `files` gives what it names."""
    given = data.get("format")
    if given != FORMAT:
        found = "it is missing" if given is None else f"got {v.shown(given)}"
        raise where.at("format").fail(f'{found}: write format = "{FORMAT}".')
    v.allow(data, _TOP, where)
    title = v.text(data.get("title", ""), where.at("title"))
    gravity = v.vector(v.required(data, "gravity", where, "gravity = [0.0, 0.0, -9.81]"), 3, where.at("gravity"))
    cable = _cable(data, where)
    tolerance = _tolerance(data.get("tolerance", {}), where.at("tolerance"))
    poses = _poses(data, where, files)
    study = Study(title, gravity, cable, poses, tolerance, folder=folder)
    study = read_effects(study, data.get("effect", []), where.at("effect"))
    study = read_unknowns(study, data.get("unknown", {}), where.at("unknown"))
    check_study(study, where)
    return study


def _cable(data: dict[str, Any], where: Where) -> dict[str, Value]:
    """`[cable]`: what is known of the cable."""
    here = where.at("cable")
    table = v.sub_table(v.required(data, "cable", where, "[cable] with its length"), here, "[cable]")
    v.allow(table, CABLE, here)
    cable = {key: v.quantity(value, CABLE[key], here.at(key)) for key, value in table.items()}
    stretch = cable.get("natural_stretch")
    if isinstance(stretch, np.ndarray) and stretch[2] <= -1:
        raise here.at("natural_stretch").fail(f"got {stretch[2]:g} along d3: give a stretch above -1.")
    return cable


def _tolerance(table: Any, where: Where) -> Tolerance:
    """`[tolerance]`: standard deviations; each entry left out is exact."""
    table = v.sub_table(table, where, "[tolerance]")
    v.allow(table, TOLERANCE, where)
    return Tolerance(**{key: float(v.quantity(table[key], TOLERANCE[key], where.at(key))) for key in table})


def _poses(data: dict[str, Any], where: Where, files: StudyFiles) -> tuple[StudyPose, ...]:
    """All `[[pose]]`, in the order in which they were measured."""
    here = where.at("pose")
    entries = v.tables(v.required(data, "pose", where, "[[pose]] with its clamps and its shape"), here)
    names: list[str] = []
    for i, entry in enumerate(entries):
        key = here.item(i + 1).at("name")
        name = v.text(v.required(entry, "name", here.item(i + 1), 'name = "sag"'), key)
        if not name.strip():
            raise key.fail("the name is empty: give the pose a name.")
        if name in names:
            raise key.fail(f"two poses are called {v.shown(name)}: give each pose its own name.")
        names.append(name)
    return tuple(_pose(entry, here.item(entry["name"]), names, files) for entry in entries)


def _pose(table: dict[str, Any], where: Where, names: list[str], files: StudyFiles) -> StudyPose:
    """One `[[pose]]`."""
    v.allow(table, _POSE, where)
    role = v.text(v.required(table, "role", where, 'role = "fit" or role = "validate"'), where.at("role"))
    if role not in ("fit", "validate"):
        raise where.at("role").fail(f'got {v.shown(role)}: write "fit" or "validate".')
    held = "start = { position = [x, y, z], quaternion = [w, x, y, z] }"
    start = _clamp(v.required(table, "start", where, held), where.at("start"))
    end = _clamp(table["end"], where.at("end")) if "end" in table else None
    turns = v.integer(table.get("turns", 0), where.at("turns"), MOST_TURNS)
    if turns and (start.quaternion is None or end is None or end.quaternion is None):
        raise where.at("turns").fail(f"got {turns}, but an end turns freely: write turns only between two clamps.")
    noise = None
    if "noise" in table:
        noise = v.number(table["noise"], where.at("noise"))
        v.check_domain(noise, "positive", where.at("noise"))
    viewpoints = v.rows(table["viewpoints"], where.at("viewpoints")) if "viewpoints" in table else None
    repeat_of = v.text(table["repeat_of"], where.at("repeat_of")) if "repeat_of" in table else None
    if repeat_of is not None and (repeat_of not in names or repeat_of == table["name"]):
        others = [name for name in names if name != table["name"]]
        hint = v.suggestion(repeat_of, others)
        raise where.at("repeat_of").fail(f"no other pose is called {v.shown(repeat_of)}: {hint}")
    curve, scan, guides, path = _shape(table, where, files)
    return StudyPose(
        table["name"], role, start, end, turns, curve, scan, guides, viewpoints, noise, repeat_of, path
    )  # fmt: skip


def _clamp(table: Any, where: Where) -> Clamp:
    """A clamp; without a quaternion, a ball joint."""
    table = v.sub_table(table, where, "{ position = [x, y, z], quaternion = [w, x, y, z] }")
    v.allow(table, ("position", "quaternion"), where)
    position = v.vector(
        v.required(table, "position", where, "position = [x, y, z] in metres"), 3, where.at("position")
    )
    quaternion = None
    if "quaternion" in table:
        key = where.at("quaternion")
        quaternion = v.unit(v.vector(table["quaternion"], 4, key), key, "quaternion [w, x, y, z]")
    return Clamp(position, quaternion)


def _shape(
    table: dict[str, Any], where: Where, files: StudyFiles
) -> tuple[MeasuredCurve | None, Path | None, Annotated[np.ndarray, "k 3"] | None, Path | None]:
    """What was measured of a pose: centre curve, scan, guide points and their file."""
    if "centre_curve" not in table and "scan" not in table:
        raise where.fail("it has no shape: give it a centre_curve, a scan, or both.")
    curve = scan = guides = path = None
    if "centre_curve" in table:
        key = where.at("centre_curve")
        curve = files.curve(v.text(table["centre_curve"], key), key)
        check_curve(curve, key)
    if "scan" in table:
        key = where.at("scan")
        scan = files.scan(v.text(table["scan"], key), key)
    if "guide_points" in table:
        key = where.at("guide_points")
        guides, path = files.guide_points(v.text(table["guide_points"], key), key)
    return curve, scan, guides, path
