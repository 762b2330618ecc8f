"""WrongError and hostile values: of every key of study.toml and every parameter of an effect, of curves, and of options.

What is refused is refused in one sentence; what is taken is described, saved, and reads back as the same study.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.attacks.attempt import REFUSED, Place, Try, WrongError, command
from benchmarks.attacks.memory import in_memory, of_the_rod
from scan2flex_jax.study import describe, load_study, save_study
from scan2flex_jax.study.kinds import ParameterFormat, kind_format, kind_names
from tests.study.samples import csv, curve, write_sample

NEVER = (  # what no key of a study is
    "nan", "-nan", "inf", "-inf", "1e999", "true", "{}", "{ a = 1 }", "[[]]", "[{}]", "[nan, nan, nan]", "[true, false]",
    "1979-05-27", "1979-05-27T07:32:00Z", "07:32:00", "9" * 400, "-" + "9" * 4000, "0x" + "f" * 99, "[[[[[[[[1.0]]]]]]]]",
)  # fmt: skip
ODD = (
    "0", "-0.0", "-1", "1", "0.5", "5e-324", "1e-300", "1e15", "1.0001e15", "1e308", "-1e308", '""', '" "', '"sag"', '"nan"',
    '"../../../etc/passwd"', '"/dev/zero"', '"study.toml"', '"\\u0000"', '"a\\nb"', '"\\u001b[2J"', '"\\u202e"',
    f'"{"x" * 5000}"', "[]", "[0]", "[0, 0, 0]", "[1, 1, 1, 1]", "[0, 0, 0, 0]", "[1e308, 1e308, 1e308]", "[-1, 1]", "[1, -1]",
    "[[0, 0, 0], [1, 1, 1]]", "[1, [2]]", '["a", "b", "c"]', "[1e-320, 0, 1]", "[0.7071, 0, 0.7071, 0]",
)  # fmt: skip
CLAMP = "[0.7071067811865476, 0.0, 0.7071067811865476, 0.0]"
TABLES: dict[str, dict[str, str]] = {
    "": {"format": '"scan2flex-study/1"', "title": '"a cable"', "gravity": "[0.0, 0.0, -9.81]"},
    "[cable]": {
        "length": "0.9", "radius": "0.004", "length_density": "0.336", "shear_stiffness": "[1e5, 2e5]",
        "axial_stiffness": "1e5", "bending_stiffness": "0.1", "torsional_stiffness": "0.03",
        "natural_curvature": "[0.0, 0.1, 0.0]", "natural_stretch": "[0.0, 0.0, 0.0]",
    },
    "[tolerance]": {"length": "0.002", "clamp_position": "0.001", "clamp_rotation": "0.01", "gravity": "0.01"},
    "[unknown.bending_stiffness]": {"guess": "0.1", "range": "[1e-3, 1e2]"},
    "[unknown.natural_curvature]": {"guess": "[0, 0, 0]", "range": "[[-1, -1, -1], [1, 1, 1]]"},
    "[[pose]]": {
        "name": '"sag"', "role": '"fit"', "turns": "-1", "centre_curve": '"shapes/sag.csv"', "scan": '"sag.xyz"',
        "guide_points": '"sag-guides.csv"', "viewpoints": "[[0.5, -1.0, 0.3]]", "noise": "0.001",
    },
    "[pose.start]": {"position": "[0.0, 0.0, 0.0]", "quaternion": CLAMP},
    "[pose.end]": {"position": "[0.5, 0.0, 0.0]", "quaternion": CLAMP},
    "[[pose]]#2": {
        "name": '"again"', "role": '"validate"', "start": f"{{ position = [0, 0, 0], quaternion = {CLAMP} }}",
        "end": "{ position = [0.5, 0, 0] }", "centre_curve": '"again.csv"', "repeat_of": '"sag"',
    },
}  # fmt: skip
_VALUES = {"positive": "0.3", "fraction": "0.3", "nonnegative": "0.3", "along_cable": "0.42", "any": "0.1", "unit": "1.0"}
_POINTS = (
    "nan", "inf", "-inf", "1e308", "1e16", "text", "", "1_0", "0x10", "1,2", "1;2", "\0", "\N{SUPERSCRIPT TWO}", "1e-320", "0,",
    "٣", "True", "1j", "--1", "1 2",
)  # fmt: skip


def tries(place: Place, rng: np.random.Generator) -> Iterator[Try]:
    """Values in study.toml, in curves, in memory, of the rod, and of options."""
    folder = write_sample(place.root / "study")
    for table, keys in TABLES.items():
        for key in keys:
            for value in (*NEVER, *ODD):
                must = REFUSED if value in NEVER else None
                yield _toml(place, folder, f"{table} {key} = {value[:40]}", text({(table, key): value}), must)
            yield _toml(place, folder, f"{table} {key} left out", text({(table, key): None}))
            yield _toml(
                place, folder, f"{table} {key} twice", text({(table, key): f"{keys[key]}\n{key} = {keys[key]}"}), REFUSED
            )
            yield _toml(place, folder, f"{table} unknown key", text({(table, key): f"{keys[key]}\n{key}_ = 1"}), REFUSED)
    yield from _effects(place, folder, rng)
    yield from _curves(place, folder, rng)
    yield from in_memory(place, folder)
    yield from of_the_rod()
    yield from _options(place)


def text(changes: dict[tuple[str, str], str | None], more: str = "") -> str:
    """The study with some of its values exchanged, or left out."""
    lines = []
    for table, keys in TABLES.items():
        lines.append(table.partition("#")[0])
        exchanged = {key: changes.get((table, key), value) for key, value in keys.items()}
        lines += [f"{key} = {value}" for key, value in exchanged.items() if value is not None]
    return "\n".join(lines) + "\n" + more


def _toml(place: Place, folder: Path, name: str, toml: str, must: str | None = None) -> Try:
    copy = place.root / "copy"
    return Try(name, lambda: taken(folder, copy), (copy,), must, prepare=lambda: (folder / "study.toml").write_text(toml))


def taken(folder: Path, copy: Path) -> None:
    """Read a study, describe it, save it, and read that."""
    study = load_study(folder)
    if not describe(study).strip():
        raise WrongError("a study that says nothing")
    save_study(study, copy)
    if load_study(copy) != study:
        raise WrongError(f"a saved study is another one: {describe(study)}")


def _effects(place, folder, rng) -> Iterator[Try]:
    """Every parameter of every effect type with a choice of the values."""
    for kind in kind_names():
        parameters = {p.name: _valid(p) for p in kind_format(kind).parameters}
        for name in (*parameters, "kind"):
            for value in rng.choice([*NEVER, *ODD], 14, replace=False):
                given = {"kind": f'"{kind}"', **parameters, name: value}
                toml = text({}, "[[effect]]\n" + "".join(f"{k} = {v}\n" for k, v in given.items()))
                yield _toml(place, folder, f"{kind} {name} = {value[:40]}", toml, REFUSED if value in NEVER else None)


def _valid(p: ParameterFormat) -> str:
    """A value of the right shape."""
    if p.domain == "unit":
        return "[0.0, 0.0, 1.0]"
    shape = p.shapes(2)[0]
    return str((np.zeros(shape) + float(_VALUES[p.domain])).tolist())


def _curves(place, folder, rng) -> Iterator[Try]:
    """A cell, a line, or the whole of a measured curve."""
    rows = csv(curve(12)).splitlines()
    for file in ("shapes/sag.csv", "sag-guides.csv"):
        for cell in _POINTS:
            for _ in range(3):
                line, column = int(rng.integers(1, len(rows))), int(rng.integers(0, 3))
                cells = rows[line].split(",")
                cells[column] = cell
                changed = "\n".join([*rows[:line], ",".join(cells), *rows[line + 1 :], ""])
                yield _file(place, folder, f"{file}: {cell!r} in line {line}", file, changed.encode())
        for n in (0, 1, 2, 3, 4, 5, 6, 7):
            yield _file(place, folder, f"{file}: {n} points", file, "\n".join(rows[: n + 1]).encode())
        for factor in (0.0, 1e-300, 1e-3, 10.0, 1e3, 1e14, 1e150, -1.0):
            yield _file(place, folder, f"{file}: times {factor:g}", file, csv(curve(12) * factor).encode())


def _file(place, folder, name, file, data) -> Try:
    def prepare():
        (folder / file).write_bytes(data)
        (folder / "study.toml").write_text(text({}))

    return Try(name, lambda: taken(folder, place.root / "copy"), (place.root / "copy",), prepare=prepare)


_NUMBERS = (
    "nan", "inf", "1e999", "", " ", "0", "-1", "text", "1e308", "0x10", "9" * 400, "1,2", "1 m", "1 parsec", "\N{MICRO SIGN}m",
    "%s", "1e-320", "--1", "\N{FULLWIDTH DIGIT ONE}", "1/0", "'", "[bold]",
)  # fmt: skip


def _options(place) -> Iterator[Try]:
    """Options of the commands that compute nothing, and those that commands refuse before they compute."""
    scans = place.root / "scans"
    scans.mkdir()
    np.savetxt(scans / "a.csv", curve(20), delimiter=",", header="x,y,z", comments="")
    study, out = place.root / "study", place.root / "made"
    right = {"--length": "0.9", "--density": "0.3", "--gravity": "0,0,-9.81", "--radius": "0.004", "--units": "m"}
    for value in _NUMBERS:
        for option in right:
            words = [w for pair in {**right, option: value}.items() for w in pair]
            yield _words(f"new {option} {value}", "new", scans, "--clamps-from-curves", "--out", out, *words, writes=(out,))
        for form in ("--matrix={}", "--matrix=1,0,0,{},0,1,0,0,0,0,1,0", "--matrix=1 0 {} 0 0 1 0 0 0 0 1 0 0 0 0 1"):
            yield _words(f"pose {form.format(value)}", "pose", form.format(value))
        for angles, convention in ((f"0,90,{value}", "kuka"), ("0,90,0", value)):
            yield _words(
                f"pose {angles} {convention}", "pose", "--position", "0,0,0", f"--angles={angles}", "--convention", convention
            )
        for option in ("--units", "--columns"):
            yield _words(f"curve {option} {value}", "curve", scans / "a.csv", f"{option}={value}")
        if value not in ("0x10", "0"):  # a whole number in another writing
            for name in ("fit", "explain", "simulate", "plan"):
                yield _words(f"{name} --elements {value}", name, study, f"--elements={value}", must=REFUSED)
        yield _words(f"fit --method {value}", "fit", study, f"--method={value}", must=REFUSED)
        yield _words(f"export --to {value}", "export", study, f"--to={value}", "-o", out / "x.xml", must=REFUSED)
        yield _words(f"check {value}", "check", value, must=REFUSED)


def _words(name, *words, writes=(), must=None) -> Try:
    return Try(name, lambda: command(*words), writes, must)
