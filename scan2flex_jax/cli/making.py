"""Commands that begin a study: new, from a folder of scans, centre curves or markers, and schema, for the editor."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

from scan2flex_jax.cli.frames import Columns, Convention, Radians, Tangent, Units, numbers
from scan2flex_jax.cli.measuring import scans_of
from scan2flex_jax.cli.options import Force, asked_or_refused, file_to_write, folder_to_write, interactive, one_of
from scan2flex_jax.cli.terminal import say
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.version import __version__

_TESTS = ("droop", "peirce", "three-point", "heart", "ring", "hanging")
_USUAL_NOISE = (
    "Usual noise of a coordinate, roughly: structured light and laser lines 0.05 to 0.5 mm, depth cameras 2 to 5 mm,\n"
    "motion capture 0.2 to 1 mm, traced photographs half a pixel (0.1 to 0.5 mm). Two scans of one still pose show it."
)


def new(
    given: Annotated[
        list[Path],
        typer.Argument(
            metavar="DIR",
            help="Folder of scans, centre curves or markers, one file a pose; or the files, in the order of the poses.",
        ),
    ],
    length: Annotated[str | None, typer.Option(help="Length between the clamps, as in 0.9, '900 mm' or '900 +- 1 mm'.")] = None,
    density: Annotated[str | None, typer.Option(help="Mass per length, as in 0.336, '36 kg/km' or '336 +- 2 g/m'.")] = None,
    mass: Annotated[str | None, typer.Option(help="Mass of that length, in place of --density, as in '302 +- 1 g'.")] = None,
    radius: Annotated[str | None, typer.Option(help="Radius of the cable, needed by scans, as in '4 mm'.")] = None,
    clamps: Annotated[
        Path | None, typer.Option(help="File of the clamps, by the names 'POSE start' and 'POSE end': see scan2flex pose.")
    ] = None,
    clamps_from_curves: Annotated[
        bool,
        typer.Option("--clamps-from-curves", help="Take the clamps from the ends of the curves, without twist, and fit them."),
    ] = False,
    ends: Annotated[
        str | None,
        typer.Option(
            help="With clamps from curves: their ends are held, or hang free; default: as the shapes tell.",
            **one_of("held", "free"),
        ),
    ] = None,
    noise: Annotated[str | None, typer.Option(help="Standard deviation of a coordinate of a point, as in '0.5 mm'.")] = None,
    units: Units = None,
    columns: Columns = None,
    markers: Annotated[
        bool, typer.Option("--markers", help="The points are markers, tracked at known arc lengths: columns s,x,y,z.")
    ] = False,
    arc_lengths: Annotated[
        Path | None, typer.Option(help="CSV with name,s: arc lengths of the markers of a motion capture, by name.")
    ] = None,
    frame: Annotated[int | None, typer.Option(help="Frame of motion captures, from 0; default: the mean of all.")] = None,
    convention: Convention = None,
    radians: Radians = False,
    tangent: Tangent = "z",
    gravity: Annotated[str | None, typer.Option(help="Gravity in the scan frame, m/s^2; default: 0,0,-9.81.")] = None,
    validate: Annotated[list[str] | None, typer.Option(help="Validate pose, which no fit uses; may be repeated.")] = None,
    title: Annotated[str | None, typer.Option(help="Title of the study.")] = None,
    test: Annotated[
        str | None,
        typer.Option(help="The argument is the table of this bending test: docs/test-benches.md.", **one_of(*_TESTS)),
    ] = None,
    span: Annotated[str | None, typer.Option(help="Of a three-point test, the distance of its supports.")] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the study; default: that of the files.", callback=folder_to_write)
    ] = None,
) -> None:
    """Make a study from a folder of scans, centre curves or markers, or from a bending test; prompts for missing values.

    Example: scan2flex new scans --units mm --length '900 mm' --mass '302 g' --clamps clamps.csv --convention kuka

    Example: scan2flex new tests.csv --test three-point --span '200 mm' --out rod
    """
    if test is not None:
        say(_of_test(given, test, length, density, mass, span, noise, validate, title, out))
        return
    from scan2flex_jax.convert import (  # noqa: PLC0415
        folder_of,
        frames_of_bodies,
        measured_files,
        new_study,
        read_arc_lengths,
        read_frames,
    )
    from scan2flex_jax.convert.start import GRAVITY  # noqa: PLC0415
    from scan2flex_jax.study import Tolerance, describe, load_study, save_study  # noqa: PLC0415

    if clamps_from_curves and clamps is not None:
        raise Scan2FlexError("--clamps and --clamps-from-curves were both given: leave one out.")
    if mass is not None and density is not None:
        raise Scan2FlexError("the mass and the density were both given: leave one of --mass and --density out.")
    free = None if ends is None else _free(ends)
    down = GRAVITY if gravity is None else numbers(gravity, 3, "gravity")
    source = given[0] if len(given) == 1 and not given[0].is_file() else given
    folder = folder_of(source)
    poses = measured_files(source, tuple(path for path in (clamps, arc_lengths) if path is not None))
    sorted_ = "sorted by name (where their order matters, as friction has it, list the files in place of the folder)"
    say(f"{len(poses)} poses, {'in the order given' if source is given else sorted_}: {', '.join(pose.name for pose in poses)}")
    long, of_length = _quantity(length, "length", "the length of the cable between its clamps", "--length")
    heavy, of_weight = _weight(density, mass, long, "--density (or --mass)")
    thick = None
    if radius is not None or any(pose.scan for pose in poses):
        thick, of_radius = _quantity(radius, "length", "the radius of the cable", "--radius")
        if of_radius:
            say("  the radius has no tolerance in a study: its +- is left out")
    frames = None
    if clamps is not None:
        frames = read_frames(clamps, units=units or "m", convention=convention, degrees=not radians, tangent=tangent)
    elif not clamps_from_curves:
        frames = frames_of_bodies(poses, units=units, frame=frame, tangent=tangent)
        frames = frames or _asked_clamps(poses, units or "m", convention, not radians, tangent)
    if frames is None and free is None and interactive():
        question = "whether the ends of the curves are held or free, empty if their shapes shall tell"
        free = asked_or_refused(question, "--ends", _free, default="")
    study, notes = new_study(
        folder, poses, length=long, length_density=heavy, clamps=frames, radius=thick, title=title or "",
        gravity=down, units=units, columns=columns, validate=_validated(validate, poses),
        tolerance=Tolerance(length=of_length, length_density=of_weight), markers=markers, frame=frame,
        arc_lengths=None if arc_lengths is None else read_arc_lengths(arc_lengths, units=units), noise=_noise(noise), free=free,
    )  # fmt: skip
    scans = scans_of(study)  # read before anything is written
    toml = save_study(study, out or folder)
    for note in (*notes, *_assumed(None if gravity else down, units, tangent, frames)):
        say(f"  {note}")
    made = load_study(toml)
    say(f"\n{describe(made, scans)}")
    if frames is not None:
        _suggest_tangent(made, tangent)
    say(f"written: {toml}; look it through, then: scan2flex fit {shlex.quote(str(toml.parent))}")


def _of_test(given, test, length, density, mass, span, noise, validate, title, out) -> str:
    """Write the study of a bending test; what was made, in words."""
    from scan2flex_jax.convert import TESTS, Bench, bench_study, read_table, table_of  # noqa: PLC0415
    from scan2flex_jax.study import Tolerance, describe, load_study, save_study  # noqa: PLC0415
    from scan2flex_jax.study.files import STUDY_FILE  # noqa: PLC0415
    from scan2flex_jax.study.values import Where  # noqa: PLC0415

    stated = [str(one).partition("=") for one in given]
    if all(mark for _, mark, _ in stated):
        rows, names = table_of([name for name, _, _ in stated], [[value for *_, value in stated]], test, Where("arguments"))
        folder = Path(out or test)
    elif len(given) == 1:
        rows, names = read_table(given[0], test)
        folder = out or given[0].parent / given[0].stem
    else:
        raise Scan2FlexError("a bending test has one table, or one row as in 'weight=50 g' 'droop=21 mm'.")
    if (folder / STUDY_FILE).exists():
        raise Scan2FlexError(f"{folder / STUDY_FILE} is there already: edit it, or name another folder with --out.")
    long = of_length = heavy = of_weight = apart = 0.0
    needs = TESTS[test].needs
    if "length" in needs or (mass is not None and length is not None):
        long, of_length = _quantity(length, "length", "the length of the cable", "--length")
    if "density" in needs:
        heavy, of_weight = _weight(density, mass, long, "--density (or --mass and --length)")
    if "span" in needs:
        apart, _ = _quantity(span, "length", "the distance of the supports", "--span")
    nearly, judge = Tolerance(length=of_length, length_density=of_weight), tuple(validate or ())
    bench = Bench(test, rows, names, long, heavy, apart, nearly, _noise(noise), judge, title or folder.name)
    toml = save_study(bench_study(bench), folder)
    closed = "" if bench.guess is None else f"closed form: EI = {bench.guess:.3g} N m^2, the start of the fit\n"
    if "span" in needs:
        say("  the span is taken as exact: 1 % of it is 3 % of EI")
    return f"{describe(load_study(toml))}\n{closed}written: {toml}; then: scan2flex fit {shlex.quote(str(toml.parent))}"


def schema(
    out: Annotated[
        Path, typer.Option("--out", "-o", help="JSON file to write, into the folder of the study.", callback=file_to_write)
    ] = Path("study.schema.json"),
    force: Force = False,
) -> None:
    """Write the JSON schema of study.toml, with which an editor completes its keys and marks mistakes.

    Name it in the first line of the study, `#:schema ./study.schema.json`, as Even Better TOML (VS Code) and taplo read it.

    Example: scan2flex schema -o my-cable/study.schema.json
    """
    from scan2flex_jax.study import study_schema  # noqa: PLC0415
    from scan2flex_jax.study.outputs import Outputs, json_bytes  # noqa: PLC0415

    outputs = Outputs(force=force)
    outputs.claim(out)
    outputs.write(out, json_bytes(out, {**study_schema(), "$comment": f"scan2flex_jax {__version__}"}))
    say(f"written: {out}; name it in the first line of study.toml: #:schema ./{out.name}")


def _weight(density, mass, long, option):
    """Mass per length (kg/m) and its standard deviation, from the mass where the length (m) is known."""
    if mass is not None and long:
        return tuple(value / long for value in _quantity(mass, "mass", "", ""))
    return _quantity(density, "length density", "the mass per length of the cable", option)


def _validated(given, poses):
    """Names of the validate poses."""
    if given is None and interactive() and len(poses) > 1:
        question = "Validate poses, which judge the fit and are not fitted, separated by commas"
        answer = typer.prompt(question, default="", show_default=False)
        given = [name.strip() for name in answer.split(",") if name.strip()]
    return tuple(given or ())


def _assumed(down, units, tangent, frames):
    """Defaults that were used because their option was omitted."""
    said = [f"assumed: gravity is {', '.join(f'{g:g}' for g in down)} m/s^2 in the scan frame (--gravity)"] if down else []
    said += ["assumed: lengths are in metres in files that name no unit (--units)"] if units is None else []
    if frames is not None and tangent == "z":
        said.append("assumed: the cable leaves each frame along its z axis, from start to end (--tangent)")
    return said


def _suggest_tangent(study, tangent):
    """Suggest another --tangent if the cable leaves every clamp along another axis."""
    from scan2flex_jax.convert import other_tangent  # noqa: PLC0415
    from scan2flex_jax.study import pose_facts  # noqa: PLC0415
    from scan2flex_jax.study.visible import visible_mistakes  # noqa: PLC0415

    axis = next((mistake.axis for mistake in visible_mistakes(study) if mistake.axis), "")
    if not axis:
        return
    facts = [pose_facts(pose) for pose in study.poses]
    ends = [end for f in facts if f is not None for end in (f.start, f.end) if end is not None]
    angles = sorted(end.angle for end in ends if end.angle is not None)
    middle = angles[len(angles) // 2]
    meant = other_tangent(axis, tangent)
    say(f"the tangents are off by {middle:.0f} degrees at every clamp: did you mean --tangent {meant}? Delete the study.toml")
    say("that was written and start again with it.\n")


def _quantity(given, what, question, option):
    """A quantity and its standard deviation, from the option or a prompt."""
    from scan2flex_jax.convert.units import G, is_weight, measured  # noqa: PLC0415

    def read(answer):
        value = measured(answer, what)
        if is_weight(answer):
            say(f"  {answer.strip()} is a weight: divided by {G} m/s^2, standard gravity")
        return value

    return asked_or_refused(question, option, read) if given is None else read(given)


def _free(answer):
    """Whether ends hang free; None if their shapes shall tell."""
    known = {"held": False, "free": True, "": None}
    if answer.strip() not in known:
        raise Scan2FlexError(f"{answer[:20]!r} is neither held nor free: --ends takes one of them.")
    return known[answer.strip()]


def _noise(given):
    """The noise of a point (m), from the option or a prompt; None if it is not known."""

    def taken(answer):
        return _quantity(answer, "length", "", "")[0] if answer.strip() else None

    if given is None and interactive():
        say(_USUAL_NOISE)
        return asked_or_refused("the noise of the points, empty if it is not known", "--noise", taken, default="")
    return None if given is None else taken(given)


def _asked_clamps(poses, units, convention, degrees, tangent):
    """Clamps by name, one prompt per end; None if they are taken from the curves."""
    import numpy as np  # noqa: PLC0415

    from scan2flex_jax.convert import clamp_of_angles, length_unit  # noqa: PLC0415
    from scan2flex_jax.study import Clamp  # noqa: PLC0415

    def clamp(answer):
        if answer.strip() == "free":
            return None
        values = numbers(answer, 6 if len(answer.replace(",", " ").split()) > 3 else 3, "clamp")
        if len(values) == 3:
            return Clamp(np.array(values) * length_unit(units))
        if convention is None:
            raise Scan2FlexError("three angles need their convention: start again with --convention, or give a position alone.")
        return clamp_of_angles(values[:3], values[3:], convention, units=units, degrees=degrees, tangent=tangent)

    untwisted = "Take the clamps from the ends of the curves (only right where no end is twisted)?"
    if interactive() and all(pose.curve for pose in poses) and typer.confirm(untwisted, default=False):
        return None
    found = {}
    for pose in poses:
        for end in ("start", "end"):
            free = ", or free" if end == "end" else ""
            question = f"the {end} clamp of {pose.name} (x y z and three angles; x y z alone for a ball joint{free})"
            at = asked_or_refused(question, "--clamps FILE (or --clamps-from-curves)", clamp)
            if at is None and end == "start":
                raise Scan2FlexError(f"the start of {pose.name} must be held: give its clamp.")
            if at is not None:
                found[f"{pose.name} {end}"] = at
    return found
