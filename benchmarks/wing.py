"""A wing with known weights at its tip: EI from the light ones, prediction of the heavy ones, and the heavy ones undeclared.

    python -m benchmarks.wing

A cantilever of 0.55 m, clamped level, bare and with its skin; the displacement of the tip against the unloaded wing (Avin,
Raveh, Drachinsky, Ben-Shmuel, Tur, AIAA Journal 60, 2022; public files of the Large Deflection Working Group, AePW3). A pose
is one weight: one coordinate of one point. The height of the unloaded tip is an unknown offset of all of them.
"""

import csv
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from benchmarks.record import record
from scan2flex_jax.cli.setup import prepare_jax
from scan2flex_jax.inference import fit
from scan2flex_jax.study import Clamp, EffectDeclaration, Markers, Study, StudyPose, Unknown

DATA, PICTURE = Path(__file__).parent / "data", Path(__file__).parents[1] / "docs" / "real" / "wing.png"
LENGTH, ROD = 0.55, 0.026  # m; kg, the rod at the tip, on which weights hang
SERIES = {"bare": (0.347, 4.46), "with skin": (0.357, 4.55)}  # kg, rod included; EI of the published equivalent beam, N m^2
GJ, NOISE = 7.5, 2e-3  # N m^2 (without influence on plane poses); m, the resolution
LIGHT = 0.6  # kg
LEVEL = Clamp(np.zeros(3), np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0]))  # d3 along x, z up


def weights(series):
    """Weights (kg) and displacements of the tip (m)."""
    with (DATA / f"wing-bending-{series.split()[-1]}.csv").open() as file:
        return [(float(row["tip_mass_kg"]), float(row["tip_displacement_m"])) for row in csv.DictReader(file)]


def wing(series, heavy):
    """The study of a series; the ``heavy`` poses are "validate", or "undeclared": fitted with unknown weights."""
    poses, unknowns = [], [Unknown("bending_stiffness"), Unknown("scan_offset.offset", prior={"mean": 0.0, "std": 0.05})]
    effects = [EffectDeclaration("scan_offset", {}), EffectDeclaration("point_mass", {"position": LENGTH, "mass": ROD})]
    for mass, displacement in weights(series):
        name, known = f"{mass:.1f} kg", mass <= LIGHT or heavy == "validate"
        role = "fit" if mass <= LIGHT or heavy == "undeclared" else "validate"
        point = Markers(np.array([[np.nan, np.nan, displacement]]), np.array([LENGTH]))
        poses.append(StudyPose(name, role, LEVEL, None, markers=point, noise=NOISE))
        if mass:
            values = {"position": LENGTH} | ({"mass": mass} if known else {})
            effects.append(EffectDeclaration("point_mass", values, poses=(name,)))
            if not known:
                unknowns.append(Unknown(f"point_mass[{len(effects) - 1}].mass"))
    cable = {"length": LENGTH, "length_density": (SERIES[series][0] - ROD) / LENGTH, "torsional_stiffness": GJ}
    return Study.from_arrays(cable, poses, unknowns, effects=effects, title=f"wing, {series}")


def one_series(series):
    """The figures of a series."""
    loaded = fit(wing(series, "validate"))
    EI = loaded.estimates["bending_stiffness"]
    heavy_rms = np.sqrt(np.mean([p.rms**2 for p in loaded.poses.values() if p.role == "validate"]))
    offset = loaded.estimates["scan_offset.offset"].value[2]
    predicted = {name: p.modelled[-1, 2] + offset for name, p in loaded.poses.items()}
    hung = [mass for mass, _ in weights(series) if mass > LIGHT]
    weighed = fit(wing(series, "undeclared")).estimates
    found = [e for name, e in weighed.items() if name.endswith(".mass")]
    return {
        "series": series,
        "EI": [EI.value, EI.low, EI.high],
        "EI_published": SERIES[series][1],
        "rms_heavy_mm": 1e3 * float(heavy_rms),
        "believed": loaded.valid,
        "predicted": {name: float(z) for name, z in predicted.items()},
        "weights": [{"hung": m, "found": e.value, "low": e.low, "high": e.high} for m, e in zip(hung, found, strict=True)],
    }


def picture(rows):
    """Displacements and predictions, and the weights estimated beside the weights hung."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 3.6), layout="constrained")
    for colour, row in zip(("C0", "C1"), rows, strict=True):
        mass, z = np.array(weights(row["series"])).T
        left.plot(mass, 1e3 * z, "o", color=colour, ms=4, label=f"{row['series']}, measured")
        predicted = [1e3 * row["predicted"][f"{m:.1f} kg"] for m in mass]
        left.plot(mass, predicted, color=colour, lw=1, label="from the light weights")
        hung, found, low, high = np.array([list(w.values()) for w in row["weights"]]).T
        bars = [found - low, high - found]
        right.errorbar(hung, found - hung, bars, fmt="o", color=colour, ms=4, capsize=2, label=row["series"])
    left.axvspan(-0.05, LIGHT + 0.1, color="0.9", zorder=0)
    left.text(LIGHT / 2, 1e3 * rows[-1]["predicted"]["3.0 kg"], "fitted", ha="center", fontsize=9)
    left.set(xlabel="weight at the tip (kg)", ylabel="displacement of the tip (mm)")
    right.axhline(0.0, color="k", lw=0.8)
    right.set(xlabel="weight hung (kg)", ylabel="weight found less weight hung (kg)")
    left.legend(fontsize=8)
    right.legend(fontsize=8)
    figure.savefig(PICTURE, dpi=110)


def main():
    prepare_jax()
    rows = [one_series(series) for series in SERIES]
    picture(rows)
    record("wing", {"light_kg": LIGHT, "noise_mm": 1e3 * NOISE, "rows": rows})


if __name__ == "__main__":
    main()
