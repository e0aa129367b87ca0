"""An installation that nobody may write, for a user without a home."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

import dryfric_control
from dryfric_control.compiled import windowed_runs
from dryfric_control.compiled.cached import njit
from dryfric_control.compiled.windowed_runs import accelerations

PROGRAM = """
from numba.core import caching

given = [c for c in caching.CacheImpl._locator_classes if "UserProvided" in c.__name__]
assert len(given) == 1
caching.CacheImpl._locator_classes = given
caching.CompileResultCacheImpl._locator_classes = given

import warnings
with warnings.catch_warnings(record=True) as told:
    warnings.simplefilter("always")
    import dryfric_control.compiled
print([str(w.message) for w in told if "NUMBA_CACHE_DIR" in str(w.message)])

import numba
from dryfric_control.compiled.axis_step import polynomial
print(polynomial.stats.cache_path == "" or polynomial.stats.cache_path)
"""


def run(**environment):
    keep = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    keep["PYTHONPATH"] = str(Path(dryfric_control.__file__).parents[1])
    program = [sys.executable, "-c", PROGRAM]
    done = subprocess.run(program, env=keep | environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_imports_and_says_what_to_set(tmp_path):
    told, folder = run(TMPDIR=str(tmp_path))
    assert "NUMBA_CACHE_DIR" in told and "written" in told
    assert folder.startswith(str(tmp_path))
    assert not list(tmp_path.iterdir())  # gone with the process


def test_says_nothing_where_a_folder_is_given(tmp_path):
    told, folder = run(NUMBA_CACHE_DIR=str(tmp_path))
    assert told == "[]" and folder.startswith(str(tmp_path))


def test_processes_write_files_of_their_own(tmp_path):
    # With equal names, two that compile a function for other types at once would leave an index
    # that gives the code for the types of the other.
    program = (
        "import numpy as np\n"
        "from dryfric_control.compiled.axis_step import polynomial\n"
        "polynomial(np.ones(2), 0, 2, 1.0)\n"
        "assert not sum(polynomial.stats.cache_hits.values())\n"
    )
    names = []
    for folder in (tmp_path / "one", tmp_path / "other"):
        environment = os.environ | {
            "NUMBA_CACHE_DIR": str(folder),
            "PYTHONPATH": str(Path(dryfric_control.__file__).parents[1]),
        }
        subprocess.run([sys.executable, "-c", program], env=environment, check=True)
        names.append({path.name for path in folder.rglob("*.polynomial-*.nbc")})
    assert all(names)
    assert names[0].isdisjoint(names[1])


def test_a_function_is_compiled_once_whatever_constants_it_is_called_with():
    @njit
    def scaled(x, factor):
        return factor * x

    @njit
    def summed(x, factor):
        return scaled(x, 2) + scaled(x, 3) + scaled(x, factor)

    assert summed(1.0, 4) == 9.0
    assert len(scaled.signatures) == 1


def test_accelerations_are_compiled_once_for_all_kinds_of_arrays():
    axis = dryfric_control.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    numbers, integers = axis.arrays(1e-3).numbers, axis.arrays(1e-3).integers
    t, u, way = np.zeros(3), np.full(3, 30.0), np.ones(3, np.int64)
    states = np.arange(12.0).reshape(3, 4).T  # rows that are not contiguous
    fixed = np.ones(3)
    fixed.flags.writeable = False
    for x, v in ((fixed, fixed), (np.ones(3), np.ones(3)), (states[0], np.ones(3))):
        rates = accelerations(numbers, integers, t, x, v, u, np.empty(0), way)
        np.testing.assert_allclose(rates, (30.0 - 8.0 - 15.0) / 2.0)
    assert len(windowed_runs._accelerations.signatures) == 1
