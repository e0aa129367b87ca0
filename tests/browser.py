"""A browser without a window: what it shows of a page from disk."""

import shutil
import subprocess

import pytest

NAMES = "chromium", "chromium-browser", "google-chrome"
BROWSER = next(filter(None, map(shutil.which, NAMES)), None)
needs_browser = pytest.mark.skipif(BROWSER is None, reason="no chromium on this machine")
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--hide-scrollbars",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    # Whatever a page asks for, nothing leaves the machine.
    "--host-resolver-rules=MAP * ~NOTFOUND", "--enable-logging=stderr", "--dump-dom",
    "--virtual-time-budget=5000",
)  # fmt: skip


def rendered(address, folder, width=1280):
    """The page as its scripts leave it, in a browser that has never run before."""
    place = (f"--window-size={width},800", f"--user-data-dir={folder}", address)
    run = subprocess.run(
        [BROWSER, *FLAGS, *place], capture_output=True, text=True, timeout=120, check=True
    )
    assert ":CONSOLE:" not in run.stderr
    return run.stdout
