"""What `from scan2flex_jax import ...` gives, in processes of their own: no public name is a module's name too."""

import importlib
import pickle
import pkgutil
import subprocess
import sys
from types import ModuleType

import pytest

import scan2flex_jax

PACKAGES = ["scan2flex_jax", *(f"scan2flex_jax.{m.name}" for m in pkgutil.iter_modules(scan2flex_jax.__path__) if m.ispkg)]


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


def test_reading_a_study_does_not_load_jax():
    run("import sys\nfrom scan2flex_jax import load_study\nassert 'jax' not in sys.modules")
