"""Causes by the likelihood of the hybrid filter, on measured machines.

    python benchmarks/likelihood_real.py [laas] [emps] [pneumatic] [bam]

What is known about each record stands in ../shared/data/README.md.  Costs are
negative log-likelihoods; a gain is a fall of the cost less what its parameters
bring by chance.  "Straight line" and "nominal axis" are the references with
which every answer is compared.
"""

from __future__ import annotations

import math
import sys
import time
import warnings
from pathlib import Path

import numpy as np

import dryfric_control as dfc
from dryfric_control.diagnosis.likelihood_search import Search, forward
from dryfric_control.estimation.likelihood import Likelihood, Solution, maximise, prepare

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
TORQUE = 0.025  # N m/A, which only sets the unit


def told(found: Solution) -> str:
    """Parameters with standard errors, and the noises."""
    errors = found.standard_errors()
    parts = [f"{name} {value:.5g} +- {errors[name]:.2g}" for name, value in found.values().items()]
    noise = f"random force {found.random_force():.3g}, readings {found.reading_noise():.3g}"
    return f"{', '.join(parts)}; {noise}{'' if found.converged else '; NOT CONVERGED'}"


def causes(title: str, search: Search, most: int) -> Solution:
    """Search, and print every step."""
    begun, used = time.perf_counter(), time.process_time()
    print(f"{title}")
    for name, cost in search.references().items():
        print(f"  {name:14s} cost {cost:.0f}")

    def tell(name, now, screened, ranked):  # type: ignore[no-untyped-def]
        print(f"  {name or 'base alone':14s} cost {now.cost:.0f}: {told(now)}")
        print("    quick gains:", ", ".join(f"{c.slug} {now.cost - c.cost:.0f}"
                                            for c in screened[:8]))  # fmt: skip
        print("    full gains: ", ", ".join(f"{c.slug} {gain:.0f}" for gain, c, _ in ranked))

    steps = forward(search, most, tell)
    last = steps[-1][1]
    print(f"  named: {', '.join(s[0] for s in steps[1:]) or 'nothing'}; cost {last.cost:.0f}: "
          f"{told(last)}")  # fmt: skip
    print(f"  {time.perf_counter() - begun:.0f} s, {time.process_time() - used:.0f} s of one core")
    return last


def laas() -> None:
    """Cogging of 72 a turn on a motor's bench, 0.5 to 7.9 s."""
    rows = np.loadtxt(DATA / "laas_cogging" / "speed_test.txt", delimiter=",", skiprows=1)
    # 16001 rows in 16 s: the time column's first step is twice the others.
    record = dfc.Record(1e-3 * np.arange(len(rows)), TORQUE * rows[:, 4], rows[:, 1])[500:7900]
    axis = dfc.FrictionAxis(
        mass=7e-6, viscous=2e-5, coulomb=1e-3, stick_speed=1e-2, units=("rad", "N m")
    )
    last = causes("LAAS, 0.5 to 7.9 s", Search(axis, [record]), 1)
    values = last.values()
    if "cogging.period" in values:
        print(f"  periods a turn {2.0 * math.pi / values['cogging.period']:.3f}, amplitude "
              f"{values['cogging.amplitude'] / TORQUE:.4f} A, inertia over the nominal "
              f"{values['mass'] / axis.mass:.2f}")  # fmt: skip


def emps() -> None:
    """Viscous asymmetry on every contiguous 40 %."""
    record = dfc.read_record(DATA / "emps" / "DATA_EMPS.mat")
    axis = dfc.FrictionAxis(mass=95.11, viscous=203.5, coulomb=20.39)
    n = len(record)
    for start in (0.0, 0.2, 0.3, 0.6):
        part = record[round(start * n) : round((start + 0.4) * n)]
        causes(f"EMPS, {100 * start:.0f} to {100 * start + 40:.0f} %", Search(axis, [part]), 1)


def pneumatic() -> None:
    """Coulomb level of a seal at four pressures: one axis, own levels and offsets."""
    records = []
    for pressure in (1, 3, 5, 7):
        rows = np.loadtxt(DATA / "pneumatic" / f"O-ring_{pressure}bar.csv", skiprows=15)
        rows = rows[np.concatenate(([True], np.diff(rows[:, 0]) > 0.0))]
        t = np.arange(rows[0, 0], rows[-1, 0], 10.0) * 1e-3
        u, x = (np.interp(1e3 * t, rows[:, 0], rows[:, i]) for i in (6, 4))
        records.append(dfc.Record(t - t[0], u, 1e-3 * x, quantum=4e-6))
    levels, errors = [], []
    for record in records:
        # The bench moves the seal: the force is what it takes, the mass is small and known.
        axis = dfc.FrictionAxis(
            mass=1.0, viscous=0.0, coulomb=7.0,
            effects=(dfc.effects.BiasForce(-float(np.mean(record.u))),),
        )  # fmt: skip
        problem = Likelihood(axis, ("coulomb", "bias_force"), [prepare(record)])
        found = maximise(problem, problem.start(0.02))
        levels.append(found.values()["coulomb"])
        errors.append(found.standard_errors()["coulomb"])
        print(f"pneumatic: {told(found)}")
    for level, error, known in zip(levels, errors, (5.4, 7.3, 8.8, 10.7), strict=True):
        off = f"{100 * (level / known - 1):+.0f} %"
        print(f"  level {level:.2f} +- {error:.2f} N, known {known} N ({off})")


def bam() -> None:
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
    search = Search(axis, train, known=("mass",), also=("input_gain.gain", "gravity.phase"))
    base = search.alone()
    last = causes("BAM, four logs at kp = 100", search, 2)
    for title, one in (("base alone", base), ("with the causes", last)):
        runs = [dfc.replay(one.axis, r).rms for r in test]
        whole = [dfc.replay(one.axis, r, window=r.duration).rms for r in test]
        print(f"  {title:16s} kp = 400: windows of 0.25 s "
              f"{np.sqrt(np.mean(np.square(runs))):.4f} rad, whole logs "
              f"{np.sqrt(np.mean(np.square(whole))):.3f} rad")  # fmt: skip


if __name__ == "__main__":
    warnings.simplefilter("ignore", dfc.FitWarning)
    for name in sys.argv[1:] or ["laas", "emps", "pneumatic", "bam"]:
        {"laas": laas, "emps": emps, "pneumatic": pneumatic, "bam": bam}[name]()
