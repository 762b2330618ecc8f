"""The blind cases as a data set in plain files, for programs of anybody: what is given, the sealed answers, and a scorer.

A case is ``cases/ID/study.toml`` with a CSV for each pose, and ``asked.json``: clamps and weights of the poses whose shapes are
asked for. ``answers/ID.json`` has the truth, and those shapes as measured. The cases are those of the record
``benchmarks/results/blind.json`` (seed `SEED`), a bamboo rod and a wing; ``score.py`` is the scorer, ``README.md`` the page
``docs/benchmark.md``, and ``dataset.json`` has version, sources and the SHA-256 of every file.
"""

import csv
import hashlib
import json
import re
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks import wing
from benchmarks.blind_score import IN_CATALOGUE
from benchmarks.record import recorded
from scan2flex_jax.cli.demo import PLACES, calipers
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.examples import example_path
from scan2flex_jax.study import Study, load_study, save_study

NAME, VERSION, SEED, COUNT = "bent-cables", 1, 20261130, 60
SCORER, PAGE = Path(__file__).with_name("score.py"), Path(__file__).parents[2] / "docs" / "benchmark.md"
_ROTATED = "anisotropic_bending"  # its EI depends on the axis that is called the first one
_ROUGH, _FEW = 0.05, 7  # points that tell which of several equilibria is asked: rounding over the length, number
_SOURCES = {
    "b001 and on": f"benchmarks.blind of scan2flex_jax, seed {SEED}; Apache-2.0",
    "bamboo-rod": "measured by Rich Miller, November 2017 (github.com/RHexMan/RHex); facts, with the diameters in answers",
    "wing-bare": "Avin, Raveh, Drachinsky, Ben-Shmuel, Tur, AIAA Journal 60, 2022; public files of AePW3",
}


def export(folder: Path, cases: Path, answers: Path) -> None:
    """Write the data set of generated ``cases`` and their ``answers``, of the rod and of the wing; raises `Scan2FlexError` if
    the cases are not those of the record, or the folder exists."""
    if folder.exists():
        raise Scan2FlexError(f"{folder} exists: name a new folder.")
    truths = {f.stem: tomllib.loads(f.read_text()) for f in sorted(answers.glob("*.toml"))}
    _of_the_record(truths)
    for name, truth in truths.items():
        generated(cases / name, truth, folder, name)
    measured(load_study(example_path("bamboo-rod")), folder, "bamboo-rod", along=_by_calipers())
    bare = wing.wing("bare", "validate")
    measured(bare, folder, "wing-bare", bending_stiffness=wing.SERIES["bare"][1])
    shutil.copy(SCORER, folder / SCORER.name)
    shutil.copy(PAGE, folder / "README.md")
    files = sorted(f for f in folder.rglob("*") if f.is_file())
    digests = {f.relative_to(folder).as_posix(): hashlib.sha256(f.read_bytes()).hexdigest() for f in files}
    _json(folder / "dataset.json", {"name": NAME, "version": VERSION, "sources": _SOURCES, "files": digests})


def _of_the_record(truths):
    """Refuse cases that others were scored on under the same names."""
    for name, row in recorded("blind")["rows"].items():
        if name in truths and round(truths[name]["plain_over_noise"], 3) != row["strength"]:
            raise Scan2FlexError(f"{name} is not the case of benchmarks/results/blind.json: generate them with --seed {SEED}.")


def generated(case: Path, truth: dict, folder: Path, name: str) -> None:
    """One generated case; its poses that are not fitted go into the answer."""
    target = folder / "cases" / name
    target.mkdir(parents=True)
    head, *poses = re.split(r"^\[\[pose\]\]\n", (case / "study.toml").read_text(), flags=re.MULTILINE)
    told = tomllib.loads((case / "study.toml").read_text())
    parsed, grid = told["pose"], _ROUGH * told["cable"]["length"]
    unseen, asked = {}, {}
    for text, pose in zip(poses, parsed, strict=True):
        file = case / pose["centre_curve"]
        if pose["role"] == "fit":
            head += f"[[pose]]\n{text}"
            shutil.copy(file, target / file.name)
        else:
            with file.open() as rows:
                points = [[float(row[k]) for k in "xyz"] for row in csv.DictReader(rows)]
            unseen[pose["name"]] = {"markers": False, "points": points}
            some = np.array(points)[np.linspace(0, len(points) - 1, _FEW).round().astype(int)]
            asked[pose["name"]] = {k: pose[k] for k in ("start", "end") if k in pose}
            rough = (np.round(some / grid) * grid).round(6)
            new = np.r_[True, np.any(np.diff(rough, axis=0) != 0.0, axis=1)]
            asked[pose["name"]]["roughly"] = rough[new].tolist()
    (target / "study.toml").write_text(head)
    _json(target / "asked.json", {"unseen": asked})
    off = truth["off_catalogue"]
    kinds = [IN_CATALOGUE[off]] if off in IN_CATALOGUE else truth["kinds"]
    kind = "off" if off not in ("none", *IN_CATALOGUE) else ("none", "one", "two")[len(kinds)]
    answer = {"class": kind, "truth": kinds, "accept": sorted({*kinds, *truth["accept"]})}
    answer["effects"] = [_listed(e) for e in truth.get("effect", [])]
    if kind != "off" and _ROTATED not in kinds:
        answer |= {k: truth[f"true_{k}"] for k in ("bending_stiffness", "torsional_stiffness")}
    _json(folder / "answers" / f"{name}.json", answer | {"noise": 2**0.5 * truth["noise_rms"], "unseen": unseen})


def _listed(effect):
    """An effect under its name in the list: tapers, which the generator counts as outside it."""
    if effect["kind"] not in IN_CATALOGUE:
        return effect
    return {"kind": IN_CATALOGUE[effect["kind"]], "taper": effect["exponent"]}


def measured(study: Study, folder: Path, name: str, **truth) -> None:
    """One measured case with markers, as `generated`; ``truth``: what is known of it from elsewhere."""
    fitted, others = study.fit_poses, study.validate_poses
    kept = {p.name for p in fitted}
    loads = [e for e in study.effects if e.poses is None or kept & {*e.poses}]
    loads = [e if e.poses is None else replace(e, poses=tuple(p for p in e.poses if p in kept)) for e in loads]
    save_study(replace(study, poses=fitted, effects=tuple(loads)), folder / "cases" / name)
    asked, unseen = {}, {}
    for pose in others:
        hung = [{"kind": e.kind, **e.parameters} for e in study.effects if e.poses and pose.name in e.poses]
        start = {"position": pose.start.position.tolist(), "quaternion": pose.start.quaternion.tolist()}
        asked[pose.name] = {"start": start, "arc_length": pose.markers.arc_length.tolist(), "effect": hung}
        points = [[None if np.isnan(x) else float(x) for x in p] for p in pose.markers.points]
        unseen[pose.name] = {"markers": True, "points": points}
    places = {"bending_stiffness_at": [s for s, _ in truth["along"]]} if "along" in truth else {}
    _json(folder / "cases" / name / "asked.json", {"unseen": asked, **places})
    noise = float(np.mean([p.noise * np.sqrt(np.mean(np.isfinite(p.markers.points).sum(axis=1))) for p in others]))
    answer = {"class": "measured", "truth": [], "accept": [], **truth, "noise": noise, "unseen": unseen}
    _json(folder / "answers" / f"{name}.json", answer)


def _by_calipers():
    """EI (N m^2) of the bamboo rod at places (m), from its diameters and its owner's modulus."""
    s, EI = calipers(example_path("bamboo-rod"))
    return [[at, float(np.exp(np.interp(at, s, np.log(EI))))] for at in PLACES]


def _json(path, content):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=1) + "\n")
