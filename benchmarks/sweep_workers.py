"""A sweep of 10,000 equilibria by four dask workers, one of which is killed: is it the sweep of an undisturbed process?

`python -m benchmarks.sweep_workers` (EI and GJ over two decades, 40 elements, a zarr store) kills a worker after a third of the
samples, and compares every number with those of a sweep in this process. 10,000 fits would take hours on two cores.
"""

import os
import signal
import tempfile
from time import perf_counter

import numpy as np
from dask.distributed import Client, LocalCluster

from benchmarks.batches import stiffnesses
from benchmarks.equilibrium import boundary, model
from benchmarks.record import conclude
from scan2flex_jax.cli.setup import prepare_jax
from scan2flex_jax.sweep import draws, equilibria, failed, sweep

COUNT, WORKERS = 10_000, 4


def hanging(sample):
    return model(sample["EI"], sample["GJ"]), boundary()


def main() -> None:
    prepare_jax()
    task = equilibria(hanging, ("points", "energy", "reaction_force"))
    samples = draws(**{name: (x, "N m^2") for name, x in zip(("EI", "GJ"), stiffnesses(COUNT), strict=True)})
    begin = perf_counter()
    alone = sweep(task, samples)
    alone_s = perf_counter() - begin
    with (
        tempfile.TemporaryDirectory() as folder,
        LocalCluster(n_workers=WORKERS, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        pids = list(client.run(os.getpid).values())

        def disturb(line):
            if int(line.split()[0]) > COUNT / 3 and len(pids) == WORKERS:
                os.kill(pids.pop(), signal.SIGKILL)

        begin = perf_counter()
        found = sweep(task, samples, store=f"{folder}/sweep", client=client, progress=disturb)
        workers_s = perf_counter() - begin
    equal = found.drop_vars("seconds").identical(alone.drop_vars("seconds"))
    largest = max(float(np.nanmax(np.abs(found[x] - alone[x]))) for x in ("points", "energy", "reaction_force"))
    results = {
        "equilibria": COUNT, "failed": len(failed(found)), "workers": WORKERS, "killed": WORKERS - len(pids), "equal": equal,
        "largest difference (m, J, N)": largest, "one process (s)": alone_s, "workers (s)": workers_s,
    }  # fmt: skip
    conclude("sweep_workers", results, {"differs": float(not equal)})


if __name__ == "__main__":
    main()
