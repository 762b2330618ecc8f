"""`to_newton`: the rod that Newton's own importer makes of the OpenUSD file; the moduli that Isaac Lab takes."""

import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.simulators import settled
from scan2flex_jax import Scan2FlexError, load_study
from scan2flex_jax.examples import example_path
from scan2flex_jax.export import export, hung, isaac_lab_material, to_newton
from scan2flex_jax.study import Clamp, EffectDeclaration, Study, StudyPose

LINKS = 12


@pytest.fixture(scope="module")
def study():
    found = load_study(example_path("simulated-cable"))
    return replace(found, unknowns=(), cable=found.cable | {"bending_stiffness": 0.1, "torsional_stiffness": 0.25})


def test_without_newton_a_sentence_says_what_to_install(study, monkeypatch):
    monkeypatch.setitem(sys.modules, "newton", None)
    with pytest.raises(Scan2FlexError, match="pip install newton"):
        to_newton(study, None)


@pytest.fixture
def imported(study, tmp_path, recwarn):
    """Newton, the builder with our file in it, the cable's bodies, and what the importer warned of."""
    newton = pytest.importorskip("newton", reason="Newton is not installed: pip install 'newton[importers]'")
    pytest.importorskip("pxr", reason="OpenUSD is not installed: pip install 'newton[importers]'")
    (tmp_path / "cable.usda").write_text(export(study, "usd", pose="twist-90", elements=LINKS))
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, -9.81))
    builder.add_usd(str(tmp_path / "cable.usda"))
    bodies = [k for k, label in enumerate(builder.body_label) if "Cable" in label]
    return newton, builder, bodies, [str(w.message) for w in recwarn if "newton" in w.category.__name__.lower()]


def test_both_ways_give_the_same_rod_and_no_warning(study, imported):
    newton, builder, links, warned = imported
    assert warned == []
    own = newton.ModelBuilder(gravity=(0.0, 0.0, -9.81))
    bodies, joints = to_newton(study, own, pose="twist-90", elements=LINKS)
    mine, theirs = own.finalize(device="cpu"), builder.finalize(device="cpu")
    a, b = (m.joint_type.numpy() for m in (mine, theirs))
    rods = [np.flatnonzero(kinds == newton.JointType.ROD) for kinds in (a, b)]
    for name in ("joint_X_p", "joint_X_c"):
        a, b = getattr(mine, name).numpy()[rods[0]], getattr(theirs, name).numpy()[rods[1]]
        np.testing.assert_allclose(a, b, rtol=1e-5, atol=2e-5, err_msg=name)
    np.testing.assert_allclose(stiffnesses(mine, rods[0]), stiffnesses(theirs, rods[1]), rtol=1e-5)
    a, b = mine.body_q.numpy()[bodies], theirs.body_q.numpy()[links]
    np.testing.assert_allclose(a[:, :3], b[:, :3], atol=2e-5)
    np.testing.assert_allclose(np.abs(np.sum(a[:, 3:] * b[:, 3:], axis=1)), 1.0, atol=1e-5)  # quaternions of either sign
    masses = mine.body_mass.numpy()[bodies]
    np.testing.assert_allclose(masses[1:-1], theirs.body_mass.numpy()[links][1:-1], rtol=1e-6)
    assert masses[0] == masses[-1] == 0.0  # clamped at both ends: Newton does not move them
    assert len(joints) == len(bodies) - 1 == LINKS


def stiffnesses(model, joints):
    """Rows of stretch, shear, bending, twist of each joint."""
    start = model.joint_qd_start.numpy()
    return np.array([model.joint_target_ke.numpy()[start[j] : start[j + 1]] for j in joints])


@pytest.mark.slow
def test_both_ways_hang_alike(study, imported):
    newton, builder, links, _ = imported
    own = newton.ModelBuilder(gravity=(0.0, 0.0, -9.81))
    bodies, _ = to_newton(study, own, pose="twist-90", elements=LINKS)
    called, read = settled(own, bodies, 960), settled(builder, links, 960)
    assert np.max(np.linalg.norm(called - read, axis=1)) < 3e-3  # m: ball joints hold the clamps of the file less exactly
    assert np.max(np.linalg.norm(called - hung(study, "twist-90", LINKS).position, axis=1)) < 1.5e-2


def test_isaac_lab_takes_moduli_that_give_the_stiffnesses_back(study):
    """Sections of a full circle: EA = E pi r^2, EI = E pi r^4/4, GJ = G pi r^4/2, mass per length = density pi r^2."""
    given = replace(study, cable=study.cable | {"radius": 0.004, "axial_stiffness": 2e4, "shear_stiffness": 1e4})
    m = isaac_lab_material(given, pose="plane", elements=LINKS)
    area, r = np.pi * 0.004**2, 0.004
    assert m["thickness"] == 2 * r
    assert m["density"] * area == pytest.approx(0.2)
    assert (m["stretch_stiffness"] * area, m["shear_stiffness"] * area) == pytest.approx((2e4, 1e4))
    assert m["bend_stiffness"] * area * r**2 / 4 == pytest.approx(0.1)
    assert m["twist_stiffness"] * area * r**2 / 2 == pytest.approx(0.25)


def test_newton_reads_the_moduli_of_isaac_lab_as_our_stiffnesses(study, imported, tmp_path):
    """Isaac Lab writes its material as `physics:bendStiffness` and the like, which Newton's importer multiplies."""
    newton, builder, *_ = imported
    text = (tmp_path / "cable.usda").read_text()
    for name, value in isaac_lab_material(study, pose="twist-90", elements=LINKS).items():
        mode = name.removesuffix("_stiffness")
        text = re.sub(rf"physics:curves{mode.title()}Stiffness = \S+", f"physics:{mode}Stiffness = {value:.9g}", text)
    assert "curvesBend" not in text
    (tmp_path / "moduli.usda").write_text(text)
    other = newton.ModelBuilder()
    with pytest.warns(newton.NewtonDeprecationWarning):
        other.add_usd(str(tmp_path / "moduli.usda"))
    a, b = (x.finalize(device="cpu") for x in (builder, other))
    rods = np.flatnonzero(a.joint_type.numpy() == newton.JointType.ROD)
    np.testing.assert_allclose(stiffnesses(a, rods), stiffnesses(b, rods), rtol=1e-5)


def rod_of(study, **options):
    """Newton, the model with our rod, and the indices of its joints."""
    newton = pytest.importorskip("newton", reason="Newton is not installed: pip install 'newton[importers]'")
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, -9.81))
    bodies, joints = to_newton(study, builder, elements=LINKS, **options)
    return newton, builder, bodies, joints


def test_a_profile_of_stiffness_reaches_every_joint(study):
    """EI and GJ of a taper at the middles of the elements, over their length."""
    taper = EffectDeclaration("stiffness_taper", {"taper": 0.8})
    varied = replace(study, effects=(taper,))
    _, builder, _, joints = rod_of(varied, pose="plane")
    found = stiffnesses(builder.finalize(device="cpu"), joints)
    cable = hung(varied, "plane", LINKS)
    ds = 1.0 / LINKS
    np.testing.assert_allclose(found[:, 3], cable.stiffness[:, 3, 3] / ds, rtol=1e-6)
    np.testing.assert_allclose(found[:, 5], cable.stiffness[:, 5, 5] / ds, rtol=1e-6)
    assert found[-1, 3] / found[0, 3] == pytest.approx(np.exp(2 * 0.8 * (1 - ds)), rel=0.02)
    with pytest.raises(Scan2FlexError, match="a stiffness that varies along the cable"):
        export(varied, "usd", pose="plane", elements=LINKS)


SHARE, SLIP = 0.6, 1.0


def remembering(study):
    return replace(study, effects=(EffectDeclaration("dahl", {"share": SHARE, "slip_curvature": SLIP}),))


def test_friction_of_dahl_is_set_on_the_joints_of_this_rod_only(study):
    _, builder, _, joints = rod_of(remembering(study), pose="plane")
    to_newton(study, builder, pose="plane", elements=LINKS)
    model, ds = builder.finalize(device="cpu"), 1.0 / LINKS
    eps, tau = model.vbd.dahl_eps_max.numpy(), model.vbd.dahl_tau.numpy()
    np.testing.assert_allclose(eps[joints], ds * SLIP * SHARE / (1 - SHARE), rtol=1e-6)
    np.testing.assert_allclose(tau[joints], ds * SLIP, rtol=1e-6)
    assert np.count_nonzero(eps) == len(joints)
    assert stiffnesses(model, joints)[0, 3] == pytest.approx((1 - SHARE) * 0.1 / ds)
    with pytest.raises(Scan2FlexError, match="cannot represent dahl"):
        export(remembering(study), "usd", pose="plane", elements=LINKS)


def test_dampings_of_newtons_schema_reach_the_joints_of_our_file(study, tmp_path):
    """`NewtonCurvesDeformableMaterialAPI` on our material: what a user adds who has measured them."""
    newton = pytest.importorskip("newton", reason="Newton is not installed: pip install 'newton[importers]'")
    pytest.importorskip("pxr", reason="OpenUSD is not installed: pip install 'newton[importers]'")
    given = {"Shear": 0.2, "Stretch": 0.3, "Bend": 0.004, "Twist": 0.005}
    added = "".join(f"        float newton:curves{name}Damping = {value}\n" for name, value in given.items())
    text = export(study, "usd", pose="plane", elements=LINKS)
    own = '"PhysicsCurvesDeformableMaterialAPI"'
    text = text.replace(own, f'{own}, "NewtonCurvesDeformableMaterialAPI"')
    first = "        float physics:curvesStretchStiffness"
    text = text.replace(first, f"{added}{first}", 1)
    (tmp_path / "damped.usda").write_text(text)
    builder = newton.ModelBuilder()
    builder.add_usd(str(tmp_path / "damped.usda"))
    model = builder.finalize(device="cpu")
    rods = np.flatnonzero(model.joint_type.numpy() == newton.JointType.ROD)
    at = model.joint_qd_start.numpy()[rods[0]]
    wanted = np.array([0.2, 0.2, 0.3, 0.004, 0.004, 0.005]) * LINKS
    np.testing.assert_allclose(model.joint_target_kd.numpy()[at : at + 6], wanted, rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_joint_of_newton_follows_dahls_law(axis):
    """Links turned by hand, to and fro: the friction that Newton's solver keeps is the solution of the differential equation;
    in bending to the second order of the angle of a joint, which Newton measures as 2 tan(angle/2)."""
    straight = StudyPose("free", "fit", Clamp(np.zeros(3), [np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0]))
    cable = {"length": 1.0, "length_density": 0.2, "bending_stiffness": 0.1, "torsional_stiffness": 0.1}
    study = remembering(Study.from_arrays(cable, [straight], gravity=np.zeros(3)))
    newton, builder, bodies, joints = rod_of(study)
    for body in bodies:
        builder.body_mass[body] = builder.body_inv_mass[body] = 0.0  # Newton does not move it
        builder.body_inertia[body], builder.body_inv_inertia[body] = (0.0 * builder.body_inertia[body],) * 2
    builder.color()
    model = builder.finalize(device="cpu")
    solver = newton.solvers.SolverVBD(model, iterations=1)
    now, then, control = model.state(), model.state(), model.control()
    start, ds, x, z = now.body_q.numpy(), 1.0 / LINKS, 0.0, 0.0
    first, off = Rotation.from_quat(start[bodies[0], 3:]), []
    for target in np.r_[0.0, np.linspace(0.2, 3.0, 15), np.linspace(2.8, -3.0, 30), np.linspace(-2.8, 3.0, 30)]:
        turned = start.copy()
        turns = Rotation.from_rotvec(np.eye(3)[axis] * target * ds * np.arange(len(bodies))[:, None])
        turned[bodies, 3:] = (first * turns).as_quat()
        now.body_q.assign(turned)
        now.body_qd.zero_()
        solver.step(now, then, control, None, 1e-3)
        way = np.sign(target - x)
        x, z = target, way - (way - z) * np.exp(-abs(target - x) / SLIP)
        off.append(solver.joint_sigma_prev.numpy()[joints, axis] - 0.1 * SHARE * SLIP * z)
    assert np.abs(off).max() < (1e-5 if axis == 2 else 0.02) * 0.1 * SHARE * SLIP
