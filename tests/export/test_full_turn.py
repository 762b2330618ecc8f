"""A full turn of twist between the clamps, in MuJoCo: no drift of the weld, and the shape that we export."""

from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax import load_study
from scan2flex_jax.examples import example_path
from scan2flex_jax.export import export, hung

GJ = 0.05  # N m^2: half of EI


@pytest.mark.slow
def test_a_cable_with_a_full_turn_stays_where_it_hangs():
    """Four seconds: links of the second order from their nodes (four times nearer with twice as many), the weld within a
    micrometre and a milliradian."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install mujoco")
    study = load_study(example_path("simulated-cable"))
    turned = replace(study.pose("plane"), turns=1, curve=None)
    cable = {"length": 1.0, "length_density": 0.2, "bending_stiffness": 0.1, "torsional_stiffness": GJ}
    study, off = replace(study, unknowns=(), cable=cable, poses=(turned,)), []
    for links in (20, 40):
        model = mujoco.MjModel.from_xml_string(export(study, "mujoco", elements=links))
        data = mujoco.MjData(model)
        while data.time < 4.0:
            mujoco.mj_step(model, data)
        bodies = [data.body(f"link{k}") for k in range(links + 1)]
        there = np.array([b.xpos + 0.5 / links * b.xmat.reshape(3, 3)[:, 2] for b in bodies])
        off.append(np.max(np.linalg.norm(there - hung(study, elements=links).position, axis=1)))
        end, clamp = data.site("end"), data.site("clamp")
        assert np.linalg.norm(end.xpos - clamp.xpos) < 1e-6
        assert np.linalg.norm(end.xmat - clamp.xmat) < 1e-3
    assert off[0] < 6e-3
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.15)
