"""Relative error of EI over EI/(g rhoA): a cantilever whose tip is measured with an error of 1 mm (the paper's Section 2.4).

The sinking u of the tip and its slope over log EI are solved for; the error of EI is that of u over the slope. The formula is
its limit for stiff cables, u = w L^4/(8 EI) with w = g rhoA, where the error grows in proportion to EI/w:
dEI/EI = 8 EI du/(w L^4). Tips with drawn errors, read back through the measured curve, are beside both.
"""

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from scipy.interpolate import PchipInterpolator

from benchmarks.paper import DENSITY, GJ, LENGTH, G
from benchmarks.sensitivity.bench import save
from scan2flex_jax import Boundary, Cable, CableModel, equilibrium
from scan2flex_jax.sweep import Axis, Output, Traced, failed, grid, sweep

TIP_ERROR = 1.0e-3  # m, standard deviation of the measured sinking of the tip
VALUES = np.logspace(-3, 1, 33)  # EI, N m^2
ALONG_X = np.array([0.5, 0.5, 0.5, 0.5])  # quaternion: d3 = +x
W = DENSITY * G  # N/m


def tip(log_EI):
    """Sinking of the tip (m) of a horizontal cantilever, and its verdict."""
    model = CableModel(Cable(LENGTH, DENSITY, jnp.exp(log_EI), GJ), jnp.array([0.0, 0.0, -G]))
    e = equilibrium(model, Boundary.of((np.zeros(3), ALONG_X)))
    return -e.points[-1, 2], e.verdict


def lane(inputs):
    """The tip and its slope over log EI."""
    log_EI = jnp.log(inputs["bending_stiffness"])
    slope, verdict = jax.jacfwd(tip, has_aux=True)(log_EI)
    return {"tip": tip(log_EI)[0], "slope": slope}, verdict


def run(bench, wanted) -> None:
    if not wanted("cantilever"):
        return
    task = Traced(lane, {"tip": Output("m"), "slope": Output("m")})
    found = sweep(task, grid(bending_stiffness=Axis(VALUES, "N m^2")))
    figures = errors(found["tip"].values, found["slope"].values)
    bench.keep("cantilever", "error of EI", figures | {"failed": len(failed(found))})
    picture(figures)


def errors(u, slope) -> dict:
    """The curve, the formula, and draws."""
    error, formula = TIP_ERROR / np.abs(slope), 8.0 * VALUES * TIP_ERROR / (W * LENGTH**4)
    stiff = VALUES / (W * LENGTH**3) > 1.0
    over = (error / formula)[stiff]
    return {
        "EI (N m^2)": VALUES.tolist(), "EI/(g rhoA) (m^3)": (VALUES / W).tolist(), "tip (m)": u.tolist(),
        "error of the tip (m)": TIP_ERROR, "relative error of EI": error.tolist(), "formula 8 EI du/(w L^4)": formula.tolist(),
        "of draws": redrawn(u), "length (m)": LENGTH,
        "measured over formula, EI/(w L^3) above 1": [float(over.min()), float(over.max())],
        "power of EI/(g rhoA), stiff half": float(np.polyfit(np.log(VALUES[stiff]), np.log(error[stiff]), 1)[0]),
    }  # fmt: skip


def redrawn(u) -> list[dict]:
    """Relative spread of EI read off noisy tips by the measured curve, where every draw still has an EI on the curve."""
    order, out = np.argsort(u), []
    inverse = PchipInterpolator(u[order], np.log(VALUES)[order], extrapolate=False)
    rng = np.random.default_rng(0)
    for k in range(2, len(VALUES) - 2, 3):
        logs = inverse(u[k] + TIP_ERROR * rng.standard_normal(2000))
        if np.all(np.isfinite(logs)):
            spread = float(np.std(np.exp(logs)) / VALUES[k])
            out.append({"EI/(g rhoA) (m^3)": float(VALUES[k] / W), "relative error of EI": spread})
    return out


def picture(figures) -> None:
    figure, ax = plt.subplots(figsize=(5.6, 4.0), layout="constrained")
    x = figures["EI/(g rhoA) (m^3)"]
    ax.loglog(x, figures["relative error of EI"], color="#c1272d", lw=1.5, label="measured: 1 mm over the slope of the tip")
    ax.loglog(x, figures["formula 8 EI du/(w L^4)"], "--", color="k", lw=1.0, label=r"$8\,\Delta u\,EI/(g\rho A\,L^4)$")
    at, spread = zip(*(d.values() for d in figures["of draws"]), strict=True)
    ax.loglog(at, spread, "o", ms=4, color="#2b5c9e", label="2,000 draws of the tip's error")
    ax.set(xlabel="EI/(g rhoA) (m$^3$), cable of 1 m", ylabel="relative error of EI (-)")
    ax.legend(frameon=False, fontsize=8)
    save(figure, "cantilever")
