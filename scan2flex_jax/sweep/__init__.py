"""Sweeps: one function evaluated for many samples, each with its own status, stored as they come, as a labelled dataset.

    sweep(fits(study), grid(bending_stiffness=Axis(decades, "N m^2")), store="guesses")
    sweep(equilibria(scene, ("points",)), draws(tilt=Axis(tilts, "rad")))
"""

from scan2flex_jax.sweep.changes import guesses, noisy, random_turns, turned
from scan2flex_jax.sweep.equilibrium_task import QUANTITIES, Quantity, Scene, equilibria
from scan2flex_jax.sweep.fit_task import fits
from scan2flex_jax.sweep.labelled import failed
from scan2flex_jax.sweep.lanes import Axis, Lanes, draws, grid
from scan2flex_jax.sweep.run import device_mesh, sweep
from scan2flex_jax.sweep.store import open_sweep
from scan2flex_jax.sweep.task import Calls, Outcome, Output, Traced

__all__ = [
    "QUANTITIES",
    "Axis",
    "Calls",
    "Lanes",
    "Outcome",
    "Output",
    "Quantity",
    "Scene",
    "Traced",
    "device_mesh",
    "draws",
    "equilibria",
    "failed",
    "fits",
    "grid",
    "guesses",
    "noisy",
    "open_sweep",
    "random_turns",
    "sweep",
    "turned",
]
