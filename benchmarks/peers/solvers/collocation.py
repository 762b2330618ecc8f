"""scipy's `solve_bvp`: the continuous equations with its own continuation; the size is its tolerance, the mesh its own."""

from benchmarks.peers import continuum
from benchmarks.peers.solvers import Found


def prepare(problem, tolerance):
    """Nothing to set up."""

    def solve():
        curve = continuum.solve(problem, tolerance)
        return [Found(curve.nodes, curve.at(curve.nodes), {"nodes": len(curve.nodes)})]

    return solve
