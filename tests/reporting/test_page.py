"""The report: what stands in the page, that nothing of a study can act in it, and that it asks for no network."""

import json
import re
import sys
from dataclasses import replace
from decimal import Decimal
from html.parser import HTMLParser

import numpy as np
import pytest

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.inference import Explanation, Law, Reading
from scan2flex_jax.reporting import report
from scan2flex_jax.reporting.contents import contents_of
from scan2flex_jax.reporting.parts import laws, stiffness
from scan2flex_jax.results.along import StiffnessAlong
from scan2flex_jax.results.answer import moved_in_words
from scan2flex_jax.study.mistakes import Mistake
from tests.reporting.scenes import EVIL, explained


class Page(HTMLParser):
    """Tags, texts and scripts of a page, each script with its attributes."""

    def __init__(self, text):
        super().__init__(convert_charrefs=True)
        self.tags, self.texts, self.scripts, self.inside = [], [], [], None
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        self.inside = tag
        if tag == "script":
            self.scripts.append([dict(attributes), ""])

    def handle_endtag(self, tag):
        self.inside = None

    def handle_data(self, data):
        if self.inside == "script":
            self.scripts[-1][1] += data
        elif self.inside != "style":
            self.texts.append(data)

    def figures(self):
        """The figures by name."""
        given = [(a["id"], text) for a, text in self.scripts if a.get("type") == "application/json"]
        return {name.removesuffix("-data"): json.loads(text) for name, text in given}

    def words(self):
        """All text that is seen."""
        return " ".join(" ".join(self.texts).split())


@pytest.fixture(scope="module")
def text(fitted):
    return report(fitted)


@pytest.fixture(scope="module")
def shown(text):
    return Page(text)


@pytest.fixture(scope="module")
def tie(fitted):
    """The page of an explanation that is tied."""
    return Page(report(explained(fitted)))


@pytest.fixture(scope="module")
def interactive(fitted):
    pytest.importorskip("plotly", reason="an interactive report needs the extra [report]")
    return Page(report(fitted, interactive=True))


def headings(shown):
    """Identities of header and sections, in their order."""
    return [a["id"] for tag, a in shown.tags if tag in ("header", "section")]


def test_the_answer_stands_first_and_correlations_last(fitted, shown, tie):
    assert headings(shown) == ["answer", "poses", "errors", "sections", "next", "details", "again"]
    assert headings(tie) == ["answer", "poses", "errors", "missing", "sections", "details", "again"]
    words = shown.words()
    order = [words.index(said) for said in ("EI", "N m^2", "GJ", "Rests on", "Unseen poses", "Shapes, measured")]
    assert words.rindex("Correlations") > words.index("What to scan next")
    assert order == sorted(order)
    for said in (fitted.answer.rest, fitted.answer.unseen, fitted.answer.belief):
        assert " ".join(said.split()) in words


def test_a_plain_report_needs_no_script_and_no_extra(shown, fitted, monkeypatch):
    monkeypatch.setitem(sys.modules, "plotly", None)
    monkeypatch.setitem(sys.modules, "jinja2", None)
    assert not Page(report(fitted)).scripts
    with pytest.raises(Scan2FlexError, match=r"scan2flex_jax\[report\]"):
        report(fitted, interactive=True)
    assert not shown.scripts


def test_texts_of_a_study_are_text(shown, interactive):
    """Only the page's own scripts stand in it, and the title is read as it was written."""
    for page_ in (shown, interactive):
        assert EVIL in page_.words()
        assert not any(tag == "b" and a for tag, a in page_.tags)
        assert not any(name.startswith("on") for _, attributes in page_.tags for name in attributes)
    kinds = [a.get("type") for a, _ in interactive.scripts]
    assert kinds == ["application/json", None, None]  # the figure, plotly, and the page's own
    own = [script for a, script in interactive.scripts if a.get("type") is None and len(script) < 20_000]
    assert "alert(" not in "".join(own)
    # plotly reads names as HTML of its own: they are escaped for it
    names = [trace["name"] for figure in interactive.figures().values() for trace in figure["data"] if "name" in trace]
    assert any("&lt;script&gt;" in name for name in names)
    assert not any("<" in name for name in names)


def test_nothing_comes_from_a_network(shown, interactive):
    for page_ in (shown, interactive):
        policy = next(a["content"] for tag, a in page_.tags if tag == "meta" and a.get("http-equiv"))
        assert policy.startswith("default-src 'none';")
        assert not re.search(r"(?:https?:|//|\*)", policy)
        assert ("script-src" in policy) == (page_ is interactive)
        assert not any(tag in ("link", "img", "iframe", "object", "base", "form") for tag, _ in page_.tags)
        assert not any("src" in a or ("href" in a and not a["href"].startswith("#")) for _, a in page_.tags)


def test_every_pose_has_its_panels_and_words(fitted, shown):
    labels = [a["aria-label"] for tag, a in shown.tags if tag == "svg"]
    assert [label for label in labels if label.startswith("shape of")] == [f"shape of pose {name}" for name in fitted.poses]
    others = {"errors of all poses along the cable", "correlations of the estimates", "torque (N m) along the cable"}
    assert others <= set(labels)
    assert all(a.get("viewbox") and "width" not in a for tag, a in shown.tags if tag == "svg")  # as wide as the page lets it be
    names = [name for name, p in fitted.poses.items() if p.role == "fit"]
    for name in names:
        moved = moved_in_words(fitted.influence, name)
        assert re.fullmatch(r"EI [+-]?<?[\d.]+ %, GJ [+-]?<?[\d.]+ %", moved)
        assert moved in shown.words()


def test_the_figures_in_space_show_the_fit(fitted, interactive):
    figures = interactive.figures()
    assert set(figures) == {"shapes-in-space"}
    traces = figures["shapes-in-space"]["data"]
    scene = figures["shapes-in-space"]["layout"]["scene"]
    low, high = np.transpose([scene[f"{k}axis"]["range"] for k in "xyz"])
    sides = np.array([scene["aspectratio"][k] for k in "xyz"])
    np.testing.assert_allclose(sides / sides.max(), (high - low) / (high - low).max())  # true to scale
    for t in traces:
        points = np.stack([numbers(t[k]) for k in "xyz"], axis=1)
        assert np.all((low < points) & (points < high)), t["name"]
    for k, (name, pose) in enumerate(fitted.poses.items()):
        own = [t for t in traces if t["meta"] == k]
        assert [t["mode"] for t in own] == ["markers", "lines", "lines+markers", "lines+markers"], name
        np.testing.assert_allclose(np.max(numbers(own[0]["marker"]["color"])), 1e3 * pose.worst)
        np.testing.assert_allclose(numbers(own[1]["x"]), pose.modelled[:, 0])


def numbers(value):
    """An array of a figure, which plotly writes as base64."""
    if isinstance(value, list):
        return np.array(value)
    import base64

    return np.frombuffer(base64.b64decode(value["bdata"]), value["dtype"])


def test_section_forces_carry_the_weight(shown):
    """Vertical reactions of the supports add up to the weight of the cable, 0.2 kg/m times 1 m."""
    at = shown.words().index("force on the cable (N), scan frame")
    found = re.findall(r"(start|end) (-?[\d.]+) (-?[\d.]+) (-?[\d.]+)", shown.words()[at:])
    assert len(found) == 8
    for (a, *_, z0), (b, *_, z1) in zip(found[::2], found[1::2], strict=True):
        assert (a, b) == ("start", "end")
        assert float(z0) + float(z1) == pytest.approx(0.2 * 9.81, abs=0.01)


def test_estimates_versions_and_inputs_are_there(fitted, shown):
    words = shown.words()
    for name, estimate in fitted.estimates.items():
        shown_as = re.search(rf"{name} (\S+) (\S+) to (\S+)", words).groups()
        rounded = [float(v) for v in shown_as]
        for text, true in zip(shown_as, (estimate.value, estimate.low, estimate.high), strict=True):
            assert abs(float(text) - true) <= 0.501 * 10.0 ** Decimal(text).as_tuple().exponent  # half of the last digit
        width = estimate.high - estimate.low  # digits enough to show the interval
        np.testing.assert_allclose(rounded, [estimate.value, estimate.low, estimate.high], rtol=0, atol=0.15 * width)
        assert rounded[1] < rounded[0] < rounded[2]
    assert "scan2flex report simulated-cable -o report.html --no-explain --elements 40" in words
    for name in ("jax", "numpy", "plotly", "plane.csv", "study.toml"):
        assert name in words


def pictures(shown):
    return {a["aria-label"] for tag, a in shown.tags if tag == "svg"}


def test_an_explanation_brings_its_evidence_and_the_tie(tie):
    load = "equivalent load along the cable"
    assert {"comparison of the hypotheses", "residual of pose twist-90"} <= pictures(tie)
    assert load not in pictures(tie)  # nothing remains to be placed
    words = tie.words()
    assert "tied: kink or natural curvature" in words
    assert "tied with natural_curvature" in words
    assert "kink: look at the cable" in words
    assert "position 0.42 m; angle (0.1, 0, 0) rad; width 0.02 m" in words
    assert "baseline fit: validate poses" in words


def test_evidence_is_not_shown_where_nothing_is_concluded(fitted):
    found = explained(fitted, "not in equilibrium")
    shown = Page(report(found))
    assert "comparison of the hypotheses" not in pictures(shown)
    assert {"equivalent load along the cable", "residual of pose twist-90"} <= pictures(shown)
    assert "natural_curvature" not in found.summary().split("tied with")[0]
    assert "log evidence" not in found.summary() + shown.words()


def test_a_study_that_could_not_be_solved_is_shown_as_measured(fitted):
    bare = Explanation(study=fitted.study, verdict="not in equilibrium", sentences=("no values let every pose settle",))
    shown = Page(report(bare))
    assert headings(shown)[:2] == ["answer", "poses"] and pictures(shown) == {
        f"shape of pose {pose.name} as it was measured" for pose in fitted.study.poses
    }
    assert "not in equilibrium" in shown.words()
    assert "no values let every pose settle" in shown.words()


def test_a_likely_mistake_stands_at_the_head(fitted):
    mistake = Mistake("gravity points the other way", "write gravity = [0, 0, -9.81]", fitted.study, 0.2, 0.001)
    for subject in (
        replace(fitted, mistakes=(mistake,), sentences=(str(mistake),)),
        Explanation(study=fitted.study, verdict="unexplained", sentences=(str(mistake),), mistakes=(mistake,)),
    ):
        words = Page(report(subject)).words()
        assert "the input is likely mistaken" in words
        assert mistake.mend in words


def test_a_law_has_its_panel_and_what_is_read_off_it(fitted):
    """Declared laws stand before what the model lacks; a fit without one has no such section."""
    at = np.linspace(0.0, 5.0, 11)
    knee = Reading("knee", 2.0, 1.8, 2.2, "1/m")
    law = Law("bending_law", at, 0.1 * at, 0.09 * at, 0.11 * at, at < 3.0, 0.1, 0.001, True, (knee,))
    contents = contents_of(replace(fitted, laws=(law,)), next_pose=False)
    (section,) = laws(contents)
    shown = Page(section)
    assert "not linear up to 2.5 1/m" in shown.words()
    assert "1.8 to 2.2" in shown.words()
    assert [a["aria-label"] for tag, a in shown.tags if tag == "svg"] == ["moment of the bending_law"]
    assert "not reached by a pose" in shown.words()
    assert list(laws(replace(contents, fit=fitted))) == []


def test_a_stiffness_that_varies_is_shown_with_its_values(fitted):
    """A fit without one has no such section."""
    s = np.linspace(0.05, 0.95, 10)
    along = StiffnessAlong(s, np.geomspace(1.0, 0.1, 10), np.geomspace(0.9, 0.05, 10), np.geomspace(1.1, 0.2, 10), np.ones(10))
    contents = contents_of(replace(fitted, along=along), next_pose=False)
    (section,) = stiffness(contents)
    assert "EI along the cable (N m^2): 1 [0.9, 1.1] at 0.05 m" in section and "<svg" in section
    assert list(stiffness(replace(contents, fit=fitted))) == []
