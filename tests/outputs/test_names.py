"""Poses may be called anything: their files stay in the folder, and their names draw and print as what they are."""

import json
import re
import warnings
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

from scan2flex_jax.names import drawn, file_stem, file_stems, printable
from scan2flex_jax.prediction import csv_files
from scan2flex_jax.scan import save_picture
from scan2flex_jax.scan.centre_curve import CentreCurve, RadiusStatistics

from . import scenes

HOSTILE = [
    "../esc", "/tmp/absolute", "../../esc", "..", ".", "...", " ", "a/../../b", "C:\\x", "\\\\host\\share", "-rf", "~root",
    "nul", "CON", "aux.csv", "com1", "LPT9.x", "x" * 5000, "\N{SNOWMAN}" * 300, "a\0b", "a\nb", "\x1b[2J", "\u202egnp",
    "a:b", "what?", "name.", "name ", "$\\frac{$", "<b>bold</b>", "", "\udcff",
]  # fmt: skip
RESERVED = re.compile(r"(?i)(con|prn|aux|nul|com\d|lpt\d)(\..*)?")


@pytest.mark.parametrize("name", HOSTILE)
def test_any_name_is_one_file_in_the_folder(name, tmp_path):
    stem = file_stem(name)
    assert stem == Path(stem).name not in ("", ".", "..")
    assert stem.isprintable() and not set(stem) & set('/\\:*?"<>|') and stem[0] not in "-.~ " and stem[-1] not in ". "
    assert not RESERVED.fullmatch(stem) and len(stem.encode()) <= 120
    (tmp_path / f"{stem}-forces.csv").write_text("")
    assert [path.parent for path in tmp_path.iterdir()] == [tmp_path]


@pytest.mark.parametrize("name", ["sag", "sag 0.5 m", "K\u00fcche", "a.b", "\u59ff\u52e2 1", "pose-2_b"])
def test_a_name_that_is_a_file_name_everywhere_stays(name):
    assert file_stem(name) == name


def test_no_two_poses_share_a_file():
    names = [*HOSTILE, "second", "second-forces", "Second", "sag", "SAG", "sag-2", "sag", "\ufb01t", "fit", "e\u0301", "\u00e9"]
    files = csv_files(names, Path("out"))
    assert list(files) == list(dict.fromkeys(names))
    every = [str(path).casefold() for pair in files.values() for path in pair]
    assert len(set(every)) == len(every)
    assert files["second"][1].name == "second-forces.csv" and files["second-forces"][0].name == "second-forces-2.csv"
    assert file_stems(["a", "A"], (".png",)) == {"a": "a", "A": "A-2"}


def test_a_simulation_stays_in_its_folder_and_says_where(tmp_path):
    names = ["../esc", str(tmp_path / "absolute"), "second", "second-forces", "a\0b", "fine"]
    study = scenes.write_study(tmp_path / "study", names)
    found = scenes.run("simulate", study, "--out", tmp_path / "out" / "deep", "--elements", "8", "--json", tmp_path / "s.json")
    assert found.exit_code == 0, found.exception
    assert {path.name for path in tmp_path.iterdir()} == {"study", "out", "s.json"}
    written = sorted(path for path in (tmp_path / "out").rglob("*.csv"))
    assert len(written) == 2 * len(names) and {path.parent for path in written} == {tmp_path / "out" / "deep"}
    headers = [path.read_text().partition("\n")[0] for path in written]
    assert sum(header == "s,x,y,z" for header in headers) == len(names)
    files = csv_files(names, tmp_path / "out" / "deep")
    for name in names:
        assert f"{printable(name)}: " in found.output and str(files[name][0]) in found.output
    assert list(json.loads((tmp_path / "s.json").read_text())) == names


def test_pictures_of_an_extraction_stay_in_their_folder(tmp_path, monkeypatch):
    study = scenes.write_study(tmp_path / "study", ["../../esc", "$\\frac{$"], "scan")
    found = {name: _curve() for name in ("../../esc", "$\\frac{$")}
    monkeypatch.setattr("scan2flex_jax.cli.extracting.extracted", lambda loaded, quiet=False: (loaded, found))
    found = scenes.run("extract", study, "--save", tmp_path / "saved", "--figures", tmp_path / "a" / "b")
    assert found.exit_code == 0, found.exception
    assert {path.name for path in tmp_path.iterdir()} == {"study", "saved", "a"}
    pictures = list((tmp_path / "a" / "b").glob("*.png"))
    assert len(pictures) == 2
    assert all(str(path) in found.output for path in pictures if path.stem != "$-frac{$")
    again = scenes.run("extract", study, "--save", tmp_path / "saved", "--figures", tmp_path / "a" / "b")
    assert any(path.name in str(again.exception) for path in pictures) and "--force" in str(again.exception)


def _curve():
    s, along = np.linspace(0.0, 1.0, 30), np.tile([1.0, 0.0, 0.0], (30, 1))
    radius = RadiusStatistics(5e-3, 1e-4, 1000, 1.0)
    frames, std = np.tile(np.eye(3), (30, 1, 1)), np.full(30, 1e-4)
    said = ("cost $5 and \\frac{1$",)
    return CentreCurve(scenes.curve(), s, along, frames, std, radius, 1e-4, (), "cloud", warnings=said)


TITLES = ["$\\frac{$", "a\x1b[31mb\x07\x0b\x00", "_hidden", "t" * 100_000]


@pytest.mark.parametrize("title", TITLES)
def test_a_picture_of_any_title_is_drawn(title, tmp_path):
    figure = plt.figure()
    figure.suptitle(drawn(title))
    figure.gca().plot([0, 1], label=drawn(title))
    figure.gca().legend()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure.savefig(tmp_path / "a.svg")
    plt.close(figure)
    assert not set((tmp_path / "a.svg").read_bytes()) & {0, 7, 11, 27}
    assert save_picture(_curve(), tmp_path / "b.png", title).stat().st_size > 10_000


@pytest.mark.parametrize("title", ["a\x1b[2Jb\x07\x9b31m", "a\rb\u202eevil\u2066x"])
def test_a_terminal_gets_no_control_characters(title, tmp_path):
    study = scenes.write_study(tmp_path / "study", [title])
    text = (study / "study.toml").read_text()
    (study / "study.toml").write_text(text.replace('"A [bold] cable"', scenes.toml_text(title)))
    found = scenes.scan2flex("check", study, text=False)
    assert found.returncode == 0, found.stderr
    shown = (found.stdout + found.stderr).decode()
    assert {c for c in shown if not c.isprintable()} <= {"\n"}
    (study / "pose-0.csv").write_text(f"{title}\n")
    refused = scenes.scan2flex("check", study / title, text=False)
    assert refused.returncode == 2
    assert {c for c in refused.stderr.decode() if not c.isprintable()} <= {"\n"}
