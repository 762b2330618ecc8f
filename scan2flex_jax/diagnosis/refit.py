"""Nonlinear refits of the base parameters with the amplitudes and sites of one or more effects.

Levenberg-Marquardt (`fitting.descent`) on the whitened residual, with the priors of `prior`: nuisance parameters and amplitudes
are standard normal in units of their tolerance and size, continuous parts of a site are uniform over the scanned range. The
evidence is Laplace's,

    log Z = -cost/2 - 1/2 log |J'J + P| + 1/2 log |P|   (amplitudes and sites),

and models are compared by its excess over that of the base model, in nats. A uniform range R counts as a normal prior of
standard deviation ``R/sqrt(12)``. Sizes are known to an order of magnitude (`evidence.SCALES`): the evidence is the mean over
those. An unidentifiable base parameter keeps its value and adds nothing to the evidence. Symbols as in `sensitivity` and
`residual`.
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from scan2flex_jax.diagnosis.evidence import SCALES, averaged
from scan2flex_jax.diagnosis.prior import Prior
from scan2flex_jax.diagnosis.residual import Law, whiten
from scan2flex_jax.diagnosis.sensitivity import Bench, Component, Numbers
from scan2flex_jax.effects.entry import Context
from scan2flex_jax.fitting.descent import Model, Point, Rules, descend
from scan2flex_jax.fitting.noise import Noise
from scan2flex_jax.fitting.quadratic import Quadratic

_MOST = 14  # iterations: a refit starts from the one-step estimate
_MOST_FREED = 25  # iterations with wide priors of the sizes: the minimum may be far
_ENOUGH = 1e-2  # decrease of the cost below which a refit has settled: verdicts depend on nats
_STATIONARY = 1.0  # decrease of the cost by an undamped step below which a refit is at its minimum: half a nat
_GIVE_UP = 1e7  # damping
_HOPELESS = 80.0  # excess over the least cost of other refits at which one is given up: 40 nats
_DAMPING = 1e-4  # initial
_STRONG, _SHARE = 5.0, 0.3  # residual over noise that calls for unweighted distances; their noise over the residual
_FREE = 100.0  # prior standard deviation of an effect that exceeds its usual size, over that size
_WHITE = 0.5  # white over correlated noise below which a refit starts with whiter noise


@dataclass(eq=False, kw_only=True)
class Refit:
    """Result of a refit: components at their final sites, parameters, shapes, cost, evidence and covariance.

    ``log_evidence`` (nats): over the baseline model with the same noise; 0 for that model itself, NaN until `over` compares a
    refit with its base. ``log_marginal``: log marginal likelihood under the ``law`` of the residual, with the prior
    of that law's sizes, up to a constant shared by all models. ``wider``: factors on the usual sizes of the effects in their
    prior (`freed`); empty for the prior of the evidence.
    """

    components: tuple[Component, ...]
    vector: np.ndarray
    shapes: list
    cost: float
    chi2: float
    log_marginal: float
    covariance: np.ndarray
    converged: bool
    law: Law
    log_evidence: float
    wider: tuple[float, ...] = ()

    @property
    def kinds(self) -> tuple[str, ...]:
        """Effect types of its components."""
        return tuple(c.kind for c in self.components)

    def over(self, base: "Refit", context: Context) -> "Refit":
        """The refit with its log evidence over the ``base``. A choice between n discrete sites costs log n; continuous parts
        of a site are penalised by their ranges."""
        evidence = self.log_marginal - base.log_marginal
        for c in self.components:
            discrete = {str({k: v for k, v in s.items() if k not in c.moving}) for s in c.entry.sites(context)}
            evidence -= np.log(len(discrete))
        return replace(self, log_evidence=float(evidence))

    def amplitudes(self, bench: Bench, k: int) -> np.ndarray:
        """Amplitudes of component ``k``."""
        return self.vector[Numbers(bench, self.components).amplitudes(k)]


def refit(bench: Bench, components, law: Law, guess, amplitudes=(), *, most: int = _MOST, least: float = np.inf) -> Refit:
    """Refit from base parameters ``guess`` and one amplitude vector per component to the nearest minimum.

    Catalogue entries may then propose other starts; the likeliest result is returned. A descent far above the cost ``least`` is
    given up early.
    """
    found = _refit(bench, tuple(components), law, guess, amplitudes, None, most, least)
    ends = [found]
    for other, begin, base in _other_starts(bench, found):
        least = min(least, found.cost)
        ends.append(_refit(bench, other, law, base, begin, found.shapes, 2 * most, least))
    return max(ends, key=lambda f: f.log_marginal)


def again(bench: Bench, before: Refit, law: Law, least: float = np.inf, most: int = _MOST) -> Refit:
    """Repeat a refit under another law of the residual, from its result."""
    n, prior = Numbers(bench, before.components), Prior(bench, before.components, before.wider)
    return _descend(bench, before.components, n, prior, law, before.vector, before.shapes, most, least, solved=True)


def freed(bench: Bench, found: Refit, most: int = _MOST_FREED) -> Refit:
    """The refit with wide priors of the effects that exceed their usual size, so that the data determine the estimates.

    Loads and stiffnesses scaled by one factor give the same shapes, except for the known weight of the cable. Under the law of
    a discrepancy that weight is weak information, and the prior of a strong load would bias the stiffnesses. The prior that
    makes a moment law smooth is kept. The evidence remains that of the usual sizes.
    """
    size = [found.amplitudes(bench, k) / c.entry.size(bench.context) for k, c in enumerate(found.components)]
    pairs = zip(size, found.components, strict=True)
    wider = tuple(_FREE if np.sqrt(np.mean(a**2)) > 1.0 and not c.entry.late else 1.0 for a, c in pairs)
    if not any(t > 1.0 for t in wider) or not np.isfinite(found.cost):
        return found
    n, prior = Numbers(bench, found.components), Prior(bench, found.components, wider)
    end = _descend(bench, found.components, n, prior, found.law, found.vector, found.shapes, most, np.inf, solved=True)
    if not np.isfinite(end.cost):
        return found
    return replace(end, log_marginal=found.log_marginal, log_evidence=found.log_evidence, wider=wider)


def _other_starts(bench, found):
    """Components, amplitudes and base parameters of the starts that the catalogue proposes after a first refit."""
    n = Numbers(bench, found.components)
    amplitudes = [found.vector[n.amplitudes(k)] for k in range(len(found.components))]
    if not np.isfinite(found.cost):
        return
    nodes = np.linspace(0.0, bench.context.length, bench.elements + 1)
    for k, c in enumerate(found.components):
        at = c.site.get("position", 0.0)
        places = np.array([[np.interp(at, nodes, x) for x in s.configuration.r.T] for s in found.shapes])
        for a, site, factors in c.entry.other_starts(amplitudes[k], c.site, bench.context, places):
            base = found.vector[: n.base].copy()
            for slot in bench.layout.slots:
                base[slot.at : slot.at + slot.size] += np.log(factors.get(slot.name, 1.0)) if slot.log else 0.0
            other = Component(c.kind, site)
            yield (*found.components[:k], other, *found.components[k + 1 :]), [*amplitudes[:k], a, *amplitudes[k + 1 :]], base


def _refit(bench, components, law, guess, amplitudes, shapes, most, least):
    n, prior = Numbers(bench, components), Prior(bench, components)
    vector = np.zeros(n.count)
    vector[: n.base] = guess[: n.base]
    for k, (c, a) in enumerate(zip(components, amplitudes, strict=True)):
        vector[n.amplitudes(k)] = a
        site = c.entry.start_site(c.site, law.noise.total)
        vector[n.site(k)] = [float(site[name]) for name in c.moving]
    steps = max([1, *(len(c.entry.continuation) for c in components)])
    for step in range(steps):
        for k, c in enumerate(components):
            if c.entry.continuation:
                vector[n.amplitudes(k)] = c.entry.continued(step, bench.context)
        vector, solved = np.clip(vector, prior.low, prior.high), False
        for each in (*_far(bench, law), *_tempered(law)):
            near = least if each is law and step == steps - 1 else np.inf  # costs under different laws do not compare
            found = _descend(bench, components, n, prior, each, vector, shapes, most, near, solved)
            vector, shapes, solved = found.vector, found.shapes, True
    return found


def _far(bench, law: Law) -> tuple[Law, ...]:
    """The law of unweighted distances, if the baseline model is far off: with noise far below the residual the cost is a
    narrow, curved valley, in which a descent to a strong effect stalls."""
    if bench.off < _STRONG * law.noise.total:
        return ()
    return (plain_law(bench, bench.off),)


def plain_law(bench: Bench, size: float) -> Law:
    """The law of unweighted distances, for residuals of this size (m): white noise of a fraction of it."""
    return Law(Noise(_SHARE * size, 1e-3 * size, 0.05 * bench.context.length))


def _tempered(law: Law) -> tuple[Law, ...]:
    """The law, preceded by a whiter one if its noise is smooth: its valley is too narrow for a distant start."""
    white, correlated = law.noise.white, law.noise.correlated
    if law.curvature or white > _WHITE * correlated:
        return (law,)
    return replace(law, noise=replace(law.noise, white=_WHITE * correlated)), law


def configurations(shapes):
    """Configurations of solved poses, with a leading axis of poses."""
    c = shapes[0].configuration
    return type(c)(*(np.stack([s.configuration[k] for s in shapes]) for k in range(2)))


class _RefitModel(Model):
    """The cable with components, under a law of the residual and priors."""

    def __init__(self, bench: Bench, components, n: Numbers, prior: Prior, law: Law):
        """No pose is solved yet."""
        self.bench, self.components, self.n, self.prior, self.law = bench, components, n, prior, law
        self.low, self.high = prior.low, prior.high
        self.own = prior.precision.copy()
        self.own[n.nuisance] = 0.0  # their priors are rows of the whitened residual

    def at(self, x, start=None) -> Point:
        return self.of(x, self.bench.shapes(self.components, x, self.bench.poses.start if start is None else start))

    def of(self, x, shapes) -> Point:
        """The evaluation at ``x`` whose poses are solved."""
        if any(int(s.verdict.code) != 0 or not np.all(np.isfinite(s.residual)) for s in shapes):
            return Point(x, np.inf, None, (shapes, None))
        white, prior = whiten(shapes, self.bench.real, self.n, x, self.law), self.prior
        cost = float(white.r @ white.r + self.own @ x**2 + prior.weak @ (x - prior.centre) ** 2)
        return Point(x, cost, configurations(shapes), (shapes, white), white.r, white.J)

    def about(self, point) -> Quadratic:
        (_, white), x, prior, own = point.found, point.x, self.prior, self.own
        A = white.J.T @ white.J + np.diag(own + prior.weak)
        g = white.J.T @ white.r + own * x + prior.weak * (x - prior.centre)  # columns: the residual's derivatives
        free = ~prior.frozen & ~(((x <= prior.low) & (g > 0)) | ((x >= prior.high) & (g < 0)))
        return Quadratic(x, A, g, np.diag(A) + prior.width, free)

    def bounded(self, move, about):
        """The move limited to a quarter of a site's range and a factor of e of a base parameter."""
        prior = self.prior
        reach = np.where(prior.width > 0, 0.25 * (prior.high - prior.low), np.inf)
        shrink = np.min(np.where(np.abs(move) > reach, reach / np.maximum(np.abs(move), 1e-300), 1.0), initial=1.0)
        logs = np.max(np.abs(move[: self.n.shared]), initial=0.0)
        return move * min(shrink, 1.0 / max(logs, 1.0))

    def within_reach(self, point: Point, start) -> tuple[Point, float]:
        """The point with amplitudes reduced until its poses are solved, and the initial damping."""
        amplitudes = [self.n.amplitudes(k) for k in range(len(self.components))]
        at, damping = np.concatenate(amplitudes) if amplitudes else np.zeros(0, int), _DAMPING
        while not np.isfinite(point.cost) and len(at) and np.any(np.abs(point.x[at]) > 0) and damping < 1e-1:
            x = point.x.copy()
            x[at] *= 0.3
            point, damping = self.at(x, start), damping * 10
        return point, damping


def _descend(bench, components, n, prior, law, vector, shapes, most, least, solved=False):
    """From the configurations of ``shapes`` (None: those of the bench); ``solved``: they are the solution at ``vector``."""
    model, start = _RefitModel(bench, components, n, prior, law), bench.start if shapes is None else configurations(shapes)
    point, damping = model.within_reach(model.of(vector, shapes) if solved else model.at(vector, start), start)
    rules = Rules(
        most=lambda cost: most, settled=lambda cost: _ENOUGH, damping=_DAMPING, least=1e-9, refused=1e-3, give_up=_GIVE_UP,
        closer=(lambda cost: _ENOUGH) if components else None, bend=True,
        hopeless=least + _HOPELESS,
    )  # fmt: skip
    found = descend(model, point, rules, damping)
    point, (shapes, white) = found.point, found.point.found
    return _finish(bench, components, n, prior, law, point.x, shapes, white, point.cost, found.converged)


def _finish(bench, components, n, prior, law, vector, shapes, white, cost, converged):
    final, chi2, evidence = [], np.inf, -np.inf
    covariance = np.full((n.count, n.count), np.nan)
    for k, c in enumerate(components):
        site = c.site | dict(zip(c.moving, (float(v) for v in vector[n.site(k)]), strict=True))
        final.append(Component(c.kind, site))
    if white is not None:
        own = prior.precision + prior.width
        own[n.nuisance] = 0.0
        free = ~prior.frozen
        inside = np.ix_(free, free)
        A = white.J.T @ white.J + np.diag(own)
        known = (prior.precision + prior.width)[free]
        whole, added = (A + np.diag(prior.weak))[inside], np.arange(n.count)[free] >= n.base
        g = white.J.T @ white.r + own * vector + prior.weak * (vector - prior.centre)
        scales = _over_scales(n, prior, whole, g[free], vector, free, components)
        evidence = 0.5 * np.sum(np.log(known[added])) - 0.5 * cost + scales
        one = [o for c in components for o in (*c.entry.one_sided, *(False,) * len(c.moving))]
        evidence += law.log_prior - white.log_det
        evidence += np.log(2.0) * sum(o for o, f in zip(one, free[n.base :], strict=True) if f)
        correlation, scale = _scaled(A[inside])  # intervals without the weak prior
        covariance[inside] = np.linalg.inv(correlation) / np.outer(scale, scale)
        chi2 = float(white.r @ white.r)
    return Refit(
        components=tuple(final), vector=vector, shapes=shapes, cost=cost, chi2=chi2, log_marginal=float(evidence),
        covariance=covariance, converged=converged, law=law, log_evidence=np.nan if components else 0.0,
    )  # fmt: skip


def _over_scales(n, prior, A, g, vector, free, components):
    """``-1/2 log |A|``, averaged over the scales of each effect's prior, with the changes of the cost (to second order) and of
    the determinants. ``g``: half the gradient of the cost.

    The parameters are kept where a step under the prior of the usual size would gain too: it would not be due to another prior.
    Those at a bound are kept always: a step past it would gain what no parameters can."""
    values, movable = [], ((vector > prior.low) & (vector < prior.high))[free]
    open_ = _decrease(A, g, movable)
    for scales in product(SCALES, repeat=len(components)):
        change = np.zeros(n.count)
        for k, t in enumerate(scales):
            change[n.amplitudes(k)] = prior.precision[n.amplitudes(k)] * (t**-2 - 1.0)
        lost, x = change[free], vector[free]
        wide = A + np.diag(lost)
        gained = _decrease(wide, g + lost * x, movable) - open_ if open_ < _STATIONARY else 0.0
        correlation, scale = _scaled(wide)
        cost = lost @ x**2 - gained
        dimensions = [np.sum((change[n.amplitudes(k)] != 0) & free[n.amplitudes(k)]) for k in range(len(components))]
        normal = -sum(d * np.log(t) for d, t in zip(dimensions, scales, strict=True))
        values.append(normal - 0.5 * cost - 0.5 * np.linalg.slogdet(correlation)[1] - np.sum(np.log(scale)))
    return averaged(values)


def _decrease(A, g, movable):
    """Decrease of a quadratic cost of the matrix ``A`` and half the gradient ``g`` by its best step, of the movable numbers."""
    correlation, scale = _scaled(A)
    pull = (g / scale)[movable]
    return float(pull @ np.linalg.solve(correlation[np.ix_(movable, movable)], pull))


def _scaled(A):
    """A precision matrix scaled to unit diagonal, and the scales."""
    scale = np.sqrt(np.diag(A)) + 1e-150
    return A / np.outer(scale, scale) + 1e-12 * np.eye(len(A)), scale
