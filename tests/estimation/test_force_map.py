"""The force that a model lacks, from the smoothed motion, against what was left out of it."""

import subprocess
import sys

import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control.estimation.smoothed_motion import SmoothedMotion, kernel_width

DT = 1e-3
AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)


def driven(machine, noise=0.0):
    t = DT * np.arange(6000)
    u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
    x = 1e-6 * np.round(1e6 * machine.simulate(u, dt=DT).y[0])
    return dfc.Record(t, u + noise * np.random.default_rng(0).standard_normal(t.size), x)


def test_a_right_model_lacks_next_to_nothing():
    found = driven(AXIS).force_map(AXIS)
    # Rounding of the readings is 3 % of the drive at most, and less in most samples.
    assert found.rms < 0.015 * found.drive_rms
    assert 0.5 < found.share_sliding < 1.0


@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_a_spring_that_is_missing_is_a_line_over_place(noise):
    spring = dfc.effects.Spring(stiffness=40.0, rest=0.05)
    found = driven(AXIS.replace(effects=(spring,)), noise).force_map(AXIS)
    for curve in found.curves["place"]:
        slope, constant = np.polyfit(curve.at, curve.force, 1)
        # The motion needs what the spring takes: the force -k (x - x0) acts beside the drive.
        assert slope == pytest.approx(-40.0, rel=0.03)
        assert constant == pytest.approx(2.0, abs=0.1)


def test_a_level_that_is_too_low_pushes_against_the_motion():
    found = driven(AXIS).force_map(AXIS.replace(coulomb=7.0))
    for curve in found.curves["velocity"]:
        assert np.median(curve.force) == pytest.approx(-curve.direction, abs=0.05)


def test_effects_of_the_axis_are_not_missing():
    delay = dfc.effects.InputDelay(delay=4e-3)
    record = driven(AXIS.replace(effects=(delay,)))
    late = record.force_map(AXIS.replace(effects=(delay,)))
    assert record.force_map(AXIS).rms > 4.0 * late.rms


def test_smoothing_widens_with_the_noise_of_the_readings():
    record = driven(AXIS)
    coarse = dfc.Record(record.t, record.u, 1e-4 * np.round(record.x / 1e-4))
    assert kernel_width(coarse, AXIS.mass) > 2.0 * kernel_width(record, AXIS.mass)


def test_spread_is_the_adjoint_of_smoothed():
    motion = SmoothedMotion.from_record(driven(AXIS), AXIS.mass)
    rng = np.random.default_rng(1)
    column, values = (
        rng.standard_normal((motion.x.size, 1)),
        rng.standard_normal(motion.places.size),
    )
    assert motion.smooth_columns(column)[:, 0] @ values == pytest.approx(
        column[:, 0] @ motion.spread(values), rel=1e-10
    )


def test_what_is_missing_is_no_part_of_a_drive_of_zero():
    x = AXIS.simulate(np.zeros(3000), dt=DT, v0=3.0).y[0]
    free = dfc.Record(DT * np.arange(3000), None, 1e-6 * np.round(1e6 * x))
    assert "N RMS, with no drive\n" in str(free.force_map(AXIS.replace(coulomb=6.0)))


def test_figures_have_units():
    found = driven(AXIS).force_map(AXIS)
    labels = [ax.get_xlabel() for ax in found.plot().axes.ravel()]
    assert labels == [
        "position [m]", "velocity [m/s]", "drive [N]", "Time [s]", "distance since reversal [m]",
    ]  # fmt: skip


def test_the_legend_says_what_the_bands_are():
    axes = driven(AXIS).force_map(AXIS).plot().axes.ravel()
    names = [text.get_text() for text in axes[0].get_legend().get_texts()]
    assert names == ["10 % to 90 % of the samples", "forwards", "backwards"]


def test_a_first_look_does_not_compile_what_moves_an_axis():
    """It takes half a minute of a core with an empty cache, and a picture needs none of it."""
    look = (
        "import dryfric_control as dfc\n"
        "from dryfric_control.compiled import axis_step\n"
        "record = dfc.datasets.belt_stage()\n"
        "record.check(dfc.axis_from(record)), record.force_map(), record.explore()\n"
        "assert axis_step.rigid_task.cache_info().currsize == 0\n"
    )
    subprocess.run([sys.executable, "-c", look], check=True)
