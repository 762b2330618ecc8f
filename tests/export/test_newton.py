"""`to_newton`: the rod that Newton's own importer makes of the OpenUSD file, and what is said without Newton."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax import Scan2FlexError, load_study
from scan2flex_jax.examples import example_path
from scan2flex_jax.export import export, to_newton

LINKS = 12


@pytest.fixture(scope="module")
def study():
    found = load_study(example_path("simulated-cable"))
    return replace(found, unknowns=(), cable=found.cable | {"bending_stiffness": 0.1, "torsional_stiffness": 0.25})


def test_without_newton_a_sentence_says_what_to_install(study, monkeypatch):
    monkeypatch.setitem(sys.modules, "newton", None)
    with pytest.raises(Scan2FlexError, match="pip install newton"):
        to_newton(study, None)


def test_the_rod_is_that_of_the_importer_with_its_ends_held(study, tmp_path):
    newton = pytest.importorskip("newton")
    pytest.importorskip("pxr")
    (tmp_path / "cable.usda").write_text(export(study, "usd", pose="twist-90", elements=LINKS))
    own, imported = newton.ModelBuilder(), newton.ModelBuilder()
    bodies, joints = to_newton(study, own, pose="twist-90", elements=LINKS)
    imported.add_usd(str(tmp_path / "cable.usda"))
    mine, theirs = own.finalize(device="cpu"), imported.finalize(device="cpu")
    for name in ("joint_X_p", "joint_X_c", "joint_rest_q", "joint_stiffness", "joint_target_ke", "joint_type", "body_com"):
        a, b = getattr(mine, name).numpy(), getattr(theirs, name).numpy()
        np.testing.assert_allclose(a, b[: len(a)], rtol=1e-5, atol=2e-5, err_msg=name)
    a, b = mine.body_q.numpy(), theirs.body_q.numpy()
    np.testing.assert_allclose(a[:, :3], b[:, :3], atol=2e-5)
    np.testing.assert_allclose(np.abs(np.sum(a[:, 3:] * b[:, 3:], axis=1)), 1.0, atol=1e-5)  # quaternions of either sign
    masses = mine.body_mass.numpy()
    np.testing.assert_allclose(masses[1:-1], theirs.body_mass.numpy()[1:-1], rtol=1e-6)
    assert masses[bodies[0]] == masses[bodies[-1]] == 0.0  # clamped at both ends: Newton does not move them
    assert len(joints) == len(bodies) - 1 == LINKS
