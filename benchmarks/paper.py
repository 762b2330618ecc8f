"""The paper's simulated cable (its Section 6.2) as the benchmarks use it: the study, its truth, its guesses. One place for all.

EI 0.1, GJ 0.25 N m^2; three poses are fitted, of shapes that solve the continuous equations, without noise. Guesses stand on a
logarithmic grid from 0.01 to 100 N m^2 for each stiffness; a guess is *recovered* when both estimates are within 0.1 %.
"""

from dataclasses import replace

import numpy as np

from scan2flex_jax.examples import example_path
from scan2flex_jax.study import Study, load_study

EI, GJ = 0.1, 0.25  # N m^2
TRUTH = {"bending_stiffness": EI, "torsional_stiffness": GJ}
STIFF = tuple(TRUTH)
WITHIN = 1e-3
LENGTH, DENSITY, G = 1.0, 0.2, 9.81  # m, kg/m, m/s^2


def simulated(validate: bool = False) -> Study:
    """The study with the poses that are fitted; ``validate`` keeps the one that is not."""
    study = load_study(example_path("simulated-cable"))
    return study if validate else replace(study, poses=study.fit_poses)


def guesses(n: int) -> np.ndarray:
    """``n`` guesses of one stiffness (N m^2); n = 5 are decades, and n = 33 holds them."""
    return np.logspace(-2, 2, n)


def guessed(study: Study, guess) -> Study:
    """The study with guesses of EI and GJ (N m^2)."""
    values = dict(zip(STIFF, guess, strict=True))
    return replace(study, unknowns=tuple(replace(u, guess=values.get(u.name, u.guess)) for u in study.unknowns))


def recovered(EI, GJ) -> np.ndarray:
    """Which of these estimates (N m^2, any shape) are both within 0.1 %; NaN is not."""
    near = [np.abs(np.asarray(x) / truth - 1.0) < WITHIN for x, truth in zip((EI, GJ), TRUTH.values(), strict=True)]
    return np.all(near, axis=0)
