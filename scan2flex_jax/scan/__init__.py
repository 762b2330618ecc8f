"""From a scanned point cloud to a centre curve (paper, Section 4), and a simulated scanner for its tests.

The method, in the order of `extraction.extract`, for a cable of radius r between two ends:

1. **Cloud** (`cloud`). The file is read and refused if its units are not metres. Points out of reach of the cable, isolated
   points and planes are left out; of a cloud with guide points, whatever is far from them.
2. **Coarse curve** (`coarse_curve`, `strand_matching`). Each point votes for the axis, r inward along its normal. Nodes of the
   votes are chained into strands, and strands joined end to end from clamp to clamp by a matching of least length and turn. The
   curve is trusted by its length and by the share of the votes that it explains; without trust or guide points it is refused.
   If it does not pass the guide points in their order, the curve through them is taken, moved onto the votes (`guide_points`).
3. **Snakes** (`snakes`). The paper's energy (Eq. 8) of a spline through 20 points is minimised over the points near the curve.
4. **Last stage** (`refine`). The most probable smooth spline through 40 points, with its standard deviation. Points are
   weighted by their radial distance (Tukey), or with viewpoints by a mixture of honest, flying and stray points along their
   rays (`sensor_noise`); the smoothness maximises the marginal likelihood.
5. **Again**, from the curve of 4, over the points near it: until no points of the cable are missed, and once more without those
   that lie on no tube of this radius or between gaps that are one (`plausibility.foreign`).
6. **Result** (`centre_curve`). 201 points with frames between the ends of the cloud or the clamps; gaps where no points are.
7. **Doubts** (`plausibility`). Length, ends, directions, radius, bends, gaps, and points that indicate another curve. Any of
   them makes the curve not `sure`; one that questions what was seen makes it `astray`, and `fit` leaves the pose out.

The numbers that decide are those of `settings`. `spline` is the curve of all steps, `picture` draws a result, and `scanner` and
`shapes` make scans of known curves.
"""

from scan2flex_jax.scan.centre_curve import CentreCurve, RadiusStatistics
from scan2flex_jax.scan.cloud import Cloud, load_cloud
from scan2flex_jax.scan.extraction import extract, extract_pose, extract_study
from scan2flex_jax.scan.picture import plot_extraction, save_picture
from scan2flex_jax.scan.scanner import PERFECT, STRUCTURED_LIGHT, TIME_OF_FLIGHT, Scan, Sensor, scan, tube_mesh
from scan2flex_jax.scan.strand_matching import End

__all__ = [
    "PERFECT",
    "STRUCTURED_LIGHT",
    "TIME_OF_FLIGHT",
    "CentreCurve",
    "Cloud",
    "End",
    "RadiusStatistics",
    "Scan",
    "Sensor",
    "extract",
    "extract_pose",
    "extract_study",
    "load_cloud",
    "plot_extraction",
    "save_picture",
    "scan",
    "tube_mesh",
]
