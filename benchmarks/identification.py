"""What identification reaches: on the bench, on EMPS, on a servo pendulum.

    python benchmarks/identification.py [coverage | emps | bam] [--repeats 200]

Prints tables; every figure comes from the run.  Records are read from
../shared/data and left out with a word where they are not at hand.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from pathlib import Path

import numpy as np
from scipy.signal import butter, decimate, filtfilt

import dryfric_control as dfc
from dryfric_control.identification import FitWarning, fit, identify_coulomb, replay_loop
from dryfric_control.records import Record, read_bam, read_record

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT.parent / "shared" / "data"
sys.path.insert(0, str(ROOT / "tests"))
import truth  # noqa: E402  (the independent bench lives with the tests)


def coverage(repeats: int) -> None:
    """Share of 90 % intervals that cover the truth, over seeded repeats."""
    names = ("mass", "viscous", "coulomb")
    rows: dict[str, list[bool]] = {}
    start = time.perf_counter()
    for seed in range(repeats):
        case = truth.make_null(seed, "short")
        rng = np.random.default_rng(seed)
        # Noise above what the generator's own time steps leave in its record.
        noisy = case.x + 20e-6 * rng.standard_normal(case.x.size)
        a = case.actual
        axis = dfc.FrictionAxis(
            mass=1.1 * a["mass"],
            viscous=a["viscous"],
            coulomb=a["coulomb"],
            stribeck=dfc.Stribeck(**a["stribeck"]) if a["stribeck"] else None,
            stick_speed=a["stick_speed"],
            travel=a["travel"],
        )
        found = fit(axis, Record(case.t, case.u, noisy, quantum=0.0), names, starts=1)
        for kind, ends in (("jackknife", found.interval()), ("bootstrap", found.bootstrap())):
            for name in names:
                hit = ends[name][0] <= a[name] <= ends[name][1]
                rows.setdefault(f"fit: {name}, {kind}", []).append(hit)
        record, level = crawl(seed)
        levels = identify_coulomb(record, degree=2, axis=BENCH)
        for place in (0.05, 0.15, 0.25):
            for s in (1, -1):
                low, high = levels.band([place], s)
                hit = bool(low[0] <= level(place, s) <= high[0])
                rows.setdefault("Coulomb map, six places", []).append(hit)
    print(f"90 % intervals over {repeats} repeats ({time.perf_counter() - start:.0f} s)")
    for name, hits in rows.items():
        print(f"  {name:32s} {100 * np.mean(hits):5.1f} %")


BENCH = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, travel=(0.0, 0.3))


def crawl(seed: int):  # type: ignore[no-untyped-def]
    """Smooth crawl of the independent bench, and its true level."""
    rng = np.random.default_rng(seed)
    plant = truth.Plant(
        mass=2.0, viscous=15.0, coulomb=8.0, asymmetry=0.1, slope=0.2, curvature=-0.1,
        middle=0.15, half_travel=0.15,
    )  # fmt: skip
    n = 20_000
    t = 1e-3 * np.arange(n)
    reference = np.interp(t, [0.0, 10.0, 20.0], [0.0, 0.3, 0.0])
    zero = np.zeros(n)
    noise = 5e-6 * rng.standard_normal(n)
    u, y, _ = truth.closed_loop(
        plant, reference, 1e-3, 30, 288.0, 576.0, 19.2, 3e-3, 40.0, 5e-6, noise, zero, zero, zero
    )

    def level(x: float, s: int) -> float:
        q = (x - 0.15) / 0.15
        return float(8.0 * (1.0 + 0.1 * s) * (1.0 + 0.2 * q - 0.1 * q**2))

    return Record(t, u, y, reference, quantum=5e-6), level


def force_error(axis: dfc.FrictionAxis, record: Record) -> float:
    """Relative force error [%]: zero-phase Butterworth at 100 Hz, decimated by 10.

    ||u - (m a + friction(x, v) - effects)|| / ||u||, with filtered position and
    central differences; with these numbers least squares on the whole record
    gives back the published parameters.
    """
    from dryfric_control.identification.start import forces

    b, a = butter(4, 2.0 * 100.0 * record.dt)
    x = filtfilt(b, a, record.x)
    v = np.gradient(x, record.dt)
    acceleration = np.gradient(v, record.dt)
    direction = np.where(v > 0.0, 1, -1)
    needed = axis.mass * acceleration - forces(axis, x, v, np.zeros_like(v), direction)
    thin = [decimate(y, 10, zero_phase=True)[7:-7] for y in (record.u, needed)]
    return float(100.0 * np.linalg.norm(thin[0] - thin[1]) / np.linalg.norm(thin[0]))


def emps() -> None:
    """EMPS: parameters, held-out errors, relative force errors."""
    path = DATA / "emps" / "DATA_EMPS.mat"
    if not path.exists():
        print("EMPS: no record at", path)
        return
    record = read_record(path)
    train, test = record.split(0.6)
    loop = dfc.PositionController(
        kp=160.18 * 243.45 * 35.1507, ki=0.0, kd=243.45 * 35.1507, dt=1e-3, limit=351.507, span=2
    )
    published = dfc.FrictionAxis(
        mass=95.11, viscous=203.5, coulomb=20.39, effects=(dfc.BiasForce(3.16),)
    )
    print(f"EMPS: published parameters, force error {force_error(published, record):.2f} %")
    believed = dfc.FrictionAxis(mass=70.0, viscous=100.0, coulomb=10.0)
    mapped = believed.replace(coulomb=dfc.CoulombMap([10.0, 0.0, 0.0]), travel=(-0.01, 0.26))
    base = ("mass", "viscous", "coulomb", "bias_force")
    sided = (*base, "viscous_asymmetry")
    for title, axis, free in (
        ("symmetric", believed, base),
        ("asymmetric Coulomb", believed, ("mass", "viscous", "coulomb_plus", "coulomb_minus")),
        ("asymmetric", believed, sided),
        ("asymmetric, input shift", believed, (*sided, "input_shift")),
        ("asymmetric, input lag", believed, (*sided, "actuator_lag")),
        ("asymmetric, map over position", mapped,
         ("mass", "viscous", "coulomb_map", "viscous_asymmetry")),
        ("asymmetric, Stribeck", believed, (*sided, "stribeck")),
    ):  # fmt: skip
        start = time.perf_counter()
        found = fit(axis, train, free)
        seconds = time.perf_counter() - start
        print(f"\n{title} ({seconds:.1f} s)")
        print(found.summary())
        print("held out:", found.replay(test).summary())
        print(replay_loop(found.axis, record, loop).summary())
        print(
            f"relative force error: trained {force_error(found.axis, train):.2f} %, held "
            f"out {force_error(found.axis, test):.2f} %, whole record "
            f"{force_error(found.axis, record):.2f} %, and with windows of 0.1 s on all of it "
            f"{force_error(fit(axis, record, free, window=0.1).axis, record):.2f} %"
        )


def bam() -> None:
    """Servo pendulum: fitted at kp = 100, tested at kp = 400."""
    logs = [read_bam(path) for path in sorted((DATA / "bam_xl330").glob("*.json"))]
    if not logs:
        print("BAM: no logs at", DATA / "bam_xl330")
        return

    def enabled(log):  # type: ignore[no-untyped-def]
        off = np.flatnonzero(~log["torque_enable"])
        return log["record"][: int(off[0])] if off.size else log["record"]

    # u is in V: gain = kt/R, and back-EMF kt^2/R is part of the viscous term.
    hanging = 0.49 * 9.81 * 0.1
    axis = dfc.FrictionAxis(
        mass=0.49 * 0.1**2, viscous=0.1, coulomb=0.05, stick_speed=1e-2, units=("rad", "N m"),
        effects=(dfc.Gravity(hanging), dfc.InputGain(0.2)),
    )  # fmt: skip
    free = ("mass", "viscous", "coulomb", "input_gain", "gravity.phase")
    for title, start_axis, names in (
        ("gravity, back-EMF, Coulomb", axis, free),
        ("and input delay", axis, (*free, "input_delay")),
        ("and Stribeck", axis, (*free, "input_delay", "stribeck")),
    ):
        begun = time.perf_counter()
        found = fit(start_axis, [enabled(g) for g in logs if g["kp"] == 100], names)
        print(f"\nBAM: {title} ({time.perf_counter() - begun:.1f} s)")
        print(found.summary())
        for log in logs:
            if log["kp"] != 400:
                continue
            record = enabled(log)
            whole = found.axis.simulate(record.u, record.dt, x0=float(record.x[0]))
            error = float(np.sqrt(np.mean((whole.y[0] - record.x) ** 2)))
            print(f"test {log['trajectory']}: {found.replay(record).summary()}; "
                  f"whole log {error:.3g} rad")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", nargs="*", default=["emps", "bam", "coverage"])
    parser.add_argument("--repeats", type=int, default=200)
    options = parser.parse_args()
    warnings.simplefilter("ignore", FitWarning)  # they are in the summaries
    for what in options.what:
        {"emps": emps, "bam": bam, "coverage": lambda: coverage(options.repeats)}[what]()


if __name__ == "__main__":
    main()
