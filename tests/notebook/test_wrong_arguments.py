"""Arguments of the rod and of its solve that are no numbers end in one sentence, before anything is compiled."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from scan2flex_jax import Boundary, Cable, CableModel, Scan2FlexError, equilibrium, solve_rod
from scan2flex_jax.rod.model import Configuration, discretise

from . import rods

pytestmark = pytest.mark.usefixtures("as_a_user_runs_it")
MODEL, BOUNDARY = rods.scene(rods.HERE)
WRONG = {
    "text": "0.1", "bytes": b"0.1", "bool": True, "None": None, "complex": 1j, "huge": 10**400, "ragged": [[1.0], [1.0, 2.0]],
    "object": object(), "five": np.ones(5), "traced list of texts": [jnp.ones(()), "a"],
}  # fmt: skip


@pytest.mark.parametrize("value", WRONG.values(), ids=WRONG)
def test_what_is_no_number_of_a_rod(value):
    ways = {
        "Cable: length ": lambda: Cable(value, 0.2, 0.1, 0.25),
        "Cable: bending_stiffness ": lambda: Cable(1.0, 0.2, value, 0.25),
        "Cable: natural_curvature ": lambda: Cable(1.0, 0.2, 0.1, 0.25, natural_curvature=value),
        "CableModel: gravity ": lambda: CableModel(MODEL.cable, value),
        "Boundary: a position ": lambda: Boundary.of((value, None)),
        "turns ": lambda: equilibrium(MODEL, BOUNDARY, turns=value),
    }
    ways |= {} if value is None else {"Boundary: a rotation ": lambda: Boundary.of((np.zeros(3), value))}
    for words, way in ways.items():
        with pytest.raises(Scan2FlexError) as error:
            way()
        said = str(error.value)
        assert said.startswith(words) and ": give " in said and said.isprintable()


@pytest.mark.parametrize("value", [0, -1, 1.5, "8", True, np.nan, np.ones(3)])
def test_counts_are_whole_numbers(value):
    for name, least in (("elements", 2), ("max_steps", 1)):
        with pytest.raises(Scan2FlexError, match=f"{name} is .*: give a whole number of at least {least}"):
            equilibrium(MODEL, BOUNDARY, **{name: value})


def test_one_element_is_no_rod():
    for solve in (lambda: equilibrium(MODEL, BOUNDARY, elements=1), lambda: solve_rod(discretise(MODEL, BOUNDARY, 1))):
        with pytest.raises(Scan2FlexError, match="at least 2"):
            solve()


def test_numpy_counts_and_lists_of_traced_numbers_are_taken():
    found = equilibrium(MODEL, BOUNDARY, elements=np.int64(rods.ELEMENTS), max_steps=np.int32(100))
    assert found.verdict.solved and len(found.points) == rods.ELEMENTS + 1
    slope = jax.grad(lambda x: jnp.sum(Boundary.of(([0.0, x, 2.0 * x], None)).position))(0.3)
    assert slope == pytest.approx(3.0)


def test_a_start_is_a_configuration_of_this_rod():
    rod = discretise(MODEL, BOUNDARY, rods.ELEMENTS)
    short = Configuration(jnp.zeros((3, 3)), jnp.zeros((3, 3, 3)))
    for start, words in ((short, "positions of start has shape"), (np.zeros((13, 3)), "start is ndarray: give")):
        with pytest.raises(Scan2FlexError, match=words):
            solve_rod(rod, start)
