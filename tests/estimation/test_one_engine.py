"""Fits and identifications give the numbers that they gave before the engines were one.

`one_engine.json` holds what three engines gave, at the last commit that had them.  On
one processor every number has stayed the same to the last bit; on another, and with
another numba, sums of another order of rounding lead the searches along other paths
to the same end.  How close that is, the stopping rules say: a fit ends where the loss
falls by less than 1e-6 of itself, with the 4e3 samples here 0.06 standard errors.

Changed on purpose, the numbers are written anew by `python tests/estimation/test_one_engine.py`,
with tests/ and the package on PYTHONPATH.
"""

import json
from pathlib import Path

import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control.estimation.parameters import choose, typical
from dryfric_control.estimation.problem import CANDIDATE, Problem, minimise, narrowing, through
from dryfric_control.estimation.windows import cut
from dryfric_control.identification import slow_ramp_experiment

STORED = Path(__file__).with_name("one_engine.json")
BASE = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
PEAKED = BASE.replace(stribeck=dfc.Stribeck(0.3, 0.01))


def made(axis, size=4000, amplitudes=(20.0, 12.0), hold="zero"):
    """A record of an axis under two sines, read to 1 um."""
    t = 1e-3 * np.arange(size)
    u = amplitudes[0] * np.sin(6.0 * t) + amplitudes[1] * np.sin(17.0 * t + 1.0)
    return dfc.Record(t, u, 1e-6 * np.round(1e6 * axis.simulate(u, dt=1e-3, hold=hold).y[0]))


def numbers(found):
    """What a fit found."""
    return {"parameters": found.parameters, "errors": found.standard_errors}


def base():
    return numbers(dfc.fit(BASE.replace(mass=3.0, coulomb=5.0), made(BASE)))


def free_peak():
    start = PEAKED.replace(mass=2.4, stribeck=dfc.Stribeck(0.2, 0.02))
    free = ("mass", "viscous", "coulomb", "stribeck")
    return numbers(dfc.fit(start, made(PEAKED, amplitudes=(9.0, 6.0)), free, starts=2))


def two_records():
    axis = BASE.replace(effects=(dfc.effects.Presliding(distance=5e-5),))
    records = [made(axis, 2000, (a, 12.0), "first") for a in (20.0, 12.0)]
    free = ("mass", "coulomb", "input_shift")
    return numbers(dfc.fit(axis.replace(mass=2.3), records, free, starts=1, hold="first"))


def coulomb():
    level = dfc.CoulombMap(plus=(8.0, 10.0), minus=(9.0,))
    axis = BASE.replace(coulomb=level, travel=(0.0, 0.1))
    record = slow_ramp_experiment(axis, duration=10.0, quantum=1e-6).record
    found = dfc.identify_coulomb(record, degree=1).to_dict()
    return {side: found[side] for side in ("plus", "minus")}


def stribeck():
    axis = PEAKED.replace(travel=(0.0, 0.1))
    ramp = slow_ramp_experiment(axis, duration=20.0, quantum=1e-6)
    free = ("stribeck", "coulomb")
    bare = axis.replace(stribeck=None)
    return numbers(dfc.identify_stribeck(bare, ramp.record, free=free, starts=1).fit)


FITS = {"base": base, "free_peak": free_peak, "two_records": two_records, "stribeck": stribeck}


@pytest.fixture(scope="module")
def stored():
    return json.loads(STORED.read_text())


def same_end(found, stored, reach):
    """Whether parameters are within part of their standard errors of the stored ones."""
    assert found["parameters"].keys() == stored["parameters"].keys()
    for name, value in stored["parameters"].items():
        error = stored["errors"][name]
        assert found["parameters"][name] == pytest.approx(value, abs=reach * error, rel=1e-9)
        # The standard error is that of the same place, its slopes taken as far apart.
        assert found["errors"][name] == pytest.approx(error, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("name", FITS)
@pytest.mark.filterwarnings("ignore")
def test_a_fit_ends_where_it_did(name, stored):
    same_end(FITS[name](), stored[name], 0.1)


def test_identified_levels_are_the_same(stored):
    # Least squares without a search: only rounding is left.
    found = coulomb()
    for side in ("plus", "minus"):
        assert found[side] == pytest.approx(stored["coulomb"][side], rel=1e-6)


def test_both_schedules_end_at_the_same_place():
    # A known shift, which both must find: 0.3 samples late.
    late = made(BASE)
    u = np.interp(late.t, late.t + 3e-4, late.u)
    x = 1e-6 * np.round(1e6 * BASE.simulate(u, dt=1e-3).y[0])
    windows = cut(dfc.Record(late.t, late.u, x))
    free = ("mass", "viscous", "coulomb", "input_shift")
    axis, parameters = choose(BASE.replace(mass=2.2, coulomb=7.0), free, typical([windows.record]))
    problem = Problem(axis, parameters, [windows])
    z = minimise(problem, problem.start)
    errors = 1.0 / np.sqrt(np.diag(problem.terms(z, problem.evaluate(z))[1].sum(axis=0)))
    quick = Problem(axis, parameters, [windows])
    every = np.ones(len(windows), bool)
    scales = narrowing(quick, quick.start, every)
    found = through(quick, quick.start, every, scales, CANDIDATE._replace(iterations=25, rounds=2))
    # The quick one stops where the loss falls by 0.1 + 1e-4 of itself: 0.7 standard errors.
    assert np.all(np.abs(found.z - z) < 0.7 * errors)
    assert problem.values(z)["input_shift"] == pytest.approx(3e-4, rel=0.02)


def test_a_descent_whose_time_is_over_stays_where_it_is():
    record = made(BASE, 2000)
    axis, parameters = choose(BASE.replace(mass=3.0), ["mass"], typical([record]))
    problem = Problem(axis, parameters, [cut(record)])
    assert minimise(problem, problem.start)[0] != problem.start[0]
    problem.until = 0.0
    assert minimise(problem, problem.start)[0] == problem.start[0]


if __name__ == "__main__":
    made_anew = {name: fit() for name, fit in FITS.items()} | {"coulomb": coulomb()}
    STORED.write_text(json.dumps(made_anew, indent=1) + "\n")
