"""Sweeps: one function evaluated for many samples, each with its own status, stored as they come, as a labelled dataset.

    sweep(fits(study), grid(guess_bending_stiffness=(decades, "N m^2")), store="guesses")
    sweep(minima(study), grid(guess_bending_stiffness=(decades, "N m^2")), client=Client())
    sweep(equilibria(scene, ("points",)), draws(tilt=(tilts, "rad")))
"""

from scan2flex_jax.sweep.changes import noisy, random_turns, turned
from scan2flex_jax.sweep.equilibrium_task import QUANTITIES, equilibria
from scan2flex_jax.sweep.fit_task import fits
from scan2flex_jax.sweep.minima_task import minima
from scan2flex_jax.sweep.run import failed, open_sweep, sweep
from scan2flex_jax.sweep.samples import draws, grid
from scan2flex_jax.sweep.task import Outcome, Output, Task

__all__ = [
    "QUANTITIES",
    "Outcome",
    "Output",
    "Task",
    "draws",
    "equilibria",
    "failed",
    "fits",
    "grid",
    "minima",
    "noisy",
    "open_sweep",
    "random_turns",
    "sweep",
    "turned",
]
