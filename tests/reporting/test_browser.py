"""The page in a browser without a window: nothing is cut off on a narrow screen, it prints on two pages, its script runs.

Chromium does not make its own window narrower than 500 px: pages are read in a frame of 420 px.
"""

import json
import re
import shutil
import subprocess

import pytest

from scan2flex_jax.reporting import report
from tests.reporting.scenes import explained

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed: apt-get install chromium"),
]
HINT = "willReadFrequently"  # about reading pixels back fast, of plotly's own drawing in space
MEASURE = """<!doctype html><body style="margin: 0"><iframe id="f" style="width: %dpx; height: 9000px; border: 0"></iframe>
<script>
const frame = document.getElementById("f");
frame.onload = function () {
  const page = frame.contentDocument, wide = %d;
  const out = Array.from(page.body.querySelectorAll("*")).filter(function (e) {
    const box = e.getBoundingClientRect();
    return box.width > 0 && !e.closest("svg g") && (box.right > wide + 0.5 || box.left < -0.5);
  });
  document.title = [page.documentElement.scrollWidth, page.querySelectorAll("figure svg").length,
    out.map(function (e) { return e.tagName + "." + e.getAttribute("class"); }).join(" ")].join("|");
};
frame.srcdoc = %s;
</script>"""


def run(profile, *options):
    """Chromium without a window; its standard output, and what its console says."""
    common = ["--headless=new", "--no-sandbox", f"--user-data-dir={profile}", "--use-angle=swiftshader", "--no-first-run"]
    common += ["--enable-unsafe-swiftshader", "--disable-extensions", "--disable-background-networking"]
    common += ["--enable-logging=stderr", "--virtual-time-budget=10000"]
    done = subprocess.run([CHROMIUM, *common, *options], capture_output=True, text=True, timeout=900, check=False)
    return done.stdout, [line for line in done.stderr.splitlines() if "CONSOLE" in line and HINT not in line]


@pytest.fixture(scope="module")
def plain(fitted):
    """The page of an explanation; a policy of its own would forbid the script that measures it."""
    return report(explained(fitted))


@pytest.mark.parametrize("width", [420, 1400])
def test_nothing_is_cut_off(plain, tmp_path, width):
    page = json.dumps(re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", plain)).replace("</", "<\\/")
    (tmp_path / "measure.html").write_text(MEASURE % (width, width, page), "utf-8")
    window = f"--window-size={max(width, 500)},1000"
    dom, said = run(tmp_path / "profile", window, "--dump-dom", f"file://{tmp_path / 'measure.html'}")
    assert said == []
    scroll, figures, beyond = re.search(r"<title>(.*?)</title>", dom)[1].split("|")
    assert int(scroll) <= width and beyond == ""
    # 4 shapes, errors, evidence, 4 residuals, load, 4 of forces, correlations
    assert int(figures) == plain.count("<figure>") == 16


def test_it_prints_as_two_pages(plain, tmp_path):
    (tmp_path / "report.html").write_text(plain, "utf-8")
    sheet = f"--print-to-pdf={tmp_path / 'sheet.pdf'}"
    run(tmp_path / "profile", "--no-pdf-header-footer", sheet, f"file://{tmp_path / 'report.html'}")
    assert len(re.findall(rb"/Type\s*/Page\b(?!s)", (tmp_path / "sheet.pdf").read_bytes())) == 2


def test_the_poses_in_space_are_drawn(fitted, tmp_path):
    pytest.importorskip("plotly", reason="an interactive report needs the extra [report]")
    (tmp_path / "report.html").write_text(report(fitted, interactive=True), "utf-8")
    page, said = run(tmp_path / "profile", "--window-size=1280,900", "--dump-dom", f"file://{tmp_path / 'report.html'}")
    assert said == []
    assert re.search(r'<html[^>]* data-drawn="1"', page)
    assert "<canvas" in page
    assert 'class="error"' not in page


def test_a_fault_would_be_seen(tmp_path):
    (tmp_path / "fault.html").write_text("<script>nothing.here()</script>", "utf-8")
    assert run(tmp_path / "profile", "--dump-dom", f"file://{tmp_path / 'fault.html'}")[1]
