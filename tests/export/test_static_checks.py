"""Static checks of exported C; what stays is argued in docs/howto/cortex_m.md."""

import re
import shutil
import subprocess
from pathlib import Path

import native
import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control.export import export_c

ROOT = Path(__file__).parents[2]
AXIS = native.random_axis(np.random.default_rng(0))
PAGE = (ROOT / "docs" / "howto" / "cortex_m.md").read_text(encoding="utf-8")
#: MISRA rules from which the page says why the code deviates.
ARGUED = set(re.findall(r"^\| (\d+\.\d+) \|", PAGE, flags=re.MULTILINE))


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    """Sources of one object of each kind, the compensation in single precision."""
    folder = tmp_path_factory.mktemp("static")
    plain = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, name="stage")
    inner = AXIS.replace(name="inner", effects=native._STRUCTURES[4](np.random.default_rng(0)))
    observer = dfc.design_pi_observer(AXIS, dt=1e-3, encoder_quantum=1e-6)
    objects = (AXIS, inner, observer, dfc.hybrid_filter(AXIS, 1e-3, 1e-6))
    comp = dfc.design_compensation(plain, dt=1e-3, encoder_quantum=1e-6)
    single = export_c(comp, folder / "single", "single")
    return [str(export_c(obj, folder)[1]) for obj in objects] + [str(single[1])]


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cppcheck") is None, reason="no cppcheck")
def test_cppcheck_finds_nothing_that_is_not_argued(sources):
    options = [
        "--std=c99", "--enable=warning,style,performance,portability", "--quiet",
        "--addon=misra", "--suppress=missingIncludeSystem", "--template={id} {file}:{line} {message}",
        "--suppress=unreadVariable", "--suppress=redundantInitialization",
        "--suppress=redundantAssignment",
    ]  # fmt: skip
    findings = []
    for source in sources:  # one program each
        done = subprocess.run(["cppcheck", *options, source], capture_output=True, text=True)
        findings += [line for line in done.stderr.splitlines() if re.match(r"[\w.-]+ /", line)]
    rules = {m[1] for line in findings if (m := re.match(r"misra-c2012-([\d.]+) ", line))}
    others = [line for line in findings if not line.startswith("misra-c2012-")]
    assert others == []
    assert rules <= ARGUED, [line for line in findings if "misra" in line]
    assert ARGUED <= rules | {"10.6", "10.8"}  # no deviation is argued that there is not


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("clang-tidy") is None, reason="no clang-tidy")
def test_clang_tidy_finds_nothing(sources):
    checks = (
        "-*,bugprone-*,cert-*,clang-analyzer-*,-bugprone-easily-swappable-parameters,"
        "-bugprone-implicit-widening-of-multiplication-result,-clang-analyzer-deadcode.DeadStores"
    )
    done = subprocess.run(
        ["clang-tidy", "--quiet", f"--checks={checks}", *sources[1:3], "--", "-std=c99"],
        capture_output=True, text=True,
    )  # fmt: skip
    assert "warning:" not in done.stdout, done.stdout
