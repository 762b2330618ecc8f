"""Inputs of the scores: signatures, the noise given them, the base refitted under that noise, and the global test."""

from dataclasses import dataclass, field, replace

import numpy as np

from scan2flex_jax.diagnosis import evidence, families, score
from scan2flex_jax.diagnosis.refit import Refit, freed, refit
from scan2flex_jax.diagnosis.residual import (
    Complement,
    Law,
    Whitened,
    noise_like,
    orthonormal,
    scales_of_poses,
    signature_basis,
    whiten,
)
from scan2flex_jax.diagnosis.sensitivity import Bench, Component, Numbers, all_components
from scan2flex_jax.diagnosis.settings import USUAL, DiagnosisSettings
from scan2flex_jax.fitting.discrepancy import plane_normal
from scan2flex_jax.fitting.noise import Noise
from scan2flex_jax.study.model import Study
from scan2flex_jax.study.repeats import repeats

NOISE_LAWS = 8  # samples of the noise parameters, which propagate their uncertainty into the bootstrap


@dataclass
class Stage:
    """Inputs of the scores: whitened residual, groups (one per component), families, noise draws.

    ``known``: refits under another estimate of the noise, by their effect types, from which refits of the same types start.
    ``least``: the lowest cost of a refit so far; those far above it are given up early.
    ``unseen``: leave-one-pose-out errors (m) of the refits for which these were computed; ``free``: `refit.freed` of refits.
    """

    bench: Bench
    law: Law
    base: Refit
    components: list[Component]
    groups: list[score.Group]
    families: list[families.Family]
    fields: dict[str, list[np.ndarray]]
    white: Whitened
    draws: np.ndarray
    y: np.ndarray
    Q: np.ndarray
    known: dict[frozenset[str], Refit]
    of: "Signatures"
    least: float = np.inf
    unseen: dict[Refit, np.ndarray] = field(default_factory=dict)
    free: dict[Refit, Refit] = field(default_factory=dict)

    @property
    def noise(self) -> Noise:
        """The sensor's noise."""
        return self.law.noise

    @property
    def settings(self) -> DiagnosisSettings:
        """The thresholds of the diagnosis."""
        return self.of.settings

    def freed(self, found: Refit) -> Refit:
        """The refit whose parameters are reported (`refit.freed`), computed once."""
        if found not in self.free:
            end = freed(self.bench, found)
            self.free[found] = self.free[end] = end
        return self.free[found]


@dataclass
class Signatures:
    """Signatures of the whole catalogue and of two fields at the baseline fit, and the inputs of the noise estimate."""

    bench: Bench
    vector: np.ndarray
    components: list[Component]
    columns: list[np.ndarray]
    owner: np.ndarray
    fields: dict[str, list[np.ndarray]]
    parts: list[np.ndarray]
    stated: float | None
    seed: int
    repeats: tuple[list[int], ...]
    across: np.ndarray | None
    alike: float = 0.0
    scales: tuple[float, ...] = ()
    settings: DiagnosisSettings = USUAL

    def exceeds(self, noise: Noise) -> bool:
        """Whether a noise is far above the stated one: not that of the sensor alone, whatever its correlation."""
        return self.stated is not None and noise.total > self.settings.beyond_stated * self.stated

    def conspicuous(self, noise: Noise) -> bool:
        """Whether a noise that is not stated is large, and smooth as the error of a model is, or of too few points to know."""
        smooth = noise.correlated >= self.settings.smooth * noise.white or self.sparse
        return self.stated is None and smooth and noise.total >= self.settings.large_noise * self.bench.context.length

    @property
    def sparse(self) -> bool:
        """Whether each pose has so few points, as of markers, that their errors do not show whether they are smooth."""
        return max(int(np.sum(real)) for real in self.bench.real) < self.settings.telling_points

    def more_than_noise(self, law: Law) -> bool:
        """Whether a law of the residual is more than noise of the sensor: each pose has a discrepancy, a stated noise is far
        exceeded, or one that is not stated is conspicuous."""
        return bool(law.curvature) or self.exceeds(law.noise) or self.conspicuous(law.noise)

    def complement(self, found_shapes, numbers, vector) -> Complement:
        """The likelihood of the noise in the residual of a model, given its own columns and all signatures."""
        bench = self.bench
        rest = (self.parts, bench.context.length, self.stated, self.repeats)
        return Complement(
            found_shapes, bench.real, numbers, vector, *rest, alike=self.alike, scales=self.scales, settings=self.settings
        )


def signatures(
    bench: Bench, minimum, stated: float | None, seed: int = 0, alike: float = 0.0,
    settings: DiagnosisSettings = USUAL,
) -> tuple[Signatures, Complement]:
    """Signatures at the baseline fit, and the likelihood of the noise there, of which ``stated`` and ``alike`` (m) are known
    parts (`fitting.noise`). With an ``alike`` part, that of scans, the size of the noise differs between poses."""
    vector = np.r_[minimum.shared, np.asarray(minimum.local).ravel()]
    components = all_components(bench.context)
    start = minimum.evaluation.configuration
    shapes = bench.shapes((), vector)
    columns, owner = bench.catalogue_columns(vector, components, start)
    fields = families.discrepancy_columns(bench, vector, start)
    numbers = Numbers(bench, ())
    size = np.sqrt(np.mean([np.mean(s.residual[k] ** 2) for s, k in zip(shapes, bench.real, strict=True)]))
    plain = Noise(max(size, 1e-9), 1e-3 * max(size, 1e-9), 0.05 * bench.context.length)
    white = whiten(shapes, bench.real, numbers, vector, Law(plain))
    every = np.concatenate([white.stack(columns), white.stack(fields["curvature"]), white.stack(fields["load"])], axis=1)
    basis = signature_basis(every, white.base)
    parts = [basis[rows].reshape(-1, 2, basis.shape[1]) for rows in white.normals]
    repeats = repeated(bench.problem.study)
    across = plane_normal(bench.context.points, bench.context.gravity)
    given = bench, vector, components, columns, owner, fields, parts, stated, seed, repeats, across, alike
    found = Signatures(*given, settings=settings)
    likelihood = found.complement(shapes, numbers, vector)
    if not alike:
        return found, likelihood
    white = whiten(shapes, bench.real, numbers, vector, Law(likelihood.estimate))
    found = replace(found, scales=scales_of_poses(white, parts, settings.prior_rows))
    return found, found.complement(shapes, numbers, vector)


def repeated(study: Study) -> tuple[list[int], ...]:
    """Groups of fitted poses (their indices) that repeat one another."""
    at = {pose.name: i for i, pose in enumerate(study.fit_poses)}
    groups = [[at[name] for name in group if name in at] for group in repeats(study)]
    return tuple(g for g in groups if len(g) > 1)


def stage_of(of: Signatures, complement: Complement, known=None, noise: Noise | None = None) -> Stage:
    """The base refitted under a noise, the most likely one if not given, and the groups given it; ``known``: refits to start
    from."""
    noise = noise or complement.estimate
    law = complement.placed(Law(noise, scales=of.scales))
    base = refit(of.bench, (), law, of.vector, most=6)
    rng = np.random.default_rng(of.seed)
    drawn = [replace(law, noise=other) for other in complement.draws(noise, NOISE_LAWS, rng)]
    bench = of.bench
    white = whiten(base.shapes, bench.real, Numbers(bench, ()), base.vector, law)
    S, Q = -white.stack(of.columns), white.base
    groups = [
        score.group_of(k, S[:, of.owner == k], c.entry.size(bench.context), Q, c.entry.one_sided)
        for k, c in enumerate(of.components)
    ]
    draws = noise_like(white, base.shapes, [law, *drawn], of.settings.draws, rng)
    found = families.families(white, of.fields, S, of.owner, of.components, Q)
    y, draws = (x - Q @ (Q.T @ x) for x in (white.r, draws))
    return Stage(bench, law, base, of.components, groups, found, of.fields, white, draws, y, Q, known or {}, of)


def sharpened(of: Signatures, found) -> Stage | None:
    """The stage with the noise estimated given the best refit, if that is clearly lower; otherwise None.

    A strong effect is nonlinear, and the part of it beyond its first-order signature would pass for noise.
    """
    best = found.best
    complement = of.complement(best.shapes, Numbers(of.bench, best.components), best.vector)
    sharper = complement.estimate.total < of.settings.sharper * found.stage.noise.total
    return stage_of(of, complement, found.refits) if sharper else None


def test(stage: Stage, extra=None, r=None) -> score.Test:
    """The global test, of the base or (with residual ``r``, projected off the ``extra`` columns) given an effect."""
    y, draws, Q = stage.y, stage.draws, stage.Q
    groups, gains = stage.groups, {f.name: f.gain for f in stage.families}
    if extra is not None:
        Q = orthonormal(np.column_stack([stage.Q, extra]))
        y, draws = r - Q @ (Q.T @ r), draws - Q @ (Q.T @ draws)
        ones = [np.ones(g.X.shape[1]) for g in stage.groups]
        groups = [score.group_of(g.owner, g.X, o, Q, g.one_sided) for g, o in zip(stage.groups, ones, strict=True)]
        gains = {f.name: families.family_of(f.name, f.U * f.d, Q).gain for f in stage.families}
    return score.global_test(groups, gains, y, draws, len(y) - Q.shape[1])


def one_step(stage: Stage):
    """Per group ``(log evidence, amplitudes)``, and per effect type the averaged evidence and its best group."""
    values, amplitudes = np.full(len(stage.groups), -np.inf), []
    for g, group in enumerate(stage.groups):
        A, b = group.X.T @ group.X, group.X.T @ stage.y
        values[g] = evidence.log_evidence(A, b, group.one_sided)
        a = evidence.one_step(A, b) * stage.components[g].entry.size(stage.bench.context)
        amplitudes.append(np.clip(a, *stage.components[g].entry.bounds(stage.bench.context)))
    kinds = [c.kind for c in stage.components]
    table = {}
    for kind in dict.fromkeys(kinds):
        own = [g for g in range(len(kinds)) if kinds[g] == kind]
        table[kind] = (evidence.averaged(values[own]), max(own, key=lambda g: values[g]))
    return values, amplitudes, table


def test_after(stage: Stage, found: Refit) -> score.Test:
    """The global test given the effects of a refit."""
    numbers = Numbers(stage.bench, found.components)
    white = whiten(found.shapes, stage.bench.real, numbers, found.vector, stage.law)
    return test(stage, orthonormal(white.J), white.r)
