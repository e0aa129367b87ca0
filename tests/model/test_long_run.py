"""Long runs: nothing drifts at rest, no memory is kept, the observer heals."""

import tracemalloc
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

import dryfric_control as dfc

Array = NDArray[np.float64]

DT = 1e-3
QUANTUM = 1e-5
AXIS = dfc.FrictionAxis(
    mass=2.0, viscous=15.0, coulomb=8.0, stribeck=dfc.Stribeck(excess=0.3, speed=0.01)
)
#: Lengths of the faults [samples]; the last ones outlast most motions.
FAULTS = (1, 3, 10, 30, 100, 500)
#: Samples between the starts of two faults.
SPACING = 2000


def rest_drift(samples: int, hold: str = "zero") -> tuple[float, int]:
    """Largest change of position at rest after 1 s, and the number of switches."""
    level = 0.99 * float(AXIS.breakaway([0.0], 1)[0])
    u = level * np.sin(0.37 * np.arange(samples)) * np.sign(np.sin(0.011 * np.arange(samples)))
    run = AXIS.simulate(u, DT, x0=0.1, v0=0.5 * AXIS.stick_speed, hold=hold)
    x = run.y[0]
    return float(np.max(np.abs(x[1000:] - x[1000]))), len(run.events)


class Footprint(NamedTuple):
    """Bytes of a call: returned in arrays, and at most in use beyond them."""

    returned: int
    beyond: int


def footprint(call: Callable[[], Any]) -> Footprint:
    """What a call allocates, arrays included, as tracemalloc sees it."""
    call()
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    found = call()
    peak = tracemalloc.get_traced_memory()[1] - before
    tracemalloc.stop()
    owners = [a if a.base is None else a.base for a in (found.t, found.y, found.x, found.u)]
    returned = sum(array.nbytes for array in {id(one): one for one in owners}.values())
    return Footprint(returned, peak - returned)


def kept(call: Callable[[], Any], times: int) -> int:
    """Bytes in use after many calls whose results are thrown away."""
    call()
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    for _ in range(times):
        call()
    after = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    return after - before


def closed_loop(samples: int) -> tuple[Array, Array, Array]:
    """Drive, sound readings and true rows x, v, F, mode of crawls and steps."""
    t = np.arange(samples) * DT
    crawl = 0.02 * np.abs((0.1 * t) % 2.0 - 1.0)
    steps = np.where((t % 4.0) < 2.0, 0.0, 0.05)
    reference = np.where((t % 40.0) < 20.0, crawl, steps)
    controller = dfc.PositionController.from_bandwidth(AXIS, 20.0, DT)
    run = dfc.simulate_loop(AXIS, controller, reference, quantum=QUANTUM)
    return run.y[4], run.y[5], run.y[:4]


class Recovery(NamedTuple):
    """Recovery of the observer from faults of one length."""

    count: int
    thrown: float  # largest distance from the run on sound readings [increments]
    median: float  # samples until the error is its usual one again
    lost: int  # faults after which it was not within a second


def recoveries(samples: int) -> tuple[list[Recovery], float]:
    """Recovery by length of fault, and the distance from the sound run at the end."""
    u, y, truth = closed_loop(samples)
    design = dfc.design_pi_observer(AXIS, DT, encoder_quantum=QUANTUM)
    sound = design.run(u, y).y[:2]
    usual = np.quantile(np.abs(sound - truth[:2]), 0.999, axis=1)
    rng, bad = np.random.default_rng(1), y.copy()
    starts = np.arange(SPACING, y.size - 2 * SPACING, SPACING)
    starts = starts + rng.integers(0, SPACING // 4, starts.size)
    lengths = rng.choice(FAULTS, starts.size)
    for start, length in zip(starts, lengths, strict=True):
        bad[start : start + length] = y[start - 1]
    apart = np.abs(design.run(u, bad).y[:2] - sound)
    found = []
    for length in FAULTS:
        chosen = starts[lengths == length]
        # A second after each fault, which ends before the next.
        windows = [np.arange(a + length, a + length + SPACING // 2) for a in chosen]
        hurt = np.array([(apart[:, window] > usual[:, None]).any(axis=0) for window in windows])
        times = np.array([np.flatnonzero(row)[-1] + 1 for row in hurt if row.any()])
        thrown = max(
            apart[0, a : window[-1]].max() for a, window in zip(chosen, windows, strict=True)
        )
        lost = times == SPACING // 2
        median = float(np.median(times[~lost])) if np.any(~lost) else 0.0
        found.append(Recovery(chosen.size, thrown / QUANTUM, median, int(lost.sum())))
    return found, float(np.max(apart[:, -1]))


@pytest.mark.parametrize("hold", ["zero", "first"])
def test_an_axis_at_rest_stays_where_it_is(hold):
    # not a bit: the position at rest is held, not summed up
    assert rest_drift(300_000, hold) == (0.0, 0)
    # Two per cent more break it away.
    level = 1.01 * float(AXIS.breakaway([0.0], 1)[0])
    assert AXIS.simulate(np.full(100, level), DT).mode[-1] == 1


def test_no_memory_is_needed_beyond_what_is_returned():
    u = 12.0 * np.sin(3e-3 * np.arange(200_000))
    found = footprint(lambda: AXIS.simulate(u, DT))
    # time, four outputs and the input; then the switches and python objects, some kilobytes
    assert found.returned == 6 * 8 * u.size
    assert found.beyond < 0.01 * found.returned
    design = dfc.design_pi_observer(AXIS, DT, encoder_quantum=QUANTUM)
    y = AXIS.simulate(u, DT).y[0].copy()
    found = footprint(lambda: dfc.observe(design, u, y))
    # time, five outputs, three states, two inputs; while it runs, outputs and inputs once more
    assert found.returned == 11 * 8 * u.size
    assert found.beyond < 7.1 * 8 * u.size


def test_nothing_is_kept_after_runs_and_steps():
    u = 12.0 * np.sin(3e-3 * np.arange(20_000))
    plant = AXIS.stepper(DT)
    # one result alone is 960 kB; interned numbers and the like are a few hundred bytes
    assert kept(lambda: AXIS.simulate(u, DT), 20) < 10_000
    assert kept(lambda: plant.step(9.0), 20_000) < 10_000


def test_the_observer_heals_after_dropped_and_stuck_readings():
    found, last = recoveries(400_000)
    assert sum(one.count for one in found) > 150
    for one in found:
        assert one.lost == 0
        # Some 20 samples in the middle; the slowest take the whole next motion.
        assert one.median <= 50
    # and nothing of two hundred faults is left: the error decays, it does not add up
    assert last < 1e-12
    # a lost half second is a fault indeed
    assert found[-1].thrown > 100.0
