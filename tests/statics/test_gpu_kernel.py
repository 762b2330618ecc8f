"""The solver on a GPU: its own source on a CPU, through XLA; what NVRTC makes of it; and, where there is one, on a GPU.

On the CPU the threads of a block are fibers in random order (`fibers.cpp`), so that a barrier that is missing changes results.
"""

import ctypes
import shutil
import subprocess
import sys
from functools import cache
from itertools import count
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from scan2flex_jax.effects.nonlinear_bending import NonlinearBending
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.model import CableModel
from scan2flex_jax.statics import MixedNewton, equilibrium
from scan2flex_jax.statics.kernel import cuda, elements, library
from scan2flex_jax.statics.kernel.solver import default_solver
from scan2flex_jax.statics.verdict import NON_FINITE

from . import cases
from .rods import ELEMENTS, LANES, judged, random_rods, settle_of

H200 = cuda.Card(90, 232_448, 132)
STRAIGHT, IN_A_BLOCK = 2, 3  # an odd number: the last warp eliminates one rod
MESHES = (8, ELEMENTS, 40)
MANY = 50  # steps beyond which rounding decides on the way
needs_compiler = pytest.mark.skipif(not shutil.which("g++"), reason="no g++")
needs_gpu = pytest.mark.skipif(jax.default_backend() != "gpu", reason="no GPU")
orders = count()


@pytest.fixture(scope="module")
def on_threads(tmp_path_factory):
    """The solver whose kernel runs on the CPU."""
    folder = tmp_path_factory.mktemp("fibers")
    (folder / "elements.inc").write_text(elements.source())
    (folder / "constants.inc").write_text(elements.constants())
    include = [f"-I{path}" for path in (folder, Path(cuda.__file__).parent)]

    @cache
    def built(n):
        command = ["g++", "-std=c++17", "-O1", "-w", "-shared", "-fPIC", f"-DN={n}", f"-DRODS={IN_A_BLOCK}", *include]
        subprocess.run([*command, str(Path(__file__).with_name("fibers.cpp")), "-o", str(folder / f"{n}.so")], check=True)
        return ctypes.CDLL(str(folder / f"{n}.so"))

    def launch(operands, n, call):
        (ctypes.c_int * 4).from_address(operands.arrays[16])[3] = 0
        if built(n).launch(ctypes.byref(operands), next(orders)):
            raise RuntimeError("threads wait for each other")

    cuda.register(launch, "settle_on_threads", "cpu")
    return cuda.CudaNewton("settle_on_threads", "cpu")


def same(solver, n, tolerance):
    """Lanes take the steps of `MixedNewton` to its verdict and, solved, to its configuration, unless they take very many."""
    rods, starts = random_rods(n, STRAIGHT)
    ours, theirs = (settle_of(s)(rods, starts) for s in (solver, MixedNewton()))
    short = theirs.steps < MANY
    codes = [jnp.where(short, judged(rods, found).code, -1) for found in (ours, theirs)]
    good = np.flatnonzero(codes[1] == 0)
    np.testing.assert_array_equal(ours.steps[short], theirs.steps[short])
    np.testing.assert_array_equal(codes[0] == 0, codes[1] == 0)
    np.testing.assert_array_equal(ours.negative[good], theirs.negative[good])
    assert len(good) >= LANES // 4
    assert {0, 4} <= set(good)  # the straight ones
    for pair in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
        a, b = (np.asarray(x, float).reshape(LANES, -1)[good] for x in pair)
        np.testing.assert_allclose(a, b, rtol=0.0, atol=tolerance * (1.0 + np.max(np.abs(b))))


def middle(x, solver):
    cable = Cable(1.0, 0.2, jnp.exp(x[0]), jnp.exp(x[1]))
    model, clamps = CableModel(cable, cases.EARTH), cases.clamped(*cases.four_poses()[1])
    found = equilibrium(model, clamps, elements=ELEMENTS, solver=solver)
    return jnp.sum(found.points[ELEMENTS // 2] * jnp.array([1.0, 2.0, 3.0]))


def same_derivatives(solver):
    x = jnp.log(jnp.array([[0.1, 0.25], [0.12, 0.2]]))
    ours = jax.jit(jax.grad(lambda x: jnp.sum(jax.vmap(lambda row: middle(row, solver))(x))))(x)
    in_jax = jax.jit(jax.jacfwd(lambda row: middle(row, MixedNewton())))
    np.testing.assert_allclose(ours, [in_jax(row) for row in x], rtol=1e-7)


@needs_compiler
@pytest.mark.slow
@pytest.mark.parametrize("n", MESHES)
def test_threads_in_any_order_end_as_jax(on_threads, n):
    same(on_threads, n, 1e-8)


@needs_compiler
@pytest.mark.slow
def test_broken_rods_leave_others_alone(on_threads):
    """Also those that come after them in their place; bit by bit, in another order of the threads."""
    rods, starts = random_rods(ELEMENTS, STRAIGHT)
    bad = eqx.tree_at(lambda r: r.load.force, rods, rods.load.force.at[3].set(jnp.nan))
    broken = eqx.tree_at(lambda s: s.r, starts, starts.r.at[5, 4].set(jnp.inf))
    found = settle_of(on_threads)(bad, broken)
    codes = np.asarray(judged(bad, found).code)
    assert codes[3] == codes[5] == NON_FINITE
    others = np.setdiff1d(np.arange(LANES), (3, 5))
    for with_bad, without in zip(jax.tree.leaves(found), jax.tree.leaves(settle_of(on_threads)(rods, starts)), strict=True):
        np.testing.assert_array_equal(with_bad[others], without[others])


@needs_compiler
@pytest.mark.slow
def test_derivatives_of_a_batch_are_those_of_the_solve_in_jax(on_threads):
    same_derivatives(on_threads)


@needs_compiler
@pytest.mark.slow
def test_energies_of_effects_are_left_to_jax(on_threads):
    def program(*effects):
        model = CableModel(Cable(1.0, 0.2, 0.1, 0.25), cases.EARTH, effects)
        boundary = cases.clamped(*cases.four_poses()[0])
        return str(jax.make_jaxpr(lambda m: equilibrium(m, boundary, solver=on_threads).points)(model))

    assert on_threads.target in program()
    assert on_threads.target not in program(NonlinearBending(3.0, 0.5))


@pytest.mark.slow
@pytest.mark.parametrize("n", [*MESHES, 200])
def test_the_kernel_compiles_without_a_compiler(n):
    codes = []
    try:
        jax.eval_shape(lambda: codes.append(cuda.compiled_for(n, H200)))  # as where a solve is traced
    except Scan2FlexError as error:
        if "NVRTC" not in str(error):
            raise
        pytest.skip("NVRTC is not installed (pip install nvidia-cuda-nvrtc)")
    assert codes[0].startswith(b"\x7fELF")
    assert b"settle" in codes[0]


def test_blocks_fill_a_multiprocessor_and_a_rod_that_does_not_fit_is_refused():
    assert [cuda.rods_of_a_block(n, H200) for n in (8, 40, 100, 200)] == [16, 6, 2, 1]
    with pytest.raises(Scan2FlexError, match="a rod of 200 elements does not fit on a multiprocessor of this GPU"):
        cuda.rods_of_a_block(200, H200._replace(shared=101_376))
    with pytest.raises(Scan2FlexError, match="a rod of 300 elements"):
        cuda.rods_of_a_block(300, H200)


def test_without_a_gpu_nothing_of_it_is_loaded():
    text = "import jax, sys, scan2flex_jax.statics.kernel.solver as s; jax.config.update('jax_platforms', 'cpu');"
    text += "s.default_solver(); print([x for x in sys.modules if x.endswith(('kernel.cuda', 'kernel.foreign'))])"
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("[]\n", "")


@needs_gpu
@pytest.mark.gpu
@pytest.mark.parametrize("n", [*MESHES, 41, 200])
def test_a_gpu_ends_as_jax(n):
    same(cuda.solver(), n, 1e-7)


@needs_gpu
@pytest.mark.gpu
def test_a_gpu_is_used_without_a_word_and_has_derivatives(monkeypatch):
    monkeypatch.delenv(library.SWITCH)
    cuda.solver.cache_clear()
    program = jax.jit(jax.vmap(lambda x: middle(x, None))).lower(jnp.zeros((2, 2)))
    assert cuda.TARGET in program.as_text()
    same_derivatives(default_solver())
