"""One explanation for all tests of this folder."""

import pytest

from scan2flex_jax.inference import explain

from . import scenes


@pytest.fixture(scope="session")
def clip():
    """Four poses of a cable with an undeclared clip, and one for validation."""
    return explain(scenes.case("t004", unseen=("p7",)), elements=40, mesh=False)
