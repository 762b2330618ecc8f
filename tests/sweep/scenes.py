"""A sweep of equilibria over clamps and stiffness, and a cheap one over numbers that notes which samples it has run."""

import time
from functools import cache
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.model import CableModel
from scan2flex_jax.sweep import Output, Task, equilibria, grid

ELEMENTS = 12
ALONG_X = np.array([0.5, 0.5, 0.5, 0.5])  # quaternion: d3 = +x
GRAVITY = np.array([0.0, 0.0, -9.81])
LENGTH = 1.0
QUANTITIES = ("points", "energy", "reaction_force")


def hanging(sample):
    """A cable of 1 m between two clamps ``span`` (m) apart."""
    cable = Cable(LENGTH, 0.2, sample["bending_stiffness"], 0.25)
    far = jnp.array([1.0, 0.0, 0.0]) * sample["span"]
    return CableModel(cable, jnp.asarray(GRAVITY)), Boundary.of((np.zeros(3), ALONG_X), (far, ALONG_X))


@cache
def hanging_cables():
    return equilibria(hanging, QUANTITIES, elements=ELEMENTS, max_steps=60)


# between clamps the last cable is too limp for any number of elements that a solve begins with
SPANS, STIFFNESSES = np.array([0.6, 0.8]), np.array([0.05, 0.2, 1e-6])
CLAMPS_APART = grid(span=(SPANS, "m"), bending_stiffness=(STIFFNESSES, "N m^2"))


def squares(note: Path | None = None, pause: float = 0.0, count: int = 40):
    """``(task, samples)`` of numbers and their squares; each sample is noted in a file and takes ``pause`` seconds."""

    def square(sample):
        if note:
            with note.open("a") as f:
                f.write(f"{sample['x']:g}\n")
        time.sleep(pause)
        return {"square": sample["x"] ** 2, "powers": sample["x"] ** np.arange(3)}

    outputs = {"square": Output("m^2"), "powers": Output("-", ("power",))}
    # what is noted and how long it takes is no part of what is computed
    return Task(square, outputs, about={"function": "squares"}), grid(x=(np.arange(float(count)), "m"))
