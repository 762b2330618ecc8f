"""The effects and the unknowns of a study, checked against its cable, its clamps and each other.

The name of an unknown is a key of `[cable]`, or "kind.parameter" of a declared effect; "kind[2].parameter" of the second one.
"""

from collections import Counter
from dataclasses import replace

import numpy as np

from scan2flex_jax.study import values as v
from scan2flex_jax.study.kinds import CABLE, INITIAL, KindFormat, ParameterFormat, kind_format, kind_names, split_name
from scan2flex_jax.study.model import EffectDeclaration, Study, Unknown
from scan2flex_jax.study.values import Where

_ROUNDING = 1e-9  # of a bound: tolerance for a start beyond it, since an estimate at its bound is rounded through a logarithm


def longest_cable(study: Study) -> float | None:
    """Largest possible length (m) of the cable: L, or the high end of its range with three sigma; None if unknown."""
    unknown = next((u for u in study.unknowns if u.name == "length"), None)
    if unknown is not None:
        return None if unknown.high is None else float(np.max(unknown.high))
    return float(np.max(study.cable["length"])) + 3 * study.tolerance.length if "length" in study.cable else None


def check_declared(study: Study, where: Where) -> None:
    """The effects and the unknowns fit the cable, its clamps and each other: names first, then values."""
    formats, unknown = unknown_formats(study), where.at("unknown")
    for name in study.unknown_names:
        check_name(name, study, unknown.at(name))
        if study.unknown_names.count(name) > 1:
            raise unknown.at(name).fail(f"{v.shown(name)} is declared twice: leave one out.")
        if "." in name and not study.effects_of(name):
            raise unknown.at(name).fail("every effect of this kind has an unknown of its own number: leave this name out.")
    _check_effects(study, where.at("effect"))
    for one in study.unknowns:
        _check_values(one, study, formats[one.name], unknown.at(one.name))


def _check_effects(study: Study, where: Where) -> None:
    """Every parameter is given or unknown, has its shape, and places lie on the cable."""
    longest, names = longest_cable(study), [pose.name for pose in study.poses]
    for i, effect in enumerate(study.effects):
        form, here = kind_format(effect.kind), where.item(i + 1)
        ends, points = len(study.clamped_ends), form.count(effect.parameters, here)
        if ends == 0 and any(parameter.per_end for parameter in form.parameters):
            raise here.fail(f"{form.kind} acts on clamps, and no pose has one: give a clamp its quaternion.")
        for parameter in form.parameters:
            name, key = parameter.name, here.at(parameter.name)
            if name in effect.parameters:
                parameter.take(effect.parameters[name], key, ends, longest, points)
            elif not parameter.optional and not study.unknown_of(i, name):
                asked = f', or declare unknown."{effect.kind}.{name}"' if parameter.estimable else ""
                raise key.fail(f"{effect.kind} needs its {name} ({parameter.unit}): give it{asked}.")
        size = float(np.linalg.norm(effect.parameters.get("coupling", 0.0)))
        if effect.kind == "bend_twist_coupling" and size >= 1:  # a singular or indefinite stiffness
            raise here.at("coupling").fail(f"got fractions of size {size:g}: give fractions whose squares sum below 1.")
        for name in effect.poses or ():
            v.known(name, names, here.at("poses"), "pose")
        if form.memory != "none":
            _check_memory(effect, form, study, here)


def _check_memory(effect: EffectDeclaration, form: KindFormat, study: Study, where: Where) -> None:
    """An effect with memory acts in all poses, and one that needs their times has them, in order."""
    if effect.poses is not None:
        said = f"{form.kind} acts from pose to pose: leave the key out, and mark a cable that was straightened by reset = true."
        raise where.at("poses").fail(said)
    if sum(other.kind == effect.kind for other in study.effects) > 1:
        raise where.fail(f"two effects are of kind {form.kind}: leave one of them out.")
    latest, last = -np.inf, ""
    for pose in study.poses if form.memory == "time" else ():
        if pose.time is None:
            said = f"{form.kind} needs the time of every pose, and pose {v.shown(pose.name)} has none: give its time (s)."
            raise where.fail(said)
        if pose.time < latest:
            said = f"pose {v.shown(pose.name)} has the time {pose.time:g} s, before that of pose {v.shown(last)}, {latest:g} s"
            raise where.fail(f"{said}: list the poses in the order in which they were measured.")
        latest, last = pose.time, pose.name
    first, unknown = next(iter(study.poses), None), f"{effect.kind}.{INITIAL}" in study.unknown_names
    if first is not None and first.reset and (unknown or np.any(effect.parameters.get(INITIAL, 0.0))):
        said = f"the cable was straightened before its first pose, {v.shown(first.name)}, and has no set"
        raise where.at(INITIAL).fail(f"{said}: leave {INITIAL} out, or the reset = true of this pose.")


def unknown_formats(study: Study) -> dict[str, ParameterFormat]:
    """Every name that may be an unknown of this study, with its format."""
    formats: dict[str, ParameterFormat] = {name: form for name, form in CABLE.items() if form.estimable}
    for kind, number in Counter(effect.kind for effect in study.effects).items():
        several = [f"{kind}[{n + 1}]" for n in range(number)] if number > 1 else []
        for parameter in (p for p in kind_format(kind).parameters if p.estimable):
            formats |= {f"{effect}.{parameter.name}": parameter for effect in (kind, *several)}
    return formats


def check_name(name: str, study: Study, where: Where) -> None:
    """Refuse a name that the study does not contain."""
    kind, formats = split_name(name)[0], unknown_formats(study)
    if name in formats:
        return
    if name in CABLE:
        raise where.fail(f"centre curves do not show the {name}: give it in [cable].")
    absent = kind in kind_names() and all(effect.kind != kind for effect in study.effects)
    needed = f"; an effect of kind {kind} must be declared first" if absent else ""
    raise where.fail(f"nothing is called {v.shown(name)}{needed}: {v.suggestion(name, formats)}")


def _check_values(unknown: Unknown, study: Study, form: ParameterFormat, where: Where) -> None:
    """Guess, range and prior have a shape and lie in the domain of the quantity, and the range contains the start."""
    shapes = form.bound_shapes(len(study.clamped_ends), study.places_of(unknown.name))
    low, high, prior = unknown.low, unknown.high, unknown.prior or {}
    bounds = replace(form, domain="any") if form.domain == "unit" else form
    given = {"guess": [unknown.guess], "range": [low, high], "prior.mean": [prior.get("mean")]}
    for name, value in ((name, value) for name, values in given.items() for value in values if value is not None):
        if (form.walk or form.smooth) and name != "guess":
            of = "law" if form.walk else "field"
            said = f"the points of a {of} follow one another by a smoothness prior of their own: leave it out."
            raise where.at(name.partition(".")[0]).fail(said)
        bounds.check(v.array(value, shapes, where.at(name)), where.at(name), longest_cable(study))
    if prior:
        std = where.at("prior.std")
        replace(form, domain="positive").check(v.array(prior["std"], shapes, std), std)
    if low is not None and high is not None and np.any(np.asarray(low) >= np.asarray(high)):
        said = f"got low {v.shown(v.plain(low))} and high {v.shown(v.plain(high))}"
        raise where.at("range").fail(f"{said}: give range = [low, high] with low below high.")
    start, place, name = study.start_value(unknown.name), where.at("guess"), unknown.name
    if unknown.guess is None and study.given(name) is None:
        place = where.at("prior.mean")
    elif unknown.guess is None:
        key = f"effect[{study.effects_of(name)[0] + 1}].{split_name(name)[2]}" if "." in name else f"cable.{name}"
        place = replace(where, key=key)
    for bound, sign, side in ((low, 1, "low"), (high, -1, "high")):
        if start is not None and bound is not None and np.any(sign * (np.asarray(start) - bound) < -_ROUNDING * np.abs(bound)):
            said = f"got {v.shown(v.plain(start))}, outside the range whose {side} end is {v.shown(v.plain(bound))}"
            raise place.fail(f"{said}: start inside it, or widen it.")
