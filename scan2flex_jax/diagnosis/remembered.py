"""Memory that the study does not declare: does the order of the poses explain what no effect without memory does?

It is tried where the answer leaves more than noise, or an estimated noise, or holds a set kept from the pose before
(`memory_set`), in three steps.

1. A *score* without refits. At ``share`` zero the states of an effect with memory follow from the strains of the baseline
   poses, and its moment ``m`` per ``share`` acts like a natural strain ``-K^-1 m``. One back-substitution gives the column of
   each pose, for each threshold and each order of the poses; the score of an order is the gain (nats) of its best column.
2. Where few other orders score as well, the permutation test by refits (`memory.memory_test`); its other orders only if the
   refit in the order of measurement leaves less than the best model without memory (`DiagnosisSettings.outdone`).
3. Where that names memory, a fit with the effect declared: the answer, if its residual is smaller too.
"""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np

from scan2flex_jax.compilation import lightly_compiled
from scan2flex_jax.diagnosis import report, sentences, verdict
from scan2flex_jax.diagnosis.memory import LEAD, ORDERS, MemoryTest, declaring, memory_test, other_order
from scan2flex_jax.diagnosis.refit import configurations
from scan2flex_jax.diagnosis.result import Explanation, PoseChange, Ranked
from scan2flex_jax.diagnosis.search import Found
from scan2flex_jax.diagnosis.sensitivity import Bench, Numbers
from scan2flex_jax.diagnosis.stage import Stage
from scan2flex_jax.effects import Friction, MemorySet, Relaxation, TorsionFriction, effect_class
from scan2flex_jax.errors import NotSettledError
from scan2flex_jax.fitting import Fit, fit
from scan2flex_jax.fitting.least_squares import Progress
from scan2flex_jax.fitting.poses import places_of
from scan2flex_jax.fitting.start import memory_starts
from scan2flex_jax.rod.energy import strains

FEWEST = 5  # fitted poses: fewer have too few other orders
AS_GOOD = 3  # other orders of `ORDERS` that may score as well as the true one: the test by refits is sharper than the score
TWISTED = 0.3  # rad along the cable, RMS over the poses, from which twist can show friction


@dataclass(frozen=True)
class Remembering:
    """The ``test`` of memory that `explain` ran by itself; where it is named, the RMS distances (m) that the best model
    without it and the fit with it leave (``errors``), and that fit, if it is the ``answer``."""

    test: MemoryTest
    errors: tuple[float, float] | None = None
    answer: Fit | None = None


def search(found: Found, progress: Progress) -> Remembering | None:
    """The test of the likeliest memory, with the fit that is the answer where it is one; None where no memory shows."""
    if not _may_matter(found):
        return None
    study, elements = found.stage.bench.problem.study, found.stage.bench.elements
    kinds = []
    for kind in _possible(found.stage):
        progress(f"score of {kind}")
        kinds += [kind] if _worth(found.stage, kind) else []
    if not kinds:
        return None
    left = report.nearest_rms(found.stage, found.best)
    useful = found.stage.settings.outdone * left
    tests = [
        memory_test(study, kind, elements=elements, until_denied=True, at_most=useful, progress=progress) for kind in kinds
    ]
    best = max(tests, key=lambda test: (test.named, test.gain - test.cost))
    if not best.named:
        return Remembering(best)
    progress(f"fit with {best.kind}")
    try:
        fitted = fit(declaring(study, best.kind, best.parameters), elements=elements)
    except NotSettledError:
        return Remembering(best)
    better = fitted.converged and fitted.rms() < useful
    return Remembering(best, (left, fitted.rms()), fitted if better else None)


def _may_matter(found) -> bool:
    """Whether the answer leaves more than the noise of the sensor, or may, or holds a set of the pose before; in enough poses,
    none declared. An estimated noise may contain what friction does to each pose."""
    study = found.stage.bench.problem.study
    if study.remembers or len(study.fit_poses) < FEWEST or found.verdict in (verdict.NONE, verdict.UNSOLVED):
        return False
    kept = any(MemorySet.kind in r.kinds for r in found.tied)
    return kept or found.verdict in (verdict.UNEXPLAINED, verdict.PARTLY) or found.stage.of.stated is None


def _possible(stage) -> list[str]:
    """The effects with memory that these poses can show."""
    study, length = stage.bench.problem.study, stage.bench.context.length
    twist = np.mean(_strained(stage)[0][..., 5], axis=1) * length
    twisted = bool(np.sqrt(np.mean(twist**2)) > TWISTED)
    timed = all(pose.time is not None for pose in study.poses)
    return [Friction.kind, *[TorsionFriction.kind] * twisted, *[Relaxation.kind] * timed]


def _worth(stage, kind) -> bool:
    """Whether memory gains in the order of measurement, and few other orders score as well."""
    true, *others = scores(stage, kind)
    return bool(true > LEAD and sum(other >= true for other in others) <= AS_GOOD)


def scores(stage: Stage, kind: str, orders: int = ORDERS, seed: int = 0) -> np.ndarray:
    """Gains (nats) of an effect with memory over the baseline model to first order in its ``share``: in the order of
    measurement, then in other ones."""
    bench, study = stage.bench, stage.bench.problem.study
    rng, count = np.random.default_rng(seed), len(study.poses)
    places = np.array([np.arange(count), *(other_order(count, rng) for _ in range(orders))])
    declared = declaring(study, kind)
    at, reset, held = places_of(study, study.fit_poses)
    excess, stiffness = _strained(stage)
    natural = []
    for start in memory_starts(declared, bench.problem.poses, bench.problem.length):
        values = {name.partition(".")[2]: value for name, value in start.items()} | {"share": 1.0}
        of = effect_class(kind)(**values)
        natural.append(_natural(of, excess, stiffness, places, held, reset))
    both = np.concatenate(natural)  # threshold by threshold all orders
    along = np.moveaxis(both, 1, 0)[at]
    columns = bench.natural_columns(stage.base.vector, along, configurations(stage.base.shapes))
    X = -stage.white.stack(columns)
    X -= stage.Q @ (stage.Q.T @ X)
    squares = np.sum(X**2, axis=0) + 1e-300
    share = np.clip(X.T @ stage.y / squares, 0.0, 1.0)
    gain = share * (X.T @ stage.y) - 0.5 * share**2 * squares
    return np.max(gain.reshape(len(natural), -1), axis=0)


def _strained(stage) -> tuple[np.ndarray, np.ndarray]:
    """Excess strains (P, n, 6) and stiffnesses (P, n, 6, 6) of all poses of the study at the baseline fit, in their order."""
    bench, problem = stage.bench, stage.bench.problem
    rods = dict(zip((p.name for p in problem.study.fit_poses), bench.rods(stage.base), strict=True))
    if problem.held_out is not None:
        other = Bench(problem, bench.minimum, problem.held_out)
        numbers, shapes = Numbers(other, ()), report.predicted(other, stage.base)
        vector = np.r_[stage.base.vector[: numbers.shared], np.zeros(numbers.base - numbers.shared)]
        unseen = other.rods(replace(stage.base, vector=vector, shapes=shapes))
        rods |= dict(zip((p.name for p in problem.study.validate_poses), unseen, strict=True))
    excess = [np.asarray(_excess(*rods[pose.name])) for pose in problem.study.poses]
    stiffness = [np.asarray(rods[pose.name][0].section.stiffness) for pose in problem.study.poses]
    return np.nan_to_num(excess), np.stack(stiffness)  # a validate pose without an equilibrium leaves nothing


@lightly_compiled
def _excess(rod, configuration):
    """Excess strains (n, 6) of a rod."""
    return strains(rod, configuration) - rod.section.natural


@lightly_compiled
def _natural(effect, excess, stiffness, places, held, reset):
    """Natural strains (orders, poses, n, 6) that act like the moment of an ``effect`` of share 1; ``places``: the orders."""

    def element(x, K, left):
        return -jnp.linalg.solve(K, jax.grad(effect.energy_given)(x, K, left))

    def pose(left, at):
        x, K, held, reset = at
        left = jnp.where(reset, effect.without_history(len(x)), left)
        leaves = jax.vmap(lambda x, K, q: effect.leaves(x, K, q, held))(x, K, left)
        return leaves, jax.vmap(element)(x, K, left)

    def order(place):
        first = effect.without_history(excess.shape[1])
        _, natural = jax.lax.scan(pose, first, (excess[place], stiffness[place], held, reset))
        return jnp.zeros_like(natural).at[place].set(natural)

    return jax.vmap(order)(jnp.asarray(places))


_OF_NO_USE = "other orders were not tried, since the best model without memory leaves less"


def said_of(memory: Remembering | None, found: Found) -> tuple[str, ...]:
    """The test in words; where it names memory, also its relation to the answer without memory."""
    if memory is None:
        return ()
    said, kind = memory.test.sentence(), memory.test.kind
    if memory.errors is None:
        return (said, *([_OF_NO_USE] if memory.test.untried else []))
    rival = "the best model without memory"
    if found.verdict in verdict.FOUND and any(MemorySet.kind in r.kinds for r in found.tied):
        rival = f"{MemorySet.kind}, which keeps a part of the pose before only,"
    without, left = (1e3 * error for error in memory.errors)
    return said, f"{rival} leaves {without:.2f} mm, {kind} {left:.2f} mm"


def answered(explanation: Explanation, memory: Remembering, more: tuple[str, ...]) -> Explanation:
    """The explanation with memory in the place of the best model without it; ``more``: sentences at its end."""
    fitted = memory.answer
    if fitted is None:
        return explanation
    added, poses = (_ranked(memory.test, fitted),), _poses(explanation, fitted)
    exceeds = explanation.search is not None and explanation.search.stage.of.exceeds(fitted.noise)
    complete = not (fitted.discrepancy.curvature or fitted.misfits or exceeds)
    others = (replace(r, verdict=verdict.TOO_LITTLE, tied_with=()) if r.verdict in _LEADING else r for r in explanation.ranking)
    return replace(
        explanation,
        study=fitted.calibrated, verdict=verdict.EXPLAINED if complete else verdict.PARTLY, p_after=None,
        noise=fitted.noise, discrepancy=fitted.discrepancy, scatter={}, ranking=(*added, *others), chosen=added, added=added,
        estimates={name: fitted.estimates[name] for name in explanation.estimates}, poses=poses, settle=(),
        sentences=(
            sentences.explains(explanation.p_value, added, complete), *sentences.before_and_after(poses, added, True),
            *sentences.of_discrepancy(fitted.discrepancy), *sentences.left_out(poses, added), *more,
        ),
        gates={k: v for k, v in explanation.gates.items() if k != "constancy"}, description=None, laws=(), remembering=fitted,
    )  # fmt: skip


_LEADING = (verdict.NAMED, verdict.FAVOURED, verdict.TIED)


def _ranked(test, fitted) -> Ranked:
    """The effect with memory: its evidence is its gain less the cost of its parameters, its p-value that of the orders."""
    own = {name.partition(".")[2]: e for name, e in fitted.estimates.items() if name.startswith(f"{test.kind}.")}
    std = {name: e.std for name, e in own.items() if e.std is not None}
    rms = {"rms_fit": fitted.rms(), "rms_validate": fitted.rms("validate")}
    values = {name: e.value for name, e in own.items()}
    return Ranked(test.kind, values, test.gain - test.cost, test.p_value, verdict.NAMED, std=std, **rms)


def _poses(explanation, fitted) -> dict[str, PoseChange]:
    """Every pose before and after; left out of the fit in turn, to first order, a pose keeps its place in the order."""
    known = fitted.influence
    unseen = {} if known is None else dict(zip(known.poses, known.left_out.tolist(), strict=True))
    return {
        name: replace(
            before, rms=p.rms, worst=p.worst, stable=p.stable, s=p.s, residual=p.residual, modelled=p.modelled,
            left_out=unseen.get(name),
        )
        for name, before in explanation.poses.items()
        for p in (fitted.poses[name],)
    }  # fmt: skip
