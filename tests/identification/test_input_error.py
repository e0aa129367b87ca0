"""Noise of a recorded input makes no mass too large; a force that acts is no such noise."""

import importlib

import numpy as np
import pytest
import truth

import dryfric_control as dfc
from dryfric_control.estimation.scoring import maximise
from dryfric_control.identification.input_error import input_bias

fitting = importlib.import_module("dryfric_control.identification.fit")


def steps(noise, acts, seed=0):
    """A pushed axis whose recorded drive has white noise, which acts on it or does not."""
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    rng = np.random.default_rng(seed)
    u = 15.0 * np.sign(np.sin(7.0 * 1e-3 * np.arange(4000) + 1e-9)) + 3.0
    pushed = noise * rng.standard_normal(u.size)
    x = axis.simulate(u + acts * pushed, dt=1e-3).y[0]
    return axis, dfc.Record(1e-3 * np.arange(u.size), u + pushed, 1e-6 * np.round(1e6 * x))


def found(axis, record):
    problem = fitting.problem_of(axis, [record], ("mass", "viscous", "coulomb"))
    return maximise(problem, problem.start(0.1), 10)


def test_what_is_recorded_but_does_not_act_biases_the_mass_alone():
    """Least squares of u on a: noise s^2 beside a spread S^2 of the drive makes s^2/S^2."""
    axis, record = steps(3.0, False)
    end = found(axis, record)
    normals = end.curvature() * end.information[:, :3, :3].sum(axis=0)
    step = np.linalg.solve(normals, input_bias(end).sum(axis=0))
    # The search coordinate of the mass is its logarithm.  3 N beside 15 N, of which friction and
    # its model explain a part: 4 % over what they leave.
    assert -0.15 < step[0] < -0.02
    assert abs(end.z[0] + step[0] - np.log(2.0)) < 0.5 * abs(end.z[0] - np.log(2.0))


def test_noise_that_acts_on_the_axis_biases_nothing():
    end = found(*steps(3.0, True))
    assert np.abs(input_bias(end).sum(axis=0)).max() == pytest.approx(0.0, abs=1e-3)


@pytest.mark.slow
def test_masses_of_noisy_drives_are_covered():
    """Records whose masses were off by 2.6 to 3.6 standard errors: noise of a fifth of the level."""
    for seed in (2, 3, 7):
        case = truth.make_null(seed, "short")
        a = case.actual
        rng = np.random.default_rng([seed, 77])
        u = case.u + 0.2 * a["coulomb"] * rng.standard_normal(case.u.size)
        axis = dfc.FrictionAxis(
            mass=a["mass"], viscous=a["viscous"], coulomb=a["coulomb"],
            stribeck=dfc.Stribeck(**a["stribeck"]) if a["stribeck"] else None,
            stick_speed=a["stick_speed"], travel=a["travel"],
        )  # fmt: skip
        record = dfc.Record(case.t, u, case.x, quantum=case.quantum)
        low, high = dfc.fit(axis.replace(mass=1.1 * a["mass"]), record, starts=1).interval()["mass"]
        assert low <= a["mass"] <= high
