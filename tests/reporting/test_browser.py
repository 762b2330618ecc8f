"""The page in a browser without a window: it loads, draws every figure, and its console stays empty."""

import re
import shutil
import subprocess

import pytest

from scan2flex_jax.reporting import report
from tests.reporting.scenes import explained

pytest.importorskip("plotly", reason="the report needs the extra [report]")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed: apt-get install chromium"),
]
HINT = "willReadFrequently"  # about reading pixels back fast, of plotly's own drawing in space


def opened(file, width, profile):
    """The page's elements after its scripts have run, and what its console says."""
    options = ["--headless=new", "--no-sandbox", f"--user-data-dir={profile}", "--use-angle=swiftshader"]
    options += ["--enable-unsafe-swiftshader", "--disable-extensions", "--disable-background-networking", "--no-first-run"]
    options += ["--enable-logging=stderr", f"--window-size={width},900", "--virtual-time-budget=10000", "--dump-dom"]
    done = subprocess.run([CHROMIUM, *options, f"file://{file}"], capture_output=True, text=True, timeout=900, check=False)
    said = [line for line in done.stderr.splitlines() if "CONSOLE" in line and HINT not in line]
    return done.stdout, said


@pytest.mark.parametrize("width", [1280, 500])
def test_every_figure_is_drawn(fitted, tmp_path, width):
    file = tmp_path / "report.html"
    file.write_text(report(explained(fitted)), "utf-8")
    page, said = opened(file, width, tmp_path / "profile")
    assert said == []
    count = page.count("data-figure=")
    assert count == 13  # shapes, errors, correlation, evidence, load, 4 residuals and 4 of forces
    assert re.search(r'<html[^>]* data-drawn="(\d+)"', page)[1] == str(count)
    assert page.count('class="main-svg"') >= count
    assert "<canvas" in page  # the poses in space
    assert 'class="error"' not in page


def test_a_fault_would_be_seen(tmp_path):
    file = tmp_path / "fault.html"
    file.write_text("<script>nothing.here()</script>", "utf-8")
    assert opened(file, 800, tmp_path / "profile")[1]
