"""What a fit is believed to tell: poses whose residual is no noise, and poses never fitted that it predicts."""

import numpy as np

from scan2flex_jax.fitting.distance import NORMALS
from scan2flex_jax.fitting.noise import white_noise
from scan2flex_jax.fitting.settings import USUAL, FitSettings


def misfits(study, poses, length, settings: FitSettings = USUAL) -> tuple[str, ...]:
    """Fitted poses whose residual is no noise: far beyond the stated one whatever its correlation, or large and smooth."""
    said = []
    for pose in study.fit_poses:
        own, noise = poses[pose.name].rms, np.sqrt(NORMALS) * min(white_noise(pose), settings.largest_noise * length)
        beside = f"pose {pose.name} is {1e3 * own:.2f} mm (RMS) off its measured curve"
        if pose.noise is not None and own > settings.beyond_noise * noise:
            said.append(f"{beside}, beside {1e3 * noise:.2f} mm of stated noise: {_NO_NOISE}")
        elif pose.noise is None and own > max(settings.largest_noise * length, settings.beyond_noise * noise):
            said.append(f"{beside}, {100 * own / length:.1f} % of the length and no noise of points: {_NO_NOISE}")
    return tuple(said)


_NO_NOISE = "something is missing or misread, and the values are not to be believed"


def of_discrepancy(discrepancy) -> tuple[str, ...]:
    """The deviation of each pose by itself, in words."""
    if not discrepancy.curvature:
        return ()
    said = f"{1e3 * discrepancy.rms:.2f} mm, {100 * discrepancy.relative:.2f} % of the length"
    return (f"beyond the sensor's noise each pose differs from the model in its own way ({said}): the intervals carry that",)


def validity(
    poses, noise, stated, length, differ, misfit, settings: FitSettings = USUAL
) -> tuple[bool | None, tuple[str, ...]]:
    """Whether the poses that were never fitted are predicted to within the noise, the discrepancy of poses, their tolerances
    and the errors of the estimates.

    Without a stated noise the fit's own residual stands for it; when that varies slowly along the cable it is no scanner's
    noise, and nothing that it leaves can be called "within the noise". None where no pose was held out.
    """
    rms = {n: p.rms for n, p in poses.items() if p.role == "validate"}
    if misfit:
        return (False if rms else None), ("what the fit leaves is no noise: nothing is predicted to within it",)
    floor = max(np.sqrt(2.0) * noise.total, differ)
    slow = noise.correlated > settings.slow * noise.white and noise.correlation_length > settings.long * length
    if stated is None and slow and floor > settings.mesh * length:
        left = f"the residual varies slowly along the cable ({1e3 * floor:.2f} mm), unlike the noise of a scanner"
        return (False if rms else None), (f"{left}: something is missing or misread",)
    if not rms:
        return None, ("no validate pose: whether the model predicts other poses is not known",)
    bad = [n for n, v in rms.items() if not v <= settings.predicted * np.hypot(floor, poses[n].spread)]
    worst = max(bad or rms, key=lambda n: np.inf if np.isnan(rms[n]) else rms[n])
    beside = f"({1e3 * rms[worst]:.2g} mm beside {1e3 * floor:.2g} mm)"
    if poses[worst].spread > settings.felt * floor:
        what = "of noise, and what tolerances and errors of the estimates may do"
        beside = f"({1e3 * rms[worst]:.2g} mm beside {1e3 * floor:.2g} mm {what}, {1e3 * poses[worst].spread:.2g} mm)"
    if not bad:
        return True, (f"validate poses are predicted to within the noise {beside}",)
    said = f"the model does not predict {', '.join(bad)} to within the noise {beside}"
    return False, (f"{said}: something is missing or misread",)
