"""Prints the lowest versions that pyproject.toml allows, as constraints for pip.

    python .ci/lowest.py > lowest.txt && pip install -e '.[test]' -c lowest.txt

`[test]` itself is not lowered: old linters and test runners are nobody's concern.
"""

import re
import tomllib
from pathlib import Path

project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]
extras = [r for name, requirements in project["optional-dependencies"].items() if name != "test" for r in requirements]
for requirement in dict.fromkeys([*project["dependencies"], *extras]):
    name, low = re.match(r"([\w.-]+)\s*>=\s*([\w.]+)", requirement).groups()
    print(f"{name}=={low}")
