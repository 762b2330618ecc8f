"""Docstrings of the public names: functions say arguments, answer and errors, and every example gives what it shows."""

import doctest
import inspect
from dataclasses import replace

import jax
import pytest

import scan2flex_jax

NAMES = {name: getattr(scan2flex_jax, name) for name in scan2flex_jax.__all__}
IN_SENTENCES = {"report"}  # arguments without a list
FUNCTIONS = sorted({name for name, value in NAMES.items() if inspect.isfunction(value)} - IN_SENTENCES)
CLASSES = ["Boundary", "Cable", "CableModel", "Clamp", "EffectDeclaration", "Markers", "MeasuredCurve", "Study", "StudyError"]
CLASSES += ["StudyPose", "Tolerance", "Unknown"]
WITHOUT_EXAMPLE = {"solve_rod"}  # that of `equilibrium` serves


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_say_arguments_and_answer(name):
    text = inspect.getdoc(NAMES[name])
    assert "\nArgs:\n" in text
    assert "\nReturns:\n" in text
    for argument in inspect.signature(NAMES[name]).parameters:
        assert f"\n    {argument}: " in text, argument


@pytest.mark.parametrize("name", sorted({*CLASSES, *FUNCTIONS} - WITHOUT_EXAMPLE))
def test_examples_give_what_they_show(name):
    known = {**NAMES, "jax": jax, "replace": replace}
    found = [t for t in doctest.DocTestFinder().find(NAMES[name], name, globs=known) if t.examples]
    assert found, f"{name} has no example"
    for test in found:
        said = []
        doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(test, out=said.append)
        assert not said, "".join(said)
