"""What reports and pictures are made of: a fit whose texts are markup, and an explanation of made-up evidence."""

import numpy as np

from scan2flex_jax.fitting.noise import Noise
from scan2flex_jax.inference import Explanation, Hypothesis, PoseChange, Ranked
from scan2flex_jax.posterior.quantities import Field

EVIL = '</script><script>alert("x")</script> & <b>$\\alpha$</b>'  # a title, and the name of a pose


def explained(fitted, verdict="tied"):
    """An explanation as `explain` makes them, of made-up evidence."""
    poses = {name: changed(p) for name, p in fitted.poses.items()}
    parameters = {"position": 0.42, "angle": np.array([0.1, 0.0, 0.0]), "width": 0.02}
    ranking = (
        Ranked("kink", parameters, 21.5, 0.0025, "tied", ("natural_curvature",)),
        Ranked("natural_curvature", {"curvature": np.array([0.3, 0.0, 0.0])}, 20.0, 0.0025, "tied", ("kink",)),
        Ranked("point_mass", {"position": 0.1, "mass": 0.0}, -900.0, 1.0, "absent"),
    )
    s = np.linspace(0, 1, 9)
    field = Field(s, np.ones((9, 3)), np.full((9, 3), 0.1), "N/m")
    table = (
        Hypothesis(("kink",), "as stated", 21.5, 19.0, 4.0, "best"),
        Hypothesis(("natural_curvature",), "as stated", 20.0, 18.0, 4.0, "tied"),
        Hypothesis((), "as stated", 0.0, 0.0, 0.0, "simpler"),
    )
    return Explanation(
        study=fitted.calibrated, fit=fitted, verdict=verdict, p_value=0.0025, noise=Noise(1e-6, 1e-6, 0.05), hypotheses=table,
        ranking=ranking, chosen=ranking[:1], estimates=fitted.estimates, poses=poses, settle=("kink: look at the cable",),
        sentences=("something is missing (p = 0.003)",), load=field,
    )  # fmt: skip


def changed(p):
    """A fitted pose that was twice as far off before."""
    return PoseChange(
        role=p.role, rms_before=2 * p.rms, rms=p.rms, worst=p.worst, stable=True, s=p.s, residual_before=2 * p.residual,
        residual=p.residual, measured=p.measured, modelled=p.modelled, left_out_before=3e-6, left_out=2e-6,
    )  # fmt: skip
