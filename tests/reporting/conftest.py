"""One fit for all tests of this folder."""

from dataclasses import replace

import pytest

from scan2flex_jax.examples import example_path
from scan2flex_jax.inference import fit
from scan2flex_jax.study import load_study
from tests.reporting.scenes import EVIL


@pytest.fixture(scope="package")
def fitted():
    """The fit of a study whose title and a pose's name are markup."""
    study = load_study(example_path("simulated-cable"))
    poses = (replace(study.poses[0], name=EVIL), *study.poses[1:])
    return fit(replace(study, title=EVIL, poses=poses))
