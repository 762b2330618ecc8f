"""Reading one cloud in every format of scanners: size of the file, seconds and memory.

    python -m benchmarks.formats [--points 1000000]

Each file is written by the format's own library where there is one, and read in a process of its own.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import laspy
import numpy as np
import pye57
import trimesh

from benchmarks.record import record


def _table(mark, head="", decimal=".", more=""):
    def write(path, points):
        rows = (mark.join(f"{x:.5f}" for x in point).replace(".", decimal) + more for point in points)
        path.write_text("\n".join([*([head.format(n=len(points))] if head else []), *rows]) + "\n")

    return write


def _las(path, points):
    data = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
    data.header.scales = [1e-5] * 3
    data.x, data.y, data.z = points.T
    data.write(path)


def _e57(path, points):
    with pye57.E57(str(path), mode="w") as out:
        out.write_scan_raw({f"cartesian{c}": x for c, x in zip("XYZ", points.T, strict=True)})


def _ptx(path, points):
    unit = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1"
    _table(" ", f"{len(points)}\n1\n{unit}", more=" 0.5")(path, points)


def _pcd(path, points):
    head = f"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH {len(points)}\nHEIGHT 1\nDATA binary\n"
    path.write_bytes(head.encode() + points.astype("<f4").tobytes())


FORMATS = {
    "PLY": ("a.ply", lambda path, points: trimesh.PointCloud(points).export(path)),
    "E57": ("a.e57", _e57),
    "LAS": ("a.las", _las),
    "LAZ": ("a.laz", _las),
    "PCD, binary": ("a.pcd", _pcd),
    "PTX": ("a.ptx", _ptx),
    "PTS": ("a.pts", _table(" ", "{n}", more=" 120 200 200 200")),
    "XYZ": ("a.xyz", _table(" ")),
    "ASC with a header": ("a.asc", _table(" ", "//X Y Z Intensity", more=" 0.5")),
    "CSV, semicolons and decimal commas": ("a.csv", _table(";", "x;y;z", ",")),
    "NPY": ("a.npy", np.save),
}


def read(path: str):
    """Print the time and the growth of memory of one reading, and a checksum of the points."""
    from scan2flex_jax.scan import load_cloud  # noqa: PLC0415

    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began = time.perf_counter()
    points = load_cloud(path).points
    seconds = time.perf_counter() - began
    memory = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    print(json.dumps({"seconds": seconds, "memory_MiB": memory, "points": len(points), "sum": float(np.sum(points))}))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=1_000_000)
    parser.add_argument("--read", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.read:
        read(given.read)
        return
    points, rows = np.random.default_rng(1).normal(size=(given.points, 3)).round(5), []
    with tempfile.TemporaryDirectory() as folder:
        for name, (file, write) in FORMATS.items():
            path = Path(folder) / file
            write(path, points)
            command = [sys.executable, "-m", "benchmarks.formats", "--read", str(path)]
            found = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
            assert found["points"] == len(points) and abs(found["sum"] - np.sum(points)) < 1e-5 * len(points), name
            rows.append({"format": name, "ending": path.suffix, "MB": path.stat().st_size / 1e6, **found})
            print(rows[-1], flush=True)
            path.unlink()
    record("formats", {"points": len(points), "rows": rows})


if __name__ == "__main__":
    main()
