"""Notebooks: stored as executed, without errors or paths of a machine; run again, they hold the claims that stand here.

A notebook tells a story and asserts nothing itself. Its claims are code that runs in its kernel after its last cell.
"""

import ast
import inspect
import os
import re
import textwrap
from importlib import import_module
from pathlib import Path

import nbformat
import pytest

from notebooks.execute import execute

NOTEBOOKS = sorted((Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))
A_PATH = re.compile(r"/(?:home|root|tmp|Users|work)/")

CLAIMS = {
    "a-calibrated-cable-in-newton": """
        assert not warned and result.believable
        assert away.max() < 0.5  # mm: Newton hangs as our equilibrium does
        root = {name: np.sqrt(np.mean(error**2)) for name, error in errors.items()}
        assert abs(root["Newton"] - root["our equilibrium"]) < 0.2 and root["Newton"] < 15.0  # mm, depth noise of 3 to 5
    """,
    "clamps-known-only-nearly": """
        from scan2flex_jax.sweep import failed

        assert not failed(trusted) and not failed(freed)
        before, after = errors(trusted), errors(freed)
        EI, GJ = "bending_stiffness", "torsional_stiffness"
        assert 0.0 < float((before[EI] < 0).mean()) < 1.0  # not always below the truth
        assert float(before[EI].std()) > 0.02 and float(before[GJ].std()) > 0.02
        for name in TRUTH:  # no bias that these draws could show
            assert abs(float(after[name].mean())) < 3.0 * float(after[name].std() / np.sqrt(COUNT)) + 1e-3
        assert float(after[EI].std()) < 0.2 * float(before[EI].std())
        held = (freed.bending_stiffness_low <= TRUTH[EI]) & (TRUTH[EI] <= freed.bending_stiffness_high)
        assert float(held.mean()) > 0.7
    """,
    "closing-the-loop-on-a-real-cable": """
        assert found.significant and found.verdict == "unexplained"
        assert plain.poses[fitted.name].rms > 3e-3  # m, beside a tracing error of 0.1 mm
        assert after.poses[fitted.name].rms < 0.2 * plain.poses[fitted.name].rms
        law = next(r for r in refitted if r.kind == "nonlinear_bending")
        assert law.rms_fit < 0.6e-3 and next(r for r in refitted if r.kind == "stiffness_taper").rms_fit < 0.6e-3
        unseen = [r.rms_validate for r in refitted if r.rms_validate is not None and np.isfinite(r.rms_validate)]
        assert min(unseen) > 3e-3  # and none predicts the other photograph
    """,
    "intervals-and-the-next-pose": """
        assert all(count >= 16 for count in inside.values())
        assert plane.estimates["bending_stiffness"].identifiable
        assert not plane.estimates["torsional_stiffness"].identifiable
        worth = [c.worth for c in ranked.candidates if not c.note]
        assert worth == sorted(worth, reverse=True) and worth[0] > 0
    """,
    "python-only": """
        assert np.linalg.norm(by_student - np.log(TRUTH)) < 0.5 * np.linalg.norm(by_squares - np.log(TRUTH))
        slope = value_and_gradient(jnp.asarray(best), residual, jnp.asarray(LEAST_SQUARES))[1]
        assert np.linalg.norm(slope) < 1e-2 and np.all(np.linalg.eigvalsh(hessian) > 0)
        np.testing.assert_allclose(hessian, hessian.T, rtol=1e-6)
        assert there.sum() > 20
        assert np.all(rhat < 1.1) and 0.15 < accepted < 0.6
        for name, samples in zip(study.unknown_names, posterior.T, strict=True):
            e = result.estimates[name]
            np.testing.assert_allclose(samples.std(), e.std, rtol=0.35)
            assert abs(samples.mean() - e.value) < 0.5 * e.std
        assert 0.7 < spread["with the set"] < 0.95  # two of three components carry the noise
        assert spread["without the set"] > 2.0
        np.testing.assert_allclose(answers["with the set"]["helical_set.curvature"], SET, atol=0.2)
    """,
    "rod-beside-closed-forms": """
        assert max(tip_errors.values()) < 1e-6  # of the length, 40 elements
        assert abs(drop / (small / 8) - 1) < 1e-5  # the factor 1/2
        assert 0.8 < np.polyfit(np.log(stiffnesses[-3:]), np.log(away[-3:]), 1)[0] < 1.1  # proportional to EI
        assert orders[0] > 3.8 and orders[1] > 3.95  # the last meets the floor that shear and stretch leave
    """,
    "stiffness-along-a-rod": """
        assert not plain.believable and found.believable
        kinds = {effect.kind for effect in found.chosen}
        assert kinds & {"stiffness_field", "stiffness_taper"} and kinds & {"natural_curvature", "kink"}
        assert not kinds & {"tether", "point_load", "stiffness_profile"}
        assert found.rms("validate") < 3e-3 < 0.1 * plain.rms("validate")  # m
        assert abs(modulus / (7.32e6 * 6894.757) - 1) < 0.1
        assert np.all(np.abs(np.log(found.along.at(s[inside])[0] / (modulus * inertia[inside]))) < np.log(1.4))
        assert all(abs(mass / weight - 1) < 0.05 for weight, mass in masses.items())
    """,
    "sweep-over-guesses": """
        assert bool(near.all()) and not failed(found)
        lowest = rms.where(rms == rms.min(), drop=True)
        assert float(lowest.bending_stiffness[0]) == 0.1  # the grid's own node nearest to the truth
        along = np.diag(rms.sel(bending_stiffness=slice(9.0, None), torsional_stiffness=slice(9.0, None)))
        assert along.max() / along.min() < 1.2  # nearly flat: ten times stiffer, about the same shape
        assert 15 <= int(close(alone).sum()) < 25
        hit = close(alone)
        assert float(alone.cost.where(hit).max()) < float(alone.cost.where(~hit).min())  # the misses fit worse
    """,
    "weights-on-a-soft-arm": """
        pulls = {"point_mass", "point_load", "tether", "density_profile"}  # at one place
        assert set(rivals) - {"stiffness_field"} <= pulls and set(rivals) & pulls
        assert abs(place - L) < 0.05
        assert hung < mass < 2.0 * hung  # too heavy, as its last text says
        after = np.sqrt(np.mean([found.poses[name].rms ** 2 for name in names]))
        assert after < 0.2 * unseen  # in held-out poses
    """,
    "your-own-scans": """
        assert all(curve.sure for curve in curves.values()) and rough.sure
        for name, (curve, _) in sensors.items():
            error = np.sqrt(np.mean(away(curve)[10:-10] ** 2))  # without the ends, which the scan does not reach
            assert error < (0.3 * 0.5e-3 if name == "structured light" else 0.5 * 3.5e-3)  # of a single point's noise
            assert error < 4.0 * np.median(curve.std)
        assert not study_warnings(study)
        for name, true in (("bending_stiffness", EI), ("torsional_stiffness", GJ)):
            estimate = result.estimates[name]
            np.testing.assert_allclose(estimate.value, true, rtol=0.01)
            assert abs(estimate.value - true) < 3.0 * estimate.std  # one draw of the noise: its 95 % interval may miss
        assert result.valid and result.poses["unseen"].ratio < 1.5
        assert xml.startswith("<mujoco")
    """,
}

NEEDS = {
    "weights-on-a-soft-arm": "SOFT_ARM names no clones of PAC_model_matlab and floating_PAC_model (github.com/sebtiburzio)"
}
"""Notebooks that read measurements which do not come with the project, and what to say without them."""
LINK = re.compile(r"\]\(([^)#:\s]+)(?:#[^)\s]*)?\)")


def outputs(notebook):
    return [output for cell in notebook.cells for output in cell.get("outputs", [])]


def test_each_notebook_has_its_claims():
    assert {path.stem for path in NOTEBOOKS} == set(CLAIMS)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_is_stored_as_executed_without_paths_of_a_machine(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    assert path.stat().st_size < 400_000
    assert notebook.cells[0].source.startswith("# ")
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))
    assert not any(output.output_type == "error" or output.get("name") == "stderr" for output in outputs(notebook))
    assert any("image/png" in output.get("data", {}) for output in outputs(notebook))
    shown = [output.get("text", "") + str(output.get("data", {}).get("text/plain", "")) for output in outputs(notebook)]
    assert not A_PATH.search("\n".join([cell.source for cell in notebook.cells] + shown))
    text = "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "markdown")
    assert [target for target in LINK.findall(text) if not (path.parent / target).exists()] == []


def calls(path):
    """Each call of a function that a notebook imports from the package: the function, and the call's syntax."""
    cells = [cell.source for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]
    nodes = list(ast.walk(ast.parse("\n".join(cells))))
    sources = [node for node in nodes if isinstance(node, ast.ImportFrom) and node.module.split(".")[0] == "scan2flex_jax"]
    known = {name.name: getattr(import_module(source.module), name.name) for source in sources for name in source.names}
    for node in nodes:
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and inspect.isroutine(known.get(node.func.id)):
            yield known[node.func.id], node


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_calls_have_the_arguments_that_the_package_takes(path):
    """What only the slow run would show after a change of a function that a notebook calls."""
    found = list(calls(path))
    assert found
    for function, call in found:
        if not any(isinstance(a, ast.Starred) for a in call.args) and all(k.arg for k in call.keywords):
            inspect.signature(function).bind(*call.args, **{k.arg: k.value for k in call.keywords})


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
@pytest.mark.slow
def test_runs_and_holds_its_claims(path):
    if path.stem.endswith("newton"):
        pytest.importorskip("newton", reason="Newton is not installed: pip install 'newton[importers]'")
    if path.stem in NEEDS and not (Path(os.environ.get("SOFT_ARM", "")) / "PAC_model_matlab").is_dir():
        pytest.skip(NEEDS[path.stem])
    notebook = nbformat.read(path, as_version=4)
    notebook.cells.append(nbformat.v4.new_code_cell(textwrap.dedent(CLAIMS[path.stem])))
    execute(notebook)
