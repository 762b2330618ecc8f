"""Nonlinear refits: the base numbers, the amplitudes and the places of one or more kinds, all free.

Levenberg-Marquardt (`fitting.descent`) on the whitened residual with priors: nearly known numbers and amplitudes are standard
normal in units of their tolerance and size, continuous parts of a site are flat over the range that was scanned. Evidence is
Laplace's,

    log Z = -cost/2 - 1/2 log |J'J + P| + 1/2 log |P|   (amplitudes and sites),

and what is compared is its excess over the base model's, the log evidence in nats. A flat range R counts as a normal of
standard deviation ``R/sqrt(12)``. Each effect's size is known to an order of magnitude (`evidence.SCALES`): its evidence is the
mean over those. Priors are in `prior`: a base number that no pose feels stays where it was, and adds nothing to the evidence.
Symbols as in `sensitivity` and `residual`.
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from scan2flex_jax.diagnosis.evidence import SCALES, averaged
from scan2flex_jax.diagnosis.prior import Prior
from scan2flex_jax.diagnosis.residual import Law, whiten
from scan2flex_jax.diagnosis.sensitivity import Bench, Component, Numbers
from scan2flex_jax.effects.entry import Context
from scan2flex_jax.fitting.descent import Model, Point, Quadratic, Rules, descend
from scan2flex_jax.fitting.noise import Noise

_MOST = 14  # iterations: a refit begins at the one-step estimate
_MOST_FREED = 25  # iterations of one whose sizes are freed: it may go far
_ENOUGH = 1e-2  # drop of the cost below which a refit has settled: verdicts turn on units
_GIVE_UP = 1e7  # damping
_HOPELESS = 80.0  # cost above the least one of another refit: forty nats behind
_DAMPING = 1e-4  # to begin with
_STRONG, _SHARE = 5.0, 0.3  # times the noise: a residual far above it; its share that is the noise of plain distances
_FREE = 100.0  # times the usual size of an effect: standard deviation of the prior of one that exceeds that size
_WHITE = 0.5  # white part over the correlated one below which a whiter noise leads the way


@dataclass(eq=False, kw_only=True)
class Refit:
    """Where a refit ended: components at their final sites, all numbers, shapes, cost, evidence and covariance.

    ``log_evidence`` (nats): over the base model, the plain rod with the same noise; 0 for the base itself, NaN until a refit
    was compared with its base (`over`). ``log_marginal``: the logarithm of the marginal likelihood under the
    ``law`` of the residual and of the prior of that law's sizes, up to a constant that all models share. ``wider``: factors on
    the usual sizes of the effects in their prior (`freed`); none for that of the evidence.
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
        """Kinds of its components."""
        return tuple(c.kind for c in self.components)

    def over(self, base: "Refit", context: Context) -> "Refit":
        """The same with its log evidence over the ``base``. A place or a law that was one of several candidates has paid for
        the choice between them; parts that a refit moves are paid for by their ranges."""
        evidence = self.log_marginal - base.log_marginal
        for c in self.components:
            discrete = {str({k: v for k, v in s.items() if k not in c.moving}) for s in c.entry.sites(context)}
            evidence -= np.log(len(discrete))
        return replace(self, log_evidence=float(evidence))

    def amplitudes(self, bench: Bench, k: int) -> np.ndarray:
        """Amplitudes of component ``k``."""
        return self.vector[Numbers(bench, self.components).amplitudes(k)]


def refit(bench: Bench, components, law: Law, guess, amplitudes=(), *, most: int = _MOST, least: float = np.inf) -> Refit:
    """From base numbers ``guess`` and one amplitude vector per component, to the nearest minimum.

    Entries may then propose other starts; the likeliest end is returned. A descent that cannot come near the cost ``least``
    is given up before its end.
    """
    found = _refit(bench, tuple(components), law, guess, amplitudes, None, most, least)
    ends = [found]
    for other, begin, base in _other_starts(bench, found):
        least = min(least, found.cost)
        ends.append(_refit(bench, other, law, base, begin, configurations(found.shapes), 2 * most, least))
    return max(ends, key=lambda f: f.log_marginal)


def again(bench: Bench, before: Refit, law: Law, least: float = np.inf, most: int = _MOST) -> Refit:
    """A refit anew under another law of the residual, from where it ended before."""
    n, prior = Numbers(bench, before.components), Prior(bench, before.components, before.wider)
    return _descend(bench, before.components, n, prior, law, before.vector, configurations(before.shapes), most, least)


def freed(bench: Bench, found: Refit, most: int = _MOST_FREED) -> Refit:
    """The refit with a wide prior of the effects that exceed their usual size: the numbers that the data give.

    Loads and stiffnesses that change by one factor give the same shapes, but for the known weight of the cable. Under the law
    of a discrepancy that weight decides little, and the prior of a strong load would draw the stiffnesses with it. That of a
    law, which makes it smooth, stays. The evidence stays that of the usual sizes.
    """
    size = [found.amplitudes(bench, k) / c.entry.size(bench.context) for k, c in enumerate(found.components)]
    pairs = zip(size, found.components, strict=True)
    wider = tuple(_FREE if np.sqrt(np.mean(a**2)) > 1.0 and not c.entry.late else 1.0 for a, c in pairs)
    if not any(t > 1.0 for t in wider) or not np.isfinite(found.cost):
        return found
    n, prior = Numbers(bench, found.components), Prior(bench, found.components, wider)
    start = configurations(found.shapes)
    end = _descend(bench, found.components, n, prior, found.law, found.vector, start, most, np.inf)
    if not np.isfinite(end.cost):
        return found
    return replace(end, log_marginal=found.log_marginal, log_evidence=found.log_evidence, wider=wider)


def _other_starts(bench, found):
    """Components, amplitudes and base numbers of the starts that the entries propose after a first refit."""
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


def _refit(bench, components, law, guess, amplitudes, start, most, least):
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
        vector = np.clip(vector, prior.low, prior.high)
        for each in (*_far(bench, law), *_tempered(law)):
            near = least if each is law and step == steps - 1 else np.inf  # costs of another law do not compare
            found = _descend(bench, components, n, prior, each, vector, start, most, near)
            vector, start = found.vector, configurations(found.shapes)
    return found


def _far(bench, law: Law) -> tuple[Law, ...]:
    """The law of plain distances, where the baseline model is far off: the metric of a noise far below the residual is that of
    a narrow, bent valley, in which a strong effect is lost."""
    if bench.off < _STRONG * law.noise.total:
        return ()
    return (plain_law(bench, bench.off),)


def plain_law(bench: Bench, size: float) -> Law:
    """The law of plain distances, for residuals of this size (m): white noise of a share of it."""
    return Law(Noise(_SHARE * size, 1e-3 * size, 0.05 * bench.context.length))


def _tempered(law: Law) -> tuple[Law, ...]:
    """The law, after a whiter one where its noise is smooth: such a metric makes a valley too narrow for a start from afar."""
    white, correlated = law.noise.white, law.noise.correlated
    if law.curvature or white > _WHITE * correlated:
        return (law,)
    return replace(law, noise=replace(law.noise, white=_WHITE * correlated)), law


def configurations(shapes):
    """The configurations of solved poses, with a leading axis of poses."""
    c = shapes[0].configuration
    return type(c)(*(np.stack([s.configuration[k] for s in shapes]) for k in range(2)))


class _RefitModel(Model):
    """A model of the cable with components, under a law of the residual and priors."""

    def __init__(self, bench: Bench, components, n: Numbers, prior: Prior, law: Law):
        """Nothing is solved yet."""
        self.bench, self.components, self.n, self.prior, self.law = bench, components, n, prior, law
        self.low, self.high = prior.low, prior.high
        self.own = prior.precision.copy()
        self.own[n.nearly_known] = 0.0  # they are rows of the whitened residual already

    def at(self, x, start=None) -> Point:
        shapes = self.bench.shapes(self.components, x, self.bench.poses.start if start is None else start)
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
        """A quarter of a site's range, and a factor of e of a base number."""
        prior = self.prior
        reach = np.where(prior.width > 0, 0.25 * (prior.high - prior.low), np.inf)
        shrink = np.min(np.where(np.abs(move) > reach, reach / np.maximum(np.abs(move), 1e-300), 1.0), initial=1.0)
        logs = np.max(np.abs(move[: self.n.shared]), initial=0.0)
        return move * min(shrink, 1.0 / max(logs, 1.0))

    def within_reach(self, point: Point, start) -> tuple[Point, float]:
        """The point, of amplitudes small enough for its poses to be solved, and the damping to begin with."""
        amplitudes = [self.n.amplitudes(k) for k in range(len(self.components))]
        at, damping = np.concatenate(amplitudes) if amplitudes else np.zeros(0, int), _DAMPING
        while not np.isfinite(point.cost) and len(at) and np.any(np.abs(point.x[at]) > 0) and damping < 1e-1:
            x = point.x.copy()
            x[at] *= 0.3
            point, damping = self.at(x, start), damping * 10
        return point, damping


def _descend(bench, components, n, prior, law, vector, start, most, least):
    model, start = _RefitModel(bench, components, n, prior, law), bench.start if start is None else start
    point, damping = model.within_reach(model.at(vector, start), start)
    rules = Rules(
        most=lambda cost: most, settled=lambda cost: _ENOUGH, damping=_DAMPING, least=1e-9, refused=1e-3, give_up=_GIVE_UP,
        stuck_converges=False, closer=(lambda cost: _ENOUGH) if components else None, bend=True,
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
        own[n.nearly_known] = 0.0
        free = ~prior.frozen
        inside = np.ix_(free, free)
        A = white.J.T @ white.J + np.diag(own)
        known = (prior.precision + prior.width)[free]
        whole, added = (A + np.diag(prior.weak))[inside], np.arange(n.count)[free] >= n.base
        scales = _over_scales(n, prior, whole, vector, free, components, converged)
        evidence = 0.5 * np.sum(np.log(known[added])) - 0.5 * cost + scales
        one = [o for c in components for o in (*c.entry.one_sided, *(False,) * len(c.moving))]
        evidence += law.log_prior - white.log_det
        evidence += np.log(2.0) * sum(o for o, f in zip(one, free[n.base :], strict=True) if f)
        correlation, scale = _scaled(A[inside])  # intervals are the data's, not the weak prior's
        covariance[inside] = np.linalg.inv(correlation) / np.outer(scale, scale)
        chi2 = float(white.r @ white.r)
    return Refit(
        components=tuple(final), vector=vector, shapes=shapes, cost=cost, chi2=chi2, log_marginal=float(evidence),
        covariance=covariance, converged=converged, law=law, log_evidence=np.nan if components else 0.0,
    )  # fmt: skip


def _over_scales(n, prior, A, vector, free, components, converged):
    """``-1/2 log |A|`` with the prior of each effect's amplitudes at all its scales: the change of the cost, to second order,
    and of the determinants go into the mean. Short of a minimum the numbers stay: a step there would not be the prior's."""
    values = []
    for scales in product(SCALES, repeat=len(components)):
        change = np.zeros(n.count)
        for k, t in enumerate(scales):
            change[n.amplitudes(k)] = prior.precision[n.amplitudes(k)] * (t**-2 - 1.0)
        lost, x = change[free], vector[free]
        correlation, scale = _scaled(A + np.diag(lost))
        moved = np.linalg.solve(correlation, lost * x / scale)
        cost = lost @ x**2 - ((lost * x / scale) @ moved if converged else 0.0)
        dimensions = [np.sum((change[n.amplitudes(k)] != 0) & free[n.amplitudes(k)]) for k in range(len(components))]
        normal = -sum(d * np.log(t) for d, t in zip(dimensions, scales, strict=True))
        values.append(normal - 0.5 * cost - 0.5 * np.linalg.slogdet(correlation)[1] - np.sum(np.log(scale)))
    return averaged(values)


def _scaled(A):
    """A precision matrix as correlations, with the scales that were divided out."""
    scale = np.sqrt(np.diag(A)) + 1e-150
    return A / np.outer(scale, scale) + 1e-12 * np.eye(len(A)), scale
