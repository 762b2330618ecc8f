"""From a scanned point cloud to a centre curve (paper, Section 4), and a scanner that makes clouds to test it with.

In the order in which a scan goes through them:

=====================  =================================================================================
`extraction`           the whole chain, for one cloud, one pose or all scans of a study
`cloud`                reading a file, checking, cleaning and thinning its points
`guide_points`         a coarse curve from the points that the user marked
`coarse_curve`         a coarse curve without them: points vote for the axis
`strand_matching`      the votes' nodes drawn into strands, which are joined from clamp to clamp
`snakes`               the paper's energy of a curve (Eq. 8)
`snakes_minimisers`    four ways to minimise it
`refine`               the most probable smooth curve, and its standard deviation
`sensor_noise`         honest, flying and stray points: the mixture that `refine` weighs them by
`plausibility`         reasons to doubt that the curve is the cable's
`centre_curve`         the answer: points, frames, standard deviation, gaps, warnings
`picture`              a picture of it
`fit_points`           beside the chain: the points of a scan for a fit without a centre curve
`spline`               the curve that all of them share
`scanner`, `shapes`    simulated scans of known curves
=====================  =================================================================================
"""

from scan2flex_jax.scan.centre_curve import CentreCurve, RadiusStatistics
from scan2flex_jax.scan.cloud import Cloud, load_cloud
from scan2flex_jax.scan.extraction import extract, extract_pose, extract_study
from scan2flex_jax.scan.fit_points import NearCurve, near_curve
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
    "NearCurve",
    "RadiusStatistics",
    "Scan",
    "Sensor",
    "extract",
    "extract_pose",
    "extract_study",
    "load_cloud",
    "near_curve",
    "plot_extraction",
    "save_picture",
    "scan",
    "tube_mesh",
]
