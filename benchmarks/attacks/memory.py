"""Hostile values in a study in memory and in the arguments of the rod, as a notebook would give them."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.attacks.attempt import REFUSED, Place, RefusedError, Try, WrongError
from benchmarks.attacks.scene import ALONG_X, ELEMENTS
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting import boundary_of, model_of
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.model import CableModel
from scan2flex_jax.statics import equilibrium
from scan2flex_jax.study import Study, describe, load_study, save_study

_RAGGED = [[1.0], [1.0, 2.0]]
NEVER: dict[str, Any] = {  # what no number, vector, clamp, curve or pose of a study is
    "nan": float("nan"), "inf": float("inf"), "-inf": -float("inf"), "np.nan": np.float64("nan"), "complex": 1j,
    "three nan": np.full(3, np.nan), "four inf": np.full(4, np.inf), "objects": np.array([object()] * 3), "ragged": _RAGGED,
    "object": object(), "a function": len, "a class": int, "bytes": b"1.0", "a set": {1.0},
    "a date": np.datetime64("2020-01-01"),
    "a generator": (x for x in ()), "10^400": 10**400, "texts": ["a", "b", "c"], "mixed": [1.0, None, "c"],
    "structured": np.zeros(3, dtype=[("x", "f8")]), "deep": [[[[[[1.0]]]]]], "masked nan": np.ma.array([np.nan] * 3, mask=True),
}  # fmt: skip
ODD: dict[str, Any] = {
    "None": None, "True": True, "False": False, "text": "text", "number as text": "0.1", "empty text": "", "empty list": [],
    "empty array": np.zeros(0), "empty rows": np.zeros((0, 3)), "0": 0.0, "-0.0": -0.0, "-1": -1.0, "1": 1, "1e308": 1e308,
    "5e-324": 5e-324, "1e16": 1e16, "float32": np.float32(0.1), "int8": np.int8(1), "0-d array": np.array(0.1),
    "one entry": [0.1], "two": [0.1, 0.2], "three": [0.1, 0.2, 0.3], "three zeros": np.zeros(3), "four ones": np.ones(4),
    "four zeros": np.zeros(4), "rows": np.ones((5, 3)), "rows of four": np.ones((5, 4)), "3 by 3": np.eye(3),
    "4 by 4": np.eye(4), "5-d": np.ones((1,) * 5), "dict": {"a": 1.0}, "path": Path("/dev/zero"), "dots": "../../x",
    "bools": [True, False, True], "int64": np.arange(3), "big": np.full(3, 1e200),
    "a line": np.linspace(0, 1, 12)[:, None] * [1.0, 0.0, 0.0], "one place": np.zeros((12, 3)),
}  # fmt: skip
_PARTS: dict[str, tuple[Callable[[Study], Any], Callable[[Study, Any], Study]]] = {
    "Study": (lambda s: s, lambda s, x: x),
    "StudyPose": (lambda s: s.poses[0], lambda s, x: replace(s, poses=(x, *s.poses[1:]))),
    "Clamp": (lambda s: s.poses[0].start, lambda s, x: replace(s, poses=(replace(s.poses[0], start=x), *s.poses[1:]))),
    "MeasuredCurve": (lambda s: s.poses[0].curve, lambda s, x: replace(s, poses=(replace(s.poses[0], curve=x), *s.poses[1:]))),
    "Unknown": (lambda s: s.unknowns[0], lambda s, x: replace(s, unknowns=(x, *s.unknowns[1:]))),
    "Tolerance": (lambda s: s.tolerance, lambda s, x: replace(s, tolerance=x)),
    "EffectDeclaration": (lambda s: s.effects[0], lambda s, x: replace(s, effects=(x, *s.effects[1:]))),
}
_FIELDS = {
    "Study": ("title", "gravity", "cable", "poses", "tolerance", "unknowns", "effects"),
    "StudyPose": ("name", "role", "start", "end", "turns", "curve", "scan", "guide_points", "viewpoints", "noise", "repeat_of"),
    "Clamp": ("position", "quaternion"),
    "MeasuredCurve": ("points", "arc_length"),
    "Unknown": ("name", "guess", "low", "high"),
    "Tolerance": ("length", "clamp_position", "clamp_rotation", "gravity"),
    "EffectDeclaration": ("kind", "parameters"),
}


def in_memory(place: Place, folder: Path) -> Iterator[Try]:
    """Every field of every part of a study, every key of a cable and of an effect."""
    study = load_study(folder)
    copy = place.root / "copy"
    for name, value, never in _values():
        must = REFUSED if never else None
        for part, fields in _FIELDS.items():
            get, put = _PARTS[part]
            for field in fields:
                changed = _changed(study, get, put, field, value)
                yield Try(f"{part}.{field} = {name}", _checked(changed, copy), (copy,), must)
        for key in (*study.cable, "bending_stiffness"):
            yield Try(f"cable {key} = {name}", _checked(_cable(study, key, value), copy), (copy,), must)
        yield Try(f"effect position = {name}", _checked(_parameter(study, "position", value), copy), (copy,), must)


def _values() -> Iterator[tuple[str, Any, bool]]:
    for values in (NEVER, ODD):
        for name, value in values.items():
            yield name, value, values is NEVER


def _changed(study, get, put, field, value) -> Callable[[], Study]:
    return lambda: put(study, replace(get(study), **{field: value}))


def _cable(study, key, value) -> Callable[[], Study]:
    return lambda: replace(study, cable={**study.cable, key: value})


def _parameter(study, name, value) -> Callable[[], Study]:
    effect = study.effects[0]
    changed = lambda: replace(effect, parameters={**effect.parameters, name: value})  # noqa: E731
    return lambda: replace(study, effects=(changed(), *study.effects[1:]))


def _checked(make: Callable[[], Study], copy: Path) -> Callable[[], None]:
    """A study that is taken makes a model of finite numbers, is described, and is one that can be saved and read."""

    def act():
        study = make()
        model, boundaries = model_of(study), [boundary_of(pose) for pose in study.poses]
        numbers = [*_leaves(model), *(x for boundary in boundaries for x in _leaves(boundary))]
        if not all(np.all(np.isfinite(x)) for x in numbers):
            raise WrongError(f"a model with numbers that are not finite: {study.cable}")
        describe(study)
        try:
            save_study(study, copy)
        except Scan2FlexError as error:
            raise WrongError(f"taken in memory, and refused as a file: {error}") from error
        if load_study(copy) != study:
            raise WrongError("a saved study is another one")

    return act


def _leaves(tree) -> list[np.ndarray]:
    import jax  # noqa: PLC0415

    return [np.asarray(x) for x in jax.tree.leaves(tree) if np.asarray(x).dtype.kind == "f"]


CABLE = {"length": 1.0, "length_density": 0.2, "bending_stiffness": 0.1, "torsional_stiffness": 0.25, "shear_stiffness": 1e5,
         "axial_stiffness": 1e5, "natural_curvature": [0.0, 0.0, 0.0], "natural_stretch": [0.0, 0.0, 0.0]}  # fmt: skip


def of_the_rod() -> Iterator[Try]:
    """Arguments of `Cable`, `CableModel`, `Boundary` and `equilibrium`: solved with finite numbers, or refused."""
    for name, value, never in _values():
        must = REFUSED if never else None
        for field in CABLE:
            yield Try(f"Cable({field} = {name})", _rod(cable={field: value}), (), must)
        yield Try(f"CableModel(gravity = {name})", _rod(gravity=value), (), must)
        for part in ("position", "rotation"):
            yield Try(f"Boundary {part} = {name}", _rod(**{part: value}), (), must)
        for option in ("elements", "turns", "solver", "start", "max_steps"):
            if not isinstance(value, int) or value is True:  # a whole number is right
                yield Try(f"equilibrium({option} = {name})", _rod(options={option: value}), (), must)


def _rod(cable=None, gravity=(0.0, 0.0, -9.81), position=(0.0, 0.0, 0.0), rotation=ALONG_X, options=None):
    def act():
        model = CableModel(Cable(**{**CABLE, **(cable or {})}), gravity)
        boundary = Boundary.of((position, rotation), (np.array([0.6, 0.0, 0.0]), np.array(ALONG_X)))
        found = equilibrium(model, boundary, **{"elements": ELEMENTS, "max_steps": 200, **(options or {})})
        if not bool(found.verdict.solved):
            raise RefusedError(found.verdict.sentence())
        for x in (found.points, *found.section_forces(), *found.reactions()):
            if not np.all(np.isfinite(x)):
                raise WrongError("solved, with numbers that are not finite: " + found.verdict.sentence())

    return act
