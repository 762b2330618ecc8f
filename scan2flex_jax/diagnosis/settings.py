"""The thresholds of `explain`, in one object that is passed and stored with the result."""

from dataclasses import dataclass

from scan2flex_jax.errors import SettingsError
from scan2flex_jax.fitting.settings import NoiseSettings


@dataclass(frozen=True)
class DiagnosisSettings(NoiseSettings):
    """Priors of the noise (`NoiseSettings`), and thresholds; evidence is in nats over the model before.

    The test: ``level`` of the tests of the baseline model and of the residual given an effect, with ``draws`` of noise;
    ``same_size_level``, the level of the homogeneity test of the sizes of effects.

    Naming: ``lead_named`` and ``lead_favoured``, the least leads over the next effect type to be named and favoured; a smaller
    lead is a tie (13 of 14 wrong first places of the method's prototype led by less than three nats); ``field_lead``, the least
    lead of a discrepancy field over the best effects to replace them; ``most_effects`` of a set; ``least_evidence`` of an
    explanation over the baseline model; ``same_misfit``, the largest difference in chi-squared of two effect types that give
    the same shapes; ``visible``, the whitened length of one physical size from which the absence of an effect is a finding.

    Poses left out in turn: ``most_left``, the largest ratio of their error to the baseline model's for an effect to be found;
    ``worse``, the ratio above which an effect explains nothing; ``most_scatter``, the largest relative scatter between poses
    of a size; ``least_gain``, the relative difference of errors below which they count as equal; ``telling_poses``, the number
    of poses from which on the error decides between an effect and a wider one; ``certain_gain``, the standard errors of a gain
    that needs no lead in likelihood; ``overwhelming``, the evidence with which an effect is found if the error is no larger,
    since few poses, or poses of which one alone shows the effect, hardly predict one another.

    Poses that differ: log evidence (nats) of a discrepancy of each pose above which models are compared at their own floors,
    ``differing`` given effects without remaining structure, and ``scattered`` given the best pair of effects;
    ``beyond_stated``, the ratio of the estimated noise to the stated one above which it is not noise of the sensor alone.

    Intervals: if no effect is found, they include all models within ``likely`` nats of the likeliest, and for a single pose
    all whose squares are within ``near`` times those of the best.

    Data: ``scan_alike``, the standard deviation of the error of a scan's axis that is alike along a pose, over the radius
    (`benchmarks.scan_alarms`); ``prior_rows``, rows of unit variance that shrink the noise of a scanned pose to that of all;
    ``sharper``, the ratio to the first estimate below which a noise estimated given an effect replaces it; ``mesh_share``, the
    mesh error over the noise above which the mesh is refined, up to ``most_elements``.

    Mistakes of the input: ``outdone``, the ratio of an effect's RMS error to that of the corrected study below which the effect
    is the explanation; ``outdone_without``, the same over the other poses of a study in which one pose does not fit.

    Doubts: a noise is conspicuous above ``smooth`` (correlated over white part; with fewer than ``telling_points`` in a pose
    any) and ``large_noise`` (over the length), unless stated; a residual of scans below ``fine`` (over the radius) may be an
    error of their axis.
    """

    level: float = 0.05
    draws: int = 400
    same_size_level: float = 0.001
    lead_named: float = 5.0
    lead_favoured: float = 3.0
    field_lead: float = 20.0
    most_effects: int = 3
    most_left: float = 0.7
    worse: float = 2.0
    most_scatter: float = 0.6
    differing: float = 5.0
    scattered: float = 30.0
    beyond_stated: float = 2.0
    likely: float = 8.0
    near: float = 4.0
    least_evidence: float = 1.0
    same_misfit: float = 4.0
    visible: float = 3.0
    least_gain: float = 0.05
    telling_poses: int = 3
    certain_gain: float = 2.0
    overwhelming: float = 50.0
    scan_alike: float = 0.01
    prior_rows: float = 10.0
    sharper: float = 0.9
    mesh_share: float = 0.2
    most_elements: int = 160
    smooth: float = 3.0
    telling_points: int = 5
    large_noise: float = 0.002
    fine: float = 0.1
    outdone: float = 0.9
    outdone_without: float = 1.5
    correlation_spread: float = 0.6
    longest_correlation: float = 0.3

    def __post_init__(self):
        """Check levels and the order of the leads, after the signs."""
        super().__post_init__()
        if not self.level < 1 or not self.same_size_level < 1:
            raise SettingsError("DiagnosisSettings: level and same_size_level are probabilities, below 1")
        if self.lead_favoured > self.lead_named:
            raise SettingsError("DiagnosisSettings: lead_favoured exceeds lead_named")


USUAL = DiagnosisSettings()
