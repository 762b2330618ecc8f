"""A JSON schema of `study.toml`, with which an editor completes its keys, shows their units and marks what the reader refuses.

It is derived from the declaration of the format (`kinds`), and never stricter than the reader, which alone checks what needs
several parts of a study at once. Draft 7, the newest that taplo reads (Even Better TOML).
"""

import re
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from scan2flex_jax.study.kinds import CABLE, KEYS, ParameterFormat, Schema, kind_format, kind_names
from scan2flex_jax.study.read import FORMAT, SHARE

_ANY_COUNT = -1  # in a shape: the points of a field
_SHARE_OF_LENGTH: Schema = {"type": "string", "pattern": f"^{SHARE.pattern}$"}
_SECTION = "CSV with s (m) and stiffness, mass per length or diameters along the cable. Left out: the same sections everywhere."


def study_schema() -> Schema:
    """The JSON schema (draft 7) of `study.toml`, with the effect types that are registered.

    Examples:
        >>> study_schema()["properties"]["cable"]["properties"]["length"]["description"]
        'L, between the clamps along the cable (m). Left out: required, here or unknown.'
    """
    readings = {name: {"type": "array", "items": _table(name)} for name in ("angle", "wrench")}
    pose = _table("pose", start=_table("clamp"), end=_table("clamp"), **readings)
    parts = {name: _table(name) for name in ("cable", "tolerance")}
    parts["cable"]["properties"]["section"] = {**KEYS["pose"]["scan"].schema(), "description": _SECTION}
    parts |= {"pose": {"type": "array", "items": pose}, "effect": _effects(), "unknown": _unknowns()}
    study = _table("study", format={"const": FORMAT}, **parts)
    head = {"$schema": "http://json-schema.org/draft-07/schema#", "title": "study.toml of scan2flex"}
    return {**head, **study, "definitions": {kind: _unknowns_of(kind) for kind in kind_names()}}


def _table(name: str, **parts: Schema) -> Schema:
    """The schema of a table of the format; ``parts``: those of keys that are tables themselves."""
    keys = KEYS[name]
    properties = {key.name: _described(parts.get(key.name) or key.schema(), key) for key in keys.values()}
    return _object(properties, [key.name for key in keys.values() if key.required])


def _object(properties: Schema, required: Iterable[str] = (), **more: Any) -> Schema:
    return {"type": "object", "properties": properties, "required": list(required), **more, "additionalProperties": False}


def _described(schema: Schema, key: ParameterFormat) -> Schema:
    """The schema with the meaning of a key, its unit and its default, without the links of the page."""
    unit = "" if key.unit == "-" else f" ({key.unit})"
    said = f"{key.words}{unit}. " + ("Required." if key.default == "required" else f"Left out: {key.default}.")
    return {**schema, "description": re.sub(r"\[([^]]+)\]\([^)]+\)", r"\1", said)}


def _unknowns() -> Schema:
    """`[unknown]`: names of `[cable]`, and parameters of effects as "kind.parameter", "kind[2].parameter" or nested tables."""
    names = {name: _unknown(form) for name, form in CABLE.items() if form.estimable}
    patterns = {}
    for kind in kind_names():
        nested = {"$ref": f"#/definitions/{kind}"}
        for name in _unknowns_of(kind)["properties"]:
            patterns[rf"^{kind}(\[[1-9][0-9]*\])?\.{name}$"] = {"$ref": f"#/definitions/{kind}/properties/{name}"}
        patterns[rf"^{kind}\[[1-9][0-9]*\]$"] = nested
        names[kind] = {"anyOf": [names[kind], nested]} if kind in names else nested
    return _object(names, patternProperties=patterns)


def _unknowns_of(kind: str) -> Schema:
    """The tables of the unknown parameters of an effect type, below one of its name."""
    return _object({p.name: _unknown(p) for p in kind_format(kind).parameters if p.estimable}, minProperties=1)


def _unknown(form: ParameterFormat) -> Schema:
    """The table of an unknown: its values lie in the domain of its quantity."""
    shapes = form.bound_shapes(1, _ANY_COUNT)
    value, spread = form.schema(shapes), replace(form, domain="positive").schema(shapes)
    parts = {"guess": value}
    if not (form.walk or form.smooth):
        prior = {"mean": value, "std": spread}
        parts["range"] = {"type": "array", "items": value, "minItems": 2, "maxItems": 2}
        parts["prior"] = _object({k: _described(s, KEYS["unknown"][f"prior.{k}"]) for k, s in prior.items()}, prior)
    said = {name: replace(KEYS["unknown"][name], unit=form.unit) for name in parts}
    return _object({name: _described(schema, said[name]) for name, schema in parts.items()})


def _effects() -> Schema:
    """`[[effect]]`: the names of all parameters, and for each effect type which of them it has.

    The conditions stand beside the items, since taplo completes no key of a table that has an ``allOf`` of its own."""
    forms = [kind_format(kind) for kind in kind_names()]
    units: dict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    for form in forms:
        for parameter in form.parameters:
            units[parameter.name][parameter.unit].append(form.kind)
    item = _table("effect", kind={"enum": [form.kind for form in forms]})
    del item["additionalProperties"]  # the conditions say it
    for name, by_unit in units.items():
        said = "; ".join(f"{unit} (of {', '.join(kinds)})" for unit, kinds in by_unit.items())
        item["properties"][name] = {"description": said}
    each = []
    for form in forms:
        own = {p.name: {**p.schema(p.shapes(1, _ANY_COUNT)), "description": p.unit} for p in form.parameters}
        if form.position is not None:
            said = "m, or per cent of the length"
            own[form.position] = {"anyOf": [own[form.position], _SHARE_OF_LENGTH], "description": said}
        needed = [p.name for p in form.parameters if not p.estimable and not p.optional]
        then = {**_object({"kind": True, "poses": True, **own}, needed), "description": form.words}
        each.append({"items": {"if": {"properties": {"kind": {"const": form.kind}}, "required": ["kind"]}, "then": then}})
    return {"type": "array", "items": item, "allOf": each}
