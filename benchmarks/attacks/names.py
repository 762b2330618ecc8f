"""Poses with hostile names, through every command that makes files, pictures, pages or text of them."""

import json
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from html.parser import HTMLParser
from pathlib import Path
from unittest import mock

import matplotlib.image
import numpy as np

from benchmarks.attacks import scene
from benchmarks.attacks.attempt import REFUSED, WORKED, Place, Try, WrongError, command
from scan2flex_jax.scan.centre_curve import CentreCurve, RadiusStatistics
from scan2flex_jax.study import MeasuredCurve, load_study, save_study

OTHER = "one-forces"
NAMES = (
    "../esc", "../../esc", "../../../../../../esc", "/etc/passwd", "..", ".", "...", " x", "a/../../b", "a/b", "C:\\x",
    "\\\\host\\share", "-rf", "--json", "~root", "~", "nul", "CON", "aux.csv", "com1", "LPT9.x", "x" * 5000,
    "\N{SNOWMAN}" * 300, "a\0b", "a\nb", "a\rb", "\x1b[2J", "\x1b]0;title\a", "\x07", "\u202egnp", "\u2028", "\ufeffa", "a:b",
    "what?", "*", "name.", "name ", "$\\frac{$", "$x$", "$$", "\\frac", "_hidden", "%s%n", "{}", "{{ 7*7 }}", "{% raw %}",
    "<b>bold</b>", "</script><script>alert(1)</script>", "<img src=x onerror=alert(1)>", '" onmouseover="alert(1)', "&lt;",
    "javascript:alert(1)", "[bold]x[/bold]", "[link=file:///]x", "study", "study.toml", "pose-0.csv", ".scan2flex-written",
    "one", "\N{COMBINING ACUTE ACCENT}", "e\u0301", "\N{LATIN SMALL LIGATURE FI}", "\N{PILE OF POO}", "'; DROP TABLE", "`id`",
    "$(id)", "| head", "#", "a,b", "a;b", '"', "'", "\t", "nan", "None", "0", "[[pose]]", "a.b", "=1+1", "\N{ZERO WIDTH SPACE}",
    "\N{ARABIC LETTER BEH}", "\x7f", "\x85",
)  # fmt: skip


def tries(place: Place, rng: np.random.Generator) -> Iterator[Try]:
    """Each name on one pose of a study whose other pose is called "one-forces"; the commands take turns."""
    folder, out = place.root / "study", place.root / "out"
    ways = {"simulate": _simulated, "check": _checked, "save": _saved, "export": _exported, "extract": _extracted,
            "fit": _fitted, "report": _reported}  # fmt: skip
    for name in NAMES:
        for way, act in ways.items():
            said, must = f"{way} {ascii(name)[:60]}", WORKED if name.strip() else REFUSED
            yield Try(said, partial(act, folder, out, name), (out,), must, prepare=partial(scene.write, folder, [name, OTHER]))


def _simulated(study: Path, out: Path, name: str) -> None:
    command("simulate", study, "--out", out / "a" / "b", "--json", out / "s.json", "--elements", scene.ELEMENTS)
    _holds(strict_json(out / "s.json"), name)
    written = [path for path in (out / "a" / "b").iterdir() if path.suffix == ".csv"]
    shapes = [path for path in written if path.read_text().startswith("s,x,y,z\n")]
    if len(written) != 4 or len(shapes) != 2:
        raise WrongError(f"two poses do not make four files: {sorted(path.name for path in written)}")


def _checked(study: Path, out: Path, name: str) -> None:
    command("check", study, "--json", out / "c.json")
    _holds(strict_json(out / "c.json")["poses"], name)


def _saved(study: Path, out: Path, name: str) -> None:
    loaded = load_study(study)  # without paths, so that files are named after the poses
    loaded = replace(loaded, poses=[replace(pose, curve=MeasuredCurve(pose.curve.points)) for pose in loaded.poses])
    save_study(loaded, out / "saved")
    again = load_study(out / "saved")
    if again != loaded or [pose.name for pose in again.poses] != [name, OTHER]:
        raise WrongError("a saved study is another one: " + ascii(name)[:60])
    if any(path.parent != out / "saved" for path in out.rglob("*.csv")):
        raise WrongError("a file outside of the saved study: " + ascii(name)[:60])


def _exported(study: Path, out: Path, name: str) -> None:
    command("export", study, "--to", "json", "-o", out / "x.json", f"--pose={name}", "--elements", scene.ELEMENTS)
    strict_json(out / "x.json")


def _extracted(study: Path, out: Path, name: str) -> None:
    """The pictures and the JSON; the extraction itself does not depend on names."""
    loaded = load_study(study)
    found = {pose.name: _a_curve() for pose in loaded.poses}
    with mock.patch("scan2flex_jax.cli.extracting.extracted", lambda _: (loaded, found)):
        command("extract", study, "--save", out / "saved", "--figures", out / "a" / "b", "--json", out / "e.json")
    _holds(strict_json(out / "e.json"), name)


def _a_curve() -> CentreCurve:
    points = scene.shapes()[0]
    n, s = len(points), np.linspace(0.0, 1.0, len(points))
    radius, frames = RadiusStatistics(scene.RADIUS, 1e-4, 1000, 1.0), np.tile(np.eye(3), (n, 1, 1))
    return CentreCurve(points, s, np.tile([1.0, 0.0, 0.0], (n, 1)), frames, np.full(n, 1e-4), radius, 1e-4, (), "cloud")


def _fitted(study: Path, out: Path, name: str) -> None:
    command(
        "fit", study, "--json", out / "f.json", "--figure", out / "f.png", "--save", out / "saved", "--elements", scene.ELEMENTS
    )
    _holds(strict_json(out / "f.json")["poses"], name)
    whole_picture(out / "f.png")


def _reported(study: Path, out: Path, name: str) -> None:
    command("report", study, "-o", out / "r.html", "--no-explain", "--elements", scene.ELEMENTS)
    page = (out / "r.html").read_text("utf-8")
    plain = scene.kept("page", lambda: tags(_plain_page(out / "plain")))
    if tags(page) != plain:
        raise WrongError(f"a name changes the tags of a page: {sorted(set(tags(page)) ^ set(plain))}")


def _plain_page(folder: Path) -> str:
    from scan2flex_jax.fitting import fit  # noqa: PLC0415
    from scan2flex_jax.reporting import report  # noqa: PLC0415

    return report(fit(load_study(scene.write(folder, ["two", OTHER])), elements=scene.ELEMENTS))


class _Tags(HTMLParser):
    def __init__(self):
        super().__init__()
        self.found: list[tuple[str, tuple[str, ...]]] = []

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, tuple(sorted(name for name, _ in attrs))))


def tags(page: str) -> list[tuple[str, tuple[str, ...]]]:
    """The tags of a page with the names of their attributes, in order."""
    parser = _Tags()
    parser.feed(page)
    parser.close()
    return parser.found


def strict_json(path: Path):
    """What a JSON file holds; NaN and infinity are no JSON."""

    def never(name):
        raise WrongError(f"{name} in JSON: {path.name}")

    return json.loads(path.read_text("utf-8"), parse_constant=never)


def whole_picture(path: Path) -> None:
    """Refuse a picture that cannot be read to its end."""
    if not matplotlib.image.imread(path).size:
        raise WrongError(f"an empty picture: {path.name}")


def _holds(entries: dict, name: str) -> None:
    if name not in entries:
        raise WrongError(f"a name that is another one in JSON: {[ascii(key)[:60] for key in entries]}")
