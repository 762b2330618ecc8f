"""Writing a study and its answer: the study shows what a user would know, the answer all that was hidden.

Numbers are rounded as an experimenter would write them; points of a curve to a micrometre. Clamps are written to a
nanometre, the precision with which the truth was solved.
"""

from pathlib import Path

import numpy as np

from . import rod
from .scene import RIGID


def value(v):
    """One value in TOML."""
    if isinstance(v, (bool, np.bool_)):
        return "true" if v else "false"
    if isinstance(v, str):
        return f'"{v}"'
    if isinstance(v, dict):
        return "{ " + ", ".join(f"{k} = {value(x)}" for k, x in v.items()) + " }"
    if isinstance(v, (list, tuple, np.ndarray)):
        return "[" + ", ".join(value(x) for x in v) + "]"
    if isinstance(v, (int, np.integer)):
        return str(int(v))
    text = f"{float(v):.9g}"
    return text if any(c in text for c in ".en") else text + ".0"


def table(entries):
    return [f"{k} = {value(v)}" for k, v in entries.items()]


def guess(rng, truth):
    """A start that is off by a random factor, and the user's range around it."""
    start = float(f"{truth * np.exp(rng.uniform(-1.4, 1.4)):.2g}")
    low, high = np.floor(np.log10(start)) - rng.integers(1, 4), np.ceil(np.log10(start)) + rng.integers(1, 4)
    return {"guess": start, "range": [float(f"{10**low:.1e}"), float(f"{10**high:.1e}")]}


def study_text(rng, case):
    """`study.toml` of a case."""
    scene, cable = case["nominal"], case["nominal"].cable
    known = {"length": cable.length, "radius": cable.radius, "length_density": cable.density}
    if cable.axial < RIGID:
        known |= {"shear_stiffness": cable.shear, "axial_stiffness": cable.axial}
    lines = table({"format": "scan2flex-study/1", "title": f"Cable {case['id']}"})
    lines += table({"gravity": np.round(scene.gravity, 9)})
    lines += ["", "[cable]", *table(known)]
    tolerance = {k: v for k, v in vars(case["tolerance"]).items() if v}
    if tolerance:
        lines += ["", "[tolerance]", *table(tolerance)]
    for name, truth in (("bending_stiffness", cable.bending), ("torsional_stiffness", cable.torsion)):
        lines += ["", f"[unknown.{name}]", *table(guess(rng, truth))]
    for p in range(len(scene.end_kind)):
        lines += ["", "[[pose]]", *table({"name": f"p{p + 1}", "role": "fit" if p < case["fit"] else "validate"})]
        lines += table(_clamps(scene, p))
        lines += table({"centre_curve": f"p{p + 1}.csv"} | ({"noise": case["noise"].sigma} if case["stated"] else {}))
    return "\n".join(lines) + "\n"


def _clamps(scene, p):
    start = {"position": scene.start[0][p], "quaternion": scene.start[1][p]}
    if scene.end_kind[p] == rod.FREE:
        return {"start": start}
    end = {"position": scene.end[0][p]}
    if scene.end_kind[p] == rod.CLAMP:
        end["quaternion"] = scene.end[1][p]
    return {"start": start, "end": end}


def curve_text(points, s=None):
    """CSV of a centre curve."""
    rows = ["s,x,y,z" if s is not None else "x,y,z"]
    for k, x in enumerate(points):
        first = [] if s is None else [f"{s[k]:.6f}"]
        rows.append(",".join(first + [f"{v:.6f}" for v in x]))
    return "\n".join(rows) + "\n"


def write(rng, case, cases, answers):
    """The folder of the study, then the answer: an answer that exists means that the case is complete."""
    folder = Path(cases) / case["id"]
    folder.mkdir(parents=True, exist_ok=True)
    for p, (points, s) in enumerate(zip(case["points"], case["s"], strict=True)):
        (folder / f"p{p + 1}.csv").write_text(curve_text(points, s if case["arc_length"] else None))
    (folder / "study.toml").write_text(study_text(rng, case))
    lines = table({"id": case["id"], **case["answer"]})
    for name, entries in case["tables"].items():
        lines += ["", f"[{name}]", *table(entries)]
    for effect in case["effects"]:
        lines += ["", "[[effect]]", *table(effect)]
    Path(answers).mkdir(parents=True, exist_ok=True)
    (Path(answers) / f"{case['id']}.toml").write_text("\n".join(lines) + "\n")
