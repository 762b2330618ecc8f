"""A loop over lanes against `jax.vmap`, and lanes of like cost together against lanes as they come.

One pose from its measured curve, EI and GJ each from 0.01 to 100 N m^2. Processor time, taken in turn, so that a slow spell of
the machine meets all of them, on fewer lanes than the steps are counted on: a wide batch is slow on a CPU.
"""

from time import process_time

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks import paper
from benchmarks.record import timed_in_turn
from scan2flex_jax import Cable, CableModel
from scan2flex_jax.compilation import compiled
from scan2flex_jax.fitting.evaluate import one
from scan2flex_jax.fitting.parameters import model_at, template
from scan2flex_jax.fitting.poses import boundary_of
from scan2flex_jax.fitting.problem import Problem
from scan2flex_jax.sweep import Axis, Output, Quantity, equilibria, grid, sweep

LANES, TIMED = 16, 8  # each way: steps of 256 lanes, seconds of 64
WIDTHS = (16, 64)
REPEATS = 2
MIDDLE = {"middle": Quantity(lambda e: e.points[len(e.points) // 2], Output("m", ("axis",)))}


def run(bench, wanted) -> None:
    if not wanted("batches"):
        return
    study = paper.simulated()
    pose = study.pose("twist-90")
    task, lanes, timed = equilibria(measured(study, pose), MIDDLE), pairs(LANES), pairs(TIMED)
    calls = {
        "a sweep": lambda: sweep(task, timed, chunk=timed.count),
        "one lane in a call": lambda: sweep(task, timed, chunk=timed.count, at_once=1),
    }
    for width in WIDTHS:
        calls[f"{width} lanes, vectorised"] = vectorised(task, timed, width)
    seconds = {way: 1e3 * t["min_s"] / timed.count for way, t in timed_in_turn(calls, REPEATS, process_time).items()}
    steps = sweep(task, lanes)["steps"].values.ravel()
    guess = sweep(equilibria(coarse(pose), MIDDLE, elements=8), lanes)["steps"].values.ravel()
    order = {
        "as they come": np.arange(len(steps)),
        "by the steps of a mesh of 8": np.argsort(-guess, kind="stable"),
        "by their own steps (the limit)": np.argsort(-steps, kind="stable"),
        "at random": np.random.default_rng(0).permutation(len(steps)),
    }
    bench.keep("batches", "a loop and vmap", {
        "lanes": lanes.count, "lanes timed": timed.count, "ms per lane": seconds,
        "steps": [int(steps.min()), int(steps.max())], "mean steps": float(steps.mean()),
        "steps of batches of 16 over steps of the lanes": {name: waste(steps, o) for name, o in order.items()},
    })  # fmt: skip


def pairs(n):
    """Lanes over both stiffnesses."""
    return grid(**dict.fromkeys(paper.STIFF, Axis(np.logspace(-2, 2, n), "N m^2")))


def vectorised(task, lanes, width):
    """All lanes, ``width`` at a time through `jax.vmap`; waits for the last."""
    call = compiled(jax.vmap(task.function))
    groups = np.arange(lanes.count).reshape(-1, width)
    batches = [{name: jnp.asarray(x) for name, x in lanes.take(which).items()} for which in groups]
    return lambda: jax.block_until_ready([call(batch) for batch in batches])


def measured(study, pose):
    """A scene that starts from the measured curve of the pose."""
    problem = Problem(study)
    start, boundary, bare = one(problem.poses.start, study.poses.index(pose)), boundary_of(pose), template(study)
    layout = problem.layout

    def scene(lane):
        return model_at(layout, bare, jnp.log(jnp.stack([lane[name] for name in paper.STIFF]))), boundary, start

    return scene


def coarse(pose):
    """The pose from a generic start, for a mesh that has none of the measured curve's nodes."""
    boundary, gravity = boundary_of(pose), jnp.array([0.0, 0.0, -paper.G])
    return lambda lane: (CableModel(Cable(paper.LENGTH, paper.DENSITY, *(lane[n] for n in paper.STIFF)), gravity), boundary)


def waste(steps, order, width=16) -> float:
    """What batches of ``width`` run, over what their lanes need."""
    groups = steps[order].reshape(-1, width)
    return float(width * groups.max(axis=1).sum() / steps.sum())
