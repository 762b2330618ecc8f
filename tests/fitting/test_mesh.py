"""A fit takes as many elements as the bends of its cable need, and says so."""

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from scan2flex_jax import Boundary, Cable, CableModel, Study, equilibrium, fit, predict
from scan2flex_jax.errors import NotSettledError
from scan2flex_jax.fitting.problem import FIT_ELEMENTS
from scan2flex_jax.inference import mesh
from scan2flex_jax.posterior.settings import USUAL

from . import scenes

EI = 5.7e-4  # N m^2: EI/(w L^3) of 3e-4, bends of 17.0 mm
ALONG = [0.5, 0.5, 0.5, 0.5]  # d3 = +x
SOFT = "80 elements in place of 40: bends of 17 mm are shorter than elements of 25 mm"
CABLE = {"length": 1.0, "length_density": 0.2, "torsional_stiffness": EI}


@pytest.fixture(scope="module")
def soft():
    """One plane pose of a soft cable, measured to 0.1 mm."""
    clamps = ((np.zeros(3), ALONG), (np.array([0.6, 0.0, 0.0]), ALONG))
    e = equilibrium(CableModel(Cable(1.0, 0.2, EI, EI), [0.0, 0.0, -9.81]), Boundary.of(*clamps), elements=160)
    points = CubicHermiteSpline(e.s, e.points, e.configuration.R[:, :, 2])(scenes.STATIONS)
    points = points + 1e-4 * np.random.default_rng(0).standard_normal(points.shape)
    pose = {"points": points, "start": clamps[0], "end": clamps[1], "noise": 1e-4}
    return Study.from_arrays(CABLE, [pose], ["bending_stiffness"], title="soft")


@pytest.mark.slow
def test_a_soft_cable_is_fitted_with_more_elements_which_the_fit_says(soft):
    f = fit(soft)
    assert f.problem.elements == 80
    assert f.mesh == (SOFT,)
    assert SOFT in f.summary()
    assert SOFT in f.to_json()["messages"]
    e = f.estimates["bending_stiffness"]
    assert e.low < EI < e.high
    (prediction,) = predict(f.calibrated).values()
    assert prediction.sentence() == f"stable equilibrium; {SOFT}"
    assert prediction.to_json()["messages"] == [SOFT]


def test_a_number_of_elements_is_used_as_given(soft):
    """And is doubted if it is too small."""
    f = fit(soft, elements=FIT_ELEMENTS)
    assert f.problem.elements == FIT_ELEMENTS
    assert "(80 are needed)" in f.mesh[0]


def test_poses_that_too_few_elements_cannot_solve_are_fitted_with_more(soft):
    """The stiffness is then that of the start, from the balance of the measured curve."""
    made = []

    def make(n):
        made.append(n)
        return mesh.Problem(soft, n)

    def first(problem, _):
        if problem.elements == FIT_ELEMENTS:
            raise NotSettledError("no values in the range let every pose settle", "check clamps", {})
        return mesh.Found(problem, problem.minimise("least-squares"))

    found, chosen = mesh.on_enough_elements(make, [first], None, lambda message: None, USUAL)
    assert made[0] == FIT_ELEMENTS
    assert chosen.elements == found.problem.elements == made[-1] > FIT_ELEMENTS
    with pytest.raises(NotSettledError):
        mesh.on_enough_elements(make, [first], FIT_ELEMENTS, lambda message: None, USUAL)
