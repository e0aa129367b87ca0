"""Attack on the certificates of compensated loops: which axis breaks it (3 s a design)?

python benchmarks/tube_attack.py [--designs 100] [--each 50] [--only none spring ...]

Each design is drawn at random (mass, delay, encoder, mismatch, Stribeck peak, levels by direction),
without an effect ("none") or with one of the package, half of them with another beside it and a
third without any mismatch.  Its moves reach from 0.3 mm to 100 mm and from crawling to fast, their
reversals are 2 to 60 loop time constants apart; its plants are the nominal axis and lie at the
corners of the mismatch, by turns, and a coordinate search starts from the worst.  Counts for each
effect what was tried of the tube, the drive that the certificate says is needed, rest without
hunting and nine tenths of the delay margin, and what was broken; exits with 1 if anything was.
"""

from __future__ import annotations

import math
import sys
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from harness import parser_of

import dryfric_control as dfc
from dryfric_control import effects as fx

DT = 1e-3
#: Time at rest within which a loop that does not hunt has come to rest [s].
_REST = 8.0


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
    return move_within(case, comp.certificate.tube, comp.bandwidth)


def move_within(case: Case, error: float, bandwidth: float) -> dfc.MotionProfile:
    """The reference of a case, for a loop with errors of about this size."""
    rng = np.random.default_rng(case.seed)
    span = error * bandwidth  # what the loop makes good in its time constant
    velocity = max(case.pace * span, case.way / 5.0)
    duration = max(case.apart / bandwidth, case.way / velocity)
    acceleration = 8.0 * velocity / duration
    points = [0.0, *((-1.0) ** i * 0.5 * case.way * rng.uniform(0.5, 1.0) for i in range(3))]
    return dfc.motion_profile(
        points,
        DT,
        velocity=velocity,
        acceleration=acceleration,
        jerk=16.0 * acceleration / duration,
        dwell=float(rng.choice([0.0, 2.0 / bandwidth, 0.3])),
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


class Draw:
    """Random numbers for an effect of a size that matters on an axis."""

    def __init__(self, axis: dfc.FrictionAxis, rng: np.random.Generator) -> None:
        self.level, self.viscous, self.rng = axis.coulomb.mean, axis.viscous, rng
        self.phase = rng.uniform(-np.pi, np.pi)

    def part(self, low: float, high: float) -> float:
        """Part of the Coulomb level."""
        return self.level * self.rng.uniform(low, high)

    def decade(self, low: float, high: float) -> float:
        """Power of ten with an exponent between two numbers."""
        return float(10.0 ** self.rng.uniform(low, high))


#: What is attacked beside the effects: designs without any.
NONE = "none"
#: Effects at random; the last three have no bounds.
EFFECTS: dict[str, Callable[[Draw], fx.Effect]] = {
    "bias_force": lambda d: fx.BiasForce(d.part(-2.0, 2.0)),
    "viscous_asymmetry": lambda d: fx.ViscousAsymmetry(d.viscous * d.rng.uniform(-0.8, 0.8)),
    "quadratic_drag": lambda d: fx.QuadraticDrag(d.level * d.decade(0.0, 2.0)),
    "spring": lambda d: fx.Spring(d.level * d.decade(0.0, 2.5), d.rng.uniform(-0.05, 0.05)),
    "gravity": lambda d: fx.Gravity(d.part(0.0, 3.0), d.phase),
    "cogging": lambda d: fx.Cogging(d.level * d.decade(-1.5, 0.0), d.decade(-3.3, -1.3), d.phase),
    "time_periodic": lambda d: fx.TimePeriodic(
        d.level * d.decade(-1.5, 0.7), d.decade(-1.0, 2.5), d.phase
    ),
    "position_force": lambda d: fx.PositionForce(
        0.0, d.decade(-2.0, -0.5), *(0.3 * d.level * d.rng.normal(0.0, 1.0, 13))
    ),
    "end_stop": lambda d: fx.EndStop(
        -d.decade(-3.0, -1.0), d.decade(-3.0, -1.0), d.level * d.decade(1.0, 3.0),
        d.viscous * d.rng.uniform(0.0, 2.0) * (d.rng.random() < 0.5),
    ),
    "coulomb_asymmetry": lambda d: fx.CoulombAsymmetry(d.part(-0.5, 0.5)),
    "position_dependence": lambda d: fx.PositionDependence(
        d.rng.uniform(-5.0, 5.0), d.rng.uniform(-20.0, 20.0)
    ),
    "friction_ripple": lambda d: fx.FrictionRipple(
        d.rng.uniform(0.0, 0.8), d.decade(-3.3, -1.3), d.phase
    ),
    "load_dependence": lambda d: fx.LoadDependence(d.rng.uniform(0.0, 0.6)),
    "load_asymmetry": lambda d: fx.LoadAsymmetry(d.rng.uniform(-0.4, 0.4)),
    "stribeck_asymmetry": lambda d: fx.StribeckAsymmetry(
        d.rng.uniform(-0.5, 0.5), d.decade(-3.0, -1.5)
    ),
    "velocity_strengthening": lambda d: fx.VelocityStrengthening(
        d.rng.uniform(0.0, 0.9), d.decade(-3.0, -1.0)
    ),
    "warm_up": lambda d: fx.WarmUp(d.rng.uniform(-0.5, 1.0), d.decade(-1.0, 2.0)),
    "viscous_warm_up": lambda d: fx.ViscousWarmUp(
        d.viscous * d.rng.uniform(-0.8, 2.0), d.decade(-1.0, 2.0)
    ),
    "drift": lambda d: fx.Drift(d.rng.uniform(-0.05, 0.2)),
    "dwell_time": lambda d: fx.DwellTime(d.part(0.0, 1.0), d.decade(-2.5, 0.5)),
    "input_gain": lambda d: fx.InputGain(d.rng.uniform(0.4, 2.5)),
    "dead_zone": lambda d: fx.DeadZone(d.part(0.0, 1.0)),
    "saturation": lambda d: fx.Saturation(d.part(1.7, 8.0)),
    "input_delay": lambda d: fx.InputDelay(d.rng.uniform(0.0, 6.0) * DT),
    "actuator_lag": lambda d: fx.ActuatorLag(d.rng.uniform(0.0, 5.0) * DT),
    "eccentric_encoder": lambda d: fx.EccentricEncoder(d.decade(-6.0, -4.0), 0.02, d.phase),
    "presliding": lambda d: fx.Presliding(d.decade(-6.0, -4.0)),
    "backlash": lambda d: fx.Backlash(d.decade(-6.0, -4.0), d.rng.uniform(0.1, 0.6)),
}  # fmt: skip


def design_with(slug: str, seed: int) -> dfc.Compensation | None:
    """A design whose axis has an effect; None if such an axis cannot be designed for."""
    if slug == NONE:
        return designs(seed)
    names = list(EFFECTS)
    rng = np.random.default_rng([69, names.index(slug), seed])
    plain = designs(seed)
    found = [EFFECTS[slug](Draw(plain.axis, rng))]
    if rng.random() < 0.5:
        other = str(rng.choice([one for one in names if one != slug]))
        found.append(EFFECTS[other](Draw(plain.axis, rng)))
    travel = (-0.12, 0.12) if rng.random() < 0.7 else None
    mismatch = 0.0 if rng.random() < 0.33 else plain.mismatch
    try:
        axis = plain.axis.replace(effects=tuple(found), travel=travel)
        return dfc.design_compensation(
            axis, DT, plain.encoder_quantum, plain.input_delay, mismatch=mismatch, law=plain.law
        )
    except ValueError:
        return None


def plant_with(comp: dfc.Compensation, case: Case) -> dfc.FrictionAxis:
    """The axis of a case with the effects of the design's."""
    bare = plant(comp, case)
    late = sum(one.delay for one in bare.effects)
    own = [one for one in comp.axis.effects if one.slug != "input_delay"]
    late += sum(one.delay for one in comp.axis.effects if one.slug == "input_delay")
    return bare.replace(effects=(*own, dfc.effects.InputDelay(late)) if late > 0.0 else tuple(own))


def nominal(case: Case) -> Case:
    """The same move of the nominal axis."""
    return replace(
        case, mass=0.0, viscous=0.0, plus=0.0, minus=0.0, excess=0.0, stribeck=0.0, delay=0.0
    )


def reference_of(comp: dfc.Compensation, case: Case, rest: float = 0.0) -> dfc.MotionProfile:
    """The move of a case, also where no tube is certified, and a rest [s] after it."""
    error = comp.certificate.nominal.l1 * comp.axis.coulomb.mean
    rows = move_within(case, error, comp.bandwidth).rows
    still = np.zeros((3, round(rest / DT)))
    still[0] = rows[0, -1]
    return dfc.MotionProfile(DT, *np.hstack([rows, still]))


def broken(comp: dfc.Compensation, case: Case, rest: float) -> Iterator[tuple[str, float]]:
    """What the simulation gives of a move, each over what the certificate states."""
    reference = reference_of(comp, case, rest)
    certificate = comp.certify(reference=reference)
    try:
        run = dfc.simulate_loop(
            plant_with(comp, case), comp.controller, reference, quantum=comp.encoder_quantum
        )
    except ValueError:  # an axis that no simulation can follow, such as one of a huge drag
        yield "not simulated", 0.0
        return
    if math.isfinite(certificate.tube):
        yield "tube", float(np.abs(reference.position - run.y[0]).max()) / certificate.tube
        if not any(one.action == "input" for one in comp.axis.effects):
            yield "drive", float(np.abs(run.y[4]).max()) / certificate.drive_needed
    if certificate.no_hunting and rest > 0.0:
        late = run.y[:, -round(1.0 / DT) :]
        yield "rest", 2.0 * bool(np.any(late[3]) or np.ptp(late[4]) > 1e-9 * np.abs(late[4]).max())


def diverges(comp: dfc.Compensation, case: Case) -> bool:
    """Whether the nominal axis diverges at nine tenths of the delay margin."""
    late = dfc.effects.InputDelay(0.9 * comp.certificate.delay_margin)
    own = [one for one in comp.axis.effects if one.slug != "input_delay"]
    known = sum(one.delay for one in comp.axis.effects if one.slug == "input_delay")
    axis = comp.axis.replace(effects=(*own, replace(late, delay=late.delay + known)))
    reference = reference_of(comp, case)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        dfc.simulate_loop(axis, comp.controller, reference, quantum=comp.encoder_quantum)
    return any("diverges" in str(one.message) for one in caught)


def attack_effect(slug: str, count: int, first: int, each: int) -> Counter[str]:
    """Cases, certified ones and broken statements of designs with an effect."""
    told: Counter[str] = Counter()
    for seed in range(first, first + count):
        comp = design_with(slug, seed)
        if comp is None:
            told["not designed"] += 1
            continue
        rng = np.random.default_rng([seed, 70])
        told["designs"] += 1
        told["slow tubes"] += math.isfinite(comp.certificate.tube)
        case, worst = drawn(rng), -1.0
        names = tuple(Case.__annotations__)
        for k in range(each):
            # The first half drawn, the nominal axis and one within the mismatch by turns.
            tried = drawn(rng) if k < (each + 1) // 2 else near(case, names[k % len(names)], rng)
            tried = nominal(tried) if k % 2 == 0 else tried
            told["cases"] += 1
            for what, ratio in broken(comp, tried, _REST if k < 2 else 0.0):
                told[what] += 1
                told[f"{what} BROKEN"] += ratio > 1.0
                if ratio > 1.0:
                    print(f"  {slug} {seed}: {what} {ratio:.3g}, {comp.axis.effects}, {tried}")
                if what == "tube" and ratio > worst:
                    worst, case = ratio, tried
        if comp.certificate.delay_margin > 0.0:
            told["margin"] += 1
            bad = diverges(comp, nominal(case))
            told["margin BROKEN"] += bad
            if bad:
                print(f"  {slug} {seed}: margin, {comp.axis.effects}, {case}")
        told["worst [%]"] = max(told["worst [%]"], round(100.0 * worst))
    return told


if __name__ == "__main__":
    given = parser_of(
        __doc__,
        {
            "--designs": (100, "of each kind"),
            "--each": (50, "moves of one design"),
            "--first": (0, "seed of the first design"),
            "--only": ((NONE, *EFFECTS), "effects to attack"),
        },
    ).parse_args()
    warnings.simplefilter("ignore")
    total: Counter[str] = Counter()
    for slug in given.only:
        told = attack_effect(slug, given.designs, given.first, given.each)
        total += told
        print(f"{slug:24s}", ", ".join(f"{what} {n}" for what, n in told.items() if n), flush=True)
    broken_ones = sum(n for what, n in total.items() if "BROKEN" in what)
    names = ("designs", "cases", "tube", "drive", "rest", "margin")
    print(f"all: {', '.join(f'{total[n]} {n}' for n in names)}; {broken_ones} broken")
    sys.exit(broken_ones > 0)
