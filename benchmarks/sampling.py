"""Motion at a sampling time against the same motion at a finer one, over combinations of effects.

Run ``python benchmarks/sampling.py``; one run prints every table, in at most an hour.  A held
drive, and one that runs linearly between samples, is the same drive at any multiple of its
sampling rate, so that the motion is the same too, whatever begins and ends within a sample.  What
may differ is the error of the steps.  `peak` compares the bound of the error of one step by the
Stribeck peak, `peak_error` in `dryfric_control/compiled/axis_step.py`, with that error, over
random steps.  Name tables to print only those: singles pairs triples peak.
"""

from __future__ import annotations

import itertools
import time
from argparse import Namespace
from collections.abc import Iterator
from functools import partial

import numpy as np
from harness import print_tables

import dryfric_control as dfc
from dryfric_control import effects as fx
from dryfric_control.model.effects.effect import REGISTRY

DT = 1e-3
#: Fine samples in one coarse one.
FINER = 64
#: Samples of a record, and most of them over which its drive keeps one course.
SAMPLES, COURSE = 120, 20
#: Largest difference of the positions, over the travel.
ALLOWED = 1e-6
#: Divisor of the bound of the error by the Stribeck peak, `_PEAK_ERROR` of the kernel.
PEAK_ERROR = 230.0
#: Random steps by which that is tried.
PEAK_STEPS = 1_200_000
#: Velocity, in Stribeck speeds, below which an error is round-off.
ROUND_OFF = 1e-13
HOLDS = ("zero", "first")


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Random number whose logarithm is evenly distributed."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def some_effect(slug: str, rng: np.random.Generator) -> fx.Effect:
    """One effect with random parameters, of a size that matters beside a level of 4 to 12 N."""

    def near(low: float, high: float) -> float:
        return log_uniform(rng, low, high)

    def sign() -> float:
        return float(rng.choice([-1.0, 1.0]))

    share, turn, side = rng.uniform(0.2, 0.8), rng.uniform(0.0, 6.28), float(rng.integers(2))
    made = {
        "inertia": lambda: fx.Inertia(near(0.5, 2.0)),
        "viscous": lambda: fx.ViscousFriction(near(0.5, 5.0)),
        "coulomb": lambda: fx.CoulombFriction(near(0.5, 2.0)),
        "stribeck": lambda: fx.StribeckPeak(near(0.1, 1.0), near(1e-3, 3e-2)),
        "input_delay": lambda: fx.InputDelay(near(1e-4, 5e-3)),
        "actuator_lag": lambda: fx.ActuatorLag(near(2e-4, 2e-2)),
        "input_gain": lambda: fx.InputGain(near(0.7, 1.5)),
        "dead_zone": lambda: fx.DeadZone(near(0.3, 10.0)),
        "saturation": lambda: fx.Saturation(near(8.0, 25.0)),
        "presliding": lambda: fx.Presliding(
            near(1e-5, 1e-3), near(1.0, 200.0) * rng.integers(2), side
        ),
        "backlash": lambda: fx.Backlash(near(1e-5, 2e-3), share, side),
        "load_encoder_backlash": lambda: fx.LoadEncoderBacklash(near(1e-5, 2e-3), share),
        "compliance": lambda: fx.Compliance(near(1e3, 1e5), near(1.0, 100.0), share, side),
        "eccentric_encoder": lambda: fx.EccentricEncoder(1e-4, 0.01, turn),
        "bias_force": lambda: fx.BiasForce(sign() * near(0.3, 6.0)),
        "viscous_asymmetry": lambda: fx.ViscousAsymmetry(sign() * near(0.5, 5.0)),
        "quadratic_drag": lambda: fx.QuadraticDrag(near(1.0, 50.0)),
        "spring": lambda: fx.Spring(near(10.0, 3e3), rng.uniform(-0.01, 0.01)),
        "gravity": lambda: fx.Gravity(near(1.0, 10.0), turn),
        "cogging": lambda: fx.Cogging(near(0.3, 8.0), near(5e-4, 2e-2), turn),
        "time_periodic": lambda: fx.TimePeriodic(near(0.5, 15.0), near(1.0, 600.0), turn),
        "position_force": lambda: fx.PositionForce(
            rng.uniform(-0.01, 0.01), near(0.01, 0.1), *rng.normal(0.0, 0.3, 13)
        ),
        "coulomb_asymmetry": lambda: fx.CoulombAsymmetry(sign() * near(0.3, 3.0)),
        "position_dependence": lambda: fx.PositionDependence(
            sign() * near(1.0, 20.0), sign() * near(10.0, 300.0), rng.uniform(-0.01, 0.01)
        ),
        "friction_ripple": lambda: fx.FrictionRipple(near(0.1, 0.8), near(5e-4, 2e-2), turn),
        "load_dependence": lambda: fx.LoadDependence(near(0.05, 0.4)),
        "load_asymmetry": lambda: fx.LoadAsymmetry(sign() * near(0.05, 0.3)),
        "stribeck_asymmetry": lambda: fx.StribeckAsymmetry(
            sign() * near(0.1, 0.8), near(1e-3, 3e-2)
        ),
        "velocity_strengthening": lambda: fx.VelocityStrengthening(
            near(0.1, 0.8), near(1e-3, 3e-2)
        ),
        "warm_up": lambda: fx.WarmUp(near(0.1, 1.0), near(0.02, 1.0)),
        "viscous_warm_up": lambda: fx.ViscousWarmUp(sign() * near(0.5, 5.0), near(0.02, 1.0)),
        "drift": lambda: fx.Drift(sign() * near(0.1, 3.0)),
        "dwell_time": lambda: fx.DwellTime(near(0.3, 3.0), near(3e-3, 0.3)),
        "end_stop": lambda: fx.EndStop(
            -near(1e-4, 1e-2), near(1e-4, 1e-2), near(1e3, 1e5), near(1.0, 50.0) * rng.integers(2)
        ),
    }
    return made[slug]()


def some_axis(slugs: tuple[str, ...], rng: np.random.Generator) -> dfc.FrictionAxis:
    """A random axis with these effects."""
    level = log_uniform(rng, 4.0, 12.0)
    peak = dfc.Stribeck(log_uniform(rng, 0.1, 1.0), log_uniform(rng, 1e-3, 3e-2))
    return dfc.FrictionAxis(
        mass=log_uniform(rng, 0.5, 4.0),
        viscous=log_uniform(rng, 2.0, 40.0),
        coulomb=level,
        stribeck=peak if rng.integers(2) else None,
        effects=tuple(some_effect(slug, rng) for slug in slugs),
    )


def some_drive(hold: str, rng: np.random.Generator) -> np.ndarray:
    """Random steps, or ramps, that start, stop and turn an axis of a few newtons."""
    lengths = rng.integers(1, COURSE, SAMPLES)
    heights = rng.uniform(-25.0, 25.0, SAMPLES)
    if hold == "zero":
        return np.repeat(heights, lengths)[:SAMPLES]
    return np.interp(np.arange(SAMPLES), np.r_[0, np.cumsum(lengths)[:-1]], heights)


def difference(axis: dfc.FrictionAxis, u: np.ndarray, hold: str, finer: int = FINER) -> float:
    """Largest difference of the positions at DT and DT/finer, over the travel."""
    if hold == "zero":
        fine_u = np.repeat(u[:-1], finer)
    else:
        at = np.arange((u.size - 1) * finer) / finer
        fine_u = np.interp(at, np.arange(u.size), u)
    coarse = axis.simulate(u, DT, hold=hold).y[0]
    fine = axis.simulate(np.r_[fine_u, u[-1]], DT / finer, hold=hold).y[0, ::finer]
    # An axis that only creeps within its stick velocity does not travel.
    travel = max(float(np.ptp(fine)), axis.stick_speed * DT * u.size)
    return float(np.abs(coarse - fine).max()) / travel


def case(slugs: tuple[str, ...], seed: int) -> tuple[dfc.FrictionAxis, np.ndarray, str]:
    """Axis, drive and hold of one case."""
    rng = np.random.default_rng([seed, *(sum(map(ord, slug)) for slug in slugs)])
    hold = HOLDS[seed % 2]
    return some_axis(slugs, rng), some_drive(hold, rng), hold


def can_join(slugs: tuple[str, ...]) -> bool:
    """Whether an axis may have these effects: one of each kind with a state."""
    kinds = [REGISTRY[slug].action for slug in slugs]
    return all(
        kinds.count(kind) == 1
        for kind in ("delay", "lag", "contact", "transmission")
        if kind in kinds
    )


def combinations(count: int) -> Iterator[tuple[str, ...]]:
    """Combinations of so many effects of the package."""
    return filter(can_join, itertools.combinations(sorted(REGISTRY), count))


def table(name: str, sets: list[tuple[str, ...]], seeds: range, shown: int) -> None:
    """Print how many cases differ by more than allowed, and the largest."""
    begin, found = time.process_time(), []
    for slugs in sets:
        for seed in seeds:
            axis, u, hold = case(slugs, seed)
            try:
                off = difference(axis, u, hold)
            except ValueError as refused:
                off = -1.0
                print("refused:", str(refused)[:150])
            found.append((off, slugs, seed, hold))
    found.sort(reverse=True)
    beyond = [one for one in found if one[0] > ALLOWED or one[0] < 0.0]
    spent = time.process_time() - begin
    print(
        f"{name}: {len(found)} cases, {len(beyond)} beyond {ALLOWED:g}; {spent:.0f} s", flush=True
    )
    for off, slugs, seed, hold in beyond[:shown]:
        print(f"  {off:8.1e} {' '.join(slugs)} ({hold}, seed {seed})", flush=True)


def peak(given: Namespace) -> None:
    """Print how the error of a step by the Stribeck peak compares with its bound.

    In Stribeck speeds and steps: dq/dt = b - z exp(-q^2), one step of the classical Runge-Kutta
    method of fourth order against 64.
    """
    begin, rng, count = time.process_time(), np.random.default_rng(0), PEAK_STEPS
    q0 = rng.uniform(0.0, 4.0, count)
    z = np.exp(rng.uniform(np.log(1e-3), np.log(3.0), count))
    b = z * np.exp(-(q0**2)) + rng.uniform(-1.0, 1.0, count)

    def slope(q: np.ndarray) -> np.ndarray:
        return b - z * np.exp(-(q**2))

    def steps(q: np.ndarray, number: int) -> tuple[np.ndarray, np.ndarray]:
        h = 1.0 / number
        for _ in range(number):
            k1 = slope(q)
            k2 = slope(q + 0.5 * h * k1)
            k3 = slope(q + 0.5 * h * k2)
            k4 = slope(q + h * k3)
            q = q + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        return q, np.maximum(np.abs(slope(q0)), np.abs(k4))

    once, fastest = steps(q0, 1)
    exact, _ = steps(q0, 64)
    nearest = np.maximum(np.minimum(q0, once), 0.0) ** 2
    fades = np.minimum(1.0, np.exp(-nearest) * (1.0 + nearest) ** 2)
    bound = z * fades * fastest * (fastest + z) ** 3 / PEAK_ERROR
    error = np.abs(once - exact)
    # Shorter ones are taken anyway, and what has turned round is another law.
    some = (fastest < 1.0) & (np.minimum(once, exact) > 0.0) & (bound > ROUND_OFF)
    ratio = error[some] / bound[some]
    spent = time.process_time() - begin
    print(
        f"peak: {ratio.size} steps, error over its bound at most {ratio.max():.2f}, median "
        f"{np.median(ratio):.2f}, lowest tenth below {np.quantile(ratio, 0.1):.3f}; {spent:.0f} s"
    )


def combination_table(count: int, most: int, given: Namespace) -> None:
    """Print the table of all combinations of so many effects, or of some at random."""
    sets = list(combinations(count))
    if count == 3:
        order = np.random.default_rng(0).permutation(len(sets))[: given.triples]
        sets = [sets[i] for i in order]
    name = ("singles", "pairs", "triples")[count - 1]
    table(name, sets, range(min(most, given.seeds)), given.shown)


if __name__ == "__main__":
    print_tables(
        __doc__,
        {
            "singles": partial(combination_table, 1, 1000),
            "pairs": partial(combination_table, 2, 1000),
            "triples": partial(combination_table, 3, 2),
            "peak": peak,
        },
        {
            "--seeds": (4, "cases of each combination, of triples at most two"),
            "--triples": (2000, "number of triples, at random"),
            "--shown": (30, "cases listed"),
        },
    )
