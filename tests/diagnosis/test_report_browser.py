"""The report of a diagnosis, as a browser shows it."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from dataclasses import dataclass
from urllib.parse import urlsplit

import numpy as np
import pytest

import dryfric_control as dfc

NAMES = ("chromium", "chromium-browser", "google-chrome")
BROWSER = next(filter(None, map(shutil.which, NAMES)), None)
pytestmark = pytest.mark.skipif(BROWSER is None, reason="no chromium on this machine")

FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--hide-scrollbars",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    # Whatever a page asks for, nothing leaves the machine.
    "--host-resolver-rules=MAP * ~NOTFOUND", )  # fmt: skip
_OWN = "not an origin"
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


@dataclass(frozen=True)
class Seen:
    """What a browser makes of a page."""

    images: list[tuple[bool, int]]
    wide: int  # pixels that do not fit
    console: list[str]
    hosts: set[str]


def opened(page, folder, width=1000):
    """Open a page from disk in a browser that has never run before."""
    copy, log = folder / "copy.html", folder / "net.json"
    copy.write_text(page.replace("</head>", PROBE + "</head>"), encoding="utf-8")
    run = subprocess.run(
        [BROWSER, *FLAGS, f"--window-size={width},800", f"--user-data-dir={folder / 'profile'}", f"--log-net-log={log}",
         "--enable-logging=stderr", "--dump-dom", "--virtual-time-budget=5000", copy.as_uri()],
        capture_output=True, text=True, timeout=120, check=True,
    )  # fmt: skip
    found = re.search(r'<script type="application/json" id="probe">(.*?)</script>', run.stdout)
    told = json.loads(found[1])
    events = [one.get("params", {}) for one in json.loads(log.read_text("utf-8"))["events"]]
    # What the browser asks on its own account, such as the time, has no origin.
    asked = [one["url"] for one in events if one.get("initiator", _OWN) != _OWN]
    return Seen(
        [tuple(one) for one in told["images"]],
        told["wide"],
        [line for line in run.stderr.splitlines() if ":CONSOLE:" in line],
        {urlsplit(url).netloc for url in asked},
    )


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """Page of a small diagnosis: a spring that nobody told of."""
    believed = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    machine = believed.replace(effects=(dfc.effects.Spring(stiffness=40.0, rest=0.05),))
    t = 1e-3 * np.arange(6000)
    u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
    x = 1e-6 * np.round(1e6 * machine.simulate(u, dt=1e-3).y[0])
    path = tmp_path_factory.mktemp("report") / "report.html"
    dfc.diagnose(believed, dfc.Record(t, u, x)).to_html(path)
    return path.read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("width", [1280, 400])
def test_the_report_opens_without_a_network(report, tmp_path, width):
    seen = opened(report, tmp_path, width)
    assert seen.console == []
    assert seen.hosts == set()
    assert len(seen.images) == report.count("<img ") >= 4
    # As large as a telephone is wide.
    assert all(complete and pixels >= 400 for complete, pixels in seen.images)
    assert seen.wide <= 0
