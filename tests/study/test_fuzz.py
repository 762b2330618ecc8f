"""Whatever bytes are on the disk, a study loads or fails with one sentence. What loads saves and loads again, and the JSON
schema takes it.
"""

import re
import tempfile
import tomllib
from pathlib import Path

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from jsonschema import Draft7Validator

from scan2flex_jax.errors import StudyError
from scan2flex_jax.study import describe, load_study, save_study, study_schema

from .samples import STUDY, csv, curve, write_sample

EDITOR = Draft7Validator(study_schema())
SAG = csv(curve(12)).encode()
FRAGMENTS = [
    b"nan", b"-inf", b"true", b"1e308", b"5e-324", b"-1", b"0", b"[]", b"{}", b'""', b"'..'", b"[[", b"]", b"=", b"\n",
    b"\x00", b"\xff", b"1979-05-27", b"9" * 5000, b"[[pose]]", b"[unknown.length]", b"\r", b",", b"x,y,z", b'"a.b"',
    "\N{LINE SEPARATOR}".encode(), b"[0, 0, 0]", b"[[0, 0, 0], [1, 1, 1]]", b"1e16", b"-0.0",
    b"[unknown.axial_stiffness]",
]  # fmt: skip
TOKENS = [match.span() for match in re.finditer(rb'[\w.+-]+|"[^"]*"|\[[^\[\]]*\]|\S', STUDY.encode())]


@st.composite
def mutated(draw, base, tokens):
    """`base` with one to three pieces taken out, doubled, or exchanged for something that does not belong there."""
    data = base
    for _ in range(draw(st.integers(1, 3))):
        if tokens and draw(st.booleans()):
            low, high = draw(st.sampled_from(tokens))
        else:
            low = draw(st.integers(0, len(data)))
            high = min(len(data), low + draw(st.integers(0, 30)))
        other = draw(st.sampled_from(FRAGMENTS) | st.binary(max_size=6) | st.just(data[low:high] * 2))
        data = data[:low] + other + data[high:]
    return data


def holds(toml, sag):
    with tempfile.TemporaryDirectory() as name:
        folder = write_sample(Path(name) / "study", toml, **{"shapes/sag": sag})
        try:
            study = load_study(folder)
        except StudyError as error:
            assert "\n" not in str(error) and str(error).isprintable()
            return
        assert describe(study)
        EDITOR.validate(tomllib.loads((folder / "study.toml").read_text("utf-8-sig")))
        save_study(study, Path(name) / "copy")
        assert load_study(Path(name) / "copy") == study


FAST = settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))


@FAST
@given(mutated(STUDY.encode(), TOKENS))
def test_any_study_toml(toml):
    holds(toml, SAG)


@FAST
@given(mutated(SAG, []) | st.binary(max_size=200))
def test_any_csv(sag):
    holds(STUDY, sag)
