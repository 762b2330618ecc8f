"""The compiled solver: the same steps and the same result as `MixedNewton`, in batches and under derivatives.

Skipped without a C++ compiler. The library is kept beside the compiled functions of the tests.
"""

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from scan2flex_jax.effects.nonlinear_bending import NonlinearBending
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.programs import Programs
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.model import CableModel
from scan2flex_jax.statics import MixedNewton, equilibrium
from scan2flex_jax.statics.kernel import build, library
from scan2flex_jax.statics.kernel.solver import CompiledNewton, default_solver
from scan2flex_jax.statics.verdict import NON_FINITE
from tests.test_programs import Memory

from . import cases
from .rods import COMPILER, LANES, judged, random_rods, same_derivatives, settle_of, solver_on_threads

FOLDER = Path(jax.config.jax_compilation_cache_dir)
_without = pytest.mark.skipif(not COMPILER, reason="no C++ compiler")


def needs_compiler(test):
    """A test of the library, whose compilation takes most of a minute."""
    return pytest.mark.slow(_without(test))


@pytest.fixture(scope="module")
def kernel():
    """The compiled solver of the package as it is."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(library.FOLDER, str(FOLDER))
        file = library.path()
        return CompiledNewton(library.register(file if file.exists() else build.build()))


@pytest.fixture(scope="module", params=("library", "threads of a GPU"))
def each(request, tmp_path_factory):
    """Either of the compiled solvers, that of a GPU with its own source on the CPU."""
    if request.param == "library":
        return request.getfixturevalue("kernel")
    return solver_on_threads(tmp_path_factory.mktemp("fibers"))


@needs_compiler
def test_all_supports_and_sections_end_as_in_jax(kernel):
    """Steps, negative pivots and verdicts of each lane; of those that are solved every array, to 1e-8 of its largest entry."""
    rods, starts = random_rods()
    ours, theirs = (settle_of(solver)(rods, starts) for solver in (kernel, MixedNewton()))
    verdict = judged(rods, theirs)
    np.testing.assert_array_equal(ours.steps, theirs.steps)
    np.testing.assert_array_equal(ours.negative, theirs.negative)
    np.testing.assert_array_equal(judged(rods, ours).code, verdict.code)
    good = np.flatnonzero(verdict.solved)
    assert len(good) >= LANES // 4
    ours, theirs = (jax.tree.map(lambda x: x[good], x) for x in (ours, theirs))
    ours, theirs = (eqx.tree_at(lambda x: x.derivatives.gradient, x, x.negative) for x in (ours, theirs))  # rounding alone
    for pair in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
        a, b = (np.asarray(x, float).reshape(len(x), -1) for x in pair)
        size = np.max(np.abs(b), axis=1, keepdims=True) + 1e-300
        np.testing.assert_allclose(a / size, b / size, rtol=0.0, atol=1e-8)


@needs_compiler
def test_failed_lanes_leave_their_neighbours_alone(each):
    rods, starts = random_rods()
    bad = eqx.tree_at(lambda r: r.load.force, rods, rods.load.force.at[3].set(jnp.nan))
    broken = eqx.tree_at(lambda s: s.r, starts, starts.r.at[5, 4].set(jnp.inf))
    found = settle_of(each)(bad, broken)
    codes = np.asarray(judged(bad, found).code)
    assert codes[3] == codes[5] == NON_FINITE
    others = np.setdiff1d(np.arange(LANES), (3, 5))
    for with_bad, without in zip(jax.tree.leaves(found), jax.tree.leaves(settle_of(each)(rods, starts)), strict=True):
        np.testing.assert_array_equal(with_bad[others], without[others])


@needs_compiler
def test_derivatives_of_a_batch_are_those_of_the_solve_in_jax(each):
    same_derivatives(each)


@needs_compiler
def test_effects_with_an_energy_of_their_own_are_solved_in_jax(each):
    def program(*effects):
        model = CableModel(Cable(1.0, 0.2, 0.1, 0.25), cases.EARTH, effects)
        boundary = cases.clamped(*cases.four_poses()[0])
        return str(jax.make_jaxpr(lambda m: equilibrium(m, boundary, solver=each).points)(model))

    assert each.target in program()
    assert each.target not in program(NonlinearBending(3.0, 0.5))


@pytest.fixture
def chosen(kernel, monkeypatch):
    """The type of the default solver, for the library of a folder and a switch, until the end of the test."""

    def choose(folder, switch="on"):
        monkeypatch.setenv(library.FOLDER, str(folder))
        monkeypatch.setenv(library.SWITCH, switch)
        library.target.cache_clear()
        return type(default_solver())

    yield choose
    library.target.cache_clear()


@needs_compiler
def test_the_installed_library_is_the_default_and_can_be_switched_off(chosen, tmp_path):
    assert chosen(FOLDER) is CompiledNewton
    assert chosen(FOLDER, "off") is MixedNewton
    assert chosen(tmp_path) is MixedNewton  # nothing there
    library.path().write_text("no library")
    assert chosen(tmp_path) is MixedNewton


@needs_compiler
def test_a_kept_program_solves_as_it_was_traced(chosen, monkeypatch):
    """Processes with and without the library share a cache."""
    traced, entries = [], Memory()

    def middle(density):
        traced.append(density)
        model = CableModel(Cable(1.0, density, 0.1, 0.25), cases.EARTH)
        return equilibrium(model, cases.clamped(*cases.four_poses()[0])).points[20]

    monkeypatch.setattr(middle, "__module__", "scan2flex_jax.somewhere")
    monkeypatch.setattr(middle, "__qualname__", "middle")
    ends = []
    for switch in ("on", "off", "on", "off"):
        chosen(FOLDER, switch)
        ends.append(Programs(entries, b"1").call(middle, {}, (jnp.asarray(0.2),), {}))
    assert len(traced) == len(entries) == 2
    np.testing.assert_allclose(ends, [ends[0]] * 4, rtol=0.0, atol=1e-12)


def test_without_a_compiler_a_sentence_says_so(monkeypatch, tmp_path):
    monkeypatch.delenv("CXX", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv(library.FOLDER, str(tmp_path))
    with pytest.raises(Scan2FlexError, match=r"no C\+\+ compiler found"):
        build.build()
    assert not list(tmp_path.glob("*.so"))
