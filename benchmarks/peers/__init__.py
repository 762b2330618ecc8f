"""The same cables solved by other programs: error against the continuous rod, and processor time.

`python -m benchmarks.peers` runs the programs that are installed (`pip install -e '.[peers]'`) and writes
`benchmarks/results/peers.json` and `docs/peers.png`. `problems` has the cables and where a solve starts, `continuum` the
solution of the continuous equations, `elastica_rod` and `mujoco_flex` the relaxation codes, `rest` when these are at rest.
"""
