"""Studies: one cable, measured in several poses, on disk and in memory.

`load_study` reads and checks, `Study.from_arrays` takes arrays, `check_study` checks a study made in memory, `save_study`
writes, `describe` summarises a study for a user, `study_schema` is the JSON schema of `study.toml`. No jax here.
"""

from scan2flex_jax.study.check import describe, study_warnings
from scan2flex_jax.study.facts import PoseFacts, pose_facts
from scan2flex_jax.study.kinds import CABLE, KindFormat, ParameterFormat, kind_format, kind_names, register_kind
from scan2flex_jax.study.model import (
    Angle,
    Clamp,
    EffectDeclaration,
    Markers,
    MeasuredCurve,
    Study,
    StudyPose,
    Tolerance,
    Unknown,
    Wrench,
)
from scan2flex_jax.study.outputs import write_json_atomic
from scan2flex_jax.study.read import load_study
from scan2flex_jax.study.schema import study_schema
from scan2flex_jax.study.sense import check_study
from scan2flex_jax.study.write import save_study

__all__ = [
    "CABLE", "Angle", "Clamp", "EffectDeclaration", "KindFormat", "Markers", "MeasuredCurve", "ParameterFormat", "PoseFacts",
    "Study", "StudyPose", "Tolerance", "Unknown", "Wrench", "check_study", "describe", "kind_format", "kind_names",
    "load_study", "pose_facts", "register_kind", "save_study", "study_schema", "study_warnings", "write_json_atomic",
]  # fmt: skip
