"""The choices on which the answer of `explain` rests, in one object that is passed, and stored with the result."""

from dataclasses import dataclass

from scan2flex_jax.errors import SettingsError
from scan2flex_jax.fitting.settings import Settings


@dataclass(frozen=True)
class DiagnosisSettings(Settings):
    """What counts as missing, as found and as one size; evidence is in nats over the model before.

    The test: ``level`` of the tests of the plain rod and of what is left beside an effect, with ``draws`` of noise;
    ``same_size_level``, that of a single effect having one size in all poses.

    Naming: ``lead_named`` and ``lead_favoured``, the leads over the next kind from which on a kind is named and favoured, less
    is a tie (13 of 14 wrong first places of the method's prototype led by less than three); ``field_lead``, by how much a field
    along the cable must be likelier than the best kinds to stand in for them; ``most_effects`` of a set.

    Poses left out in turn: ``most_left``, the share of their error above which an effect takes too little away to be found;
    ``worse``, times the plain rod's error, beyond which an effect explains nothing; ``most_scatter``, the relative scatter of a
    size between poses beyond which it is no size.

    Poses that differ: nats that a discrepancy of each pose gains beside effects that leave no structure, ``differing``, and
    beside the best pair of effects, ``scattered``, from which on models are compared at their own floors.

    Intervals: where nothing was found they are taken over all models within ``likely`` nats of the likeliest, and from a single
    pose over all whose squares are within ``near`` times those of the best.

    Data: ``scan_alike``, the standard deviation of the error of a scan's axis that is alike along a pose, over the radius
    (`benchmarks.scan_alarms`); ``mesh_share``, the mesh error over the noise beyond which the mesh is refined, up to
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
        """Probabilities and leads have an order beside being positive."""
        super().__post_init__()
        if not self.level < 1 or not self.same_size_level < 1:
            raise SettingsError("DiagnosisSettings: level and same_size_level are probabilities, below 1")
        if self.lead_favoured > self.lead_named:
            raise SettingsError("DiagnosisSettings: lead_favoured exceeds lead_named")


USUAL = DiagnosisSettings()
