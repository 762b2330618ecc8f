"""The floor of a model: the noise and discrepancy of poses that are most likely given that model.

If no effect type reduces the residual to the sensor's noise, models are compared by their marginal likelihoods, each under its
own most likely law of the residual: the baseline model has a large discrepancy, and an effect is credited with its reduction.
Before any refit, the evidence of a signature is its maximum over a *ladder* of laws, from that of the baseline model down to
the sensor's noise alone, so that an effect is credited with the discrepancy that it replaces.
"""

from dataclasses import dataclass, replace

import numpy as np

from scan2flex_jax.diagnosis import evidence
from scan2flex_jax.diagnosis.refit import Refit, again, configurations, plain_law
from scan2flex_jax.diagnosis.residual import Complement, Law, orthonormal, whiten
from scan2flex_jax.diagnosis.sensitivity import Component, Numbers
from scan2flex_jax.diagnosis.stage import Signatures
from scan2flex_jax.effects.catalogue import fields
from scan2flex_jax.fitting.discrepancy import usual_size
from scan2flex_jax.fitting.noise import FINEST, Noise, sensor_noise

_ROUNDS, _STEPS = 3, 6  # alternations of refit and law, and iterations of each refit
_RUNGS = ((1.0, 1.0), (0.5, 1.0), (0.25, 1.0), (0.1, 1.0), (0.03, 1.0))  # factors on the discrepancy and noise of a model
_FINER = ((0.5, 0.3), (0.25, 0.3), (0.1, 0.3), (0.03, 0.3), (0.1, 0.1), (0.03, 0.1))  # further ones if the noise is not stated
_SETTLED, _FOLLOWED = 1.0, 2.0  # nats gained in the last round; mean square above which a refit lost track
_LAST = 20  # further iterations, at most, of a last refit that has not converged
_BLUNT = 2.0  # times the white noise of the points: a noise above it may stand in for an effect
_PLAIN_STEPS = 16  # iterations of a refit with unweighted distances


def own_floor(of: Signatures, found: Refit, noise: Noise, plain: bool = False, sharp: bool = False) -> Refit:
    """A refit under its most likely law, starting from ``noise``; ``plain``: the refit already minimises unweighted distances.

    Refit and law each fit what the other leaves, and may settle on a noise far above that of the sensor, which neighbouring
    points show by themselves (`fitting.noise.sensor_noise`): if ``sharp``, the refit is then repeated from that noise, and the
    likelier one is kept.
    """
    end = _alternated(of, found if plain else nearest(of, found), noise)
    if not sharp or of.alike or not np.isfinite(end.cost):  # points on the axes of scans show no noise of their own
        return end
    sensor = max(sensor_noise(of.bench.problem.study), FINEST * of.bench.context.length)
    if end.law.noise.total <= _BLUNT * sensor:
        return end
    noise = replace(end.law.noise, white=sensor, correlated=sensor)
    begun = again(of.bench, end, replace(end.law, noise=noise), most=_LAST)
    return max(end, _alternated(of, begun, noise), key=lambda r: r.log_marginal)


def _alternated(of, found, noise):
    """A refit and its most likely law in turn, from ``noise``.

    The likelihood of a law treats the parameters as free to first order. If the refit is too nonlinear for that, such a law is
    too narrow for the residual, and the law of the residual with fixed parameters is tried. The refit under the last law
    goes on, to converge: only at its minimum is a strong effect credited with larger prior sizes (`refit`).
    """
    ends, law = [], None
    as_it_stands = False
    for _ in range(_ROUNDS):
        if not np.isfinite(found.cost):
            break
        law = likeliest_law(of, found, noise, as_it_stands, None if as_it_stands else law)
        found = again(of.bench, found, law, most=_STEPS)
        ends.append(found)
        if len(ends) > 1 and abs(found.log_marginal - ends[-2].log_marginal) < _SETTLED:
            break
        as_it_stands = _lost(of, found)
    if np.isfinite(found.cost) and not found.converged:
        ends.append(again(of.bench, found, found.law, most=_LAST))
    return max(ends, key=lambda end: end.log_marginal, default=found)


def nearest(of: Signatures, found: Refit) -> Refit:
    """The refit continued with unweighted distances, if that reduces its distance to the curves."""
    if not np.isfinite(found.cost):
        return found
    size = max(np.sqrt(np.mean([np.mean(s.residual[k] ** 2) for s, k in zip(found.shapes, of.bench.real, strict=True)])), 1e-12)
    plain = again(of.bench, found, plain_law(of.bench, size), most=_PLAIN_STEPS)
    return plain if np.isfinite(plain.cost) and squares(of, plain) < squares(of, found) else found


def squares(of: Signatures, found: Refit) -> float:
    """Sum of the squared distances (m^2) of a refit from the curves."""
    return sum(float(np.sum(s.residual[k] ** 2)) for s, k in zip(found.shapes, of.bench.real, strict=True))


def _lost(of, found):
    """Whether the residual of a refit far exceeds its law."""
    white = whiten(found.shapes, of.bench.real, Numbers(of.bench, found.components), found.vector, found.law)
    return bool(white.r @ white.r > _FOLLOWED * len(white.r))


def likeliest_law(of: Signatures, found: Refit, noise: Noise, as_it_stands: bool = False, near: Law | None = None) -> Law:
    """The most likely noise and discrepancy given a refit, starting from ``noise`` or from a law that is ``near``.

    ``as_it_stands``: with all parameters fixed.
    """
    complement, scatter = _complement(of, found, as_it_stands)
    return complement.law(noise, usual_size(of.bench.start, of.settings), scatter, near)


def gain_of_discrepancy(of: Signatures, found: Refit, noise: Noise) -> float:
    """Log evidence (nats) of a discrepancy of each pose over noise alone, given a refit."""
    return _complement(of, found)[0].gain(noise, usual_size(of.bench.start, of.settings))


def _complement(of, found, as_it_stands=False):
    bench, solved = of.bench, configurations(found.shapes)
    scatter = bench.scatter(found.components, found.vector, solved)
    given = found.shapes, bench.real, Numbers(bench, found.components), found.vector, ()
    rest = bench.context.length, of.stated, of.repeats, scatter, of.across
    free = not as_it_stands
    return Complement(*given, *rest, free=free, alike=of.alike, scales=of.scales, settings=of.settings), scatter


@dataclass(frozen=True)
class Scores:
    """One-step scores of the catalogue given a model: per component the log evidence (nats) over that model at its own floor,
    and the amplitudes at the law of largest evidence."""

    components: list[Component]
    values: np.ndarray
    amplitudes: list[np.ndarray]

    def table(self, skip=()) -> dict[str, tuple[float, int]]:
        """Per effect type the mean evidence over its sites, and its best component."""
        kinds = [c.kind for c in self.components]
        out = {}
        for kind in dict.fromkeys(kinds):
            own = [g for g in range(len(kinds)) if kinds[g] == kind]
            if kind not in skip:
                out[kind] = (evidence.averaged(self.values[own]), max(own, key=lambda g: self.values[g]))
        return out


def only(of: Signatures, components: list[Component]) -> Signatures:
    """The signatures of these components in the place of those of the catalogue."""
    columns, owner = of.bench.catalogue_columns(of.vector, components, of.bench.start)
    return replace(of, components=components, columns=columns, owner=owner)


def with_fields(of: Signatures) -> Signatures:
    """The signatures together with those of the fields along the cable."""
    bench, more = of.bench, [Component(entry.kind, {}) for entry in fields()]
    columns, owner = bench.catalogue_columns(of.vector, more, bench.start)
    both = [np.concatenate(pair, axis=-1) for pair in zip(of.columns, columns, strict=True)]
    owner = np.r_[of.owner, len(of.components) + owner]
    return replace(of, components=[*of.components, *more], columns=both, owner=owner)


def scores(of: Signatures, found: Refit) -> Scores:
    """Scores of the catalogue given a refit, on the ladder of laws from its own downwards."""
    laws = _ladder(of, found.law)
    totals, amplitudes, base = [], [], []
    for law in laws:
        evidence_, a, without = _at(of, found, law)
        totals.append(without + evidence_)
        amplitudes.append(a)
        base.append(without)
    best = np.argmax(totals, axis=0)
    values = np.max(totals, axis=0) - max(base)
    return Scores(of.components, values, [amplitudes[k][g] for g, k in enumerate(best)])


def _ladder(of, law):
    rungs = _RUNGS if of.stated else _RUNGS + _FINER
    usual, least = usual_size(of.bench.start, of.settings), FINEST * of.bench.context.length
    b = law.curvature or usual
    scatter = law.scatter or of.bench.scatter((), of.vector, of.bench.start)
    out = [law]
    for smaller, finer in rungs[0 if not law.curvature else 1 :]:
        n = law.noise
        noise = replace(n, white=max(finer * n.white, least), correlated=max(finer * n.correlated, least))
        prior = -0.5 * (np.log(smaller * b / usual) / of.settings.discrepancy_spread) ** 2
        out.append(replace(law, noise=noise, curvature=smaller * b, scatter=scatter, log_prior=law.log_prior + prior))
    return out


def _at(of, found, law):
    """``(log evidence per component, its amplitudes, log likelihood of the model alone)`` under one law."""
    bench, numbers = of.bench, Numbers(of.bench, found.components)
    white = whiten(found.shapes, bench.real, numbers, found.vector, law)
    Q = orthonormal(white.J)
    y = white.r - Q @ (Q.T @ white.r)
    S = -white.stack(of.columns)
    S -= Q @ (Q.T @ S)
    values, amplitudes = np.full(len(of.components), -np.inf), []
    for g, c in enumerate(of.components):
        size = c.entry.size(bench.context)
        X = S[:, of.owner == g] * size
        A, b = X.T @ X, X.T @ y
        values[g] = evidence.log_evidence(A, b, c.entry.one_sided)
        amplitudes.append(np.clip(evidence.one_step(A, b) * size, *c.entry.bounds(bench.context)))
    scale = np.linalg.norm(white.J, axis=0) + 1e-150
    known = np.linalg.svd(white.J / scale, compute_uv=False)
    information = np.sum(np.log(known[known > 1e-7 * known[0]])) + np.sum(np.log(scale[scale > 1e-100]))
    return values, amplitudes, law.log_prior - white.log_det - 0.5 * float(y @ y) - information
