"""What the data of a blind case with a background allow an estimator that knows all that `explain` has to find.

    python -m benchmarks.background_ideal CASES ANSWERS --json FILE [--only b001,b002] [--record]

Each case of `benchmarks.blind.generate --background` with one effect is made again from its seed, with the same points. The
simulator that made it knows the effect type, the covariance of noise, of each pose's own curvature and of its seats, and the
arc lengths of the points. Two questions:

1. A fit by generalised least squares that starts at the truth. Directions that the data leave open cost it nothing, so it is
   optimistic. The scores are those of `background_score`.
2. What an efficient estimator may expect: the information matrix at the truth (Cramer and Rao) gives the covariance of all
   numbers; of draws from it, the share whose size is within 15 %, and whose validate poses, to first order, are within 1.3 of
   the error of the true model.

A tether and a support plane are left out: the simulator has no free numbers for them.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.background_score import SIZE, VALIDATE, share, size_off_by
from benchmarks.blind import background
from benchmarks.blind import effects as blind_effects
from benchmarks.blind.generate import MOST_POINTS
from benchmarks.blind.refits import Fit, free_numbers
from benchmarks.blind.scene import Cable
from benchmarks.blind.shapes import EPS, Lens, Model
from benchmarks.each_case import run

SETTLED = 1e-6  # of what is left: a step that gains less is the last
STEPS = 40
DRAWS = 2000


def fitted(_: Path, answer: dict) -> dict:
    """Errors of size and of validate poses of one case, and the shares of draws within the targets."""
    (kind,) = answer["kinds"]
    _, case = background.make_case(tuple(answer["seed"]), (kind,), MOST_POINTS)
    base, truth, fit = case["base"], case["effects"], case["fit"]
    whole = Model(base.scene, truth, base.F.sigma, base.y)
    first, last = np.split(np.arange(len(base.y)), [fit])
    model = Model(base.scene.pick(first), truth, base.F.sigma, whole.y[first])
    lens = Lens(base.F.sigma, base.scene.cable.length, case["s"][:fit], case["noise"])
    fit_of = Fit(model, lens, case["points"][:fit], case["background"], truth)
    unseen = Model(base.scene.pick(last), truth, base.F.sigma, whole.y[last])
    out = {"kind": kind} | expected(fit_of, model, unseen, case, answer)
    left, model, z = fit_of.run(enough=0.0, steps=STEPS, settled=SETTLED)
    if model is None:
        return out | {"fault": "not solved at the truth"}
    out["left_of_expected"] = left / (2 * lens.count)
    scene, effects = fit_of.unpack(z)
    out["size_off_by"] = size_off_by(kind, effects[0], truth[0], answer["true_length"])
    full = Model(replace(base.scene, cable=scene.cable).pick(last), effects, base.F.sigma, whole.y[last])
    if full.ok.all():
        far = [background.distances({"model": full}, p, x) for p, x in enumerate(case["points"][fit:])]
        out["validate_over_attained"] = float(np.sqrt(np.mean(np.concatenate(far) ** 2)) / answer["attained_validate"])
    return out


def expected(fit: Fit, model: Model, unseen: Model, case: dict, answer: dict) -> dict:
    """What draws from the inverse of the information at the truth give; each number has its range as a wide prior."""
    low, high = fit.bounds()
    z, kind = fit.start(), answer["kinds"][0]
    J = fit.columns(model, z)
    scale = np.sqrt(np.sum(J**2, axis=0) + 12.0 / (high - low) ** 2)
    information = J.T @ J / np.outer(scale, scale) + np.diag(12.0 / ((high - low) * scale) ** 2)
    values, axes = np.linalg.eigh(information)
    root = axes / np.sqrt(np.maximum(values, 1e-12)) / scale[:, None]
    drawn = root @ np.random.default_rng(answer["seed"]).normal(size=(len(z), DRAWS))
    found = [fit.unpack(np.clip(z + d, low, high))[1][0] for d in drawn.T]
    sizes = [size_off_by(kind, each, fit.effects[0], answer["true_length"]) for each in found]
    count = case["fit"]
    lens = Lens(unseen.F.sigma, fit.cable.length, case["s"][count:], case["noise"])
    changes = [_change(unseen, fit, z, e) for e in np.eye(len(z))]
    metres = case["noise"].sigma
    J = metres * unseen.columns(lens, changes, correlated=False)
    r = metres * unseen.residual(lens, case["points"][count:], correlated=False)
    far = np.sqrt(np.sum((r[:, None] + J @ drawn) ** 2, axis=0) / lens.count) / answer["attained_validate"]
    errors = np.sqrt(np.sum(root[:2] ** 2, axis=1))
    return {
        "expected_size": float(np.mean(np.array(sizes, float) < SIZE)), "expected_validate": float(np.mean(far < VALIDATE)),
        "expected_error_of_EI": float(errors[0]), "expected_error_of_GJ": float(errors[1]),
    }  # fmt: skip


def _change(unseen, fit, z, direction):
    """The unseen poses changed by a complex step of one number."""
    scene, effects = fit.unpack(z + 1j * EPS * direction)
    return blind_effects.build(replace(unseen.scene, cable=scene.cable), effects, unseen.F.sigma)


def table(rows: list[dict]) -> dict:
    """Shares of the cases within the targets of `background_score`; a case with a fault counts as missed."""
    sized = [r for r in rows if "size_off_by" in r or "fault" in r]
    mean = lambda key: {"share": float(np.mean([r[key] for r in rows])) if rows else None, "of": len(rows)}  # noqa: E731
    return {
        "cases": len(rows), "faults": sum("fault" in r for r in rows),
        "size_within_15_percent": share(r.get("size_off_by", np.inf) < SIZE for r in sized),
        "validate_within_1.3": share(r.get("validate_over_attained", np.inf) < VALIDATE for r in rows),
        "expected_size_within_15_percent": mean("expected_size"),
        "expected_validate_within_1.3": mean("expected_validate"),
    }  # fmt: skip


def wanted(answer: dict) -> bool:
    """Whether a case has one effect, with numbers that the simulator can fit."""
    kinds = answer["kinds"]
    return len(kinds) == 1 and free_numbers(kinds[0], Cable(1.0, 0.01, 0.1, 0.1, 0.1)) is not None


if __name__ == "__main__":
    run("background_ideal", __doc__, fitted, table, wanted)
