"""From foreign measurements to a study: units, frames of robots and trackers, centre curves of other tools, a new study.

All results are types of `scan2flex_jax.study`, in SI units. No jax here.
"""

from scan2flex_jax.convert.bench import TESTS, Bench, bench_study
from scan2flex_jax.convert.bench_table import read_table, table_of
from scan2flex_jax.convert.curves import CurveFile, read_foreign_curve
from scan2flex_jax.convert.folder import MeasuredFile, folder_of, measured_files
from scan2flex_jax.convert.frames import (
    CONVENTIONS,
    axes_of,
    check_convention,
    clamp_of_angles,
    clamp_of_matrix,
    clamp_toml,
    other_tangent,
    read_frames,
    sequence_of,
)
from scan2flex_jax.convert.motion_capture import read_arc_lengths
from scan2flex_jax.convert.start import frames_of_bodies, new_study
from scan2flex_jax.convert.units import length_unit, measured, quantity
from scan2flex_jax.study.tables import LENGTHS

__all__ = [
    "CONVENTIONS",
    "LENGTHS",
    "TESTS",
    "Bench",
    "CurveFile",
    "MeasuredFile",
    "axes_of",
    "bench_study",
    "check_convention",
    "clamp_of_angles",
    "clamp_of_matrix",
    "clamp_toml",
    "folder_of",
    "frames_of_bodies",
    "length_unit",
    "measured",
    "measured_files",
    "new_study",
    "other_tangent",
    "quantity",
    "read_arc_lengths",
    "read_foreign_curve",
    "read_frames",
    "read_table",
    "sequence_of",
    "table_of",
]
