"""Tests the lowest versions that pyproject.toml allows, in an environment of their own.

    python .ci/lowest.py             # environment, tests of everything that a library is used for, some minutes
    python .ci/lowest.py --print     # only the versions, as constraints for pip

`[test]` itself is not lowered (old linters and test runners are nobody's concern), nor `[peers]` and `[notebooks]`, which the
package never imports.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
import tomllib
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
EXTRAS = ("report", "scans", "sweep")
RUNNERS = ("pytest", "pytest-xdist", "beartype", "hypothesis")
TESTS = (
    "test_toolchain.py", "test_public_names.py", "cli/test_help.py", "cli/test_measuring.py", "study", "convert",
    "scan/test_files.py", "statics/test_blocktridiagonal.py", "fitting/test_result.py", "fitting/test_simulation_study.py",
    "reporting/test_page.py", "reporting/test_plot.py", "sweep/test_store.py",
)  # fmt: skip


def lowest() -> dict[str, str]:
    """Lowest version of every library that the package imports."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = [*project["dependencies"], *(r for extra in EXTRAS for r in project["optional-dependencies"][extra])]
    return dict(re.match(r"([\w.-]+)\s*>=\s*([\w.]+)", requirement).groups() for requirement in wanted)


def main() -> None:
    """Versions, environment, tests; the exit code of the tests."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--print", action="store_true", help="print the versions and end")
    constraints = "".join(f"{name}=={version}\n" for name, version in lowest().items())
    if parser.parse_args().print:
        sys.stdout.write(constraints)
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "lowest.txt").write_text(constraints)
        venv.create(folder / "env", with_pip=True)
        python = folder / "env" / ("Scripts" if os.name == "nt" else "bin") / "python"
        package = f"{ROOT}[{','.join(EXTRAS)}]"
        install = ["-m", "pip", "install", "-q", "-e", package, *RUNNERS, "-c", str(folder / "lowest.txt")]
        subprocess.run([python, *install], check=True)
        tests = [str(ROOT / "tests" / name) for name in TESTS]
        ran = subprocess.run(
            [python, "-m", "pytest", "-q", "-p", "no:xdist", "-o", "addopts=-m 'not slow'", *tests], cwd=ROOT, check=False
        )
    sys.exit(ran.returncode)


if __name__ == "__main__":
    main()
