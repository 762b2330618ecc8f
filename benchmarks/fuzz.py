"""Bytes that nobody meant to write, given to every reader of the package.

`python -m benchmarks.fuzz --inputs 100000` mutates valid files (pieces taken out, doubled, exchanged, bytes turned) or makes
raw bytes, and lets the reader have them. A reader gives what it says, or raises `Scan2FlexError` with one line. Anything else
is a failure: another exception, more than `LIMIT_S` seconds of processor time, more than `LIMIT_MB` of memory beyond what is
there before. Failures are counted by where they come from, with the first input of each kept; the record is
`benchmarks/results/fuzz.json`. The same seed gives the same inputs.
"""

import argparse
import base64
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import jax
import numpy as np
import trimesh

from benchmarks.kinect_picks import read_picks
from benchmarks.record import record
from scan2flex_jax.convert import quantity, read_foreign_curve, read_frames
from scan2flex_jax.convert.curves import read_foreign_points
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.scan.cloud import load_cloud
from scan2flex_jax.study import describe, load_study
from scan2flex_jax.sweep import Axis, Calls, Output, grid, open_sweep, sweep
from tests.study.samples import STUDY, csv, curve, write_sample

jax.config.update("jax_enable_x64", True)

LIMIT_S, LIMIT_MB = 10.0, 1024.0
_RAW = 0.1  # share of inputs that are raw bytes
FRAGMENTS = [
    b"nan", b"-inf", b"1e308", b"5e-324", b"-1", b"0", b"1e999", b"9" * 400, b"4294967295", b"2147483648", b"true", b"[]",
    b"{}", b"null", b'""', b"'..'", b"../../../etc/passwd", b"[[", b"]", b"=", b"\n", b"\r", b"\x00", b"\xff",
    b"\xef\xbb\xbf", b",", b";", b"\t", b"x,y,z", b"s;x;y;z", b"name,x,y,z,qw,qx,qy,qz", b"pose,end,x,y,z,a,b,c",
    b"[[pose]]", b"[unknown.length]", b"1979-05-27", b"property list uchar int", b"element vertex 99999999",
    b"element face 3", b"format ascii 1.0", b"solid", b"facet normal 0 0 0", b"v 1 2", b"f 1 2 9999999", b"mtllib x.mtl",
    b"usemtl a", b"/", b"1/2/3", "\N{LINE SEPARATOR}".encode(), b"1,5", b"1_0",
]  # fmt: skip


class Hang(BaseException):
    """More processor time than one input may take; no `except Exception` of a library stops it."""


@dataclass
class Reader:
    """What is fuzzed: ``read(bytes)``, and valid ``seeds`` to begin from."""

    read: Callable[[bytes], object]
    seeds: list[bytes]
    count: int = 0
    refused: int = 0
    seconds: float = 0.0
    slowest_s: float = 0.0
    failures: dict[str, dict] = field(default_factory=dict)


def mutated(rng: np.random.Generator, seeds: list[bytes]) -> bytes:
    """A valid file with one to four pieces changed, or raw bytes."""
    if rng.random() < _RAW:
        return rng.bytes(int(rng.integers(0, 300)))
    data = seeds[rng.integers(len(seeds))]
    for _ in range(rng.integers(1, 5)):
        low = int(rng.integers(0, len(data) + 1))
        high = min(len(data), low + int(rng.integers(0, 2 ** rng.integers(0, 9))))
        way = rng.integers(0, 6)
        if way == 0:
            piece = FRAGMENTS[rng.integers(len(FRAGMENTS))]
        elif way == 1:
            piece = data[low:high] * 2
        elif way == 2:
            piece = rng.bytes(high - low)
        elif way == 3:
            piece = b""
        elif way == 4:
            other = seeds[rng.integers(len(seeds))]
            at = int(rng.integers(0, len(other) + 1))
            piece = other[at : at + 40]
        else:
            high = low + 1
            piece = bytes([data[low] ^ (1 << int(rng.integers(8)))]) if low < len(data) else b""
        data = data[:low] + piece + data[high:]
    return data


def in_file(path: Path, read) -> Callable[[bytes], object]:
    """The reader of a file, given bytes."""

    def given(data):
        path.write_bytes(data)
        return read(path)

    return given


def in_study(folder: Path, name: str) -> Callable[[bytes], object]:
    """The reader of a whole study in which one file holds the bytes."""
    write_sample(folder)
    return in_file(folder / name, lambda path: describe(load_study(folder)))


def cloud_seeds() -> dict[str, list[bytes]]:
    """Small valid files of every kind that scans come in: points, and a mesh."""
    mesh, points = trimesh.creation.icosphere(1), trimesh.PointCloud(curve(30))
    kinds = {mesh: ("ply", "obj", "stl", "off", "glb"), points: ("ply", "obj", "xyz")}
    out: dict[str, list[bytes]] = {}
    for thing, written in kinds.items():
        for kind in written:
            data = thing.export(file_type=kind)
            out.setdefault(kind, []).append(data if isinstance(data, bytes) else data.encode())
    out["ply"] += [points.export(file_type="ply", encoding="ascii"), mesh.export(file_type="ply", encoding="ascii")]
    out["stl"] += [mesh.export(file_type="stl_ascii").encode()]
    out["xyz"] += [b"\n".join(b"%g %g %g" % tuple(p) for p in curve(20))]
    return out


def readers(folder: Path) -> dict[str, Reader]:
    """Every reader by name."""
    toml = STUDY.encode()
    table, arcs = csv(curve(12)).encode(), csv(np.column_stack([np.linspace(0, 0.9, 12), curve(12)]), "s,x,y,z").encode()
    matrices = b"sag start\n0 0 1 0.5\n1 0 0 0\n0 1 0 0.2\n0 0 0 1\n\nsag end\n0 0 1 1\n1 0 0 0\n0 1 0 0.2\n0 0 0 1\n"
    angles = b"pose,end,x,y,z,a,b,c\nsag,start,0,0,0,0,90,0\nsag,end,0.5,0,0,0,90,0\n"
    quaternions = b"name;x;y;z;qw;qx;qy;qz\nsag start;0;0;0;1;0;0;0\n"
    german, blanks = table.replace(b",", b";").replace(b".", b","), b"# t\nx_mm y_mm z_mm\n" + table[6:].replace(b",", b" ")
    foreign = [table, arcs, german, blanks]
    picks = b"310,200,900\n320.5,210,905\n330,215,910.25\n340,230,915\n"
    out = {
        "study.toml": Reader(in_study(folder / "a", "study.toml"), [toml]),
        "centre curve": Reader(in_study(folder / "b", "shapes/sag.csv"), [table, arcs]),
        "guide points": Reader(in_study(folder / "c", "sag-guides.csv"), [csv(curve(5)).encode()]),
        "foreign curve": Reader(in_file(folder / "curve.txt", lambda p: read_foreign_curve(p, units=None)), foreign),
        "foreign points": Reader(in_file(folder / "points.txt", lambda p: read_foreign_points(p, units="mm")), foreign),
        "frames": Reader(
            in_file(folder / "frames.csv", lambda p: read_frames(p, convention="kuka")), [matrices, angles, quaternions]
        ),
        "quantity": Reader(
            lambda data: quantity(data[:60].decode("latin-1"), "length"), [b"900 mm", b"0,9 m", b"1e-3", b"12.5 in"]
        ),
        "kinect picks": Reader(in_file(folder / "picks.csv", read_picks), [picks]),
    }
    for kind, seeds in cloud_seeds().items():
        out[f"cloud {kind}"] = Reader(in_file(folder / f"cloud.{kind}", lambda p: load_cloud(p).points.shape), seeds)
    stored = folder / "sweep"
    double = Calls(lambda lane: {"twice": 2.0 * lane["a"]}, {"twice": Output("m", (), "twice")}, chunk=4)
    sweep(double, grid(a=Axis(np.arange(6.0), "m")), store=stored)
    for name in ("definition.json", "lanes.nc", "chunk-00000.nc"):
        original = (stored / name).read_bytes()
        out[f"sweep {name}"] = Reader(_restoring(stored, name, original), [original])
    return out


def _restoring(stored, name, original):
    def given(data):
        (stored / name).write_bytes(data)
        try:
            return open_sweep(stored).sizes
        finally:
            (stored / name).write_bytes(original)

    return given


def attempt(reader: Reader, data: bytes) -> None:
    """One input; what goes wrong is kept by the line of the package that it comes from."""
    began, fault = time.process_time(), None
    signal.setitimer(signal.ITIMER_PROF, LIMIT_S)
    try:
        reader.read(data)
    except Scan2FlexError as error:
        reader.refused += 1
        text = str(error)
        fault = None if text and "\n" not in text else ("a message of several lines", text[:200])
    except Hang:
        fault = ("hang", "")
    except Exception as error:
        own = [f for f in traceback.extract_tb(error.__traceback__) if "scan2flex_jax" in f.filename]
        at = f"{Path(own[-1].filename).name}:{own[-1].lineno}" if own else "?"
        fault = (f"{type(error).__name__} from {at}", str(error)[:200])
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    took = time.process_time() - began
    reader.count += 1
    reader.seconds += took
    reader.slowest_s = max(reader.slowest_s, took)
    if fault:
        first = {"count": 0, "message": fault[1], "input": base64.b64encode(data[:4000]).decode()}
        reader.failures.setdefault(fault[0], first)["count"] += 1


def _hung(*_):
    raise Hang


def memory_mb() -> float:
    """Largest resident size so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def run(inputs: int, seed: int, only: str | None = None, save: bool = True) -> dict:
    """Inputs spread evenly over the readers, in turns; the record is renewed on the way."""
    signal.signal(signal.SIGPROF, _hung)
    warnings.simplefilter("error", RuntimeWarning)
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as name:
        every = {n: r for n, r in readers(Path(name)).items() if only is None or only in n}
        before = memory_mb()
        size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (size + int(LIMIT_MB * 2**20), resource.RLIM_INFINITY))
        order = [every[n] for n in every]
        found = {}
        for i in range(inputs):
            reader = order[i % len(order)]
            attempt(reader, mutated(rng, reader.seeds))
            if (i + 1) % 5000 == 0 or i + 1 == inputs:
                found = summary(every, seed, memory_mb() - before)
                print(f"{i + 1} inputs, {found['failures']} failures, {found['seconds']:.0f} s", file=sys.stderr, flush=True)
                if save:
                    record("fuzz", found)
    return found


def summary(every: dict[str, Reader], seed: int, memory: float) -> dict:
    """The figures of the record."""
    rows = {
        n: {
            "inputs": r.count, "refused in one sentence": r.refused, "seconds": round(r.seconds, 2),
            "slowest_s": round(r.slowest_s, 3), "failures": r.failures,
        }
        for n, r in every.items()
    }  # fmt: skip
    return {
        "seed": seed,
        "inputs": sum(r.count for r in every.values()),
        "failures": sum(f["count"] for r in every.values() for f in r.failures.values()),
        "seconds": round(sum(r.seconds for r in every.values()), 1),
        "memory beyond the start, MB": round(memory, 1),
        "limits": {"seconds": LIMIT_S, "MB": LIMIT_MB},
        "readers": rows,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--inputs", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--reader", help="only readers whose name holds this; nothing is recorded then")
    a = parser.parse_args()
    found = run(a.inputs, a.seed, a.reader, save=a.reader is None)
    for name, row in found["readers"].items():
        failures = sum(f["count"] for f in row["failures"].values())
        print(f"{name:<24}{row['inputs']:>8} inputs {row['seconds']:>9} s  {failures} failures")
        for fault, f in row["failures"].items():
            print(f"    {f['count']:>6} x {fault}: {f['message'][:150]}")


if __name__ == "__main__":
    main()
