"""The command demo: a find whose truth is known, and a real rod beside its calipers."""

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from scan2flex_jax.cli.options import Force, Quiet, draw_explanation, drawing, explanation_pictures, folder_to_write
from scan2flex_jax.cli.setup import prepare_jax, progress
from scan2flex_jax.cli.terminal import say

_FIND, _ROD = "hidden-sleeve", "bamboo-rod"
_RIVALS = 3  # that are shown
OWNERS_MODULUS = 7.32e6 * 6894.757  # Pa: the owner's fit of another model, with the calipers known
PLACES = (0.3, 0.6, 0.9, 1.2, 1.5, 1.7)  # m along the rod


def demo(
    out: Annotated[Path, typer.Option(help="Folder for the pictures and results.", callback=folder_to_write)] = Path(
        "scan2flex-demo"
    ),
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Find what the study of a simulated cable does not mention, compare it with the truth, and the stiffness along a real rod
    from how it droops, beside calipers.

    Example: scan2flex demo --out pictures
    """
    from scan2flex_jax.examples import example_path  # noqa: PLC0415
    from scan2flex_jax.study import load_study  # noqa: PLC0415
    from scan2flex_jax.study.outputs import Outputs  # noqa: PLC0415

    outputs = Outputs(force=force)
    rod_files = [out / f"{_ROD}.{kind}" for kind in ("png", "json")]
    outputs.claim(*explanation_pictures(out), out / "explanation.json", *rod_files)
    prepare_jax()
    from scan2flex_jax.inference import explain  # noqa: PLC0415

    cable, rod = (load_study(example_path(name)) for name in (_FIND, _ROD))
    truth = tomllib.loads((example_path(_FIND) / "truth.toml").read_text("utf-8"))
    with progress(f"explaining {cable.title}", quiet) as tell:
        found = explain(cable, progress=tell)
    say("\n".join([f"{cable.title}: {found.verdict}", *(f"  {line}" for line in _find(found, truth))]))
    draw_explanation(found, out, outputs.write)
    outputs.write_json(out / "explanation.json", found.to_json())
    say(f"  pictures    {', '.join(map(str, explanation_pictures(out)))}\n")
    with progress(f"explaining {rod.title}", quiet) as tell:
        found = explain(rod, progress=tell)
    s, EI = calipers(example_path(_ROD))
    say("\n".join([f"{rod.title}: {found.verdict}", *(f"  {line}" for line in _rod(found, s, EI))]))
    plot = drawing()
    plot.save(plot.varied(found, {"calipers": (s[s >= 0], EI[s >= 0])}), rod_files[0], write=outputs.write)
    outputs.write_json(rod_files[1], found.to_json())
    say(f"  picture     {rod_files[0]}")


def calipers(folder: Path):
    """Arc lengths (k,) in m and EI (k,) in N m^2 of the rod by calipers: a hexagon of its width across flats, of the owner's
    modulus."""
    import numpy as np  # noqa: PLC0415

    s, across = np.loadtxt(folder / "calipers.csv", delimiter=",", skiprows=1).T
    return s, OWNERS_MODULUS * 5.0 * np.sqrt(3.0) / 144.0 * across**4


def _errors(e) -> Iterator[str]:
    """The error before and after, in fitted poses and in others."""
    from scan2flex_jax.results.answer import in_mm  # noqa: PLC0415

    for role, which in (("fit", "fitted poses"), ("validate", "poses that were never fitted")):
        count = sum(p.role == role for p in e.poses.values())
        yield f"error       {in_mm(e.rms(role, after=False))} -> {in_mm(e.rms(role))} mm in {count} {which}"


def _rod(e, s, EI) -> Iterator[str]:
    """What was found along the rod, beside the calipers that the study does not hold."""
    import numpy as np  # noqa: PLC0415

    from scan2flex_jax.results.words import found_in_words  # noqa: PLC0415

    yield from _errors(e)
    yield f"found       {found_in_words(e)}"
    if e.along is not None:
        yield "stiffness   EI from the droop, N m^2          by calipers"
        for at in PLACES:
            value, low, high = e.along.at(at)
            caliper = np.exp(np.interp(at, s, np.log(EI)))
            yield f"  at {at:.1f} m    {value:6.3g}  ({low:.2g} to {high:.2g})".ljust(46) + f"{caliper:.3g}"


def _find(e, truth) -> Iterator[str]:
    """The effect found, its rivals, and the truth."""
    from scan2flex_jax.results.explanation import parameter_in_words  # noqa: PLC0415
    from scan2flex_jax.results.fit_result import in_words  # noqa: PLC0415

    yield from _errors(e)
    for r in e.chosen:
        true = truth["effect"] if r.kind == truth["effect"]["kind"] else {}
        yield f"found       {_spaced(r.kind)}"
        for name, value in r.parameters.items():
            beside = f"   (truth: {parameter_in_words(e.study, r.kind, name, true[name])})" if name in true else ""
            yield f"  {name:<20}{parameter_in_words(e.study, r.kind, name, value, r.std.get(name))}{beside}"
    others = [r for r in e.ranking if r.kind not in {c.kind for c in e.chosen}]
    rivals = [f"{_spaced(r.kind)} by {e.ranking[0].log_evidence - r.log_evidence:.0f} nats" for r in others[:_RIVALS]]
    yield f"less likely {', '.join(rivals)} of log evidence, and {len(others) - len(rivals)} more effects"
    yield "values      without -> with what was found"
    for name, value in truth["cable"].items():
        after = in_words(e.estimates[name])
        yield f"  {_spaced(name):<20}{e.fit.estimates[name].value:.4g} -> {after}   (truth: {value:.4g})"


def _spaced(name):
    return name.replace("_", " ")
