"""What the runs say beside each other: errors against the reference, and two ratios for every other program.

At equal accuracy: the seconds that it took over those of our fastest run on the same problem that is at least as accurate.
At equal mesh: its error over ours with as many elements. Both are formed within one run of the benchmark.
"""

import numpy as np

OURS = "scan2flex_jax"
_REST = 1e-4  # of the length: relaxations that came closer to rest than this are compared by their mesh
_WORSE = 0.7  # of a ratio in the last record: below, it is reported


def scored(peer, answer, curve) -> list[dict]:
    """One row for each thing found: error (largest distance of a node to the reference at its arc length, parts of L)."""
    shared = {"peer": peer, "problem": answer["problem"], "size": answer["size"]}
    if "failed" in answer:
        return [shared | {"failed": answer["failed"]}]
    numbers = {k: answer[k] for k in ("prepare_s", "first_s", "repeats", "wall_median_s", "memory_MB") if k in answer}
    rows = []
    for found in answer["found"]:
        distance = np.linalg.norm(np.array(found["points"]) - curve.at(found["s"]), axis=1)
        error = float(distance.max() / curve.problem.length)
        rows.append(shared | {"error": error, "seconds": found["seconds"]} | found["told"] | numbers)
    return rows


def usable(rows) -> list[dict]:
    """Rows that came to an end, and those relaxations that came to rest."""
    return [r for r in rows if "failed" not in r and r.get("rest to", 0.0) is not None]


def ratios(rows) -> dict:
    """Per peer: seconds over ours at equal accuracy (least, median), errors over ours at equal mesh (least, median)."""
    good = usable(rows)
    ours = [r for r in good if r["peer"] == OURS]
    table = {}
    for peer in dict.fromkeys(r["peer"] for r in rows):
        if peer == OURS:
            continue
        own = [r for r in good if r["peer"] == peer]
        time, beyond = [], 0
        for r in own:
            as_good = [o["seconds"] for o in ours if o["problem"] == r["problem"] and o["error"] <= r["error"]]
            time += [r["seconds"] / min(as_good)] if as_good else []
            beyond += not as_good
        at_mesh = {(o["problem"], o["size"]): o["error"] for o in ours}
        rest = [r for r in own if (r["problem"], r["size"]) in at_mesh and r.get("rest to", 0.0) <= _REST]
        meshed = [r["error"] / at_mesh[r["problem"], r["size"]] for r in rest]
        table[peer] = {
            "seconds over ours at equal accuracy": _spread(time),
            "runs more accurate than any of ours": beyond,
            "error over ours at equal mesh": _spread(meshed),
            "runs": len(own),
            "failed": sum(r["peer"] == peer for r in rows) - len(own),
            "least error": min((r["error"] for r in own), default=None),
            "memory_MB": max((r["memory_MB"] for r in own), default=None),
        }
    return table


def _spread(values):
    return {"least": min(values), "median": float(np.median(values)), "of": len(values)} if values else None


def fallen(before: dict, now: dict) -> list[str]:
    """Sentences on ratios that fell by more than 30 % against those of an older record."""
    told = []
    for peer, row in now.items():
        for key in ("seconds over ours at equal accuracy", "error over ours at equal mesh"):
            old, new = (before.get(peer) or {}).get(key), row[key]
            if old and new and new["median"] < _WORSE * old["median"]:
                told.append(f"{peer}: {key} fell from {old['median']:.3g} to {new['median']:.3g} (median)")
    return told
