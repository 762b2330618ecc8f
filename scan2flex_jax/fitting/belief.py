"""Validation of a fit: are residuals of fitted poses noise, and are validate poses predicted to within it?"""

import numpy as np

from scan2flex_jax.fitting.answer import two_digits
from scan2flex_jax.fitting.distance import NORMALS
from scan2flex_jax.fitting.noise import white_noise
from scan2flex_jax.fitting.settings import USUAL, FitSettings


def misfits(study, poses, length, settings: FitSettings = USUAL) -> tuple[str, ...]:
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


def validity(
    poses, noise, stated, length, differ, misfit, settings: FitSettings = USUAL
) -> tuple[bool | None, tuple[str, ...]]:
    """Whether the validate poses are predicted to within the noise, the discrepancy of poses, their tolerances and the errors
    of the estimates, with sentences that give the reason. None without a validate pose.

    Without a stated noise the fit's own residual stands in for it; a residual that varies slowly along the cable is not the
    noise of a scanner, and no prediction is then called "within the noise".
    """
    rms = {n: p.rms for n, p in poses.items() if p.role == "validate"}
    if misfit:
        return (False if rms else None), ("the residual of the fit is not noise: no prediction can be within it",)
    floor = max(np.sqrt(2.0) * noise.total, differ)
    slow = noise.correlated > settings.slow * noise.white and noise.correlation_length > settings.long * length
    if stated is None and slow and floor > settings.mesh * length:
        left = f"the residual varies slowly along the cable ({1e3 * floor:.2f} mm), unlike the noise of a scanner"
        return (False if rms else None), (f"{left}: something is missing or misread",)
    if not rms:
        return None, ("no validate pose: whether the model predicts other poses is not known",)
    bad = [n for n, v in rms.items() if not v <= settings.predicted * np.hypot(floor, poses[n].spread)]
    worst = max(bad or rms, key=lambda n: np.inf if np.isnan(rms[n]) else rms[n])
    error = f"error {two_digits(1e3 * rms[worst])} mm" if np.isfinite(rms[worst]) else "no equilibrium was found"
    sizes = f"{error}, noise {two_digits(1e3 * floor)} mm"
    if poses[worst].spread > settings.felt * floor:
        sizes += f", tolerances and errors of the estimates {two_digits(1e3 * poses[worst].spread)} mm"
    if not bad:
        return True, (f"validate poses are predicted to within the noise ({sizes})",)
    said = f"the model does not predict {', '.join(bad)} to within the noise ({sizes})"
    return False, (f"{said}: something is missing or misread",)
