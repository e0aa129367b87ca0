"""The units of force, length and time change no result.

An axis in newtons, metres and seconds is written again in other units, from
micronewtons to meganewtons and from increments to kilometres, sampled every
10 us to 20 ms, and every result must come back the same, whole pipeline included.

Factors are powers of two unless a test says otherwise: they scale without
round-off, so that arithmetic free of units of its own returns the same digits.
What is left to tolerate is named where it is tolerated.
"""

import re
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from diagnosis_cases import among, driven
from each_effect import BY_SLUG as EFFECTS
from hypothesis import given, settings
from hypothesis import strategies as st

import dryfric_control as dfc
from dryfric_control.identification import slow_ramp_experiment

DT = 1.25e-3  # times 2^-7 to 2^4: 10 us to 20 ms

# Powers of force, length and time in a unit.
SYMBOLS = {
    "N": (1, 0, 0), "m": (0, 1, 0), "s": (0, 0, 1), "kg": (1, -1, 2), "Hz": (0, 0, -1),
    "rad": (0, 0, 0), "1": (0, 0, 0),
}  # fmt: skip
FORCE, LENGTH, TIME, SPEED, RATE = (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 1, -1), (0, 0, -1)


def powers(unit):
    """Powers of force, length and time in a unit such as "N s^2/m^2"."""
    total = np.zeros(3, int)
    for part, sign in zip(unit.split("/"), (1, -1), strict=False):
        for word in part.split():
            symbol, power = re.fullmatch(r"(\w+?)(?:\^(\d+))?", word).groups()
            total += sign * int(power or 1) * np.array(SYMBOLS[symbol])
    return tuple(total.tolist())


@dataclass(frozen=True)
class Units:
    """How many of the new units make one of the old."""

    force: float = 1.0
    length: float = 1.0
    time: float = 1.0

    def of(self, kind):
        f, x, t = kind
        return self.force**f * self.length**x * self.time**t

    def axis(self, axis):
        """The same axis in the new units."""
        levels = [
            [c * self.of((1, -i, 0)) for i, c in enumerate(side)]
            for side in (axis.coulomb.plus, axis.coulomb.minus)
        ]
        peak = axis.stribeck
        return axis.replace(
            mass=axis.mass * self.of((1, -1, 2)), viscous=axis.viscous * self.of((1, -1, 1)),
            coulomb=dfc.CoulombMap(*levels),
            stribeck=peak and dfc.Stribeck(peak.excess, peak.speed * self.of(SPEED)),
            stick_speed=axis.stick_speed * self.of(SPEED),
            stick_rate=axis.stick_rate * self.of(RATE),
            travel=axis.travel and tuple(x * self.length for x in axis.travel),
            effects=tuple(self.effect(effect) for effect in axis.effects),
        )  # fmt: skip

    def effect(self, effect):
        sizes = {n: self.of(powers(meta["unit"])) for n, meta in effect.parameters().items()}
        if effect.slug == "gravity":  # x is an angle: its amplitude is force by force
            sizes["amplitude"] = self.force
        return replace(effect, **{n: getattr(effect, n) * size for n, size in sizes.items()})


@st.composite
def scales(draw, length=True):
    """Micronewtons to meganewtons, nanometres to kilometres, 10 us to 20 ms."""
    force, way = draw(st.integers(-20, 20)), draw(st.integers(-30, 10))
    return Units(2.0**force, 2.0**way if length else 1.0, 2.0 ** draw(st.integers(-7, 4)))


@st.composite
def axes(draw, slugs=tuple(EFFECTS), most=4):
    effects = {}  # one of each action that an axis may have once
    for slug in draw(st.lists(st.sampled_from(slugs), unique=True, max_size=most)):
        action = EFFECTS[slug].action
        once = action in ("delay", "lag", "contact", "transmission")
        effects.setdefault(action if once else slug, EFFECTS[slug])
    peak = draw(st.booleans())
    levels = [(8.0, None), ((8.0, 6.0), None), (([8.0, 3.0], [7.0, -2.0, 4.0]), (-0.2, 0.3))]
    coulomb, travel = draw(st.sampled_from(levels))
    return dfc.FrictionAxis(
        mass=draw(st.floats(0.5, 4.0)),
        viscous=draw(st.sampled_from([0.0, 6.0, 40.0])),
        coulomb=dfc.CoulombMap(*coulomb) if travel else coulomb,
        stribeck=dfc.Stribeck(draw(st.floats(0.05, 1.0)), 0.02) if peak else None,
        stick_speed=10.0 ** draw(st.floats(-6, -2)),
        stick_rate=draw(st.floats(50.0, 1500.0)),
        travel=travel,
        switching=draw(st.sampled_from(["filippov", "paper"])),
        effects=tuple(effects.values()),
    )


def shaken(n, seed, size=25.0):
    """Steps of random height that stop, start and turn the axis many times."""
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-size, size, n // 20 + 1), 20)[:n]


KINDS = (LENGTH, SPEED, FORCE, (0, 0, 0))  # x, v, F, mode


def same(new, old, units, kinds=KINDS):
    """Rows of results agree digit by digit, the time axis aside."""
    sizes = np.array([[units.of(kind)] for kind in kinds])
    # Leftover speeds are cut off at 1e-250, whatever the unit.
    np.testing.assert_allclose(new[: len(kinds)] / sizes, old[: len(kinds)], rtol=0, atol=1e-200)


@settings(max_examples=100)
@given(st.data())
def test_simulation(data):
    axis = data.draw(axes())
    units = data.draw(scales(length="gravity" not in {e.slug for e in axis.effects}))
    u = shaken(400, data.draw(st.integers(0, 1000)))
    hold = data.draw(st.sampled_from(["zero", "first"]))
    x0, v0 = data.draw(st.floats(-0.1, 0.1)), data.draw(st.sampled_from([0.0, 0.3, -0.05]))
    one = axis.simulate(u, DT, x0=x0, v0=v0, hold=hold)
    other = units.axis(axis).simulate(
        u * units.force, DT * units.time, x0 * units.length, v0 * units.of(SPEED), hold
    )
    same(other.y, one.y, units)
    np.testing.assert_array_equal(other.events.time / units.time, one.events.time)
    np.testing.assert_array_equal(other.events.before, one.events.before)
    np.testing.assert_array_equal(other.events.after, one.events.after)


@settings(max_examples=40)
@given(st.data())
def test_closed_loop(data):
    axis = data.draw(axes(most=2))
    units = data.draw(scales(length="gravity" not in {e.slug for e in axis.effects}))
    wanted = 0.05 * np.sign(np.sin(np.arange(400) / 40.0))
    quantum = data.draw(st.sampled_from([0.0, 1e-6, 1e-4]))
    there, dt = units.axis(axis), DT * units.time
    old = dfc.PositionController.from_bandwidth(axis, 20.0, DT)
    new = dfc.PositionController.from_bandwidth(there, 20.0 / units.time, dt)
    kinds = dict(kp=(1, -1, 0), ki=(1, -1, -1), kd=(1, -1, 1))
    kinds |= dict(dt=TIME, limit=FORCE, filter_time=TIME)
    scaled = {name: getattr(old, name) * units.of(kind) for name, kind in kinds.items()}
    # Pole placement inverts a 3x3 matrix whose columns the units stretch.
    found = {name: getattr(new, name) for name in kinds}
    assert found == pytest.approx(scaled, rel=1e-9, abs=0.0)
    one = dfc.simulate_loop(axis, old, wanted, quantum=quantum)
    quantum, wanted = quantum * units.length, wanted * units.length
    other = dfc.simulate_loop(there, replace(old, **scaled), wanted, quantum=quantum)
    same(other.y, one.y, units, (*KINDS, FORCE, LENGTH))
    np.testing.assert_array_equal(other.events.time / units.time, one.events.time)


DESIGNED = dfc.FrictionAxis(
    mass=2.0, viscous=15.0, coulomb=(8.0, 6.0), stribeck=dfc.Stribeck(0.3, 0.01),
    effects=(EFFECTS["spring"], EFFECTS["actuator_lag"], EFFECTS["drift"]),
)  # fmt: skip
# Micronewtons and increments; the second rounds off.
ABROAD = (Units(2.0**-20, 2.0**-30, 2.0**-7), Units(3.7e-5, 1.9e4, 7.3))
SPECS = {
    "sensor": {"encoder_quantum": (1e-6, LENGTH)},
    "amplitudes": {
        "uncertainty": (1.0, FORCE), "noise": (1e-4, LENGTH), "drift": (0.01, FORCE),
        "decay": (0.995, (0, 0, 0)),
    },
    "nothing": {},
}  # fmt: skip
GAINS = ((0, 0, 0), RATE, (1, -1, 0))


@cache
def designed(method, spec, units=Units()):
    given = {name: value * units.of(kind) for name, (value, kind) in SPECS[spec].items()}
    memory = {"path": 2}.get(method)
    form = "prediction" if method == "paper" else "current"
    return dfc.design_pi_observer(
        units.axis(DESIGNED), DT * units.time, method=method, window=memory, form=form, **given
    )


@pytest.mark.parametrize(
    ("method", "spec"),
    [("paper", "amplitudes"), ("slack", "sensor"), ("path", "amplitudes"), ("path", "nothing")],
)  # fmt: skip
@pytest.mark.parametrize("units", ABROAD)
def test_synthesis(method, spec, units):
    old, new = designed(method, spec), designed(method, spec, units)
    exact, there, here = units is ABROAD[0], new.certificate, old.certificate
    for found, expected, rtol in (
        # z is a speed.  The solver stops at 1e-6, the bisections for the bounds at 2e-5.
        (new.gamma, old.gamma, 4e-6),
        (there.limit, here.limit, 4e-5),
        (new.lower_bound, old.lower_bound, 4e-5),
    ):
        rtol = 0.0 if exact else rtol
        assert found / units.of(SPEED) == pytest.approx(expected, rel=rtol, abs=0.0)
    assert there.worst_sequence == here.worst_sequence
    assert there.hardest_sequence == here.hardest_sequence
    assert new.decay == pytest.approx(old.decay, rel=1e-12)  # round-off of a root
    assert there.margin > 0.0
    scaled = new.node_gains / np.array([units.of(kind) for kind in GAINS])
    if exact:
        np.testing.assert_array_equal(scaled, old.node_gains)
        assert (there.spectral_radius, there.margin) == (here.spectral_radius, here.margin)
    elif method in ("paper", "slack"):
        # A gamma known to 1e-9 fixes its minimiser to the root of that.  With memory several
        # gains reach the same gamma: rounding decides among them, nothing to compare.
        np.testing.assert_allclose(scaled, old.node_gains, rtol=1e-4)


@pytest.mark.parametrize("switching", ["reading", "paper", "filippov"])
@settings(max_examples=10)
@given(scales(), st.integers(0, 1000))
def test_observer(switching, units, seed):
    old = designed("slack", "sensor")
    scale = np.array([units.of(kind) for kind in GAINS])
    # The same design in other units, gains and all: the solver is left out of this.
    new = replace(
        old, axis=units.axis(old.axis), dt=old.dt * units.time,
        encoder_quantum=old.encoder_quantum * units.length, node_gains=old.node_gains * scale,
    )  # fmt: skip
    u = shaken(500, seed)
    y = 1e-6 * np.round(1e6 * DESIGNED.simulate(u, DT).y[0])
    one = dfc.observe(old, u, y, xhat0=0.01, switching=switching)
    other = dfc.observe(
        new, u * units.force, y * units.length, xhat0=0.01 * units.length, switching=switching
    )
    assert set(one.mode) == {-1, 0, 1}
    same(other.y, one.y, units, (LENGTH, SPEED, FORCE, FORCE, (0, 0, 0)))


BELIEVED = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
BASE = {"mass": (1, -1, 2), "viscous": (1, -1, 1), "coulomb": FORCE}


def shaken_record(machine, units, seconds=3.0):
    """A run of a machine, written down in other units."""
    one = driven(machine, seconds)
    return dfc.Record(one.t * units.time, one.u * units.force, one.x * units.length)


# Powers of two in force and length, from micronewtons and increments to meganewtons.
LANDS = (Units(2.0**20, 2.0**20), Units(2.0**-20, 2.0**-30))
# Seconds counted otherwise: 16 ms and 8 us a sample.  `motion.LONGEST`, half the time within which
# a motion must show, is 0.05 s for everybody: a record read in other seconds is not the same.
CLOCKS = (Units(time=2.0**4), Units(time=2.0**-7))
HIDDEN = {
    "bias and spring": (
        (dfc.effects.BiasForce(0.7), dfc.effects.Spring(9.0, 0.02)),
        {"bias_force.force": FORCE, "spring.stiffness": (1, -1, 0)},
    ),
    "position": (dfc.effects.PositionDependence(0.6), {"position_dependence.slope": (0, -1, 0)}),
}


@cache
def fitted(hidden, units):
    """Base parameters and more, from 50 % and 40 % off, in the old units, with their errors."""
    effects, more = HIDDEN[hidden]
    machine, kinds = BELIEVED.replace(effects=effects), BASE | more
    found = dfc.fit(
        units.axis(BELIEVED.replace(mass=3.0, coulomb=5.0)), shaken_record(machine, units),
        tuple(kinds), window=0.25 * units.time, block=0.5 * units.time,
    )  # fmt: skip
    size = np.array([units.of(kind) for kind in kinds.values()])
    return [np.array(list(d.values())) / size for d in (found.parameters, found.standard_errors)]


@pytest.mark.filterwarnings("ignore::dryfric_control.identification.FitWarning")
@pytest.mark.parametrize(
    ("hidden", "units"),
    [*(("bias and spring", units) for units in (*LANDS, *CLOCKS)),
     ("position", Units(length=2.0**-30))],
)  # fmt: skip
def test_fit(hidden, units):
    values, errors = fitted(hidden, Units())
    there, spread = fitted(hidden, units)
    # A mass is searched by its logarithm, which the unit shifts and so rounds off
    # otherwise; the search stops far inside a standard error.  In other seconds at most a
    # standard error from what 0.05 s say on the starts of windows at rest.
    same_time = units.time == 1.0
    np.testing.assert_allclose((there - values) / errors, 0.0, atol=1e-3 if same_time else 1.0)
    if same_time:
        np.testing.assert_allclose(spread, errors, rtol=1e-3)


CRAWLING = dfc.FrictionAxis(
    mass=2.0, viscous=15.0, coulomb=dfc.CoulombMap([8.0, 6.0], 7.0), travel=(0.0, 0.1),
    stribeck=dfc.Stribeck(0.2, 0.01),
)  # fmt: skip


@cache
def levels(units, known):
    """Levels over the travel, their errors, mass and viscous coefficient, in the old units."""
    ramp = slow_ramp_experiment(CRAWLING, duration=12.0, quantum=1e-6, bandwidth=20.0).record
    record = dfc.Record(
        ramp.t * units.time, ramp.u * units.force, ramp.x * units.length,
        quantum=1e-6 * units.length,
    )  # fmt: skip
    found = dfc.identify_coulomb(record, axis=units.axis(CRAWLING) if known else None)
    x = np.linspace(0.01, 0.09, 9)
    sides = [found(x * units.length, s) / units.force for s in (1, -1)]
    spread = [found.standard_error(x * units.length, s) / units.force for s in (1, -1)]
    return found.degrees, np.array(sides), np.array(spread)


@pytest.mark.filterwarnings("ignore::dryfric_control.identification.FitWarning")
@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("units", [*LANDS, *CLOCKS])
def test_coulomb_levels(units, known):
    degrees, value, spread = levels(Units(), known)
    there_degrees, there, there_spread = levels(units, known)
    assert there_degrees == degrees
    # Least squares in one step: round-off; in other seconds a standard error, as above.
    tolerance = 1e-6 if units.time == 1.0 else 1.0
    np.testing.assert_allclose((there - value) / spread, 0.0, atol=tolerance)
    if units.time == 1.0:
        np.testing.assert_allclose(there_spread, spread, rtol=1e-6)


@cache
def diagnosed(slug, units=Units()):
    hidden = dict(nothing=(), spring=dfc.effects.Spring(40.0, 0.05))
    hidden["position_dependence"] = dfc.effects.PositionDependence(1.5)
    record = shaken_record(BELIEVED.replace(effects=hidden[slug]), units, 4.0)
    names = "spring", "gravity", "position_dependence", "bias_force", "cogging", "drift"
    with among(*names):
        return dfc.diagnose(units.axis(BELIEVED), record, window=0.25 * units.time, jobs=1)


@pytest.mark.slow
@pytest.mark.parametrize(("slug", "units"), [
    ("nothing", LANDS[0]), ("spring", Units(2.0**-20, 2.0**10)), ("position_dependence", LANDS[1]),
])  # fmt: skip
def test_diagnosis(slug, units):
    old, new = diagnosed(slug), diagnosed(slug, units)
    assert new.verdict == old.verdict == ("explained" if old.causes else "nothing to find")
    assert (slug in [cause.effect for cause in new.causes]) == (slug != "nothing")
    assert [cause.effect for cause in new.causes] == [cause.effect for cause in old.causes]
    # Deviations in standard errors: the search runs through the same numbers, rounded otherwise.
    atol, rtol = 1e-3, 1e-6
    for mine, theirs in zip(new.causes, old.causes, strict=True):
        # A sine of x knows the unit of x, an angle: over nanometres called radians it
        # is the spring itself.
        assert set(mine.alternatives) - {"gravity"} == set(theirs.alternatives) - {"gravity"}
        assert mine.held_out_gain == pytest.approx(theirs.held_out_gain, rel=rtol)
        for name, value in theirs.parameters.items():
            size = units.of(BASE[name] if name in BASE else powers(theirs.units[name]))
            there = mine.parameters[name] / size
            assert (there - value) / theirs.standard_errors[name] == pytest.approx(0.0, abs=atol)
    assert new.gain.ratio == pytest.approx(old.gain.ratio, rel=rtol)
    for name in ("before", "after", "floor"):
        there = getattr(new.gain, name) / units.length
        assert there == pytest.approx(getattr(old.gain, name), rel=rtol)
