"""Diagnoses of measured machines: a linear drive and a servo pendulum.

    python benchmarks/diagnosis_real.py [emps] [bam]

EMPS (doi 10.1109/CDC.2013.6760089 and the benchmark of nonlinearbenchmark.org):
diagnosed on its first 60 %, starting from the published symmetric parameters;
the rest is held out.  BAM (servo pendulum XL330): diagnosed on the logs at
kp = 100, each cause tested on the logs at kp = 400.
"""

from __future__ import annotations

import sys
import time
import warnings
from pathlib import Path

import numpy as np

import dryfric_control as dfc
from dryfric_control.diagnosis import evidence
from dryfric_control.identification import FitWarning
from dryfric_control.records import Record, read_bam, read_record

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


def force_error(axis: dfc.FrictionAxis, record: Record) -> float:
    """RMS of the force residual at sliding samples."""
    return evidence(axis, record).force_rms


def emps() -> None:
    """What the linear drive's record shows, and whether each cause holds."""
    path = DATA / "emps" / "DATA_EMPS.mat"
    if not path.exists():
        print("EMPS: no record at", path)
        return
    first, last = read_record(path).split(0.6)
    axis = dfc.FrictionAxis(mass=95.11, viscous=203.5, coulomb=20.39)
    begun = time.perf_counter()
    d = dfc.diagnose(axis, first)
    print(f"EMPS, first 60 % ({time.perf_counter() - begun:.1f} s)")
    print(d.summary())
    before, after = force_error(axis, last), force_error(d.extended, last)
    print(f"held-out 40 %: force residual {before:.3f} N RMS before, {after:.3f} N after "
          f"({100 * (after / before - 1):+.0f} %)")  # fmt: skip
    # Against the same axis with its base parameters refitted, and leaving one out.
    slugs = [c.effect for c in d.causes]
    others = [s for s in slugs if s not in ("inertia", "viscous", "coulomb")]
    free = ("mass", "viscous", "coulomb")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FitWarning)
        rows = [("base parameters refitted", free)]
        rows += [("published: bias force", (*free, "bias_force"))]
        rows += [("all named causes", (*free, *others))]
        rows += [
            (f"without {s}", (*free, *(o for o in others if o != s)))
            for s in others
            if len(others) > 1
        ]
        for title, names in rows:
            found = dfc.fit(axis, first, names)
            run = found.replay(last)
            print(f"  {title:32s} held out: force {force_error(found.axis, last):.3f} N, free runs "
                  f"median {1e6 * run.median:.1f} um, RMS {1e6 * run.rms:.1f} um")  # fmt: skip


def bam() -> None:
    """Whether the servo's gear shows friction that grows with its load."""
    logs = [read_bam(path) for path in sorted((DATA / "bam_xl330").glob("*.json"))]
    if not logs:
        print("BAM: no logs at", DATA / "bam_xl330")
        return

    def enabled(log):  # type: ignore[no-untyped-def]
        off = np.flatnonzero(~log["torque_enable"])
        return log["record"][: int(off[0])] if off.size else log["record"]

    axis = dfc.FrictionAxis(
        mass=0.49 * 0.1**2, viscous=0.1, coulomb=0.05, stick_speed=1e-2, units=("rad", "N m"),
        effects=(dfc.effects.Gravity(0.49 * 9.81 * 0.1), dfc.effects.InputGain(0.2)),
    )  # fmt: skip
    free = ("mass", "viscous", "coulomb", "input_gain", "gravity.phase")
    train = [enabled(g) for g in logs if g["kp"] == 100]
    test = [enabled(g) for g in logs if g["kp"] == 400]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FitWarning)
        base = dfc.fit(axis, train, free)
        print(f"\nBAM: fitted on {len(train)} logs at kp = 100, held out {len(test)} at kp = 400")
        for log in (g for g in logs if g["kp"] == 100):
            d = dfc.diagnose(base.axis, enabled(log), window=0.1)
            named = ", ".join(c.effect for c in d.causes) or "-"
            ranked = sorted(d.scores, key=d.scores.__getitem__)
            place = ranked.index("load_dependence") + 1 if "load_dependence" in ranked else None
            print(f"  {log['trajectory']:18s} {d.verdict}: {named}; load_dependence is number "
                  f"{place} of {len(ranked)} candidates")  # fmt: skip
        rows = {"without": base.axis}
        for slug in ("load_dependence", "input_delay", "stribeck"):
            rows[slug] = dfc.fit(base.axis, train, (*free, slug)).axis
        errors = {}
        for title, one in rows.items():
            runs = [dfc.replay(one, r) for r in test]
            errors[title] = [r.rms for r in runs]
        for title, values in errors.items():
            text = " ".join(f"{v:.4f}" for v in values)
            total = float(np.sqrt(np.mean(np.square(values))))
            first = float(np.sqrt(np.mean(np.square(errors["without"]))))
            print(f"  held out, {title:16s} windows of 0.25 s: {text} rad, all {total:.4f} rad "
                  f"({100 * (total / first - 1):+.0f} %)")  # fmt: skip


if __name__ == "__main__":
    chosen = sys.argv[1:] or ["emps", "bam"]
    for name in chosen:
        {"emps": emps, "bam": bam}[name]()
