"""The solver on a GPU: its own source on a CPU, through XLA; what NVRTC makes of it; and, where there is one, on a GPU.

On the CPU the threads of a block are fibers in random order (`fibers.cpp`), so that a barrier that is missing changes results.
"""

import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.statics import MixedNewton
from scan2flex_jax.statics.kernel import cuda, library
from scan2flex_jax.statics.kernel.solver import default_solver

from .rods import COMPILER, ELEMENTS, LANES, judged, middle, random_rods, same_derivatives, settle_of, solver_on_threads

H200 = cuda.Card(90, 232_448, 132)
STRAIGHT = 2
MESHES = (8, ELEMENTS, 40)
MANY = 50  # steps beyond which rounding decides on the way
needs_compiler = pytest.mark.skipif(not COMPILER, reason="no C++ compiler")
needs_gpu = pytest.mark.skipif(jax.default_backend() != "gpu", reason="no GPU")


@pytest.fixture(scope="module")
def on_threads(tmp_path_factory):
    return solver_on_threads(tmp_path_factory.mktemp("fibers"))


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


@needs_compiler
@pytest.mark.slow
@pytest.mark.parametrize("n", MESHES)
def test_threads_in_any_order_end_as_jax(on_threads, n):
    same(on_threads, n, 1e-8)


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
