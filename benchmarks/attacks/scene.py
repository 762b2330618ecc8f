"""Small studies of a simulated cable, and the answers to them, computed once where writing them is what is attacked."""

import contextlib
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from unittest import mock

import numpy as np
from scipy.interpolate import CubicSpline

from scan2flex_jax.fitting import fit
from scan2flex_jax.inference import explain, plan
from scan2flex_jax.prediction import predict
from scan2flex_jax.reporting import report
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.model import CableModel
from scan2flex_jax.scan import extract_study, scanner
from scan2flex_jax.statics import equilibrium

ELEMENTS = 8
ALONG_X = (0.7071067811865476, 0.0, 0.7071067811865476, 0.0)
ENDS = ((0.6, 0.0, 0.0), (0.75, 0.0, 0.1))  # m
RADIUS, NOISE = 0.005, 2e-4  # m
HEAD = f"""format = "scan2flex-study/1"
title = "a simulated cable"
gravity = [0.0, 0.0, -9.81]

[cable]
length = 1.0
length_density = 0.2
radius = {RADIUS}
bending_stiffness = 0.1
torsional_stiffness = 0.25
"""
UNKNOWN = "\n[unknown.bending_stiffness]\n"


@cache
def shapes() -> tuple[np.ndarray, ...]:
    """Points (40, 3) of the cable between its clamps (m), one array a pose, with noise."""
    model, found = CableModel(Cable(1.0, 0.2, 0.1, 0.25), [0.0, 0.0, -9.81]), []
    for i, end in enumerate(ENDS):
        e = equilibrium(
            model, Boundary.of((np.zeros(3), np.array(ALONG_X)), (np.array(end), np.array(ALONG_X))), elements=ELEMENTS
        )
        s = np.linspace(0.0, 1.0, 40)
        noise = NOISE * np.random.default_rng(i).normal(size=(len(s), 3))
        found.append(CubicSpline(np.asarray(e.s), np.asarray(e.points))(s) + noise)
    return tuple(found)


@cache
def scans() -> tuple[np.ndarray, ...]:
    """Points of a scan of each shape (m)."""
    fine = [CubicSpline(np.linspace(0, 1, 40), p)(np.linspace(0, 1, 400)) for p in shapes()]
    eyes = np.array([[0.3, -1.0, 0.6], [0.3, 1.0, 0.5]])
    return tuple(scanner.scan(p, RADIUS, eyes, scanner.STRUCTURED_LIGHT, 1).points for p in fine)


def toml_text(name: str) -> str:
    """A TOML string of any name."""
    return '"' + "".join(c if c.isascii() and c.isalnum() else f"\\U{ord(c):08x}" for c in name) + '"'


def write(folder: Path, names: Sequence[str] = ("one", "two"), scanned: bool = False, unknown: bool = True) -> Path:
    """A study with a pose for each name, whose files are pose-0.csv (or .xyz) and so on."""
    folder.mkdir(parents=True, exist_ok=True)
    text = HEAD + (UNKNOWN if unknown else "")
    for i, name in enumerate(names):
        key, file = ("scan", f"pose-{i}.xyz") if scanned else ("centre_curve", f"pose-{i}.csv")
        points = (scans if scanned else shapes)()[i % len(ENDS)]
        np.savetxt(folder / file, points, delimiter=" " if scanned else ",", header="" if scanned else "x,y,z", comments="")
        text += f'\n[[pose]]\nname = {toml_text(name)}\nrole = "fit"\n'
        text += f"start = {{ position = [0, 0, 0], quaternion = {list(ALONG_X)} }}\n"
        text += f'end = {{ position = {list(ENDS[i % len(ENDS)])}, quaternion = {list(ALONG_X)} }}\n{key} = "{file}"\n'
    (folder / "study.toml").write_text(text)
    return folder


_KEPT: dict[str, object] = {}


def kept(name: str, compute) -> object:
    """The answer of this name, computed when it is first wanted."""
    if name not in _KEPT:
        _KEPT[name] = compute()
    return _KEPT[name]


@contextlib.contextmanager
def answers_kept() -> Iterator[None]:
    """Commands on one study get answers that were computed once: what they write, and where, is what is attacked."""
    ways = {
        "scan2flex_jax.fitting.fit": lambda study, *_, **__: kept("fit", lambda: fit(study, elements=ELEMENTS)),
        "scan2flex_jax.inference.explain": lambda study, **_: kept("explain", lambda: explain(study, elements=ELEMENTS)),
        "scan2flex_jax.inference.plan": lambda found, **_: kept("plan", lambda: plan(found)),
        "scan2flex_jax.prediction.predict": lambda study, **_: kept("predict", lambda: predict(study, elements=ELEMENTS)),
        "scan2flex_jax.reporting.report": lambda found, **_: kept("report", lambda: report(found)),
        "scan2flex_jax.scan.extract_study": lambda study, *_, **__: kept("extract", lambda: extract_study(study)),
    }
    with contextlib.ExitStack() as stack:
        for name, way in ways.items():
            stack.enter_context(mock.patch(name, way))
        yield
