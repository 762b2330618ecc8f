"""Settings of `explain`: bad ones are refused by name, and all are stored with the result."""

import pytest

from scan2flex_jax.inference import Settings


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"slab": 0.0}, "slab is 0.0; it must be positive"),
        ({"surprise": float("nan")}, "surprise is nan"),
        ({"found": 6.0}, "found exceeds named"),
    ],
)
def test_bad_settings_are_refused_by_name(wrong, said):
    with pytest.raises(ValueError, match=said):
        Settings(**wrong)


def test_there_are_few():
    assert len(Settings().to_json()) <= 25
