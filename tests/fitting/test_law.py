"""The law of a fit: shapes of a cable whose law is known give it back with its band, and say what kind of law it is."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest

from scan2flex_jax import plot
from scan2flex_jax.errors import Scan2FlexError, StudyError
from scan2flex_jax.inference.fitting import fit
from scan2flex_jax.posterior.quantities import laws_of
from scan2flex_jax.study import EffectDeclaration, Unknown, load_study, save_study

from . import scenes

NOISE, SLIP = 1e-3, 1.0
LAWS = {"linear": 1.0, "softening": 0.3, "slipping": 0.02}  # stiffness left far above the slip curvature
GRID = np.linspace(1.0, 8.0, 8)


ALL = (*scenes.BOTH, Unknown("bending_law.factor"))


def with_law(unknowns=ALL, **parameters):
    return scenes.study_of(unknowns, effects=[EffectDeclaration("bending_law", {"curvature": GRID, **parameters})])


LAWS_SEEN = ["softening", *(pytest.param(law, marks=pytest.mark.slow) for law in ("linear", "slipping"))]


@pytest.fixture(scope="module", params=LAWS_SEEN)
def found(request):
    """The name of a law, and the fit of shapes that another effect type made with it."""
    truth = EffectDeclaration("nonlinear_bending", {"slip_curvature": SLIP, "ratio": LAWS[request.param]})
    elements = scenes.ELEMENTS * (2 if request.param == "slipping" else 1)  # it bends sharply at its clamps
    curves = scenes.exact_curves(scenes.study_of(effects=[truth]), scenes.TRUE, elements=elements)
    return request.param, fit(scenes.measured(with_law(), curves, noise=NOISE, seed=3, stated=NOISE), elements=elements)


def true_moment(name, q):
    ratio = LAWS[name]
    return scenes.EI * q * (ratio + (1 - ratio) / np.sqrt(1 + (q / SLIP) ** 2))


def test_the_band_holds_the_law_over_the_curvatures_reached(found):
    name, result = found
    (law,) = result.laws
    truth, inside = true_moment(name, law.at), law.reached & (law.at > 0)
    assert np.mean((law.low <= truth)[inside] & (truth <= law.high)[inside]) > 0.9
    assert np.max(np.abs(law.moment - truth)[inside]) < 0.05 * np.max(truth[inside])
    assert np.mean((law.high - law.low)[inside] / truth[inside]) < 0.2


def test_linear_is_said_of_the_linear_law_alone(found):
    name, result = found
    (law,) = result.laws
    assert law.linear == (name == "linear")
    (said,) = [s for s in result.sentences if s.startswith("bending_law")]
    assert ("not linear" in said) == (name != "linear")
    assert said in scenes.summary_of(result)


def test_what_is_read_off_has_the_truth_in_its_interval(found):
    """Softening over the range reached, its knee and the moment there, each as the module defines it."""
    name, result = found
    (law,) = result.laws
    read = {r.name: r for r in law.readings}
    if name == "linear":
        assert read == {}
        return
    q = np.linspace(0.0, law.at[law.reached][-1], 4000)
    slope = LAWS[name] + (1 - LAWS[name]) * (1 + (q / SLIP) ** 2) ** -1.5
    end = np.mean(slope[q >= 0.5 * q[-1]])
    knee = q[np.argmax(np.log(slope) <= 0.5 * np.log(end))]
    truth = {"softening": end, "knee": knee, "break-point moment": true_moment(name, knee)}
    if name == "slipping":
        flat = q[slope < 0.2]
        truth["slip plateau"] = np.mean(true_moment(name, flat))
    assert set(read) == set(truth)
    for what, value in truth.items():  # a grid of 1/m sees a knee no finer than a part of that
        assert 0.9 * read[what].low < value < 1.1 * read[what].high, (what, value, read[what])


def test_curvatures_that_no_pose_reached_are_marked(found):
    _, result = found
    (law,) = result.laws
    curvature = max(float(np.max(curvatures(p.modelled))) for p in result.poses.values())
    assert 0.95 * curvature < law.at[law.reached][-1] < 1.4 * curvature  # chords cut the bend at a clamp short
    assert law.at[-1] == pytest.approx(max(GRID[-1], law.at[law.reached][-1]), rel=0.05)


def curvatures(points):
    """Curvature (1/m) of a fine curve at its nodes."""
    d = np.diff(points, axis=0)
    t = d / np.linalg.norm(d, axis=1, keepdims=True)
    return np.linalg.norm(np.diff(t, axis=0), axis=1) / np.linalg.norm(d, axis=1)[:-1]


def test_the_result_holds_the_law(found):
    _, result = found
    (law,), (told,) = result.laws, result.to_json()["laws"]
    assert told["kind"] == "bending_law"
    np.testing.assert_array_equal(told["moment"], law.moment)
    assert told["linear"] == law.linear
    assert len(told["curvature"]) == len(told["low"]) == len(told["high"]) == len(told["reached"])
    factor = result.estimates["bending_law.factor"]
    assert np.all((factor.low < factor.value) & (factor.value < factor.high))


def test_a_fit_that_has_not_settled_reports_no_law(found):
    _, result = found
    (law,) = laws_of(replace(result.posterior, converged=False))
    assert law.p_value is None
    assert law.sentences() == law.readings == ()


def test_a_fitted_law_is_saved_and_read_back(found, tmp_path):
    _, result = found
    save_study(result.calibrated, tmp_path)
    again = load_study(tmp_path)
    np.testing.assert_allclose(again.effects[0].parameters["factor"], result.estimates["bending_law.factor"].value)


def test_the_law_is_drawn_with_its_band(found):
    _, result = found
    ax = plot.law(result)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("curvature (1/m)", "moment (N m)")
    assert "95 % band" in ax.get_legend_handles_labels()[1]
    with pytest.raises(Scan2FlexError, match="declares no torsion_law"):
        plot.law(result, "torsion_law")
    plt.close(ax.figure)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"curvature": [2.0]}, "got 1 point: give at least 2"),
        ({"curvature": [1.0, 3.0, 2.0]}, "does not grow from point 2"),
        ({"curvature": [0.0, 3.0, 4.0]}, "give a value above zero"),
        ({"factor": np.ones(3)}, "write a list of 8 numbers"),
    ],
)
def test_a_grid_that_is_none_is_refused(change, message):
    with pytest.raises(StudyError, match=message):
        fit(with_law(**change))


@pytest.mark.parametrize("said", [{"range": (0.1, 2.0)}, {"prior": {"mean": 1.0, "std": 0.1}}])
def test_a_law_takes_no_range_and_no_prior_but_its_own(said):
    given = {"low": said["range"][0], "high": said["range"][1]} if "range" in said else said
    with pytest.raises(StudyError, match="smoothness prior of their own"):
        fit(with_law((*scenes.BOTH, Unknown("bending_law.factor", **given))))


def test_a_law_that_is_given_is_no_finding():
    study = with_law(scenes.BOTH, factor=np.linspace(1.0, 0.4, 8))
    curves = scenes.exact_curves(study, scenes.TRUE)
    result = fit(scenes.measured(study, curves, noise=NOISE, stated=NOISE), elements=scenes.ELEMENTS)
    (law,) = result.laws
    assert law.p_value is None
    assert not law.linear
    assert law.sentences() == law.readings == ()
    assert "p_value" not in law.to_json()
    assert result.estimates["bending_stiffness"].low < scenes.EI < result.estimates["bending_stiffness"].high


@pytest.mark.slow
def test_a_strip_of_fabric_shows_softening():
    """It yields beside its clamp, and its stiffness falls a hundredfold. The other photograph alone leaves it undecided between
    a law and a deviation of its own."""
    study = scenes.example("textile-strip")
    law = EffectDeclaration("bending_law", {"curvature": np.geomspace(0.5, 40.0, 12)})
    unknowns = (*study.unknowns, Unknown("bending_law.factor"))
    pose = replace(study.pose("strip-a"), role="fit")
    (law,) = fit(replace(study, poses=(pose,), effects=(law,), unknowns=unknowns)).laws
    assert not law.linear
    softening = next(r for r in law.readings if r.name == "softening")
    assert softening.high < 0.2
    assert np.all(np.diff(law.moment) > 0)
