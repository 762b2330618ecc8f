"""Hostile input: every reader of the package returns the contents of a file, or refuses it in one sentence.

`python -m benchmarks.attacks --inputs 5000` mutates valid files (pieces removed, doubled, exchanged, bytes changed) or makes
raw bytes, and passes them to a reader in turn; *hostile values* puts wrong values into every key of a study. Anything but the
contents or a `Scan2FlexError` of one printable line is a failure: another exception, more than `LIMIT_S` seconds of processor
time, more than `LIMIT_MB` of additional memory, a study that does not survive saving, a damaged sweep that reads as another.
Failures are counted by the line that raised them, with the first input of each. The same seed gives the same inputs.
"""

import argparse
import base64
import gzip
import io
import json
import resource
import shutil
import signal
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

from benchmarks.kinect_wires import read_picks
from benchmarks.record import record
from scan2flex_jax.convert import measured, quantity, read_foreign_curve, read_frames
from scan2flex_jax.convert.curves import read_foreign_points
from scan2flex_jax.convert.motion_capture import captured
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.scan.cloud import load_cloud
from scan2flex_jax.study import describe, load_study, save_study
from scan2flex_jax.sweep import Output, Task, grid, open_sweep, sweep
from tests.convert.test_frames import PRINTED
from tests.convert.test_lines import FILES, FRAMES, POINTS, edged_ply
from tests.convert.test_motion_capture import c3d, motive, vicon
from tests.convert.test_motion_capture import frames as marker_frames
from tests.scan.test_files import BINARY, TABLES
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
HOSTILE = (
    "nan", "-nan", "inf", "1e999", "true", "{}", "{ a = 1 }", "[[]]", "[{}]", "[nan, nan, nan]", "1979-05-27", "9" * 400,
    "0x" + "f" * 99, "[[[[[[[[1.0]]]]]]]]", "0", "-0.0", "-1", "1", "5e-324", "1e15", "1e308", '""', '" "', '"sag"', '"nan"',
    '"../../../etc/passwd"', '"/dev/zero"', '"study.toml"', '"\\u0000"', '"a\\nb"', '"\\u001b[2J"', f'"{"x" * 5000}"', "[]",
    "[0]", "[0, 0, 0]", "[1, 1, 1, 1]", "[0, 0, 0, 0]", "[1e308, 1e308, 1e308]", "[-1, 1]", "[1, [2]]", '["a", "b", "c"]',
)  # fmt: skip


class Hang(BaseException):
    """More processor time than one input may take; no `except Exception` of a library stops it."""


@dataclass
class Reader:
    """An attacked reader: ``read(bytes)``, and valid ``seeds`` to mutate; hostile ones are given as they are (``mutate``)."""

    read: Callable[[bytes], object]
    seeds: list[bytes]
    mutate: bool = True
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
    """The reader of a whole study in which one file holds the bytes; the study that was read survives saving."""
    write_sample(folder)

    def read(path):
        shutil.rmtree(folder / "copy", ignore_errors=True)
        study = load_study(folder)
        save_study(study, folder / "copy")
        if load_study(folder / "copy") != study:
            raise AssertionError("a saved study is another one")
        return describe(study)

    return in_file(folder / name, read)


def hostile_studies() -> list[bytes]:
    """The sample study with the value of each key replaced by each hostile one."""
    lines = STUDY.splitlines()
    keys = [(i, line.split("=")[0]) for i, line in enumerate(lines) if "=" in line and not line.lstrip().startswith("#")]
    return ["\n".join([*lines[:i], f"{key}= {value}", *lines[i + 1 :], ""]).encode() for i, key in keys for value in HOSTILE]


def cloud_seeds() -> dict[str, list[bytes]]:
    """Small valid files of every type that scans come in: points, and a mesh."""
    mesh, points = trimesh.creation.icosphere(1), trimesh.PointCloud(curve(30))
    out: dict[str, list[bytes]] = {}
    for thing, written in {mesh: ("ply", "obj", "stl", "off", "glb"), points: ("ply", "obj", "xyz")}.items():
        for kind in written:
            data = thing.export(file_type=kind)
            out.setdefault(kind, []).append(data if isinstance(data, bytes) else data.encode())
    out["ply"] += [points.export(file_type="ply", encoding="ascii"), mesh.export(file_type="ply", encoding="ascii")]
    out["stl"] += [mesh.export(file_type="stl_ascii").encode()]
    out["xyz"] += [b"\n".join(b"%g %g %g" % tuple(p) for p in curve(20))]
    for name, text in TABLES.items():
        out.setdefault(name.split(".")[-1], []).append(text.encode())
    with tempfile.TemporaryDirectory() as folder:
        for name, write in BINARY.items():
            path = Path(folder) / name
            write(path, curve(400))
            out.setdefault(path.suffix[1:], []).append(path.read_bytes())
    out["pcd"] = [(Path(__file__).parents[1] / "tests/data/pypcd4.pcd").read_bytes()]
    out["xyz.gz"] = [gzip.compress(out["xyz"][-1])]
    return out


def bombs() -> list[bytes]:
    """Small files that unpack to more than may be read, once or twice packed."""
    blank = gzip.compress(bytes(6 * 10**8), 1)
    rows = gzip.compress(b"0 0 0\n" * 10**8, 1)
    return [rows, blank, gzip.compress(blank)]


def readers(folder: Path) -> dict[str, Reader]:
    """Every reader by name."""
    table, arcs = csv(curve(12)).encode(), csv(np.column_stack([np.linspace(0, 0.9, 12), curve(12)]), "s,x,y,z").encode()
    matrices = b"sag start\n0 0 1 0.5\n1 0 0 0\n0 1 0 0.2\n0 0 0 1\n\nsag end\n0 0 1 1\n1 0 0 0\n0 1 0 0.2\n0 0 0 1\n"
    angles = b"pose,end,x,y,z,a,b,c\nsag,start,0,0,0,0,90,0\nsag,end,0.5,0,0,0,90,0\n"
    quaternions = b"name;x;y;z;qw;qx;qy;qz\nsag start;0;0;0;1;0;0;0\n"
    german, blanks = table.replace(b",", b";").replace(b".", b","), b"# t\nx_mm y_mm z_mm\n" + table[6:].replace(b",", b" ")
    frames, foreign, toml = [matrices, angles, quaternions], [table, arcs, german, blanks], STUDY.encode()
    captures = [motive(marker_frames()).encode(), vicon(marker_frames()).encode()]
    c3d(folder / "seed.c3d", marker_frames())
    lengths = [b"900 mm", b"0,9 m", b"1e-3", b"12.5 in", b"3 ft 3 in"]
    densities = [b"336 g/m +/- 2 g/m", b"24 lb/1000ft", b"3.2 N/m", b"150 tex +- 1 %"]
    out = {
        "study.toml": Reader(in_study(folder / "a", "study.toml"), [toml]),
        "hostile values": Reader(in_study(folder / "v", "study.toml"), hostile_studies(), mutate=False),
        "centre curve": Reader(in_study(folder / "b", "shapes/sag.csv"), [table, arcs]),
        "guide points": Reader(in_study(folder / "c", "sag-guides.csv"), [csv(curve(5)).encode()]),
        "foreign curve": Reader(in_file(folder / "curve.txt", lambda p: read_foreign_curve(p, units=None)), foreign),
        "lines": Reader(in_file(folder / "l.csv", read_foreign_curve), [text.encode() for text in FILES.values()]),
        "arrays": Reader(in_file(folder / "a.npy", read_foreign_curve), [_saved(a) for a in (POINTS, POINTS.T, FRAMES)]),
        "edges": Reader(in_file(folder / "e.ply", read_foreign_curve), [edged_ply("ascii"), edged_ply("binary_little_endian")]),
        "foreign points": Reader(in_file(folder / "points.txt", lambda p: read_foreign_points(p, units="mm")), foreign),
        "frames": Reader(in_file(folder / "f.csv", lambda p: read_frames(p, convention="kuka")), frames),
        "printed poses": Reader(
            in_file(folder / "r.txt", lambda p: read_frames(p, convention=None)), [text.encode() for text in PRINTED.values()]
        ),
        "motion capture": Reader(in_file(folder / "m.csv", captured), captures),
        "motion capture c3d": Reader(in_file(folder / "m.c3d", captured), [(folder / "seed.c3d").read_bytes()]),
        "quantity": Reader(lambda data: quantity(data[:60].decode("latin-1"), "length"), lengths),
        "density": Reader(lambda data: measured(data[:60].decode("latin-1"), "length density"), densities),
        "kinect picks": Reader(in_file(folder / "picks.csv", read_picks), [b"310,200,900\n320.5,210,905\n340,230,915\n"]),
    }
    for kind, seeds in cloud_seeds().items():
        out[f"cloud {kind}"] = Reader(in_file(folder / f"cloud.{kind}", lambda p: load_cloud(p).points.shape), seeds)
    double = Task(lambda sample: {"twice": 2.0 * sample["a"]}, {"twice": Output("m", (), "twice")})
    sweep(double, grid(a=(np.arange(6.0), "m")), store=folder / "sweep", chunk=3)
    whole = open_sweep(folder / "sweep")["twice"].values
    for name in ("zarr.json", "a/c/0", "twice/c/0"):
        original = (folder / "sweep" / name).read_bytes()
        out[f"sweep {name}"] = Reader(_restoring(folder / "sweep", name, original, whole), [original])
    return out


def _saved(array):
    """The bytes of an array's file."""
    np.save(stream := io.BytesIO(), array)
    return stream.getvalue()


def _restoring(stored, name, original, whole):
    """The reader of a sweep's store with one file changed: every sample reads as computed, or as not run."""

    def given(data):
        (stored / name).write_bytes(data)
        try:
            found = open_sweep(stored)["twice"].values
        finally:
            (stored / name).write_bytes(original)
        if not np.array_equal(np.where(np.isnan(found), whole, found), whole):
            raise AssertionError("a damaged sweep is read as another one")
        return found

    return given


def attempt(reader: Reader, data: bytes) -> None:
    """One input; a failure is recorded under the line of the package that raised it."""
    began, fault = time.process_time(), None
    signal.setitimer(signal.ITIMER_PROF, LIMIT_S)
    try:
        reader.read(data)
    except Scan2FlexError as error:
        reader.refused += 1
        text = str(error)
        fault = None if text and "\n" not in text and text.isprintable() else ("no printable line", ascii(text[:200]))
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


def run(inputs: int, seed: int, only: str = "") -> dict:
    """Inputs spread evenly over the readers, in turns; the record is renewed on the way."""
    signal.signal(signal.SIGPROF, _hung)
    warnings.simplefilter("error", RuntimeWarning)
    rng, found = np.random.default_rng(seed), {}
    with tempfile.TemporaryDirectory() as name:
        packed = in_file(Path(name) / "bomb.xyz.gz", lambda p: load_cloud(p).points.shape)
        every = readers(Path(name)) | {"bombs": Reader(packed, bombs(), mutate=False)}
        every = {n: r for n, r in every.items() if only in n}
        size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (size + int(LIMIT_MB * 2**20), resource.RLIM_INFINITY))
        order = list(every.values())
        for i in range(inputs):
            reader, turn = order[i % len(order)], i // len(order)
            if reader.mutate or turn < len(reader.seeds):
                attempt(reader, mutated(rng, reader.seeds) if reader.mutate else reader.seeds[turn])
            if (i + 1) % 5000 == 0 or i + 1 == inputs:
                found = summary(every, seed)
                print(f"{i + 1} inputs, {found['failures']} failures, {found['seconds']:.0f} s", flush=True)
                if not only:
                    record("attacks", found)
    return found


def summary(every: dict[str, Reader], seed: int) -> dict:
    """The figures of the record."""
    rows = {
        n: {
            "inputs": r.count, "refused in one sentence": r.refused, "seconds": round(r.seconds, 2),
            "slowest_s": round(r.slowest_s, 3), "failures": r.failures,
        }
        for n, r in every.items()
    }  # fmt: skip
    return {
        "seed": seed, "inputs": sum(r.count for r in every.values()), "limits": {"seconds": LIMIT_S, "MB": LIMIT_MB},
        "failures": sum(f["count"] for r in every.values() for f in r.failures.values()),
        "seconds": round(sum(r.seconds for r in every.values()), 1), "readers": rows,
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--inputs", type=int, default=5_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--reader", default="", help="only readers whose name holds this; nothing is recorded then")
    args = parser.parse_args()
    print(json.dumps(run(args.inputs, args.seed, args.reader), indent=1))


if __name__ == "__main__":
    main()
