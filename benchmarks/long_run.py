"""Ten million samples: does the position at rest drift, does memory grow, does the observer heal?

Run ``python benchmarks/long_run.py``; ``--samples`` makes it shorter.  Three parts:

rest      an axis pushed to and fro below its breakaway level, at rest after a leftover speed;
          the position after the first second is compared bit by bit with all later ones.
memory    what a simulation and an observer run allocate beyond the arrays that they return,
          and what the process keeps after twenty of them and a million steps by hand.
observer  a crawl with stick-slip and steps in closed loop.  Every two seconds or so the encoder
          fails: it drops samples (the last reading stays) or sticks, for 1 to 500 samples.  The
          run is compared with one of the same observer on the sound readings: how far a fault
          throws it, and how long until it is back within the error that the sound run has with
          the truth in 99.9 % of all samples.

Times are those of one thread, compiled code warmed up.
"""

from __future__ import annotations

import argparse
import resource
import time
import tracemalloc
from dataclasses import dataclass

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
SPACING = 2000


# -------------------------------------------------------------------- rest


def rest_drift(samples: int, hold: str = "zero") -> tuple[float, int]:
    """Largest change of position at rest after 1 s, and the number of switches."""
    level = 0.99 * float(AXIS.breakaway([0.0], 1)[0])
    u = level * np.sin(0.37 * np.arange(samples)) * np.sign(np.sin(0.011 * np.arange(samples)))
    run = AXIS.simulate(u, DT, x0=0.1, v0=0.5 * AXIS.stick_speed, hold=hold)
    x = run.y[0]
    return float(np.max(np.abs(x[1000:] - x[1000]))), len(run.events)


# ------------------------------------------------------------------ memory


@dataclass(frozen=True)
class Footprint:
    """Bytes of a call: returned in arrays, and at most in use beyond them."""

    returned: int
    beyond: int


def footprint(call: object) -> Footprint:
    """What a call allocates, arrays included, as tracemalloc sees it."""
    call()  # type: ignore[operator]
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    found = call()  # type: ignore[operator]
    peak = tracemalloc.get_traced_memory()[1] - before
    tracemalloc.stop()
    arrays = {
        id(a.base if a.base is not None else a): a for a in (found.t, found.y, found.x, found.u)
    }
    returned = sum((a if a.base is None else a.base).nbytes for a in arrays.values())
    return Footprint(returned, peak - returned)


def kept(call: object, times: int) -> int:
    """Bytes in use after many calls whose results are thrown away."""
    call()  # type: ignore[operator]
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    for _ in range(times):
        call()  # type: ignore[operator]
    after = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    return after - before


# ---------------------------------------------------------------- observer


def motion(samples: int) -> tuple[Array, Array, Array]:
    """Drive, sound readings and true rows x, v, F, mode of a long closed loop."""
    t = np.arange(samples) * DT
    crawl = 0.02 * np.abs((0.1 * t) % 2.0 - 1.0)
    steps = np.where((t % 4.0) < 2.0, 0.0, 0.05)
    reference = np.where((t % 40.0) < 20.0, crawl, steps)
    controller = dfc.PositionController.from_bandwidth(AXIS, 20.0, DT)
    run = dfc.simulate_loop(AXIS, controller, reference, quantum=QUANTUM)
    return run.y[4], run.y[5], run.y[:4]


def faulty(y: Array, seed: int = 1) -> tuple[Array, Array, NDArray[np.int64]]:
    """Readings with faults: first sample and length of each."""
    rng = np.random.default_rng(seed)
    starts = np.arange(SPACING, y.size - 2 * SPACING, SPACING)
    starts = starts + rng.integers(0, SPACING // 4, starts.size)
    lengths = rng.choice(FAULTS, starts.size)
    bad = y.copy()
    for a, n in zip(starts, lengths, strict=True):
        bad[a : a + n] = y[a - 1]
    return bad, starts, lengths


@dataclass(frozen=True)
class Recovery:
    """Recovery of the observer from faults of one length.

    Attributes
    ----------
    length : int
        Samples of a fault.
    count, unhurt : int
        Faults of this length, and how many did not move the estimate out of its usual error.
    thrown : float
        Largest distance from the run on sound readings, in increments of the encoder.
    median, usually, most : float
        Middle, 95 % quantile and largest of the samples from the end of a fault until the
        error is its usual one again and stays so for a second; over the faults that hurt.
    lost : int
        Faults after which it was not back within that second.
    """

    length: int
    count: int
    unhurt: int
    thrown: float
    median: float
    usually: float
    most: float
    lost: int


def recoveries(samples: int) -> tuple[list[Recovery], float, float]:
    """Recovery by length of fault, seconds of the run, and the last distance."""
    u, y, truth = motion(samples)
    design = dfc.design_pi_observer(AXIS, DT, encoder_quantum=QUANTUM)
    sound = dfc.observe(design, u, y).y[:2]
    # Usual errors of position and speed: of the sound run against the truth.
    usual = np.quantile(np.abs(sound - truth[:2]), 0.999, axis=1)
    bad, starts, lengths = faulty(y)
    dfc.observe(design, u[:1000], bad[:1000])
    begin = time.perf_counter()
    hurt = dfc.observe(design, u, bad).y[:2]
    took = time.perf_counter() - begin
    found = []
    for length in FAULTS:
        thrown, times, lost, unhurt = 0.0, [], 0, 0
        chosen = starts[lengths == length]
        for a in chosen:
            # a second, which ends before the next fault
            window = slice(a + length, a + SPACING // 2 + length)
            apart = np.abs(hurt[:, window] - sound[:, window])
            thrown = max(
                thrown, float(np.max(np.abs(hurt[0, a : window.stop] - sound[0, a : window.stop])))
            )
            late = np.flatnonzero((apart > usual[:, None]).any(axis=0))
            if not late.size:
                unhurt += 1
            elif late[-1] == apart.shape[1] - 1:
                lost += 1
            else:
                times.append(int(late[-1]) + 1)
        found.append(
            Recovery(
                length, chosen.size, unhurt, thrown / QUANTUM,
                *(np.quantile(times, (0.5, 0.95, 1.0)) if times else np.zeros(3)).tolist(), lost,
            )
        )  # fmt: skip
    return found, took, float(np.max(np.abs(hurt[:, -1] - sound[:, -1])))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--samples", type=int, default=10_000_000)
    samples = parser.parse_args().samples
    print(f"rest, {samples} samples of {DT:g} s")
    for hold in ("zero", "first"):
        begin = time.perf_counter()
        drift, switches = rest_drift(samples, hold)
        took = time.perf_counter() - begin
        print(f"  hold {hold:6} drift {drift:g} m, {switches} switches, {took:.1f} s")

    print("observer: faults of the encoder, recovery in samples")
    print(
        f"  {'fault':>5} {'count':>6} {'unhurt':>7} {'thrown':>9} {'median':>7} "
        f"{'95 %':>5} {'most':>5} {'lost':>5}"
    )
    found, took, last = recoveries(samples)
    for one in found:
        print(
            f"  {one.length:>5} {one.count:>6} {one.unhurt:>7} {one.thrown:>5.0f} inc "
            f"{one.median:>7.0f} {one.usually:>5.0f} {one.most:>5.0f} {one.lost:>5}"
        )
    print(f"  {1e9 * took / samples:.0f} ns a sample; at the end {last:g} from the sound run")

    print("memory")
    u = 12.0 * np.sin(3e-3 * np.arange(samples))
    design = dfc.design_pi_observer(AXIS, DT, encoder_quantum=QUANTUM)
    y = AXIS.simulate(u, DT).y[0].copy()
    for name, call in (
        ("simulate", lambda: AXIS.simulate(u, DT)),
        ("observe", lambda: dfc.observe(design, u, y)),
    ):
        one = footprint(call)
        print(
            f"  {name:9} returns {one.returned / 2**20:.0f} MiB, {one.beyond / 2**20:.1f} MiB "
            f"beyond at most while it runs"
        )
    few = u[: max(1000, samples // 100)]
    plant = AXIS.stepper(DT)
    print(f"  kept after 20 runs: {kept(lambda: AXIS.simulate(few, DT), 20)} bytes")
    print(f"  kept after {few.size} steps by hand: {kept(lambda: plant.step(9.0), few.size)} bytes")
    largest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"  largest size of the process {largest:.0f} MiB")


if __name__ == "__main__":
    main()
