"""The example of docs/adding-an-effect.md, run as it stands there, against the closed form of a free cable."""

import re
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from scan2flex_jax.effects import add_kind, effect_of, parameters_of
from scan2flex_jax.effects.catalogue import _ADDED, _CLASSES, catalogue, entry_of
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.rod.model import CableModel, discretise
from scan2flex_jax.statics.solve import equilibrium
from scan2flex_jax.study import load_study, save_study
from scan2flex_jax.study.kinds import _KINDS, kind_format, kind_names
from scan2flex_jax.study.model import EffectDeclaration

from . import scene

ROOT = Path(__file__).parents[2]


BLOCKS = re.findall(r"```python\n(.*?)```", (ROOT / "docs/adding-an-effect.md").read_text(), re.S)


def of_block(k):
    """A test of one block of the page."""
    return pytest.mark.parametrize("page", [k], indirect=True, ids=[""])


@pytest.fixture
def page(request):
    """The names of one block of the page's code, and everything as it was afterwards."""
    before = [dict(table) for table in (_ADDED, _CLASSES, _KINDS)]
    names = {}
    exec(BLOCKS[request.param], names)
    yield names
    for table, old in zip((_ADDED, _CLASSES, _KINDS), before, strict=True):
        table.clear()
        table.update(old)


@pytest.fixture
def helical_set(page):
    return page["HelicalSet"]


@of_block(0)
def test_a_free_cable_takes_its_natural_shape(helical_set):
    """With the frame turning back as the curvature turns on, the cable is the helix of constant curvature and torsion: its
    axis distance per turn follows from k and 2 pi/pitch (helix of curvature k and torsion -2 pi/pitch in a fixed frame)."""
    k, pitch = 2.0, 0.5
    effect = effect_of("helical_set", {"curvature": [k, 0.0], "pitch": pitch})
    model = CableModel(scene.CABLE, jnp.zeros(3), (effect,))
    ends = scene.pose()
    free = replace(ends, held=ends.held.at[1].set(0.0))
    e = equilibrium(model, free, elements=160)
    assert e.verdict.solved, e.verdict.sentence()
    r = np.asarray(e.points)
    turn = 2 * np.pi / pitch
    w = np.hypot(k, turn)
    s = np.linspace(0.0, float(scene.CABLE.length), len(r))
    # a curve of curvature k and torsion w.r.t. its own frame of rate `turn`: a helix about an axis, chord known in closed form
    chord = np.sqrt((turn / w * s) ** 2 + (2 * k / w**2 * np.sin(w * s / 2)) ** 2)
    np.testing.assert_allclose(np.linalg.norm(r - r[0], axis=1), chord, atol=2e-4)


@of_block(0)
def test_it_is_known_everywhere(helical_set, tmp_path):
    assert "helical_set" in kind_names()
    assert entry_of("helical_set") in catalogue()
    given = {"curvature": np.array([0.3, -0.2]), "pitch": 0.4}
    back = parameters_of(effect_of("helical_set", given))
    np.testing.assert_allclose(back["curvature"], given["curvature"])
    study = load_study(ROOT / "tests/data/blind/cases/t001")
    save_study(replace(study, effects=(EffectDeclaration("helical_set", given),)), tmp_path / "study")
    assert load_study(tmp_path / "study").effects[0].kind == "helical_set"
    rods = [discretise(CableModel(scene.CABLE, scene.DOWN, e), scene.pose(), 8)
            for e in ((), entry_of("helical_set").build(jnp.zeros(2), {"pitch": 0.4}, scene.CONTEXT))]  # fmt: skip
    np.testing.assert_array_equal(rods[0].section.natural, rods[1].section.natural)


@of_block(0)
def test_a_name_that_is_taken_is_refused(helical_set):
    taken = type("Bend", (helical_set,), {"kind": "kink"})
    with pytest.raises(Scan2FlexError, match="taken"):
        add_kind(replace(entry_of("helical_set"), effect=taken))
    assert entry_of("kink").effect is not taken


@of_block(1)
def test_a_law_bends_as_it_says(page):
    """Pure bending: the moment is the derivative of the energy, smooth at zero, and the baseline if the scale is far."""
    EI, k, K = 0.02, 3.0, jnp.diag(jnp.array([1e5, 1e5, 1e4, 0.02, 0.02, 0.015]))
    effect = effect_of("cubic_bending", {"scale": 2.0})
    extra = jax.grad(effect.strain_energy)(jnp.zeros(6).at[4].set(k), K)
    np.testing.assert_allclose(EI * k + extra[4], EI * k * (1 + (k / 2.0) ** 2))
    np.testing.assert_array_equal(jax.hessian(effect.strain_energy)(jnp.zeros(6), K), np.zeros((6, 6)))
    assert kind_format("cubic_bending").parameter("scale").unit == "1/m"


@pytest.mark.slow
@of_block(2)
def test_a_law_of_any_form_is_fitted(page):
    """The simulated cable is linear, and its law is that of the paper's stiffness within its band."""
    found = page["found"]
    inside = found.reached & (found.at > 0)
    truth = 0.1 * found.at
    assert np.max(np.abs(found.moment - truth)[inside]) < 0.02 * np.max(truth[inside])
    assert page["result"].estimates["bending_stiffness"].value == pytest.approx(0.1, rel=0.05)


@of_block(3)
def test_a_bend_that_is_kept_is_the_set_of_the_pose_before(page):
    """As `memory_set` of the curvature of the pose before, whatever was before that."""
    K = jnp.diag(jnp.array([1e5, 1e5, 1e4, 0.02, 0.02, 0.015]))
    effect, strain = effect_of("kept_bend", {"part": 0.3}), jnp.array([0.0, 0.0, 0.0, 1.0, 2.0, 0.0])
    left = effect.leaves(strain, K, effect.without_history(1)[0], jnp.array(0.0))
    force = jax.grad(effect.energy_given)(jnp.array([0.0, 0.0, 0.0, 0.4, 0.0, 0.0]), K, left)
    np.testing.assert_allclose(force[3:], [-0.3 * 0.02 * 1.0, -0.3 * 0.02 * 2.0, 0.0])
    assert kind_format("kept_bend").memory == "order"


@pytest.mark.slow
@of_block(4)
def test_the_same_clamps_hold_two_shapes(page):
    """Bent further and back, the cable has kept a part of its bend: it sags less deep than on its first way there."""
    first, again = (np.asarray(page[name].points) for name in ("first", "again"))
    assert all(bool(page[name].verdict.solved) for name in ("first", "nearer", "again"))
    assert np.abs(first - again).max() > 2e-3
