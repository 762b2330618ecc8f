"""python score.py MINE.json: scores the answers of a program to the cases beside this file, as README.md says, one a line."""
# ruff: noqa: B905, RUF007 - for any Python, with the standard library alone
import json
import sys
from math import dist, hypot
from pathlib import Path


def apart(p, a, b):  # m, of a point from a segment
    along, off = [y - x for x, y in zip(a, b)], [y - x for x, y in zip(a, p)]
    t = sum(x * y for x, y in zip(along, off)) / (sum(x * x for x in along) or 1.0)
    return dist(off, [min(1.0, max(0.0, t)) * x for x in along])

def far(pose, points):  # m, of points measured from the curve; of markers each from its own place, as far as it was measured
    if pose["markers"]:
        return [hypot(*(x - y for x, y in zip(p, q) if x is not None)) for p, q in zip(pose["points"], points)]
    return [min(apart(p, a, b) for a, b in zip(points, points[1:])) for p in pose["points"]]

def score(mine, true):
    named, missing, right = set(mine.get("named", [])), bool(mine.get("missing")), set(true["accept"])
    tied = named | set(mine.get("tied", []))
    row = {"class": true["class"], "alarm": missing or bool(named), "unexplained": missing and not named}
    row |= {"in_tie_set": bool(tied & right), "both": set(true["truth"]) <= tied, "wrong": not named <= right}
    for name in (x for x in ("bending_stiffness", "torsional_stiffness") if x in true and "low" in mine.get(x, {})):
        row[f"covers_{name}"] = mine[name]["low"] <= true[name] <= mine[name]["high"]
    off = [d for pose, points in mine.get("unseen", {}).items() for d in far(true["unseen"][pose], points)]
    return row | ({"unseen_over_noise": hypot(*off) / len(off) ** 0.5 / true["noise"]} if off else {})

if __name__ == "__main__":
    for file in sorted(Path(__file__).parent.glob("answers/*.json")):
        mine = json.loads(Path(sys.argv[1]).read_text()).get(file.stem, {})
        print(json.dumps({"case": file.stem} | score(mine, json.loads(file.read_text()))))
