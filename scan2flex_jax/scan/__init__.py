"""From a scanned point cloud to a centre curve (paper, Section 4), and a scanner that makes clouds to test it with."""

from scan2flex_jax.scan.centre_curve import CentreCurve, RadiusStatistics
from scan2flex_jax.scan.cloud import Cloud, load_cloud
from scan2flex_jax.scan.extraction import extract, extract_pose, extract_study
from scan2flex_jax.scan.near import NearCurve, near_curve
from scan2flex_jax.scan.picture import plot_extraction, save_picture
from scan2flex_jax.scan.scanner import PERFECT, STRUCTURED_LIGHT, TIME_OF_FLIGHT, Scan, Sensor, scan, tube_mesh
from scan2flex_jax.scan.strands import End

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
