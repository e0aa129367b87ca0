"""Diagnosis of machines whose friction no candidate has, made by a simulator of its own.

    python benchmarks/foreign_machines.py [--seeds 5] [--first 0] [--laws tanh maxwell ...]

The simulator takes explicit steps of 20 us and shares no code with the package.  Its laws: Maxwell
slip (four springs that slip one after another), the same with levels that fall with velocity (after
the generalised Maxwell slip model of Al-Bender, Lampaert and Swevers, 2005), tanh (friction that
creeps), a gear that loses less when it is driven back, a spot of raised friction, a drive whose
gain changes.  A PD loop moves the axis; the nominal axis is up to 30 % off.  A machine takes up to
several minutes of a core.

What counts against an answer: a force in it that is larger than any in the record, and an amount
that another run of the same machine (another motion, other noise) contradicts by more than five of
the standard errors of both and a twentieth of itself.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator

import numpy as np
from harness import parser_of, percent_of
from numba import njit

import dryfric_control as dfc

#: Sampling time [s].
DT = 1e-3
#: Steps of the simulator in a sample.
STEPS = 50
#: Samples of a record.
SAMPLES = 20_000
LAWS = ("maxwell", "gms", "tanh", "gear", "spot", "gain")
#: Standard errors by which two runs of one machine may differ.
MOST_ERRORS = 5.0
#: Part of the amount by which they may differ besides.
MOST_PART = 0.05
#: Width of a spot of raised friction [m].
SPOT = 3e-3
#: Ways after which the springs of Maxwell slip begin to slip [m].
WAYS = np.array([3e-6, 1e-5, 3e-5, 1e-4])


@njit
def machine(law, reference, gains, mass, viscous, level, extra, speed, noise, quantum):
    """Drive and readings of an axis that a PD loop moves; `law`: index in LAWS."""
    h = DT / STEPS
    n = reference.size
    u, x_read = np.empty(n), np.empty(n)
    x = v = before = 0.0
    springs = np.zeros(WAYS.size)
    for k in range(n):
        reading = quantum * np.round(x / quantum)
        rate = (reading - before) / DT
        before = reading
        drive = gains[0] * (reference[k] - reading) - gains[1] * rate + noise[k]
        u[k], x_read[k] = drive, reading
        if law == 5 and k > n // 2:
            drive *= 1.0 - extra
        for _ in range(STEPS):
            if law <= 1:
                height = level
                if law == 1:
                    height = level * (1.0 + extra * np.exp(-((v / speed) ** 2)))
                force = 0.0
                for i in range(springs.size):
                    most = height / springs.size
                    stiffness = level / springs.size / WAYS[i]
                    springs[i] = min(max(springs[i] + v * h, -most / stiffness), most / stiffness)
                    force += stiffness * springs[i]
                v += h * (drive - viscous * v - force) / mass
            elif law == 2:
                v += h * (drive - viscous * v - level * np.tanh(v / speed)) / mass
            else:
                height = level
                if law == 3:
                    height += (extra if drive * v >= 0.0 else 0.4 * extra) * abs(drive)
                elif law == 4 and abs(x) < 0.5 * SPOT:
                    height *= 1.0 + 2.0 * extra
                f = drive - viscous * v
                if v == 0.0 and abs(f) <= height:
                    continue
                s = np.sign(v) if v != 0.0 else np.sign(f)
                w = v + h * (f - height * s) / mass
                v = 0.0 if w * s < 0.0 else w
            x += h * v
    return u, x_read


def records(law: str, seed: int) -> tuple[dfc.FrictionAxis, dfc.Record, dfc.Record]:
    """Nominal axis and two runs of one machine."""
    rng = np.random.default_rng([seed, LAWS.index(law)])
    mass = float(np.exp(rng.uniform(np.log(0.5), np.log(8.0))))
    level = float(np.exp(rng.uniform(np.log(2.0), np.log(20.0))))
    viscous, extra = rng.uniform(0.5, 2.0) * level, rng.uniform(0.15, 0.4)
    speed = float(np.exp(rng.uniform(np.log(1e-3), np.log(5e-3))))
    turn = 2.0 * np.pi * rng.uniform(4.0, 8.0)
    gains = np.array([mass * turn**2, 1.4 * mass * turn])
    time_ = DT * np.arange(SAMPLES)
    runs = []
    for _ in range(2):
        waves = [(rng.uniform(4e-3, 1.2e-2), rng.uniform(0.15, 0.5)) for _ in range(3)]
        reference = sum(
            a * np.sin(2.0 * np.pi * f * time_ + rng.uniform(0.0, 6.28)) for a, f in waves
        )
        reference = np.asarray(reference) - reference[0]
        noise = 0.01 * level * rng.standard_normal(SAMPLES)
        u, x = machine(
            LAWS.index(law), reference, gains, mass, viscous, level, extra, speed, noise, 1e-6
        )
        runs.append(dfc.Record(time_, u, x, reference, quantum=1e-6))
    off = rng.uniform(0.75, 1.3, 3)
    axis = dfc.FrictionAxis(mass=off[0] * mass, viscous=off[1] * viscous, coulomb=off[2] * level)
    return axis, runs[0], runs[1]


def amounts(found: dfc.Diagnosis) -> Iterator[tuple[str, float, float, str]]:
    """Name as `fit` takes it, value, standard error and unit of each amount."""
    for cause in found.causes:
        for name, value in cause.parameters.items():
            own = cause.effect in ("inertia", "viscous", "coulomb", "stribeck")
            full = f"{cause.effect}.{name}" if not own or cause.effect == "stribeck" else name
            yield full, value, cause.standard_errors[name], cause.units[name]


def complaints(found: dfc.Diagnosis, record: dfc.Record, other: dfc.Record) -> Iterator[str]:
    """What counts against an answer."""
    rows = list(amounts(found))
    most = float(np.abs(record.u).max())
    for name, value, _, unit in rows:
        if unit == "N" and abs(value) > most:
            yield f"{name} = {value:.3g} N, the drive at most {most:.3g} N"
    names = [name for name, _, error, _ in rows if np.isfinite(error)]
    if not names:
        return
    try:
        again = dfc.fit(found.extended, other, free=names, anyway=True)
    except ValueError as error:
        yield f"not fitted again: {error}"
        return
    for name, value, error, _ in rows:
        if name not in again.parameters or not np.isfinite(error):
            continue
        there, its = again.parameters[name], again.standard_errors[name]
        allowed = MOST_ERRORS * np.hypot(error, its) + MOST_PART * abs(value)
        if abs(there - value) > allowed:
            yield f"{name} = {value:.4g} +- {error:.2g}, the other run {there:.4g} +- {its:.2g}"


def main() -> None:
    """Diagnose each machine, print the answer and what counts against it."""
    given = parser_of(
        __doc__,
        {
            "--seeds": (5, "machines of each law"),
            "--first": (0, "first seed"),
            "--laws": (LAWS, "of the machines"),
        },
    ).parse_args()
    warnings.simplefilter("ignore")
    marks = []
    for law in given.laws:
        for seed in range(given.first, given.first + given.seeds):
            axis, record, other = records(law, seed)
            start = time.process_time()
            found = dfc.diagnose(axis, record, progress=False)
            spent = time.process_time() - start
            wrong = list(complaints(found, record, other))
            marks.append(bool(wrong))
            named = ", ".join(f"{n} {v:.4g}" for n, v, _, _ in amounts(found)) or "no cause"
            print(f"{law} {seed}: {found.verdict}; {named}; {spent:.0f} s", flush=True)
            print("".join(f"    against it: {line}\n" for line in wrong), end="", flush=True)
    print(f"answers with something against them: {percent_of(marks)}")


if __name__ == "__main__":
    main()
