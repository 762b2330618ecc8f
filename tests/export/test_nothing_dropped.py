"""Whatever a study has goes into every file or is refused by name: all effect types, in every target."""

import json
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.export import TO
from scan2flex_jax.export.hanging import described
from scan2flex_jax.fitting.parameters import model_of
from scan2flex_jax.fitting.poses import boundary_of
from scan2flex_jax.rod.model import Configuration, discretise
from scan2flex_jax.study.kinds import kind_names
from tests.effects.scene import GIVEN
from tests.export.test_export import cable, effect, names_of_script

ELEMENTS = 10
DS = 1.0 / ELEMENTS
SCANNER = {"scan_scale", "scan_offset"}
POSE = {"clamp_rotation", "clamp_offset"}  # they are in the supports, hence in positions and rotations
ALONG = {"natural_curvature", "kink", "curvature_profile", "density_profile", "density_taper", "point_mass", "length_error"}
STIFF = {"section_profile", "stiffness_profile", "stiffness_taper", "stiffness_field"}
HELD = {
    "mujoco": ALONG | STIFF,
    "pyelastica": ALONG | STIFF | {"anisotropic_bending", "bend_twist_coupling", "extensibility"},
    "usd": ALONG | {"extensibility"},
    "abaqus": ALONG | STIFF | {"extensibility", "nonlinear_bending", "bending_law", "torsion_law"},
    "orcaflex": STIFF | {"density_profile", "density_taper", "extensibility", "length_error"},
    "moordyn": {"extensibility", "length_error"},
    "cabledyn": {"extensibility", "length_error"},
    "moduli": {"extensibility", "length_error"},
    "json": set(kind_names()) - SCANNER - POSE,
}


def straight(*effects, strain=1e-6, **changes):
    """A cable with these effects, along z as a fresh pose begins: what is written of it needs no equilibrium."""
    study = replace(cable(**changes), effects=effects)
    study = replace(study, poses=tuple(replace(p, time=60.0 * k) for k, p in enumerate(study.poses)))  # some effects need it
    pose = study.poses[0]
    model = model_of(study, pose)
    rod = discretise(model, boundary_of(pose), ELEMENTS)
    r = np.linspace(0.0, 1.0, ELEMENTS + 1)[:, None] * [0.0, 0.0, 1.0]
    return described(study, pose, model, rod, Configuration(r, np.broadcast_to(np.eye(3), (ELEMENTS + 1, 3, 3))), strain)


@pytest.fixture(scope="module")
def plain():
    return {to: write(straight()) for to, write in TO.items()}


@pytest.mark.parametrize("kind", [kind for kind in kind_names() if kind in GIVEN and kind != "memory_set"])
def test_every_effect_goes_along_or_is_refused_by_name(kind, plain):
    given = dict(GIVEN[kind])
    if "normal" in given:
        given["normal"] = np.array([0.0, 0.0, 1.0])
    hanging = straight(effect(kind, **given), strain=1e-2 if kind == "extensibility" else 1e-6)
    for to, write in TO.items():
        if kind in HELD[to]:
            assert write(hanging) != plain[to], to
        elif kind in SCANNER:
            assert kind in write(hanging), to
        elif kind in POSE:
            assert write(hanging)
        else:
            with pytest.raises(Scan2FlexError, match=kind) as refused:
                write(hanging)
            assert "\n" not in str(refused.value)


def joints_of(text, name):
    found = [j for j in ET.fromstring(text).iter("joint") if j.get("name").endswith(name)]
    return np.array([float(j.get("stiffness")) for j in found]), np.array([float(j.get("springref")) for j in found])


def test_a_profile_of_stiffness_is_in_every_joint():
    hanging = straight(effect("stiffness_profile", position=0.3, width=0.2, factor=3.0))
    EI = hanging.stiffness[:, 3, 3]
    assert EI.max() > 2.0 * EI.min()
    np.testing.assert_allclose(joints_of(TO["mujoco"](hanging), "x")[0], EI / DS)
    np.testing.assert_allclose(cable_of_script(TO["pyelastica"](hanging))["bend"], hanging.stiffness[:, 3:, 3:])


def cable_of_script(source):
    return names_of_script(source)["CABLE"]


def test_a_kink_is_where_the_springs_rest():
    hanging = straight(effect("kink", position=0.45, angle=np.array([0.2, 0.0, 0.0]), width=0.0))
    _, rest = joints_of(TO["mujoco"](hanging), "x")
    assert np.sum(rest) == pytest.approx(0.2)
    assert np.argmax(rest) == 4
    kappa = np.array(cable_of_script(TO["pyelastica"](hanging))["rest_kappa"])
    assert np.sum(kappa[:, 0]) * DS == pytest.approx(0.2)


@pytest.mark.parametrize("place", [0.0, 0.33, 0.95, 1.0])
def test_a_mass_hangs_where_it_hangs(place):
    """Total mass and its first moment are those of the cable and the mass, whatever the links."""
    hanging = straight(effect("point_mass", position=place, mass=0.05))
    nodes = np.linspace(0.0, 1.0, ELEMENTS + 1)
    assert np.sum(hanging.link_masses) == pytest.approx(0.25)
    assert hanging.link_masses @ nodes == pytest.approx(0.2 * 0.5 + 0.05 * place)
    root = ET.fromstring(TO["mujoco"](hanging))
    assert sum(float(g.get("mass")) for g in root.iter("geom")) == pytest.approx(0.25)
    carrier = next(body for body in root.iter("body") if body.find("geom[@type='sphere']") is not None)
    k, z = int(carrier.get("name")[4:]), float(carrier.find("geom[@type='sphere']").get("pos").split()[2])
    assert (k - 0.5) * DS + z == pytest.approx(place)
    assert np.sum(cable_of_script(TO["pyelastica"](hanging))["masses"]) == pytest.approx(0.25)


def test_natural_stretch_is_refused_by_rigid_links_and_kept_by_the_rest():
    hanging = straight(natural_stretch=np.array([0.0, 0.0, 0.01]))
    for to in ("mujoco", "usd", "abaqus", "orcaflex", "moordyn", "cabledyn", "moduli"):
        with pytest.raises(Scan2FlexError, match="natural stretch"):
            TO[to](hanging)
    np.testing.assert_allclose(np.array(cable_of_script(TO["pyelastica"](hanging))["rest_sigma"])[:, 2], 0.01)


def test_no_radius_is_invented_silently():
    for write in TO.values():
        assert ("no radius" in write(straight())) == (write is not TO["json"])
        assert "no radius" not in write(straight(radius=0.004))
    assert "radius" not in json.loads(TO["json"](straight()))
