"""The choices on which the belief in a fit rests, in one object that is passed, and stored with the result."""

from dataclasses import asdict, dataclass

from scan2flex_jax.errors import SettingsError


@dataclass(frozen=True)
class Settings:
    """Positive numbers with names, checked when they are made. Raises `SettingsError` with the name of a bad one."""

    def __post_init__(self):
        """Bad values end in a sentence that names the setting."""
        for name, value in asdict(self).items():
            if not value > 0:
                raise SettingsError(f"{type(self).__name__}: {name} is {value}; it must be positive")

    def to_json(self) -> dict:
        """All of them, by their names."""
        return asdict(self)


@dataclass(frozen=True)
class FitSettings(Settings):
    """When the residual of a fit is no noise, when a pose counts as predicted, and which interval is no information.

    No noise: a residual ``beyond_noise`` times the noise that is stated or that the points show, and beyond ``largest_noise``
    of the length where none is stated; one that varies slowly along the cable, its correlated part ``slow`` times the white
    one and alike over ``long`` of the length, unless it is within ``mesh`` of the length, as the error of the mesh may be.

    Predicted: a validate pose whose RMS distance is within ``predicted`` times the noise and what tolerances and the errors of
    the estimates do to it, which is said where it exceeds ``felt`` of the noise.

    ``vaguest_interval``: standard deviation of the logarithm of a value beyond which its interval is withheld.
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
