"""The input of every exporter: the cable's properties and its equilibrium in one pose, free of JAX.

For simulators made of rigid links, the links *begin and end between* our nodes: link ``k`` (0..n) is centred on node ``k`` and
joined to its neighbours half an element away. Then the first and the last link have exactly the orientations of the clamps,
each joint carries the stiffness of one element, and shapes agree to second order in the element length; with links from node
to node the clamps would be half an element off.

Every property of a study is exported or refused by name: each target lists which of `FEATURES` it supports,
`HungCable.require` refuses the others, and `HungCable.remarks` are the sentences that every file contains.
"""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from scan2flex_jax.effects.point_mass import PointMass
from scan2flex_jax.errors import Scan2FlexError

_SAME = 1e-9  # relative difference below which sections count as equal
_STRETCH = 1e-3  # largest strain of a pose for which a chain of rigid links may neglect stretch and shear
_SOFTEST = 1e-4  # of an assumed stiffness of stretch or shear that carries next to nothing
THIN = 5e-3  # of the length: radius where the study has none

STIFFNESS = "a stiffness that varies along the cable"
CURVED = "a natural curvature"
NATURAL = "a natural curvature that varies along the cable"
DENSITY = "a mass per length that varies along the cable"
BENDINGS = "two bending stiffnesses"
SHEARS = "two shear stiffnesses"
BEND_TWIST = "a coupling among bending and twist"
COUPLED = "a coupling of stretch or shear with other strains"
NATURAL_STRETCH = "natural stretch or shear"
GIVES = "stretch or shear of more than 0.1 %"
MASSES = "a point mass"
LAWS = frozenset({"nonlinear_bending", "bending_law", "torsion_law"})  # effect types whose moments `HungCable.laws` tabulates
DAHL = "dahl"  # effect type whose law Newton has
FEATURES = (STIFFNESS, CURVED, NATURAL, DENSITY, BENDINGS, SHEARS, BEND_TWIST, COUPLED, NATURAL_STRETCH, GIVES, MASSES)


@dataclass(frozen=True)
class HungCable:
    """A cable in one pose: ``stiffness`` (n, 6, 6) of shear, stretch, bending, twist (N, N m^2), ``natural`` strain (n, 6)
    (-, 1/m), ``density`` (n,) kg/m, nodes ``s`` (m), ``position`` (m) and ``rotation`` (columns d1, d2, d3), supports ``held``
    (2, 6), ``gravity`` m/s^2, ``radius`` (m, None where the study has none).

    ``masses``: ``(arc length m, kg)`` of point masses on the cable. ``beyond``: effect types that none of these fields
    represents. ``seen``: those of the scanner, which no simulator needs. ``assumed``: stiffnesses that the study omits.
    ``effects``: all acting effects, ``(effect type, parameters)``. ``strain``: bound of stretch and shear (-), 0 without a
    pose. ``sources``: effect types by the feature that they cause. ``laws``: "bending" and "twist" where they are not linear,
    strains (k,) in 1/m and moments (n, k) in N m.
    """

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
    masses: tuple[tuple[float, float], ...] = ()
    seen: tuple[str, ...] = ()
    effects: tuple[tuple[str, dict], ...] = ()
    strain: float = 0.0
    sources: dict[str, tuple[str, ...]] = field(default_factory=dict)
    laws: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)

    @property
    def elements(self) -> int:
        """Number of elements."""
        return len(self.density)

    @property
    def element_length(self) -> float:
        """Length of an element (m)."""
        return self.length / self.elements

    @property
    def drawn_radius(self) -> float:
        """Radius (m) for pictures, contact and rotational inertia; a default, named in `remarks`, if the study has none."""
        return THIN * self.length if self.radius is None else self.radius

    @property
    def softened(self) -> np.ndarray:
        """``stiffness`` with assumed entries as soft as a strain of 0.1 % in this pose allows: a stiffer one costs a simulator
        small steps, iterations or digits, and changes nothing that was measured. Without a pose: as they are."""
        if not self.strain:
            return self.stiffness
        soft = [("shear_stiffness" in self.assumed)] * 2 + ["axial_stiffness" in self.assumed] + [False] * 3
        scale = np.where(soft, np.sqrt(np.clip(self.strain / _STRETCH, _SOFTEST, 1.0)), 1.0)
        return self.stiffness * np.outer(scale, scale)

    @property
    def link_masses(self) -> np.ndarray:
        """Masses (n + 1,) of the links (kg), with point masses."""
        half = 0.5 * self.element_length * self.density
        return np.append(half, 0.0) + np.insert(half, 0, 0.0) + self.point_masses

    @property
    def point_masses(self) -> np.ndarray:
        """Point masses (kg) at the nodes (n + 1,), each split between the two nearest, so that moments are kept."""
        out = np.zeros(self.elements + 1)
        for place, mass in self.masses:
            k = int(np.clip(place / self.element_length, 0, self.elements - 1))
            part = place / self.element_length - k
            out[k : k + 2] += np.array([1.0 - part, part]) * mass
        return out

    @property
    def remarks(self) -> list[str]:
        """Sentences that a file must contain: assumptions, and omitted effects of the scanner."""
        out = []
        if self.radius is None:
            out.append(
                f"The study has no radius: {self.drawn_radius:.4g} m (0.5 % of the length) stands in for pictures, contact and "
                "rotational inertia; no stiffness depends on it."
            )
        if self.assumed:
            names = " and ".join(self.assumed)
            so = "with which it strains by 0.1 % in this pose" if self.strain else "that is next to rigid"
            out.append(f"The study has no {names}: a value is assumed {so}.")
        if self.seen:
            out.append(f"Left out: {', '.join(self.seen)}, an effect of the scanner and not of the cable.")
        return out

    @property
    def runs(self) -> list[slice]:
        """Neighbouring elements of equal sections, in order."""
        rows = np.column_stack([self.stiffness.reshape(self.elements, 36), self.density])
        same = np.all(np.abs(np.diff(rows, axis=0)) <= _SAME * np.max(np.abs(rows), axis=0), axis=1)
        ends = [0, *(np.flatnonzero(~same) + 1).tolist(), self.elements]
        return [slice(a, b) for a, b in pairwise(ends)]

    def require(self, simulator: str, holds: frozenset[str], *, ball_joints: bool = True) -> None:
        """Raises `Scan2FlexError` if the cable has an effect or a feature that the simulator does not support (``holds``)."""
        kept = {PointMass.kind, *({*LAWS, DAHL} & holds)}  # in `masses`, `laws` and `effects`
        if beyond := [kind for kind in self.beyond if kind not in kept]:
            raise Scan2FlexError(
                f"The export to {simulator} cannot represent {', '.join(beyond)}: leave it out of the study, or export to json."
            )
        if missing := [feature for feature in self.features() if feature not in holds]:
            brought = dict.fromkeys(kind for feature in missing for kind in self.sources.get(feature, ()))
            by = f" ({', '.join(brought)})" if brought else ""
            raise Scan2FlexError(f"The export to {simulator} cannot represent {missing[0]}{by}: export this cable to json.")
        loose = self.held.any(axis=1) & ~self.held.all(axis=1)
        if not self.held[0].any() or (loose.any() and not ball_joints):
            what = "a ball joint" if loose.any() else "no support at its start"
            raise Scan2FlexError(f"The export to {simulator} cannot represent {what} (pose {self.pose!r}): name another pose.")

    def features(self) -> tuple[str, ...]:
        """The `FEATURES` of the sections beyond a straight, uniform, isotropic rod."""
        found = features_of(self.stiffness, self.natural, self.density)
        beyond = {GIVES: self.strain > _STRETCH, MASSES: bool(self.masses)}
        return (*found, *(feature for feature, present in beyond.items() if present))


def printable(text: str) -> str:
    """A text in one line, for a comment or a name in a file."""
    return "".join(c if c.isprintable() else " " for c in text)[:2000]


def features_of(stiffness: np.ndarray, natural: np.ndarray, density: np.ndarray) -> tuple[str, ...]:
    """The features that sections (n, 6, 6), (n, 6), (n,) have, among `FEATURES`."""
    diagonal = np.diagonal(stiffness, axis1=1, axis2=2)
    scale = np.sqrt(diagonal)
    coupled = np.max(np.abs(stiffness / (scale[:, :, None] * scale[:, None, :]) - np.eye(6)), axis=0) > _SAME
    present = {
        STIFFNESS: _varies(stiffness),
        CURVED: bool(np.any(natural[:, 3:])),
        NATURAL: _varies(natural[:, 3:]),
        DENSITY: _varies(density),
        BENDINGS: _differ(diagonal[:, 3], diagonal[:, 4]),
        SHEARS: _differ(diagonal[:, 0], diagonal[:, 1]),
        BEND_TWIST: bool(np.any(coupled[3:, 3:])),
        COUPLED: bool(np.any(coupled[:3])),
        NATURAL_STRETCH: bool(np.any(natural[:, :3])),
    }
    return tuple(feature for feature in FEATURES if present.get(feature))


def _varies(values):
    return bool(np.max(np.abs(values - values[0]), initial=0.0) > _SAME * np.max(np.abs(values)))


def _differ(one, other):
    return bool(np.max(np.abs(one - other)) > _SAME * np.max(np.abs(one)))
