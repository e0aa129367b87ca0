"""Long runs: nothing drifts at rest, no memory is kept, the observer heals.

The same as ``benchmarks/long_run.py``, which does it over ten million samples.
"""

import long_run
import numpy as np
import pytest

import dryfric_control as dfc


@pytest.mark.parametrize("hold", ["zero", "first"])
def test_an_axis_at_rest_stays_where_it_is(hold):
    # not a bit: the position at rest is held, not summed up
    assert long_run.rest_drift(300_000, hold) == (0.0, 0)
    # Two per cent more break it away.
    level = 1.01 * float(long_run.AXIS.breakaway([0.0], 1)[0])
    assert long_run.AXIS.simulate(np.full(100, level), long_run.DT).mode[-1] == 1


def test_no_memory_is_needed_beyond_what_is_returned():
    u = 12.0 * np.sin(3e-3 * np.arange(200_000))
    found = long_run.footprint(lambda: long_run.AXIS.simulate(u, long_run.DT))
    # time, four outputs and the input; then the switches and python objects, some kilobytes
    assert found.returned == 6 * 8 * u.size
    assert found.beyond < 0.01 * found.returned
    design = dfc.design_pi_observer(long_run.AXIS, long_run.DT, encoder_quantum=long_run.QUANTUM)
    y = long_run.AXIS.simulate(u, long_run.DT).y[0].copy()
    found = long_run.footprint(lambda: dfc.observe(design, u, y))
    # time, five outputs, three states, two inputs; while it runs, outputs and inputs once more
    assert found.returned == 11 * 8 * u.size
    assert found.beyond < 7.1 * 8 * u.size


def test_nothing_is_kept_after_runs_and_steps():
    u = 12.0 * np.sin(3e-3 * np.arange(20_000))
    plant = long_run.AXIS.stepper(long_run.DT)
    # one result alone is 960 kB; interned numbers and the like are a few hundred bytes
    assert long_run.kept(lambda: long_run.AXIS.simulate(u, long_run.DT), 20) < 10_000
    assert long_run.kept(lambda: plant.step(9.0), 20_000) < 10_000


def test_the_observer_heals_after_dropped_and_stuck_readings():
    found, last = long_run.recoveries(400_000)
    assert sum(one.count for one in found) > 150
    for one in found:
        assert one.lost == 0
        # Ten million samples show 21 in the middle; the slowest take the whole next motion.
        assert one.median <= 50
    # and nothing of two hundred faults is left: the error decays, it does not add up
    assert last < 1e-12
    # a lost half second is a fault indeed
    assert found[-1].thrown > 100.0
