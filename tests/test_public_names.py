"""The public names: none is a module's name too, and each says what it takes and answers, with an example that holds."""

import doctest
import importlib
import inspect
import pickle
import pkgutil
import subprocess
import sys
from dataclasses import replace
from types import ModuleType

import jax
import pytest

import scan2flex_jax

PACKAGES = ["scan2flex_jax", *(f"scan2flex_jax.{m.name}" for m in pkgutil.iter_modules(scan2flex_jax.__path__) if m.ispkg)]
NAMES = {name: getattr(scan2flex_jax, name) for name in scan2flex_jax.__all__}
IN_SENTENCES = {"report"}  # arguments without a list
FUNCTIONS = sorted({name for name, value in NAMES.items() if inspect.isfunction(value)} - IN_SENTENCES)
CLASSES = ["Boundary", "Cable", "CableModel", "Clamp", "EffectDeclaration", "Markers", "MeasuredCurve", "Study", "StudyError"]
CLASSES += ["StudyPose", "Tolerance", "Unknown"]
WITHOUT_EXAMPLE = {"solve_rod"}  # that of `equilibrium` serves


def run(code):
    command = [sys.executable, "-W", "error::ImportWarning", "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_no_public_name_hides_a_module():
    hidden = []
    for package in PACKAGES:
        module = importlib.import_module(package)
        modules = {m.name for m in pkgutil.iter_modules(module.__path__)}
        hidden += [n for n in getattr(module, "__all__", ()) if n in modules and not isinstance(getattr(module, n), ModuleType)]
    assert hidden == []


def test_every_public_name_is_there_and_an_assignment_stays():
    run(
        "import sys\nfrom scan2flex_jax import load_study\nassert 'jax' not in sys.modules\n"  # reading a study needs no JAX
        "import scan2flex_jax as s\n"
        "for n in s.__all__: getattr(s, n)\n"
        "assert 'fit' in dir(s) and all(map(callable, (s.equilibrium, s.fit, s.predict)))\n"
        "s.fit = 3\nfrom scan2flex_jax import fit\nassert fit == 3"
    )


@pytest.mark.parametrize("name", ["equilibrium", "explain", "fit", "plan", "predict", "report"])
def test_functions_are_pickled_by_name_and_print_their_name(name):
    function = getattr(scan2flex_jax, name)
    assert pickle.loads(pickle.dumps(function)) is function
    assert repr(function).startswith(f"<function {name}")


def test_the_optional_libraries_are_imported_when_a_sweep_needs_them():
    libraries = {"xarray", "zarr", "dask", "distributed"}
    run(f"import sys\nimport scan2flex_jax.sweep\nassert not {libraries} & {{*sys.modules}}")


def functions(name: str, thing):
    """The functions behind a public name: itself, or a class's own public methods."""
    thing = inspect.unwrap(thing)
    if inspect.isclass(thing):
        own = [(f"{name}.{key}", member) for key, member in vars(thing).items() if not key.startswith("_")]
        return [(key, inspect.unwrap(f)) for key, f in own if inspect.isfunction(f)]
    return [(name, thing)] if inspect.isfunction(thing) else []


def unsaid(function) -> list[str]:
    """Arguments, and the answer, without an annotation."""
    signature = inspect.signature(function)
    empty = inspect.Signature.empty
    found = [p.name for p in signature.parameters.values() if p.annotation is empty and p.name not in ("self", "cls")]
    return found + (["the answer"] if signature.return_annotation is empty else [])


@pytest.mark.parametrize("package", [p for p in PACKAGES if p.rpartition(".")[2] not in ("cli", "examples")])
def test_public_functions_are_annotated(package):
    """A type checker knows nothing of what is left unsaid."""
    module = importlib.import_module(package)
    public = [(name, getattr(module, name)) for name in getattr(module, "__all__", ())]
    every = [pair for name, thing in public for pair in functions(name, thing)]
    assert {name: lacking for name, f in every if (lacking := unsaid(f))} == {}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_say_arguments_and_answer(name):
    text = inspect.getdoc(NAMES[name])
    assert "\nArgs:\n" in text
    assert "\nReturns:\n" in text
    for argument in inspect.signature(NAMES[name]).parameters:
        assert f"\n    {argument}: " in text, argument


@pytest.mark.parametrize("name", sorted({*CLASSES, *FUNCTIONS} - WITHOUT_EXAMPLE))
def test_examples_give_what_they_show(name):
    known = {**NAMES, "jax": jax, "replace": replace}
    found = [t for t in doctest.DocTestFinder().find(NAMES[name], name, globs=known) if t.examples]
    assert found, f"{name} has no example"
    for test in found:
        said = []
        doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(test, out=said.append)
        assert not said, "".join(said)
