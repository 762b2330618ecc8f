"""The compiled solver: the same steps and the same result as `MixedNewton`, alone, in batches and under derivatives.

Skipped without a C++ compiler. The library is kept beside the compiled functions of the tests.
"""

import shutil
from functools import cache, partial
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference import clamped_cases

from scan2flex_jax.compilation import compiled
from scan2flex_jax.effects.nonlinear_bending import NonlinearBending
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.geometry import lie
from scan2flex_jax.rod.boundary import BALL, CLAMP, FREE, Boundary
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.element_law import stiffness_within
from scan2flex_jax.rod.model import CableModel, discretise
from scan2flex_jax.statics import MixedNewton, equilibrium
from scan2flex_jax.statics.kernel import build, library
from scan2flex_jax.statics.kernel.solver import CompiledNewton, default_solver
from scan2flex_jax.statics.starts import sagging_start
from scan2flex_jax.statics.verdict import MAX_STEPS_REACHED, NON_FINITE, judge

from . import cases

FOLDER = Path(__file__).parents[2] / ".pytest_cache" / "compiled"
LANES, ELEMENTS = 24, 11
SUPPORTS = ((CLAMP, CLAMP), (CLAMP, FREE), (CLAMP, BALL), (BALL, BALL))
needs_compiler = pytest.mark.skipif(not any(map(shutil.which, ("c++", "g++", "clang++"))), reason="no C++ compiler")


@pytest.fixture(scope="module")
def kernel():
    """The compiled solver of the package as it is."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(library.FOLDER, str(FOLDER))
        file = library.path()
        return CompiledNewton(library.register(file if file.exists() else build.build()))


@cache
def random_rods(elements=ELEMENTS):
    """Rods with unequal, coupled and varying sections on all kinds of supports, and their generic starts, as one batch."""
    rng = np.random.default_rng(5)
    held = np.array([SUPPORTS[i % len(SUPPORTS)] for i in range(LANES)])
    stiffness, frames = 10.0 ** rng.uniform(-2, 0, (LANES, 3)), 0.7 * rng.normal(size=(LANES, 2, 3))
    numbers = stiffness, rng.uniform(0.0, 0.3, LANES), rng.normal(size=(LANES, 6)) * [1e-3, 1e-3, 1e-3, 1.0, 1.0, 1.0]
    ends = rng.uniform([0.3, -0.4, -0.4], [0.8, 0.4, 0.4], (LANES, 3))
    mixed = 0.1 * rng.uniform(-1.0, 1.0, (LANES, elements, 6, 6)) + 0.3 * rng.uniform(size=(LANES, elements, 1, 1)) * np.eye(6)
    return compiled(jax.vmap(rod_of))(*map(jnp.asarray, (*numbers, held, frames, ends, mixed)))


def rod_of(stiffness, density, natural, held, frames, end, mixed):
    """A rod with ``mixed`` added to its sections, as parts of their size, and its generic start."""
    rotation = jnp.array(clamped_cases.START_FRAME) @ jax.vmap(lie.so3_exp)(frames)
    clamps = Boundary(jnp.stack([jnp.zeros(3), end]), rotation, held)
    cable = Cable(1.0, density, stiffness[:2], stiffness[2], 3e2, 4e3, natural[3:], natural[:3])
    model = CableModel(cable, jnp.array([0.5, -0.3, -9.81]))
    rod = discretise(model, clamps, len(mixed))
    size = jnp.sqrt(jnp.diagonal(rod.section.stiffness, axis1=1, axis2=2))
    mixed = 0.5 * (mixed + mixed.swapaxes(1, 2)) * size[:, :, None] * size[:, None, :]
    rod = eqx.tree_at(lambda r: r.section.stiffness, rod, rod.section.stiffness + mixed)
    rod = eqx.tree_at(lambda r: r.section.within, rod, stiffness_within(rod.section.stiffness))
    return rod, sagging_start(clamps, cable.length, model.gravity, 0, len(mixed))


def settled(solver, rods, starts, max_steps=None):
    return compiled(jax.vmap(partial(solver.settle, max_steps=max_steps)))(rods, starts)


@cache
def in_jax(elements, max_steps=None):
    return settled(MixedNewton(), *random_rods(elements), max_steps)


def assert_alike(ours, theirs, tolerance):
    """All arrays of two results, relative to the largest entry of each lane."""
    for pair in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
        a, b = (np.asarray(x, float).reshape(len(x), -1) for x in pair)
        size = np.max(np.abs(b), axis=1, keepdims=True) + 1e-300
        np.testing.assert_allclose(a / size, b / size, rtol=0.0, atol=tolerance)


@needs_compiler
@pytest.mark.parametrize("elements", [2, 8, ELEMENTS])
def test_all_supports_and_sections_end_as_in_jax(kernel, elements):
    rods, starts = random_rods(elements)
    ours, theirs = settled(kernel, rods, starts), in_jax(elements)
    verdict = jax.vmap(judge)(rods, theirs)
    np.testing.assert_array_equal(ours.steps, theirs.steps)
    np.testing.assert_array_equal(ours.negative, theirs.negative)
    np.testing.assert_array_equal(jax.vmap(judge)(rods, ours).code, verdict.code)
    good = np.flatnonzero(verdict.solved)
    assert len(good) >= LANES // 4
    ours, theirs = (jax.tree.map(lambda x: x[good], x) for x in (ours, theirs))
    ours, theirs = (eqx.tree_at(lambda x: x.derivatives.gradient, x, x.negative) for x in (ours, theirs))  # rounding alone
    assert_alike(ours, theirs, 1e-8)


@needs_compiler
def test_a_cable_pushed_off_its_saddles_takes_the_same_way(kernel):
    pose = cases.four_poses()[2]
    model = CableModel(Cable(1.0, 0.2, 0.1, 0.25), cases.EARTH)
    ours, theirs = (equilibrium(model, cases.clamped(*pose), elements=20, solver=s) for s in (kernel, MixedNewton()))
    assert int(theirs.verdict.steps) > 15
    assert int(ours.verdict.steps) == int(theirs.verdict.steps)
    np.testing.assert_allclose(ours.energy, theirs.energy, rtol=1e-9)  # rounding chooses between two mirror images


@needs_compiler
def test_failed_lanes_leave_their_neighbours_alone(kernel):
    rods, starts = random_rods()
    bad = eqx.tree_at(lambda r: r.load.force, rods, rods.load.force.at[3].set(jnp.nan))
    starts = eqx.tree_at(lambda s: s.r, starts, starts.r.at[5, 4].set(jnp.inf))
    found = settled(kernel, bad, starts)
    codes = np.asarray(jax.vmap(judge)(bad, found).code)
    assert codes[3] == codes[5] == NON_FINITE
    others = np.setdiff1d(np.arange(LANES), (3, 5))
    for with_bad, without in zip(jax.tree.leaves(found), jax.tree.leaves(settled(kernel, *random_rods())), strict=True):
        np.testing.assert_array_equal(with_bad[others], without[others])


@needs_compiler
def test_the_step_limit_is_kept(kernel):
    rods, starts = random_rods()
    found = settled(kernel, rods, starts, 3)
    assert np.max(found.steps) == 3
    assert MAX_STEPS_REACHED in jax.vmap(judge)(rods, found).code
    np.testing.assert_array_equal(found.exhausted, in_jax(ELEMENTS, 3).exhausted)


def shape_of(solver):
    """The middle of a twisted cable as a function of its logarithmic stiffnesses."""
    pose = cases.four_poses()[1]

    def middle(x):
        cable = Cable(1.0, 0.2, jnp.exp(x[0]), jnp.exp(x[1]))
        found = equilibrium(CableModel(cable, cases.EARTH), cases.clamped(*pose), elements=ELEMENTS, solver=solver)
        return jnp.sum(found.points[ELEMENTS // 2] * jnp.array([1.0, 2.0, 3.0]))

    return middle


@cache
def gradients_in_jax():
    """Where derivatives are compared, and the gradients of the solve in JAX there."""
    x = jnp.log(jnp.array([[0.1, 0.25], [0.12, 0.2]]))
    return x, np.stack([jax.jit(jax.jacfwd(shape_of(MixedNewton())))(row) for row in x])


@needs_compiler
@pytest.mark.parametrize(
    "of",
    [
        lambda f: lambda x: jnp.stack([jax.grad(f)(row) for row in x]),
        lambda f: jax.jit(jax.vmap(jax.jacfwd(f))),
        lambda f: jax.jit(jax.grad(lambda x: jnp.sum(jax.vmap(f)(x)))),
        lambda f: jax.jit(lambda x: jax.lax.map(jax.grad(f), x)),
    ],
    ids=["grad", "vmap jacfwd", "grad vmap", "map grad"],
)
def test_derivatives_are_those_of_the_solve_in_jax(kernel, of):
    x, expected = gradients_in_jax()
    np.testing.assert_allclose(of(shape_of(kernel))(x), expected, rtol=1e-7)


@needs_compiler
def test_effects_with_an_energy_of_their_own_are_solved_in_jax(kernel):
    def program(*effects):
        model = CableModel(Cable(1.0, 0.2, 0.1, 0.25), cases.EARTH, effects)
        boundary = cases.clamped(*cases.four_poses()[0])
        return str(jax.make_jaxpr(lambda m: equilibrium(m, boundary, solver=kernel).points)(model))

    assert kernel.target in program()
    assert kernel.target not in program(NonlinearBending(3.0, 0.5))


@needs_compiler
def test_the_installed_library_is_the_default_and_can_be_switched_off(kernel, monkeypatch, tmp_path):
    def chosen(folder, switch="on"):
        monkeypatch.setenv(library.FOLDER, str(folder))
        monkeypatch.setenv(library.SWITCH, switch)
        library.target.cache_clear()
        return type(default_solver())

    assert chosen(FOLDER) is CompiledNewton
    assert chosen(FOLDER, "off") is MixedNewton
    assert chosen(tmp_path) is MixedNewton  # nothing there
    library.path().write_text("no library")
    assert chosen(tmp_path) is MixedNewton
    monkeypatch.setattr(library, "_ours", lambda file: False)
    assert chosen(FOLDER) is MixedNewton  # of another user
    library.target.cache_clear()


def test_a_library_of_other_sources_is_not_found(monkeypatch, tmp_path):
    before = library.key()
    (tmp_path / "rod").mkdir()
    (tmp_path / "rod" / "assembly.py").write_text("another")
    monkeypatch.setattr(library, "_PACKAGE", tmp_path)
    assert library.key() != before


@pytest.mark.parametrize(
    ("name", "sentence"),
    [("no-such-compiler", "cannot be run"), (shutil.which("false"), "failed .* set CXX to another")],
)
def test_a_compiler_that_does_not_serve_is_named(monkeypatch, tmp_path, name, sentence):
    monkeypatch.setenv("CXX", name)
    monkeypatch.setenv(library.FOLDER, str(tmp_path))
    monkeypatch.setattr(build.elements, "source", lambda: "")
    with pytest.raises(Scan2FlexError, match=sentence):
        build.build()
    assert not list(tmp_path.glob("*.so"))


def test_without_a_compiler_a_sentence_says_so(monkeypatch, tmp_path):
    monkeypatch.delenv("CXX", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv(library.FOLDER, str(tmp_path))
    with pytest.raises(Scan2FlexError, match=r"no C\+\+ compiler found"):
        build.build()


def test_a_folder_that_cannot_be_written_is_named(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv(library.FOLDER, str(tmp_path / "file"))
    with pytest.raises(Scan2FlexError, match=r"file: the kernel cannot be written there"):
        build.build()


@needs_compiler
def test_a_library_with_another_result_is_not_installed(kernel, monkeypatch, tmp_path):
    monkeypatch.setenv(library.FOLDER, str(FOLDER))
    there = library.path()
    monkeypatch.setenv(library.FOLDER, str(tmp_path))
    monkeypatch.setattr(build, "_compile", lambda folder: Path(shutil.copy(there, folder)))
    monkeypatch.setattr(build, "_ALIKE", 0.0)
    with pytest.raises(Scan2FlexError, match=r"differs by .* not installed"):
        build.build()
    assert not library.path().exists()
