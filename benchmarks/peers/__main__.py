"""`python -m benchmarks.peers [--only PEER ...] [--python PEER=INTERPRETER ...] [--skip-fits] [--skip-limits] [--longest S]`.

Runs the peers and writes results and picture after each of them, so that an interrupted run leaves what it has. Peers of two
versions of one library need two interpreters: ``--python "MuJoCo cable=/path/to/python"`` runs every peer whose name begins so
with the other one, which needs numpy, scipy and the library. With ``--only`` the rows of the other peers are kept.
"""

import argparse
import json
import sys

from benchmarks.peers import compare, continuum, picture
from benchmarks.peers.bench import LONGEST, Process
from benchmarks.peers.problems import PROBLEMS
from benchmarks.peers.solvers import MESHES, PEERS
from benchmarks.record import RESULTS, conclude, record


def main() -> None:
    arguments = _arguments()
    file = RESULTS / "peers.json"
    results = {"problems": {}, "peers": {}, "runs": []}
    if arguments.only is not None and file.exists():
        before = json.loads(file.read_text())["results"]
        results |= {key: before[key] for key in ("problems", "peers", "runs", "fits", "limits") if key in before}
    curves = {}
    for name, problem in PROBLEMS.items():
        if name in results["problems"]:
            curves[name] = continuum.solve(problem, continuum.LOOSE)
        else:
            curves[name], results["problems"][name] = continuum.reference(problem)
    ours = Process(compare.OURS)
    for name in PEERS if arguments.only is None else arguments.only:
        about, rows = _of(PEERS[name], ours, curves, arguments)
        results["peers"][name] = about
        results["runs"] = [r for r in results["runs"] if r["peer"] != name] + rows
        _written(results)
        sys.stderr.write(f"{name}: {about.get('missing') or about.get('failed') or f'{len(rows)} results'}\n")
    ours.close()
    _more(arguments, results)
    conclude("peers", results, compare.watched(results))


def _more(arguments, results):
    """The two parts that need the package itself."""
    if not arguments.skip_limits:
        from benchmarks.peers import arithmetic  # noqa: PLC0415 - imports jax, which the peers' processes do not share

        results["limits"] = arithmetic.limits()
        _written(results)
    if not arguments.skip_fits:
        from benchmarks.peers import fitting  # noqa: PLC0415

        results["fits"] = fitting.compared()
        _written(results)


def _of(peer, ours, curves, arguments):
    """One peer on everything; after each of its answers our solver is asked the same, on all meshes."""
    process, rows = Process(peer.name, _interpreter(peer.name, arguments.python), arguments.longest), []
    about = {"family": peer.family, "what": peer.what} | process.about
    for problem in PROBLEMS if process.ready else ():
        for size in peer.sizes:
            answer = process.ask(problem, size)
            beside = {n: ours.ask(problem, n) for n in MESHES} if "failed" not in answer else {}
            rows += compare.scored(peer.name, answer | {"problem": problem, "size": size}, beside, curves[problem])
    process.close()
    return about | memory(peer, _interpreter(peer.name, arguments.python)) if rows else about, rows


def memory(peer, interpreter) -> dict:
    """Megabytes of a fresh process that has solved `level` once at the peer's second size, and nothing else."""
    process = Process(peer.name, interpreter)
    answer = process.ask("level", peer.sizes[1])
    process.close()
    return {"memory_MB": answer["memory_MB"]} if "failed" not in answer else {}


def _written(results):
    order = list(PEERS)
    results["runs"] = sorted(compare.with_the_least(results["runs"]), key=lambda r: order.index(r["peer"]))
    results["ratios"] = compare.ratios(results["runs"])
    record("peers", results)
    if compare.usable(results["runs"]):
        picture.draw(results["runs"])


def _interpreter(name, given):
    for pair in given:
        start, _, interpreter = pair.partition("=")
        if name.startswith(start):
            return interpreter
    return sys.executable


def _arguments():
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers", description=__doc__.splitlines()[2])
    parser.add_argument("--only", nargs="*", choices=list(PEERS), default=None, metavar="PEER")
    parser.add_argument("--python", action="append", default=[], metavar="PEER=INTERPRETER")
    parser.add_argument("--skip-fits", action="store_true")
    parser.add_argument("--skip-limits", action="store_true")
    parser.add_argument("--longest", type=float, default=LONGEST, help="wall seconds for one answer")
    return parser.parse_args()


if __name__ == "__main__":
    main()
