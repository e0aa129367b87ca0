"""Diagnoses of measured machines whose truth is known from elsewhere.

    python benchmarks/diagnosis_real.py [emps] [laas] [pneumatic] [bam] [--time-limit S]

What is known about each record stands in ../shared/data/README.md.  EMPS, a linear
drive: every contiguous 40 % from the published symmetric model with its offset, tested by the
force residual on the rest.  LAAS, a motor's bench: cogging of 72 a turn.  Pneumatic: one
seal at four pressures, whose Coulomb level grows.  BAM, a servo pendulum: the logs at
kp = 100 together, tested on those at kp = 400.
"""

from __future__ import annotations

import math
import time
import warnings
from argparse import Namespace

import measured
import numpy as np
from harness import DATA, print_tables

import dryfric_control as dfc
from dryfric_control.diagnosis import evidence

TORQUE = 0.025  # N m/A, which only sets the unit


def diagnosed(title: str, axis, record, given: Namespace, **settings) -> dfc.Diagnosis:  # type: ignore[no-untyped-def]
    """A diagnosis, printed with its time."""
    used = time.process_time()
    d = dfc.diagnose(axis, record, time_limit=given.time_limit, **settings)
    print(f"{title} ({time.process_time() - used:.0f} s of a core)\n{d.summary()}", flush=True)
    return d


def emps(given: Namespace) -> None:
    """Viscous asymmetry on every contiguous 40 %."""
    record = dfc.datasets.emps(measured.EMPS)
    axis = dfc.datasets.emps_axis()
    n = len(record)
    for start in (0.0, 0.2, 0.3, 0.6):
        a, b = round(start * n), round((start + 0.4) * n)
        rest = record[b:] if start < 0.5 else record[:a]
        title = f"EMPS, {100 * start:.0f} to {100 * start + 40:.0f} %"
        d = diagnosed(title, axis, record[a:b], given)
        before, after = (evidence(one, rest).force_rms for one in (axis, d.extended))
        print(f"  mass {d.extended.mass:.2f} kg; held-out force residual {before:.2f} N before, "
              f"{after:.2f} N after")  # fmt: skip


def laas(given: Namespace) -> None:
    """Cogging of 72 a turn on a motor's bench, 0.5 to 7.9 s."""
    rows = np.loadtxt(DATA / "laas_cogging" / "speed_test.txt", delimiter=",", skiprows=1)
    # 16001 rows in 16 s: the time column's first step is twice the others.
    record = dfc.Record(1e-3 * np.arange(len(rows)), TORQUE * rows[:, 4], rows[:, 1])[500:7900]
    axis = dfc.FrictionAxis(
        mass=7e-6, viscous=2e-5, coulomb=1e-3, stick_speed=1e-2, units=("rad", "N m")
    )
    d = diagnosed("LAAS, 0.5 to 7.9 s", axis, record, given)
    for cause in d.causes:
        if "cogging" in cause.effect:
            print(f"  {2.0 * math.pi / cause.parameters['period']:.3f} a turn, "
                  f"{cause.parameters['amplitude'] / TORQUE:.4f} A")  # fmt: skip
    print(f"  inertia over the nominal {d.extended.mass / axis.mass:.2f}")


def pneumatic(given: Namespace) -> None:
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
    d = diagnosed("pneumatic, four pressures", axis, records, given, known=("mass",))
    for level, known in zip(d.varies.get("coulomb", {}).get("values", ()), (5.4, 7.3, 8.8, 10.7),
                            strict=False):  # fmt: skip
        print(f"  level {level:.2f} N, known {known} N ({100 * (level / known - 1):+.0f} %)")


def bam(given: Namespace) -> None:
    """Servo pendulum: the four logs at kp = 100 together, judged on those at kp = 400."""
    machine = measured.pendulum()
    title = "BAM, four logs at kp = 100"
    d = diagnosed(title, machine.axis, machine.train, given, known=("mass",))
    test = [record for _, record in machine.test]
    for name, one in (("nominal", machine.axis), ("with the causes", d.extended)):
        windows = np.sqrt(np.mean([dfc.replay(one, r).rms ** 2 for r in test]))
        free = [one.simulate(r.u, r.dt, x0=float(r.x[0])).y[0] - r.x for r in test]
        whole = np.sqrt(np.mean([np.mean(e**2) for e in free]))
        print(
            f"  {name}, kp = 400: windows of 0.25 s {windows:.4f} rad, whole logs {whole:.3g} rad"
        )


if __name__ == "__main__":
    warnings.simplefilter("ignore", dfc.FitWarning)
    print_tables(
        __doc__,
        {"emps": emps, "laas": laas, "pneumatic": pneumatic, "bam": bam},
        {"--time-limit": (float, "of a diagnosis [s]")},
    )
