"""Ten million samples: drift at rest, memory, recovery of the observer (1 min).

python benchmarks/long_run.py [--samples N]

rest      change of position of an axis that is pushed below its breakaway level, after 1 s [m]
observer  recovery from readings that are lost for 1 to 500 samples, by that length: faults that
          did not move the estimate out of its usual error (99.9 % of the run on sound readings);
          of the others the largest distance from that run [increments], and samples until the
          error is its usual one again for good: median, 95 %, most
memory    bytes that a call returns and uses beyond, and that stay after many calls
"""

from __future__ import annotations

import argparse
import tracemalloc
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
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
    """Recovery of the observer from faults of one length; times in samples."""

    length: int
    count: int
    unhurt: int
    thrown: float  # [increments]
    median: float
    usually: float
    most: float
    lost: int  # faults after which it was not back within a second


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
        quantiles = np.quantile(times[~lost], (0.5, 0.95, 1.0)) if np.any(~lost) else np.zeros(3)
        found.append(
            Recovery(
                length, chosen.size, chosen.size - times.size, thrown / QUANTUM,
                *quantiles.tolist(), int(lost.sum()),
            )
        )  # fmt: skip
    return found, float(np.max(apart[:, -1]))


def main() -> None:
    """Print the three parts."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--samples", type=int, default=10_000_000)
    samples = parser.parse_args().samples
    for hold in ("zero", "first"):
        drift, switches = rest_drift(samples, hold)
        print(f"rest, hold {hold:6} drift {drift:g} m, {switches} switches")
    found, last = recoveries(samples)
    print("observer  " + "".join(f"{name:>9}" for name in Recovery._fields))
    for one in found:
        print("          " + "".join(f"{value:9.0f}" for value in one))
    print(f"          at the end {last:g} from the sound run")
    u = 12.0 * np.sin(3e-3 * np.arange(samples))
    design = dfc.design_pi_observer(AXIS, DT, encoder_quantum=QUANTUM)
    y = AXIS.simulate(u, DT).y[0].copy()
    few, plant = u[: max(1000, samples // 100)], AXIS.stepper(DT)
    for name, call in (
        ("simulate", lambda: AXIS.simulate(u, DT)),
        ("run", lambda: design.run(u, y)),
    ):
        one = footprint(call)
        print(f"memory    {name:9} returns {one.returned:.3g} bytes, {one.beyond:.3g} beyond")
    print(f"          kept after 20 runs: {kept(lambda: AXIS.simulate(few, DT), 20)} bytes")
    print(f"          kept after {few.size} steps: {kept(lambda: plant.step(9.0), few.size)} bytes")


if __name__ == "__main__":
    main()
