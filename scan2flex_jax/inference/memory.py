"""Does the cable remember? The poses in the order of measurement against the same poses in other orders.

A cable with memory explains its poses in one order: that in which they were measured. What poses do not owe to their past (a
law that softens, a set) may be imitated by memory too, but then other orders fit as well. So the study is fitted with the
memory effect in the order of measurement and in random orders, in which times and resets keep their places. If poses are
exchangeable, as they are without memory, the rank of the true order is uniform: an exact permutation test (Good, "Permutation,
Parametric and Bootstrap Tests of Hypotheses", 2005).

Gains are in nats: the log evidence of each order (`posterior`) over that of the fit without memory, in which the order has no
part.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from math import factorial

import numpy as np

from scan2flex_jax.effects import Friction
from scan2flex_jax.errors import NotSettledError, Scan2FlexError
from scan2flex_jax.fitting.problem import FIT_ELEMENTS
from scan2flex_jax.fitting.threads import threaded
from scan2flex_jax.inference.fitting import fitted
from scan2flex_jax.study.kinds import kind_format
from scan2flex_jax.study.model import EffectDeclaration, Study, Unknown
from scan2flex_jax.study.sense import check_study

ORDERS = 19  # permutations: the least p-value is 1/20
LEVEL = 0.05  # of the p-value
LEAD = 3.0  # nats over the fit without memory, and over every other order


@dataclass(frozen=True)
class MemoryTest:
    """Whether poses owe something to their past.

    ``gain`` (nats) of the memory effect ``kind`` in the order of measurement, ``others`` those in other orders (minus infinity
    where no values let every pose settle), ``parameters`` its values.
    """

    kind: str
    gain: float
    others: tuple[float, ...] = field(repr=False)
    parameters: dict[str, float]

    @property
    def p_value(self) -> float:
        """Share of all orders tried, the true one included, that fit at least as well as the true one."""
        return (1 + sum(other >= self.gain for other in self.others)) / (1 + len(self.others))

    @property
    def named(self) -> bool:
        """Whether memory explains the poses, and no other order explains them as well."""
        return self.p_value <= LEVEL and self.gain - max(0.0, *self.others) >= LEAD

    def sentence(self) -> str:
        """The result in words."""
        orders = f"{len(self.others)} other orders" if len(self.others) > 1 else "one other order"
        best = f"the best of {orders} gains {max(self.others, default=0.0):.1f}"
        tested = f"{self.kind} gains {self.gain:.1f} nats in the order of measurement, {best} (p = {self.p_value:.2f})"
        if self.named:
            return f"the shapes depend on the poses before: {tested}"
        if self.gain < LEAD:
            return f"no memory is seen: {tested}"
        return f"memory is not established, other orders of the poses fit as well: {tested}"

    def to_json(self) -> dict:
        """As numbers and lists."""
        others = [other if np.isfinite(other) else None for other in self.others]
        said = {"kind": self.kind, "gain": self.gain, "others": others, "p_value": self.p_value}
        return said | {"parameters": self.parameters, "named": self.named}


@threaded
def memory_test(
    study: Study,
    kind: str = Friction.kind,
    *,
    orders: int = ORDERS,
    elements: int = FIT_ELEMENTS,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> MemoryTest:
    """Test whether the poses of a study depend on those before them.

    Args:
        study: One cable with unknowns; its poses stand in the order of measurement. An effect of this ``kind`` may be declared.
        kind: The effect with memory: "friction", "dahl", "torsion_friction" or "relaxation".
        orders: Different random orders to compare with, or all there are; 19 or more can name memory.
        elements: Elements of the rod.
        seed: Draws the orders.
        progress: Called with a line of text now and then.

    Returns:
        Gains in all orders, the p-value, and whether memory is to be named.

    Raises:
        Scan2FlexError: ``kind`` has no memory, or the study cannot be fitted.
        NotSettledError: No values let every pose settle in the order of measurement.

    Examples:
        >>> memory_test(load_study("my-cable")).named  # doctest: +SKIP
        True
    """
    plain, remembering, say = _plain(study, kind), declaring(study, kind), progress or (lambda message: None)
    fit = partial(fitted, elements=elements, turns=False, mistakes=False)
    say(f"with {kind}")
    true = fit(remembering)
    say(f"without {kind}")
    least = fit(plain).posterior.score
    tried, others = other_orders(len(study.poses), orders, np.random.default_rng(seed)), []
    for k, order in enumerate(tried):
        say(f"order {k + 1} of {len(tried)}")
        try:
            others.append(fit(_permuted(true.calibrated, order)).posterior.score - least)
        except NotSettledError:
            others.append(-np.inf)
    names = (name for name in true.estimates if name.startswith(f"{kind}."))
    values = {name.partition(".")[2]: float(true.estimates[name].value) for name in names}
    return MemoryTest(kind, true.posterior.score - least, tuple(others), values)


def _plain(study, kind):
    """The study without the effect and its unknowns."""
    effects = tuple(e for e in study.effects if e.kind != kind)
    unknowns = tuple(u for u in study.unknowns if not u.name.startswith(f"{kind}."))
    return replace(study, effects=effects, unknowns=unknowns)


def declaring(study: Study, kind: str, guesses: Mapping[str, float] | None = None) -> Study:
    """The study with an effect with memory declared, its parameters unknown unless they are given.

    ``guesses``: starts of the unknown parameters, by name. Raises `Scan2FlexError` for an effect without memory, and where the
    study lacks what the effect needs (the times of its poses).
    """
    guesses = guesses or {}
    form = kind_format(kind)
    if form.memory == "none":
        raise Scan2FlexError(f"{kind} has no memory: test friction, dahl, torsion_friction or relaxation.")
    if all(e.kind != kind for e in study.effects):
        own = [p.name for p in form.parameters if p.estimable and not p.optional]
        unknowns = tuple(Unknown(f"{kind}.{name}", guess=guesses.get(name)) for name in own)
        study = replace(study, effects=(*study.effects, EffectDeclaration(kind)), unknowns=(*study.unknowns, *unknowns))
    check_study(study)
    return study


def _permuted(study, order):
    """The study with its poses in another order; times and resets stay where they were."""
    shown = zip((study.poses[i] for i in order), study.poses, strict=True)
    return replace(study, poses=tuple(replace(pose, time=place.time, reset=place.reset) for pose, place in shown))


def other_orders(count: int, most: int, rng: np.random.Generator) -> list[tuple[int, ...]]:
    """Different random orders of so many poses, none that of measurement: ``most`` of them, or all there are."""
    found, every = dict.fromkeys([tuple(range(count))]), factorial(count)
    while len(found) <= min(most, every - 1):
        found[tuple(map(int, rng.permutation(count)))] = None
    return list(found)[1:]
