"""Attack on the tracking tube: which axis within the mismatch leaves it?

Run ``python benchmarks/tube_attack.py --plants 5000``.  Each design is drawn at random (mass,
delay, encoder, mismatch, Stribeck peak, levels by direction); its plants lie at the corners of the
mismatch, its moves reach from 0.3 mm to 100 mm and from crawling to fast, their reversals are
2 to 60 loop time constants apart.  A coordinate search starts from the worst plant of each design.
Prints the largest error over its tube, and exits with 1 if one is beyond 1.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import dataclass, replace

import numpy as np

import dryfric_control as dfc

DT = 1e-3


@dataclass(frozen=True)
class Case:
    """One plant and its move; shares are in parts of the mismatch, -1 to 1."""

    mass: float
    viscous: float
    plus: float
    minus: float
    excess: float
    stribeck: float
    delay: float  # part of the largest
    way: float  # [m]
    pace: float  # velocity over what friction left and the loop's time constant give
    apart: float  # of the reversals, in loop time constants
    seed: int


def designs(seed: int) -> dfc.Compensation:
    """A design drawn at random."""
    rng = np.random.default_rng([47, seed])
    mass = 10.0 ** rng.uniform(-2.0, 1.5)
    level = mass * 10.0 ** rng.uniform(0.0, 1.0)
    minus = level * (rng.uniform(0.6, 1.6) if rng.random() < 0.5 else 1.0)
    peak = dfc.Stribeck(rng.uniform(0.1, 0.6), 10.0 ** rng.uniform(-3.0, -1.5))
    axis = dfc.FrictionAxis(
        mass=mass,
        viscous=mass * 10.0 ** rng.uniform(-0.5, 1.5),
        coulomb=(level, minus),
        stribeck=peak if rng.random() < 0.5 else None,
        stick_speed=10.0 ** rng.uniform(-4.0, -3.0),
    )
    quantum = 0.0 if rng.random() < 0.3 else 10.0 ** rng.uniform(-7.0, math.log10(5e-6))
    return dfc.design_compensation(
        axis,
        DT,
        quantum,
        0.0 if rng.random() < 0.3 else rng.uniform(0.0, 2.5) * DT,
        mismatch=rng.uniform(0.1, 0.3),
        law="learned" if rng.random() < 0.8 else "fixed",
    )


def plant(comp: dfc.Compensation, case: Case) -> dfc.FrictionAxis:
    """The axis of a case."""
    axis, mu = comp.axis, comp.mismatch
    plus, minus = axis.coulomb(0.0, 1), axis.coulomb(0.0, -1)
    peak = axis.stribeck
    delay = case.delay * comp.input_delay
    return axis.replace(
        mass=axis.mass * (1.0 + mu * case.mass),
        viscous=axis.viscous * (1.0 + mu * case.viscous),
        coulomb=(float(plus) * (1.0 + mu * case.plus), float(minus) * (1.0 + mu * case.minus)),
        stribeck=peak
        and dfc.Stribeck(
            peak.excess * (1.0 + mu * case.excess), peak.speed * (1.0 + mu * case.stribeck)
        ),
        effects=(dfc.effects.InputDelay(delay=delay),) if delay > 0.0 else (),
    )


def move(comp: dfc.Compensation, case: Case) -> dfc.MotionProfile:
    """The reference of a case: back and forth, at most ten seconds."""
    rng = np.random.default_rng(case.seed)
    span = comp.certificate.tube * comp.bandwidth  # what the loop makes good in its time constant
    velocity = max(case.pace * span, case.way / 5.0)
    duration = max(case.apart / comp.bandwidth, case.way / velocity)
    acceleration = 8.0 * velocity / duration
    points = [0.0, *((-1.0) ** i * 0.5 * case.way * rng.uniform(0.5, 1.0) for i in range(3))]
    return dfc.motion_profile(
        points,
        DT,
        velocity=velocity,
        acceleration=acceleration,
        jerk=16.0 * acceleration / duration,
        dwell=float(rng.choice([0.0, 2.0 / comp.bandwidth, 0.3])),
    )


def beyond(comp: dfc.Compensation, case: Case) -> float:
    """Largest error over the tube; 0 where no tube is certified."""
    reference = move(comp, case)
    tube = comp.certify(reference=reference).tube
    run = dfc.simulate_loop(
        plant(comp, case), comp.controller, reference, quantum=comp.encoder_quantum
    )
    return float(np.abs(reference.position - run.y[0]).max()) / tube


def drawn(rng: np.random.Generator) -> Case:
    """A plant at a corner, with any move."""
    sides = rng.choice([-1.0, 1.0], 6)
    return Case(
        *(float(side) for side in sides),
        delay=float(rng.choice([0.0, 0.5, 1.0])),
        way=10.0 ** rng.uniform(math.log10(3e-4), -1.0),
        pace=10.0 ** rng.uniform(-2.5, 1.5),
        apart=10.0 ** rng.uniform(math.log10(2.0), math.log10(60.0)),
        seed=int(rng.integers(1 << 30)),
    )


def near(case: Case, name: str, rng: np.random.Generator) -> Case:
    """The same case but for one coordinate."""
    value = getattr(case, name)
    if name == "seed":
        value = int(rng.integers(1 << 30))
    elif name == "delay":
        value = float(rng.uniform(0.0, 1.0))
    elif name in ("way", "pace", "apart"):
        value *= 2.0 ** rng.uniform(-1.0, 1.0)
        low, high = {"way": (3e-4, 0.1), "pace": (1e-3, 50.0), "apart": (2.0, 60.0)}[name]
        value = min(max(value, low), high)
    else:
        value = float(rng.uniform(-1.0, 1.0)) if rng.random() < 0.5 else -value
    return replace(case, **{name: value})


def attack(seed: int, plants: int) -> tuple[float, Case, dfc.Compensation]:
    """Worst case of one design: half of the plants drawn, half by a coordinate search."""
    comp = designs(seed)
    rng = np.random.default_rng(seed)
    worst, case = -1.0, drawn(rng)
    for k in range(plants):
        names = tuple(Case.__annotations__)
        tried = drawn(rng) if k < plants // 2 else near(case, names[k % len(names)], rng)
        found = beyond(comp, tried)
        if found > worst:
            worst, case = found, tried
    return worst, case, comp


def main() -> None:
    """Read the command line and attack."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plants", type=int, default=5000)
    parser.add_argument("--each", type=int, default=50, help="plants of one design")
    parser.add_argument("--first", type=int, default=0, help="seed of the first design")
    given = parser.parse_args()
    ratios = []
    for seed in range(given.first, given.first + math.ceil(given.plants / given.each)):
        if not math.isfinite(designs(seed).certificate.tube):
            print(f"{seed:4d}  no tube is certified", flush=True)
            continue
        worst, case, comp = attack(seed, given.each)
        ratios.append(worst)
        axis, peak = comp.axis, comp.axis.stribeck
        print(
            f"{seed:4d}  mass {axis.mass:8.4g}, delay {1e3 * comp.input_delay:4.2f} ms, encoder "
            f"{1e6 * comp.encoder_quantum:4.2f} um, mismatch {comp.mismatch:.2f}, excess "
            f"{peak.excess if peak else 0.0:.2f}: error {worst:.3f} of the tube {case}",
            flush=True,
        )
    beyond_it = sum(ratio > 1.0 for ratio in ratios)
    print(
        f"{given.each * len(ratios)} plants of {len(ratios)} designs: largest error "
        f"{max(ratios):.3f} of its tube, median {np.median(ratios):.3f} of the designs' worst; "
        f"{beyond_it} designs with an error beyond the tube"
    )
    sys.exit(beyond_it > 0)


if __name__ == "__main__":
    main()
