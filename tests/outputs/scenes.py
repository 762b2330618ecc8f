"""A study of hanging cables whose poses have any names, and commands run on it as a user runs them."""

import os
import subprocess
import sys

import numpy as np
from typer.testing import CliRunner

from scan2flex_jax.cli.app import app

ALONG_X = [0.7071067811865476, 0.0, 0.7071067811865476, 0.0]
HEAD = """format = "scan2flex-study/1"
title = "A [bold] cable"
gravity = [0.0, 0.0, -9.81]

[cable]
length = 1.0
length_density = 0.2
radius = 0.005
bending_stiffness = 0.1
torsional_stiffness = 0.25
"""


def curve(n=30):
    s = np.linspace(0, 1, n)
    return np.column_stack([0.6 * s, 0 * s, -0.35 * np.sin(np.pi * s) ** 2])


def toml_text(name):
    """A TOML string of any name."""
    return '"' + "".join(c if c.isalnum() else f"\\U{ord(c):08x}" for c in name) + '"'


def write_study(folder, names=("sag",), measured="centre_curve"):
    """A study with a pose for each name, whose curves (or scans) are pose-0.csv (or .xyz) and so on."""
    folder.mkdir(parents=True, exist_ok=True)
    text = HEAD
    for i, name in enumerate(names):
        file = f"pose-{i}.{'csv' if measured == 'centre_curve' else 'xyz'}"
        header = "x,y,z" if file.endswith("csv") else ""
        np.savetxt(folder / file, curve(), delimiter=",", header=header, comments="")
        text += f'\n[[pose]]\nname = {toml_text(name)}\nrole = "fit"\n'
        text += f"start = {{ position = [0, 0, 0], quaternion = {ALONG_X} }}\n"
        text += f'end = {{ position = [0.6, 0, 0], quaternion = {ALONG_X} }}\n{measured} = "{file}"\n'
    (folder / "study.toml").write_text(text)
    return folder


def contents(folder):
    """Every file below a folder, and its bytes."""
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def run(*words):
    """A command in this process, without a cache of its own."""
    return CliRunner().invoke(app, [str(word) for word in words], env={"SCAN2FLEX_CACHE": "off"})


PROGRAM = [sys.executable, "-c", "from scan2flex_jax.cli import main; main()"]


def scan2flex(*words, **options):
    """The program in a process of its own."""
    environment = {**os.environ, "SCAN2FLEX_CACHE": "off", **options.pop("env", {})}
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "timeout": 300, **options}
    return subprocess.run([*PROGRAM, *map(str, words)], env=environment, check=False, **options)
