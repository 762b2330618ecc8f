"""The posterior of a hypothesis: its mode, covariance and log evidence.

A `Variant` is a study as stated, or with other turns, a mistake corrected, an effect with memory declared; a hypothesis is a
variant with a set of effects. Its log evidence is that of `likelihood` at the mode of the parameters (Laplace), averaged over
the prior sizes of effects, which are known to an order of magnitude, plus the log prior of the hypothesis:

    log p(H) = log prior of the variant - sum over effects of (1 - log of its share in `settings.ODDS` + log of its sites).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from scipy import special

from scan2flex_jax.effects.catalogue import catalogue
from scan2flex_jax.effects.entry import CatalogueEntry
from scan2flex_jax.fitting.descent import Model, Point, Rules, descend
from scan2flex_jax.fitting.discrepancy import usual_size
from scan2flex_jax.fitting.least_squares import Minimum
from scan2flex_jax.fitting.noise import FINEST, sensor_noise, stated_noise
from scan2flex_jax.fitting.problem import Problem
from scan2flex_jax.fitting.quadratic import Quadratic
from scan2flex_jax.posterior.likelihood import Likelihood, Linear, bare, elpd, inverted
from scan2flex_jax.posterior.priors import Prior
from scan2flex_jax.posterior.program import Component, Index, Program
from scan2flex_jax.posterior.rows import Rows
from scan2flex_jax.posterior.settings import USUAL, Settings, odds
from scan2flex_jax.rod.model import Configuration
from scan2flex_jax.statics.verdict import SOLVED
from scan2flex_jax.study.model import Study
from scan2flex_jax.study.repeats import repeats

SIZES = (1 / 3, 1.0, 3.0, 10.0, 30.0)  # factors on the usual size of an effect, equally likely
_ROUNDS, _STEPS, _LAST = 3, 10, 30  # of sizes of the noise and parameters in turn; steps of a descent, and of the last one
_SETTLED = 0.5  # nats
_LOOSE, _TIGHT = 0.1, 1e-6  # of the cost: predicted gain at which a descent ends, with effects and without
_DOUBT = 15.0  # nats behind the best, within which a descent that has not converged goes on
_SHARE = 0.3  # of the baseline residual: noise of unweighted distances
_TRUSTED = 4.0  # nats that a further Gauss-Newton step may promise
_WORST_NOISE = 5e-3  # of the length: noise of the sensor to begin from
_DAMPING = 1e-4
_INFORMED = 1e-3  # of the weak prior's precision: least information on a parameter that goes without that prior
_WAY = (0.0, 0.25, 0.5, 0.75, 1.0)  # continuation from a model without effects to one with them


@dataclass(eq=False)
class Fitted:
    """A hypothesis at the mode ``x`` of its posterior: components at their final sites, ``shapes``, sizes ``u`` of noise and
    discrepancy, log evidence ``score`` (nats), ``covariance``, ``wider`` (factors on the usual sizes of its effects), whether
    it ``converged``, its linear model, and ``chi2``."""

    variant: "Variant"
    components: tuple[Component, ...]
    x: np.ndarray
    shapes: list = field(repr=False)
    u: np.ndarray
    score: float
    covariance: np.ndarray = field(repr=False)
    wider: tuple[float, ...]
    converged: bool
    linear: Linear = field(repr=False)
    chi2: float

    @property
    def kinds(self) -> tuple[str, ...]:
        """Its effect types."""
        return tuple(c.kind for c in self.components)

    @property
    def log_odds(self) -> float:
        """Log prior odds (nats) of its effects against common ones."""
        return float(sum(np.log(odds(c.kind)) for c in self.components))

    @property
    def names(self) -> tuple[str, ...]:
        """Its effect types, that of the variant included."""
        return (*filter(None, [self.variant.effect]), *self.kinds)

    @property
    def key(self) -> tuple[str, frozenset[str]]:
        """Its variant and its effect types."""
        return self.variant.name, frozenset(self.kinds)

    @property
    def index(self) -> Index:
        """Places of its parameters."""
        return Index(self.variant.program, self.components)

    @property
    def squares(self) -> float:
        """Sum of squares (m^2) of the distances of all points."""
        real = self.variant.program.real
        return float(sum(np.sum(s.residual[k] ** 2) for s, k in zip(self.shapes, real, strict=True)))

    @property
    def rms(self) -> float:
        """RMS distance (m) of all points."""
        return float(np.sqrt(self.squares / sum(int(np.sum(real)) for real in self.variant.program.real)))

    @property
    def configuration(self) -> Configuration:
        """Configurations of all poses."""
        return configuration(self.shapes)

    def amplitudes(self, k: int) -> np.ndarray:
        """Of component ``k``."""
        return self.x[self.index.amplitudes(k)]

    @property
    def discrepant(self) -> bool:
        """Whether its poses have a discrepancy."""
        return self.variant.likelihood.discrepant(self.u)

    @cached_property
    def elpd(self) -> np.ndarray:
        """Log predictive density (nats) of each pose, or group of repeats, given the others."""
        return elpd(self.variant.likelihood, self.linear, self.u, self.variant.groups)

    @cached_property
    def predicted(self) -> list:
        """Shapes of the validate poses at its shared parameters; those that are not solved from their measured curves are
        continued from the shapes without effects. Empty without such poses."""
        program, n = self.variant.held_out, self.index
        if program is None:
            return []
        x = self.variant.unseen_vector(self, program)
        shapes = program.shapes(self.components, x)
        if solved(shapes) or not self.components:
            return shapes
        begin = x.copy()
        begin[: n.shared] = self.variant.empty.x[: n.shared]
        for k in range(len(self.components)):
            begin[Index(program, self.components).amplitudes(k)] = 0.0
        continued, start = shapes, None
        for t in _WAY:
            continued = program.shapes(self.components, begin + t * (x - begin), start)
            start = configuration(continued)
        return [own if solved([own]) else other for own, other in zip(shapes, continued, strict=True)]

    def gain(self) -> float:
        """Nats that a discrepancy of the poses gains beside its effects."""
        return self.variant.likelihood.gain(self.linear, self.u)

    def scattered(self) -> float:
        """RMS displacement (m) by the discrepancies of the poses."""
        measured = self.variant.rows.measured
        return float(np.sqrt(np.sum((np.exp(self.u[3]) * self.linear.Z[measured]) ** 2) / np.sum(measured)))

    def structured(self) -> float:
        """RMS displacement (m) by correlated noise and discrepancies."""
        return float(np.hypot(np.exp(self.u[1]), self.scattered()))


def configuration(shapes) -> Configuration:
    """Configurations of solved poses, with a leading axis of poses."""
    first = shapes[0].configuration
    return type(first)(*(np.stack([s.configuration[k] for s in shapes]) for k in range(2)))


def solved(shapes) -> bool:
    """Whether every pose is a stable equilibrium with finite residuals."""
    return all(int(s.verdict.code) == SOLVED and np.all(np.isfinite(s.residual)) for s in shapes)


class Variant:
    """A variant of a study, from the minimum of its unweighted distances; refits hypotheses in it.

    ``log_prior`` (nats) of the variant, the ``effect`` with memory that it declares, if any; ``outliers`` have a wide
    discrepancy of their own. ``held``: the hypothesis without effects keeps the parameters of the minimum.
    """

    def __init__(
        self, name: str, problem: Problem, minimum: Minimum, settings: Settings = USUAL, *, log_prior: float = 0.0,
        effect: str | None = None, outliers: Sequence[int] = (), held: bool = False,
    ):  # fmt: skip
        """Refit the hypothesis without effects."""
        self.name, self.problem, self.minimum, self.settings, self.effect = name, problem, minimum, settings, effect
        self.log_prior, self.held = log_prior, held
        self.fit: Any = None  # the `Fit` that this variant is of
        self.program, study = Program(problem, minimum), problem.study
        self.context, self.length = self.program.context, self.program.context.length
        x = np.r_[minimum.shared, np.asarray(minimum.local).ravel()]
        shapes = self.program.shapes((), x)
        if not solved(shapes):  # rounding may keep a solve from where it was
            shapes = self.program.shapes((), x, self.program.poses.start)
        self.rows = Rows(shapes, self.program)
        self.sensor = float(np.clip(sensor_noise(study), FINEST * self.length, _WORST_NOISE * self.length))
        real = self.program.real
        squares = [np.mean(s.residual[k] ** 2) for s, k in zip(shapes, real, strict=True)]
        self.off = max(float(np.sqrt(np.mean(squares))), 1e-9)
        axis = settings.axis * self.context.radius_or_guess if any(p.scan is not None for p in study.fit_poses) else 0.0
        usual = usual_size(self.program.start, settings.usual_discrepancy)
        stated = stated_noise(study, of_all=False)
        self.likelihood = Likelihood(self.rows, self.length, stated, axis, usual, settings, outliers)
        at = {pose.name: i for i, pose in enumerate(study.fit_poses)}
        same = [[at[name] for name in group if name in at] for group in repeats(study)]
        alone = [[i] for i in at.values() if all(i not in group for group in same)]
        self.groups = sorted([*(g for g in same if g), *alone])
        self.refits, self.best = 0, -np.inf
        found = self.refitted((), [], x, shapes, unweighted=False)
        if found is None:
            raise ValueError("the baseline fit is solved")
        self.empty = found

    @property
    def study(self) -> Study:
        """Its study."""
        return self.problem.study

    @cached_property
    def held_out(self) -> Program | None:
        """The validate poses; None without any."""
        held_out = self.problem.held_out
        return None if held_out is None else Program(self.problem, self.minimum, held_out)

    def unseen_vector(self, h: Fitted, program: Program) -> np.ndarray:
        """Parameters of a hypothesis for poses that were not fitted: their own ones are zero."""
        n, own = Index(program, h.components), h.index
        x = np.zeros(n.count)
        x[: n.shared], x[n.base :] = h.x[: n.shared], h.x[own.base :]
        return x

    # --- one hypothesis

    def linear(self, shapes, x, components, prior: Prior, scatter: bool = True) -> Linear:
        """The generative model about a point."""
        n = Index(self.program, components)
        own = [n.of_pose(i) for i in range(n.poses)]
        r = self.rows.of(shapes, [s.residual[:, :, None] for s in shapes])[:, :, 0]
        X = self.rows.of(shapes, [s.columns for s in shapes]) * np.stack([~prior.frozen[a] for a in own])[:, None]
        Z = np.zeros((len(r), self.rows.rows, 1))
        if scatter:
            Z = self.rows.of(shapes, self.program.scatter(components, x, configuration(shapes)))
            most = np.max(np.abs(Z), axis=(1, 2), keepdims=True) * self.likelihood.usual / self.length
            Z /= np.maximum(most, 1.0)  # at a bifurcation the displacement of first order has no bound
        precision = np.where(prior.frozen, 1.0, prior.precision + prior.weak + prior.width)
        return Linear(r, X, Z, own, precision, prior.pull(x), prior.cost(x))

    def refitted(
        self, components, amplitudes, base, shapes=None, u=None, *, unweighted: bool = True, nearest: float = np.inf,
        others: bool = True, within: float | None = None,
    ) -> Fitted | None:
        """A hypothesis at its mode, from amplitudes and base parameters; None where it is not solved or hopeless.

        ``unweighted``: unweighted distances first, as far effects need; ``nearest``: squares (m^2) that these must come near.
        An end beyond the squares ``within`` which a contained hypothesis has, by default the one without effects, began too far
        away for the weights, and is descended again by unweighted distances first.
        ``u``: sizes to begin from. ``others``: also from further starts that the catalogue proposes.
        """
        components, self.refits = tuple(components), self.refits + 1
        n, wider, begun = Index(self.program, components), (1.0,) * len(components), shapes
        x = self._begin(n, components, amplitudes, base)
        steps = max([1, *(len(c.entry.continuation) for c in components)])
        for step in range(steps):
            for k, c in enumerate(components):
                if c.entry.continuation:
                    x[n.amplitudes(k)] = c.entry.continued(step, self.context)
            if unweighted or steps > 1:
                hopeless = 4 * nearest / (_SHARE * self.off) ** 2 if np.isfinite(nearest) and step == steps - 1 else np.inf
                end = self._descend(components, x, begun, self._unweighted(), wider, hopeless=hopeless)
                if end is None:
                    return None
                x, begun, *_ = end
        weighted = bool(components) and begun is shapes
        begun = self._within_reach(components, x, shapes) if weighted else begun
        found = None if begun is None else self._in_turn(components, x, begun, u)
        if found is not None:
            self.best = max(self.best, found.score)
        most = (within or self.empty.squares) if weighted else np.inf
        if found is None or found.squares > most:
            again = self.refitted(components, amplitudes, base, shapes, u, nearest=most, others=others)
            return max((h for h in (found, again) if h is not None), key=lambda h: h.score, default=None)
        if not (others and components):
            return found
        return max([found, *self._other_starts(found)], key=lambda h: h.score)

    def at(self, components: tuple[Component, ...], x, u, converged: bool) -> Fitted | None:
        """A hypothesis at a mode that is known; None where it is not solved."""
        if len(x) != Index(self.program, components).count or len(u) != len(self.empty.u):
            raise ValueError("a mode of another program")
        shapes = self.program.shapes(components, x, self.empty.configuration)
        return self._finished(components, x, shapes, u, converged) if solved(shapes) else None

    def _begin(self, n, components, amplitudes, base):
        x = np.zeros(n.count)
        x[: n.base] = base[: n.base]
        for k, (c, a) in enumerate(zip(components, amplitudes, strict=True)):
            site = c.entry.start_site(c.site, self.sensor)
            x[n.amplitudes(k)], x[n.site(k)] = a, [float(site[name]) for name in c.moving]
        return x

    def _unweighted(self):
        """White rows of unweighted distances."""
        sd = _SHARE * self.off / np.sqrt(self.rows.count)
        return np.eye(self.rows.rows) * np.where(self.rows.pad > 0, 1.0, 1.0 / sd)[:, :, None]

    def _within_reach(self, components, x, shapes):
        """The shapes at a start, made nearer to the absent effects in place where its poses are not solved."""
        sizes = (Prior(self.program, components).width == 0) & (np.arange(len(x)) >= Index(self.program, components).base)
        for factor in (1.0, 0.1):
            x[sizes] *= factor
            found = self.program.shapes(components, x, None if shapes is None else configuration(shapes))
            if solved(found):
                return found
        return None

    def _in_turn(self, components, x, shapes, u):
        """Sizes of the noise and parameters in turn, from solved shapes."""
        last, sensor, law = -np.inf, self.sensor, self.likelihood
        starts = [law.start(sensor, b) for b in (0.03, 1.0)]
        if u is not None:
            starts = [u, np.r_[np.log([sensor, sensor]), u[2], u[3] - 4.0, u[4]]]
        held = self.held and not components
        converged, height = self.minimum.converged or bool(components), -np.inf
        likeliest: tuple = ()
        for turn in range(_ROUNDS + 1):
            wider = self._sizes(components, x)
            linear = self.linear(shapes, x, components, Prior(self.program, components, wider))
            u, value = law.nearest(linear, u) if turn else law.likeliest(linear, starts)
            here = law(u, linear, gradient=False, shift=False) - self.settings.discrepancy * law.discrepant(u)
            if here < height - _SETTLED:  # the sizes before took the step for a gain
                break
            likeliest, height = (x, shapes, u, converged, linear), here if solved(shapes) else -np.inf
            if held or turn == _ROUNDS or value - last < _SETTLED:
                break  # the value has the gain of the next linear step in it
            if value < self.best - (_DOUBT if np.isfinite(last) else 2 * _DOUBT):
                break
            last = value
            Li = law.whitening(u, linear.Z)
            wr = (Li @ linear.r[:, :, None])[:, :, 0]
            A, g = linear.normal(wr, Li @ linear.X)
            lowest = float(np.sum(wr**2) + linear.quad - g @ inverted(A)[1] @ g)  # by a linear step, which ``value`` counts on
            hopeless = lowest + 2 * (value - self.best + 2 * _DOUBT)
            end = self._descend(components, x, shapes, Li, wider, hopeless=hopeless)
            if end is None:
                break
            x, shapes, converged, _ = end
        x, shapes, u, converged, linear = likeliest
        found = self._finished(components, x, shapes, u, converged, linear)
        if not (converged or held) and found.score > self.best - _DOUBT:
            Li = self.likelihood.whitening(found.u, found.linear.Z)
            end = self._descend(components, x, shapes, Li, found.wider, most=_LAST)
            if end is not None:
                found = self._finished(components, end[0], end[1], found.u, end[2])
        return found

    def _descend(self, components, x, shapes, Li, wider, most: int = _STEPS, hopeless: float = np.inf, zero=(), pinned=None):
        """``(x, shapes, converged, cost)`` of the nearest minimum of the cost under white rows, with some parameters held at
        ``zero``, or where they are ``pinned``; None without an equilibrium."""
        prior = Prior(self.program, components, wider, zero, pinned)
        model, x = _Descent(self, components, prior, Li), np.clip(x, prior.low, prior.high)
        start = self.program.start if shapes is None else configuration(shapes)
        point, damping, base = model.at(x, start), _DAMPING, model.n.base
        while not np.isfinite(point.cost) and components and damping < 1e3 * _DAMPING:
            nearer = point.x.copy()
            nearer[base:] = np.where(prior.width[base:] > 0, nearer[base:], 0.3 * nearer[base:])
            point, damping = model.at(nearer, start), damping * 10
        rules = Rules(
            most=lambda cost: most, settled=lambda cost: _LOOSE if components else _TIGHT, damping=_DAMPING, least=1e-9,
            refused=1e-3, give_up=1e7,
            closer=(lambda cost: 1e-2) if components else None, bend=True, hopeless=hopeless,
        )  # fmt: skip
        end = descend(model, point, rules, damping)
        if not np.isfinite(end.point.cost):
            return None
        return end.point.x, end.point.found[0], end.converged, end.point.cost

    def descended(self, x, shapes, Li, zero=(), pinned=None):
        """``(x, shapes, converged, cost)`` of the hypothesis without effects under white rows, some parameters ``zero``, others
        ``pinned`` at values, by their place."""
        return self._descend((), x, shapes, Li, (), most=_LAST, zero=zero, pinned=pinned)

    def _sizes(self, components, x):
        """The prior sizes nearest to the amplitudes."""
        n, out = Index(self.program, components), []
        for k, c in enumerate(components):
            a = np.sqrt(np.mean((x[n.amplitudes(k)] / c.entry.size(self.context)) ** 2))
            out.append(float(min(_sizes_of(c), key=lambda t: abs(np.log(max(a, 0.2) / t)))))
        return tuple(out)

    def _finished(self, components, x, shapes, u, converged, linear: Linear | None = None) -> Fitted:
        """Log evidence, averaged over the prior sizes of the effects, and covariance at the mode; ``linear`` there if known."""
        n, wider = Index(self.program, components), self._sizes(components, x)
        prior = Prior(self.program, components, wider)
        linear = linear or self.linear(shapes, x, components, prior)
        u, _ = self.likelihood.likeliest(linear, [u], most=12)
        wr, wX = self.likelihood.white(u, linear)
        A, g = linear.normal(wr, wX)
        score = self.likelihood(u, bare(linear), gradient=False, shift=False)
        inside = (x > prior.low) & (x < prior.high) | (np.arange(n.count) < n.base)
        free, known = ~prior.frozen & inside, linear.precision
        values = []
        for sizes in product(*map(_sizes_of, components)):
            change = np.zeros(n.count)
            for k, t in enumerate(sizes):
                at = n.amplitudes(k)
                change[at] = np.where(prior.frozen[at], 0.0, prior.precision[at] * ((wider[k] / t) ** 2 - 1.0))
            B, h = (A + np.diag(change))[np.ix_(free, free)], (g + change * x)[free]
            log_det, inverse = inverted(B)
            lost = min(float(h @ inverse @ h), _TRUSTED)
            value = -0.5 * (linear.quad + change @ x**2 - lost) - 0.5 * log_det
            values.append(value + 0.5 * np.sum(np.log((known + change)[free & (known + change > 0)])))
        score += special.logsumexp(values) - np.log(len(values)) + self.log_prior_of(components)
        score -= self.settings.discrepancy * self.likelihood.discrepant(u) + np.log(2.0) * np.sum(~inside & (prior.width > 0))
        one = [o for c in components for o in (*c.entry.one_sided, *(False,) * len(c.moving))]
        score += np.log(2.0) * sum(o and f for o, f in zip(one, free[n.base :], strict=True))
        informed = np.diag(A) > (1.0 + _INFORMED) * prior.weak  # rounding is all that is left of the precision of the others
        _, covariance = inverted(A - np.diag(np.where(prior.frozen | ~informed, 0.0, prior.weak)))
        placed = tuple(
            Component(c.kind, c.site | dict(zip(c.moving, map(float, x[n.site(k)]), strict=True)))
            for k, c in enumerate(components)
        )
        chi2 = float(np.sum(wr**2))
        return Fitted(self, placed, x, shapes, u, float(score), covariance, wider, converged, linear, chi2)

    def log_prior_of(self, components) -> float:
        """Log prior (nats) of a hypothesis."""
        return self.log_prior - sum(price(c.entry, self.context, self.settings) for c in components)

    def _other_starts(self, found: Fitted) -> Iterator[Fitted]:
        """Refits from the further starts that the catalogue proposes (a light span for a heavy one elsewhere, ...)."""
        nodes, slots = np.linspace(0.0, self.length, self.program.elements + 1), self.program.layout.slots
        for k, c in enumerate(found.components):
            at = c.site.get("position", 0.0)
            places = np.array([[np.interp(at, nodes, x) for x in s.configuration.r.T] for s in found.shapes])
            for a, site, factors in c.entry.other_starts(found.amplitudes(k), c.site, self.context, places):
                base = found.x[: found.index.base].copy()
                for slot in slots:
                    base[slot.at : slot.at + slot.size] += np.log(factors.get(slot.name, 1.0)) if slot.log else 0.0
                components = (*found.components[:k], Component(c.kind, site), *found.components[k + 1 :])
                amplitudes = [a if j == k else found.amplitudes(j) for j in range(len(components))]
                begun = found.shapes, found.u
                end = self.refitted(components, amplitudes, base, *begun, unweighted=True, nearest=found.squares, others=False)
                if end is not None:
                    yield end


def _sizes_of(component: Component) -> tuple[float, ...]:
    """Factors on its usual size; a form with one slow part has waves of the usual size at least, however small the rest is."""
    return SIZES[SIZES.index(1.0) :] if component.entry.varies else SIZES


def price(entry: CatalogueEntry, context, settings: Settings) -> float:
    """Cost (nats) of an effect: of the choice of its kind and of its discrete sites, and of having one more."""
    discrete = {str({k: v for k, v in s.items() if k not in entry.moving}) for s in entry.sites(context)}
    of_all = sum(odds(e.kind) for e in catalogue())
    return settings.effect + np.log(of_all / odds(entry.kind)) + np.log(len(discrete))


class _Descent(Model):
    """The cost of a hypothesis under fixed white rows."""

    def __init__(self, variant: Variant, components, prior: Prior, Li):
        self.variant, self.components, self.prior, self.Li = variant, components, prior, Li
        self.n = Index(variant.program, components)
        self.low, self.high = prior.low, prior.high

    def at(self, x, start=None) -> Point:
        program = self.variant.program
        shapes = program.shapes(self.components, x, program.poses.start if start is None else start)
        if not solved(shapes):
            return Point(x, np.inf, None, (shapes, None))
        linear = self.variant.linear(shapes, x, self.components, self.prior, scatter=False)
        wr, wX = (self.Li @ linear.r[:, :, None])[:, :, 0], self.Li @ linear.X
        J = np.zeros((wr.size, self.n.count))
        for i, a in enumerate(linear.at):
            J[i * wr.shape[1] : (i + 1) * wr.shape[1], a] = wX[i]
        cost = float(np.sum(wr**2) + linear.quad)
        return Point(x, cost, configuration(shapes), (shapes, linear), wr.ravel(), J)

    def about(self, point) -> Quadratic:
        (_, linear), x, prior = point.found, point.x, self.prior
        A = point.jacobian.T @ point.jacobian + np.diag(np.where(prior.frozen, 0.0, prior.precision + prior.weak))
        g = point.jacobian.T @ point.residual + linear.pull
        free = ~prior.frozen & ~(((x <= prior.low) & (g > 0)) | ((x >= prior.high) & (g < 0)))
        return Quadratic(x, A, g, np.diag(A) + prior.width, free)

    def bounded(self, move, about):
        """The move limited to a quarter of a site's range and a factor of e of an unknown."""
        prior = self.prior
        reach = np.where(prior.width > 0, 0.25 * (prior.high - prior.low), np.inf)
        longest = np.max(np.abs(move) / reach, initial=1.0)
        return move / max(longest, np.max(np.abs(move[: self.n.shared]), initial=1.0))
