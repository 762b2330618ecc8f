"""What every score rests on: signatures, the noise beside them, the base in the metric of that noise, and the global test."""

from dataclasses import dataclass, field, replace

import numpy as np

from scan2flex_jax.diagnosis import evidence, families, score
from scan2flex_jax.diagnosis.refit import Refit, refit
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
from scan2flex_jax.fitting.discrepancy import planes_of
from scan2flex_jax.fitting.noise import Noise
from scan2flex_jax.study.model import Study
from scan2flex_jax.study.repeats import repeats

NOISE_LAWS = 8  # noises drawn beside the estimated one, for what the test does not know of the noise
_SHARPER = 0.9  # of the noise: a lower estimate beside an effect replaces the first one


@dataclass
class Stage:
    """All that the scores rest on: whitened residual, groups (one per component), families, noise draws.

    ``known``: refits with another estimate of the noise, by their kinds; a refit of the same kinds begins where they ended.
    ``least``: the lowest cost of a refit so far; those that cannot come near it are given up on the way.
    ``unseen``: errors (m) of the poses left out in turn, of refits for which these were computed.
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

    @property
    def noise(self) -> Noise:
        """The sensor's."""
        return self.law.noise

    @property
    def settings(self) -> DiagnosisSettings:
        """What counts as missing and as found."""
        return self.of.settings


@dataclass
class Signatures:
    """What the whole catalogue and two fields would do to the residual of the plain fit, and the noise beside them."""

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
    planes: int
    alike: float = 0.0
    scales: tuple[float, ...] = ()
    settings: DiagnosisSettings = USUAL

    def complement(self, found_shapes, numbers, vector) -> Complement:
        """The likelihood of the noise in the residual of some model, beside its own columns and all signatures."""
        bench = self.bench
        rest = (self.parts, bench.context.length, self.stated, self.repeats)
        return Complement(found_shapes, bench.real, numbers, vector, *rest, alike=self.alike, scales=self.scales)


def signatures(
    bench: Bench, minimum, stated: float | None, seed: int = 0, alike: float = 0.0,
    settings: DiagnosisSettings = USUAL,
) -> tuple[Signatures, Complement]:
    """Signatures at the plain fit, and the likelihood of the noise there; ``stated`` and ``alike`` (m) are parts of it that
    are known (`fitting.noise`). With an ``alike`` part, that of scans, poses have noises of their own size."""
    vector = np.r_[minimum.shared, np.asarray(minimum.local).ravel()]
    components = all_components(bench.context)
    start = minimum.evaluation.configuration
    shapes = bench.shapes((), vector)
    columns, owner = bench.catalogue_columns(vector, components, start)
    fields = families.ghost_columns(bench, vector, start)
    numbers = Numbers(bench, ())
    size = np.sqrt(np.mean([np.mean(s.residual[k] ** 2) for s, k in zip(shapes, bench.real, strict=True)]))
    plain = Noise(max(size, 1e-9), 1e-3 * max(size, 1e-9), 0.05 * bench.context.length)
    white = whiten(shapes, bench.real, numbers, vector, Law(plain))
    every = np.concatenate([white.stack(columns), white.stack(fields["curvature"]), white.stack(fields["load"])], axis=1)
    basis = signature_basis(every, white.base)
    parts = [basis[rows].reshape(-1, 2, basis.shape[1]) for rows in white.normals]
    repeats = repeated(bench.problem.study)
    planes = planes_of(bench.context.points, bench.context.gravity)
    given = bench, vector, components, columns, owner, fields, parts, stated, seed, repeats, planes, alike
    found = Signatures(*given, settings=settings)
    beside = found.complement(shapes, numbers, vector)
    if not alike:
        return found, beside
    white = whiten(shapes, bench.real, numbers, vector, Law(beside.estimate))
    found = replace(found, scales=scales_of_poses(white, parts))
    return found, found.complement(shapes, numbers, vector)


def repeated(study: Study) -> tuple[list[int], ...]:
    """Groups of fitted poses (their indices) that repeat one another."""
    at = {pose.name: i for i, pose in enumerate(study.fit_poses)}
    groups = [[at[name] for name in group if name in at] for group in repeats(study)]
    return tuple(g for g in groups if len(g) > 1)


def stage_of(of: Signatures, complement: Complement, known=None) -> Stage:
    """The base refitted in the metric of the noise, and the groups beyond it; ``known`` refits are begun from."""
    noise = complement.estimate
    law = Law(noise, scales=of.scales)
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
    """The stage with the noise estimated beside the best refit, when that is clearly less; None when it is not.

    A strong effect acts nonlinearly, and what its signature to first order leaves in the residual looks like noise.
    """
    best = found.best
    complement = of.complement(best.shapes, Numbers(of.bench, best.components), best.vector)
    sharper = complement.estimate.total < _SHARPER * found.stage.noise.total
    return stage_of(of, complement, found.refits) if sharper else None


def test(stage: Stage, extra=None, r=None) -> score.Test:
    """The global test, of the base or (with ``extra`` columns taken out and residual ``r``) after an effect."""
    y, draws, Q = stage.y, stage.draws, stage.Q
    groups, ghosts = stage.groups, {f.name: f.gain for f in stage.families}
    if extra is not None:
        Q = orthonormal(np.column_stack([stage.Q, extra]))
        y, draws = r - Q @ (Q.T @ r), draws - Q @ (Q.T @ draws)
        ones = [np.ones(g.X.shape[1]) for g in stage.groups]
        groups = [score.group_of(g.owner, g.X, o, Q, g.one_sided) for g, o in zip(stage.groups, ones, strict=True)]
        ghosts = {f.name: families.family_of(f.name, f.U * f.d, Q).gain for f in stage.families}
    return score.global_test(groups, ghosts, y, draws, len(y) - Q.shape[1])


def one_step(stage: Stage):
    """Per group ``(log evidence, amplitudes)``, and per kind the averaged evidence and its best group."""
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
    """The global test with the effect in the model."""
    numbers = Numbers(stage.bench, found.components)
    white = whiten(found.shapes, stage.bench.real, numbers, found.vector, stage.law)
    return test(stage, orthonormal(white.J), white.r)
