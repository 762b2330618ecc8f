"""What the runs say beside each other: errors against the reference, and two ratios for every other program.

At equal accuracy: the seconds that it took over those of our fastest run on the same problem that is at least as accurate, of
those that were made right after it (``beside``). At equal mesh: its error over ours with as many elements.
"""

import numpy as np

OURS = "scan2flex_jax"
_ALIKE = 1.0 + 1e-6  # the same minimum of the same energy, found by two programs, is as accurate
_REST = 1e-4  # of the length: relaxations that came closer to rest than this are compared by their mesh


def scored(peer, answer, beside, curve) -> list[dict]:
    """One row for each thing found, with the seconds of our own answers ``beside`` it, by mesh."""
    shared = {"peer": peer, "problem": answer["problem"], "size": answer["size"]}
    if "failed" in answer:
        return [shared | {"failed": answer["failed"]}]
    numbers = {k: v for k, v in answer.items() if k in ("prepare_s", "first_s", "repeats", "wall_median_s")}
    own = {str(n): a["found"][0]["seconds"] for n, a in beside.items() if "failed" not in a}
    return [shared | _seen(found, curve) | found["told"] | numbers | {"beside": own} for found in answer["found"]]


def _seen(found, curve):
    """Error (largest distance of a node to the reference at its arc length, parts of L) and processor seconds."""
    distance = np.linalg.norm(np.array(found["points"]) - curve.at(found["s"]), axis=1)
    return {"error": float(distance.max() / curve.problem.length), "seconds": found["seconds"]}


def with_the_least(rows) -> list[dict]:
    """The rows, ours with the least seconds of all times that we were asked the same beside others."""
    least = {}
    for r in rows:
        for n, seconds in r.get("beside", {}).items():
            key = r["problem"], int(n)
            least[key] = min(seconds, least.get(key, seconds))
    return [
        r | {"seconds": min(r["seconds"], least.get((r["problem"], r["size"]), r["seconds"]))}
        if r["peer"] == OURS and "failed" not in r
        else r
        for r in rows
    ]


def usable(rows) -> list[dict]:
    """Rows that came to an end, and those relaxations that came to rest."""
    return [r for r in rows if "failed" not in r and r.get("rest to", 0.0) is not None]


def ratios(rows) -> dict:
    """Per peer: seconds over ours at equal accuracy (least, median), errors over ours at equal mesh (least, median)."""
    good, table = usable(rows), {}
    ours = {(r["problem"], str(r["size"])): r["error"] for r in good if r["peer"] == OURS}
    for peer in dict.fromkeys(r["peer"] for r in rows):
        if peer == OURS:
            continue
        own = [r for r in good if r["peer"] == peer]
        as_good = [[t for n, t in r["beside"].items() if ours[r["problem"], n] <= r["error"] * _ALIKE] for r in own]
        time = [r["seconds"] / min(seconds) for r, seconds in zip(own, as_good, strict=True) if seconds]
        rest = [r for r in own if str(r["size"]) in r["beside"] and r.get("rest to", 0.0) <= _REST]
        table[peer] = {
            "seconds over ours at equal accuracy": _spread(time),
            "runs more accurate than any of ours": len(own) - len(time),
            "error over ours at equal mesh": _spread([r["error"] / ours[r["problem"], str(r["size"])] for r in rest]),
            "runs": len(own),
            "failed": sum(r["peer"] == peer for r in rows) - len(own),
            "least error": min((r["error"] for r in own), default=None),
        }
    return table


def watched(results) -> dict[str, float]:
    """For the record: each ratio the other way round, ours over theirs, so that smaller is better."""
    keys = ("seconds over ours at equal accuracy", "error over ours at equal mesh")
    rows = results["ratios"].items()
    return {f"{peer}: {k}, turned round": 1.0 / row[k]["median"] for peer, row in rows for k in keys if row[k]}


def _spread(values):
    return {"least": min(values), "median": float(np.median(values)), "of": len(values)} if values else None
