"""Equilibria as the task of a sweep: any parameter of the model, any pose, per sample."""

from collections.abc import Callable, Sequence
from functools import partial

import jax.numpy as jnp

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.statics.balance import DEFAULT_ELEMENTS
from scan2flex_jax.statics.solve import Equilibrium, equilibrium
from scan2flex_jax.sweep.task import Output, Task

Quantity = tuple[Callable[[Equilibrium], object], Output]


def _largest_moment(e):
    return jnp.max(jnp.linalg.norm(e.section_forces()[2], axis=1))


QUANTITIES: dict[str, Quantity] = {
    "points": (lambda e: e.points, Output("m", ("node", "axis"), "nodes of the centre line")),
    "observed": (lambda e: e.observed, Output("m", ("node", "axis"), "nodes as the scanner sees them")),
    "tangents": (lambda e: e.configuration.R[:, :, 2], Output("-", ("node", "axis"), "tangents at the nodes")),
    "energy": (lambda e: e.energy, Output("J", (), "potential energy")),
    "reaction_force": (lambda e: e.reactions()[0], Output("N", ("end", "axis"), "force of the supports")),
    "reaction_moment": (lambda e: e.reactions()[1], Output("N m", ("end", "axis"), "moment of the supports")),
    "largest_moment": (_largest_moment, Output("N m", (), "largest section moment")),
}


def equilibria(
    scene: Callable[[dict], tuple],
    quantities: Sequence[str] | dict[str, Quantity | Callable[[Equilibrium], object]] = ("points",),
    *,
    elements: int = DEFAULT_ELEMENTS,
    max_steps: int | None = None,
) -> Task:
    """A task that solves a problem per sample and keeps ``quantities`` of the equilibrium.

    Args:
        scene: ``scene(sample)`` gives ``(model, boundary)``, then ``start`` and ``turns`` as for `equilibrium`, if needed. It
            is traced: its arguments are arrays.
        quantities: Names of `QUANTITIES`, or a dictionary of your own: ``{"sag": (lambda e: e.points[20, 2], Output("m"))}``. A
            function alone gives one number without a unit.
        elements: Elements of the rod.
        max_steps: As in `equilibrium`.

    Raises:
        Scan2FlexError: A name is none of `QUANTITIES`.
    """
    if isinstance(quantities, dict):
        chosen = {name: one if isinstance(one, tuple) else (one, Output()) for name, one in quantities.items()}
    else:
        names = [quantities] if isinstance(quantities, str) else quantities
        if strangers := [name for name in names if name not in QUANTITIES]:
            known = ", ".join(QUANTITIES)
            raise Scan2FlexError(f"{strangers[0]!r} is no known quantity of an equilibrium: use one of {known}")
        chosen = {name: QUANTITIES[name] for name in names}
    own = dict(chosen) if isinstance(quantities, dict) else list(chosen)
    return Task(
        partial(_solved, scene, chosen, elements, max_steps),
        {name: output for name, (_, output) in chosen.items()},
        traced=True,
        about={"scene": scene, "quantities": own, "options": (elements, max_steps)},
    )


def _solved(scene, quantities, elements, max_steps, sample):
    model, boundary, *more = scene(sample)
    given = dict(zip(("start", "turns"), more, strict=False))
    e = equilibrium(model, boundary, **given, elements=elements, max_steps=max_steps)
    return {name: of(e) for name, (of, _) in quantities.items()}, e.verdict
