"""The report: what stands in the page, that nothing of a study can act in it, and that it asks for no network."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from scan2flex_jax.diagnosis import Explanation
from scan2flex_jax.reporting import page, report, save_report
from scan2flex_jax.study.mistakes import Mistake
from tests.reporting.scenes import EVIL, explained

pytest.importorskip("plotly", reason="the report needs the extra [report]")


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


def test_texts_of_a_study_are_text(text, shown):
    """Only the page's own scripts stand in it, and the title is read as it was written."""
    kinds = [a.get("type") for a, _ in shown.scripts]
    assert kinds.count(None) == 2  # plotly, and the page's own
    assert set(kinds) == {None, "application/json"}
    assert "alert(" not in "".join(script for a, script in shown.scripts if a.get("type") is None and len(script) < 20_000)
    assert EVIL in shown.words()
    assert not any(tag == "b" for tag, _ in shown.tags)
    assert not any(name.startswith("on") for _, attributes in shown.tags for name in attributes)
    # plotly reads names as HTML of its own: they are escaped for it
    names = [trace["name"] for figure in shown.figures().values() for trace in figure["data"] if "name" in trace]
    assert any("&lt;script&gt;" in name for name in names)
    assert not any("<" in name for name in names)


def test_nothing_comes_from_a_network(text, shown):
    policy = next(a["content"] for tag, a in shown.tags if tag == "meta" and a.get("http-equiv"))
    assert policy.startswith("default-src 'none';")
    assert not re.search(r"(?:https?:|//|\*)", policy)
    assert not any(tag in ("link", "img", "iframe", "object", "base", "form") for tag, _ in shown.tags)
    assert not any("src" in a or ("href" in a and not a["href"].startswith("#")) for _, a in shown.tags)


def test_the_figures_show_the_fit(fitted, shown):
    figures = shown.figures()
    assert set(figures) == {"shapes", "errors-figure", "correlation", "section-1", "section-2", "section-3", "section-4"}
    drawn = [a["id"] for _, a in shown.tags if "data-figure" in a]
    assert sorted(drawn) == sorted(figures)
    traces = figures["shapes"]["data"]
    scene = figures["shapes"]["layout"]["scene"]
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
    np.testing.assert_allclose(
        numbers(figures["errors-figure"]["data"][0]["y"]).max(), 1e3 * next(iter(fitted.poses.values())).worst
    )


def numbers(value):
    """An array of a figure, which plotly writes as base64."""
    if isinstance(value, list):
        return np.array(value)
    import base64

    return np.frombuffer(base64.b64decode(value["bdata"]), value["dtype"])


def test_section_forces_carry_the_weight(shown):
    """Vertical reactions of the supports add up to the weight of the cable, 0.2 kg/m times 1 m."""
    at = shown.words().index("force (N), scan frame")
    found = re.findall(r"(start|end) (-?[\d.]+) (-?[\d.]+) (-?[\d.]+)", shown.words()[at:])
    assert len(found) == 8
    for (a, *_, z0), (b, *_, z1) in zip(found[::2], found[1::2], strict=True):
        assert (a, b) == ("start", "end")
        assert float(z0) + float(z1) == pytest.approx(0.2 * 9.81, abs=0.01)


def test_estimates_versions_and_inputs_are_there(fitted, shown):
    words = shown.words()
    for name, estimate in fitted.estimates.items():
        rounded = [float(v) for v in re.search(rf"{name} (\S+) (\S+) to (\S+)", words).groups()]
        np.testing.assert_allclose(rounded, [estimate.value, estimate.low, estimate.high], rtol=1e-6)
        assert rounded[1] < rounded[0] < rounded[2]  # digits enough to show the interval
    assert "scan2flex report simulated-cable -o report.html --no-explain --elements 40" in words
    for name in ("jax", "numpy", "plotly", "plane.csv", "study.toml"):
        assert name in words
    assert "what the model lacks" not in words.lower().split("were left out")[0].split("reproduction")[0][:2000]


def test_an_explanation_brings_its_evidence_and_the_tie(fitted, monkeypatch):
    shown = Page(report(explained(fitted)))
    assert {"evidence", "load", "residual-1", "residual-4"} <= set(shown.figures())
    words = shown.words()
    assert "tied: kink or natural curvature" in words
    assert "kink (tied with natural_curvature)" in words
    assert "kink: look at the cable" in words
    assert "position 0.42; angle [0.1, 0, 0]; width 0.02" in words
    assert "plain fit: validate poses" in words
    alone = explained(fitted)
    alone = replace(alone, chosen=(replace(alone.chosen[0], tied_with=()),))
    assert "tied: kink or something outside the catalogue" in Page(report(alone)).words()
    colours = {t["line"]["color"] for t in shown.figures()["residual-1"]["data"]}
    assert len(colours) == 2  # before and after


def test_evidence_is_not_shown_where_nothing_is_concluded(fitted):
    found = explained(fitted, "not in equilibrium")
    shown = Page(report(found))
    assert "evidence" not in shown.figures()
    assert {"load", "residual-1"} <= set(shown.figures())
    assert "natural_curvature" not in found.summary().split("tied with")[0]
    assert "log evidence" not in found.summary() + shown.words()


def test_a_study_that_could_not_be_solved_is_shown_as_measured(fitted):
    bare = Explanation(study=fitted.study, verdict="not in equilibrium", sentences=("no values let every pose settle",))
    shown = Page(report(bare))
    assert set(shown.figures()) == {"shapes"}
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


def test_a_report_is_written_whole(fitted, text, tmp_path, monkeypatch):
    monkeypatch.setattr(page, "report", lambda subject, **options: text)
    file = save_report(fitted, tmp_path / "deep" / "report.html")
    assert file.read_text("utf-8") == text
    assert list(file.parent.iterdir()) == [file]


def test_a_missing_library_is_one_sentence(monkeypatch):
    def gone(name):
        raise ImportError(name)

    monkeypatch.setattr(page, "import_module", gone)
    with pytest.raises(Exception, match=r"scan2flex_jax\[report\]"):
        page.require_libraries()
