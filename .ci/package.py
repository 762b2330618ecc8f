"""Builds the package and uses it as somebody does who has nothing else: the wheel alone, in an empty environment, elsewhere.

    python .ci/package.py            # sdist, wheel, what they hold, help, check and a fit from another folder
    python .ci/package.py --demo     # and `scan2flex demo`, which compiles for a minute or two

Needs the library `build` (extra [test]). Leaves nothing behind.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
INSIDE = (
    "scan2flex_jax/py.typed", "scan2flex_jax/reporting/page.css", "scan2flex_jax/study/kinds.json",
    "scan2flex_jax/study/keys.json",
    "scan2flex_jax/examples/black-wire/study.toml",
)  # fmt: skip


def main() -> None:
    """All of it, or the first thing that is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--demo", action="store_true", help="run `scan2flex demo` too")
    demo = parser.parse_args().demo
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        wheel = built(folder)
        used_alone(wheel, folder, demo)
    print("the package builds, and its wheel works alone")


def built(folder: Path) -> Path:
    """The wheel that the sdist gives; the one of the source tree must hold the same."""
    run(sys.executable, "-m", "build", "--outdir", folder / "of-sdist", ROOT, cwd=folder)
    run(sys.executable, "-m", "build", "--wheel", "--outdir", folder / "of-tree", ROOT, cwd=folder)
    (one,), (other,) = ((folder / d).glob("*.whl") for d in ("of-sdist", "of-tree"))
    held, same = contents(one), contents(other)
    if held != same:
        sys.exit(f"the sdist builds another wheel than the tree: {sorted(held.items() ^ same.items())[:5]}")
    sources = {p.relative_to(ROOT).as_posix() for p in (ROOT / "scan2flex_jax").rglob("*") if p.is_file()}
    missing = {n for n in sources if "__pycache__" not in n} - set(held)
    missing |= set(INSIDE) - set(held)
    if missing:
        sys.exit(f"the wheel lacks {sorted(missing)[:5]}")
    return one


def contents(wheel: Path) -> dict[str, int]:
    """Names and checksums of what is in it."""
    with zipfile.ZipFile(wheel) as archive:
        return {i.filename: i.CRC for i in archive.infolist()}


def used_alone(wheel: Path, folder: Path, demo: bool) -> None:
    """Commands of the wheel, from a folder that is not the source tree and with nothing on the path to it."""
    venv.create(folder / "alone", with_pip=True)
    programs = folder / "alone" / ("Scripts" if os.name == "nt" else "bin")
    run(programs / "python", "-m", "pip", "install", "-q", wheel, cwd=folder)
    study = "import scan2flex_jax.examples as e; print(e.example_path('simulated-cable'))"
    example = run(programs / "python", "-c", study, cwd=folder).strip()
    if Path(example).is_relative_to(ROOT):
        sys.exit(f"the example {example} is that of the source tree")
    scan2flex = programs / "scan2flex"
    for command in (["--help"], ["check", example], ["fit", example, "--json", "result.json"]):
        run(scan2flex, *command, cwd=folder)
    run(scan2flex, "report", example, "--no-explain", cwd=folder)
    said = run(scan2flex, "report", example, "--interactive", "--force", cwd=folder, code=2)
    if "scan2flex_jax[report]" not in said:
        sys.exit(f"an interactive report without plotly does not name its extra: {said}")
    if demo:
        run(scan2flex, "demo", "--out", "demo", cwd=folder)


def run(*command, cwd: Path, code: int = 0) -> str:
    """What a command says; ends the check when its exit code is another one."""
    clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    print("+", *command, flush=True)
    done = subprocess.run([str(c) for c in command], cwd=cwd, env=clean, capture_output=True, text=True, check=False)
    if done.returncode != code:
        sys.exit(f"exit code {done.returncode}, not {code}\n{done.stdout}\n{done.stderr}")
    return done.stdout + done.stderr


if __name__ == "__main__":
    main()
