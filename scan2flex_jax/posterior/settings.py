"""Every number that decides what `fit` and `explain` answer, in one object that is passed and stored with the result.

Log probabilities are in nats. What limits the work alone (refits, iterations) stands beside the code.
"""

from dataclasses import asdict, dataclass

from scan2flex_jax.errors import SettingsError

FEWEST = 3  # poses, or groups of repeats, that can establish anything

ODDS = {
    "natural_curvature": 1.0, "kink": 1.0, "stiffness_profile": 1.0, "stiffness_taper": 1.0, "stiffness_field": 1.0,
    "density_profile": 1.0, "density_taper": 1.0, "point_mass": 1.0, "elastic_clamp": 1.0, "clamp_rotation": 1.0,
    "clamp_offset": 1.0, "scan_scale": 1.0, "scan_offset": 1.0,
    "length_error": 0.1,  # a length is measured with a tape
    "anisotropic_bending": 0.3, "nonlinear_bending": 0.3, "extensibility": 0.3, "memory_set": 0.3, "uniform_load": 0.3,
    "support_plane": 0.3,  # a table is seen
    "bend_twist_coupling": 0.1, "tension_twist_coupling": 0.1, "tension_stiffening": 0.1,  # of strands laid in a helix
    "point_load": 0.1, "elastic_support": 0.1,  # a body beside the cable
    "tether": 0.03,  # a string and an anchor that nobody mentions
}  # fmt: skip
"""Prior odds of every effect type that is searched for against a common one, such as a bend by nature, a taper or a mass; 1 for
one that a user adds. A hundred in a log evidence of 4.6 nats: strong data outweigh them, a tie they decide."""


def odds(kind: str) -> float:
    """Prior odds of an effect type against a common one."""
    return ODDS.get(kind, 1.0)


@dataclass(frozen=True)
class Settings:
    """Priors of the generative model and of hypotheses, and the thresholds of validation and of the eight decisions.

    Noise: a ``stated`` one is known to this standard deviation of its logarithm; an unstated one is ``usual_noise`` of the
    length, to a factor of ``noise_factor``; its correlation length is ``correlation`` of the length, with a spread of its
    logarithm of ``correlation_spread``. ``axis``: error of the axis of a scan over its radius, correlated over ``axis_length``
    of the length (`benchmarks.scan_alarms`).

    Discrepancy of each pose: its size is half-Cauchy of ``usual_discrepancy`` of the curvature of the poses, and it costs
    ``discrepancy`` to have one at all: prior odds of e^-2, and the width of its size's posterior over that of its prior.

    Validation: a residual is no noise above ``beyond_noise`` times the noise that is stated or shown by the points, and above
    ``largest_noise`` of the length if none is stated; above ``moved`` of what a factor of e in the values moves the points, it
    is large whatever the length (right studies with noise: 0.05 at most). Unstated noise is conspicuously smooth where its
    correlated part exceeds ``smooth`` times the white one, and its length or size as many times the usual one. A validate pose
    contradicts the model from ``surprise`` times the distance that noise, discrepancy, tolerances and errors of the estimates
    let expect. An interval is withheld above a standard deviation ``vaguest_interval`` of the logarithm.

    Hypotheses: ``effect`` is the prior cost of each effect beyond the choice of its kind and place, ``turn`` that of a full
    turn in a pose (5 % of poses are a turn off, one way or the other), ``mistake`` that of a mistake of the input, and so the
    most that one pose can say for a hypothesis. Sets have at most ``most_effects``.

    Validate poses that are off by more than ``untested`` of the length are no evidence, even where tolerances allow as much.

    Mistakes of the input are looked for in a fit that is ``doubtful`` of the length off, or ``beyond_noise`` times a stated
    noise. A correction is likely that brings the points ``corrected`` times nearer, as missing physics seldom does
    (docs/mistakes.md), and to ``close`` of the length at least, which real cables may leave; so are others up to ``alike``
    times the distance of the best. A single pose is reported as the one that does not fit from ``alone`` of the length on; a
    single reading up to the probability ``outlier`` of so large an outlier, or ``gross`` of one that is large against what the
    values move.

    Decisions (`posterior.decision`): ``found``, the least difference (nats) in log predictive density by which a hypothesis
    leads; ``tied``, that over its rivals, and ``named``, that of an effect that is named; ``same_misfit``, the difference in
    chi-squared up to which effects with the same shapes are tied; ``averaged``, the difference in evidence up to which models
    are in the intervals; ``explains``, the share of the unexplained displacement that effects beside a discrepancy leave at
    most; ``mesh_share``, the mesh error over the noise above which the mesh is refined, up to ``most_elements``.

    Raises:
        SettingsError: A number is not positive, ``noise_factor`` is no factor, or ``found`` exceeds ``named``.
    """

    stated: float = 0.15
    usual_noise: float = 1.0e-3
    noise_factor: float = 5.0
    correlation: float = 0.07
    correlation_spread: float = 0.8
    axis: float = 0.01
    axis_length: float = 0.2
    usual_discrepancy: float = 0.03
    discrepancy: float = 8.0
    beyond_noise: float = 3.0
    largest_noise: float = 0.01
    moved: float = 0.2
    smooth: float = 3.0
    surprise: float = 2.0
    vaguest_interval: float = 5.0
    effect: float = 1.0
    turn: float = 3.7
    mistake: float = 5.0
    untested: float = 0.025
    most_effects: int = 3
    doubtful: float = 0.004
    corrected: float = 3.0
    close: float = 0.03
    alike: float = 1.3
    alone: float = 0.03
    outlier: float = 0.01
    gross: float = 0.05
    found: float = 4.0
    named: float = 5.0
    tied: float = 3.0
    same_misfit: float = 4.0
    averaged: float = 8.0
    explains: float = 0.7
    mesh_share: float = 0.2
    most_elements: int = 160

    def __post_init__(self):
        """Raise `SettingsError` with the name of an invalid number."""
        for name, value in asdict(self).items():
            if not value > 0:
                raise SettingsError(f"Settings: {name} is {value}; it must be positive")
        if not self.noise_factor > 1.0:
            raise SettingsError(f"Settings: noise_factor is {self.noise_factor}; it must exceed 1")
        if self.found > self.named:
            raise SettingsError("Settings: found exceeds named")

    def to_json(self) -> dict:
        """All of them, by their names."""
        return asdict(self)


USUAL = Settings()
