"""A wing with known weights at its tip: EI from the light ones, prediction of the heavy ones, and the heavy ones undeclared;
GJ from light weights behind its trailing edge, and the twist under the heavy ones.

    python -m benchmarks.wing

A cantilever of 0.55 m, clamped level, bare and with its skin; the displacement of the tip against the unloaded wing (Avin,
Raveh, Drachinsky, Ben-Shmuel, Tur, AIAA Journal 60, 2022; public files of the Large Deflection Working Group, AePW3). A pose
is one weight: one coordinate of one point. The height of the unloaded tip is an unknown offset of all of them. In torsion a
pose has two readings, displacement and twist of the tip, both changes from the unloaded wing, beside the light bending poses.
"""

import csv
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from benchmarks.record import record
from scan2flex_jax.cli.setup import prepare_jax
from scan2flex_jax.inference import fit
from scan2flex_jax.study import Angle, Clamp, EffectDeclaration, Markers, Study, StudyPose, Unknown

DATA, PICTURE = Path(__file__).parent / "data", Path(__file__).parents[1] / "docs" / "real" / "wing.png"
LENGTH, ROD = 0.55, 0.026  # m; kg, the rod at the tip, on which weights hang
SERIES = {"bare": (0.347, 4.46), "with skin": (0.357, 4.55)}  # kg, rod included; EI of the published equivalent beam, N m^2
GJ, NOISE = 7.5, 2e-3  # N m^2 (without influence on plane poses); m, the resolution
LIGHT = 0.6  # kg
LEVEL = Clamp(np.zeros(3), np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0]))  # d3 along x, z up

# in torsion: metres from the axis of the beam, at 44 % of the chord, to the weights; GJ of the published beam, N m^2
ARMS, GJ_PUBLISHED = {"bare": 0.096, "with skin": 0.136}, {"bare": 7.5, "with skin": 7.6}
IN_PLANE, TWIST_NOISE, G = 3290.0, np.radians(0.2), 9.81  # N m^2, published; rad: read in steps of 0.6 degrees; m/s^2


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


def twists(series):
    """Weights (kg) behind the trailing edge, displacements (m) and twists (rad) of the tip."""
    with (DATA / f"wing-torsion-{series.split()[-1]}.csv").open() as file:
        rows = [[float(x) for x in row.values()] for row in csv.DictReader(file)]
    return [(mass, z, np.radians(degrees)) for mass, z, degrees in rows if mass]


def torsion(series):
    """The study of EI and GJ from light weights on the axis and beside it; heavier ones beside it are "validate"."""
    poses, effects = [StudyPose("unloaded", "fit", LEVEL)], []
    for mass, z in weights(series):
        if 0 < mass <= LIGHT:
            marks = Markers(np.array([[np.nan, np.nan, z]]), np.array([LENGTH]))
            poses.append(StudyPose(f"{mass:.1f} kg", "fit", LEVEL, markers=marks, noise=NOISE, change_from="unloaded"))
            effects.append(EffectDeclaration("point_mass", {"position": LENGTH, "mass": mass}, (poses[-1].name,)))
    for mass, z, twist in twists(series):
        name, role = f"{mass:.1f} kg beside", "fit" if mass <= LIGHT else "validate"
        marks = Markers(np.array([[np.nan, np.nan, z]]), np.array([LENGTH]))
        angle = Angle(LENGTH, twist, TWIST_NOISE, about=np.array([-1.0, 0.0, 0.0]), of="d2")
        given = {"markers": marks, "angle": (angle,), "change_from": "unloaded", "noise": NOISE}
        poses.append(StudyPose(name, role, LEVEL, **given))
        hung = {"position": LENGTH, "mass": mass, "offset": np.array([0.0, ARMS[series], 0.0])}
        effects.append(EffectDeclaration("point_mass", hung, (name,)))
    effects.append(EffectDeclaration("point_mass", {"position": LENGTH, "mass": ROD}))
    ratio = IN_PLANE / SERIES[series][1]
    effects.append(EffectDeclaration("anisotropic_bending", {"ratio": ratio, "angle": 0.5 * np.pi}))  # EI is that about d2
    cable = {"length": LENGTH, "length_density": (SERIES[series][0] - ROD) / LENGTH}
    unknowns = [Unknown("bending_stiffness"), Unknown("torsional_stiffness")]
    return Study.from_arrays(cable, poses, unknowns, effects=effects, title=f"wing, {series}, bending and torsion")


def in_torsion(series):
    """The figures of a series in torsion."""
    found = fit(torsion(series))
    EI, GJ = (found.estimates[name] for name in ("bending_stiffness", "torsional_stiffness"))
    read = {name: p.readings[0] for name, p in found.poses.items() if p.readings}
    heavy = [name for name in read if found.poses[name].role == "validate"]
    off = np.degrees([read[name].modelled[0] - read[name].measured[0] for name in heavy])
    light = [m * G * ARMS[series] * LENGTH / twist for m, _, twist in twists(series) if m <= LIGHT]
    return {
        "series": series,
        "EI": [EI.value, EI.low, EI.high],
        "GJ": [GJ.value, GJ.low, GJ.high],
        "GJ_published": GJ_PUBLISHED[series],
        "GJ_first_order": light,
        "believed": found.valid,
        "judgement": found.judgement,
        "rms_heavy_deg": float(np.sqrt(np.mean(off**2))),
        "rms_heavy_mm": 1e3 * float(np.sqrt(np.mean([found.poses[name].rms ** 2 for name in heavy]))),
        "twists": {name: np.degrees([one.measured[0], one.modelled[0]]).tolist() for name, one in read.items()},
    }


def torsion_picture(rows):
    """Twists measured and predicted, from the light weights."""
    figure, ax = plt.subplots(figsize=(5.2, 3.6), layout="constrained")
    for colour, row in zip(("C0", "C1"), rows, strict=True):
        mass = [float(name.split()[0]) for name in row["twists"]]
        measured, modelled = np.array(list(row["twists"].values())).T
        ax.plot(mass, measured, "o", color=colour, ms=4, label=f"{row['series']}, measured")
        ax.plot(mass, modelled, color=colour, lw=1, label="from the light weights")
        linear = np.degrees(np.array(mass) * G * ARMS[row["series"]] * LENGTH / row["GJ"][0])
        ax.plot(mass, linear, ":", color=colour, lw=1, label="to first order")
    ax.axvspan(0.0, LIGHT + 0.1, color="0.9", zorder=0)
    ax.set(xlabel="weight behind the trailing edge (kg)", ylabel="twist of the tip (degrees)", ylim=(0, 14))
    ax.legend(fontsize=8)
    figure.savefig(PICTURE.with_name("wing-torsion.png"), dpi=110)


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
    twisted()


def twisted():
    """The part in torsion, by itself."""
    rows = [in_torsion(series) for series in SERIES]
    torsion_picture(rows)
    figures = {"light_kg": LIGHT, "noise_mm": 1e3 * NOISE, "noise_deg": float(np.degrees(TWIST_NOISE))}
    record("wing_torsion", {**figures, "rows": rows})


if __name__ == "__main__":
    main()
