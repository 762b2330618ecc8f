"""Build of the compiled solver: source text, compiler, check, and its place in the cache folder."""

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import jax

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.statics.kernel import elements, library
from scan2flex_jax.statics.kernel.operands import check
from scan2flex_jax.statics.kernel.solver import CompiledNewton

_FLAGS = ("-std=c++17", "-O3", "-fno-math-errno", "-ffp-contract=fast", "-w", "-shared", "-fPIC")
_NATIVE = "-march=native"  # not every compiler knows it
_COMPILERS = ("c++", "g++", "clang++")
_CHECKED = 11  # elements of the cable in the check


def build() -> Path:
    """Compile the solver, compare it with `MixedNewton` on one cable, and put it where every solve finds it.

    Returns:
        The file of the library.

    Raises:
        Scan2FlexError: No C++ compiler, one that fails, a folder that cannot be written, or a library whose result differs.
    """
    place = library.path()
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=place.parent) as folder:
            file = _compile(Path(folder))
            check(CompiledNewton(library.register(file)), _CHECKED)
            file.replace(place)
    except OSError as error:
        raise Scan2FlexError(f"{place.parent}: the kernel cannot be written there ({error.strerror}): name another folder"
                             f" in {library.FOLDER}.") from error  # fmt: skip
    return place


def _compile(folder):
    """The library, made in ``folder``."""
    given = os.environ.get("CXX", "").split()
    compiler = given or [c for c in map(shutil.which, _COMPILERS) if c][:1]
    if not compiler:
        raise Scan2FlexError(f"no C++ compiler found ({', '.join(_COMPILERS)}): install one, or name it in CXX.")
    file, here = folder / "settle.so", Path(__file__).parent
    (folder / "elements.inc").write_text(elements.source())
    (folder / "constants.inc").write_text(elements.constants())
    headers = [f"-I{path}" for path in (folder, here, jax.ffi.include_dir())]
    command = [*compiler, *_FLAGS, *headers, str(here / "settle.cpp"), "-o", str(file)]
    for more in ([_NATIVE], []):
        try:
            done = subprocess.run([*command, *more], capture_output=True, text=True, check=False)
        except OSError as error:
            reason = f"the C++ compiler {compiler[0]!r} cannot be run ({error.strerror}): set CXX to another."
            raise Scan2FlexError(reason) from error
        if done.returncode == 0:
            return file
    first = next((line for line in done.stderr.splitlines() if "error" in line), "no message")
    raise Scan2FlexError(f"the C++ compiler {compiler[0]!r} failed ({first}): set CXX to another, which knows C++17.")
