"""The commands of ``scan2flex``."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from scan2flex_jax.cli.setup import ERRORS, prepare_jax, progress
from scan2flex_jax.errors import Scan2FlexError

BAD_INPUT, NOT_TO_BELIEVE = 2, 3

app = typer.Typer(
    help="Find the stiffness of a cable from its measured shapes.", no_args_is_help=True, pretty_exceptions_enable=False
)
StudyFolder = Annotated[Path, typer.Argument(help="Folder of a study, with its study.toml.")]
JsonFile = Annotated[Path | None, typer.Option("--json", help="Write the result here, as JSON.")]
Elements = Annotated[int, typer.Option(min=8, max=5000, help="Elements of the rod.")]


@app.command()
def fit(
    study: StudyFolder,
    method: Annotated[str, typer.Option(help="least-squares, bfgs or nelder-mead.")] = "least-squares",
    data: Annotated[str, typer.Option(help="curve, cloud (the points of the scans), or auto: curves where given.")] = "auto",
    distance: Annotated[str, typer.Option(help="normal, integrated (the paper's Eq. 10), or hausdorff.")] = "normal",
    json: JsonFile = None,
    save: Annotated[Path | None, typer.Option(help="Save the study with its estimates to this folder.")] = None,
    figure: Annotated[Path | None, typer.Option(help="Draw measured and modelled shapes to this PNG or SVG.")] = None,
    elements: Elements = 40,
) -> None:
    """Estimate the unknowns of a study from its shapes. Example: scan2flex fit my-cable --json result.json"""
    from scan2flex_jax.study import load_study, save_study, write_json_atomic  # noqa: PLC0415

    loaded = load_study(study)
    prepare_jax()
    from scan2flex_jax.fit import fit as run  # noqa: PLC0415

    with progress(f"fitting {loaded.title}") as tell:
        result = run(loaded, method, data=data, distance=distance, elements=elements, progress=tell)
    typer.echo(result.summary())
    if json:
        write_json_atomic(json, result.to_json())
    if save:
        save_study(result.calibrated, save)
    if figure:
        _draw(result, figure)
    if not all(pose.stable for pose in result.poses.values()):
        raise typer.Exit(NOT_TO_BELIEVE)


@app.command()
def check(study: StudyFolder) -> None:
    """Read a study; say what it holds and what is wrong with it. Example: scan2flex check my-cable"""
    from scan2flex_jax.study import describe, load_study  # noqa: PLC0415

    typer.echo(describe(load_study(study)))


@app.command()
def simulate(
    study: StudyFolder,
    out: Annotated[Path, typer.Option(help="Folder for the CSV files.")] = Path("simulated"),
    json: JsonFile = None,
    elements: Elements = 40,
) -> None:
    """Predict shapes, section forces and moments, and clamp reactions of all poses, as CSV.

    Every parameter must have a value: under [cable], or as a guess. Example: scan2flex simulate my-cable --out predicted
    """
    from scan2flex_jax.study import load_study, write_json_atomic  # noqa: PLC0415

    loaded = load_study(study)
    prepare_jax()
    from scan2flex_jax.predict import predict, write_csv  # noqa: PLC0415

    with progress(f"simulating {loaded.title}"):
        predictions = predict(loaded, elements=elements)
        write_csv(predictions, out)
    for name, p in predictions.items():
        typer.echo(f"{name}: {p.verdict.sentence()}, {int(p.verdict.steps)} steps -> {out / name}.csv")
    if json:
        write_json_atomic(json, {n: p.to_json() for n, p in predictions.items()})
    if not all(bool(p.verdict.solved) for p in predictions.values()):
        raise typer.Exit(NOT_TO_BELIEVE)


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Folder for the pictures and results.")] = Path("scan2flex-demo"),
) -> None:
    """Fit two studies that come with the package, and find what the rod lacks for the real wire."""
    from scan2flex_jax.examples import example_path  # noqa: PLC0415
    from scan2flex_jax.study import load_study, write_json_atomic  # noqa: PLC0415

    prepare_jax()
    from scan2flex_jax.fit import fit as run  # noqa: PLC0415

    out.mkdir(parents=True, exist_ok=True)
    for name in ("simulated-cable", "black-wire"):
        loaded = load_study(example_path(name))
        with progress(f"fitting {name}") as tell:
            result = run(loaded, progress=tell)
        typer.echo(result.summary())
        _draw(result, out / f"{name}.png")
        write_json_atomic(out / f"{name}.json", result.to_json())
        typer.echo(f"\n  picture: {out / name}.png   result: {out / name}.json\n")
    result = _explained(loaded, 40)
    if result.fit is not None:
        _draw_explanation(result, out)
        typer.echo(f"\n  pictures: {out / 'explanation.png'}, {out / 'shapes.png'}")
    write_json_atomic(out / "explanation.json", result.to_json())


@app.command()
def extract(
    study: StudyFolder,
    save: Annotated[Path | None, typer.Option(help="Folder for the study with its curves; default: the study itself.")] = None,
    figures: Annotated[Path | None, typer.Option(help="Folder for a picture per pose.")] = None,
) -> None:
    """Find the centre curves of scanned poses and write them into the study. Example: scan2flex extract my-cable"""
    from scan2flex_jax.study import load_study, save_study  # noqa: PLC0415

    loaded = load_study(study)
    prepare_jax()
    found, curves = _extracted(loaded)
    save_study(found, save or loaded.folder)
    for name, curve in curves.items():
        typer.echo(f"{name}: {curve.arc_length[-1]:.4f} m of centre curve" + "".join(f"; {w}" for w in curve.warnings))
        if figures:
            _agg()
            from scan2flex_jax.scan import save_picture  # noqa: PLC0415

            figures.mkdir(parents=True, exist_ok=True)
            save_picture(curve, figures / f"{name}.png", name)


@app.command()
def explain(
    study: StudyFolder,
    json: JsonFile = None,
    figures: Annotated[Path | None, typer.Option(help="Folder for pictures of the evidence, residuals and shapes.")] = None,
    save: Annotated[Path | None, typer.Option(help="Save the study with the effect declared to this folder.")] = None,
    elements: Elements = 40,
) -> None:
    """Find which physics the model lacks, with the error before and after.

    Example: scan2flex explain my-cable --json result.json --figures pictures
    """
    from scan2flex_jax.study import load_study, save_study, write_json_atomic  # noqa: PLC0415

    loaded = load_study(study)
    prepare_jax()
    result = _explained(loaded, elements)
    if json:
        write_json_atomic(json, result.to_json())
    if figures and result.fit is not None:
        _draw_explanation(result, figures)
    if save:
        save_study(result.study, save)
    if result.fit is None:
        raise typer.Exit(NOT_TO_BELIEVE)


@app.command()
def plan(study: StudyFolder, json: JsonFile = None, elements: Elements = 40) -> None:
    """Rank poses that could be scanned next by what they would settle. Example: scan2flex plan my-cable

    The clamps of the first poses are varied: twisted, rolled, nearer, aside. Poses of your own: `scan2flex_jax.plan` in Python.
    """
    from scan2flex_jax.study import load_study, write_json_atomic  # noqa: PLC0415

    loaded = load_study(study)
    prepare_jax()
    from scan2flex_jax.explain import plan as rank  # noqa: PLC0415

    result = _explained(loaded, elements)
    with progress("solving poses that could be scanned"):
        ranked = rank(result)
    typer.echo("\n" + ranked.summary())
    if json:
        write_json_atomic(json, ranked.to_json())


def _explained(loaded, elements):
    from scan2flex_jax.explain import explain as run  # noqa: PLC0415

    loaded = _with_curves(loaded)
    with progress(f"explaining {loaded.title}") as tell:
        result = run(loaded, elements=elements, progress=tell)
    typer.echo(result.summary())
    return result


def _draw_explanation(result, folder: Path) -> None:
    _agg()
    from scan2flex_jax import plot  # noqa: PLC0415

    plot.save(plot.explained(result), folder / "explanation.png")
    plot.save(plot.overview(result), folder / "shapes.png")


def _with_curves(study):
    """The study itself, or with the centre curves of its scans where poses have none."""
    return study if all(pose.curve is not None for pose in study.poses) else _extracted(study)[0]


def _extracted(study):
    from scan2flex_jax.scan import extract_study  # noqa: PLC0415

    with progress("extracting centre curves") as tell:
        return extract_study(study, progress=lambda name, i, n: tell(f"{name} ({i} of {n})"))


def _agg() -> None:
    import matplotlib as mpl  # noqa: PLC0415

    mpl.use("Agg")


def _draw(result, file: Path) -> None:
    _agg()
    from scan2flex_jax import plot  # noqa: PLC0415

    plot.save(plot.overview(result), file)


def main() -> None:
    """Entry point: faults in the input are one sentence and exit code 2."""
    try:
        app()
    except Scan2FlexError as error:
        ERRORS.print(f"scan2flex: {error}", markup=False, soft_wrap=True)
        sys.exit(BAD_INPUT)
    except OSError as error:
        ERRORS.print(f"scan2flex: {error.filename}: {error.strerror}", markup=False, soft_wrap=True)
        sys.exit(BAD_INPUT)
