"""docs/study.md: effects and default ranges are those of the package, and the examples are accepted.

The tables of keys are made from their declaration (`tests/test_site.py`).
"""

import json
import tomllib

import numpy as np
import pytest

from scan2flex_jax.effects import effect_class
from scan2flex_jax.fitting.parameters import DEFAULT_RANGE
from scan2flex_jax.study import CABLE, kind_format, kind_names, load_study
from tests.documents import DOCS, PAGES, blocks, name_of, rows, section

PAGE = (DOCS / "study.md").read_text("utf-8")


def test_every_effect_has_a_row_for_each_parameter_with_its_unit():
    told, kind, place = {}, "", ""
    for first, acts, parameter, unit, _ in rows(section(PAGE, "Effects")):
        kind, place = first.strip("`") or kind, acts or place
        told.setdefault(kind, (place, {}))[1][parameter.strip("`")] = unit
    own = [kind for kind in kind_names() if effect_class(kind).__module__.startswith("scan2flex_jax.")]
    package = {kind: kind_format(kind) for kind in own}  # without those that other tests add
    assert told == {kind: (form.place, {p.name: p.unit for p in form.parameters}) for kind, form in package.items()}


def test_ranges_are_those_of_the_fit():
    told = {}
    for name, unit, words in rows(section(PAGE, "Default ranges")):
        low, high = map(float, words.split(" to "))
        told[name.strip("`")] = (low, high)
        assert unit == CABLE[name.strip("`")].unit
    assert told == DEFAULT_RANGE


def test_the_example_is_a_study(tmp_path):
    (tmp_path / "study.toml").write_text(blocks(section(PAGE, "An example"), "toml")[0], "utf-8")
    t = np.linspace(0.0, 1.0, 30)
    sag = np.column_stack([0.6 * t, 0.0 * t, -0.25 * np.sin(np.pi * t) ** 2])
    for name in ("sag", "twisted"):
        np.savetxt(tmp_path / f"{name}.csv", sag, delimiter=",", header="x,y,z", comments="")
    study = load_study(tmp_path)
    assert study.unknown_names == ("bending_stiffness", "torsional_stiffness")
    assert [pose.name for pose in study.poses] == ["sag", "twisted"]


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_blocks_of_toml_and_json_can_be_read(page):
    text = page.read_text("utf-8")
    for block in blocks(text, "toml"):
        tomllib.loads(block)
    for block in blocks(text, "json"):
        json.loads(block)
