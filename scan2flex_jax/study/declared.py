"""What a study declares beyond the plain rod, and what it asks for: `[[effect]]` and `[unknown]`.

The name of an unknown is a key of `[cable]`, or "kind.parameter" of a declared effect. TOML writes the latter as
`[unknown."point_mass.mass"]` or as the nested table `[unknown.point_mass.mass]`; both are read.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from scan2flex_jax.study import values as v
from scan2flex_jax.study.kinds import CABLE, DESCRIPTIVE_KINDS, KindFormat, ParameterFormat, kind_format, kind_names
from scan2flex_jax.study.model import EffectDeclaration, Study, Unknown, Value
from scan2flex_jax.study.sense import longest_cable
from scan2flex_jax.study.values import Where


def read_effects(study: Study, entries: Any, where: Where) -> Study:
    """The study with its `[[effect]]`; that no parameter is missing is known only with the unknowns."""
    effects = []
    for i, table in enumerate(v.tables(entries, where)):
        here = where.item(i + 1)
        form = _kind(v.text(v.required(table, "kind", here, 'kind = "point_mass"'), here.at("kind")), here.at("kind"))
        v.allow(table, ("kind", *form.names), here)
        ends = _ends(study, form, here)
        parameters = {
            p.name: v.quantity(table[p.name], p, here.at(p.name), ends) for p in form.parameters if p.name in table
        }
        _coupled(form, parameters, here)
        effects.append(EffectDeclaration(form.kind, parameters))
    return replace(study, effects=tuple(effects))


def _kind(kind: str, where: Where) -> KindFormat:
    if kind in DESCRIPTIVE_KINDS:
        raise where.fail(f"{kind} describes a residual and names nothing: declare a kind that can act.")
    if kind not in kind_names():
        raise where.fail(f"unknown kind {v.shown(kind)}: {v.suggestion(kind, kind_names())}")
    return kind_format(kind)


def _ends(study: Study, form: KindFormat, where: Where) -> int:
    """How many ends have a clamp, for a kind that needs one."""
    ends = len(study.clamped_ends)
    if ends == 0 and any(parameter.per_end for parameter in form.parameters):
        raise where.fail(f"{form.kind} acts on clamps, and no pose has one: give a clamp its quaternion.")
    return ends


def _coupled(form: KindFormat, parameters: dict[str, Value], where: Where) -> None:
    """Fractions of sqrt(EI GJ) whose squares sum to one or more leave a rod without resistance (isotropic EI)."""
    coupling = parameters.get("coupling")
    if form.kind == "bend_twist_coupling" and coupling is not None and float(np.sum(np.square(coupling))) >= 1:
        size = float(np.linalg.norm(coupling))
        raise where.at("coupling").fail(f"got fractions of size {size:g}: give fractions whose squares sum below 1.")


def unknown_formats(study: Study) -> dict[str, ParameterFormat]:
    """Every name that may stand under `[unknown]` in this study, with its format."""
    formats = {name: form for name, form in CABLE.items() if form.estimable}
    for effect in study.effects:
        for parameter in kind_format(effect.kind).parameters:
            formats[f"{effect.kind}.{parameter.name}"] = parameter
    return formats


def read_unknowns(study: Study, table: Any, where: Where) -> Study:
    """The study with what is to be estimated."""
    formats = unknown_formats(study)
    unknowns: dict[str, Unknown] = {}
    for name, body, here in _flat(v.sub_table(table, where, "[unknown.bending_stiffness]"), where):
        if name in unknowns:
            raise here.fail(f"{v.shown(name)} is declared twice: leave one out.")
        _known_name(name, study, formats, here)
        unknowns[name] = _unknown(name, body, formats[name], study, here)
    study = replace(study, unknowns=tuple(unknowns.values()))
    longest = longest_cable(study)
    for unknown in study.unknowns:
        _check_range(unknown, study, formats[unknown.name], longest, where.at(unknown.name))
    return study


def _flat(table: dict[str, Any], where: Where) -> Iterator[tuple[str, dict[str, Any], Where]]:
    """Name, body and place of each unknown, nested tables made flat."""
    example = "[unknown.bending_stiffness]"
    for name, entry in table.items():
        here = where.at(name)
        body = v.sub_table(entry, here, example)
        if any(isinstance(value, dict) for value in body.values()):
            for parameter, inner in body.items():
                yield f"{name}.{parameter}", v.sub_table(inner, here.at(parameter), example), here.at(parameter)
        else:
            yield name, body, here


def _known_name(name: str, study: Study, formats: dict[str, ParameterFormat], where: Where) -> None:
    """Refuse a name that nothing in the study has, or that two effects share."""
    kind = name.partition(".")[0]
    if name not in formats:
        if name in CABLE:
            raise where.fail(f"centre curves do not show the {name}: give it in [cable].")
        needed = f"; an effect of kind {kind} must be declared first" if "." in name and kind in kind_names() else ""
        raise where.fail(f"nothing is called {v.shown(name)}{needed}: {v.suggestion(name, formats)}")
    if "." in name and sum(effect.kind == kind for effect in study.effects) > 1:
        raise where.fail(f"two effects are of kind {kind}, so the name could mean either: leave one of them out.")


def _unknown(name: str, body: dict[str, Any], form: ParameterFormat, study: Study, where: Where) -> Unknown:
    """One `[unknown.NAME]`: guess and range by their shapes."""
    v.allow(body, ("guess", "range"), where)
    shapes = form.bound_shapes(len(study.clamped_ends))
    guess = v.array(body["guess"], shapes, where.at("guess")) if "guess" in body else None
    if "range" not in body:
        return Unknown(name, guess)
    here, bounds = where.at("range"), body["range"]
    if not isinstance(bounds, list) or len(bounds) != 2:
        raise here.fail(f"got {v.shown(bounds)}: write range = [low, high].")
    low, high = (v.array(bound, shapes, here) for bound in bounds)
    return Unknown(name, guess, low, high)


def _check_range(unknown: Unknown, study: Study, form: ParameterFormat, longest: float | None, where: Where) -> None:
    """The range is a range of values that the quantity may take, and the start lies in it."""
    domain = "any" if form.domain == "unit" else form.domain
    low, high, key = unknown.low, unknown.high, where.at("range")
    if unknown.guess is not None:
        v.check_domain(unknown.guess, domain, where.at("guess"), longest)
    if low is None or high is None:
        return
    v.check_domain(low, domain, key, longest)
    v.check_domain(high, domain, key, longest)
    start = study.start_value(unknown.name)
    place = where.at("guess") if unknown.guess is not None else replace(where, key=_given_key(unknown.name, study))
    if not _match(low, high) or (start is not None and not (_match(low, start) and _match(high, start))):
        raise key.fail("its shape does not match the value: write one number, or one for each entry, in both.")
    if np.any(np.asarray(low) >= np.asarray(high)):
        raise key.fail(f"got low {_plain(low)} and high {_plain(high)}: write range = [low, high] with low below high.")
    if start is not None and np.any((np.asarray(start) < low) | (np.asarray(start) > high)):
        bounds = f"{_plain(low)} to {_plain(high)}"
        raise place.fail(f"got {_plain(start)}, outside the range {bounds}: start inside it, or widen it.")


def _match(a: Value, b: Value) -> bool:
    """Whether two values stand for the same entries; one entry may stand for all."""
    try:
        np.broadcast_shapes(np.shape(a), np.shape(b))
    except ValueError:
        return False
    return True


def _plain(value: Value) -> str:
    return v.shown(np.asarray(value).tolist())


def _given_key(name: str, study: Study) -> str:
    """The key of a value given outside `[unknown]`."""
    kind, dot, parameter = name.partition(".")
    index = next((i for i, effect in enumerate(study.effects) if effect.kind == kind), 0)
    return f"effect[{index + 1}].{parameter}" if dot else f"cable.{name}"
