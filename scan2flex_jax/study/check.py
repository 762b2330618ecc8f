"""Summary of a study before any fit: known and unknown parameters, the ends of each curve at its clamps, warnings.

Every number is computed from the study. A warning never stops anything: it informs a reader of the result,
in one sentence.
"""

from collections.abc import Mapping
from typing import Annotated

import numpy as np

from scan2flex_jax.study.curve_warnings import PLANE_LIMIT, curve_warnings, mm
from scan2flex_jax.study.declared import unknown_formats
from scan2flex_jax.study.facts import EndFacts, all_plane, measured_length, pose_facts
from scan2flex_jax.study.kinds import CABLE, TOLERANCE, kind_format
from scan2flex_jax.study.mistakes import far_neighbours
from scan2flex_jax.study.model import Angle, Clamp, Study, StudyPose, Value, Wrench, scan_name
from scan2flex_jax.study.repeats import repeats
from scan2flex_jax.study.sense import knows_a_force, looks_like
from scan2flex_jax.study.values import one_line
from scan2flex_jax.study.visible import carried, scale_between, visible_mistakes

HEAVY = 50.0  # kg/m: beyond the heaviest cables that are laid by hand
DENSE = 20000.0  # kg/m^3: above the density of every cable material
LIGHT = 1e-6  # kg/m: a human hair weighs 5e-6
LOOSE = 50.0  # kg/m^3: foams are denser
LONG = 100.0  # m: a longer cable is in another unit, unless it hangs between ball joints and its shapes are as long
SHOWN = 0.5  # of the length: shapes that are longer confirm its unit
GRAVITY = 9.81  # m/s^2; on Earth gravity stays within 0.5 % of it
NO_VALIDATE = (
    'no validate pose: nothing will tell whether the estimates hold for another shape; give one pose role = "validate".'
)

_VAGUE = 45.0  # deg: a tangent known to no better than this points anywhere
_CLAMPED = ("clamp_position", "clamp_rotation")
_MEASURED = ("length", "length_density")  # cable inputs that may have a tolerance and that influence every stiffness


def describe(study: Study, scans: Mapping[str, tuple[int, Annotated[np.ndarray, "3"]]] | None = None) -> str:
    """Summary of a study as text for a terminal.

    ``scans``: by pose, the number of points of its scan and the extents (3,) of their box in m, from `scan_facts`."""
    parts = [f"Study    {one_line(study.title, 200) or '(no title)'}"]
    parts += [] if study.folder is None else [f"Folder   {study.folder}"]
    parts += [f"Gravity  {_text(study.gravity)} m/s^2 (size {float(np.linalg.norm(study.gravity)):.4g})"]
    known = [(key, value, CABLE[key].unit) for key, value in study.cable.items() if key not in study.unknown_names]
    nearly = [(key, value, TOLERANCE[key].unit) for key, value in study.tolerance.given.items()]
    sections: dict[str, list[str]] = {
        "Given": [f"  {key:<24} {_text(value)} {unit}" for key, value, unit in known] or ["  nothing"],
        "Assumed": [f"  {sentence}" for sentence in assumptions(study)],
        "To estimate": _unknowns(study) or ["  nothing"],
        "Tolerances (standard deviations)": [f"  {key:<24} {_text(value)} {unit}" for key, value, unit in nearly] or ["  none"],
    }
    sections |= {"Declared effects": _effects(study)} if study.effects else {}
    repeated = {name: [other for other in group if other != name] for group in repeats(study) for name in group}
    poses = [line for p in study.poses for line in ("", *_pose(study, p, (scans or {}).get(p.name), repeated.get(p.name, [])))]
    sections[f"Poses: {len(study.fit_poses)} to fit, {len(study.validate_poses)} to validate"] = poses
    warnings = study_warnings(study)
    sections["Warnings" if warnings else "No warnings"] = [f"  - {warning}" for warning in warnings]
    for title, lines in sections.items():
        parts += ["", title, *lines]
    return "\n".join(parts) + "\n"


def assumptions(study: Study) -> tuple[str, ...]:
    """Assumptions of a fit about inputs that the study does not state, in words."""
    said = list(study.assumptions)
    named = {*study.cable, *(name.split(".")[-1] for name in study.unknown_names)}
    if not {"natural_curvature", "curvature"} & named.union(*(effect.parameters for effect in study.effects)):
        said.append("natural_curvature left out: the cable is assumed straight when nothing bends it")
    exact = [name for name in _MEASURED if study.known(name) is not None and not getattr(study.tolerance, name)]
    exact += [name for name in _CLAMPED if not getattr(study.tolerance, name)]
    if exact:
        said.append(f"taken as exact in the intervals: {', '.join(exact)} (give their errors under [tolerance])")
    if silent := [pose.name for pose in study.poses if pose.seen and pose.noise is None]:
        who = "every pose" if len(silent) == len(study.poses) else ", ".join(map(one_line, silent))
        said.append(f"noise of {who} not stated: it is estimated from the residuals")
    return tuple(said)


def _text(value: Value) -> str:
    return f"{float(value):.6g}" if np.ndim(value) == 0 else f"[{', '.join(map(_text, np.asarray(value)))}]"


def _unknowns(study: Study) -> list[str]:
    lines, formats = [], unknown_formats(study)
    for unknown in study.unknowns:
        start = study.start_value(unknown.name)
        said = [formats[unknown.name].unit, "start computed by the fit" if start is None else f"start {_text(start)}"]
        low, high, prior = unknown.low, unknown.high, unknown.prior
        said.append("default range" if low is None or high is None else f"range {_text(low)} to {_text(high)}")
        said += [] if prior is None else [f"measured elsewhere as {_text(prior['mean'])} +- {_text(prior['std'])}"]
        lines.append(f"  {unknown.name:<24} {'; '.join(said)}")
    return lines


def _effects(study: Study) -> list[str]:
    lines = []
    for i, effect in enumerate(study.effects):
        form = kind_format(effect.kind)
        said = [f"{p.name} {_text(effect.parameters[p.name])} {p.unit}" for p in form.parameters if p.name in effect.parameters]
        said += [f"{name} to be estimated" for name in form.names if study.unknown_of(i, name)]
        where = "" if effect.poses is None else f"; in {', '.join(map(one_line, effect.poses))} only"
        lines.append(f"  {effect.kind} (on the {form.place}; {form.words}): {', '.join(said)}{where}")
    return lines


def _held(clamp: Clamp | None) -> str:
    if clamp is None or clamp.quaternion is None:
        return "free" if clamp is None else "ball joint"
    along = "" if clamp.free is None else f" free along {' and '.join(map(_text, clamp.free))}"
    return f"clamp{along}" if clamp.hinge is None else f"hinge about {_text(clamp.hinge)}"


def _pose(study: Study, pose: StudyPose, scan: tuple[int, Annotated[np.ndarray, "3"]] | None, repeated: list[str]) -> list[str]:
    held = f"start {_held(pose.start)}, end {_held(pose.end)}"
    if pose.start is not None and pose.end is not None:
        held += f", {np.linalg.norm(pose.end.position - pose.start.position):.4g} m apart"
    said = {"held": f"{held}; turns {pose.turns}"}
    if (facts := pose_facts(pose)) is not None:
        length = None if "length" not in study.cable else float(np.max(study.cable["length"]))
        ratio = "" if length is None else f" ({facts.arc_length / length:.4f} of the length)"
        said["curve"] = f"{facts.points} points, arc length {facts.arc_length:.4g} m{ratio}"
        said |= {f"at {name}": _end(one) for name, one in (("start", facts.start), ("end", facts.end)) if one is not None}
        if facts.end is None and length is not None:
            said["at end"] = f"stops {mm(length - facts.covered)} short of the free end"
    if pose.markers is not None:
        s, some = pose.markers.arc_length, pose.markers.measured
        alone = "" if some == "xyz" else f" ({', '.join(some)} alone)"
        at = ", ".join(f"{x:.4g}" for x in s[:6]) + ", ..." * (len(s) > 6)
        aside = "" if pose.markers.offset is None else ", beside the axis"
        said["markers"] = f"{len(s)}{alone}, at s = {at} m{aside}"
    said |= {"angles": "; ".join(map(_angle, pose.angle))} if pose.angle else {}
    said |= {"wrench": "; ".join(map(_wrench, pose.wrench))} if pose.wrench else {}
    said |= {"changes": f"readings are changes from {one_line(pose.change_from)}"} if pose.change_from is not None else {}
    if study.only_compared(pose):
        said["compared"] = "not measured: readings of other poses are changes from its equilibrium"
    if pose.scan is not None:
        guides = "none" if pose.guide_points is None else str(len(pose.guide_points))
        points = "" if scan is None else f", {_scan(study, scan)}"
        said["scan"] = f"{scan_name(study, pose)}{points}, guide points {guides}"
    if pose.seen:
        said["noise"] = "not stated" if pose.noise is None else f"{mm(pose.noise)} stated"
    said |= {"repeats": ", ".join(map(one_line, repeated))} if repeated else {}
    said |= {} if pose.gravity is None else {"gravity": f"{_text(pose.gravity)} m/s^2 in this pose"}
    said |= {} if pose.time is None else {"measured": f"at {pose.time:.6g} s"}
    said |= {"before": "the cable was taken out and straightened"} if pose.reset else {}
    return [f"  {one_line(pose.name)} ({pose.role})", *(f"    {name:<11} {words}" for name, words in said.items())]


def _angle(one: Angle) -> str:
    return f"{one.value:.4g} +- {one.noise:.2g} rad of {one.of} at s = {one.s:.4g} m about {_text(one.about)}"


def _wrench(one: Wrench) -> str:
    each = (f"{_text(x)} +- {sd:.2g} {unit}" for (_, x, sd), unit in zip(one.each, ("N", "N m"), strict=True) if x is not None)
    return f"{' and '.join(each)} of the {one.end} on the cable, in the axes of the {one.frame}"


def _scan(study: Study, scan: tuple[int, Annotated[np.ndarray, "3"]]) -> str:
    count, size = scan
    unit = None if study.length is None else looks_like(float(np.max(size)) / study.length)
    box = f"{count} points in a box of {' x '.join(f'{x:.3g}' for x in size)} m"
    if unit is None:
        return box
    return f"{box}: it looks like {unit[0]}, and must be in metres (new --units {'mm' if unit[1] == 1000 else 'cm'})"


def _end(end: EndFacts) -> str:
    gap = f"{mm(end.gap)} from the clamp"
    if end.angle is None or end.angle_sd is None:
        return gap
    half = 1.96 * end.angle_sd
    if half > _VAGUE:
        return f"{gap}; its points do not show its direction there"
    low, high = max(end.angle - half, 0.0), end.angle + half
    return f"{gap}; tangent {end.angle:.1f} deg [{low:.1f}, {high:.1f}] from the clamp's axis d3"


def study_warnings(study: Study) -> list[str]:
    """Warnings about a study, one sentence each, likely mistakes first; empty without any."""
    mistakes = visible_mistakes(study)
    warnings = [f"{mistake}." for mistake in mistakes]
    scale = None if warnings else scale_between(study)
    warnings += [] if scale is None else [f"{scale}."]
    warnings += _of_study(study)
    mended = mistakes[-1].study if mistakes else study  # a mistake is the reason for what its correction mends
    facts = {pose.name: one for pose in mended.poses if (one := pose_facts(pose)) is not None}
    warnings += curve_warnings(mended, facts)
    measured = len(facts) == len(study.poses)
    for pose in () if mistakes else study.poses:
        if pose.markers is not None and len(far := far_neighbours(study, pose)):
            i = int(far[0])
            step, along = (np.diff(x[i : i + 2], axis=0) for x in (pose.markers.points, pose.markers.arc_length))
            off = mm(float(np.linalg.norm(np.nan_to_num(step))))
            said = f"markers {i + 1} and {i + 2} are {off} apart, and only {mm(float(along[0]))} along the cable"
            warnings.append(f"{one_line(pose.name)}: {said}: correct their s, or their names in the tracking.")
    if carried(study):
        level = "every curve lies level, across gravity: something seems to carry the cable"
        warnings.append(f"{level}; if it lies on a table, declare the effect support_plane.")
    if measured and all_plane(study, list(facts.values()), PLANE_LIMIT * max(f.covered for f in facts.values())):
        sideways = "torsional stiffness, and natural curvature or stiffness out of that plane, cannot show"
        warnings.append(f"all poses are plane: {sideways}; add a pose that is twisted or bent out of the plane.")
    return warnings


def _of_study(study: Study) -> list[str]:
    """Warnings that concern no single pose."""
    warnings = [] if study.validate_poses else [NO_VALIDATE]
    if len(study.fit_poses) == 1 and len(study.unknowns) > 1:
        warnings.append(f"one fit pose for {len(study.unknowns)} unknowns: add poses that differ.")
    warnings += unit_warnings(study)
    scales = {"length_density", "bending_stiffness", "torsional_stiffness"}
    measured = any(unknown.prior is not None for unknown in study.unknowns if unknown.name in scales)
    if scales <= set(study.unknown_names) and not measured and not knows_a_force(study):
        warnings.append("the density and both stiffnesses are unknown: shapes tell only their ratios.")
    twice = [name for name in _MEASURED if getattr(study.tolerance, name) and name in study.unknown_names]
    return warnings + [f"{name} stands under [tolerance] and under [unknown]: one of them is enough." for name in twice]


def unit_warnings(study: Study) -> list[str]:
    """Numbers outside the range of cables on Earth. A fit may not notice them, since shapes depend on ratios of forces."""
    own = {f"{one_line(pose.name)}: ": pose.gravity for pose in study.poses if pose.gravity is not None}
    sizes = {of: float(np.linalg.norm(gravity)) for of, gravity in {"": study.gravity, **own}.items()}
    odd = {of: size for of, size in sizes.items() if size and abs(size - GRAVITY) > 0.01 * GRAVITY}  # none at all may be meant
    warnings = [f"{of}gravity is {size:.4g} m/s^2, not {GRAVITY}: check its unit." for of, size in odd.items()]
    length, shown = float(np.max(study.cable.get("length", 0.0))), 0.0 if study.clamped_ends else measured_length(study) or 0.0
    if length > max(LONG, shown / SHOWN):
        warnings.append(f"the cable is {length:.4g} m long: write lengths in metres.")
    density, radius = study.known("length_density"), study.known("radius")
    if density is None or not any(np.any(study.gravity_in(pose)) for pose in study.poses):
        return warnings
    area = None if radius is None else np.pi * float(np.max(radius)) ** 2
    most, least = (HEAVY, LIGHT) if area is None else (min(HEAVY, DENSE * area), LOOSE * area)
    weight = float(np.max(density))
    if not least <= weight <= most:
        other = f"{weight / 1000:.4g} kg/m if it was written in g/m" if weight > most else f"{1000 * weight:.4g} kg/m if in t/m"
        warnings.append(f"the cable weighs {weight:.4g} kg/m: check the unit, it is kg/m ({other}).")
    return warnings
