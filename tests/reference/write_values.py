"""Write the solved clamped cases to values/*.json: `python -m tests.reference.write_values` from the repository's root.

A file holds the case (all its inputs) and the answer: s (21,) m, positions (21, 3) m, frames (21, 3, 3) with the
directors as columns, forces (21, 3) N and moments (21, 3) N m in space, energy (J) and the lowest point (z, s in m). The case
has the fields of `cosserat_bvp.Clamped`; matrices are lists of rows.
"""

import json
from pathlib import Path

from . import clamped_cases

FOLDER = Path(__file__).parent / "values"


def rounded(x):
    """Nested lists with 12 decimals: more than the solution holds; minus zero becomes zero."""
    return (x.round(12) + 0.0).tolist()


def answer(name):
    """Record (a dict of numbers and lists) of the named case, solved now."""
    rod, solution = clamped_cases.CASES[name], clamped_cases.solve_case(name)
    s = rod.length * clamped_cases.STATIONS
    fields = ("positions", "frames", "forces", "moments")
    case = {key: value if isinstance(value, int | float) else rounded(value) for key, value in rod._asdict().items()}
    z, s_lowest = solution.lowest()
    return {
        "case": case,
        "s": rounded(s),
        **{field: rounded(getattr(solution, field)(s)) for field in fields},
        "energy": round(float(solution.energy()), 12),
        "lowest": {"z": round(z, 10), "s": round(s_lowest, 6)},
    }


def load(name):
    """The recorded answer of a case, as `answer` gives it."""
    return json.loads((FOLDER / f"{name}.json").read_text())


def main():
    FOLDER.mkdir(exist_ok=True)
    for name in clamped_cases.CASES:
        lines = [f'"{key}": {json.dumps(value)}' for key, value in answer(name).items()]
        (FOLDER / f"{name}.json").write_text("{\n" + ",\n".join(lines) + "\n}\n")


if __name__ == "__main__":
    main()
