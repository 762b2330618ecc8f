"""Measuring errors of a scanned centre curve: white, and correlated along `s`, the same for each coordinate.

The variance of one coordinate is `sigma^2 (1 - share) + sigma^2 share c(s - s')`, with one of two correlations that are
rough or oscillating, so that a smooth kernel (squared exponential, Matern 3/2) does not assume them:

- `walk`: `c = exp(-|d| / l)`, an Ornstein-Uhlenbeck walk, stepped exactly from point to point;
- `waves`: `c = sin(d / l) / (d / l)`, a sum of `WAVES` sinusoids with random phase and wave number uniform in [0, 1/l].

`l` is in metres, like `s`. Poses and coordinates are independent.
"""

from dataclasses import dataclass

import numpy as np

WAVES = 64


@dataclass(frozen=True)
class Noise:
    sigma: float  # m, one coordinate
    share: float = 0.0  # of the variance that is correlated
    length: float = 1.0  # l, m
    kernel: str = "walk"

    def correlation(self, d):
        """`c` of a distance along `s`."""
        return np.exp(-np.abs(d) / self.length) if self.kernel == "walk" else np.sinc(d / (np.pi * self.length))

    def covariance(self, s):
        """Of one coordinate at the points `s`, m^2."""
        correlated = self.share * self.correlation(s[:, None] - s)
        return self.sigma**2 * (correlated + (1 - self.share) * np.eye(len(s)))

    def draw(self, rng, s):
        """One realisation, `(len(s), 3)`."""
        white = rng.normal(size=(len(s), 3)) * np.sqrt(1 - self.share)
        smooth = _walk(rng, s, self.length) if self.kernel == "walk" else _waves(rng, s, self.length)
        return self.sigma * (white + np.sqrt(self.share) * smooth)


def _walk(rng, s, length):
    keep = np.exp(-np.diff(s) / length)
    fresh = rng.normal(size=(len(s), 3))
    out = fresh.copy()
    for i, a in enumerate(keep):
        out[i + 1] = a * out[i] + np.sqrt(1 - a * a) * fresh[i + 1]
    return out


def _waves(rng, s, length):
    number = rng.uniform(0, 1 / length, (WAVES, 3))
    phase = rng.uniform(0, 2 * np.pi, (WAVES, 3))
    return np.sqrt(2 / WAVES) * np.cos(number * s[:, None, None] + phase).sum(axis=1)


def draw_noise(rng, length):
    """A random measuring error for a cable of this length; half of them white only."""
    sigma = round(rng.uniform(2e-4, 8e-4), 6)
    if rng.random() < 0.5:
        return Noise(sigma)
    kernel = "walk" if rng.random() < 0.5 else "waves"
    reach = rng.uniform(0.03, 0.12) if kernel == "walk" else rng.uniform(0.01, 0.04)
    return Noise(sigma, round(rng.uniform(0.3, 0.7), 3), round(reach * length, 4), kernel)
