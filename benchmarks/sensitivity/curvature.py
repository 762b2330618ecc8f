"""Natural curvature as an unknown beside EI and GJ: from how many starts it is recovered, and both stiffnesses with it.

Shapes are those of the package's own model on four times as many elements. Four cases: constant, about one material axis; the
same with the other axes free; a set bend at one place (`kink`); and curvature that varies along the cable. The study format has
no word for the last: its `curvature_profile` is an answer, not a declaration. `FieldCurvature` below is what a user
writes for it in Python (docs/adding-an-effect.md): values about d1 at five points, linear between them, each an unknown.
"""

from dataclasses import replace
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from scipy.interpolate import CubicHermiteSpline

from benchmarks import paper
from benchmarks.sensitivity.bench import run as was_run
from benchmarks.sensitivity.bench import save
from scan2flex_jax.effects import parameter, register_effect
from scan2flex_jax.fitting.problem import FIT_ELEMENTS, Problem
from scan2flex_jax.rod.effect import AbstractEffect
from scan2flex_jax.study import EffectDeclaration, MeasuredCurve, Unknown
from scan2flex_jax.sweep import Axis, fits, grid

CURVED = np.array([2.0, 0.0, 0.0])  # 1/m about d1: a cable that came off a reel of half a metre
KINK = {"position": 0.4, "angle": np.array([0.5, 0.0, 0.0]), "width": 0.1}
VARYING = np.array([3.0, 2.5, 0.5, -0.5, -1.0])  # 1/m about d1, from the start to the end
STARTS = (-8.0, -2.0, 0.0, 4.0, 8.0)  # 1/m
NEAR = 0.01  # of the largest true value: recovered
_ONE_AXIS = np.array([20.0, 1e-9, 1e-9])  # range of the three components: the others are held


@register_effect  # studies may hold it and fits estimate it; `explain` does not look for it
class FieldCurvature(AbstractEffect):
    """Natural curvature ``about_d1`` (1/m) on five points evenly along the cable, linear between them."""

    kind: ClassVar[str] = "field_curvature"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "the cable is bent at rest, here more, there less"
    about_d1: jax.Array = parameter("1/m", len(VARYING))

    def section(self, section, length):
        field = jnp.interp(section.s, jnp.linspace(0.0, 1.0, len(VARYING)) * length, self.about_d1)
        return eqx.tree_at(lambda x: x.natural, section, section.natural.at[:, 3].add(field))


def made(study, **cable):
    """The study with every value known and with shapes of its own model on a fine mesh."""
    whole = replace(study, cable={**study.cable, **paper.TRUTH, **cable}, unknowns=())
    count = 4 * FIT_ELEMENTS
    problem = Problem(whole, count)
    found = problem.evaluator(np.zeros(0))
    if not found.solved:
        raise SystemExit("the poses of the study on natural curvature could not be solved")
    nodes, s = np.linspace(0.0, problem.length, count + 1), np.linspace(0.02, 0.98, 80) * problem.length
    curves = [CubicHermiteSpline(nodes, r, R[:, :, 2])(s) for r, R in zip(*found.configuration, strict=True)]
    return replace(whole, poses=tuple(replace(p, curve=MeasuredCurve(c)) for p, c in zip(whole.poses, curves, strict=True)))


def estimated(study, lane, unknown, effects=()):
    """The study with EI, GJ and one more unknown, from the lane's guesses."""
    cable = {k: v for k, v in study.cable.items() if k not in (*paper.STIFF, unknown.name)}
    both = (Unknown(name, lane[f"guess_{name}"], 1e-3, 1e3) for name in paper.STIFF)
    return replace(study, cable=cable, unknowns=(*both, unknown), effects=effects)


def about_one_axis(study, lane):
    """The other two components are held at zero."""
    return estimated(study, lane, Unknown("natural_curvature", np.array([lane["start"], 0.0, 0.0]), -_ONE_AXIS, _ONE_AXIS))


def about_all_axes(study, lane):
    return estimated(study, lane, Unknown("natural_curvature", np.array([lane["start"], 0.0, 0.0]), -20.0, 20.0))


def kinked(study, lane):
    """A set bend of unknown angle at a known place."""
    start = {**KINK, "angle": np.array([lane["start"] / 8.0, 0.0, 0.0])}
    unknown = Unknown("kink.angle", start["angle"], -3.0, 3.0)
    return estimated(study, lane, unknown, (EffectDeclaration("kink", start),))


def varying(study, lane):
    """Curvature that varies along the cable, from a constant start."""
    start = np.full(len(VARYING), lane["start"])
    effects = (EffectDeclaration(FieldCurvature.kind, {"about_d1": start}),)
    return estimated(study, lane, Unknown(f"{FieldCurvature.kind}.about_d1", start, -20.0, 20.0), effects)


def cases():
    """Name -> measured study, what a lane makes of it, the parameter, and its truth."""
    plain = paper.simulated()
    constant = made(plain, natural_curvature=CURVED)

    def of(kind, parameters):
        return made(replace(plain, effects=(EffectDeclaration(kind, parameters),)))

    return {
        "about one axis": (constant, about_one_axis, "natural_curvature", CURVED),
        "about all axes": (constant, about_all_axes, "natural_curvature", CURVED),
        "set at one place": (of("kink", KINK), kinked, "kink.angle", KINK["angle"]),
        "varying along the cable": (
            of(FieldCurvature.kind, {"about_d1": VARYING}), varying, f"{FieldCurvature.kind}.about_d1", VARYING
        ),
    }  # fmt: skip


def run(bench, wanted) -> None:
    decades = Axis([0.01, 1.0], "N m^2")
    lanes = grid(start=Axis(STARTS, "1/m"), guess_bending_stiffness=decades, guess_torsional_stiffness=decades)
    for name, (study, change, sought, truth) in cases().items():
        if wanted(name):
            first = change(study, {k: v[0] for k, v in lanes.take(slice(None)).items()})  # its unknowns are the outputs
            task = fits(first, lambda _, lane, s=study, change=change: change(s, lane))
            found = bench.sweep(f"curvature {name}", task, lanes)
            bench.keep("natural curvature", name, outcomes(found, sought, truth))
            if change is varying:
                picture(found[sought].values.reshape(-1, len(VARYING)), was_run(found).ravel())


def outcomes(found, parameter, truth) -> dict:
    """From how many starts the curvature came back, and both stiffnesses with it, to 1 %."""
    done = was_run(found)
    near = np.all(np.abs(found[parameter].values - truth) < NEAR * np.max(np.abs(truth)), axis=-1)
    stiff = np.all([np.abs(found[k].values / v - 1) < NEAR for k, v in paper.TRUTH.items()], axis=0)
    both = near & stiff & done
    return {
        "starts": int(done.sum()), "recovered": int(both.sum()), "curvature recovered": int((near & done).sum()),
        "failed": int(np.sum(found["code"].values[done] != 0)), "seconds": float(found["seconds"].values[done].sum()),
        "recovered by start (1/m)": {f"{k:g}": int(both[i].sum()) for i, k in enumerate(found["start"].values)},
    }  # fmt: skip


def picture(values, done) -> None:
    """The curvature that came back from each start, over the true one."""
    figure, ax = plt.subplots(figsize=(5.6, 3.6), layout="constrained")
    s = np.linspace(0.0, paper.LENGTH, len(VARYING))
    for k, row in enumerate(values[done]):
        ax.plot(s, row, color="#c1272d", lw=1.0, label="from each start" if k == 0 else None)
    ax.plot(s, VARYING, "ks", ms=5, mfc="none", label="truth")
    for k in STARTS:
        ax.axhline(k, color="#888888", lw=0.6, ls=":", label="starts" if k == STARTS[0] else None)
    ax.set(xlabel="s (m)", ylabel="natural curvature about d1 (1/m)")
    ax.legend(frameon=False, fontsize=8)
    save(figure, "varying-curvature")
