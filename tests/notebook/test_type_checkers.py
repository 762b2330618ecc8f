"""What mypy and pyright say of a notebook's script that uses every public name: all of it is typed, and mistakes are reported.

The scripts lie outside of the source tree and import the package as an installed one (it ships ``py.typed``).
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import scan2flex_jax

pytestmark = pytest.mark.slow

ROOT = Path(scan2flex_jax.__file__).parents[1]
SCRIPT = """
import numpy as np

from scan2flex_jax import Boundary, Cable, CableModel, StudyError, equilibrium, explain, fit, load_study, plan, plot, predict
from scan2flex_jax import report, save_study


cable = Cable(length=0.9, length_density=0.05, bending_stiffness=[0.02, 0.03], torsional_stiffness=np.float64(0.015))
held = Boundary.of((np.zeros(3), np.eye(3)), (np.array([0.5, 0.0, 0.0]), None))
solved = equilibrium(CableModel(cable, [0.0, 0.0, -9.81]), held)
reveal_type(solved)
reveal_type(solved.points)
reveal_type(solved.verdict.sentence())
study = load_study("my-cable")
reveal_type(study)
result = fit(study, method="bfgs", progress=print)
reveal_type(result.estimates["bending_stiffness"].value)
reveal_type(result.calibrated)
reveal_type(result.minimum.iterations)
explanation = explain(study, elements=40)
reveal_type(explanation.verdict)
reveal_type(explanation.ranking[0].log_evidence)
reveal_type(plan(explanation).candidates[0].worth)
reveal_type(predict(study)["sag"].points)
reveal_type(report(result))
reveal_type(save_study(result.calibrated, "calibrated"))
reveal_type(plot.overview(result))
try:
    load_study("elsewhere")
except StudyError as fault:
    reveal_type(fault.key)
"""
REVEALED = {  # expression: its type, in the words that both checkers share
    "solved": "Equilibrium",
    "solved.points": "Array",
    "solved.verdict.sentence()": "str",
    "study": "Study",
    'result.estimates["bending_stiffness"].value': "float | ndarray",
    "result.calibrated": "Study",
    "result.minimum.iterations": "int",
    "explanation.verdict": "str",
    "explanation.ranking[0].log_evidence": "float",
    "plan(explanation).candidates[0].worth": "float",
    'predict(study)["sag"].points': "ndarray",
    "report(result)": "str",
    'save_study(result.calibrated, "calibrated")': "Path",
    "plot.overview(result)": "Figure",
    "fault.key": "str | None",
}
ANSWERS = {"fit": "Fit", "explain": "Explanation", "plan": "Plan", "equilibrium": "Equilibrium", "load_study": "Study",
           "report": "str", "Cable": "Cable"}  # fmt: skip
MISTAKES = """
from scan2flex_jax import Cable, equilibrium, explain, fit, load_study, plan, predict, report, save_study

study = load_study("my-cable")
load_study(3)
Cable(length=0.9, density=0.05, bending_stiffness=0.02, torsional_stiffness=0.015)
Cable(length="0.9 m", length_density=0.05, bending_stiffness=0.02, torsional_stiffness=0.015)
fit("my-cable")
fit(study, methd="bfgs")
fit(study).estimate
explain(study, elements="forty")
plan(study)
predict(study, elements="many")
equilibrium(study, 3)
report(3)
save_study(study)
"""
FIRST_MISTAKE = 4  # line


def environment() -> dict[str, str]:
    """That of a process which finds the package of this source tree."""
    return {**os.environ, "PYTHONPATH": str(ROOT), "MYPYPATH": str(ROOT)}


def by_mypy(folder: Path) -> list[tuple[str, int, str, str]]:
    """``(script, line, severity, message)`` of all that mypy says."""
    command = [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", "--no-error-summary", str(folder)]
    options = ["--cache-dir", str(ROOT / ".pytest_cache" / "mypy"), "--python-executable", sys.executable]
    done = subprocess.run([*command, *options], cwd=folder, env=environment(), capture_output=True, text=True, check=False)
    assert done.returncode in (0, 1), done.stdout + done.stderr
    found = re.findall(r"^[^\n:]*?(\w+)\.py:(\d+): (\w+): (.*)$", done.stdout, re.M)
    return [(script, int(line), severity, message) for script, line, severity, message in found]


def by_pyright(folder: Path) -> list[tuple[str, int, str, str]]:
    """``(script, line, severity, message)`` of all that pyright says."""
    command = [sys.executable, "-m", "pyright", "--outputjson", "--pythonpath", sys.executable, str(folder)]
    done = subprocess.run(command, cwd=folder, env=environment(), capture_output=True, text=True, check=False)
    try:
        found = json.loads(done.stdout)["generalDiagnostics"]
    except ValueError:
        lines = (done.stderr or done.stdout).strip().splitlines() or ["it said nothing"]
        sentence = f"pyright cannot be started: {lines[-1]}"
        (pytest.fail if os.environ.get("CI") else pytest.skip)(sentence)
    return [(Path(d["file"]).stem, d["range"]["start"]["line"] + 1, d["severity"], d["message"]) for d in found]


def type_in(message: str) -> str:
    """The type that a checker reveals, without the modules of classes and the parameters of arrays."""
    found = re.search(r'Revealed type is "(.*)"$|Type of ".*" is "(.*)"$', message)
    name = (found[1] or found[2]).replace("builtins.", "")
    while (shorter := re.sub(r"\[[^\[\]]*\]", "", name)) != name:
        name = shorter
    return re.sub(r"\b(?:\w+\.)+(\w+)", r"\1", name)


NAMES = scan2flex_jax.__all__
SCRIPTS = {
    "typical": SCRIPT,
    "names": "import scan2flex_jax\n" + "".join(f"reveal_type(scan2flex_jax.{name})\n" for name in NAMES),
    "mistakes": MISTAKES,
}


@pytest.fixture(scope="module", params=[by_mypy, by_pyright], ids=["mypy", "pyright"])
def said(request, tmp_path_factory):
    """What a checker says of each script, by lines; it runs once."""
    folder = tmp_path_factory.mktemp("scripts")
    for name, text in SCRIPTS.items():
        (folder / f"{name}.py").write_text(text)
    found = request.param(folder)
    return {name: [rest for script, *rest in found if script == name] for name in SCRIPTS}


def test_a_script_of_typical_results_is_typed(said):
    found = said["typical"]
    assert [message for _, severity, message in found if severity in ("error", "warning")] == []
    lines = SCRIPT.splitlines()
    types = {re.fullmatch(r"\s*reveal_type\((.*)\)", lines[at - 1])[1]: type_in(message) for at, _, message in found}
    assert types == REVEALED


def test_every_public_name_has_a_type(said):
    found = said["names"]
    assert [severity for _, severity, _ in found if severity in ("error", "warning")] == []
    revealed = {NAMES[at - 2]: message for at, _, message in found}
    assert set(revealed) == set(NAMES)
    assert {name for name, message in revealed.items() if type_in(message) in ("Any", "Unknown")} == set()
    for name, answer in ANSWERS.items():
        of_call = re.search(r'(?:-> |is "type\[)(?:\w+\.)*(\w+)\]?"$', revealed[name])
        assert of_call and of_call[1] == answer, revealed[name]


def test_wrong_names_and_types_are_reported(said):
    reported = {at for at, severity, _ in said["mistakes"] if severity == "error"}
    assert reported == set(range(FIRST_MISTAKE + 1, len(MISTAKES.splitlines()) + 1))
