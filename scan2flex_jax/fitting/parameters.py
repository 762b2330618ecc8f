"""The parameter vector ``x``: the unknowns of a study, then nuisance parameters with their priors (length, gravity, clamps).

Unknowns come first (logarithms of positive ones), then, in units of their stated tolerance, the length, the tilt of gravity,
the mass per length, and per pose the positions and rotations of the clamps. These nuisance parameters have standard normal
priors, which `least_squares` adds to the cost. An unknown may have a prior too: normal, or log-normal if it is represented by
its logarithm.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.linalg import block_diag

from scan2flex_jax.effects import effect_of, ordered
from scan2flex_jax.errors import StudyError
from scan2flex_jax.geometry import lie
from scan2flex_jax.geometry.fields import middle_root
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.effect import AbstractEffect
from scan2flex_jax.rod.model import CableModel, with_rigid
from scan2flex_jax.rod.support import Guide
from scan2flex_jax.study.facts import measured_length
from scan2flex_jax.study.kinds import CABLE, ENDS, kind_format, split_name
from scan2flex_jax.study.model import Study, StudyPose, at_end
from scan2flex_jax.study.sense import check_study

# Default ranges of unknowns, wide enough for flexible components, in the unit of the parameter.
DEFAULT_RANGE = {
    "length": (1.0e-3, 1.0e4),
    "length_density": (1.0e-4, 1.0e3),
    "shear_stiffness": (1.0e-1, 1.0e9),
    "axial_stiffness": (1.0e-1, 1.0e9),
    "bending_stiffness": (1.0e-10, 1.0e6),
    "torsional_stiffness": (1.0e-10, 1.0e6),
    "natural_curvature": (-100.0, 100.0),
    "natural_stretch": (-0.5, 0.5),
}
LENGTH_RANGE = (0.5, 10.0)  # of the length that the shapes show: curves may stop short of a free end
_NO_PLACE = -1  # of an effect that a study does not declare
_ANY = {"positive": (1.0e-9, 1.0e9), "nonnegative": (0.0, 1.0e9), "fraction": (0.0, 0.99)}
CLAMP_MOTIONS = 12  # per pose: position and rotation of the start, then of the end


@dataclass(frozen=True)
class Slot:
    """One unknown: its place ``at`` in ``x``, its shape, whether ``x`` holds its logarithm, its range in the unit of ``x``, and
    the end (0 start, 1 end) of a parameter with a value per end in a study that clamps only one.

    ``walk``: ``x`` holds the increments of the logarithm from point to point of a law, from 0 before the first; a random walk.
    ``root``: ``x`` holds independent components of a smooth random field, which this matrix (rows) turns into its values.
    """

    name: str
    shape: tuple[int, ...]
    log: bool
    low: tuple[float, ...] = field(compare=False)  # compilation does not depend on the range
    high: tuple[float, ...] = field(compare=False)
    at: int
    unit: str
    end: int = 0
    prior: tuple[tuple[float, ...], tuple[float, ...]] | None = None  # mean and standard deviation in ``x``
    walk: bool = False
    root: tuple[tuple[float, ...], ...] = ()
    places: tuple[int, ...] = ()  # of its effects among those of the study; empty: all of their kind

    @property
    def size(self) -> int:
        """Number of entries."""
        return int(np.prod(self.shape, dtype=int))

    @property
    def scales(self) -> bool:
        """Whether each number is by itself the logarithm of a quantity."""
        return self.log and not self.walk

    @property
    def sums(self) -> np.ndarray:
        """Matrix from its numbers in ``x`` to quantities or their logarithms: root of a field, sums of a walk's steps, or the
        identity."""
        if self.root:
            return np.array(self.root)
        return np.tril(np.ones((self.size, self.size))) if self.walk else np.eye(self.size)

    def value(self, x):
        """The quantity, of numpy or traced numbers ``x`` of the slot."""
        logs = np.array(self.root) @ x if self.root else x.cumsum() if self.walk else x
        if not self.log:
            return logs.reshape(self.shape)
        return (np.exp(logs) if isinstance(x, np.ndarray) else jnp.exp(logs)).reshape(self.shape)

    def numbers(self, value: np.ndarray) -> np.ndarray:
        """The numbers in ``x`` of a quantity."""
        logs = np.log(np.ravel(value)) if self.log else np.ravel(value)
        if self.root:
            return np.linalg.solve(np.array(self.root), logs)
        return np.diff(logs, prepend=0.0) if self.walk else logs

    @property
    def labels(self) -> list[str]:
        """A name for each entry."""
        return [self.name] if not self.shape else [f"{self.name}[{i}]" for i in range(self.size)]


@dataclass(frozen=True)
class SharedPrior:
    """Normal priors of the shared entries ``at`` of ``x``: means and standard deviations."""

    at: np.ndarray
    mean: np.ndarray
    std: np.ndarray

    def pull(self, x):
        """Deviation of each from its mean, in standard deviations."""
        return (x[self.at] - self.mean) / self.std

    def precision(self, size: int) -> np.ndarray:
        """Precision of each of ``size`` entries; 0 for those without a prior."""
        out = np.zeros(size)
        out[self.at] = self.std**-2
        return out


@dataclass(frozen=True)
class Layout:
    """The structure of ``x``: slots of the unknowns, and tolerances (standard deviations) of the nuisance parameters.

    The scan frame is tilted about the two axes across gravity, or about three if poses differ in gravity. ``rigid``: the
    stiffnesses that the study omits.
    """

    slots: tuple[Slot, ...]
    length_tolerance: float
    gravity_tolerance: float
    position_tolerance: float
    rotation_tolerance: float
    roll_tolerance: float | None = None
    density_tolerance: float = 0.0
    gravity_axes: int = 2
    rigid: tuple[str, ...] = ()

    @property
    def unknowns(self) -> int:
        """Number of entries of the unknowns."""
        return sum(slot.size for slot in self.slots)

    @property
    def shared(self) -> int:
        """Number of entries that all poses share: unknowns, then shared nuisance parameters."""
        nearly = (self.length_tolerance > 0) + self.gravity_axes * (self.gravity_tolerance > 0) + (self.density_tolerance > 0)
        return self.unknowns + nearly

    @property
    def local(self) -> int:
        """Number of nuisance parameters of each pose."""
        tolerances = (self.position_tolerance, self.rotation_tolerance, self.roll_tolerance or 0.0)
        return CLAMP_MOTIONS if max(tolerances) > 0 else 0

    @cached_property
    def prior(self) -> "SharedPrior":
        """The priors of the shared entries."""
        rest = np.arange(self.unknowns, self.shared)
        at, mean, std = [rest], [np.zeros(len(rest))], [np.ones(len(rest))]
        for slot in reversed(self.slots):
            if slot.prior is not None:
                at.insert(0, np.arange(slot.at, slot.at + slot.size))
                mean.insert(0, np.array(slot.prior[0]))
                std.insert(0, np.array(slot.prior[1]))
        return SharedPrior(np.concatenate(at), np.concatenate(mean), np.concatenate(std))

    @property
    def has_priors(self) -> bool:
        """Whether a fit has priors in addition to the residuals."""
        return bool(len(self.prior.at)) or self.local > 0

    @property
    def sums(self) -> np.ndarray:
        """Matrix (b, b) from the unknown numbers of ``x`` to quantities or their logarithms."""
        return block_diag(*[slot.sums for slot in self.slots]) if self.slots else np.zeros((0, 0))

    @property
    def labels(self) -> list[str]:
        """A name for each entry of the unknowns."""
        return [label for slot in self.slots for label in slot.labels]

    @property
    def logs(self) -> np.ndarray:
        """Which of the unknown numbers are logarithms."""
        return np.array([slot.scales for slot in self.slots for _ in range(slot.size)], bool)

    @property
    def ranges(self) -> tuple[np.ndarray, np.ndarray]:
        """The lowest and the highest value of each of the unknown numbers."""
        return np.array([v for s in self.slots for v in s.low]), np.array([v for s in self.slots for v in s.high])


def layout_of(study) -> Layout:
    """The layout of a study's unknowns and tolerances."""
    slots, at = [], 0
    for unknown in study.unknowns:
        slot = _slot(study, unknown, at)
        slots.append(slot)
        at += slot.size
    t = study.tolerance
    length, density = (0.0 if n in study.unknown_names else getattr(t, n) for n in ("length", "length_density"))
    axes = 2 if all(pose.gravity is None for pose in study.poses) else 3
    clamps = t.clamp_position, t.clamp_rotation, t.clamp_roll
    return Layout(tuple(slots), length, t.gravity, *clamps, density, axes, study.assumed_rigid)


def _slot(study, unknown, at):
    form = _format(unknown.name)
    shape = _whole_shape(study, unknown.name, form)
    log = form.domain == "positive"
    default = DEFAULT_RANGE.get(unknown.name) or _ANY.get(form.domain, (-1e6, 1e6))
    if unknown.name == "length" and (shown := measured_length(study)) is not None:
        default = LENGTH_RANGE[0] * shown, LENGTH_RANGE[1] * shown
    if form.domain == "along_cable":
        default = (0.0, float(study.cable.get("length", 1e3)))
    low, high = (
        np.broadcast_to(np.asarray(d if u is None else u, float), shape)
        for u, d in zip((unknown.low, unknown.high), default, strict=True)
    )
    if log:
        low, high = np.log(low), np.log(high)
    end = ENDS.index(study.clamped_ends[0]) if study.clamped_ends else 0
    prior = None if unknown.prior is None else _prior_in_x(unknown.prior, shape, log)
    if form.walk:
        steps = int(np.prod(shape))
        prior = (0.0,) * steps, (form.walk / np.sqrt(steps),) * steps
    root: tuple[tuple[float, ...], ...] = ()
    if form.smooth:
        prior, root = ((0.0,) * len(low), (1.0,) * len(low)), _field_root(study, unknown.name, form.smooth)
    ends = tuple(low.ravel()), tuple(high.ravel())
    places = study.effects_of(unknown.name) if slot_of_some(study, unknown.name) else ()
    return Slot(unknown.name, shape, log, *ends, at, form.unit, end, prior, form.walk > 0, root, places)


def _whole_shape(study, name, form):
    """The shape of an unknown: the simplest, or that of its stated values; one number stands for all entries."""
    unknown = next(u for u in study.unknowns if u.name == name)
    said = [study.start_value(name), unknown.low, unknown.high, *(unknown.prior or {}).values()]
    shapes = form.shapes(len(study.clamped_ends), study.places_of(name))
    shape = np.broadcast_shapes(*(np.shape(v) for v in said if v is not None))
    return shape if shape in shapes else shapes[0]


def _field_root(study, name, size):
    """Root of the covariance of a smooth random field at its places, as a tuple of rows."""
    s = np.ravel(study.given(f"{split_name(name)[0]}.s"))
    length = study.cable.get("length") or study.start_value("length") or measured_length(study) or s[-1]
    return tuple(map(tuple, (size * middle_root(s / float(length))).tolist()))


def _prior_in_x(prior, shape, log):
    """Mean and standard deviation in ``x``: for a logarithm, those of the log-normal with the stated mean and deviation."""
    mean, std = (np.broadcast_to(np.asarray(prior[k], float), shape).ravel() for k in ("mean", "std"))
    if log:
        variance = np.log1p((std / mean) ** 2)
        mean, std = np.log(mean) - 0.5 * variance, np.sqrt(variance)
    return tuple(mean.tolist()), tuple(std.tolist())


def _format(name):
    kind, _, parameter = split_name(name)
    return kind_format(kind).parameter(parameter) if kind else CABLE[name]


def template(study, pose: StudyPose | None = None) -> CableModel:
    """The model of a pose, with every unknown at its stated value (or at a filler without one).

    Without ``pose``: the model of a pose that has no gravity and no effects of its own.
    """
    known = {key: value for key, value in study.cable.items() if key != "radius"}
    filler = {"length_density": 1.0, "bending_stiffness": 1.0, "torsional_stiffness": 1.0, "length": 1.0}
    cable = Cable(**{**filler, **known})
    effects, acting = [], study.acting(pose)
    places = [i for i, effect in enumerate(study.effects) if any(effect is one for one in acting)]
    for place in places:
        declaration = study.effects[place]
        form, given = kind_format(declaration.kind), dict(declaration.parameters)
        for parameter in form.parameters:
            name = study.unknown_of(place, parameter.name)
            if parameter.name not in given and name is not None:
                start, shape = study.start_value(name), _whole_shape(study, name, parameter)
                given[parameter.name] = np.broadcast_to(1e-3 if start is None else start, shape)
        effects.append(effect_of(declaration.kind, given, study.clamped_ends))
    in_order = ordered(effects)
    own = [next(p for p, e in zip(places, effects, strict=True) if e is one) for one in in_order]
    if pose is not None and any(guide_key(pose)):
        in_order, own = (*in_order, _guide(pose)), [*own, _NO_PLACE]
    some = any(slot_of_some(study, name) for name in study.unknown_names)
    ends = [_stays_at_end(study, place) for place in own]
    return CableModel(
        cable, jnp.asarray(study.gravity_in(pose)), in_order,
        places=list(map(float, own)) if some else None, at_end=ends if any(ends) else (),
    )  # fmt: skip


def guide_key(pose: StudyPose) -> tuple[bytes | None, ...]:
    """What distinguishes poses by their guided ends and hinges; None four times without any."""
    held = [x for clamp in (pose.start, pose.end) for x in ((None, None) if clamp is None else (clamp.free, clamp.hinge))]
    return tuple(None if x is None else x.tobytes() for x in held)


def _guide(pose):
    """What the guided ends and hinges of a pose hold."""
    ends = (pose.start, pose.end)
    across = [np.zeros((3, 3)) if clamp is None else clamp.across for clamp in ends]
    axes = [np.zeros(3) if clamp is None or clamp.hinge is None else clamp.hinge for clamp in ends]
    return Guide(jnp.asarray(np.array(across)), jnp.asarray(np.array(axes)))


def _stays_at_end(study, place):
    """Whether the effect at a place among those of a study was stated at the end of the cable."""
    if place == _NO_PLACE:
        return False
    effect = study.effects[place]
    name = kind_format(effect.kind).position
    given = name in effect.parameters and study.unknown_of(place, name) is None
    return given and at_end(effect.parameters[name], study.stated_length)


def with_ends(model: CableModel, more: Sequence[AbstractEffect] = ()) -> CableModel:
    """The model with the effects stated at the end of the cable there, at its length with all effects and ``more``."""
    cable = model.cable
    for effect in (*model.effects, *more):
        cable = effect.cable(cable)
    for i in (i for i, ends in enumerate(model.at_end) if ends):
        name = kind_format(model.effects[i].kind).position
        model = eqx.tree_at(partial(_parameter, i=i, name=name), model, cable.length)
    return model


def model_at(layout: Layout, model: CableModel, x) -> CableModel:
    """The template with the shared entries ``x`` inserted; differentiable in ``x``."""
    for slot in layout.slots:
        model = _put(model, slot, slot.value(x[slot.at : slot.at + slot.size]))
    at = layout.unknowns
    if layout.length_tolerance > 0:
        length = model.cable.length + layout.length_tolerance * x[at]
        model = eqx.tree_at(lambda m: m.cable.length, model, length)
        at += 1
    if layout.gravity_tolerance > 0:
        turn = _tilt(model.gravity, x[at : at + layout.gravity_axes])
        tilt = lie.so3_exp(layout.gravity_tolerance * turn)
        model = eqx.tree_at(lambda m: m.gravity, model, tilt @ model.gravity)
        at += layout.gravity_axes
    if layout.density_tolerance > 0:
        density = model.cable.length_density + layout.density_tolerance * x[at]
        model = eqx.tree_at(lambda m: m.cable.length_density, model, density)
    return with_rigid(with_ends(model), layout.rigid)


def _tilt(gravity, x):
    """The rotation vector of a tilt: across gravity if it has two entries."""
    if len(x) == 3:
        return x
    size = jnp.linalg.norm(gravity)
    down = gravity / jnp.where(size > 0, size, 1.0)
    across = jnp.linalg.svd(down[None, :])[2][1:]
    return x[0] * across[0] + x[1] * across[1]


def model_of(study: Study, pose: StudyPose | None = None) -> CableModel:
    """The model of a pose with every unknown at its value or guess.

    Args:
        study: One cable.
        pose: May have its own gravity, and effects that act in it only; default: a pose that has neither.

    Returns:
        Cable, gravity and effects, as `equilibrium` takes them.

    Raises:
        StudyError: An unknown has neither a value nor a guess.

    Examples:
        >>> from scan2flex_jax.examples import example_path
        >>> study = load_study(example_path("simulated-cable"))
        >>> known = replace(study, unknowns=(), cable={**study.cable, "bending_stiffness": 0.1, "torsional_stiffness": 0.25})
        >>> float(model_of(known).cable.length)
        1.0
    """
    check_study(study, "predict")
    for unknown in study.unknowns:
        if study.start_value(unknown.name) is None:
            where = (study.folder / "study.toml") if study.folder else "study"
            raise StudyError(
                where, f"unknown.{unknown.name}", "has no value to simulate with: give a guess, or fit the study first."
            )
    layout = layout_of(study)
    x = np.concatenate([start_vector(study, layout, {}), np.zeros(layout.shared - layout.unknowns)])
    return model_at(layout, template(study, pose), x)


def slot_of_some(study, name: str) -> bool:
    """Whether an unknown belongs to some of several effects of its kind."""
    kind = split_name(name)[0]
    return bool(kind) and len(study.effects_of(name)) < sum(effect.kind == kind for effect in study.effects)


def _put(model, slot, value):
    """The model with a value of a slot, in the effects that it belongs to; these may act in other poses only."""
    kind, _, parameter = split_name(slot.name)
    if not kind:
        name = slot.name
        return eqx.tree_at(lambda m: getattr(m.cable, name), model, jnp.broadcast_to(value, getattr(model.cable, name).shape))
    for i, effect in enumerate(model.effects):
        if effect.kind != kind:
            continue
        old = getattr(effect, parameter)
        if jnp.ndim(value) == jnp.ndim(old) and jnp.shape(value) != jnp.shape(old):  # one clamped end of two
            new = old.at[slot.end].set(value[0])
        else:
            new = jnp.broadcast_to(value, jnp.shape(old))
        if slot.places:
            new = jnp.where(jnp.any(model.places[i] == jnp.array(slot.places)), new, old)
        model = eqx.tree_at(partial(_parameter, i=i, name=parameter), model, new)
    return model


def _parameter(model, i, name):
    return getattr(model.effects[i], name)


def boundary_at(layout: Layout, boundary: Boundary, z) -> Boundary:
    """A pose's supports, displaced by its nuisance parameters ``z`` (empty if the layout has none)."""
    if not layout.local:
        return boundary
    z = z.reshape(2, 6) * jnp.any(boundary.held > 0, axis=1, keepdims=True)  # a guide holds more than its flags say
    if layout.roll_tolerance is None:
        turn = jax.vmap(lie.so3_exp)(layout.rotation_tolerance * z[:, 3:])
    else:  # roll first, then tilt: the tangent is independent of the roll
        tilt = jax.vmap(lie.so3_exp)(layout.rotation_tolerance * z[:, 3:].at[:, 2].set(0.0))
        turn = tilt @ jax.vmap(lie.so3_exp)(layout.roll_tolerance * z[:, 3:].at[:, :2].set(0.0))
    return Boundary(boundary.position + layout.position_tolerance * z[:, :3], boundary.rotation @ turn, boundary.held)


def start_vector(study, layout: Layout, own: Mapping[str, float | np.ndarray]) -> np.ndarray:
    """``x`` of the unknowns at the user's guess if there is one, else at the package's ``own`` start."""
    parts = []
    for slot in layout.slots:
        value = study.start_value(slot.name)
        if value is None:
            middle = np.exp(np.add(slot.low, slot.high) / 2) if slot.scales else np.full(slot.size, float(slot.walk))
            value = own.get(slot.name, np.reshape(middle, slot.shape))
        value = np.broadcast_to(np.asarray(value, float), slot.shape).ravel()
        if slot.log and np.any(value <= 0):
            raise StudyError(study.folder or "study", f"unknown.{slot.name}", "a positive quantity needs a positive start.")
        parts.append(np.clip(slot.numbers(value), slot.low, slot.high))
    return np.concatenate(parts) if parts else np.zeros(0)


def values_of(layout: Layout, x: np.ndarray) -> dict[str, np.ndarray]:
    """The unknowns in their own units, by name."""
    x = np.asarray(x)
    return {slot.name: np.asarray(slot.value(x[slot.at : slot.at + slot.size])) for slot in layout.slots}
