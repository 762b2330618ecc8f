"""Double precision for every test, and one cache of compiled functions for all processes of a run.

With `SCAN2FLEX_TEST_SHAPES=1`, as in CI, the shapes written in the package's annotations are checked at every call, which takes
a quarter of the processor time.

A test runs a function a few times only and mostly waits for its compilation: XLA compiles without optimisation, without fusion
emitters and in one part, in a fifth of the time, for code that takes half as long again. Flags in `XLA_FLAGS` have the last
word: `--xla_backend_optimization_level=3 --xla_llvm_disable_expensive_passes=false` tests what a user runs, as
`.ci/package.py` and the benchmarks do.

Of several test processes each keeps to one core: threads of several processes on the same cores take a quarter more processor
time.
"""

import gc
import os
from importlib.metadata import version
from pathlib import Path

_WORKER = os.environ.get("PYTEST_XDIST_WORKER", "")  # gw0, gw1, ...
if _WORKER and hasattr(os, "sched_setaffinity"):  # before JAX counts the cores
    _CORES = sorted(os.sched_getaffinity(0))
    os.sched_setaffinity(0, {_CORES[int(_WORKER.removeprefix("gw")) % len(_CORES)]})

# read when JAX first compiles; of two values of a flag the last one counts
QUICKLY = "--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true --xla_cpu_parallel_codegen_split_count=1"
if version("jaxlib").startswith(("0.9.", "0.10.")):  # a flag that XLA does not know ends the process
    QUICKLY += " --xla_cpu_use_fusion_emitters=false"
os.environ["XLA_FLAGS"] = f"{QUICKLY} {os.environ.get('XLA_FLAGS', '')}".strip()
os.environ["SCAN2FLEX_KERNEL"] = "off"  # the tests of the compiled solver build their own

import jax  # noqa: E402 - after the settings that it reads
import pytest  # noqa: E402
from jaxtyping import install_import_hook  # noqa: E402

jax.config.update("jax_enable_x64", True)
CACHE = os.environ.get("SCAN2FLEX_TEST_CACHE") or str(Path(__file__).parents[1] / ".pytest_cache" / "compiled")
LEAST = 0.1  # s of compilation that an entry of the cache is worth
jax.config.update("jax_compilation_cache_dir", CACHE)
jax.config.update("jax_persistent_cache_min_compile_time_secs", LEAST)
os.environ |= {"JAX_COMPILATION_CACHE_DIR": CACHE, "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": str(LEAST)}  # of subprocesses
if os.environ.get("SCAN2FLEX_TEST_SHAPES"):
    install_import_hook("scan2flex_jax", "beartype.beartype")

MEMORY = Path("/proc/self/statm")  # pages, the second number those that are resident
MOST_PAGES = 5_000_000_000 // 4096  # of one worker; beyond it the functions that it has compiled are forgotten


@pytest.fixture(scope="module", autouse=True)
def _compiled_functions_are_not_kept_for_ever():
    yield
    if MEMORY.exists() and int(MEMORY.read_text().split()[1]) > MOST_PAGES:
        jax.clear_caches()
        gc.collect()
