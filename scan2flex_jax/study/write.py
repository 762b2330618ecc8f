"""Writing of a study to a folder, such that `load_study` returns an equal one and no user data is lost.

The study is first written to a temporary folder and read back with all checks. Then the files that it names are written, each
in one step, and `study.toml` last: it never names a missing file. A file that would change is kept as NAME.bak, with the user's
comments; one with the same content, up to comments, is left unchanged.
"""

import filecmp
import json
import re
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import numpy as np

from scan2flex_jax.errors import StudyError
from scan2flex_jax.study.curves import read_csv
from scan2flex_jax.study.files import STUDY_FILE, backup, inside, write_atomic, writing
from scan2flex_jax.study.model import Markers, MeasuredCurve, Study, StudyPose, Unknown, relative_name
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
    text = study_text(study, files)
    with writing(toml):
        _check_written(study, text, files, Where(one_line(str(toml), 300)))
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in files.contents.items():
            path = inside(folder, name, Where(one_line(str(folder / name), 300)))
            if not (path.exists() and _holds(path, content)):
                backup(path)
                write_atomic(path, content if isinstance(content, Path) else csv_text(content).encode("ascii"))
        if not (toml.exists() and _is_study(toml, study)):
            backup(toml)
            write_atomic(toml, text.encode("utf-8"))
    return toml


def _check_written(study: Study, text: str, files: NamedFiles, where: Where) -> None:
    """Write a study to a temporary folder, with a dash for each scan, and read an equal one back."""
    with TemporaryDirectory() as name:
        folder = Path(name).resolve()
        for file, content in files.contents.items():
            if isinstance(content, Path) and not content.is_file():
                raise where.fail(f"the scan {one_line(str(content), 200)} is not there: put it back, or name another.")
            path = inside(folder, file, where)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text("-" if isinstance(content, Path) else csv_text(content), "ascii")
        (folder / STUDY_FILE).write_text(text, "utf-8")
        purpose: Purpose = "fit" if any(pose.measured for pose in study.poses) else "predict"
        with where.placed():
            again = load_study(folder, purpose=purpose)
        one, other = (replace(s, poses=tuple(replace(pose, scan=None) for pose in s.poses)) for s in (again, study))
        if one != other:  # scans may get other names
            raise where.fail("the study would not read back as it is: use names and values of the format.")


def _is_study(path: Path, study: Study) -> bool:
    """Whether a study.toml has the same content; one that cannot be read has not."""
    try:
        return load_study(path, purpose="predict") == study
    except StudyError:
        return False


def _holds(path: Path, content: Content) -> bool:
    """Whether a file is this scan, or the CSV of the same numbers."""
    if isinstance(content, Path):
        return path.samefile(content) or filecmp.cmp(path, content, shallow=False)
    header, table = _csv(content)
    try:
        found = read_csv(path, (header,), Where(path.name))[1]
    except StudyError:
        return False
    return np.array_equal(found[np.argsort(found[:, 0], kind="stable")] if isinstance(content, Markers) else found, table)


def csv_text(content: MeasuredCurve | Markers | Annotated[np.ndarray, "k 3"]) -> str:
    """The text of a CSV with all digits, so that every number is restored exactly."""
    header, table = _csv(content)
    return "\n".join([header, *(",".join(map(repr, row)) for row in table.tolist()), ""])


def _csv(content: MeasuredCurve | Markers | Annotated[np.ndarray, "k 3"]) -> tuple[str, Annotated[np.ndarray, "n c"]]:
    if not isinstance(content, MeasuredCurve | Markers):
        return "x,y,z", np.asarray(content)
    if content.arc_length is None:
        return "x,y,z", content.points
    columns = dict(zip("sxyz", [content.arc_length, *content.points.T], strict=True))
    if isinstance(content, Markers):
        columns = {name: column for name, column in columns.items() if name in f"s{content.measured}"}
        columns |= {} if content.offset is None else dict(zip(("d1", "d2"), content.offset.T, strict=True))
    return ",".join(columns), np.column_stack(list(columns.values()))


def study_text(study: Study, files: NamedFiles | None = None) -> str:
    """The text of `study.toml` in the layout of the format: clamps on one line each, and what is assumed of the cable or of the
    noise in comments of their tables. Files get their names in `files`."""
    files = NamedFiles(study) if files is None else files
    noisy = () if all(pose.noise is not None for pose in study.poses if pose.seen) else (_NO_NOISE,)
    tables: list[tuple[str, Mapping[str, Any], tuple[str, ...]]] = [
        ("", {"format": FORMAT, "title": study.title, "gravity": study.gravity}, ()),
        ("[cable]", study.cable, study.assumptions),
        *(("[tolerance]", table, ()) for table in [_of_record(study.tolerance)] if table),
        *((f"[unknown.{_key(one.name)}]", _unknown(one), ()) for one in study.unknowns),
        *(("[[pose]]", _pose(pose, files), () if i else noisy) for i, pose in enumerate(study.poses)),
        *(("[[effect]]", {"kind": one.kind, **one.parameters, "poses": one.poses}, ()) for one in study.effects),
    ]
    parts = ([name, *_entries(table), *(f"# {said}" for said in comments)] for name, table, comments in tables)
    return "\n\n".join("\n".join(filter(None, lines)) for lines in parts) + "\n"


def _unknown(unknown: Unknown) -> dict[str, Any]:
    bounds = None if unknown.low is None or unknown.high is None else [unknown.low, unknown.high]
    return {"guess": unknown.guess, "range": bounds, "prior": unknown.prior}


def _pose(pose: StudyPose, files: NamedFiles) -> dict[str, Any]:
    """The table of one pose, in the order of the format."""
    slug = re.sub(r"[^A-Za-z0-9_-]+", "-", pose.name).strip("-")[:60] or "pose"
    table = _of_record(pose)
    for key, ending in _ENDINGS.items():
        content = getattr(pose, FIELDS.get(key, key))
        if content is not None:
            table[key] = files.add(content, pose.files[key], f"{slug}{ending}")
    return {key: table[key] for key in pose.KEYS if key in table}


def _of_record(record: Record) -> dict[str, Any]:
    """The table of a record: its keys, but files, that differ from what holds where they are left out."""
    defaults = {field.name: field.default for field in fields(record)}  # type: ignore[arg-type]
    names = {key: FIELDS.get(key, key) for key, form in record.KEYS.items() if form.type != "file"}
    return {key: getattr(record, name) for key, name in names.items() if not same(getattr(record, name), defaults[name])}


def _entries(table: Mapping[str, Any]) -> list[str]:
    """The lines of a table's values, without those that are None."""
    return [f"{_key(key)} = {_toml(value)}" for key, value in table.items() if value is not None]


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _toml(name)


def _toml(value: Any) -> str:
    """A value in the notation of TOML, numbers with all digits."""
    value = plain(value)
    if isinstance(value, Record | Mapping):
        return f"{{{', '.join(_entries(value if isinstance(value, Mapping) else _of_record(value)))}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    return repr(value) if isinstance(value, float) else json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
