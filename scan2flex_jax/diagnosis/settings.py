"""The thresholds of `explain`, in one object that is passed and stored with the result."""

from dataclasses import dataclass

from scan2flex_jax.errors import SettingsError
from scan2flex_jax.fitting.settings import Settings


@dataclass(frozen=True)
class DiagnosisSettings(Settings):
    """Thresholds of the test, of naming and of homogeneity; evidence is in nats over the model before.

    The test: ``level`` of the tests of the baseline model and of the residual given an effect, with ``draws`` of noise;
    ``same_size_level``, the level of the homogeneity test of a single effect.

    Naming: ``lead_named`` and ``lead_favoured``, the least leads over the next effect type to be named and favoured; a smaller
    lead is a tie (13 of 14 wrong first places of the method's prototype led by less than three nats); ``field_lead``, the least
    lead of a discrepancy field over the best effects to replace them; ``most_effects`` of a set.

    Poses left out in turn: ``most_left``, the largest ratio of their error to the baseline model's for an effect to be found;
    ``worse``, the ratio above which an effect explains nothing; ``most_scatter``, the largest relative scatter between poses
    of a size.

    Poses that differ: log evidence (nats) of a discrepancy of each pose above which models are compared at their own floors,
    ``differing`` given effects without remaining structure, and ``scattered`` given the best pair of effects.

    Intervals: if no effect is found, they include all models within ``likely`` nats of the likeliest, and for a single pose
    all whose squares are within ``near`` times those of the best.

    Data: ``scan_alike``, the standard deviation of the error of a scan's axis that is alike along a pose, over the radius
    (`benchmarks.scan_alarms`); ``mesh_share``, the mesh error over the noise above which the mesh is refined, up to
    ``most_elements``.
    """

    level: float = 0.05
    draws: int = 400
    same_size_level: float = 0.02
    lead_named: float = 5.0
    lead_favoured: float = 3.0
    field_lead: float = 20.0
    most_effects: int = 3
    most_left: float = 0.7
    worse: float = 2.0
    most_scatter: float = 0.6
    differing: float = 5.0
    scattered: float = 30.0
    likely: float = 8.0
    near: float = 4.0
    scan_alike: float = 0.01
    mesh_share: float = 0.2
    most_elements: int = 160

    def __post_init__(self):
        """Check levels and the order of the leads, after the signs."""
        super().__post_init__()
        if not self.level < 1 or not self.same_size_level < 1:
            raise SettingsError("DiagnosisSettings: level and same_size_level are probabilities, below 1")
        if self.lead_favoured > self.lead_named:
            raise SettingsError("DiagnosisSettings: lead_favoured exceeds lead_named")


USUAL = DiagnosisSettings()
