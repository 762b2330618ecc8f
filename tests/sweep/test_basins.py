"""The picture of the minima that a sweep over guesses ended in."""

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

from scan2flex_jax import plot
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.sweep import Output, Task, grid, sweep
from scan2flex_jax.sweep.task import NOT_RUN

mpl.use("Agg")


def test_basins_show_ends_and_failures_and_nothing_where_no_fit_was_run():
    def estimate(sample):
        EI, GJ = sample["guess_bending_stiffness"], sample["guess_torsional_stiffness"]
        if EI > 1.0 and GJ > 1.0:
            raise Scan2FlexError("no equilibrium")
        right = EI < 1.0
        return {"bending_stiffness": 0.1 if right else 0.2, "torsional_stiffness": 0.25, "cost": float(not right)}

    outputs = dict.fromkeys(("bending_stiffness", "torsional_stiffness", "cost"), Output())
    guesses = (np.geomspace(0.01, 100.0, 5), "N m^2")
    found = sweep(Task(estimate, outputs), grid(guess_bending_stiffness=guesses, guess_torsional_stiffness=guesses))
    found["code"][0, 0] = NOT_RUN
    for name in outputs:
        found[name][0, 0] = np.nan
    ax = plot.basins(found)
    crosses = ax.lines[0].get_xydata()
    assert len(crosses) == 4 and np.all(crosses > 1.0)
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["0.1, 0.25 (9)", "0.2, 0.25 (11)"]
    plt.close("all")
