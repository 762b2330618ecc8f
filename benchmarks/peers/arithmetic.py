"""How far one Newton step with 40 elements, and a whole solve, are from what the processor can do with such small blocks.

The arithmetic is counted in the program itself: additions, multiplications, divisions and square roots of the jaxpr, a product
of matrices as 2 m n k, loops times their length; transcendental functions are counted beside it and not in it. XLA's own cost
analysis is the cross-check where there is no loop (it counts the body of a loop once). The peak is measured by a compiled
routine (`blocks.c`) on 6x6 blocks in the first cache: products and Cholesky factors, one block at a time and eight at once.
"""

import ctypes
import math
import shutil
import subprocess
import tempfile
from pathlib import Path
from time import process_time

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.peers.problems import PROBLEMS
from benchmarks.peers.solvers.ours import rod as rod_of
from scan2flex_jax.compilation import _options
from scan2flex_jax.rod.assembly import derivatives
from scan2flex_jax.rod.model import discretise
from scan2flex_jax.statics import blocktridiagonal as bt
from scan2flex_jax.statics.newton import MixedNewton
from scan2flex_jax.statics.solve import equilibrium
from scan2flex_jax.statics.starts import sagging_start

ELEMENTS = 40
_SIMPLE = {"add", "sub", "mul", "div", "sqrt", "rsqrt", "add_any", "square"}
_LIBRARY = {"sin", "cos", "tan", "exp", "log", "atan2", "pow", "tanh", "acos", "asin"}
_BLOCKS, _LANES, _REPEATS = 16, 8, 40_000


def counted(function, *args) -> dict:
    """Arithmetic and transcendental operations of one call; loops without a stated length are refused."""
    total = {"arithmetic": 0, "transcendental": 0}
    _walk(jax.make_jaxpr(function)(*args).jaxpr, 1, total)
    return total


def _walk(jaxpr, times, total):
    for e in jaxpr.eqns:
        name, size = e.primitive.name, sum(math.prod(v.aval.shape) for v in e.outvars)
        floating = any(jnp.issubdtype(v.aval.dtype, jnp.floating) for v in e.outvars if hasattr(v.aval, "dtype"))
        given = [x for p in e.params.values() for x in (p if isinstance(p, tuple | list) else (p,))]
        inner = [x for x in given if hasattr(x, "eqns") or hasattr(x, "jaxpr")]
        if name == "while":
            raise ValueError("a loop without a stated length cannot be counted")
        if inner:
            bodies = inner[-1:] if name in ("custom_jvp_call", "cond") else inner
            for body in bodies:
                _walk(getattr(body, "jaxpr", body), times * e.params.get("length", 1) if name == "scan" else times, total)
        elif name == "dot_general" and floating:
            (contracted, _), _ = e.params["dimension_numbers"]
            shape = e.invars[0].aval.shape
            total["arithmetic"] += times * 2 * size * math.prod(shape[d] for d in contracted)
        elif name in ("reduce_sum", "cumsum") and floating:
            total["arithmetic"] += times * math.prod(e.invars[0].aval.shape)
        elif name == "integer_pow" and floating:
            power = abs(e.params["y"])
            total["arithmetic"] += times * size * max(1, power.bit_length() + power.bit_count() - 2)
        elif name in _SIMPLE and floating:
            total["arithmetic"] += times * size
        elif name in _LIBRARY and floating:
            total["transcendental"] += times * size


def peak() -> dict:
    """Operations per second on 6x6 blocks: products (2 n^3) and Cholesky factors (n^3/3 and lower order, as counted)."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        return {"missing": "no C compiler: the processor's peak was not measured"}
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "blocks.so"
        source = Path(__file__).with_name("blocks.c")
        command = [compiler, "-O3", "-march=native", "-ffast-math", "-shared", "-fPIC", "-o", str(library), str(source)]
        subprocess.run(command, check=True, capture_output=True)
        return _measured(ctypes.CDLL(str(library)))


def _measured(code):
    rng = np.random.default_rng(0)
    shape = (_BLOCKS, 6, 6)
    a, b = rng.normal(size=shape) * 1e-3, rng.normal(size=shape)
    positive = np.matmul(b, np.swapaxes(b, 1, 2)) + 6 * np.eye(6)
    table = {}
    product, factor = 2 * 6**3, sum(2 * j + 1 + (5 - j) * (2 * j + 1) for j in range(6)) + 6
    for name, arrays, work in (
        ("multiply_one", (_rows(a), _rows(b), _rows(0 * a)), product),
        ("multiply_wide", (_lanes(a), _lanes(b), _lanes(0 * a)), product),
        ("cholesky_one", (_rows(positive), _rows(0 * a)), factor),
        ("cholesky_wide", (_lanes(positive), _lanes(0 * a)), factor),
    ):
        call = getattr(code, name)
        call.restype, call.argtypes = ctypes.c_double, [ctypes.c_long, *[ctypes.c_void_p] * len(arrays)]
        seconds = _least(lambda call=call, arrays=arrays: call(_REPEATS, *[x.ctypes.data for x in arrays]))
        table[name] = work * _BLOCKS * _REPEATS / seconds
    return table


def _rows(blocks):
    return _aligned(np.pad(blocks, ((0, 0), (0, 0), (0, 2))))


def _lanes(blocks):
    return _aligned(np.moveaxis(blocks.reshape(-1, _LANES, 6, 6), 1, 3))


def _aligned(array):
    """A copy at a multiple of 64 bytes, as vectors of eight ask for."""
    room = np.zeros(array.size + 8)
    first = (-room.ctypes.data % 64) // 8
    out = room[first : first + array.size].reshape(array.shape)
    out[...] = array
    return out


def _least(call, repeats=7):
    seconds = []
    for _ in range(repeats):
        begin = process_time()
        call()
        seconds.append(process_time() - begin)
    return min(seconds)


def parts(problem="twisted") -> dict:
    """Arithmetic, XLA's count and seconds of assembly, factorisation and the step, and of the whole solve."""
    model, boundary = rod_of(PROBLEMS[problem])
    rod = discretise(model, boundary, ELEMENTS)
    start = sagging_start(boundary, model.cable.length, model.gravity, 0, ELEMENTS)
    found = equilibrium(model, boundary, elements=ELEMENTS)
    d = derivatives(rod, found.configuration)
    sides = jnp.stack([d.gradient, d.gradient], axis=-1)
    newton = MixedNewton()
    state = newton.begin(rod, start)

    def step(y, state):
        return newton.step(rod, y, state)

    table = {
        "assembly": _part(lambda c: derivatives(rod, c)[:3], found.configuration),
        "factor and solve, 2 right-hand sides": _part(bt.factor_and_solve, d.diagonal, d.upper, sides),
        "Newton step": _part(step, start, state),
        "generic start": _part(lambda L: sagging_start(boundary, L, model.gravity, 0, ELEMENTS), model.cable.length),
    }
    steps = int(found.verdict.steps)
    seconds = _least(lambda: jax.block_until_ready(equilibrium(model, boundary, elements=ELEMENTS).configuration.r), 50)
    work = steps * table["Newton step"]["arithmetic"] + table["generic start"]["arithmetic"]
    table["whole solve"] = {"steps": steps, "arithmetic": work, "seconds": seconds}
    return table


def _part(function, *args):
    jitted = jax.jit(function, compiler_options=_options())
    jax.block_until_ready(jitted(*args))
    analysis = jitted.lower(*args).compile().cost_analysis()
    inner = 50

    def many():
        for _ in range(inner):
            out = jitted(*args)
        jax.block_until_ready(out)

    return counted(function, *args) | {"XLA's count": analysis.get("flops"), "seconds": _least(many) / inner}


def least_work(nodes=ELEMENTS + 1, sides=2) -> int:
    """Arithmetic that block Cholesky needs: factor of D, two triangular solves of U, U'..U, and substitutions."""
    return nodes * (6**3 // 3 + 6**3 + 6**3) + sides * nodes * (4 * 6**2 + 4 * 6**2)


def limits() -> dict:
    """The counts, the peak, and the share of the peak that each part reaches."""
    jax.config.update("jax_enable_x64", True)
    best, table = peak(), parts()
    rates = {k: v for k, v in best.items() if k != "missing"}
    for row in table.values():
        row["operations per second"] = row["arithmetic"] / row["seconds"]
        if rates:
            row["share of one block at a time"] = row["operations per second"] / rates["multiply_one"]
            row["share of eight at once"] = row["operations per second"] / rates["multiply_wide"]
    return {"elements": ELEMENTS, "peak (1/s)": best, "parts": table, "block Cholesky needs": least_work()}
