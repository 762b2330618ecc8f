"""The compiled solver on a GPU of NVIDIA: `settle.cu`, compiled at the first solve and kept beside the library of the CPU.

NVRTC, which ``jax[cuda13]`` installs, compiles it for the card and the number of elements; no compiler of the user's is needed.
Only `solver.default_solver` imports this module, where JAX has a GPU.
"""

import contextlib
import ctypes
import importlib.util
import math
import tempfile
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.rod.assembly import derivatives
from scan2flex_jax.rod.model import Configuration, Rod
from scan2flex_jax.statics.kernel import elements, foreign, library
from scan2flex_jax.statics.kernel.operands import check, operands, translated
from scan2flex_jax.statics.newton import MixedNewton
from scan2flex_jax.statics.solver import AbstractRodSolver, Settled, Steps

TARGET = "scan2flex_settle_cuda"
_ROW, _SLOT = 69 * 8, 128  # bytes of shared memory: of a node, and of a rod besides
_THREADS, _LANES = 256, 16  # most threads of a block, each of which may then have 255 registers; those that eliminate a rod
_KEPT, _COUNTS = 57, 4  # rows of `kept` and entries of `counts` in `settle.cu`
_SYMMETRIC, _ALONG, _R = (1, 3), (2, 4, 5, 9, 10, 11), 9  # places of operands: symmetric, along the rod, the start's nodes
_PROCESSORS, _MAJOR, _MINOR, _SHARED, _DYNAMIC = 16, 75, 76, 97, 8  # attributes of a device, and of a function, in CUDA


class Operands(ctypes.Structure):
    """The argument of the kernel: arrays those of `operands.operands`, two results, the number of rods."""

    _fields_ = (("arrays", ctypes.c_void_p * 17), ("rods", ctypes.c_int))


class Card(NamedTuple):
    """What the kernel depends on: compute capability (90 for 9.0), bytes of shared memory for a block, multiprocessors."""

    capability: int
    shared: int
    processors: int


class CudaNewton(AbstractRodSolver):
    """`MixedNewton` as a kernel of a GPU: the same steps, and the same result to rounding, with JAX's derivatives there.

    ``target`` is the name of the function in XLA for a ``platform``. On others, and for rods that it cannot solve (those whose
    effects add energies of their own, or of too many elements for the card), `MixedNewton` is run; and for all rods of as many
    elements where it does not solve one cable as `MixedNewton` does, unless it is ``trusted``.
    """

    target: str = TARGET
    platform: str = "cuda"
    atol: float = MixedNewton.atol
    trusted: bool = False

    def settle(self, rod: Rod, start: Configuration, max_steps: Steps = None) -> Settled:
        """See `AbstractRodSolver.settle`."""
        newton = MixedNewton(self.atol)
        arrays = operands(rod, start, newton, max_steps)
        if not translated(rod, arrays) or not (self.trusted or _solves(rod.elements)):
            return newton.settle(rod, start, max_steps)

        def of_kernel():
            shapes = [
                jax.ShapeDtypeStruct((_KEPT, rod.elements + 1), jnp.float64), jax.ShapeDtypeStruct((_COUNTS,), jnp.int32)
            ]  # fmt: skip
            kept, counts = jax.ffi.ffi_call(self.target, shapes, vmap_method="broadcast_all")(*_turned(arrays))
            end = Configuration(kept[:3].T, kept[3:12].T.reshape(-1, 3, 3))
            steps, negative = counts[:2].astype(int)
            return Settled(end, derivatives(rod, end), negative, steps, counts[2] > 0)

        other = partial(newton.settle, rod, start, max_steps)
        return jax.lax.platform_dependent(default=other, **{self.platform: of_kernel})


def register(launch: Callable[[Operands, int, foreign.Call], None], target: str, platform: str) -> None:
    """Make ``launch``, which gets the argument of the kernel and the number of elements, a function of XLA."""

    def call(call):
        rods = math.prod(call.arrays[0].shape)
        if rods:
            addresses = (ctypes.c_void_p * 17)(*(array.address for array in call.arrays))
            launch(Operands(addresses, rods), call.arrays[_R].shape[-1] - 1, call)

    foreign.register(target, call, platform)
    jax.ffi.register_ffi_target_as_batch_partitionable(target)


@cache
def solver() -> AbstractRodSolver:
    """The default solver where JAX has a GPU."""
    if library.switched_off() or _driver() is None:
        return MixedNewton()
    register(_launch, TARGET, "cuda")
    return CudaNewton()


def rods_of_a_block(elements: int, card: Card) -> int:
    """How many rods a multiprocessor solves at a time.

    Raises:
        Scan2FlexError: Not one fits.
    """
    bytes_of_a_rod = (elements + elements % 2 + 1) * _ROW + _SLOT
    rods = min(_THREADS // max(elements + 1, _LANES), card.shared // bytes_of_a_rod)
    if not rods:
        raise Scan2FlexError(f"a rod of {elements} elements does not fit on a multiprocessor of this GPU"
                             f" ({card.shared // 1024} kB of shared memory): XLA solves it, more slowly.")  # fmt: skip
    return rods


def compiled_for(elements: int, card: Card) -> bytes:
    """The machine code of the kernel for a card, by NVRTC.

    Raises:
        Scan2FlexError: NVRTC is not installed, or refuses; or the rod does not fit.
    """
    options = {"N": elements, "RODS": rods_of_a_block(elements, card)}
    nvrtc, program, here = _nvrtc(), ctypes.c_void_p(), Path(__file__).parent
    files = _translation() | {"decisions.h": (here / "decisions.h").read_bytes()}
    names = [name.encode() for name in files]
    given = [f"-arch=sm_{card.capability}", "-std=c++17", *(f"-D{name}={value}" for name, value in options.items())]

    def texts(values):
        return (ctypes.c_char_p * len(values))(*values)

    def answer(of):
        size = ctypes.c_size_t()
        getattr(nvrtc, f"nvrtcGet{of}Size")(program, ctypes.byref(size))
        text = ctypes.create_string_buffer(size.value)
        getattr(nvrtc, f"nvrtcGet{of}")(program, text)
        return text.raw

    source = (here / "settle.cu").read_bytes()
    nvrtc.nvrtcCreateProgram(ctypes.byref(program), source, b"settle.cu", len(files), texts(list(files.values())), texts(names))
    try:
        if nvrtc.nvrtcCompileProgram(program, len(given), texts([x.encode() for x in given])):
            first = next((line for line in answer("ProgramLog").decode().splitlines() if "error" in line), "no message")
            raise Scan2FlexError(f"the kernel for GPUs cannot be compiled ({first}): XLA solves, more slowly.")
        return answer("CUBIN")
    finally:
        nvrtc.nvrtcDestroyProgram(ctypes.byref(program))


@cache
def _translation():
    """What `settle.cu` includes, made from the package outside of the trace of a solve, and not on the card."""

    def source():
        with contextlib.ExitStack() as stack:
            with contextlib.suppress(RuntimeError):  # JAX_PLATFORMS leaves the CPU out
                stack.enter_context(jax.default_device(jax.devices("cpu")[0]))
            return elements.source()

    with ThreadPoolExecutor(1) as thread:
        return {"elements.inc": thread.submit(source).result().encode(), "constants.inc": elements.constants().encode()}


def _nvrtc():
    package = importlib.util.find_spec("nvidia")
    folders = package.submodule_search_locations if package else ()
    files = [str(file) for folder in folders or () for file in sorted(Path(folder).glob("*/lib/libnvrtc.so.*"))]
    for name in (*files, "libnvrtc.so.13", "libnvrtc.so.12"):
        with contextlib.suppress(OSError):
            return ctypes.CDLL(name)
    raise Scan2FlexError("NVRTC, which jax[cuda13] brings, is not installed, and compiles no kernel: XLA solves, more slowly.")


@cache
def _solves(n):
    """Whether the card solves rods of ``n`` elements, tried outside of the trace of a solve; a warning says why not."""

    def tried():
        with jax.enable_x64(True):
            check(CudaNewton(trusted=True), n)

    try:
        _code(n)
        with ThreadPoolExecutor(1) as thread:
            thread.submit(tried).result()
    except (Scan2FlexError, RuntimeError) as error:  # XLA's errors are of the latter kind
        warnings.warn(str(error), stacklevel=2)
        return False
    return True


@cache
def _code(n):
    """The machine code, kept where the library of the CPU is; `_solves` makes it when a solve is traced."""

    def file():
        library_file = library.path()
        return library_file.with_name(f"{library_file.stem}-sm_{_card().capability}-{n}.cubin")

    with contextlib.suppress(OSError, RuntimeError):  # not there, or no home
        if library.ours(file()):
            return file().read_bytes()
    code = compiled_for(n, _card())
    with contextlib.suppress(OSError, RuntimeError):
        file().parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=file().parent, delete=False) as part:
            part.write(code)
        Path(part.name).replace(file())
    return code


@cache
def _driver():
    """The library of the card's driver; None without one."""
    with contextlib.suppress(OSError):
        return ctypes.CDLL("libcuda.so.1")
    return None


def _do(name, *arguments):
    """Call a function of the driver."""
    code = getattr(_driver(), name)(*arguments)
    if code:
        text = ctypes.c_char_p()
        _driver().cuGetErrorString(code, ctypes.byref(text))
        raise RuntimeError(f"{name}: {(text.value or b'unknown error').decode()}")


@cache
def _card():
    """The first card; all are taken to be alike."""
    value = ctypes.c_int()
    _do("cuInit", 0)

    def of(attribute):
        _do("cuDeviceGetAttribute", ctypes.byref(value), attribute, 0)
        return value.value

    return Card(10 * of(_MAJOR) + of(_MINOR), of(_SHARED), of(_PROCESSORS))


@cache
def _function(context, n):
    """The kernel in a context, which is the current one."""
    module, function = ctypes.c_void_p(), ctypes.c_void_p()
    _do("cuModuleLoadData", ctypes.byref(module), _code(n))
    _do("cuModuleGetFunction", ctypes.byref(function), module, b"settle")
    _do("cuFuncSetAttribute", function, _DYNAMIC, _dynamic(n))
    return function


def _dynamic(n):
    """Bytes of shared memory of a block, besides those that the kernel declares."""
    return rods_of_a_block(n, _card()) * (n + n % 2 + 1) * _ROW


def _launch(operands, n, call):
    context, stream = ctypes.c_void_p(), ctypes.c_void_p(call.stream())
    _do("cuStreamGetCtx", stream, ctypes.byref(context))
    _do("cuCtxPushCurrent_v2", context)
    try:
        function, blocks = _function(context.value, n), min(_card().processors, operands.rods)
        threads = -(-rods_of_a_block(n, _card()) * max(n + 1, _LANES) // 32) * 32
        _do("cuMemsetD32Async", ctypes.c_void_p(operands.arrays[16] + 4 * 3), 0, ctypes.c_size_t(1), stream)
        argument = (ctypes.c_void_p * 1)(ctypes.addressof(operands))
        _do("cuLaunchKernel", function, blocks, 1, 1, threads, 1, 1, _dynamic(n), stream, argument, None)
    finally:
        _do("cuCtxPopCurrent_v2", ctypes.byref(context))


def _turned(arrays):
    """The operands with the entries of elements and nodes first, of symmetric matrices the lower triangle."""

    def lower(x):
        return x[:, *np.tril_indices(x.shape[-1])].T

    def rows(x):
        return x.reshape(len(x), -1).T

    return [lower(x) if i in _SYMMETRIC else rows(x) if i in _ALONG else x for i, x in enumerate(arrays)]
