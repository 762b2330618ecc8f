"""Reading of a study from its folder: `study.toml` and the files that it names.

TOML is converted to the parts of a study, which check themselves; here their errors get the place in the file.
"""

import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from scan2flex_jax.study import values as v
from scan2flex_jax.study.curves import read_curve, read_guide_points, read_markers
from scan2flex_jax.study.declared import check_name
from scan2flex_jax.study.files import STUDY_FILE, TOML_LIMIT, existing, read_text
from scan2flex_jax.study.kinds import KEYS, ParameterFormat, kind_format, kind_names
from scan2flex_jax.study.model import EffectDeclaration, Study, StudyPose, Tolerance, Unknown
from scan2flex_jax.study.records import Record
from scan2flex_jax.study.section import sections
from scan2flex_jax.study.sense import Purpose, check_study
from scan2flex_jax.study.values import Where

SHARE = re.compile(r"\s*\d{1,3}(\.\d*)?\s*%\s*")  # of the length, as a place
FORMAT = "scan2flex-study/1"
FIELDS = {"centre_curve": "curve", "pose": "poses", "unknown": "unknowns", "effect": "effects"}
"""Fields of the records that have another name than their key."""
Parts = Mapping[str, type[Record] | tuple[type[Record]]]
MOST_PARTS = 32  # of a dotted key: a study's have three at most, and the run time of tomllib grows with their square or cube
# possessive, for a search in linear time
_PART = r"""(?:[A-Za-z0-9_-]++|"[^"\\\n]*+(?:\\.[^"\\\n]*+)*+"|'[^'\n]*+')"""
_LONG_KEY = re.compile(rf"(?:^[ \t]*+\[{{0,2}}+|[{{,])[ \t]*+(?:{_PART}[ \t]*+\.[ \t]*+){{{MOST_PARTS}}}", re.MULTILINE)
_READERS: dict[str, Callable[[Path, Where], Any]] = {
    "centre_curve": read_curve, "markers": read_markers, "guide_points": read_guide_points, "scan": lambda path, _: path,
}  # fmt: skip


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
    where = Where(v.one_line(str(path), 300))
    try:
        if not path.exists():
            raise where.fail(f"there is no such file or folder: name the folder that holds {STUDY_FILE}, or that file.")
        path = path / STUDY_FILE if path.is_dir() else path
        folder = path.parent.resolve()
    except (OSError, ValueError, RuntimeError) as error:
        raise where.fail(f"the path cannot be opened ({v.one_line(str(error))}): name the study's folder.") from error
    where = Where(v.one_line(str(path), 300))
    missing = f"the folder holds no {path.name}: write one, or name another folder."
    data = _parsed(read_text(path, TOML_LIMIT, where, missing), where)
    with np.errstate(all="ignore"):
        return _study(data, where, folder, path.parent, purpose)


def _parsed(content: str, where: Where) -> dict[str, Any]:
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


def _study(data: dict[str, Any], where: Where, folder: Path, shown: Path, purpose: Purpose) -> Study:
    """The checked study of a TOML tree; `where` is the file, `shown` its folder in the user's notation."""
    if data.get("format") != FORMAT:
        said = f"got {v.shown(data['format'])}" if "format" in data else "it is missing"
        raise where.at("format").fail(f'{said}: write format = "{FORMAT}".')
    data = _given(KEYS["study"], Study.PARTS, data, where, "")
    poses = tuple(_poses(data["poses"], where.at("pose"), folder, shown))
    unknowns, here = data.get("unknowns", {}), where.at("unknown")
    v.table(unknowns, None, here, KEYS["study"]["unknown"].example)
    cable, effects = data["cable"], list[EffectDeclaration]()
    if isinstance(cable, dict) and "section" in cable:
        path = existing(folder, v.text(cable["section"], at := where.at("cable.section")), at)
        shown_path = Where(v.one_line(str(shown / cable["section"]), 300))
        cable = {name: cable[name] for name in cable if name != "section"}
        if "length" in cable:
            cable["length"] = KEYS["cable"]["length"].take(cable["length"], where.at("cable.length"))
        sectioned, cable = sections(path, shown_path, cable, unknowns)
        effects.append(sectioned)
    with where.placed():
        study = Study(data.get("title", ""), data["gravity"], cable, poses, data.get("tolerance", Tolerance()), folder=folder)
    length = None if "length" in unknowns else study.length
    effects += _effects(data.get("effects", []), where.at("effect"), length)
    study = replace(study, effects=tuple(effects))
    study = replace(study, unknowns=tuple(_unknowns(study, unknowns, here)))
    with where.placed({"curve": "centre_curve"}):
        check_study(study, purpose)
    return study


def _given(keys: Mapping[str, ParameterFormat], parts: Parts, given: Any, where: Where, example: str) -> dict[str, Any]:
    """The values of a table by the fields of its record, tables as records; all keys are known, and required ones are there."""
    given = v.table(given, keys, where, example)
    for name, key in keys.items():
        value, here, part = given.get(name), where.at(name), parts.get(name)
        if key.required:
            v.required(given, name, where, key.written)
        if name not in given or part is None or key.type == "file":
            continue
        if not isinstance(part, tuple):
            given[name] = _record(part, value, here, key.example)
        elif isinstance(value, list):
            given[name] = tuple(_record(part[0], one, here.item(i), key.example) for i, one in enumerate(value, 1))
        else:
            raise here.fail(f"got {v.shown(value)}: write {key.written}.")
    return {FIELDS.get(name, name): value for name, value in given.items()}


def _record(record: type[Record], given: Any, where: Where, example: str) -> Record:
    values = _given(record.KEYS, record.PARTS, given, where, example)
    with where.placed():
        return record(**values)


def _tables(value: Any, where: Where) -> list[dict[str, Any]]:
    if not isinstance(value, list) or not all(isinstance(entry, dict) for entry in value):
        raise where.fail(f"got {v.shown(value)}: write each one as a table that begins with [[{where.key}]].")
    return value


def _poses(entries: Any, where: Where, folder: Path, shown: Path) -> Iterator[StudyPose]:
    name = KEYS["pose"]["name"]
    for i, table in enumerate(_tables(entries, where)):
        here = where.item(i + 1)
        here = where.item(name.take(v.required(table, "name", here, name.written), here.at("name")))
        given = _given(StudyPose.KEYS, StudyPose.PARTS, table, here, "[[pose]]")
        for key, reader in _READERS.items():
            if key in table:
                path = existing(folder, v.text(table[key], here.at(key)), here.at(key))
                given[FIELDS.get(key, key)] = reader(path, Where(v.one_line(str(shown / table[key]), 300)))
                given |= {"guide_points_path": path} if key == "guide_points" else {}
        with here.placed():
            yield StudyPose(**given)


def _effects(entries: Any, where: Where, length: float | None) -> Iterator[EffectDeclaration]:
    """All `[[effect]]` of a cable of this length (m), of which a place may be a share."""
    for i, table in enumerate(_tables(entries, where)):
        here = where.item(i + 1)
        kind = v.required(table, "kind", here, KEYS["effect"]["kind"].written)
        with here.placed():
            given = {key: table[key] for key in table if key not in KEYS["effect"]}
            name = kind_format(kind).position if isinstance(kind, str) and kind in kind_names() else None
            place = given.get(name or "")
            if name and isinstance(place, str) and SHARE.fullmatch(place):
                if length is None:
                    said = f"got {v.shown(place)} of a length that is unknown: write the place in m from the start."
                    raise here.at(name).fail(said)
                share = float(place.replace("%", ""))
                given[name] = length * (1.0 if share == 100 else 0.01 * share)
            yield EffectDeclaration(kind, given, table.get("poses"))


def _unknowns(study: Study, table: dict[str, Any], where: Where) -> Iterator[Unknown]:
    """The tables under `[unknown]`, for the study declared above them in the file.

    TOML writes an effect's parameter as `[unknown."point_mass.mass"]` or as the nested table `[unknown.point_mass.mass]`."""
    example = KEYS["study"]["unknown"].example
    for first, entry in table.items():
        here = where.at(first)
        body = v.table(entry, None, here, example)
        nested = any(isinstance(value, dict) for key, value in body.items() if key != "prior")
        inner = {f"{first}.{key}": (value, here.at(key)) for key, value in body.items()} if nested else {first: (body, here)}
        for name, (values, at) in inner.items():
            given = v.table(values, None, at, example)
            check_name(name, study, at)
            v.table(given, ("guess", "range", "prior"), at, "")
            bounds = given.get("range", [None, None])
            if not isinstance(bounds, list) or len(bounds) != 2:
                raise at.at("range").fail(f"got {v.shown(bounds)}: write range = [low, high].")
            with at.placed({"low": "range", "high": "range"}):
                yield Unknown(name, given.get("guess"), bounds[0], bounds[1], given.get("prior"))
