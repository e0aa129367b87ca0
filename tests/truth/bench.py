"""Random closed-loop records with hidden effects, seeded.

    case = make_case("bias_force", seed=3)            # one hidden effect
    case = make_pair(seed=3), make_null(seed=3), make_outside(seed=3)
    runs = make_machine(seed=3)                       # two to four effects, three records

An effect's strength is drawn relative to the axis (a share of its Coulomb
level, say) from the band written in `Bands.draw`.  Every effect must matter in the
record: `Case.visibility` is the mean over windows of 0.25 s of
log(1 + (RMS error / quantum)^2) of a free run of the plant without that
effect, started from the true state; for effects outside the catalogue, local
or rare by nature, the mean over the loudest tenth of the windows.  Below
`VISIBLE` the strength is redrawn from a band stretched by 1.5, then by 2.25;
if that does not help, the axis and the reference are redrawn too (a record
without slow break-aways after rests cannot show `dwell_time`).
"""

import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .bands import ADDED, DT, EFFECTS, KNOWN, OUTSIDE, Bands, Effects, slowest
from .plant import Plant, closed_loop, free_runs
from .recorder import RECORDERS, noisy, recorded
from .reference import make_reference, make_runs

Array = NDArray[np.float64]

WINDOW = 250
VISIBLE = 1.0  # spurious candidates gain at most 0.03 on this scale
LOUD = 4.0  # the same for the loudest tenth: RMS error of 7 quanta
CONDITIONS = ("exact", "off", "coarse", "short")

# Pairs that one record can hardly hold apart by construction (the same force on
# most of the record), or that the bench cannot combine (two transmissions).
EQUAL = frozenset(
    frozenset(pair.split())
    for pair in """
    bias_force coulomb_asymmetry, coulomb dead_zone, input_gain load_dependence,
    input_delay actuator_lag, spring gravity, bias_force spring,
    bias_force gravity, coulomb_asymmetry spring, coulomb_asymmetry gravity,
    coulomb drift, coulomb position_dependence, viscous quadratic_drag,
    inertia input_gain, coulomb input_gain, coulomb load_dependence,
    dead_zone input_gain, dead_zone load_dependence, backlash compliance,
    presliding compliance, presliding backlash
""".split(",")
)


@dataclass(frozen=True)
class Case:
    """One record, of n samples, with everything that is true about it."""

    t: Array  # [s]
    u: Array  # held drive force [N], or N m on an axis in rad
    x: Array  # encoder reading [m or rad]
    reference: Array
    quantum: float  # of the encoder
    noise: float  # standard deviation of its noise
    # Base axis as the user believes it and as it is: mass, viscous, coulomb, stribeck (None or
    # excess and speed), stick_speed, travel.
    believed: dict[str, Any]
    actual: dict[str, Any]
    truth: Effects  # hidden effects, {slug: {parameter: value}}; empty for a clean record
    # {slug: (slug, ...)}: effects that give the very same record on this axis, whatever is done
    # with it (a bias is an asymmetry without a Stribeck peak).
    twins: dict[str, tuple[str, ...]]
    visibility: dict[str, float]  # score of each hidden effect, see above
    condition: str
    seed: int
    unit: str  # "m" or "rad"
    plant: Plant
    substeps: int
    states: Array  # true ones, shape (n, 7), for checks of the generator only


def make_case(
    effects: str | Sequence[str] | Mapping[str, Mapping[str, float]],
    seed: int,
    condition: str = "exact",
) -> Case:
    """Closed-loop record of a random axis with `effects` hidden in it.

    Parameters
    ----------
    effects : str, sequence of str or dict
        Slugs with random parameters, or {slug: parameters} with given ones
        (then used as they are, without the visibility check).
    seed : int
    condition : {"exact", "off", "coarse", "short"} or one of `RECORDERS`
        Believed base parameters exact, encoder 1 to 5 um, 20 s; each of mass,
        viscous and coulomb believed up to 3 % wrong; 50 um encoder; 6 s of steps.
        A recorder spoils the record "exact" of the same seed, see `recorder`.
    """
    if condition in RECORDERS:
        return _spoiled(make_case(effects, seed), condition)
    slugs = (effects,) if isinstance(effects, str) else tuple(effects)
    for slug in slugs:
        if slug not in KNOWN:
            raise ValueError(f"effects: unknown effect {slug!r}; one of {', '.join(KNOWN)}")
    if len({"backlash", "compliance", "load_encoder_backlash"} & set(slugs)) > 1:
        raise ValueError("effects: the bench has one transmission: backlash or compliance")
    if condition not in CONDITIONS:
        known = ", ".join((*CONDITIONS, *RECORDERS))
        raise ValueError(f"condition {condition!r}: one of {known}")
    rng = _random(seed, slugs, CONDITIONS.index(condition))
    if isinstance(effects, Mapping):
        for slug in slugs:
            if not KNOWN[slug]:
                raise ValueError(f"effects: {slug!r} has no parameters to give; pass its name")
        return _Bench(rng, slugs, condition).run({k: dict(p) for k, p in effects.items()}, seed)
    for _ in range(20):
        bench = _Bench(rng, slugs, condition)
        for stretch in (1.0, 1.5, 2.25):
            case = bench.run({slug: bench.bands.draw(slug, stretch) for slug in slugs}, seed)
            least = {slug: LOUD if slug in OUTSIDE else VISIBLE for slug in slugs}
            if all(score >= least[slug] for slug, score in case.visibility.items()):
                return case
    raise RuntimeError(f"no record shows all of {slugs} (seed {seed}, {condition}); widen a band")


def _random(seed: int, slugs: Iterable[str], condition: int) -> np.random.Generator:
    """Random numbers of their own for each set of effects and each condition."""
    return np.random.default_rng([seed, zlib.crc32(" ".join(sorted(slugs)).encode()), condition])


def make_null(seed: int, condition: str = "exact") -> Case:
    """Record of an axis with nothing hidden in it."""
    return make_case((), seed, condition)


def make_pair(seed: int, condition: str = "exact", pair: tuple[str, str] | None = None) -> Case:
    """Record with two effects, drawn from all pairs not in `EQUAL`."""
    if pair is None:
        rng = np.random.default_rng([seed, 2])
        while pair is None or frozenset(pair) in EQUAL:
            first, second = rng.choice(len(EFFECTS), size=2, replace=False)
            pair = (EFFECTS[first], EFFECTS[second])
    return make_case(pair, seed, condition)


def make_outside(seed: int, condition: str = "exact", kind: str | None = None) -> Case:
    """Record with an effect that no candidate of the catalogue describes."""
    return make_case(OUTSIDE[seed % len(OUTSIDE)] if kind is None else kind, seed, condition)


def make_machine(seed: int, effects: int | Sequence[str] | None = None) -> tuple[Case, ...]:
    """Three records of one machine that is far from what is believed of it.

    Each of mass, viscous and coulomb is believed 20 % wrong, not all to the same
    side; the recorded input has white noise of 2 % of the Coulomb level; the runs
    last 7 to 9 s, and only together hold every piece of a reference.  Time starts
    at zero in each.

    Parameters
    ----------
    seed : int
    effects : int or sequence of str, optional
        Hidden effects or their number, 0 for none; two to four when left out.
        Wrong base parameters are no effects here: they are always wrong.
    """
    rng = np.random.default_rng([seed, 3])
    if effects is None or isinstance(effects, int):
        count = int(rng.integers(2, 5)) if effects is None else effects
        pool = [slug for slug in EFFECTS if slug not in BASE]
        while True:
            slugs = tuple(str(s) for s in rng.choice(pool, size=count, replace=False))
            if not any(pair <= set(slugs) for pair in EQUAL):
                break
    else:
        slugs = tuple(effects)
    for _ in range(20):
        bench = _Bench(rng, slugs, "off")
        sides = rng.permutation([1.0, -1.0, rng.choice((-1.0, 1.0))])
        for key, side in zip(BASE.values(), sides, strict=True):
            bench.believed[key] = bench.axis[key] * (1.0 + 0.2 * side)
        runs = make_runs(rng, bench.axis["travel"], bench.speed, DT)
        for stretch in (1.0, 1.5, 2.25):
            hidden = {slug: bench.bands.draw(slug, stretch) for slug in slugs}
            cases = [bench.rerun(reference, hidden, seed) for reference in runs]
            if all(np.mean([c.visibility[slug] for c in cases]) >= VISIBLE for slug in slugs):
                size = 0.02 * bench.axis["coulomb"]
                return tuple(
                    replace(c, u=noisy(c.u, size, rng), condition="machine") for c in cases
                )
    raise RuntimeError(f"no runs show all of {slugs} (seed {seed}); widen a band")


def _spoiled(case: Case, condition: str) -> Case:
    """The case as a poor logger has recorded it."""
    rng = _random(case.seed, case.truth, len(CONDITIONS) + RECORDERS.index(condition))
    t, u, x, kept = recorded(
        condition, case.t, case.u, case.x, case.states, case.quantum,
        case.actual["coulomb"], bool(case.seed % 2), rng,
    )  # fmt: skip
    return replace(
        case, t=t, u=u, x=x, reference=case.reference[kept], states=case.states[kept],
        condition=condition,
    )  # fmt: skip


def visibility(case: Case, slug: str) -> float:
    """Score of free runs of the plant without `slug`; see the module."""
    rest = {name: p for name, p in case.truth.items() if name != slug}
    base = {BASE[slug]: case.believed[BASE[slug]]} if slug in BASE else {}
    plant = _plant(case.actual | base, rest)
    x = free_runs(plant, case.u, DT, case.substeps, case.states, WINDOW)
    n = case.t.size // WINDOW * WINDOW
    error = (case.x - x)[:n].reshape(-1, WINDOW) / case.quantum
    score = np.sort(np.log1p(np.mean(error**2, axis=1)))
    return float(np.mean(score[-max(1, score.size // 10) :] if slug in OUTSIDE else score))


BASE = {"inertia": "mass", "viscous": "viscous", "coulomb": "coulomb"}


def _plant(axis: Mapping[str, Any], truth: Mapping[str, Mapping[str, float]]) -> Plant:
    """The plant of a base axis with effects."""
    low, high = axis["travel"]
    values = {name: axis[name] for name in ("mass", "viscous", "coulomb", "stick_speed")}
    values |= {"middle": 0.5 * (low + high), "half_travel": 0.5 * (high - low)}
    for slug, parameters in {"stribeck": axis["stribeck"] or {}, **truth}.items():
        names = KNOWN[slug]
        values |= {names[name]: value for name, value in parameters.items() if name in names}
    values["load_encoder"] = float("load_encoder_backlash" in truth)
    if {"backlash", "load_encoder_backlash"} & set(truth):
        # Contact: the Coulomb level bends it by 2e-6 of the travel (0.6 um of
        # 0.3 m), damping ratio 0.7: next to rigid, next to no rebound.
        share = values["load_fraction"]
        reduced = values["mass"] * share * (1.0 - share)
        stiffness = axis["coulomb"] / (2e-6 * (high - low))
        values["coupling_stiffness"] = stiffness
        values["coupling_damping"] = 2.0 * 0.7 * np.sqrt(stiffness * reduced)
    return Plant(**{name: float(value) for name, value in values.items()})


def _substeps(plant: Plant) -> int:
    """Enough substeps that a finer grid moves nothing by a tenth of a quantum."""
    if plant.gap > 0.0:
        return 120
    return 40 if plant.load_fraction > 0.0 or plant.presliding > 0.0 else 30


def _twins(axis: Mapping[str, Any], truth: Effects) -> dict[str, tuple[str, ...]]:
    known = "stribeck position_dependence presliding drift backlash compliance"
    even = {*ADDED, *known.split()}
    if axis["stribeck"] is None and "bias_force" in truth and not even & set(truth):
        return {"bias_force": ("coulomb_asymmetry",)}
    return {}


class _Bench:
    """Axis, controller, encoder and reference of one record."""

    def __init__(self, rng: np.random.Generator, slugs: tuple[str, ...], condition: str) -> None:
        self.rng, self.condition = rng, condition
        rotary = "gravity" in slugs or rng.random() < 0.15
        self.unit = "rad" if rotary else "m"
        self.scale = scale = 12.0 if rotary else 1.0  # a rotary travel is 12 times as many units
        mass = 10.0 ** rng.uniform(0.0, 1.3)
        coulomb = mass * 10.0 ** rng.uniform(-0.3, 0.6)  # stops 0.5 to 4 m/s^2
        viscous = mass * rng.uniform(2.0, 12.0)
        travel = scale * rng.uniform(0.2, 0.5)
        excess = rng.uniform(0.1, 0.5)
        speed = max(scale * rng.uniform(0.005, 0.02), slowest(excess, coulomb, mass / scale))
        # Without a Stribeck peak an asymmetry *is* a bias, F = s Fc + b either way:
        # nothing could name it, so that its axes have one.
        peaked = "coulomb_asymmetry" in slugs or rng.random() < 0.5
        flat = "stribeck" in slugs or not peaked
        self.axis: dict[str, Any] = {
            "mass": mass / scale,
            "viscous": viscous / scale,
            "coulomb": coulomb,
            "stribeck": None if flat else {"excess": excess, "speed": speed},
            "stick_speed": scale * 10.0 ** rng.uniform(-5.0, -4.0),
            "travel": (0.0, travel),
        }
        self.speed = scale * rng.uniform(0.25, 0.5)
        short = condition == "short"
        self.reference = make_reference(rng, self.axis["travel"], self.speed, DT, short)
        n = self.reference.size
        fine = rng.uniform(1.0, 5.0)
        self.coarse = condition == "coarse"
        self.quantum = scale * 1e-6 * (50.0 if self.coarse else fine)
        self.noise = self.quantum * (rng.uniform(0.1, 0.4) if rng.random() < 0.5 else 0.0)
        self.readings = self.noise * rng.standard_normal(n)
        # A coarse encoder gets a softer loop and a slower speed filter, else its
        # steps alone would drive the axis through its friction.
        omega = rng.uniform(25.0, 32.0 if self.coarse else 45.0)
        damping = rng.uniform(0.7, 1.0)
        m = self.axis["mass"]
        self.kp = m * omega**2
        self.kd = 2.0 * damping * m * omega
        self.ki = self.kp * rng.uniform(1.0, 4.0) if rng.random() < 0.5 else 0.0
        self.filter_time = rng.uniform(1.5e-3, 4e-3) * (2.0 if self.coarse else 1.0)
        self.limit = 3.0 * (45.0 * m + self.axis["viscous"]) * self.speed + 6.0 * coulomb
        wrong = rng.uniform(-0.03, 0.03, size=3)
        self.believed = dict(self.axis)
        if condition == "off":
            for (slug, key), share in zip(BASE.items(), wrong, strict=True):
                if slug not in slugs:
                    self.believed[key] = self.axis[key] * (1.0 + share)
        self.push, self.wander, self.offset = np.zeros(n), np.zeros(n), np.zeros(n)
        peak = 0.0
        if "saturation" in slugs:
            u, _, _ = self._loop(_plant(self.axis, {}))
            peak = float(np.quantile(np.abs(u), 0.998))
        self.bands = Bands(
            rng, self.axis, scale, self.speed, self.coarse, peak, self.quantum, self.reference,
            self.push, self.wander, self.offset,
        )  # fmt: skip

    def _loop(self, plant: Plant) -> tuple[Array, Array, Array]:
        return closed_loop(
            plant, self.reference, DT, _substeps(plant), self.kp, self.ki, self.kd,
            self.filter_time, self.limit, self.quantum, self.readings, self.offset,
            self.push, self.wander,
        )  # fmt: skip

    def rerun(self, reference: Array, truth: Effects, seed: int) -> Case:
        """The same axis, loop and encoder on another reference."""
        n = reference.size
        noise = self.noise * self.rng.standard_normal(n)
        self.reference, self.readings = reference, noise
        self.push, self.wander, self.offset = np.zeros(n), np.zeros(n), np.zeros(n)
        return self.run(truth, seed)

    def run(self, truth: Effects, seed: int) -> Case:
        actual = self.axis | {key: truth[slug][key] for slug, key in BASE.items() if slug in truth}
        plant = _plant(actual, truth)
        u, x, states = self._loop(plant)
        case = Case(
            t=np.arange(u.size) * DT, u=u, x=x, reference=self.reference,
            quantum=self.quantum, noise=self.noise, believed=self.believed, actual=actual,
            truth=truth, twins=_twins(actual, truth), visibility={}, condition=self.condition,
            seed=seed, unit=self.unit, plant=plant, substeps=_substeps(plant), states=states,
        )  # fmt: skip
        case.visibility.update({slug: visibility(case, slug) for slug in truth})
        return case
