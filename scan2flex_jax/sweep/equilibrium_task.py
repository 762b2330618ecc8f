"""Equilibria as the task of a sweep: any parameter of the model, any pose, per sample."""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.model import CableModel, Configuration
from scan2flex_jax.statics.balance import DEFAULT_ELEMENTS
from scan2flex_jax.statics.solve import Equilibrium, equilibrium
from scan2flex_jax.sweep.task import Output, Traced


class Scene(NamedTuple):
    """The problem of one sample; ``start`` and ``turns`` as in `equilibrium`."""

    model: CableModel
    boundary: Boundary
    start: Configuration | None = None
    turns: int = 0


class Quantity(NamedTuple):
    """A number or array computed from an equilibrium, declared once."""

    of: Callable[[Equilibrium], object]
    output: Output


def _largest_moment(e):
    return jnp.max(jnp.linalg.norm(e.section_forces()[2], axis=1))


QUANTITIES = {
    "points": Quantity(lambda e: e.points, Output("m", ("node", "axis"), "nodes of the centre line")),
    "observed": Quantity(lambda e: e.observed, Output("m", ("node", "axis"), "nodes as the scanner sees them")),
    "tangents": Quantity(lambda e: e.configuration.R[:, :, 2], Output("-", ("node", "axis"), "tangents at the nodes")),
    "energy": Quantity(lambda e: e.energy, Output("J", (), "potential energy")),
    "reaction_force": Quantity(lambda e: e.reactions()[0], Output("N", ("end", "axis"), "force of the supports")),
    "reaction_moment": Quantity(lambda e: e.reactions()[1], Output("N m", ("end", "axis"), "moment of the supports")),
    "largest_moment": Quantity(_largest_moment, Output("N m", (), "largest section moment")),
}


def equilibria(
    scene: Callable[[dict], Scene | tuple],
    quantities: tuple[str, ...] | dict[str, Quantity] = ("points",),
    *,
    elements: int = DEFAULT_ELEMENTS,
    max_steps: int | None = None,
) -> Traced:
    """A task that solves ``scene(lane)``, a `Scene` or ``(model, boundary)``, and keeps ``quantities`` of the equilibrium.

    ``quantities`` are names of `QUANTITIES`, or a dictionary of your own. ``scene`` is traced: its arguments are arrays.
    """
    chosen = quantities if isinstance(quantities, dict) else {name: _standard(name) for name in quantities}

    def one(lane):
        s = Scene(*scene(lane))
        e = equilibrium(s.model, s.boundary, start=s.start, turns=s.turns, elements=elements, max_steps=max_steps)
        return {name: q.of(e) for name, q in chosen.items()}, e.verdict

    parts: dict[str, object] = {"scene": scene, "quantities": chosen, "options": (elements, max_steps)}
    return Traced(one, {name: q.output for name, q in chosen.items()}, parts)


def _standard(name):
    if name not in QUANTITIES:
        raise Scan2FlexError(f"{name!r} is no known quantity of an equilibrium: use one of {', '.join(QUANTITIES)}")
    return QUANTITIES[name]
