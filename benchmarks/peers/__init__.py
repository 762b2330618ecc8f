"""The same cables solved by other programs: error against the continuous rod, processor time and memory, in one run.

`python -m benchmarks.peers` from the repository's root runs whatever is installed (`pip install -e '.[peers]'`) and writes
`benchmarks/results/peers.json` and `docs/peers.png`. `problems` says what is solved, `continuum` solves it from the
continuous equations, `bench` runs one peer in a process of its own, and each module of `solvers` is one peer.
`fitting` compares ways to fit, `arithmetic` counts what a step of our solver costs against what the processor can do.
"""
