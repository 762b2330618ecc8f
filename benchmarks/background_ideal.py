"""What the data of a blind case with a background allow: a fit that knows all that `explain` has to find.

    python -m benchmarks.background_ideal CASES ANSWERS --json FILE [--only b001,b002] [--record]

Each case of `benchmarks.blind.generate --background` with one effect is made again from its seed, with the same points. The
simulator that made it then fits EI, GJ and the numbers of the true effect type by generalised least squares. It knows the
covariance of noise, of each pose's own curvature and of its seats, and the arc lengths, and starts at the truth, so that a
direction that the data leave open costs it nothing. To first order no unbiased estimator has a smaller variance. A tether and a
support plane are left out: the simulator has no free numbers for them. The scores are those of `background_score`.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.background_score import SIZE, VALIDATE, share, size_off_by
from benchmarks.blind import background
from benchmarks.blind.generate import MOST_POINTS
from benchmarks.blind.refits import Fit, free_numbers
from benchmarks.blind.scene import Cable
from benchmarks.blind.shapes import Lens, Model
from benchmarks.each_case import run

SETTLED = 1e-6  # of what is left: a step that gains less is the last
STEPS = 40


def fitted(_: Path, answer: dict) -> dict:
    """Errors of size and of validate poses of one case."""
    (kind,) = answer["kinds"]
    _, case = background.make_case(tuple(answer["seed"]), (kind,), MOST_POINTS)
    base, truth, fit = case["base"], case["effects"], case["fit"]
    whole = Model(base.scene, truth, base.F.sigma, base.y)
    first = np.arange(fit)
    model = Model(base.scene.pick(first), truth, base.F.sigma, whole.y[first])
    lens = Lens(base.F.sigma, base.scene.cable.length, case["s"][:fit], case["noise"])
    found = Fit(model, lens, case["points"][:fit], case["background"], truth)
    left, model, z = found.run(enough=0.0, steps=STEPS, settled=SETTLED)
    if model is None:
        return {"kind": kind, "fault": "not solved at the truth"}
    out = {"kind": kind, "left_of_expected": left / (2 * lens.count)}
    scene, effects = found.unpack(z)
    out["size_off_by"] = size_off_by(kind, effects[0], truth[0], answer["true_length"])
    last = np.arange(fit, len(base.y))
    full = Model(replace(base.scene, cable=scene.cable).pick(last), effects, base.F.sigma, whole.y[last])
    if full.ok.all():
        far = [background.distances({"model": full}, p, x) for p, x in enumerate(case["points"][fit:])]
        out["validate_over_attained"] = float(np.sqrt(np.mean(np.concatenate(far) ** 2)) / answer["attained_validate"])
    return out


def table(rows: list[dict]) -> dict:
    """Shares of the cases within the targets of `background_score`; a case with a fault counts as missed."""
    sized = [r for r in rows if "size_off_by" in r or "fault" in r]
    return {
        "cases": len(rows), "faults": sum("fault" in r for r in rows),
        "size_within_15_percent": share(r.get("size_off_by", np.inf) < SIZE for r in sized),
        "validate_within_1.3": share(r.get("validate_over_attained", np.inf) < VALIDATE for r in rows),
    }  # fmt: skip


def wanted(answer: dict) -> bool:
    """Whether a case has one effect, with numbers that the simulator can fit."""
    kinds = answer["kinds"]
    return len(kinds) == 1 and free_numbers(kinds[0], Cable(1.0, 0.01, 0.1, 0.1, 0.1)) is not None


if __name__ == "__main__":
    run("background_ideal", __doc__, fitted, table, wanted)
