"""What every export writes: the cable's numbers and how it hangs in one pose, free of JAX.

Simulators made of rigid links see a rod whose links *begin and end between* our nodes: link ``k`` (0..n) is centred on node
``k``, its neighbours are joined half an element away. Then the first and the last link have exactly the orientations of the
clamps, the joints carry the stiffness over one element each, and shapes agree to second order in the element length; with
links from node to node the clamps would be half an element off.
"""

from dataclasses import dataclass

import numpy as np

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting.parameters import model_of
from scan2flex_jax.prediction import settled
from scan2flex_jax.rod.effect import overriding
from scan2flex_jax.rod.loads import distributed_load
from scan2flex_jax.statics.solve import Equilibrium
from scan2flex_jax.study.model import Study

THIN = 5e-3
"""Of the length: the radius that simulators are given where the study has none."""
_SAME = 1e-9  # part by which sections may differ and still be one cable's


@dataclass(frozen=True)
class HungCable:
    """A cable in one pose: ``stiffness`` (n, 6, 6) of shear, stretch, bending, twist (N, N m^2), ``natural`` strain (n, 6)
    (-, 1/m), ``density`` (n,) kg/m, nodes ``s`` (m), ``position`` (m) and ``rotation`` (columns d1, d2, d3), supports ``held``
    (2, 6), ``gravity`` m/s^2, ``radius`` (m, None where the study has none); ``assumed``: the stiffnesses that the study
    leaves out."""

    title: str
    pose: str
    length: float
    gravity: np.ndarray
    radius: float | None
    stiffness: np.ndarray
    natural: np.ndarray
    density: np.ndarray
    s: np.ndarray
    position: np.ndarray
    rotation: np.ndarray
    held: np.ndarray
    beyond: tuple[str, ...]
    assumed: tuple[str, ...] = ()

    @property
    def drawn_radius(self) -> float:
        """The radius (m) of the study; where it has none, a thin one that only pictures and rotational inertia know."""
        return THIN * self.length if self.radius is None else self.radius

    @property
    def elements(self) -> int:
        """Number of elements."""
        return len(self.density)

    def uniform(self, simulator: str) -> tuple[np.ndarray, np.ndarray, float]:
        """``(stiffness (6,), natural (6,), density)`` of a cable that is alike along s with no couplings.

        Raises `Scan2FlexError` for what a simulator of such cables cannot represent.
        """
        if self.beyond:
            raise Scan2FlexError(
                f"{simulator} has no {', '.join(self.beyond)}: leave the effect out of the study, or export to json."
            )
        K, scale = self.stiffness[0], np.sqrt(np.diag(self.stiffness[0]))
        coupled = np.max(np.abs(K - np.diag(np.diag(K))) / np.outer(scale, scale)) > _SAME
        varied = [
            np.max(np.abs(a - a[0]), initial=0.0) > _SAME * np.max(np.abs(a))
            for a in (self.stiffness, self.natural, self.density)
        ]
        if coupled or any(varied):
            what = "couples its strains" if coupled else "varies along its length"
            raise Scan2FlexError(f"this cable {what}, which the export to {simulator} does not know: export to json.")
        if not np.all(self.held[0] == 1) or np.any(self.held[1] != self.held[1, 0]):
            raise Scan2FlexError(
                f"pose {self.pose!r} has a ball joint, which the export to {simulator} does not know: name another."
            )
        return np.diag(K), self.natural[0], float(self.density[0])


def hung(study: Study, pose: str | None = None, elements: int = 40) -> HungCable:
    """The cable of a study whose parameters are all known, hanging in one pose; raises `Scan2FlexError`."""
    chosen = study.poses[0] if pose is None else study.pose(pose)
    model = model_of(study, chosen)
    e = settled(study, chosen, model, elements)
    if not bool(e.verdict.solved):
        raise Scan2FlexError(f"pose {chosen.name!r} could not be solved ({e.verdict.sentence()}): export another pose.")
    section, radius = e.rod.section, study.cable.get("radius")
    r, R = map(np.asarray, e.configuration)
    K, natural, density = map(np.asarray, (section.stiffness, section.natural, section.density))
    return HungCable(
        study.title, chosen.name, float(e.rod.length), np.asarray(model.gravity), None if radius is None else float(radius),
        K, natural, density, np.asarray(e.s), r, R, np.asarray(e.rod.boundary.held), _beyond(e, model),
        study.assumed_rigid,
    )  # fmt: skip


def _beyond(e: Equilibrium, model) -> tuple[str, ...]:
    """Effects that are neither in the sections, nor in the supports, nor in what the scanner sees."""
    own = [*overriding(model.effects, "strain_energy"), *overriding(model.effects, "node_potential")]
    plain = distributed_load(e.rod.section, e.rod.section.density[:, None] * model.gravity)
    if np.max(np.abs(plain.force - e.rod.load.force)) > _SAME * (np.max(np.abs(plain.force)) + 1e-300):
        own += overriding(model.effects, "dead_load")
    return tuple(dict.fromkeys(effect.kind for effect in own))
