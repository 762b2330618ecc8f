"""What varies along the cable: errors, residuals, section forces, stiffness and loads over arc length; and laws over strain."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.plot.style import BAND, BEFORE, MODELLED, PALE, chosen, legend, named

if TYPE_CHECKING:  # for annotations only: drawing needs no import of these types
    from scan2flex_jax.inference import Explanation, Fit

Beside = Mapping[str, tuple[np.ndarray, np.ndarray]]
EVEN = "nothing lets the stiffness vary along this cable: there is no stiffness to draw"
_DECADES = 5.0  # largest over smallest stiffness from which on it is drawn in logarithms


def errors(fit: "Fit | Explanation", pose: str | None = None, ax: Axes | None = None) -> Axes:
    """Distance between measured and modelled curve along the cable (mm), of one pose or of all (the paper's Fig. 4)."""
    ax = plt.subplots()[1] if ax is None else ax
    for name in chosen(fit, pose):
        p = fit.poses[name]
        if not len(p.s):
            continue
        order = np.argsort(p.s)
        before: np.ndarray | None = getattr(p, "residual_before", None)
        if pose is not None and before is not None and np.all(np.isfinite(before)):
            ax.plot(p.s[order], 1e3 * np.linalg.norm(before[order], axis=1), color=BEFORE, label="before", **PALE)
        if np.isfinite(p.rms):
            colour = None if pose is None else MODELLED
            label = named(name, f" ({p.role})") if pose is None else "modelled" if before is None else "after"
            style = "-" if p.role == "fit" or pose is not None else "--"
            ax.plot(p.s[order], 1e3 * np.linalg.norm(p.residual, axis=1)[order], style, lw=1.4, label=label, color=colour)
    ax.set(xlabel="arc length s (m)", ylabel="distance (mm)", ylim=(0, 1.05 * ax.dataLim.y1))
    if pose is not None:
        ax.set_title(named(pose, f" ({p.role})"), fontsize=10, pad=22)
    legend(ax)
    return ax


def residual(explanation: "Explanation", pose: str | None = None, ax: Axes | None = None) -> Axes:
    """Residual along s (mm), before and after: for one pose both normal components over the 95 % band of the noise, for all
    poses (no ``pose``) the distances."""
    ax = plt.subplots()[1] if ax is None else ax
    if explanation.noise is None:
        raise Scan2FlexError("nothing was solved: there is no residual to draw")
    if pose is None:
        return _residuals(explanation, ax)
    p = explanation.poses[chosen(explanation, pose)[0]]
    order = np.argsort(p.s)
    s = p.s[order]
    band = 1.96e3 * explanation.noise.total
    ax.fill_between([s[0], s[-1]], -band, band, color=BAND, lw=0, label="95 % of the noise")
    for k, style in enumerate(("-", (0, (2, 1)))):
        wide = {**PALE, "ls": style} if k == 0 else {**PALE, "ls": style, "lw": 2.5}
        ax.plot(s, 1e3 * p.residual_before[order, k], color=BEFORE, label=f"before, normal {k + 1}", **wide)
    for k, style in enumerate(("-", "--")):
        ax.plot(s, 1e3 * p.residual[order, k], style, color=MODELLED, lw=1.2, label=f"after, normal {k + 1}")
    ax.set(xlabel="arc length s (m)", ylabel="residual (mm)")
    title = named(pose, f" ({p.role}): {1e3 * p.rms_before:.3g} to {1e3 * p.rms:.3g} mm")
    ax.set_title(title, fontsize=10, pad=46)
    legend(ax)
    return ax


def _residuals(explanation, ax):
    """Distances of all poses along s (mm): broad and pale before, thin after."""
    for i, (name, p) in enumerate(explanation.poses.items()):
        order, style = np.argsort(p.s), "-" if p.role == "fit" else "--"
        was, now = (1e3 * np.linalg.norm(values[order], axis=1) for values in (p.residual_before, p.residual))
        ax.plot(p.s[order], was, color=f"C{i % 10}", **{**PALE, "alpha": 0.3})
        ax.plot(p.s[order], now, style, lw=1.4, color=f"C{i % 10}", label=named(name, f" ({p.role})"))
    ax.set(xlabel="arc length s (m)", ylabel="distance (mm), pale before", ylim=(0, None))
    legend(ax)
    return ax


def along(values: Mapping[str, tuple[np.ndarray, np.ndarray]], label: str, ax: Axes | None = None) -> Axes:
    """One quantity along the cable, one line per pose: ``values`` are ``(s, quantity)`` by pose, ``label`` name and unit."""
    ax = plt.subplots()[1] if ax is None else ax
    for i, (name, (s, quantity)) in enumerate(values.items()):
        ax.plot(s, quantity, color=f"C{i % 10}", lw=1.4, label=named(name))
    ax.set(xlabel="arc length s (m)", ylabel=label)
    legend(ax)
    return ax


def law(fit: "Fit | Explanation", kind: str | None = None, ax: Axes | None = None) -> Axes:
    """Moment (N m) of a law over its strain (1/m) with its 95 % band, full where poses reached the strain and pale where they
    did not; with the linear law of the stiffness at zero strain. Of the fit of a study that declares a law, or of an
    explanation that added one; without a ``kind``, the first."""
    ax = plt.subplots()[1] if ax is None else ax
    found = next((x for x in fit.laws if kind in (None, x.kind)), None)
    if found is None:
        what = f"no {kind}" if fit.laws else "no bending_law and no torsion_law"
        raise Scan2FlexError(f"the study declares {what}: there is no law to draw")
    q, told = found.at, np.where(found.reached, found.moment, np.nan)
    for reached, alpha, label in ((True, 0.3, "95 % band"), (False, 0.1, "not reached by a pose")):
        inside = found.reached == reached
        if np.any(inside):
            wide = inside | np.r_[inside[1:], False] | np.r_[False, inside[:-1]]  # so that the two parts meet
            ax.fill_between(q, found.low, found.high, where=wide, color=MODELLED, alpha=alpha, lw=0, label=label)
    ax.plot(q, found.moment, "--", color=MODELLED, lw=1.0)
    ax.plot(q, told, color=MODELLED, lw=1.5, label="law")
    top = min(ax.get_ylim()[1], 2.0 * float(np.max(found.moment)))  # a band that is open at small strains would hide the law
    ax.plot(q, found.stiffness * q, color="#999999", lw=0.8, label="linear")
    ax.set(xlabel=f"{found.strain} (1/m)", ylabel="moment (N m)", xlim=(0.0, q[-1]), ylim=(0.0, top))
    legend(ax)
    return ax


def stiffness(fit: "Fit | Explanation", ax: Axes | None = None, beside: Beside | None = None) -> Axes:
    """EI along the cable (N m^2) with its 95 % band, of a fit or an explanation with an effect that lets it vary.

    ``beside``: EI (N m^2) at arc lengths (m) by other means, under its name.
    """
    ax = plt.subplots()[1] if ax is None else ax
    found = fit.along
    if found is None:
        raise Scan2FlexError(EVEN)
    if np.all(np.isfinite(found.high)):
        ax.fill_between(found.s, found.low, found.high, color=MODELLED, alpha=0.25, lw=0, label="95 % band")
    ax.plot(found.s, found.bending, color=MODELLED, lw=1.5, label="EI from the shapes")
    for name, (s, EI) in (beside or {}).items():
        ax.plot(s, EI, ls="", marker="o", ms=5, mfc="white", mec="k", mew=1.2, label=name)
    if np.max(found.bending) > _DECADES * np.min(found.bending):
        ax.set(yscale="log", ylim=(0.3 * np.min(found.bending), 3.0 * np.max(found.bending)))
    ax.set(xlabel="arc length s (m)", ylabel="bending stiffness (N m$^2$)")
    legend(ax)
    return ax


def load(explanation: "Explanation", ax: Axes | None = None) -> Axes:
    """Equivalent load (N/m, scan frame) common to all poses, with its 95 % band: where a cause acts, not which one."""
    ax = plt.subplots()[1] if ax is None else ax
    f = explanation.load
    if f is None:
        raise Scan2FlexError("nothing was solved: there is no load to draw")
    for k, (name, colour) in enumerate(zip("xyz", ("#c1272d", "#2d7d46", "#2b5c9e"), strict=True)):
        mean, band = f.mean[:, k], 1.96 * f.std[:, k]
        ax.plot(f.s, mean, color=colour, lw=1.5, label=name)
        ax.fill_between(f.s, mean - band, mean + band, color=colour, alpha=0.15, lw=0)
    ax.axhline(0.0, color="k", lw=0.8)
    ax.set(xlabel="arc length s (m)", ylabel="equivalent load (N/m)")
    legend(ax)
    return ax
