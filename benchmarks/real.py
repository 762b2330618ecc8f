"""The loop on the real measurements of the package: residual of the baseline model, the effects named or not, and why.

    python -m benchmarks.real

Writes `results/real.json`, and to `docs/real` a page with its picture for each study. The text of a page is that of
`explain`; an independent measurement (the twist at which a loop buckles) is compared with the prediction of the calibrated
model. Sources and licences: `scan2flex_jax/examples/README.md`.
"""

from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

from benchmarks.record import record
from benchmarks.tables import markdown
from scan2flex_jax import Boundary, Cable, CableModel, EffectDeclaration, Unknown, equilibrium, explain, fit, load_study, plot
from scan2flex_jax.cli.setup import prepare_jax
from scan2flex_jax.examples import example_path
from scan2flex_jax.statics.starts import curve_start
from scan2flex_jax.study import Tolerance

# What a photograph with hand-made clamps leaves open: length and scale by some per cent, clamps by some degrees.
LOOSE = {"length": 0.02, "clamp_position": 0.003, "clamp_rotation": 0.09, "gravity": 0.02}
BUCKLED = {"black-wire": [470, 500, 480, 470, 490], "red-wire": [430, 470, 445, 445, 460]}  # degrees, five repeats each
GRID, SHOWN = np.geomspace(0.5, 40.0, 12), (0.5, 1.0, 2.0, 5.0, 10.0, 20.0)  # 1/m: of the law of the strip, and in its table
PAGES = Path(__file__).parents[1] / "docs" / "real"
AS_DECLARED = "as declared"  # the variant that the picture shows
RATIOS = (0.5, 0.77, 1.0, 1.5)  # of GJ to EI; 0.77 is that of a solid round wire of Poisson's ratio 0.3
MOST_TWIST = 1800  # degrees
_JUMP = 0.03  # of the length: by which a node moves in 10 degrees only when the loop jumps
ABOUT = {
    "textile-strip": "Two photographs of a strip of fabric, a cantilever under its own weight.",
    "black-wire": "Two photographs of a stranded wire hanging as a loop from two facing clamps, the end turned by 0 and by 360 "
    "degrees.",
    "red-wire": "One photograph of a second wire hanging as a loop from two facing clamps.",
}


def variants(name, study):
    """The study as measured, and with declarations that a user might add."""
    every = replace(study, poses=tuple(replace(p, role="fit") for p in study.poses))
    yield AS_DECLARED, study
    if len(study.poses) > 1:
        yield "all poses fitted", every
        for pose in every.poses:
            yield f"{pose.name} by itself", replace(study, poses=(pose,))
    if name != "textile-strip":
        yield "all poses fitted, tolerances declared", replace(every, tolerance=Tolerance(**LOOSE))


def figures(e) -> dict:
    """The figures of an explanation that its page has."""
    out = {"verdict": e.verdict, "sentences": list(e.sentences), "settle": list(e.settle)}
    if e.fit is None:
        return out
    keys = "kind", "log_evidence", "rms_fit", "rms_validate"
    ranking = [{key: getattr(r, key) for key in keys} | {"verdict": e.in_words(r)} for r in e.ranking[:6]]
    before = {n: np.asarray(x.value).tolist() for n, x in e.fit.estimates.items()}
    after = {n: {"value": np.asarray(x.value).tolist(), "identifiable": x.identifiable} for n, x in e.estimates.items()}
    poses = {n: p.to_json() for n, p in e.poses.items()}
    return out | {"ranking": ranking, "before": before, "after": after, "poses": poses, "noise": e.noise.total}


def measured_laws(study, picture: Path) -> dict:
    """The bending law of each photograph by itself: moments (N m) with their 95 % bands, and a picture of all."""
    figure, axes = plt.subplots(1, len(study.poses), figsize=(4.6 * len(study.poses), 3.6), layout="constrained", sharey=True)
    law, out = EffectDeclaration("bending_law", {"curvature": GRID}), {}
    unknowns = (*study.unknowns, Unknown("bending_law.factor"))
    for pose, ax in zip(study.poses, axes, strict=True):
        alone = (replace(pose, role="fit"),)
        result = fit(replace(study, poses=alone, effects=(*study.effects, law), unknowns=unknowns))
        (one,), rms = result.laws, result.poses[pose.name].rms
        at = [int(np.argmin(np.abs(one.at - k))) for k in SHOWN]
        out[pose.name] = {
            "rms": rms, "converged": result.converged, "sentences": list(one.sentences()),
            "moments": [[float(x[i]) for x in (one.at, one.moment, one.low, one.high)] for i in at],
            "reached": [bool(one.reached[i]) for i in at],
        }  # fmt: skip
        plot.law(result, ax=ax)
        ax.set_title(f"{pose.name}: {1e3 * rms:.2f} mm RMS", fontsize=10, pad=34)
    plot.save(figure, picture)
    plt.close(figure)
    return out


def buckling(study, bending_stiffness: float, ratio: float) -> float | None:
    """Twist (degrees) of the end clamp at which the loop jumps to another shape; None up to `MOST_TWIST`."""
    pose, given = study.poses[0], study.cable
    cable = Cable(given["length"], given["length_density"], bending_stiffness, ratio * bending_stiffness)
    model = CableModel(cable, jnp.asarray(study.gravity))
    start = (pose.start.position, pose.start.quaternion)
    held = Boundary.of(start, (pose.end.position, pose.end.quaternion))
    c, before = curve_start(jnp.asarray(pose.curve.points), held, 0, 40), None
    for degrees in range(0, MOST_TWIST + 1, 10):
        angle = np.deg2rad(degrees)
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
        turned = Boundary.of(start, (pose.end.position, held.rotation[1] @ turn))
        e = equilibrium(model, turned, start=c)
        points = np.asarray(e.points)
        moved = 0.0 if before is None else np.linalg.norm(points - before, axis=1).max()
        if not bool(e.verdict.solved) or moved > _JUMP * given["length"]:
            return float(degrees)
        c, before = e.configuration, points
    return None


def page(name, entry) -> str:
    """Markdown."""
    lines = [f"# {name}", "", f"{ABOUT[name]} Made by `python -m benchmarks.real`.", ""]
    for words, r in entry["variants"].items():
        lines += [f"## {words[0].upper()}{words[1:]}", ""]
        lines += [f"![{name}, {words}]({name}.png)", ""] if words == AS_DECLARED else []
        lines += [f"Verdict: **{r['verdict']}**.", "", *(f"- {s}" for s in r["sentences"])]
        lines += _figures(r) if "ranking" in r else []
    lines += _laws(name, entry["laws"]) if "laws" in entry else []
    if "buckling" in entry:
        b = entry["buckling"]
        said = ", ".join(f"{k}: {f'none up to {MOST_TWIST}' if v is None else f'{v:.0f}'}" for k, v in b["predicted"].items())
        lines += ["## The twist at which the loop buckles", ""]
        lines += [f"Measured five times: {', '.join(map(str, b['measured']))} degrees. Predicted with EI = "
                  f"{b['bending_stiffness']:.3g} N m^2 (straight wire, baseline fit) by the ratio GJ/EI, which plane shapes "
                  f"do not determine: {said} degrees.", ""]  # fmt: skip
    return "\n".join(lines) + "\n"


def _figures(r) -> list[str]:
    """Errors of the poses, ranking, noise, estimates, and measurements that settle a tie."""
    poses = [[n, p["role"], *(_millimetres(p.get(k, np.inf)) for k in ("rms_before", "rms"))] for n, p in r["poses"].items()]
    ranking = [[k["kind"], f"{k['log_evidence']:.0f}", k["verdict"], *(_millimetres(k[x]) for x in ("rms_fit", "rms_validate"))]
               for k in r["ranking"]]  # fmt: skip
    lines = ["", markdown(("pose", "role", "baseline, mm", "after, mm"), poses)]
    head = ("kind", "log evidence, nats", "verdict", "error on fitted poses, mm", "on validate poses, mm")
    lines += [markdown(head, ranking), f"Noise given all signatures: {1e3 * r['noise']:.2f} mm per normal. Estimates:", ""]
    for n, x in r["after"].items():
        not_determined = "" if x["identifiable"] else " (not determined)"
        lines.append(f"- {n}: {r['before'][n]:.3g} before, {x['value']:.3g} after{not_determined}")
    return [*lines, *(f"- to settle it: {s}" for s in r["settle"]), ""]


def _laws(name, laws) -> list[str]:
    about = "A law of any form, fitted to each photograph by itself: moment over curvature, in mN m with its 95 % band."
    lines = ["## The measured bending law", "", about, "", f"![bending law of each photograph]({name}-law.png)", ""]
    rows = [[f"{k:.1f}", *(_moment(*law["moments"][i][1:], law["reached"][i]) for law in laws.values())]
            for i, k in enumerate(SHOWN)]  # fmt: skip
    lines.append(markdown(("curvature, 1/m", *laws), rows))
    for pose, law in laws.items():
        settled = "" if law["converged"] else ", not settled"
        lines.append(f"- {pose}: {1e3 * law['rms']:.2f} mm RMS are left{settled}; {'; '.join(law['sentences'])}")
    return [*lines, ""]


def _moment(value, low, high, reached):
    return f"{1e3 * value:.3g} ({1e3 * low:.3g} to {1e3 * high:.3g}){'' if reached else ', not reached'}"


def _millimetres(value):
    return "-" if value is None else f"{1e3 * value:.2f}" if np.isfinite(value) else "not solved"


def main() -> None:
    prepare_jax()
    mpl.use("Agg")
    results = {}
    for name in ABOUT:
        study, entry = load_study(example_path(name)), {"variants": {}}
        for words, variant in variants(name, study):
            e = explain(variant)
            entry["variants"][words] = figures(e)
            print(f"{name}, {words}: {e.verdict}, {e.seconds:.0f} s", flush=True)
            if e.fit is not None and words == AS_DECLARED:
                plot.save(plot.explained(e), PAGES / f"{name}.png")
        if name == "textile-strip":
            entry["laws"] = measured_laws(study, PAGES / f"{name}-law.png")
        if name in BUCKLED:
            EI = entry["variants"][AS_DECLARED]["before"]["bending_stiffness"]
            predicted = {str(r): buckling(study, EI, r) for r in RATIOS}
            entry["buckling"] = {"measured": BUCKLED[name], "bending_stiffness": EI, "predicted": predicted}
        results[name] = entry
        (PAGES / f"{name}.md").write_text(page(name, entry))
    record("real", results)


if __name__ == "__main__":
    main()
