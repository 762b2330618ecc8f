"""Fixtures of the tests that type what a notebook's user types."""

import jaxtyping
import pytest


@pytest.fixture
def as_a_user_runs_it():
    """Arguments are not checked against annotations, which would come before the package's own sentences."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)
