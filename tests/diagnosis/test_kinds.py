"""A kind is known by its catalogue entry: no code decides by its name, so one's own kind can do what any other can."""

import ast
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import scan2flex_jax
from scan2flex_jax.diagnosis import refit, search, verdict
from scan2flex_jax.diagnosis.prior import Prior
from scan2flex_jax.diagnosis.refit import Refit
from scan2flex_jax.diagnosis.residual import Law
from scan2flex_jax.diagnosis.sensitivity import Bench, Component
from scan2flex_jax.effects.catalogue import _ADDED, SameShapes, entry_of
from scan2flex_jax.fitting.noise import Noise
from scan2flex_jax.fitting.parameters import Layout, Slot
from scan2flex_jax.study.kinds import CABLE, DESCRIPTIVE_KINDS, kind_names
from tests.effects import scene

PACKAGE = Path(scan2flex_jax.__file__).parent
KINDS = {*kind_names(), *DESCRIPTIVE_KINDS, "memory_set"} - set(CABLE)
NOISE = Noise(1e-3, 1e-4, 0.05)
STATED = {"study/kinds.py"}  # `[tolerance]` has keys of the same name
OF_THE_FORMAT = {"study/declared.py", "study/sense.py"}  # what a study may say of single kinds, before any catalogue is read
NAMES = [p.relative_to(PACKAGE).as_posix() for p in sorted(PACKAGE.rglob("*.py"))]
FILES = [name for name in NAMES if not name.startswith("effects/") and name not in STATED | OF_THE_FORMAT]


def documentation(tree):
    """The docstrings of a module."""
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef)
    return {id(n.body[0].value) for n in ast.walk(tree) if isinstance(n, documented) and isinstance(n.body[0], ast.Expr)}


def decided_by_words(name) -> list[str]:
    """Constants of a module that are the name of a kind, and questions whether words are in a text made of an object."""
    tree = ast.parse((PACKAGE / name).read_text("utf-8"))
    texts = documentation(tree)
    found = [
        f"line {n.lineno}: {n.value!r}"
        for n in ast.walk(tree)
        if isinstance(n, ast.Constant) and isinstance(n.value, str) and id(n) not in texts and n.value.split(".")[0] in KINDS
    ]
    return found + [
        f"line {n.lineno}: in str(...)"
        for n in ast.walk(tree)
        if isinstance(n, ast.Compare) and any(isinstance(c, ast.Call) and called(c) == "str" for c in n.comparators)
    ]


def called(call) -> str:
    return call.func.id if isinstance(call.func, ast.Name) else ""


@pytest.mark.parametrize("name", FILES)
def test_no_code_decides_by_the_name_of_a_kind_or_the_words_of_a_message(name):
    assert decided_by_words(name) == []


@pytest.fixture
def own_table():
    """A user's effect type that declares the properties of `support_plane`: contact with a plane."""
    own = of_ones_own("own_table", "support_plane")
    _ADDED[own.kind] = own
    yield own
    del _ADDED[own.kind]


def of_ones_own(kind, like, **changed):
    """An entry under another name that declares the properties of one of the package."""
    entry = entry_of(like)
    return replace(entry, effect=type("Own", (entry.effect,), {"kind": kind}), **changed)


def bench():
    """The numbers and the scales of a study of one pose and one unknown; nothing is solved on it."""
    slot = Slot("bending_stiffness", (), True, (-5.0,), (5.0,), 0, "N m^2")
    layout = Layout((slot,), 0.0, 0.0, 0.0, 0.0)
    minimum = SimpleNamespace(shared=np.zeros(1))
    made = Bench.__new__(Bench)
    made.layout, made.poses, made.context, made.minimum = layout, SimpleNamespace(count=1), scene.CONTEXT, minimum
    made.off = 0.0
    return made


def refitted(*kinds, **known):
    """A refit of kinds at their first sites."""
    components, nothing = tuple(Component(kind, entry_of(kind).sites(scene.CONTEXT)[0]) for kind in kinds), np.zeros(0)
    rest = {"vector": nothing, "shapes": [], "cost": np.inf, "log_marginal": 0.0, **known}
    return Refit(components=components, chi2=0.0, covariance=nothing, converged=True, law=Law(NOISE), log_evidence=0.0, **rest)


def descents(kind, monkeypatch):
    """The vectors at which a refit with a kind begins its descents."""
    begun = []

    def descend(bench, components, n, prior, noise, vector, shapes, most, least, solved=False):
        begun.append(vector.copy())
        return refitted(kind, vector=vector)

    monkeypatch.setattr(refit, "_descend", descend)
    monkeypatch.setattr(refit, "configurations", lambda shapes: None)
    site = entry_of(kind).sites(scene.CONTEXT)[0]
    refit.refit(bench(), (Component(kind, site),), Law(NOISE), np.zeros(1), [np.array([0.3])])
    return np.array(begun)


def test_ones_own_contact_is_met_step_by_step_from_where_the_noise_begins(own_table, monkeypatch):
    given, own = (descents(kind, monkeypatch) for kind in ("support_plane", "own_table"))
    np.testing.assert_array_equal(own, given)
    size = own_table.size(scene.CONTEXT)
    most = own_table.bounds(scene.CONTEXT)[1]
    np.testing.assert_allclose(own[:, 1], np.minimum(np.array([20.0, 400.0, 1e4]) * size, most))  # hardness, not the given 0.3
    offset = np.clip(NOISE.total, *own_table.moving["offset"](scene.CONTEXT))
    np.testing.assert_allclose(own[:, 2], offset)


def test_ones_own_contact_has_the_ranges_that_it_states_and_no_estimate_of_its_hardness(own_table):
    site = own_table.sites(scene.CONTEXT)[0]
    given, own = (Prior(bench(), (Component(kind, site),)) for kind in ("support_plane", "own_table"))
    for name in ("precision", "low", "high", "width", "frozen", "weak"):
        np.testing.assert_array_equal(getattr(own, name), getattr(given, name))
    assert own.frozen.tolist() == [False, True, False, False, False]
    narrow = replace(own_table, moving={"offset": lambda c: (-0.1, 0.2)})
    _ADDED[narrow.kind] = narrow
    alone = Prior(bench(), (Component("own_table", site),))
    assert (alone.low[2:].tolist(), alone.high[2:].tolist()) == ([-0.1], [0.2])


def test_amplitudes_of_ends_that_a_site_leaves_out_do_not_move():
    prior = Prior(bench(), (Component("clamp_rotation", {"ends": np.array([1.0, 0.0])}),))
    assert prior.frozen[1:].tolist() == [False] * 3 + [True] * 3
    prior = Prior(bench(), (Component("elastic_clamp", {"ends": np.array([0.0, 1.0])}),))
    assert prior.frozen[1:].tolist() == [True, False]


def test_a_users_piece_of_a_field_names_nothing_with_another_piece():
    own = of_ones_own("own_sleeve", "point_mass")
    _ADDED[own.kind] = own
    try:
        assert search.pieces(refitted("own_sleeve", "density_taper"))
        assert search.pieces(refitted("own_sleeve", "kink", "density_taper"))
        assert not search.pieces(refitted("own_sleeve"))
        assert not search.pieces(refitted("own_sleeve", "stiffness_taper"))
        assert not search.pieces(refitted("kink", "tether"))
    finally:
        del _ADDED[own.kind]
    before, after = SimpleNamespace(p_value=0.01), SimpleNamespace(p_value=0.5)
    for pieces, word in ((True, "unexplained"), (False, "explained")):
        assert verdict.whole(before, after, [verdict.Candidate(("a", "b"), 40.0, pieces=pieces)]) == word


def test_what_always_gives_the_same_shapes_is_said_by_its_field():
    """The word "always" in a condition means nothing by itself."""
    same = (SameShapes("gravity", "where it is not always level"), SameShapes("length_density", "a scale", always=True))
    own = of_ones_own("own_wind", "uniform_load", same_shapes=same)
    _ADDED[own.kind] = own
    try:
        assert search.outside(refitted("own_wind")) == ("length_density",)
    finally:
        del _ADDED[own.kind]
    assert search.outside(refitted("uniform_load")) == ("gravity",)
    tilt, _ = entry_of("uniform_load").same_shapes
    assert tilt.words == "a tilt of the scan frame, always"
