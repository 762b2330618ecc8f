"""The fit of a study as one traced function: Levenberg-Marquardt in JAX, compiled once and vmapped.

The descent is that of `least_squares` and `descent`, step by step: steps and the rule of convergence of `quadratic`, solves
continued from the last configurations, and another start where a minimum is in doubt (`problem`). Guesses, poses, noise and
any other array of a `TracedProblem` may have a leading axis of samples:

    problem, starts = traced_problem(study)
    jax.vmap(minimise, in_axes=(None, 0))(problem, many_starts)

Every sample states whether it converged; a sample that did not is no estimate. Without statistics: `fit` estimates the noise
and the intervals.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int

from scan2flex_jax.compilation import compiled
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting.least_squares import COST_TOLERANCE, GIVE_UP, MOST_ITERATIONS, STEP_TOLERANCE
from scan2flex_jax.fitting.poses import check_distance, check_no_memory
from scan2flex_jax.fitting.problem import CREDIBLE, FIT_ELEMENTS, LADDER, WEAK, Problem
from scan2flex_jax.fitting.quadratic import GROWTH, FitQuadratic, rounding_of
from scan2flex_jax.fitting.residuals import ResidualFunction, of_poses
from scan2flex_jax.rod.model import Configuration
from scan2flex_jax.statics.verdict import SOLVED, Verdict
from scan2flex_jax.study.model import Study
from scan2flex_jax.study.sense import check_study

DISTANCES = ("normal", "integrated")


class TracedProblem(eqx.Module):
    """A residual function with the ranges of its parameters and the scale of its residuals.

    ``low`` and ``high`` (n,): ranges of ``x``; ``sigma`` (P,) in m: standard deviations that weigh the poses; ``length`` (m) of
    the cable; ``values``: the number of measured values; ``logs`` (n,): mask of logarithms.
    """

    function: ResidualFunction
    low: Float[Array | np.ndarray, " n"]
    high: Float[Array | np.ndarray, " n"]
    sigma: Float[Array | np.ndarray, " P"]
    length: Float[Array | np.ndarray, ""]
    values: Int[Array | np.ndarray, ""]
    logs: tuple[bool, ...] = eqx.field(static=True)


class TracedMinimum(eqx.Module):
    """The end of a fit: ``x`` (n,), its ``cost``, the root mean square distance ``rms`` (m) of the points, the status of the
    worst pose, whether the fit converged, and the iterations and evaluations of all poses that it took."""

    x: Float[Array, " n"]
    cost: Float[Array, ""]
    rms: Float[Array, ""]
    verdict: Verdict
    converged: Bool[Array, ""]
    iterations: Int[Array, ""]
    evaluations: Int[Array, ""]


class _Value(NamedTuple):
    """An evaluation: cost, sum of squares (m^2), normal equations, configurations and verdicts."""

    cost: Float[Array, ""]
    squares: Float[Array, ""]
    JJ: Float[Array, "n n"]
    Jr: Float[Array, " n"]
    configuration: Configuration
    verdict: Verdict


class _Descent(NamedTuple):
    """State of one descent: the best iterate and its value, the next trial, and why it stops."""

    x: Float[Array, " n"]
    value: _Value
    trial: Float[Array, " n"]
    damping: Float[Array, ""]
    growth: Float[Array, ""]
    iteration: Int[Array, ""]
    evaluations: Int[Array, ""]
    going: Bool[Array, ""]
    converged: Bool[Array, ""]


def traced_problem(
    study: Study, *, noise: float | None = None, elements: int = FIT_ELEMENTS, distance: str = "normal"
) -> tuple[TracedProblem, Float[np.ndarray, "2 n"]]:
    """The fit of a study's ``fit`` poses, and its starts: from the guesses of the study, and from the balance of moments.

    Args:
        study: One cable; its ``fit`` poses need a centre curve or markers.
        noise: Standard deviation of one coordinate (m), the weight of residuals against priors; by default the noise that
            each pose states. It may be left out where the study has no priors.
        elements: Elements of the rod.
        distance: Of curves: "normal" or "integrated" (paper, Eq. 10), as in `fit`.

    Raises:
        Scan2FlexError: A pose has no curve and no markers, an effect has memory, priors have no noise to be weighed against, or
            an argument is none of these.
    """
    check_study(study)
    check_distance(study, distance)
    check_no_memory(study, "use fit")
    if distance not in DISTANCES:
        raise Scan2FlexError(f"distance is {distance!r}: give one of {', '.join(DISTANCES)}.")
    if noise is not None and not 0.0 < noise < np.inf:
        raise Scan2FlexError(f"noise is {noise!r}: give a positive number in m, or None.")
    if not study.unknowns:
        raise Scan2FlexError("the study declares nothing under [unknown]: there is nothing to fit")
    problem = Problem(study, elements, distance)
    layout, poses = problem.layout, problem.poses
    stated = all(pose.noise is not None for pose in study.fit_poses if pose.seen)
    if noise is None and layout.has_priors and not stated:
        raise Scan2FlexError("the study has tolerances or priors, and states no noise to weigh them against: give noise in m.")
    sigma = problem.first_scale() if noise is None else np.full(poses.count, float(noise))
    poses = poses.weighed(sigma / problem.first_scale())
    goal, rest = problem.goal(sigma), poses.count * layout.local
    function = ResidualFunction(layout, poses, np.zeros(0, int), None, elements, distance)
    low, high = np.r_[goal.low, np.full(rest, -np.inf)], np.r_[goal.high, np.full(rest, np.inf)]
    logs = (*(bool(log) for log in problem.logs()), *[False] * rest)
    traced = TracedProblem(function, low, high, sigma, np.asarray(problem.length), np.asarray(poses.values), logs)
    return traced, padded_starts(traced, problem.both_starts())


def padded_starts(problem: TracedProblem, starts: Sequence[np.ndarray]) -> Float[np.ndarray, "starts n"]:
    """Starts of the unknowns, with the nuisance parameters at zero."""
    rest = len(problem.logs) - problem.function.layout.unknowns
    return np.stack([np.r_[x, np.zeros(rest)] for x in starts])


def evaluate(problem: TracedProblem, x, start: Configuration) -> _Value:
    """Cost and normal equations of all poses at ``x``, solved from ``start``; an infinite cost where a pose is not solved."""
    f, sigma = problem.function, problem.sigma
    n, k = f.layout.shared, f.layout.local

    def normal(residual, own):
        r, push, (_, configuration, verdict, _) = jax.linearize(residual, own, has_aux=True)
        J = jax.vmap(push)(jnp.eye(len(own))).reshape(len(own), -1)
        r = r.ravel()
        return r @ r, J @ J.T, J @ r, configuration, verdict

    squares, JJ_own, Jr_own, configuration, verdict = of_poses(f, x, normal, start)
    JJ, Jr = jnp.zeros((len(x), len(x))), jnp.zeros(len(x))
    for i in range(f.poses.count):
        at = np.r_[np.arange(n), n + i * k + np.arange(k)]
        JJ, Jr = JJ.at[np.ix_(at, at)].add(JJ_own[i] / sigma[i] ** 2), Jr.at[at].add(Jr_own[i] / sigma[i] ** 2)
    prior = f.layout.prior
    pull, local = prior.pull(x), x[n:]
    diagonal = np.r_[prior.precision(n), np.ones(len(x) - n)]
    JJ, Jr = JJ + jnp.diag(diagonal), Jr.at[prior.at].add(pull / prior.std).at[n:].add(local)
    cost = jnp.sum(squares / sigma**2) + pull @ pull + local @ local
    solved = jnp.all(verdict.code == SOLVED) & jnp.isfinite(cost)
    cost = jnp.where(solved, cost, jnp.inf)
    return _Value(cost, jnp.sum(squares), JJ, Jr, configuration, verdict)


def _about(problem, value, x, began) -> FitQuadratic:
    """The cost to second order about ``x``, as `least_squares` has it."""
    n, logs, share = problem.function.layout.shared, np.asarray(problem.logs), value.cost / problem.values
    precision, rounding = share * jnp.where(logs, WEAK**-2, 0.0), rounding_of(problem.length, problem.sigma, jnp)
    bounds = problem.low, problem.high
    return FitQuadratic(x, value.JJ, value.Jr, began, bounds, logs, precision, n, share, rounding, jnp)


def _descend(problem: TracedProblem, begin, most, empty: _Value) -> _Descent:
    """From ``begin``, in at most ``most`` iterations; 0 evaluates the start alone."""

    def advance(d):
        first = d.evaluations == 0
        start = _where(first, problem.function.poses.start, d.value.configuration)
        value = evaluate(problem, d.trial, start)
        old = _about(problem, d.value, d.x, begin)
        change = old.change(d.value.cost, value.cost, d.trial)
        better = jnp.where(first, jnp.isfinite(value.cost), change < 0)
        small = ~first & (jnp.abs(change) <= COST_TOLERANCE * d.value.cost)
        small |= ~first & better & (old.moved(d.trial) < STEP_TOLERANCE)
        damped = old.damped(d.damping, d.growth, change, d.trial)
        damping, growth = _where(first, (d.damping, d.growth), damped)
        x, value = _where(better, (d.trial, value), (d.x, d.value._replace(verdict=_where(first, value, d.value).verdict)))
        q, iteration, solved = _about(problem, value, x, begin), d.iteration + ~first, jnp.isfinite(value.cost)
        going = solved & ~q.stationary() & ~small & (damping < GIVE_UP) & (iteration < most)
        step = q.bounded(q.solved(q.g, damping))
        trial = jnp.where(going, jnp.clip(x + step, problem.low, problem.high), d.trial)
        return _Descent(x, value, trial, damping, growth, iteration, d.evaluations + 1, going, solved & q.converged())

    no, zero = jnp.array(False), jnp.array(0)
    state = _Descent(begin, empty, begin, jnp.array(1e-3), jnp.array(GROWTH), zero, zero, ~no, no)
    return jax.lax.while_loop(lambda d: d.going, advance, state)


class _Attempts(NamedTuple):
    """Descents from one start after the other: the costs of all starts, the place in the order, the best end so far."""

    costs: Float[Array, " starts"]
    at: Int[Array, ""]
    best: _Descent
    iterations: Int[Array, ""]
    evaluations: Int[Array, ""]
    going: Bool[Array, ""]


@compiled
def minimise(problem: TracedProblem, starts: Float[Array | np.ndarray, "starts n"]) -> TracedMinimum:
    """The minimum from the start of least cost, and from the others too where that leaves doubt, as `fit` does it.

    A start whose poses cannot be solved is made softer and stiffer. In doubt is a minimum that did not converge, lies at a
    bound or is 1 % of the length off; the best one is returned then.
    """
    f, count, rungs = problem.function, len(starts), len(LADDER)
    starts = jnp.clip(starts, problem.low, problem.high)
    points, factors = jnp.sum(jnp.asarray(f.poses.mask)), jnp.log(jnp.array(LADDER))
    shared, none = np.arange(starts.shape[1]) < f.layout.shared, _empty(problem, starts[0])

    def attempt(a):
        scouting = a.at < count
        place = jnp.maximum(a.at - count, 0)
        which = jnp.where(scouting, a.at, jnp.argsort(a.costs)[jnp.minimum(place // rungs, count - 1)])
        factor = jnp.where(scouting, 0.0, factors[place % rungs])
        begin = jnp.clip(starts[which] + jnp.where(np.asarray(problem.logs), factor, 0.0), problem.low, problem.high)
        d = _descend(problem, begin, jnp.where(scouting, 0, MOST_ITERATIONS), none)
        costs = jnp.where(scouting & (jnp.arange(count) == which), d.value.cost, a.costs)
        inside = jnp.all(((d.x > problem.low) & (d.x < problem.high)) | ~shared)
        sure = d.converged & inside & (jnp.sqrt(d.value.squares / points) < CREDIBLE * problem.length)
        best = _where(~scouting & ((d.value.cost < a.best.value.cost) | (a.best.evaluations == 0)), d, a.best)
        onward = jnp.where(jnp.isfinite(d.value.cost), count + rungs * (place // rungs + 1), a.at + 1)
        at = jnp.where(scouting, a.at + 1, onward)
        going = scouting | (~sure & (at < count + rungs * count))
        return _Attempts(costs, at, best, a.iterations + d.iteration, a.evaluations + d.evaluations, going)

    zero = jnp.array(0)
    no = jnp.array(False)
    nothing = _Descent(starts[0], none, starts[0], jnp.array(1e-3), jnp.array(GROWTH), zero, zero, no, no)
    begun = _Attempts(jnp.full(count, jnp.inf), zero, nothing, zero, zero, jnp.array(True))
    a = jax.lax.while_loop(lambda a: a.going, attempt, begun)
    value = a.best.value
    worst = jax.tree.map(lambda v: v[jnp.argmax(value.verdict.code)], value.verdict)
    rms = jnp.sqrt(value.squares / points)
    return TracedMinimum(a.best.x, value.cost, rms, worst, a.best.converged, a.iterations, a.evaluations)


def _empty(problem, x) -> _Value:
    """A value of infinite cost, of the shapes and types of an evaluation."""
    shapes = jax.eval_shape(lambda x: evaluate(problem, x, problem.function.poses.start), x)
    return jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes)._replace(cost=jnp.array(jnp.inf))


def _where(condition, yes, no):
    """`jnp.where` over trees."""
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), yes, no)
