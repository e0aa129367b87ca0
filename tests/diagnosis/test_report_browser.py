"""The report of a diagnosis, as a browser shows it."""

from __future__ import annotations

import json
import re
import shutil
import subprocess

import pytest
from diagnosis_cases import among, driven

import dryfric_control as dfc

NAMES = ("chromium", "chromium-browser", "google-chrome")
BROWSER = next(filter(None, map(shutil.which, NAMES)), None)
pytestmark = pytest.mark.skipif(BROWSER is None, reason="no chromium on this machine")

FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--hide-scrollbars",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    # Whatever a page asks for, nothing leaves the machine.
    "--host-resolver-rules=MAP * ~NOTFOUND", )  # fmt: skip
# Goes into a copy of the page, and writes down what only the page can see.
PROBE = """
<script>addEventListener("load", () => {
  const page = document.documentElement, probe = document.createElement("script");
  probe.type = "application/json"; probe.id = "probe";
  probe.textContent = JSON.stringify({
    images: [...document.images].map(one => [one.complete, one.naturalWidth]),
    wide: page.scrollWidth - innerWidth});
  document.body.append(probe);
});</script>
"""


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """Page of a small diagnosis: a spring that nobody told of."""
    believed = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    machine = believed.replace(effects=(dfc.effects.Spring(stiffness=40.0, rest=0.05),))
    path = tmp_path_factory.mktemp("report") / "report.html"
    with among("spring", "gravity", "bias_force"):
        dfc.diagnose(believed, driven(machine, 6.0)).to_html(path)
    return path.read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("width", [1280, 400])
def test_the_report_is_shown_whole(report, tmp_path, width):
    """From disk, in a browser that has never run before."""
    copy = tmp_path / "copy.html"
    copy.write_text(report.replace("</head>", PROBE + "</head>"), encoding="utf-8")
    run = subprocess.run(
        [BROWSER, *FLAGS, f"--window-size={width},800", f"--user-data-dir={tmp_path / 'profile'}",
         "--enable-logging=stderr", "--dump-dom", "--virtual-time-budget=5000", copy.as_uri()],
        capture_output=True, text=True, timeout=120, check=True,
    )  # fmt: skip
    assert ":CONSOLE:" not in run.stderr
    found = re.search(r'<script type="application/json" id="probe">(.*?)</script>', run.stdout)
    seen = json.loads(found[1])
    assert len(seen["images"]) == report.count("<img ") >= 4
    # As large as a telephone is wide; no pixel that does not fit.
    assert all(complete and pixels >= 400 for complete, pixels in seen["images"])
    assert seen["wide"] <= 0
