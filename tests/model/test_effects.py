"""Every effect against its equation, integrated by someone else."""

import math
from dataclasses import FrozenInstanceError, fields, make_dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.polynomial.chebyshev import chebval
from scipy.integrate import odeint

import dryfric_control as dfc
from dryfric_control import effects as fx
from dryfric_control.estimation.parameters import Scales, choose, values_of, with_values
from dryfric_control.model.effects.effect import REGISTRY
from dryfric_control.model.effects.levels import equivalent_values

DT = 1e-3
MASS, VISCOUS, COULOMB = 2.0, 3.0, 5.0


def axis_with(*effects):
    return dfc.FrictionAxis(mass=MASS, viscous=VISCOUS, coulomb=COULOMB, effects=effects)


def slide(u, extra, level=COULOMB, v0=0.5):
    """Slow oracle: one sliding direction, tight tolerance, no switches."""

    def rates(t, state):
        x, v = state
        c = level(t, x, u) if callable(level) else level
        return [v, (u + extra(t, x, v) - VISCOUS * v - math.copysign(c, v0)) / MASS]

    grid = np.arange(201) * DT
    return odeint(rates, [0.01, v0], grid, rtol=1e-11, atol=1e-13, mxstep=5000, tfirst=True).T


COEFFICIENTS = (0.2, -0.9, 0.6, 0.4, -0.3, 0.2, 0.1, -0.2, 0.1, 0.1, -0.1, 0.05, -0.02)
FORCES = [
    (fx.BiasForce(1.5), lambda t, x, v: 1.5),
    (fx.ViscousAsymmetry(0.7), lambda t, x, v: -0.7 * abs(v)),
    (fx.ViscousWarmUp(4.0, 0.05), lambda t, x, v: -4.0 * math.exp(-t / 0.05) * v),
    (fx.QuadraticDrag(2.5), lambda t, x, v: -2.5 * v * abs(v)),
    (fx.Spring(40.0, rest=0.02), lambda t, x, v: -40.0 * (x - 0.02)),
    (fx.Gravity(3.0, phase=0.4), lambda t, x, v: -3.0 * math.sin(x - 0.4)),
    (fx.Cogging(0.8, 0.02, 0.3), lambda t, x, v: 0.8 * math.sin(2 * math.pi * x / 0.02 + 0.3)),
    (
        fx.PositionForce(0.03, 0.04, *COEFFICIENTS),
        lambda t, x, v: chebval(min(max((x - 0.03) / 0.04, -1.0), 1.0), COEFFICIENTS),
    ),
    (fx.TimePeriodic(0.8, 35.0, 0.3), lambda t, x, v: 0.8 * math.sin(2 * math.pi * 35 * t + 0.3)),
]


def constant(force):
    return lambda t, x, v: force


def along(x):
    """Shares of the level of a slope and a curvature about a centre."""
    return 1.0 + 1.5 * (x - 0.02) - 2.0 * (x - 0.02) ** 2


ALONG = fx.PositionDependence(slope=1.5, curvature=-2.0, centre=0.02)
EQUATIONS = [((effect,), law, COULOMB) for effect, law in FORCES]
EQUATIONS += [
    ((ALONG,), constant(0.0), lambda t, x, u: COULOMB * along(x)),
    ((fx.FrictionRipple(0.4, 0.03, 0.5),), constant(0.0),
     lambda t, x, u: COULOMB * (1.0 + 0.4 * math.sin(2.0 * math.pi * x / 0.03 + 0.5))),
    ((fx.LoadDependence(0.1),), constant(0.0), lambda t, x, u: COULOMB + 0.1 * abs(u)),
    ((fx.Drift(0.6),), constant(0.0), lambda t, x, u: COULOMB * (1.0 + 0.6 * t)),
    # A transmission carries the drive and the weight that it lifts or lowers.
    ((fx.BiasForce(-2.0), fx.LoadDependence(0.3)), constant(-2.0),
     lambda t, x, u: COULOMB + 0.3 * abs(u + 2.0)),
]  # fmt: skip


@pytest.mark.parametrize(
    ("effects", "law", "level"), EQUATIONS, ids=lambda p: p[0].slug if isinstance(p, tuple) else ""
)
@pytest.mark.parametrize("s", [1.0, -1.0])
def test_effects_act_by_their_equations(effects, law, level, s):
    resp = axis_with(*effects).simulate(np.full(201, 9.0 * s), DT, x0=0.01, v0=0.5 * s)
    # The step's own tolerance is 1e-9 of the speed; 200 of them add up.
    np.testing.assert_allclose(resp.y[:2], slide(9.0 * s, law, level, 0.5 * s), rtol=0, atol=2e-8)


@pytest.mark.parametrize(("weight", "held"), [(7.1, True), (7.2, False)])
def test_a_weight_without_drive_holds_itself_by_the_friction_of_its_load(weight, held):
    # 5 N, and 0.3 of the weight: 7.14 N hold themselves.
    axis = axis_with(fx.BiasForce(-weight), fx.LoadDependence(0.3))
    assert bool(axis.simulate(np.zeros(101), DT).y[0, -1] == 0.0) is held


@pytest.mark.parametrize("rest", [0.01, 0.1, 1.0])
def test_breakaway_grows_with_the_time_at_rest(rest):
    axis = axis_with(fx.DwellTime(rise=3.0, time_constant=0.2))
    level = COULOMB + 3.0 * (1.0 - math.exp(-rest / 0.2))
    n = round(rest / DT)
    for force, mode in ((0.999 * level, 0), (1.001 * level, 1)):
        assert axis.simulate(np.r_[np.zeros(n), force, force], DT).mode[n] == mode
    # Sliding, and at rest again, it starts anew.
    assert dfc.axis_block(axis, DT).state_labels[3] == "rest"


def test_effects_add_up_in_any_order():
    effects = [effect for effect, _ in FORCES]
    one, other = (
        axis_with(*order).simulate(np.full(201, 9.0), DT, x0=0.01, v0=0.5)
        for order in (effects, effects[::-1])
    )
    np.testing.assert_allclose(one.y[:2], other.y[:2], rtol=1e-12)
    x, v = slide(9.0, lambda t, x, v: sum(law(t, x, v) for _, law in FORCES))
    np.testing.assert_allclose(one.y[1], v, rtol=0, atol=5e-8)


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (3, 2, 1, 0), (1, 3, 0, 2)])
def test_shares_of_the_level_multiply_in_any_order(order):
    effects = ALONG, fx.CoulombAsymmetry(1.25), fx.Drift(0.8), fx.WarmUp(0.4, time_constant=0.3)
    axis = axis_with(*(effects[i] for i in order))
    for s in (1.0, -1.0):

        def level(t, x, u, s=s):
            grown = (1.0 + 0.8 * t) * (1.0 + 0.4 * math.exp(-t / 0.3))
            return (COULOMB + 1.25 * s) * along(x) * grown

        resp = axis.simulate(np.full(201, s * 9.0), DT, x0=0.01, v0=0.5 * s)
        x, v = slide(s * 9.0, constant(0.0), level, 0.5 * s)
        np.testing.assert_allclose(resp.y[1], v, rtol=0, atol=5e-8)


@pytest.mark.parametrize("hold", ["zero", "first"])
@pytest.mark.parametrize("delay", [1e-3, 2.5e-3, 7.3e-3, 0.4e-3])
def test_input_delay_is_the_shifted_input(delay, hold):
    rng = np.random.default_rng(1)
    u = np.concatenate([np.zeros(5), 15.0 * rng.standard_normal(300)])
    fine = 10
    t = np.arange(u.size * fine) * (DT / fine)
    if hold == "zero":
        shifted = u[np.clip(np.floor((t - delay) / DT + 1e-9).astype(int), 0, None)]
    else:
        shifted = np.interp(t - delay, np.arange(u.size) * DT, u)
    shifted[t < delay] = 0.0
    one = axis_with(fx.InputDelay(delay)).simulate(u, DT, v0=0.1, hold=hold)
    other = axis_with().simulate(shifted, DT / fine, v0=0.1, hold=hold)
    np.testing.assert_allclose(one.y[0], other.y[0, ::fine], atol=1e-9)


@pytest.mark.parametrize(("effect", "u", "acting"), [
    (fx.InputGain(0.8), 10.0, 8.0), (fx.DeadZone(2.0), 1.5, 0.0),
    (fx.DeadZone(2.0), 10.0, 8.0), (fx.DeadZone(2.0), -10.0, -8.0),
    (fx.Saturation(6.5), 10.0, 6.5), (fx.Saturation(6.5), -10.0, -6.5),
])  # fmt: skip
def test_input_effect_maps_the_drive(effect, u, acting):
    one = axis_with(effect).simulate(np.full(100, u), DT, v0=0.1)
    other = axis_with().simulate(np.full(100, acting), DT, v0=0.1)
    np.testing.assert_allclose(one.y, other.y, rtol=1e-14, atol=1e-15)


CHANGES = [
    (fx.Inertia(1.3), {"mass": 1.3 * MASS}),
    (fx.ViscousFriction(0.6), {"viscous": 0.6 * VISCOUS}),
    (fx.CoulombFriction(1.2), {"coulomb": 1.2 * COULOMB}),
    (fx.StribeckPeak(0.3, 0.02), {"stribeck": dfc.Stribeck(0.3, 0.02)}),
]


@pytest.mark.parametrize(("effect", "change"), CHANGES, ids=lambda p: getattr(p, "slug", ""))
def test_axis_effect_is_the_axis_with_other_base_parameters(effect, change):
    u = 9.0 * np.sin(np.arange(2000) * 5e-3)
    base = axis_with().replace(stribeck=dfc.Stribeck(0.1, 0.05))
    believed, actual = base.replace(effects=effect), base.replace(**change)
    same = believed.simulate(u, DT).y
    # The same arrays reach the same kernel: nothing may differ.
    assert np.array_equal(same, actual.simulate(u, DT).y)
    assert not np.array_equal(same, base.simulate(u, DT).y)
    for index in (0, 1):
        one, other = believed.mode_ss(index, DT), actual.mode_ss(index, DT)
        assert np.array_equal(one.A, other.A) and np.array_equal(one.B, other.B)
    assert np.array_equal(believed.breakaway([0.0, 0.1], 1), actual.breakaway([0.0, 0.1], 1))
    assert believed.effective() == actual and actual.effective() is actual


def test_axis_effects_are_parameters_of_a_fit():
    axis = axis_with(fx.StribeckPeak(0.3, 0.02))
    scales = Scales(force=10.0, length=0.1, time=0.5, step=DT)
    # The effect's peak hides the axis' own, so that a fit must move the effect's.
    moved, chosen = choose(axis, ("inertia.factor", "stribeck.excess"), scales)
    names = [parameter.name for parameter in chosen]
    assert values_of(moved, names).tolist() == [1.0, 0.3]
    after = with_values(moved, names, [1.2, 0.4]).effective()
    assert (after.mass, after.stribeck) == (1.2 * MASS, dfc.Stribeck(0.4, 0.02))


def declared(count, law, shared=False):
    """An effect with `count` parameters, which share one declaration or have their own."""
    one = fx.parameter("N", "level", default=0.0)
    names = [(f"p{k}", float, one if shared else fx.parameter("N", "l")) for k in range(count)]
    return make_dataclass(
        "Reader", names, bases=(fx.Effect,), frozen=True,
        namespace={"slug": "reader", "action": "force", "law": staticmethod(law)},
    )  # fmt: skip


@pytest.mark.parametrize(("count", "law", "shared", "words"), [
    (1, lambda t, x, v, u, level, s, rest, p: p[1], False, r"reads p\[1\].*p\[0\] to p\[0\]"),
    (2, lambda t, x, v, u, level, s, rest, p: p[-1], False, r"reads p\[-1\]"),
    (2, lambda t, x, v, u, level, s, rest, p: p[int(t)] / v, False, r"reads p\[2\]"),
    (0, lambda t, x, v, u, level, s, rest, p: p[0], False, "declares no parameter"),
    (3, lambda t, x, v, u, level, s, rest, p: p[2], True, "p0 is no field.*for each param"),
])  # fmt: skip
def test_a_law_that_reads_numbers_not_its_own_is_refused(count, law, shared, words):
    """Compiled, it would read whatever lies behind them in memory."""
    effect = declared(count, law, shared)
    with pytest.raises(ValueError, match=words):
        fx.register_effect(effect)
    assert "reader" not in REGISTRY
    with pytest.raises(ValueError, match=words):
        axis_with(effect(*[0.0] * len(fields(effect)))).simulate(np.zeros(3), DT)
    # A law may fail where it is tried: its own table may end before the places that are.
    table = (1.0, 2.0)
    reader = declared(1, lambda t, x, v, u, level, s, rest, p: p[0] * table[int(t)])
    assert fx.register_effect(reader) is reader


def own_spring(module):
    """A class of a user with the name of one of the package, as a notebook defines it."""
    body = {"action": "force", "law": staticmethod(lambda *_: 0.0), "__module__": module}
    return type("Spring", (fx.Effect,), body)


@pytest.mark.parametrize("module", ["__main__", "my_effects"])
def test_an_effect_of_a_user_does_not_take_the_place_of_one_of_the_package(module):
    with pytest.raises(ValueError, match=r"Spring: the id 'spring' is that of .*rename the class"):
        fx.register_effect(own_spring(module))
    assert REGISTRY["spring"] is fx.Spring


@pytest.mark.parametrize("later", ["__main__", "my_effects"])
def test_an_effect_of_a_user_may_be_defined_anew(later):
    """A cell that is run again, or a class that moves from a notebook into a module."""
    body = {"action": "force", "law": staticmethod(lambda *_: 0.0)}
    first, again = (type("OwnPull", (fx.Effect,), body | {"__module__": module})
                    for module in ("__main__", later))  # fmt: skip
    try:
        fx.register_effect(first)
        assert fx.register_effect(again) is again is REGISTRY["own_pull"]
    finally:
        del REGISTRY["own_pull"]


def test_a_plain_class_is_registered_under_its_name():
    class SoftEdge(fx.Effect):
        strength: float = fx.parameter("N", "force")
        action = "force"

        @staticmethod
        def law(t, x, v, u, level, direction, rest, p):
            return p[0]

    class Bare(SoftEdge):
        width: float = 1.0
        slug = "bare"

    fx.register_effect(SoftEdge)
    try:
        assert REGISTRY["soft_edge"] is SoftEdge and SoftEdge.title == "soft edge"
        assert SoftEdge(2.0) == SoftEdge(strength=2.0) != SoftEdge(1.0)
        with pytest.raises(FrozenInstanceError):
            SoftEdge(2.0).strength = 1.0
        # A number that is no parameter has neither unit nor bounds.
        with pytest.raises(ValueError, match=r"Bare\.width is no field.*dfc\.effects\.parameter"):
            fx.register_effect(Bare)
    finally:
        del REGISTRY["soft_edge"]


def test_limits_and_dead_zones_within_noise_are_none():
    noise = 0.3 * np.random.default_rng(3).standard_normal(5000)
    noisy = 10.0 * np.sin(np.arange(5000) * 1e-2) + noise
    assert not fx.Saturation(9.9).beyond_noise(noisy, 0.3)
    assert fx.Saturation(8.0).beyond_noise(noisy, 0.3)
    assert not fx.Saturation(12.0).beyond_noise(noisy, 0.3)
    # What every sample exceeds is no limit: it takes the drive away.
    assert not fx.Saturation(8.0).beyond_noise(20.0 + noisy, 0.3)
    # A dead zone shrinks the noise of a small drive.
    assert not fx.DeadZone(0.5).beyond_noise(noisy, 0.3)
    assert fx.DeadZone(0.8).beyond_noise(noisy, 0.3)
    assert fx.InputGain(1.01).beyond_noise(noisy, 0.3)  # noise does not imitate it


def test_a_cold_lubricant_resists_less_or_more_but_does_not_drive():
    for rise, plausible in ((4.0, True), (-0.9 * VISCOUS, True), (-1.1 * VISCOUS, False)):
        assert fx.ViscousWarmUp(rise, time_constant=0.3).plausible(axis_with()) is plausible


@pytest.mark.parametrize(
    "effects", [(fx.BiasForce(1.0), fx.CoulombAsymmetry(0.5)), (fx.Backlash(2e-4, 0.4),)]
)
def test_load_that_rubs_is_as_good_as_more_mass_and_friction(effects):
    """While the drive does not brake: (1 - c) u + (1 + c) e = m a + f v + F_c."""
    axis = axis_with(*effects)
    values = equivalent_values(axis, 0.8)
    rubbing = axis.replace(effects=(*effects, fx.LoadDependence(0.2)))
    other = with_values(rubbing, list(values), list(values.values()))
    assert other.mass < axis.mass
    u = 20.0 + 5.0 * np.sin(6.0 * DT * np.arange(1000))
    x, y = (one.simulate(u, DT).y[0] for one in (axis, other))
    np.testing.assert_allclose(y, x, rtol=0, atol=1e-8 * np.ptp(x))


def test_a_lag_far_shorter_than_a_sample_is_none():
    """Its time constant is what a fit may try: the steps within a sample must not follow it."""
    t = 2e-3 * np.arange(1000)
    u = 9.0 * np.sin(6.0 * t) + 3.0 * np.sin(20.0 * t)
    axis = dfc.FrictionAxis(mass=1.0, viscous=24.0, coulomb=4.0)
    plain = axis.simulate(u, dt=2e-3).y
    for time_constant in (1e-14, 1e-11, 1e-9):
        late = axis.replace(effects=(dfc.effects.ActuatorLag(time_constant),))
        np.testing.assert_allclose(late.simulate(u, dt=2e-3).y[0], plain[0], rtol=0, atol=1e-8)


def test_a_nominal_peak_has_columns_of_its_size_and_of_peaks_at_other_velocities():
    v = np.linspace(-0.5, 0.5, 401)
    view = SimpleNamespace(v=v, direction=np.sign(v), level=np.full(v.size, 8.0), fast=0.5)
    peak = dfc.effects.StribeckPeak(excess=0.3, speed=0.02)
    size, *others = peak.changes(view)
    assert size.values((0.1,)) == pytest.approx({"excess": 0.4, "speed": 0.02})
    expected = -8.0 * np.sign(v) * np.exp(-((v / 0.02) ** 2))
    np.testing.assert_allclose(size.force[0], expected, atol=1e-12)
    speeds = [one.values((-0.3, 0.5))["speed"] for one in others]
    assert min(speeds) < 0.01 < 0.1 < max(speeds)
    for one, speed in zip(others, speeds, strict=True):
        # The nominal peak gone, the other one is there.
        assert one.values((-0.3, 0.5)) == pytest.approx({"excess": 0.5, "speed": speed})
        expected = -8.0 * np.sign(v) * np.exp(-((v / speed) ** 2))
        np.testing.assert_allclose(one.force[1], expected, atol=1e-12)
        # Both together are one peak between them, and none is below nothing.
        both = one.values((0.0, 0.3))
        assert both == pytest.approx({"excess": 0.6, "speed": np.sqrt(0.02 * speed)})
        assert one.values((-0.4, -0.1))["excess"] == 0.0
