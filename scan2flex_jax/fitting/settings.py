"""`FitSettings`: the thresholds of a fit's validation, in one object that is passed in and stored with the result."""

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
class FitSettings(Settings):
    """Thresholds: when a residual is not noise, when a pose counts as predicted, and which interval is withheld.

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
