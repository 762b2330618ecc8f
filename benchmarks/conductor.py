"""A measured moment curve as the law of a cable: a table of curvature (1/m) and moment (N m), read from a file of the user.

Made for the bending test of an overhead line in the public repository ``rte-france/pallas-stranded-cable`` (MPL-2.0,
``src/strdcable/data/FLEXION_CARDINAL_H40kN_mu0.7_FOTI.csv``: 18 points, its secant stiffness falls from 1,583 to 170 N m^2, its
tangent to 29). The file stays where it is. The curve is made smooth by monotone cubics between its points; it is a straight
line from zero to the first, since a law is odd, and after the last. Lengths and moments of a cable have no scale of their own:
the curve is stretched in both, so that it acts in a cable of another size.
"""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

from benchmarks.blind import laws


class CurveError(Exception):
    """A file that holds no moment curve, with its name and what is wrong with it."""


@dataclass(frozen=True)
class Measured:
    """Moment over the stiffness at zero curvature, ``m`` (1/m), at curvatures ``q`` (1/m) from the first point on, times
    ``stretch`` both; as in `blind.laws`: ``g(u)`` is moment over the linear one, ``u`` the square of a curvature."""

    curve: CubicHermiteSpline
    stretch: float = 1.0

    @property
    def yields(self) -> float:
        """Curvature (1/m) at which a linear law reaches the largest moment of the table."""
        return self.stretch * float(self.curve(self.curve.x[-1]))

    def g(self, u):
        """Moment over the linear one, and its derivative by ``u``; for complex ``u`` too."""
        x = self.curve.x
        k = np.sqrt(np.where(u.real > (self.stretch * x[0]) ** 2, u, (self.stretch * x[0]) ** 2)) / self.stretch
        i = np.clip(np.searchsorted(x, k.real, side="right") - 1, 0, len(x) - 2)
        d, c = k - x[i], self.curve.c[:, i]
        m, slope = ((c[0] * d + c[1]) * d + c[2]) * d + c[3], (3 * c[0] * d + 2 * c[1]) * d + c[2]
        last, end = float(self.curve(x[-1])), float(self.curve(x[-1], 1))
        past = k.real > x[-1]
        m, slope = np.where(past, last + end * (k - x[-1]), m), np.where(past, end, slope)
        bent = u.real > (self.stretch * x[0]) ** 2
        return np.where(bent, m / k, 1.0), np.where(bent, (slope * k - m) / (2 * k**3 * self.stretch**2), 0.0)

    def pick(self, poses):
        """The same law in some of the poses."""
        return self

    def __call__(self, M, part, compliance):
        """Curvature from the material moment, and its derivative."""
        return laws.invert(self, M, 1 / compliance[part, 0, 0], compliance[part, 2, 2])


def read(path: Path) -> Measured:
    """The curve of a CSV file with one line of names, then curvature (1/m) and moment (N m) that both grow from above zero.

    Raises `CurveError`.
    """
    try:
        rows = list(csv.reader(path.read_text("utf-8").splitlines()))[1:]
        q, m = np.array([[float(v) for v in row] for row in rows if row]).T
    except (OSError, ValueError) as fault:
        raise CurveError(f"{path}: no table of curvature (1/m) and moment (N m) below a line of names: {fault}") from fault
    if len(q) < 3 or not all(np.all(np.isfinite(v)) and v[0] > 0 and np.all(np.diff(v) > 0) for v in (q, m)):
        raise CurveError(f"{path}: give 3 points or more, whose curvature and moment both grow from above zero")
    m = m * (q[0] / m[0])
    slopes = PchipInterpolator(q, m).derivative()(q)
    slopes[0] = min(1.0, 3.0 * (m[1] - m[0]) / (q[1] - q[0]))  # of the straight line before it; beyond that a cubic falls
    slopes[-1] = (m[-1] - m[-2]) / (q[-1] - q[-2])
    return Measured(CubicHermiteSpline(q, m, slopes))
