"""What begins and ends within a sample is seen, against closed forms and explicit integration."""

import math

import numpy as np
import pytest
from dryfric_control.effects import (
    ActuatorLag,
    Backlash,
    BiasForce,
    DeadZone,
    Effect,
    InputDelay,
    InputGain,
    Presliding,
    Saturation,
    TimePeriodic,
    VelocityStrengthening,
    parameter,
)  # fmt: skip
from each_effect import EFFECTS
from scipy.integrate import quad
from scipy.optimize import brentq

import dryfric_control as dfc
from dryfric_control.model.responses import check_finite

DT = 1e-3


@pytest.mark.parametrize(("f", "a", "phase"), [(250.0, 3.2, 1.178), (125.0, 3.03, 1.374)])
def test_a_periodic_force_releases_where_it_exceeds_breakaway_for_a_moment(f, a, phase):
    bias, level, excess = 9.0, 8.0, 0.5
    axis = dfc.FrictionAxis(
        mass=0.05, viscous=2.0, coulomb=level, stribeck=dfc.Stribeck(excess, 1e-3), stick_speed=1e-5,
        effects=(BiasForce(bias), TimePeriodic(a, f, phase)),
    )  # fmt: skip
    run = axis.simulate(np.zeros(101), DT)
    first = (math.asin((level * (1.0 + excess) - bias) / a) - phase) % (2.0 * math.pi)
    # Bisection to the last digits of the time.
    assert run.events.time[0] == pytest.approx(first / (2.0 * math.pi * f), abs=1e-12)
    # From then on it slides: the load is above the Coulomb level on average.
    assert run.y[0, -1] > 5e-3


def test_a_lagged_drive_that_rises_and_falls_in_one_sample_releases():
    lag, dt, level = 3e-3, 1e-2, 7.95
    axis = dfc.FrictionAxis(mass=1.0, viscous=1.0, coulomb=level, effects=(ActuatorLag(lag),))
    run = axis.simulate([0.0, 11.0, -60.0, 0.0], dt, hold="first")

    def lagged(t):
        """Response of the lag at t in the second sample, by the integral of its weight."""
        drive = [lambda s: 1100.0 * s, lambda s: 11.0 - 7100.0 * (s - dt)]
        parts = [(0.0, dt, drive[0]), (dt, t, drive[1])]
        return sum(
            quad(lambda s, u=u: u(s) * math.exp((s - t) / lag) / lag, a, b, epsabs=1e-13)[0]
            for a, b, u in parts
        )

    release = brentq(lambda t: lagged(t) - level, dt, dt + 4e-4, xtol=1e-15)
    assert lagged(dt + 0.5 * dt) < 0.0  # nothing of it is left in the middle
    assert run.events.time[0] == pytest.approx(release, abs=1e-9)  # of the quadrature
    assert run.events.after[0] == 1


def clipped(u, width):
    return u - np.clip(u, -width, width)


INPUTS = {
    "saturation": ((Saturation(1.0),), [0.0, 100.0, 100.0], lambda u: np.clip(u, -1.0, 1.0)),
    "dead zone": ((DeadZone(10.0),), [-20.0, 30.0, 30.0], lambda u: clipped(u, 10.0)),
    "dead zone, one side": ((DeadZone(10.0),), [0.0, 20.0, 20.0], lambda u: clipped(u, 10.0)),
    "both, a gain": (
        (InputGain(2.0), DeadZone(10.0), Saturation(7.0)),
        [-15.0, 25.0, 25.0],
        lambda u: np.clip(clipped(2.0 * u, 10.0), -7.0, 7.0),
    ),
}


@pytest.mark.parametrize(("effects", "u", "drive"), INPUTS.values(), ids=INPUTS)
def test_a_drive_bends_where_the_input_within_a_sample_does(effects, u, drive):
    dt, n = 0.1, 200_000
    axis = dfc.FrictionAxis(mass=1.0, viscous=0.0, coulomb=0.0, effects=effects)
    # The velocity of a free mass of 1 kg is the integral of the drive; n points miss by 1/n^2.
    raw = u[0] + (u[1] - u[0]) * (np.arange(n) + 0.5) / n
    right = float(drive(raw).mean()) * dt
    assert axis.simulate(u, dt, hold="first").y[1, 1] == pytest.approx(right, rel=1e-8)
    late = axis.replace(effects=(*effects, InputDelay(0.25 * dt)))
    run = late.simulate([*u, u[-1]], dt, hold="first")
    part = float(drive(raw[: 3 * n // 4]).mean()) * 0.75 * dt
    # Before the record the delay line holds no drive.
    assert run.y[1, 1] == pytest.approx(part, rel=1e-8)
    assert run.y[1, 2] == pytest.approx(right + 0.75 * dt * drive(u[1]), rel=1e-8)


def test_other_laws_take_the_drive_that_bends_too():
    axis = dfc.FrictionAxis(mass=1.0, viscous=0.0, coulomb=0.3, effects=(Saturation(1.0),))
    coarse = axis.simulate([0.0, 100.0, 100.0], 0.1, hold="first", law=dfc.laws.Tanh(speed=1e-4))
    # 0.0995 N s of drive; the level of 0.3 N is reached after 0.3 ms, 0.2 ms later by the tanh.
    assert coarse.y[1, 1] == pytest.approx(0.0996 - 0.3 * 0.0997, abs=2e-4)


class Cubed(Effect):
    """An input law that says nothing of where it bends."""

    size: float = parameter("1/N^2", "coefficient of the cube")
    slug, action = "cubed", "input"

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):
        return u + p[0] * u * u * u


def test_an_input_law_of_ones_own_is_followed_within_a_sample():
    law = dfc.effects.register_effect(Cubed)(0.01)
    axis = dfc.FrictionAxis(mass=1.0, viscous=0.0, coulomb=0.0, effects=(law,))
    run = axis.simulate([0.0, 10.0, 10.0], 0.1, hold="first")
    # 0.1 (10/2 + 0.01 10^3/4); straight between knots 15 % apart: 1 % of the cube.
    assert run.y[1, 1] == pytest.approx(0.75, rel=1e-2)


def test_a_contact_that_slips_back_within_a_sample():
    """Its level falls with the velocity; explicit integration with steps of 2 us."""
    rng = np.random.default_rng(166)

    def some(low, high):
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    dt = float(rng.choice([1e-3, 2e-3]))
    m, f, fc, length = some(0.5, 4), some(2, 40), some(3, 12), some(1e-5, 2e-3)
    u = np.repeat(rng.uniform(-25, 25, 16), 5)
    film = VelocityStrengthening(0.5, 0.004)
    axis = dfc.FrictionAxis(mass=m, viscous=f, coulomb=fc, effects=(Presliding(length), film))
    x = v = z = 0.0
    h, k, right = 2e-6, fc / length, []
    for force in u.tolist():
        right.append(x)
        for _ in range(round(dt / h)):
            level = fc * (1.0 - 0.5 * (1.0 - math.tanh(abs(v) / 0.004)))
            z = min(max(z, -level / k), level / k)
            v += h * (force - f * v - k * z) / m
            x, z = x + h * v, z + h * v
    # The error of Euler's rule; the slip that was missed makes 4 % of the travel.
    assert np.abs(axis.simulate(u, dt).y[0] - right).max() < 1e-3 * np.ptp(right)


def played(u, gap, fc, rubs, dt, h=5e-7):
    """Velocity of the motor; two masses of 0.5 kg with a play and friction on one, explicitly."""
    x = v = y = p = 0.0
    out = []

    def net(force, v):
        if abs(v) > 1e-6:
            return force - math.copysign(fc, v)
        return math.copysign(max(abs(force) - fc, 0.0), force)

    for force in u.tolist():
        out.append(v)
        for _ in range(round(dt / h)):
            lead = x - y
            side = int(lead >= gap / 2 - 1e-15) - int(lead <= -gap / 2 + 1e-15)
            if side and side * (v - p) > 0.0:
                v = p = 0.5 * (v + p)
            w = net(force, v)
            if side and v == p and side * (0.5 * w if rubs else force - 0.5 * w) >= 0.0:
                v = p = v + h * w
            else:
                old = v if rubs else p
                new = old + 2.0 * h * net(force if rubs else 0.0, old)
                new = 0.0 if old * new < 0.0 else new
                v, p = (new, p) if rubs else (v + 2.0 * h * force, new)
            x, y = x + h * v, y + h * p
    return np.array(out)


@pytest.mark.parametrize("seed", [1905, 2046])
def test_masses_that_touch_and_part_within_a_sample(seed):
    rng = np.random.default_rng(seed)
    gap, rubs = 1e-3 * rng.uniform(0.5, 2), bool(rng.integers(2))
    fc, u = rng.uniform(0.5, 50), rng.uniform(-30, 30, 7)
    play = Backlash(gap, 0.5, float(rubs))
    axis = dfc.FrictionAxis(1.0, 0.0, fc, stick_speed=1e-6, effects=(play,))
    # The error of Euler's rule and of its instant of impact; the impact missed makes 2.4e-3 m/s.
    off = np.abs(axis.simulate(u, 2e-3).y[1] - played(u, gap, fc, rubs, 2e-3))
    assert off.max() < 5e-4


def test_bristles_in_a_long_sample_are_followed_or_refused():
    """50 ms hold 13 swings of the contact; a step of that length grew to 1e302 m."""
    rng = np.random.default_rng(449)

    def some(low, high):
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    dt = float(rng.choice([1e-3, 5e-3, 1e-2, 2e-2, 5e-2]))
    m, fc, length, f = some(0.5, 4), some(3, 15), some(5e-6, 1e-3), some(2, 20)
    c = rng.uniform(0, 1) * math.sqrt(fc / length * m)
    u = rng.uniform(-1.3, 1.3, 60)[:39] * fc
    axis = dfc.FrictionAxis(
        mass=m, viscous=f, coulomb=fc, stribeck=dfc.Stribeck(0.3, 0.01),
        effects=(Presliding(length, c, 1.0),),
    )  # fmt: skip
    try:
        coarse = axis.simulate(u, dt).y[0]
    except ValueError as refused:
        assert "leaves the range of numbers" in str(refused)
        return
    fine = axis.simulate(np.repeat(u, 8), dt / 8).y[0, ::8]
    # Steps of one radian, once a sample has taken more than the solver tries.
    assert np.abs(coarse - fine).max() < 1e-2 * np.ptp(fine)


def test_a_motion_that_grows_beyond_numbers_is_refused():
    out = np.zeros((4, 5))
    out[0, 3:] = 3e302
    with pytest.raises(
        ValueError, match="leaves the range of numbers at sample 3: check the units"
    ):
        check_finite(out)


class Magnet(Effect):
    """A force of one's own, with no bound of its rate."""

    size: float = parameter("N m^2", "pull times distance squared")
    slug, action = "rate_magnet", "force"

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):
        return p[0] * math.sin(3.0 * t) / (1.5 + x) ** 2


BY_LAW = [effect for effect in EFFECTS if effect.action in ("force", "friction")]


@pytest.mark.parametrize("effect", BY_LAW, ids=lambda effect: effect.slug)
def test_the_rate_of_a_force_stays_within_its_bound(effect):
    check_rate(effect)


def test_the_rate_of_a_law_of_ones_own_is_bounded():
    check_rate(dfc.effects.register_effect(Magnet)(2.0))


def check_rate(effect):
    """Force along random short motions against the bound for their velocity and acceleration."""
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, travel=(-0.05, 0.05))
    rng, h = np.random.default_rng(3), 1e-7
    for _ in range(200):
        x, v, a = rng.uniform(-0.05, 0.05), rng.uniform(-0.3, 0.3), rng.uniform(-10.0, 10.0)
        t, rest, load = rng.uniform(0.0, 1.0), rng.uniform(0.0, 1.0), rng.uniform(-300.0, 300.0)
        s = math.copysign(1.0, v)
        forces = [
            effect.law(t + d, x + d * v, v + d * a, 5.0 + d * load, 8.0, s, rest + d, effect.values)
            for d in (-h, h)
        ]
        rate = abs(forces[1] - forces[0]) / (2.0 * h)
        bound = effect.rate_bound(axis, abs(v) + h * abs(a), abs(a), abs(load))
        # Round-off of a difference of forces of some newtons over 2e-7 s.
        assert rate <= bound * (1.0 + 1e-6) + 1e-6
