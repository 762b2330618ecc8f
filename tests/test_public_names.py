"""What `from scan2flex_jax import ...` gives, in a process of its own: three functions have the names of modules."""

import subprocess
import sys

import pytest

IMPORTS = (
    "from scan2flex_jax import Boundary, Cable, CableModel, equilibrium, fit, load_study, predict",
    "import scan2flex_jax.equilibrium.solve, scan2flex_jax.fit.run, scan2flex_jax.predict\n"
    "from scan2flex_jax import equilibrium, fit, predict",
)


@pytest.mark.parametrize("imports", IMPORTS, ids=["at once", "after the modules"])
def test_functions_and_not_the_modules_of_their_names(imports):
    code = f"{imports}\nfrom scan2flex_jax.fit import METHODS\nassert all(map(callable, (equilibrium, fit, predict)))"
    command = [sys.executable, "-W", "error::ImportWarning", "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_every_public_name_is_there():
    code = "import scan2flex_jax as s\nfor n in s.__all__: getattr(s, n)\nassert 'fit' in dir(s)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_reading_a_study_does_not_load_jax():
    code = "import sys\nfrom scan2flex_jax import load_study\nassert 'jax' not in sys.modules"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
