"""`python -m benchmarks.sensitivity [PART ...] [--only SWEEP ...] [--longest SECONDS]`; without parts, all of them."""

import argparse

import jax
import matplotlib as mpl

from benchmarks.record import conclude
from benchmarks.sensitivity import batches, cantilever, clamps, curvature, guesses, minima
from benchmarks.sensitivity.bench import NAME, Bench

PARTS = {
    "cantilever": cantilever, "clamps": clamps, "curvature": curvature, "guesses": guesses, "batches": batches,
    "minima": minima,
}  # fmt: skip


def ratios(results: dict) -> dict[str, float]:
    """What is watched: counts and times of one method over another's, of the same guesses and lanes; smaller is better."""
    table, small = {}, results.get("guesses", {})
    ours = small.get("5 x 5, least-squares")
    for name in ("5 x 5, bfgs", "5 x 5, nelder-mead"):
        if ours and name in small:
            table[f"equilibria, {name}: least-squares over it"] = ours["median equilibria"] / small[name]["median equilibria"]
    ms = results.get("batches", {}).get("a loop and vmap", {}).get("ms per lane", {})
    for way in ("one lane in a call", "16 lanes, vectorised"):
        if {way, "a sweep"} <= ms.keys():
            table[f"a lane of a sweep over {way}"] = ms["a sweep"] / ms[way]
    return table


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.sensitivity", description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(PARTS))
    parser.add_argument("--longest", type=float, default=1800.0, help="seconds for one sweep; the next run goes on")
    parser.add_argument("--only", nargs="+", default=None, metavar="SWEEP", help='of these parts only: "33 x 33, bfgs"')
    arguments = parser.parse_args()
    if unknown := set(arguments.parts) - set(PARTS):
        parser.error(f"no part is called {min(unknown)!r}: they are {', '.join(PARTS)}")
    jax.config.update("jax_enable_x64", True)
    mpl.use("Agg")
    bench = Bench(arguments.longest)
    for name in arguments.parts or PARTS:
        PARTS[name].run(bench, lambda sweep: arguments.only is None or sweep in arguments.only)
    conclude(NAME, bench.results, ratios(bench.results))


if __name__ == "__main__":
    main()
