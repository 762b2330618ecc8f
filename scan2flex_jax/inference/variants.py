"""Variants of a study: as stated, with other turns, a mistake of the input corrected, or an effect with memory declared.

Each is a study of its own with its baseline fit, in which hypotheses are scored alike: the measured points are the same, the
prediction differs. That one pose does not fit is a variant too, in which this pose has a wide discrepancy of its own.
"""

from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from scan2flex_jax.compilation import lightly_compiled
from scan2flex_jax.effects import Dahl, Friction, Relaxation, TorsionFriction, effect_class
from scan2flex_jax.effects.catalogue import catalogue
from scan2flex_jax.errors import NotSettledError, Scan2FlexError
from scan2flex_jax.fitting.least_squares import Progress
from scan2flex_jax.fitting.poses import places_of
from scan2flex_jax.fitting.start import memory_starts
from scan2flex_jax.inference.fitting import fitted
from scan2flex_jax.inference.memory import declaring
from scan2flex_jax.inference.mesh import mesh_error
from scan2flex_jax.posterior.posterior import Fitted, Variant
from scan2flex_jax.posterior.program import slots_of
from scan2flex_jax.posterior.search import Search
from scan2flex_jax.posterior.settings import Settings
from scan2flex_jax.results.fit_result import Fit
from scan2flex_jax.rod.energy import excess_strains
from scan2flex_jax.study.mistakes import Mistake
from scan2flex_jax.study.model import Study
from scan2flex_jax.study.visible import visible_mistakes

_FEWEST = 5  # fitted poses that can show memory
_TWISTED = 0.3  # rad along the cable, RMS over the poses, from which twist can show friction


def given(study: Study, elements: int | None, mesh: bool, settings: Settings, say: Progress):
    """``(variant, figures, coarse)``: the study as stated on a fine enough mesh, or its fit alone where a mistake of the input
    shows without a solve, or in single readings; elements and mesh error, and the poses whose mesh remains too coarse. Raises
    `NotSettledError`."""
    while True:
        say("baseline fit")
        first = fitted(study, elements=elements, slots=slots_of(study), settings=settings)
        if first.mistakes and (first.mistakes[0].reading or visible_mistakes(first.problem.study)):
            return first, {}, []
        elements, study = first.problem.elements, first.problem.study  # with the turns that the shapes show
        variant = variant_of("as stated", first)
        if not mesh:
            return variant, {"elements": elements}, []
        error = mesh_error(first.problem, first.minimum)
        most = settings.mesh_share * variant.likelihood.noise(variant.empty.u).total
        figures, coarse = mesh_figures([p.name for p in study.fit_poses], error, most)
        if not coarse or elements >= settings.most_elements:
            return variant, {"elements": elements, **figures}, coarse
        elements *= 2
        say(f"again with {elements} elements")


def mesh_figures(names, error: np.ndarray, most: float) -> tuple[dict[str, float], list[str]]:
    """The largest mesh error (m), unless a pose has none, and the poses in which it exceeds ``most`` in words."""
    known = bool(np.all(np.isfinite(error)))
    pairs = [(name, m) for name, m in zip(names, error, strict=True) if not m <= most]
    said = [(name, f"{1e3 * m:.2f} mm" if np.isfinite(m) else "not solved with more elements") for name, m in pairs]
    coarse = [f"{name} ({why})" for name, why in said]
    return ({"mesh_error": float(np.max(error))} if known else {}), coarse


def variant_of(
    name: str, fit: Fit, log_prior: float = 0.0, effect: str | None = None, groups: list[list[int]] | None = None
) -> Variant:
    """The variant of a fit, with its prior; ``groups``: of poses that are left out together, where it is compared with
    another."""
    variant = fit.posterior.variant
    variant.name, variant.fit, variant.effect = name, fit, effect
    variant.groups = variant.groups if groups is None else groups
    return with_prior(variant, log_prior)


def with_prior(variant: Variant, log_prior: float) -> Variant:
    """The variant with this log prior (nats), whichever it had."""
    variant.empty.score += log_prior - variant.log_prior
    variant.log_prior = log_prior
    return variant


def _as(v: Variant) -> dict[str, Any]:
    """Options of a fit that is compared with a variant."""
    return {"elements": v.program.elements, "slots": slots_of(v.study), "settings": v.settings}


def stated_turns(study: Study, first: Variant, say: Progress) -> Variant | None:
    """The study with the turns that it states, where the fit adopted others."""
    if not first.fit.turned:
        return None
    say("with the turns of the study")
    with_prior(first, -first.settings.turn * len(first.fit.turned))
    try:
        stated = fitted(study, turns=False, mistakes=False, **_as(first))
    except NotSettledError:
        return None
    return variant_of("turns as stated", stated, groups=first.groups)


def corrected(first: Variant, say: Progress) -> Iterator[tuple[Mistake, Variant]]:
    """Each likely mistake of the input with the study that it corrects; a pose that does not fit has a discrepancy of its own.
    """
    study = first.study
    for k, mistake in enumerate(first.fit.mistakes):
        log_prior = -first.settings.mistake
        say(str(mistake))
        name = f"mistake {k + 1}"
        if len(mistake.study.fit_poses) < len(study.fit_poses):
            left = {p.name for p in mistake.study.fit_poses}
            outliers = [i for i, p in enumerate(study.fit_poses) if p.name not in left]
            log_prior -= np.log(len(study.fit_poses))
            own = Variant(name, first.problem, first.minimum, first.settings, log_prior=log_prior, outliers=outliers)
            own.fit = first.fit
            yield mistake, own
            continue
        try:
            mended = fitted(mistake.study, mistakes=False, **_as(first))
        except Scan2FlexError:
            continue
        yield mistake, variant_of(name, mended, log_prior, groups=first.groups)


def remembering(search: Search, say: Progress) -> Iterator[Variant]:
    """Effects with memory, none declared, in enough poses: each where it gains to first order beside the best hypothesis. The
    moment that the poses before leave, at their baseline strains, acts like a natural strain.
    """
    best = search.causes[0]
    v, study = best.variant, best.variant.study
    if study.history_dependent or len(study.fit_poses) < _FEWEST:
        return
    excess, stiffness = _strained(v)
    twist = np.sqrt(np.mean(np.mean(excess[..., 5], axis=1) ** 2)) * v.length
    timed = all(pose.time is not None for pose in study.poses)
    price = v.settings.effect + np.log(len(catalogue()))
    frictions = (Friction.kind, Dahl.kind, *[TorsionFriction.kind] * bool(twist > _TWISTED))
    for kind in (*frictions, *[Relaxation.kind] * timed):
        say(f"score of {kind}")
        if _gain(best, kind, excess, stiffness) < price:
            continue
        say(f"fit with {kind}")
        try:
            found = fitted(declaring(study, kind), turns=False, mistakes=False, **_as(v) | {"slots": ()})
        except NotSettledError:
            continue
        yield variant_of(kind, found, -price, kind, v.groups)


def _strained(v: Variant) -> tuple[np.ndarray, np.ndarray]:
    """Excess strains (P, n, 6) and stiffnesses (P, n, 6, 6) of all poses of the study at the baseline fit, in their order."""
    study, empty = v.study, v.empty
    rods = dict(zip((p.name for p in study.fit_poses), v.program.rods((), empty.x, empty.shapes), strict=True))
    if v.held_out is not None:
        unseen = v.held_out.rods((), v.unseen_vector(empty, v.held_out), empty.predicted)
        rods |= dict(zip((p.name for p in study.validate_poses), unseen, strict=True))
    excess = [np.asarray(excess_strains(*rods[pose.name])) for pose in study.poses]
    return np.nan_to_num(excess), np.stack([np.asarray(rods[pose.name][0].section.stiffness) for pose in study.poses])


def _gain(h: Fitted, kind: str, excess, stiffness) -> float:
    """Gain (nats) of an effect with memory beside a hypothesis, to first order in its share, without a discrepancy."""
    v, study = h.variant, h.variant.study
    at, reset, held = places_of(study, study.fit_poses)
    natural = []
    for start in memory_starts(declaring(study, kind), v.problem.poses, v.problem.length):
        values = {name.partition(".")[2]: value for name, value in start.items()} | {"share": 1.0}
        natural.append(_natural(effect_class(kind)(**values), excess, stiffness, held, reset))
    along = np.moveaxis(np.stack(natural), 1, 0)[at]
    S = v.rows.of(h.shapes, v.program.natural_columns(h.components, h.x, along, h.configuration))
    u, _ = v.likelihood.without(h.linear, h.u)
    wr, wX, wS = v.likelihood.white(u, h.linear, S)
    A, g = h.linear.normal(wr, wX)
    cross = h.linear.crossed(wX, wS)
    flat = wS.reshape(-1, wS.shape[2])
    b = -(flat.T @ wr.ravel() - cross.T @ np.linalg.lstsq(A, g, rcond=1e-12)[0])
    M = np.sum(flat**2, axis=0) - np.sum(cross * np.linalg.lstsq(A, cross, rcond=1e-12)[0], axis=0)
    share = np.clip(b / np.maximum(M, 1e-300), 0.0, 1.0)
    return float(np.max(share * b - 0.5 * share**2 * M))


@lightly_compiled
def _natural(effect, excess, stiffness, held, reset):
    """Natural strains (poses, n, 6) that act like the moment of an ``effect`` of share 1."""

    def element(x, K, left):
        return -jnp.linalg.solve(K, jax.grad(effect.energy_given)(x, K, left))

    def pose(left, at):
        x, K, held, reset = at
        left = jnp.where(reset, effect.without_history(len(x)), left)
        leaves = jax.vmap(lambda x, K, q: effect.leaves(x, K, q, held))(x, K, left)
        return leaves, jax.vmap(element)(x, K, left)

    return jax.lax.scan(pose, effect.without_history(excess.shape[1]), (excess, stiffness, held, reset))[1]
