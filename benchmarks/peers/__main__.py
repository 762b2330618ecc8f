"""`python -m benchmarks.peers [--only PEER ...]`.

Runs the peers and writes results and picture after each of them, so that an interrupted run leaves what it has. With ``--only``
the rows of the other peers are kept.
"""

import argparse
import json
import sys

from benchmarks.peers import compare, continuum, picture
from benchmarks.peers.bench import Asked
from benchmarks.peers.problems import PROBLEMS
from benchmarks.peers.solvers import MESHES, PEERS
from benchmarks.record import RESULTS, conclude, one_processor, record


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers", description=__doc__.splitlines()[2])
    parser.add_argument("--only", nargs="*", choices=list(PEERS), default=None, metavar="PEER")
    args = parser.parse_args()
    one_processor()
    file = RESULTS / "peers.json"
    results = {"problems": {}, "peers": {}, "runs": []}
    if args.only is not None and file.exists():
        results |= json.loads(file.read_text())["results"]
    curves = {}
    for name, problem in PROBLEMS.items():
        curves[name], results["problems"][name] = continuum.reference(problem)
    ours = Asked(compare.OURS)
    for name in PEERS if args.only is None else args.only:
        results["peers"][name], rows = asked(PEERS[name], ours, curves)
        runs = [r for r in results["runs"] if r["peer"] != name] + rows
        results["runs"] = sorted(compare.with_the_least(runs), key=lambda r: list(PEERS).index(r["peer"]))
        results["ratios"] = compare.ratios(results["runs"])
        record("peers", results)
        picture.draw(results["runs"])
        sys.stderr.write(f"{name}: {results['peers'][name].get('missing') or f'{len(rows)} results'}\n")
    conclude("peers", results, compare.watched(results))


def asked(peer, ours, curves):
    """One peer on everything; after each of its answers our solver is asked the same, on all meshes."""
    them, rows = Asked(peer.name), []
    for problem in PROBLEMS if "missing" not in them.about else ():
        for size in peer.sizes:
            answer = them(problem, size)
            beside = {n: ours(problem, n) for n in MESHES} if "failed" not in answer else {}
            rows += compare.scored(peer.name, answer, beside, curves[problem])
    return them.about, rows


if __name__ == "__main__":
    main()
