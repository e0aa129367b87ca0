"""The same answers whatever the processor does with round-off, and with one thread or several."""

import functools
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnosis_cases import among, believed, record
from truth import make_case

import dryfric_control as dfc

#: Effects hidden in the ten records, and what is wrong with each.
RECORDS = (
    ("inertia", "coarse"), ("bias_force", "short"), ("spring", "short"), ("gravity", "coarse"),
    ("stribeck", "short"), ("quadratic_drag", "short"), ("cogging", "short"),
    ("load_dependence", "short"), ("input_delay", "short"), ("saturation", "short"),
)  # fmt: skip
CANDIDATES = (*(slug for slug, _ in RECORDS if slug != "inertia"), "coulomb_asymmetry", "drift")
#: Settings of the libraries, and the feature without which a processor cannot take them.
SETTINGS = {
    "OPENBLAS_CORETYPE=Sandybridge OPENBLAS_NUM_THREADS=1": "avx",
    "OPENBLAS_CORETYPE=Haswell": "avx2",
    "OPENBLAS_CORETYPE=SkylakeX": "avx512f",
}


def able(feature: str) -> bool:
    """Whether this processor is known to have a feature."""
    about = Path("/proc/cpuinfo")
    return about.exists() and feature in about.read_text().split()


def answers() -> list[dict[str, Any]]:
    """Verdict of each record, its causes, and their amounts with standard errors."""
    found = []
    for slug, condition in RECORDS:
        case = make_case(slug, 3, condition)
        with among(*CANDIDATES):
            d = dfc.diagnose(believed(case), record(case), jobs=1, progress=False)
        amounts = {
            f"{cause.effect}.{name}": (value, cause.standard_errors[name])
            for cause in d.causes
            for name, value in cause.parameters.items()
        }
        found.append({"hidden": slug, "verdict": d.verdict, "amounts": amounts})
    return found


@functools.cache
def answers_here() -> list[dict[str, Any]]:
    """Those of this process."""
    return json.loads(json.dumps(answers()))


@pytest.mark.long
@pytest.mark.parametrize("setting", SETTINGS)
def test_answers_do_not_depend_on_the_processor(setting):
    if not able(SETTINGS[setting]):
        pytest.skip(f"a processor without {SETTINGS[setting]} cannot run {setting}")
    given = dict(one.split("=") for one in setting.split())
    code = "import json, test_processors as t; print(json.dumps(t.answers()))"
    paths = [path for path in sys.path if path]
    run = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True, check=True,
        env=os.environ | given | {"PYTHONPATH": os.pathsep.join(paths)},
    )  # fmt: skip
    for here, there in zip(answers_here(), json.loads(run.stdout), strict=True):
        assert here["verdict"] == there["verdict"], here["hidden"]
        assert here["amounts"].keys() == there["amounts"].keys(), here["hidden"]
        for key, (amount, error) in here["amounts"].items():
            # A tenth of its standard error.
            assert abs(there["amounts"][key][0] - amount) < 0.1 * error, (here["hidden"], key)
        assert np.isfinite([amount for amount, _ in here["amounts"].values()]).all()
