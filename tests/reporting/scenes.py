"""What reports and pictures are made of: a fit whose texts are markup, and an explanation of made-up evidence."""

import numpy as np

from scan2flex_jax.diagnosis import Explanation, PoseChange, Ranked
from scan2flex_jax.diagnosis.locate import Field
from scan2flex_jax.fitting.noise import Noise

EVIL = '</script><script>alert("x")</script> & <b>$\\alpha$</b>'  # a title, and the name of a pose


def explained(fitted, verdict="tied"):
    """An explanation as `explain` makes them, of made-up evidence."""
    poses = {
        name: PoseChange(
            p.role, 2 * p.rms, p.rms, p.worst, True, p.s, 2 * p.residual, p.residual, p.measured, p.modelled, 3e-6, 2e-6
        )
        for name, p in fitted.poses.items()
    }
    parameters = {"position": 0.42, "angle": np.array([0.1, 0.0, 0.0]), "width": 0.02}
    ranking = (
        Ranked("kink", parameters, 21.5, 0.0025, "tied", ("natural_curvature",)),
        Ranked("natural_curvature", {"curvature": np.array([0.3, 0.0, 0.0])}, 20.0, 0.0025, "tied", ("kink",)),
        Ranked("point_mass", {"position": 0.1, "mass": 0.0}, -900.0, 1.0, "absent"),
    )
    s = np.linspace(0, 1, 9)
    field = Field(s, np.ones((9, 3)), np.full((9, 3), 0.1), 3.0, "N/m")
    return Explanation(
        fitted.calibrated, fitted, verdict, 0.0025, Noise(1e-6, 1e-6, 0.05), ranking, ranking[:1], 0.4, fitted.estimates, poses,
        settle=("kink: look at the cable",), sentences=("something is missing (p = 0.003)",), load=field,
    )  # fmt: skip
