"""Diagnoses of measured machines whose truth is known from elsewhere.

    python benchmarks/diagnosis_real.py [emps] [laas] [pneumatic] [bam] [--time-limit S]

What is known about each record stands in ../shared/data/README.md.  EMPS, a linear
drive: every contiguous 40 % from the published symmetric model with its offset, tested by the
force residual on the rest.  LAAS, a motor's bench: cogging of 72 a turn.  Pneumatic: one
seal at four pressures, whose Coulomb level grows.  BAM, a servo pendulum: the logs at
kp = 100 together, tested on those at kp = 400.
"""

from __future__ import annotations

import argparse
import math
import time
import warnings
from pathlib import Path

import numpy as np

import dryfric_control as dfc
from dryfric_control.diagnosis import evidence

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
TORQUE = 0.025  # N m/A, which only sets the unit


def diagnosed(title: str, axis, record, **settings) -> dfc.Diagnosis:  # type: ignore[no-untyped-def]
    """A diagnosis, printed with its time."""
    begun, used = time.perf_counter(), time.process_time()
    d = dfc.diagnose(axis, record, **settings)
    print(f"{title} ({time.perf_counter() - begun:.0f} s, {time.process_time() - used:.0f} s of a "
          f"core)\n{d.summary()}", flush=True)  # fmt: skip
    return d


def emps(**settings) -> None:  # type: ignore[no-untyped-def]
    """Viscous asymmetry on every contiguous 40 %."""
    record = dfc.datasets.emps(DATA / "emps" / "DATA_EMPS.mat")
    axis = dfc.datasets.emps_axis()
    n = len(record)
    for start in (0.0, 0.2, 0.3, 0.6):
        a, b = round(start * n), round((start + 0.4) * n)
        rest = record[b:] if start < 0.5 else record[:a]
        d = diagnosed(f"EMPS, {100 * start:.0f} to {100 * start + 40:.0f} %", axis, record[a:b],
                      **settings)  # fmt: skip
        before, after = (evidence(one, rest).force_rms for one in (axis, d.extended))
        print(f"  mass {d.extended.mass:.2f} kg; held-out force residual {before:.2f} N before, "
              f"{after:.2f} N after")  # fmt: skip


def laas(**settings) -> None:  # type: ignore[no-untyped-def]
    """Cogging of 72 a turn on a motor's bench, 0.5 to 7.9 s."""
    rows = np.loadtxt(DATA / "laas_cogging" / "speed_test.txt", delimiter=",", skiprows=1)
    # 16001 rows in 16 s: the time column's first step is twice the others.
    record = dfc.Record(1e-3 * np.arange(len(rows)), TORQUE * rows[:, 4], rows[:, 1])[500:7900]
    axis = dfc.FrictionAxis(
        mass=7e-6, viscous=2e-5, coulomb=1e-3, stick_speed=1e-2, units=("rad", "N m")
    )
    d = diagnosed("LAAS, 0.5 to 7.9 s", axis, record, **settings)
    for cause in d.causes:
        if "cogging" in cause.effect:
            print(f"  {2.0 * math.pi / cause.parameters['period']:.3f} a turn, "
                  f"{cause.parameters['amplitude'] / TORQUE:.4f} A")  # fmt: skip
    print(f"  inertia over the nominal {d.extended.mass / axis.mass:.2f}")


def pneumatic(**settings) -> None:  # type: ignore[no-untyped-def]
    """Coulomb level of a seal at four pressures, which the bench moves."""
    records = []
    for pressure in (1, 3, 5, 7):
        rows = np.loadtxt(DATA / "pneumatic" / f"O-ring_{pressure}bar.csv", skiprows=15)
        rows = rows[np.concatenate(([True], np.diff(rows[:, 0]) > 0.0))]
        t = np.arange(rows[0, 0], rows[-1, 0], 10.0) * 1e-3
        u, x = (np.interp(1e3 * t, rows[:, 0], rows[:, i]) for i in (6, 4))
        # The force holds pressure times area, which its mean is but for friction.
        records.append(dfc.Record(t - t[0], u - np.mean(u), 1e-3 * x, quantum=4e-6))
    axis = dfc.FrictionAxis(mass=1.0, viscous=0.0, coulomb=7.0)
    d = diagnosed("pneumatic, four pressures", axis, records, known=("mass",), **settings)
    for level, known in zip(d.varies.get("coulomb", {}).get("values", ()), (5.4, 7.3, 8.8, 10.7),
                            strict=False):  # fmt: skip
        print(f"  level {level:.2f} N, known {known} N ({100 * (level / known - 1):+.0f} %)")


def bam(**settings) -> None:  # type: ignore[no-untyped-def]
    """Servo pendulum: the four logs at kp = 100 together, judged on those at kp = 400."""
    logs = [dfc.read_bam(path) for path in sorted((DATA / "bam_xl330").glob("*.json"))]

    def enabled(log):  # type: ignore[no-untyped-def]
        off = np.flatnonzero(~log["torque_enable"])
        return log["record"][: int(off[0])] if off.size else log["record"]

    axis = dfc.FrictionAxis(
        mass=0.49 * 0.1**2, viscous=0.1, coulomb=0.05, stick_speed=1e-2, units=("rad", "N m"),
        effects=(dfc.effects.Gravity(0.49 * 9.81 * 0.1), dfc.effects.InputGain(0.2)),
    )  # fmt: skip
    train = [enabled(g) for g in logs if g["kp"] == 100]
    test = [enabled(g) for g in logs if g["kp"] == 400]
    d = diagnosed("BAM, four logs at kp = 100", axis, train, known=("mass",), **settings)
    for title, one in (("nominal", axis), ("with the causes", d.extended)):
        windows = np.sqrt(np.mean([dfc.replay(one, r).rms ** 2 for r in test]))
        free = [one.simulate(r.u, r.dt, x0=float(r.x[0])).y[0] - r.x for r in test]
        whole = np.sqrt(np.mean([np.mean(e**2) for e in free]))
        print(
            f"  {title}, kp = 400: windows of 0.25 s {windows:.4f} rad, whole logs {whole:.3g} rad"
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", default=["emps", "laas", "pneumatic", "bam"])
    parser.add_argument("--time-limit", type=float, default=None)
    chosen = parser.parse_args()
    warnings.simplefilter("ignore", dfc.FitWarning)
    for name in chosen.names:
        {"emps": emps, "laas": laas, "pneumatic": pneumatic, "bam": bam}[name](
            time_limit=chosen.time_limit
        )
