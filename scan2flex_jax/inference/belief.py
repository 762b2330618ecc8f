"""Validation of a fit: are residuals of fitted poses noise, and are validate poses predicted to within it?"""

import numpy as np

from scan2flex_jax.fitting.distance import NORMALS
from scan2flex_jax.fitting.noise import Noise, white_noise
from scan2flex_jax.inference.answer import two_digits
from scan2flex_jax.inference.settings import USUAL, Settings


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
    return tuple(said)


_NO_NOISE = "something is missing or misread, and the values are not to be believed"


def of_discrepancy(discrepancy) -> tuple[str, ...]:
    """The discrepancy of poses, in words."""
    if not discrepancy.curvature:
        return ()
    said = f"{1e3 * discrepancy.rms:.2f} mm, {100 * discrepancy.relative:.2f} % of the length"
    return (f"beyond the noise, each pose deviates from the model in its own way ({said})",)


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
    error = f"error {two_digits(1e3 * worst.rms)} mm, {two_digits(worst.ratio)} times the expected one"
    sizes = error if np.isfinite(worst.rms) else "no equilibrium was found"
    within = "the noise and the deviations of poses" if differ else "the noise"
    if not bad and worst.rms > settings.untested * length:
        share = f"{two_digits(100 * worst.rms / length)} % of the length"
        off = f"validate poses are off by up to {two_digits(1e3 * worst.rms)} mm, {share}"
        return None, f"{off}, which tolerances and errors of the estimates let expect: they test little"
    if not bad:
        return True, f"validate poses are predicted to within {within} ({sizes})"
    said = f"the model does not predict {', '.join(bad)} to within {within} ({sizes})"
    return False, f"{said}: something is missing or misread"
