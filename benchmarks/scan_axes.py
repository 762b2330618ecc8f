"""Errors of axes from scans, over the radius, by their order along the pose: what `ExplainSettings.scan_alike` assumes.

    python -m benchmarks.scan_axes [--studies 8] [--seed 501]

Studies of `scan_alarms` with nothing missing, whose true axes are known. The error across the axis at the stations of the
direct fit is expanded in Legendre polynomials of the arc length, each of unit RMS.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.polynomial import legendre

from benchmarks import scan_alarms

_ORDERS = 8
_FINER = 8  # times the points of a true shape


def across(points, shape):
    """Errors (n, 3) of points across a shape (m, 3), whose nearest points are taken on a finer grid."""
    at = np.linspace(0, len(shape) - 1, _FINER * len(shape))
    fine = np.stack([np.interp(at, np.arange(len(shape)), x) for x in shape.T], axis=1)
    nearest = np.argmin(np.sum((points[:, None] - fine[None]) ** 2, axis=-1), axis=1)
    tangent = np.gradient(fine, axis=0)[nearest]
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    off = points - fine[nearest]
    return off - np.sum(off * tangent, axis=1, keepdims=True) * tangent


def of_study(key, made) -> list:
    """Per pose the coefficients (orders, 3) over the radius, and the variance of a coefficient of white noise."""
    from scan2flex_jax.fitting import fit  # noqa: PLC0415 - the environment must be set first

    *_, shapes, radius = made
    with tempfile.TemporaryDirectory() as folder:
        fitted = fit(scan_alarms.studies(key, made, Path(folder))["scan"])
    out = []
    for pose, shape in zip(fitted.poses.values(), shapes, strict=True):
        off = across(np.asarray(pose.measured), shape) / radius
        unit = legendre.legvander(np.linspace(-1, 1, len(off)), _ORDERS) * np.sqrt(2 * np.arange(_ORDERS + 1) + 1)
        found = np.linalg.lstsq(unit, off, rcond=None)[0]
        out.append((found, np.mean(np.sum((off - unit @ found) ** 2, axis=1)) / 2 / len(off)))
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--studies", type=int, default=8)
    parser.add_argument("--seed", type=int, default=501)
    args = parser.parse_args()
    from scan2flex_jax.cli.setup import prepare_jax  # noqa: PLC0415

    prepare_jax()
    poses = []
    for index in range(args.studies):
        keys = ([args.seed, index, attempt, 7] for attempt in range(scan_alarms.ATTEMPTS))
        drawn = ((key, scan_alarms.make(key, ())) for key in keys)
        poses += next((of_study(key, made) for key, made in drawn if made is not None), [])
    rms = np.sqrt(np.mean([np.sum(c**2, axis=1) / 2 for c, _ in poses], axis=0))
    figures = {"poses": len(poses), "rms_by_order": rms.tolist(), "white": float(np.sqrt(np.mean([w for _, w in poses])))}
    sys.stdout.write(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
