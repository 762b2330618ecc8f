"""Writing of a study to a folder, such that `load_study` returns an equal one and no user data is lost.

The study is first written to a temporary folder and read back with all checks. Then the files that it names are written, each
in one step, and `study.toml` last: it never names a missing file. A file that would change is kept as
NAME.bak, with the user's comments, which the new one lacks; a file with the same content, up to comments, is left unchanged.
"""

import filecmp
import re
from dataclasses import fields, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import numpy as np
import tomlkit
from tomlkit.items import SingleKey

from scan2flex_jax.errors import StudyError
from scan2flex_jax.study.curves import read_csv
from scan2flex_jax.study.files import STUDY_FILE, backup, inside, write_atomic, writing_error
from scan2flex_jax.study.model import EffectDeclaration, Markers, MeasuredCurve, Study, StudyPose, Unknown, relative_name
from scan2flex_jax.study.read import FIELDS, FORMAT, load_study
from scan2flex_jax.study.records import Record, same
from scan2flex_jax.study.sense import Purpose
from scan2flex_jax.study.values import Where, one_line, plain

Content = MeasuredCurve | Markers | Path | Annotated[np.ndarray, "k 3"]
_NO_NOISE = (
    "noise left out: it is estimated from the residuals, so that an error of the model may pass for noise; "
    "state it in each pose, in m, as in noise = 0.0005"
)
_ENDINGS = {"centre_curve": ".csv", "scan": ".ply", "markers": "-markers.csv", "guide_points": "-guides.csv"}


class NamedFiles:
    """The files that a study will name: the content of each, under its path inside the folder."""

    def __init__(self, study: Study, target: Path | None = None):
        """Files that poses were read from keep their names; a new one takes none of theirs, or of another file in `target`."""
        self.folder, self.target = study.folder, target
        self.contents: dict[str, Content] = {}
        for pose in study.poses:
            for key, path in pose.files.items():
                if path is not None:
                    self.add(getattr(pose, FIELDS.get(key, key)), path, "")

    def add(self, content: Content, path: Path | None, fallback: str) -> str:
        """The name for `content`: its previous one inside the folder, or `fallback`, numbered if it is taken."""
        name = fallback if path is None else relative_name(self.folder, path).as_posix()
        stem, dot, ending = name.rpartition(".")
        number = 1
        while self._taken(name, content, path is None):
            number += 1
            name = f"{stem}-{number}{dot}{ending}" if dot else f"{ending}-{number}"
        self.contents[name] = content
        return name

    def _taken(self, name: str, content: Content, new: bool) -> bool:
        """Whether a name has other content; case does not distinguish names on every system."""
        there = self.target / name if new and self.target is not None else None
        if name.lower() == STUDY_FILE or (there is not None and there.exists() and not _holds(there, content)):
            return True
        other = next((key for key in self.contents if key.lower() == name.lower()), None)
        return other is not None and not (other == name and same(self.contents[other], content))


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
    toml, files = folder / STUDY_FILE, NamedFiles(study, folder)
    tree = study_tables(study, files)
    stated = all(pose.noise is not None for pose in study.poses if pose.seen)
    text = render(tree, study.assumptions, () if stated else (_NO_NOISE,))
    try:
        _check_written(study, tree, text, files, Where(one_line(str(toml), 300)))
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in files.contents.items():
            _put_file(inside(folder, name, Where(one_line(str(folder / name), 300))), content)
        _put_toml(toml, study, text)
    except (OSError, ValueError) as error:
        raise writing_error(toml, error) from error
    return toml


def _check_written(study: Study, tree: dict[str, Any], text: str, files: NamedFiles, where: Where) -> None:
    """Write a study to a temporary folder, an empty file for each scan, and read an equal one back."""
    with TemporaryDirectory() as name:
        folder = Path(name).resolve()
        for file, content in files.contents.items():
            if isinstance(content, Path) and not content.is_file():
                raise where.fail(f"the scan {one_line(str(content), 200)} is not there: put it back, or name another.")
            path = inside(folder, file, where)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text("-" if isinstance(content, Path) else csv_text(content), "ascii")
        (folder / STUDY_FILE).write_text(text, "utf-8")
        named = zip(study.poses, tree["pose"], strict=True)
        poses = [replace(pose, scan=folder / table["scan"]) if "scan" in table else pose for pose, table in named]
        planned = not any(pose.measured for pose in study.poses)
        purpose: Purpose = "predict" if planned else "fit"
        with where.placed():
            again = load_study(folder, purpose=purpose)
        if again != replace(study, poses=tuple(poses), folder=folder):
            raise where.fail("the study would not read back as it is: use names and values of the format.")


def _put_toml(path: Path, study: Study, text: str) -> None:
    """Write study.toml, unless the existing one has the same content."""
    try:
        if path.exists() and load_study(path, purpose="predict") == study:
            return
    except StudyError:
        pass  # the existing file is no study, and is kept in the backup
    backup(path)
    write_atomic(path, text.encode("utf-8"))


def _put_file(path: Path, content: Content) -> None:
    """Write a CSV or copy a scan, unless the existing file has the same content."""
    if path.exists() and _holds(path, content):
        return
    backup(path)
    write_atomic(path, content if isinstance(content, Path) else csv_text(content).encode("ascii"))


def _holds(path: Path, content: Content) -> bool:
    """Whether a file is this scan, or the CSV of the same numbers."""
    if isinstance(content, Path):
        return path.samefile(content) or filecmp.cmp(path, content, shallow=False)
    header, table = _csv(content)
    try:
        found = read_csv(path, (header,), Where(path.name))[1]
        return np.array_equal(found[np.argsort(found[:, 0], kind="stable")] if isinstance(content, Markers) else found, table)
    except StudyError:
        return False


def csv_text(content: MeasuredCurve | Markers | Annotated[np.ndarray, "k 3"]) -> str:
    """The text of a CSV with all digits, so that every number is restored exactly."""
    header, table = _csv(content)
    return "\n".join([header, *(",".join(map(repr, row)) for row in table.tolist()), ""])


def _csv(content: MeasuredCurve | Markers | Annotated[np.ndarray, "k 3"]) -> tuple[str, Annotated[np.ndarray, "n c"]]:
    """The header and the rows of a CSV."""
    if not isinstance(content, MeasuredCurve | Markers):
        return "x,y,z", np.asarray(content)
    if content.arc_length is None:
        return "x,y,z", content.points
    table, names = np.column_stack([content.arc_length, content.points]), list("sxyz")
    if isinstance(content, Markers):
        kept = [name in f"s{content.measured}" for name in names]
        table, names = table[:, kept], [name for name, own in zip(names, kept, strict=True) if own]
        if content.offset is not None:
            table, names = np.c_[table, content.offset], [*names, "d1", "d2"]
    return ",".join(names), table


def study_tables(study: Study, files: NamedFiles) -> dict[str, Any]:
    """The TOML tree of a study, as plain dicts, lists and numbers; files get their names in `files`."""
    tree: dict[str, Any] = {"format": FORMAT, "title": study.title, "gravity": plain(study.gravity)}
    tree["cable"] = {key: plain(value) for key, value in study.cable.items()}
    tree["tolerance"] = _of_record(study.tolerance)
    tree["unknown"] = {unknown.name: _unknown(unknown) for unknown in study.unknowns}
    tree["pose"] = [_pose(pose, files) for pose in study.poses]
    tree["effect"] = [_effect(effect) for effect in study.effects]
    return {key: value for key, value in tree.items() if value or key in ("title", "cable", "pose")}


def _of_record(record: Record) -> dict[str, Any]:
    """The table of a record: its keys that differ from what holds where they are left out, in the order of the format."""
    defaults = {field.name: field.default for field in fields(record)}  # type: ignore[arg-type]
    table = {}
    for key, form in record.KEYS.items():
        name = FIELDS.get(key, key)
        value = getattr(record, name)
        if value is not None and form.type != "file" and not same(value, defaults[name]):
            if isinstance(value, tuple) and value and isinstance(value[0], Record):
                value = [_of_record(one) for one in value]
            table[key] = _of_record(value) if isinstance(value, Record) else plain(value)
    return table


def _effect(effect: EffectDeclaration) -> dict[str, Any]:
    table = {"kind": effect.kind, **{name: plain(value) for name, value in effect.parameters.items()}}
    return table if effect.poses is None else {**table, "poses": list(effect.poses)}


def _unknown(unknown: Unknown) -> dict[str, Any]:
    table = {} if unknown.guess is None else {"guess": plain(unknown.guess)}
    if unknown.low is not None and unknown.high is not None:
        table["range"] = [plain(unknown.low), plain(unknown.high)]
    return table if unknown.prior is None else {**table, "prior": {k: plain(x) for k, x in unknown.prior.items()}}


def _pose(pose: StudyPose, files: NamedFiles) -> dict[str, Any]:
    """The table of one pose, in the order of the format."""
    slug = re.sub(r"[^A-Za-z0-9_-]+", "-", pose.name).strip("-")[:60] or "pose"
    table = _of_record(pose)
    for key, ending in _ENDINGS.items():
        content = getattr(pose, FIELDS.get(key, key))
        if content is not None:
            table[key] = files.add(content, pose.files[key], f"{slug}{ending}")
    return {key: table[key] for key in pose.KEYS if key in table}


def render(tree: dict[str, Any], assumptions: tuple[str, ...] = (), of_poses: tuple[str, ...] = ()) -> str:
    """The TOML text of a study's tree, in the layout of the format: clamps on one line each, assumptions about the cable in
    comments of its table, and those about poses in that of the first pose."""
    document = tomlkit.document()
    for key, value in tree.items():
        if isinstance(value, list) and value and isinstance(value[0], dict):
            array = tomlkit.aot()
            for entry in value:
                array.append(_table(entry))
            for sentence in of_poses if key == "pose" else ():
                array[0].add(tomlkit.comment(sentence))
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
            table[key] = _inline(value)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            table[key] = tomlkit.array()
            table[key].extend(_inline(one) for one in value)
        else:
            table[key] = value
    return table


def _inline(entries: dict[str, Any]) -> Any:
    inline = tomlkit.inline_table()
    inline.update(entries)
    return inline
