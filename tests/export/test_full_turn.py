"""A full turn of twist between the clamps, in MuJoCo, MJX and Genesis: no drift of the weld, and the shape that we export."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from scan2flex_jax import load_study
from scan2flex_jax.examples import example_path
from scan2flex_jax.export import export, hung
from tests.export.test_export import links as centred

GJ = 0.05  # N m^2: half of EI
FEW, STEPS = 10, 1000  # links and steps of 1 ms beside MuJoCo


@pytest.fixture(scope="module")
def study():
    study = load_study(example_path("simulated-cable"))
    turned = replace(study.pose("plane"), turns=1, curve=None)
    cable = {"length": 1.0, "length_density": 0.2, "bending_stiffness": 0.1, "torsional_stiffness": GJ}
    return replace(study, unknowns=(), cable=cable, poses=(turned,))


def in_mujoco(study, links, steps):
    """The model, and its data after these steps."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install mujoco")
    model = mujoco.MjModel.from_xml_string(export(study, "mujoco", elements=links))
    data = mujoco.MjData(model)
    for _ in range(steps):
        mujoco.mj_step(model, data)
    return model, data


@pytest.mark.slow
def test_a_cable_with_a_full_turn_stays_where_it_hangs(study):
    """Four seconds: links of the second order from their nodes (four times nearer with twice as many), the weld within a
    micrometre and a milliradian."""
    off = []
    for links in (20, 40):
        _, data = in_mujoco(study, links, 4000)
        there = centred(data, links, 1.0 / links)
        off.append(np.max(np.linalg.norm(there - hung(study, elements=links).position, axis=1)))
        end, clamp = data.site("end"), data.site("clamp")
        assert np.linalg.norm(end.xpos - clamp.xpos) < 1e-6
        assert np.linalg.norm(end.xmat - clamp.xmat) < 1e-3
    assert off[0] < 6e-3
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.15)


@pytest.mark.slow
def test_mjx_holds_it_as_mujoco_does(study):
    """On the CPU without fusion: XLA puts the kinematics of all links before into that of each, again and again."""
    mjx = pytest.importorskip("mujoco.mjx", reason="MJX is not installed: pip install mujoco-mjx")
    model, data = in_mujoco(study, FEW, STEPS)
    there, now = mjx.put_model(model), mjx.put_data(model, type(data)(model))
    step = jax.jit(mjx.step, compiler_options={"xla_disable_hlo_passes": "fusion"})
    for _ in range(STEPS):
        now = step(there, now)
    np.testing.assert_allclose(now.qpos, data.qpos, rtol=0, atol=1e-5)
    np.testing.assert_allclose(now.site_xpos[0], now.site_xpos[1], rtol=0, atol=1e-6)


@pytest.mark.slow
def test_genesis_holds_it_as_mujoco_does(study, tmp_path):
    """Its springs rest in the pose as loaded, whatever `springref` says; constant joint torques load them."""
    genesis = pytest.importorskip("genesis", reason="Genesis is not installed: pip install torch genesis-world")
    _, data = in_mujoco(study, FEW, STEPS)
    (tmp_path / "cable.xml").write_text(export(study, "mujoco", elements=FEW))
    genesis.init(backend=genesis.cpu, precision="64", logging_level="error")
    scene = genesis.Scene(sim_options=genesis.options.SimOptions(dt=1e-3), show_viewer=False)
    cable = scene.add_entity(genesis.morphs.MJCF(file=str(tmp_path / "cable.xml")))
    scene.build()
    cable.control_dofs_force(-cable.get_dofs_stiffness() * cable.get_qpos())
    for _ in range(STEPS):
        scene.step()
    np.testing.assert_allclose(cable.get_qpos().numpy(), data.qpos, rtol=0, atol=1e-5)
