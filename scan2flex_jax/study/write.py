"""Writing of a study to a folder, such that `load_study` returns an equal one and no user data is lost.

The study is first read back in memory with the reader's own checks. Then the files that it names are written, each in
one step, and `study.toml` last: it never names a missing file. A file that would change is kept as
NAME.bak, with the user's comments, which the new one lacks; a file with the same content, up to comments, is left unchanged.
"""

import filecmp
import re
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
import tomlkit
from tomlkit.items import SingleKey

from scan2flex_jax.errors import StudyError
from scan2flex_jax.study import arrays
from scan2flex_jax.study.curves import checked_curve, checked_markers
from scan2flex_jax.study.files import backup, inside, write_atomic, writing_error
from scan2flex_jax.study.model import Clamp, EffectDeclaration, Markers, MeasuredCurve, Study, StudyPose, Unknown, relative_name
from scan2flex_jax.study.read import FORMAT, STUDY_FILE, FolderFiles, load_study, read_tables
from scan2flex_jax.study.sense import Purpose
from scan2flex_jax.study.values import Where, one_line

_Kind = TypeVar("_Kind")
Content = MeasuredCurve | Markers | Path | Annotated[np.ndarray, "k 3"]


class NamedFiles:
    """The files that a study will name: the content of each, under its path inside the folder."""

    def __init__(self, folder: Path | None):
        """`folder` is where the study was read from."""
        self.folder = folder
        self.contents: dict[str, Content] = {}

    def add(self, content: Content, path: Path | None, fallback: str) -> str:
        """The name for `content`: its previous one inside the folder, or `fallback`, numbered if it is taken."""
        name = fallback if path is None else relative_name(self.folder, path).as_posix()
        stem, dot, ending = name.rpartition(".")
        number = 1
        while self._taken(name, content):
            number += 1
            name = f"{stem}-{number}{dot}{ending}" if dot else f"{ending}-{number}"
        self.contents[name] = content
        return name

    def _taken(self, name: str, content: Content) -> bool:
        """Whether a name has other content; case does not distinguish names on every system."""
        if name.lower() == STUDY_FILE:
            return True
        other = next((key for key in self.contents if key.lower() == name.lower()), None)
        return other is not None and not (other == name and _equal(self.contents[other], content))

    def curve(self, name: str, where: Where) -> MeasuredCurve:
        """The centre curve of this name, checked like one that is read."""
        curve = _of_kind(self.contents[name], MeasuredCurve, where)
        return checked_curve(curve.points, curve.arc_length, curve.path, where)

    def markers(self, name: str, where: Where) -> Markers:
        """The markers of this name, checked like those that are read."""
        markers = _of_kind(self.contents[name], Markers, where)
        return checked_markers(markers.points, markers.arc_length, markers.path, where)

    def guide_points(self, name: str, where: Where) -> tuple[Annotated[np.ndarray, "k 3"], Path | None]:
        """The guide points of this name."""
        points = _of_kind(self.contents[name], np.ndarray, where)
        return arrays.points(points, 2, where), None

    def scan(self, name: str, where: Where) -> Path:
        """The scan to copy, which must still exist."""
        path = _of_kind(self.contents[name], Path, where)
        if not path.is_file():
            raise where.fail(f"the scan {one_line(str(path), 200)} is not there: put it back, or name another.")
        return path


def _of_kind(content: Any, kind: type[_Kind], where: Where) -> _Kind:
    """Refuse one name for two kinds of content."""
    if not isinstance(content, kind):
        raise where.fail("the same file name stands for two things: give each its own.")
    return content


def _equal(a: Content, b: Content) -> bool:
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return np.array_equal(a, b, equal_nan=True)
    return type(a) is type(b) and a == b


def save_study(study: Study, folder: str | Path) -> Path:
    """Write a study such that `load_study` returns an equal one.

    Args:
        study: The study; its curves and scans are written or copied too.
        folder: Created if missing. A file that would change is kept as NAME.bak.

    Returns:
        The path of its `study.toml`.

    Raises:
        StudyError: The study cannot be read back, or the folder cannot be written.

    Examples:
        >>> save_study(fit(study).calibrated, "calibrated")  # doctest: +SKIP
    """
    folder = Path(folder)
    toml = folder / STUDY_FILE
    files = NamedFiles(study.folder)
    tree = study_tables(study, files)
    with np.errstate(all="ignore"):
        planned = not any(pose.curve or pose.scan or pose.markers for pose in study.poses)
        purpose: Purpose = "predict" if planned else "fit"
        again = read_tables(tree, Where(one_line(str(toml), 300)), study.folder, files, purpose)
    if again != study:
        raise StudyError(toml, None, "the study would not read back as it is: use names and values of the format.")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in files.contents.items():
            _put_file(folder, name, content)
        _put_toml(toml, study, render(tree, study.assumptions))
    except (OSError, ValueError) as error:
        raise writing_error(toml, error) from error
    return toml


def _put_toml(path: Path, study: Study, text: str) -> None:
    """Write study.toml, unless the existing one has the same content."""
    try:
        if path.exists() and load_study(path, purpose="predict") == study:
            return
    except StudyError:
        pass  # the existing file is no study, and is kept in the backup
    backup(path)
    write_atomic(path, text.encode("utf-8"))


def _put_file(folder: Path, name: str, content: Content) -> None:
    """Write a CSV or copy a scan, unless the existing file has the same content."""
    path = inside(folder, name, Where(one_line(str(folder / name), 300)))
    if isinstance(content, Path):
        if path.exists() and (path.samefile(content) or filecmp.cmp(path, content, shallow=False)):
            return
    elif path.exists() and _holds(folder, name, content):
        return
    backup(path)
    write_atomic(path, content if isinstance(content, Path) else csv_text(content).encode("ascii"))


def _holds(folder: Path, name: str, content: Content) -> bool:
    """Whether the CSV in the folder contains the same numbers."""
    files, where = FolderFiles(folder, folder), Where(name)
    try:
        found: Content
        if isinstance(content, MeasuredCurve):
            found = files.curve(name, where)
        else:
            found = files.markers(name, where) if isinstance(content, Markers) else files.guide_points(name, where)[0]
    except StudyError:
        return False
    return _equal(found, content)


def csv_text(content: MeasuredCurve | Markers | Annotated[np.ndarray, "k 3"]) -> str:
    """The text of a CSV with all digits, so that every number is restored exactly."""
    header = "x,y,z"
    table: np.ndarray = content.points if isinstance(content, MeasuredCurve | Markers) else np.asarray(content)
    if isinstance(content, MeasuredCurve | Markers) and content.arc_length is not None:
        header, table = "s,x,y,z", np.column_stack([content.arc_length, content.points])
    if isinstance(content, Markers):
        header, table = f"s,{','.join(content.measured)}", np.compress(~np.isnan(table[0]), table, axis=1)
    lines = [",".join(map(repr, row)) for row in table.tolist()]
    return "\n".join([header, *lines, ""])


def study_tables(study: Study, files: NamedFiles) -> dict[str, Any]:
    """The TOML tree of a study, as plain dicts, lists and numbers; files get their names in `files`."""
    tree: dict[str, Any] = {"format": FORMAT, "title": study.title, "gravity": _plain(study.gravity)}
    tree["cable"] = {key: _plain(value) for key, value in study.cable.items()}
    if study.tolerance.given:
        tree["tolerance"] = {key: float(value) for key, value in study.tolerance.given.items()}
    if study.unknowns:
        tree["unknown"] = {unknown.name: _unknown(unknown) for unknown in study.unknowns}
    tree["pose"] = [_pose(pose, files) for pose in study.poses]
    if study.effects:
        tree["effect"] = [_effect(effect) for effect in study.effects]
    return tree


def _plain(value: Any) -> Any:
    return np.asarray(value, dtype=np.float64).tolist()


def _effect(effect: EffectDeclaration) -> dict[str, Any]:
    table = {"kind": effect.kind, **{name: _plain(value) for name, value in effect.parameters.items()}}
    return table if effect.poses is None else {**table, "poses": list(effect.poses)}


def _unknown(unknown: Unknown) -> dict[str, Any]:
    table = {} if unknown.guess is None else {"guess": _plain(unknown.guess)}
    if unknown.low is not None and unknown.high is not None:
        table["range"] = [_plain(unknown.low), _plain(unknown.high)]
    return table if unknown.prior is None else {**table, "prior": {k: _plain(x) for k, x in unknown.prior.items()}}


def _pose(pose: StudyPose, files: NamedFiles) -> dict[str, Any]:
    """The table of one pose, in the order of the format."""
    slug = re.sub(r"[^A-Za-z0-9_-]+", "-", pose.name).strip("-")[:60] or "pose"
    table: dict[str, Any] = {"name": pose.name, "role": pose.role, "start": _clamp(pose.start)}
    if pose.end is not None:
        table["end"] = _clamp(pose.end)
    if pose.turns:
        table["turns"] = pose.turns
    if pose.curve is not None:
        table["centre_curve"] = files.add(pose.curve, pose.curve.path, f"{slug}.csv")
    if pose.scan is not None:
        table["scan"] = files.add(Path(pose.scan), Path(pose.scan), f"{slug}.ply")
    if pose.markers is not None:
        table["markers"] = files.add(pose.markers, pose.markers.path, f"{slug}-markers.csv")
    if pose.guide_points is not None:
        table["guide_points"] = files.add(pose.guide_points, pose.guide_points_path, f"{slug}-guides.csv")
    if pose.viewpoints is not None:
        table["viewpoints"] = _plain(pose.viewpoints)
    if pose.noise is not None:
        table["noise"] = float(pose.noise)
    if pose.repeat_of is not None:
        table["repeat_of"] = pose.repeat_of
    return table | _circumstances(pose)


def _circumstances(pose: StudyPose) -> dict[str, Any]:
    """Gravity, time and reset of a pose, if given."""
    table = {} if pose.gravity is None else {"gravity": _plain(pose.gravity)}
    table |= {} if pose.time is None else {"time": float(pose.time)}
    return {**table, "reset": True} if pose.reset else table


def _clamp(clamp: Clamp) -> dict[str, Any]:
    table = {"position": _plain(clamp.position)}
    return table if clamp.quaternion is None else {**table, "quaternion": _plain(clamp.quaternion)}


def render(tree: dict[str, Any], assumptions: tuple[str, ...] = ()) -> str:
    """The TOML text of a study's tree, in the layout of the format: clamps on one line each, and assumptions about the cable in
    a comment of its table."""
    document = tomlkit.document()
    for key, value in tree.items():
        if isinstance(value, list) and value and isinstance(value[0], dict):
            array = tomlkit.aot()
            for entry in value:
                array.append(_table(entry))
            document[key] = array
        elif key == "unknown":
            nested = tomlkit.table(is_super_table=True)
            for name, body in value.items():
                nested.append(SingleKey(name), _table(body))
            document[key] = nested
        else:
            document[key] = _table(value) if isinstance(value, dict) else value
        if key == "cable":
            for sentence in assumptions:
                document[key].add(tomlkit.comment(sentence))
    return tomlkit.dumps(document)


def _table(entries: dict[str, Any]) -> Any:
    table = tomlkit.table()
    for key, value in entries.items():
        if isinstance(value, dict):
            inline = tomlkit.inline_table()
            inline.update(value)
            table[key] = inline
        else:
            table[key] = value
    return table
