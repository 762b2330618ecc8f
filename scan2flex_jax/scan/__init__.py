"""From a scanned point cloud to a centre curve (paper, Section 4), and a simulated scanner for its tests.

Modules, in the order of the chain:

=====================  =================================================================================
`extraction`           the whole chain, for one cloud, one pose or all scans of a study
`cloud`                reading, checking, cleaning and thinning a point cloud
`guide_points`         a coarse curve from the points that the user marked
`coarse_curve`         a coarse curve without guide points: every point votes for the axis
`strand_matching`      nodes of the votes chained into strands, joined from clamp to clamp
`snakes`               the paper's energy of a curve (Eq. 8)
`snakes_minimisers`    four minimisers of that energy
`refine`               the most probable smooth curve, and its standard deviation
`sensor_noise`         mixture of honest, flying and stray points, which sets the weights of `refine`
`plausibility`         reasons to doubt the extracted curve
`centre_curve`         the result: points, frames, standard deviation, gaps, warnings
`picture`              its plot
`spline`               the curve representation shared by all
`scanner`, `shapes`    simulated scans of known curves
=====================  =================================================================================
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
