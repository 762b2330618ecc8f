"""What laboratories print of a history-dependent cable: its stiffness while it sticks and slips, and the energy of a cycle.

Of friction, with ``B`` (N m^2) the stiffness before anything slips, EI or GJ:

*stick stiffness*  ``B``;
*slip stiffness*  ``(1 - share) B``;
*critical strain*  the curvature or twist (1/m) at which the line of the stick stiffness meets the asymptote of slip;
*first cycle*  work per length (J/m) that a new, straight cable takes up to ``most``, back to ``-most`` and to zero;
*following cycles*  the area (J/m) of the steady loop between ``most`` and ``-most``.

``most`` (1/m) is the largest strain of the fitted poses. On a way without a turn the work is a difference of the energy whose
slope is the moment (`rod.memory`), so no quadrature is needed. Of relaxation, a standard linear solid: the stiffness that stays
(``K_inf``), that which creeps away (``K_1``), and the time ``tau`` in which it does.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects import Dahl, Friction, Relaxation, TorsionFriction
from scan2flex_jax.rod.energy import excess_strains
from scan2flex_jax.rod.memory import AbstractMemory, memories
from scan2flex_jax.rod.model import Configuration, Rod

_STEADY = 20  # cycles after which a loop repeats itself: Dahl's state nears its limit by exp(-4 most/slip) in each
_NONE = 1e-9  # of the largest strain: one that is zero but for rounding, as the twist of a plane cable
_BENDING, _TWIST = ("bending", 4), ("twist", 5)
_ACTS = {Friction: (_BENDING,), TorsionFriction: (_TWIST,), Dahl: (_BENDING, _TWIST), Relaxation: (_BENDING, _TWIST)}


@dataclass(frozen=True)
class Loop:
    """What is read off one effect with memory in "bending" or "twist": ``values`` by name, ``(number, unit)`` each."""

    kind: str
    of: str
    values: dict[str, tuple[float, str]]

    def sentences(self) -> tuple[str, ...]:
        """The values in words."""
        said = (f"{name} {value:.3g} {unit}" for name, (value, unit) in self.values.items())
        return (f"{self.kind}, {self.of}: {', '.join(said)}",)

    def to_json(self) -> dict:
        """The values with their units."""
        values = {name.replace(" ", "_"): {"value": value, "unit": unit} for name, (value, unit) in self.values.items()}
        return {"kind": self.kind, "of": self.of, "values": values}


def loops_of(poses: Sequence[tuple[Rod, Configuration]]) -> tuple[Loop, ...]:
    """What is read off the effects with memory of these rods in their equilibria."""
    effects = memories(poses[0][0].effects) if poses else ()
    acting = [e for e in effects if type(e) in _ACTS]
    if not acting:
        return ()
    excess = np.concatenate([np.asarray(excess_strains(rod, c)) for rod, c in poses])
    most = {4: float(np.nanmax(np.linalg.norm(excess[:, 3:5], axis=1))), 5: float(np.nanmax(np.abs(excess[:, 5])))}
    K = np.mean(np.asarray(poses[0][0].section.stiffness), axis=0)
    K[[3, 4], [3, 4]] = 0.5 * (K[3, 3] + K[4, 4])
    shown = {axis for axis in most if most[axis] > _NONE * max(most.values())}
    return tuple(
        Loop(e.kind, of, _values(e, K, axis, most[axis])) for e in acting for of, axis in _ACTS[type(e)] if axis in shown
    )


def _values(effect, K, axis, most):
    B, share = float(K[axis, axis]), float(effect.share)
    if isinstance(effect, Relaxation):
        return {"K_inf": ((1.0 - share) * B, "N m^2"), "K_1": (share * B, "N m^2"), "tau": (float(effect.time_constant), "s")}
    critical = effect.slip_twist if isinstance(effect, TorsionFriction) else effect.slip_curvature
    first, following = cycles(effect, K, axis, most)
    return {
        "stick stiffness": (B, "N m^2"), "slip stiffness": ((1.0 - share) * B, "N m^2"),
        "critical strain": (float(critical), "1/m"), "most": (most, "1/m"),
        "first cycle": (first, "J/m"), "following cycles": (following, "J/m"),
    }  # fmt: skip


def cycles(effect: AbstractMemory, K: Float[Array | np.ndarray, "6 6"], axis: int, most: float) -> tuple[float, float]:
    """Work (J/m) of the first cycle and of those that follow, in pure bending or twist between ``most`` and ``-most`` (1/m)."""
    stiffness, held = jnp.asarray(K), jnp.asarray(0.0)

    @jax.jit
    def branch(left, begin, end):
        """Work of the way, and the state at its end."""
        a, b = (jnp.zeros(6).at[axis].set(x) for x in (begin, end))
        work = [0.5 * e @ stiffness @ e + effect.energy_given(e, stiffness, left) for e in (a, b)]
        return work[1] - work[0], effect.leaves(b, stiffness, left, held)

    def path(left, corners):
        total = 0.0
        for begin, end in pairwise(corners):
            work, left = branch(left, begin, end)
            total += float(work)
        return total, left

    first, left = path(effect.without_history(1)[0], (0.0, most, -most, 0.0))
    _, left = path(left, (0.0, most, *(-most, most) * _STEADY))
    return first, path(left, (most, -most, most))[0]
