"""`FitSettings`: the priors of noise and discrepancy and the thresholds of a fit's validation, stored with its result."""

from dataclasses import asdict, dataclass

from scan2flex_jax.errors import SettingsError


@dataclass(frozen=True)
class Settings:
    """Positive named numbers, checked on construction. Raises `SettingsError` with the name of an invalid one."""

    def __post_init__(self):
        """Raise `SettingsError` for a value that is not positive."""
        for name, value in asdict(self).items():
            if not value > 0:
                raise SettingsError(f"{type(self).__name__}: {name} is {value}; it must be positive")

    def to_json(self) -> dict:
        """All of them, by their names."""
        return asdict(self)


@dataclass(frozen=True)
class NoiseSettings(Settings):
    """Log-normal priors of the noise of measured shapes and of the discrepancy (`fitting.noise`, `fitting.discrepancy`).

    Size of the noise: a stated one is known to ``stated_spread`` (standard deviation of its logarithm); an unstated one, where
    the prior applies, is ``usual_noise`` of the length, to a factor of ``noise_factor``, and with a discrepancy at most
    ``most_noise`` of the length. ``cloud_spread``: standard deviation of the logarithm of the noise of a cloud's points about
    their scatter.

    Correlation length: median ``usual_correlation`` of the length, ``correlation_spread`` of its logarithm, at most
    ``longest_correlation`` of the length.

    Discrepancy: median ``usual_discrepancy`` of the curvature of the poses, ``discrepancy_spread`` of its logarithm; it must
    gain ``discrepancy_gain`` nats over the most likely noise alone.
    """

    usual_noise: float = 1.0e-3
    noise_factor: float = 5.0
    most_noise: float = 5.0e-3
    stated_spread: float = 0.15
    cloud_spread: float = 0.4
    usual_correlation: float = 0.07
    correlation_spread: float = 0.8
    longest_correlation: float = 0.5
    usual_discrepancy: float = 0.03
    discrepancy_spread: float = 1.5
    discrepancy_gain: float = 2.0

    def __post_init__(self):
        """Raise `SettingsError` for a factor that is none, after the signs."""
        super().__post_init__()
        if not self.noise_factor > 1.0:
            raise SettingsError(f"{type(self).__name__}: noise_factor is {self.noise_factor}; it must exceed 1")


@dataclass(frozen=True)
class FitSettings(NoiseSettings):
    """Priors of the noise (`NoiseSettings`), and thresholds: when a residual is not noise, when a pose counts as predicted, and
    which interval is withheld.

    Not noise: a residual above ``beyond_noise`` times the noise that is stated or shown by the points, and above
    ``largest_noise`` of the length if none is stated; or one that varies slowly along the cable (correlated part above ``slow``
    times the white part, correlation length above ``long`` of the length) and exceeds ``mesh`` of the length, a bound of the
    mesh error.

    Predicted: a validate pose whose RMS distance is within ``predicted`` times the noise combined with the propagated
    uncertainty of tolerances and estimates; that uncertainty is reported above ``felt`` of the noise.

    ``vaguest_interval``: standard deviation of the logarithm of a value above which its interval is withheld.
    """

    beyond_noise: float = 3.0
    largest_noise: float = 0.01
    slow: float = 3.0
    long: float = 0.2
    mesh: float = 5.0e-5
    predicted: float = 1.5
    felt: float = 0.3
    vaguest_interval: float = 5.0


USUAL = FitSettings()
