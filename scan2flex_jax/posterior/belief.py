"""Validation of a fit: are residuals of fitted poses noise, and are validate poses predicted to within it?"""

from collections.abc import Sequence

import numpy as np

from scan2flex_jax.fitting.discrepancy import Discrepancy
from scan2flex_jax.fitting.distance import NORMALS
from scan2flex_jax.fitting.noise import Noise, sensor_noise, white_noise
from scan2flex_jax.fitting.problem import Problem
from scan2flex_jax.fitting.quadratic import EXACT
from scan2flex_jax.fitting.states import Shape
from scan2flex_jax.posterior.estimate import two_digits
from scan2flex_jax.posterior.posterior import Fitted
from scan2flex_jax.posterior.search import scored
from scan2flex_jax.posterior.settings import FEWEST, USUAL, Settings


def misfits(study, poses, length, settings: Settings = USUAL) -> tuple[str, ...]:
    """Fitted poses whose residual is not noise: far above the stated noise, or large and smooth."""
    said = []
    for pose in study.fit_poses:
        own, noise = poses[pose.name].rms, np.sqrt(NORMALS) * min(white_noise(pose), settings.largest_noise * length)
        off = f"pose {pose.name} is {1e3 * own:.2f} mm (RMS) off its measured curve"
        if pose.noise is not None and own > settings.beyond_noise * noise:
            said.append(f"{off}, more than the stated noise of {1e3 * noise:.2f} mm: {_NO_NOISE}")
        elif pose.noise is None and own > max(settings.largest_noise * length, settings.beyond_noise * noise):
            said.append(f"{off}, {100 * own / length:.1f} % of the length, too much for noise: {_NO_NOISE}")
        far = max(poses[pose.name].readings, key=lambda one: one.off, default=None)
        if far is not None and far.off > settings.beyond_noise:
            said.append(f"pose {pose.name}, {far.sentence()}: {_NO_NOISE}")
    return tuple(said)


_NO_NOISE = "something is missing or misread, and the values are not reliable"


def reservation(h: Fitted, discrepancy: Discrepancy) -> str:
    """Why an answer is believed with care at most, in words, by `fit` and `explain` alike; empty without a reason.

    Residuals are large against what the values move, or poses deviate by more than the noise of their points: a random
    deviation of each pose then stands in for whatever the model lacks, and need not be random.
    """
    v, shown = h.variant, np.sqrt(NORMALS) * sensor_noise(h.variant.study)
    if not np.any(v.program.poses.seen):  # in units of the noise that the readings state
        shown = float(np.sqrt(NORMALS) * np.median(v.problem.first_scale()))
    known, points = np.isfinite(shown), sum(int(np.sum(real)) for real in v.program.real)
    own, move = float(np.sqrt(h.squares / points)), moved(v.problem, h.shapes, v.program.real)
    seen = move > EXACT * v.length  # else the values are not determined, whatever the residuals
    if seen and own > v.settings.moved * move and not (known and own <= v.settings.beyond_noise * shown):
        share = f"{100 * own / move:.0f} % of what a factor of e in the values moves"
        size = f" of {two_digits(1e3 * own)} mm" if np.any(v.program.poses.seen) else ""
        return f"residuals{size} are {share}: a reading is mistaken, or something is missing"
    if not discrepancy.curvature:
        return ""
    of = "that is stated" if v.likelihood.stated else "that their points show" if known else "of the fit"
    size = shown if known else np.sqrt(NORMALS) * v.likelihood.noise(h.u).total
    if not discrepancy.moved:
        return "readings deviate from the model by more than their noise"
    deviate = f"poses deviate from the model by {two_digits(1e3 * discrepancy.rms)} mm"
    return f"{deviate}, beside the noise of {two_digits(1e3 * size)} mm {of}"


def overlooked(h: Fitted) -> str:
    """An effect that the model lacks by its score to first order (Rao's test), in words; empty where none gains as many nats as
    a finding of `explain` takes. What the estimates absorb leaves a small residual, and predicts the validate poses."""
    if h.variant.held or len(h.variant.groups) < FEWEST or of_the_axis(h):
        return ""
    kind, best = next(iter(scored(h).items()))
    if best.gain <= h.variant.settings.found:
        return ""
    return f"{kind.replace('_', ' ')} would explain the shapes better ({best.gain:.0f} nats to first order)"


def of_the_axis(h: Fitted) -> bool:
    """Whether the residual of scans may be the error of their axis. Such errors are alike in poses seen alike: nats add up over
    the poses, and prove nothing."""
    likelihood = h.variant.likelihood
    return bool(h.rms <= likelihood.settings.beyond_noise * np.sqrt(NORMALS) * likelihood.axis)


def moved(problem: Problem, shapes: Sequence[Shape], real: Sequence[np.ndarray]) -> float:
    """RMS displacement (m) of the measured points by a factor of e in each unknown that is positive, to first order; infinite
    without such."""
    logs, points = np.flatnonzero(problem.logs()), sum(int(np.sum(keep)) for keep in real)
    squares = sum(float(np.sum(np.asarray(s.columns)[keep][..., logs] ** 2)) for s, keep in zip(shapes, real, strict=True))
    return float(np.sqrt(squares / points)) if len(logs) else np.inf


def conspicuous(noise: Noise, length: float, settings: Settings = USUAL) -> bool:
    """Whether noise that nobody stated varies along the cable as no scanner's does: smoothly, and over lengths or by sizes far
    beyond the usual ones."""
    far = settings.smooth * length
    beyond = noise.correlation_length > far * settings.correlation or noise.total > far * settings.usual_noise
    return noise.correlated > settings.smooth * noise.white and beyond and not noise.assumed(length)


def validity(poses, noise, differ, stated, length, misfit, settings: Settings = USUAL) -> tuple[bool | None, str]:
    """Whether the validate poses are predicted, with the reason in words: none is farther off than ``surprise``
    times what noise, discrepancy, tolerances and the errors of the estimates let expect. None without a validate pose.

    ``differ``: whether poses have a discrepancy. Without a stated noise the fit's own residual stands in for it; one that
    varies slowly along the cable is not the noise of a scanner, and no prediction is then called "within the noise".
    """
    unseen = {n: p for n, p in poses.items() if p.role == "validate"}
    if misfit:
        return (False if unseen else None), "the residual of the fit is not noise: no prediction can be within it"
    if stated is None and conspicuous(noise, length, settings):
        left = f"the residual varies slowly along the cable ({1e3 * np.sqrt(2.0) * noise.total:.2f} mm)"
        return (False if unseen else None), f"{left}, unlike the noise of a scanner: something is missing or misread"
    if not unseen:
        return None, "no validate pose: whether the model predicts other poses is not known"
    bad = [n for n, p in unseen.items() if not p.ratio <= settings.surprise]
    worst = unseen[max(bad or unseen, key=lambda n: unseen[n].ratio)]
    error = f"error {two_digits(1e3 * worst.rms)} mm, " if len(worst.residual) else "error "
    sizes = f"{error}{two_digits(worst.ratio)} times the expected one" if worst.stable else "no equilibrium was found"
    within = "the noise and the deviations of poses" if differ else "the noise"
    if not bad and worst.rms > settings.untested * length:
        share = f"{two_digits(100 * worst.rms / length)} % of the length"
        off = f"validate poses are off by up to {two_digits(1e3 * worst.rms)} mm, {share}"
        return None, f"{off}, which tolerances and errors of the estimates let expect: they test little"
    if not bad:
        return True, f"validate poses are predicted to within {within} ({sizes})"
    said = f"the model does not predict {', '.join(bad)} to within {within} ({sizes})"
    return False, f"{said}: something is missing or misread"
