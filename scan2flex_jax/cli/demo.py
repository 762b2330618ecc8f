"""The command demo: a find whose truth is known, and a real wire."""

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from scan2flex_jax.cli.options import Force, Quiet, draw_explanation, drawing, explanation_pictures, folder_to_write
from scan2flex_jax.cli.setup import prepare_jax, progress
from scan2flex_jax.cli.terminal import say

_FIND, _WIRE = "hidden-sleeve", "black-wire"
_RIVALS = 3  # that are shown


def demo(
    out: Annotated[Path, typer.Option(help="Folder for the pictures and results.", callback=folder_to_write)] = Path(
        "scan2flex-demo"
    ),
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Find what the study of a simulated cable does not mention, compare it with the truth, and fit a real wire.

    Example: scan2flex demo --out pictures
    """
    from scan2flex_jax.examples import example_path  # noqa: PLC0415
    from scan2flex_jax.study import load_study  # noqa: PLC0415
    from scan2flex_jax.study.outputs import Outputs  # noqa: PLC0415

    outputs = Outputs(force=force)
    wire_files = [out / f"{_WIRE}.{kind}" for kind in ("png", "json")]
    outputs.claim(*explanation_pictures(out), out / "explanation.json", *wire_files)
    prepare_jax()
    from scan2flex_jax.inference import explain  # noqa: PLC0415
    from scan2flex_jax.inference.fitting import fitted  # noqa: PLC0415
    from scan2flex_jax.inference.program import slots_of  # noqa: PLC0415

    cable, wire = (load_study(example_path(name)) for name in (_FIND, _WIRE))
    truth = tomllib.loads((example_path(_FIND) / "truth.toml").read_text("utf-8"))
    with progress(f"explaining {cable.title}", quiet) as tell:
        found = explain(cable, progress=tell)
    say("\n".join([f"{cable.title}: {found.verdict}", *(f"  {line}" for line in _find(found, truth))]))
    draw_explanation(found, out, outputs.write)
    outputs.write_json(out / "explanation.json", found.to_json())
    say(f"  pictures    {', '.join(map(str, explanation_pictures(out)))}\n")
    with progress(f"fitting {wire.title}", quiet) as tell:
        fit = fitted(wire, progress=tell, slots=slots_of(wire))  # by the functions that the search has compiled
    say(f"{wire.title}:\n  {_in_a_line(fit)}")
    plot = drawing()
    plot.save(plot.overview(fit), wire_files[0], write=outputs.write)
    outputs.write_json(wire_files[1], fit.to_json())
    say(f"  picture     {wire_files[0]}")


def _find(e, truth) -> Iterator[str]:
    """What was found, from what it was told apart, and the truth."""
    from scan2flex_jax.inference.answer import in_mm  # noqa: PLC0415
    from scan2flex_jax.inference.explanation import parameter_in_words  # noqa: PLC0415
    from scan2flex_jax.inference.fit_result import in_words  # noqa: PLC0415

    for role, which in (("fit", "fitted poses"), ("validate", "poses that were never fitted")):
        count = sum(p.role == role for p in e.poses.values())
        yield f"error       {in_mm(e.rms(role, after=False))} -> {in_mm(e.rms(role))} mm in {count} {which}"
    for r in e.chosen:
        true = truth["effect"] if r.kind == truth["effect"]["kind"] else {}
        yield f"found       {_spaced(r.kind)}"
        for name, value in r.parameters.items():
            beside = f"   (truth: {parameter_in_words(e.study, r.kind, name, true[name])})" if name in true else ""
            yield f"  {name:<20}{parameter_in_words(e.study, r.kind, name, value, r.std.get(name))}{beside}"
    others = [r for r in e.ranking if r.kind not in {c.kind for c in e.chosen}]
    rivals = [f"{_spaced(r.kind)} by {e.ranking[0].log_evidence - r.log_evidence:.0f} nats" for r in others[:_RIVALS]]
    yield f"told from   {', '.join(rivals)} of log evidence, and {len(others) - len(rivals)} more effects"
    yield "values      without -> with what was found"
    for name, value in truth["cable"].items():
        after = in_words(e.estimates[name])
        yield f"  {_spaced(name):<20}{e.fit.estimates[name].value:.4g} -> {after}   (truth: {value:.4g})"


def _in_a_line(fit) -> str:
    """What can be said of a fit."""
    from scan2flex_jax.inference.answer import in_mm  # noqa: PLC0415

    off = " and ".join(f"{in_mm(p.rms)} mm in {name} ({p.role})" for name, p in fit.poses.items())
    worth = "worth believing" if fit.believable else "not to be believed: its model lacks what `scan2flex explain` looks for"
    return f"EI {fit.estimates['bending_stiffness'].value:.3g} N m^2 leaves {off}, which is {worth}"


def _spaced(name):
    return name.replace("_", " ")
