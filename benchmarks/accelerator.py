"""Equilibria per second over the number of samples (lanes), on a GPU if JAX has one: the same sweep, vectorised, in float64.

`python -m benchmarks.accelerator [--most LANES] [--cpu]` from the repository's root writes
`benchmarks/results/accelerator.json` with the name of the device. Without an accelerator it prints that and writes nothing;
with `--cpu` it runs on the processor, where a sweep takes samples one after the other. The cable is that of
`benchmarks.equilibrium`, EI and GJ each over two decades, 40 elements, generic start. Target on an H200: 50,000 a second.
"""

import argparse
import sys

import jax
import numpy as np

from benchmarks.equilibrium import boundary, model
from benchmarks.record import conclude, record, timed
from scan2flex_jax.sweep import Axis, Output, Quantity, draws, equilibria, sweep

REPEATS, LONGEST = 3, 120.0  # runs of one count of lanes; seconds of a run after which more lanes are not tried
MIDDLE = {"middle": Quantity(lambda e: e.points[len(e.points) // 2], Output("m", ("axis",)))}  # little to carry home


def measured(task, count) -> dict:
    """Seconds of one call with ``count`` samples without compilation, and the number solved."""
    values = 10.0 ** np.random.default_rng(0).uniform(-2, 0, (2, count))
    lanes = draws(**{name: Axis(x, "N m^2") for name, x in zip(("EI", "GJ"), values, strict=True)})
    found = sweep(task, lanes, chunk=count)
    seconds = timed(lambda: sweep(task, lanes, chunk=count), REPEATS)
    solved, steps = int((found["code"] == 0).sum()), found["steps"].values
    rates = {"equilibria per second": count / seconds["min_s"], "solved": solved, "most steps": int(steps.max())}
    return seconds | rates | {"mean steps": float(steps.mean())}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.accelerator", description=__doc__.splitlines()[0])
    parser.add_argument("--most", type=int, default=65_536, help="lanes of the largest batch")
    parser.add_argument("--cpu", action="store_true", help="run on a processor too")
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    if jax.default_backend() == "cpu" and not arguments.cpu:
        sys.exit("JAX has no accelerator here: install its CUDA version on a machine with a GPU, or give --cpu")
    supports = boundary()
    task = equilibria(lambda lane: (model(lane["EI"], lane["GJ"]), supports), MIDDLE)
    results = {"device": jax.devices()[0].device_kind, "backend": jax.default_backend(), "lanes": {}}
    count = 1
    while count <= arguments.most:
        row = results["lanes"][str(count)] = measured(task, count)
        sys.stderr.write(f"{count} lanes: {row['equilibria per second']:.0f} equilibria a second, {row['solved']} solved\n")
        record("accelerator", results)
        if row["min_s"] > LONGEST:
            break
        count *= 4
    rates = [row["equilibria per second"] for row in results["lanes"].values()]
    conclude("accelerator", results, {"a lane of the best batch over a lane alone": rates[0] / max(rates)})


if __name__ == "__main__":
    main()
