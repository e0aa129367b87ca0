"""Presliding, backlash and compliance: closed forms, limits, an independent truth.

The tolerance of the kernel's step is 3e-9 of the speed, which bounds most of what
is compared with closed forms; every other tolerance says where it comes from.
"""

import math

import control as ct
import numpy as np
import pytest

import dryfric_control as dfc

DT = 1e-3
MASS, COULOMB, DISTANCE = 2.0, 8.0, 40e-6
STIFFNESS = COULOMB / DISTANCE
OMEGA = math.sqrt(STIFFNESS / MASS)

PRESLIDING = dfc.effects.Presliding(distance=DISTANCE)
BACKLASH = dfc.effects.Backlash(gap=2e-4, load_fraction=0.4)
COMPLIANCE = dfc.effects.Compliance(stiffness=3e4, damping=12.0, load_fraction=0.4)
STRUCTURES = [
    (PRESLIDING,),
    (BACKLASH,),
    (COMPLIANCE,),
    (PRESLIDING, BACKLASH),
    (PRESLIDING, COMPLIANCE),
]


def slugs(effects):
    return "+".join(effect.slug for effect in effects)


def axis_with(*effects, **changes):
    base = {"mass": MASS, "viscous": 0.0, "coulomb": COULOMB}
    return dfc.FrictionAxis(**(base | changes), effects=effects)


def rich_axis(*effects):
    return axis_with(
        *effects,
        viscous=6.0,
        coulomb=dfc.CoulombMap(plus=[8.0, 3.0], minus=[7.0, -2.0]),
        stribeck=dfc.Stribeck(0.3, 0.02),
        travel=(-0.5, 0.5),
    )


def shaken(n, seed=3):
    """Steps of random height that stop, start and turn the axis many times."""
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-25.0, 25.0, n // 40 + 1), 40)[:n]


def test_viscous_friction_damps_the_elastic_contact():
    f, u = 400.0, 3.0
    resp = axis_with(PRESLIDING, viscous=f).simulate(np.full(60, u), DT)
    decay = 0.5 * f / MASS
    swing = math.sqrt(OMEGA**2 - decay**2)
    turn = np.cos(swing * resp.t) + decay / swing * np.sin(swing * resp.t)
    want = u / STIFFNESS * (1.0 - np.exp(-decay * resp.t) * turn)
    np.testing.assert_allclose(resp.y[0], want, rtol=0, atol=1e-6 * u / STIFFNESS)


def test_stop_and_spring_back_keep_the_energy_book():
    """Half m v0^2 = half Fc d + Fc (way - d); then it swings by d about way - d."""
    v0, fine = 0.2, 1e-4
    resp = axis_with(PRESLIDING).simulate(np.zeros(1000), fine, v0=v0)
    way = DISTANCE + (0.5 * MASS * v0**2 - 0.5 * COULOMB * DISTANCE) / COULOMB
    ((slide, before, after), (stop, *_)) = resp.events
    assert (before, after) == (0, 1)
    # Elastic until z = d: sin(omega t) = omega d/v0; then evenly braked.
    begin = math.asin(OMEGA * DISTANCE / v0) / OMEGA
    speed = math.sqrt(v0**2 - COULOMB * DISTANCE / MASS)
    assert slide == pytest.approx(begin, rel=3e-8)  # 3e-9 of the speed, a few steps
    assert stop == pytest.approx(begin + speed * MASS / COULOMB, rel=1e-8)
    rest = resp.t > stop
    want = way - DISTANCE * (1.0 - np.cos(OMEGA * (resp.t - stop)))
    np.testing.assert_allclose(resp.y[0, rest], want[rest], rtol=0, atol=1e-9 * way)
    # On the way back the force falls by k from the level at which it has slid.
    np.testing.assert_allclose(
        resp.y[2, rest], COULOMB - STIFFNESS * (way - resp.y[0, rest]), rtol=0, atol=1e-4
    )


def test_slow_loop_loses_the_area_of_a_prandtl_element():
    """Amplitude A of position: the area of the loop is 4 Fc (A - d)."""
    t = np.arange(40_000) * DT
    spring = 2e4
    axis = axis_with(PRESLIDING, dfc.effects.Spring(spring), viscous=2000.0)
    u = 12.0 * np.sin(2 * np.pi * 0.05 * t)
    resp = axis.simulate(u, DT, hold="first")
    cycle = slice(20_000, 40_000)
    x, force = resp.y[0, cycle], resp.y[2, cycle]
    amplitude = 0.5 * (x.max() - x.min())
    area = float(np.sum(0.5 * (force + np.roll(force, -1)) * (np.roll(x, -1) - x)))
    # The sum over 20,000 chords cuts the corners of the loop by less than 1e-4.
    assert area == pytest.approx(4.0 * COULOMB * (amplitude - DISTANCE), rel=1e-3)
    assert amplitude > 3.0 * DISTANCE


@pytest.mark.parametrize("s", [1.0, -1.0])
def test_friction_under_the_blow_takes_its_part_of_the_impulse(s):
    # J = m_m (v0 - v) of the motor, J - c J = m_l v of the load.
    motor, load, v0, c = 0.6 * MASS, 0.4 * MASS, 0.05 * s, 0.3
    u = np.r_[motor * v0 / DT, np.zeros(50)]
    axis = axis_with(BACKLASH, dfc.effects.LoadDependence(c), coulomb=0.0)
    v = (1.0 - c) * motor * v0 / (load + (1.0 - c) * motor)
    assert axis.simulate(u, DT).y[1, 3:] == pytest.approx(v, rel=1e-9)


@pytest.mark.parametrize("hold", ["zero", "first"])
def test_motor_crosses_the_play_alone(hold):
    u, motor = 10.0, 0.6 * MASS
    resp = axis_with(BACKLASH).simulate(np.full(50, u), DT, hold=hold)
    meeting = math.sqrt(BACKLASH.gap * motor / u)
    assert resp.events.times(0, 1)[0] == pytest.approx(meeting, rel=1e-12)
    # From the impact on the whole mass is driven by u - Fc.
    speed = 0.6 * u * meeting / motor + (u - COULOMB) / MASS * (resp.t - meeting)
    late = resp.t > meeting
    np.testing.assert_allclose(resp.y[1, late], speed[late], rtol=1e-10)


def test_braked_motor_leaves_the_load_and_meets_it_behind():
    """Apart both brake evenly: the whole gap takes sqrt(2 gap/(am - al))."""
    push, brake = 20.0, -30.0
    motor, load = 0.6 * MASS, 0.4 * MASS
    n = 100
    u = np.r_[np.full(n, push), np.full(200, brake)]
    resp = axis_with(BACKLASH).simulate(u, DT)
    t0, v0 = n * DT, resp.y[1, n]
    am, al = brake / motor, -COULOMB / load
    meeting = math.sqrt(2.0 * BACKLASH.gap / (al - am))
    apart = (resp.t >= t0) & (resp.t < t0 + meeting)
    np.testing.assert_allclose(resp.y[1, apart], v0 + am * (resp.t[apart] - t0), rtol=1e-13)
    merged = v0 + (0.6 * am + 0.4 * al) * meeting
    joined = (resp.t > t0 + meeting) & (resp.mode == 1)
    assert np.count_nonzero(joined) > 5
    want = merged + (brake - COULOMB) / MASS * (resp.t - t0 - meeting)
    np.testing.assert_allclose(resp.y[1, joined], want[joined], rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("effect", "s"),
    [
        (dfc.effects.LoadDependence(0.3), 1.0),
        (dfc.effects.LoadDependence(0.3), -1.0),
        (dfc.effects.LoadAsymmetry(0.3), 1.0),
    ],
)
def test_teeth_do_not_carry_the_inertia_of_the_motor(effect, s):
    # The load needs N = m_l a + f v + F of the drive, and F = F_c + c N.
    viscous, c, n = 6.0, effect.coefficient, 400
    axis = axis_with(BACKLASH, effect, viscous=viscous)
    v = s * axis.simulate(np.full(n, s * 25.0), dt=DT).y[1]
    begin = 100  # the play has been crossed
    load = BACKLASH.load_fraction * MASS
    inertia, drag = MASS + c / (1.0 - c) * load, viscous / (1.0 - c)
    last = (25.0 - COULOMB / (1.0 - c)) / drag
    t = DT * np.arange(n - begin)
    expected = last + (v[begin] - last) * np.exp(-drag / inertia * t)
    assert v[begin:] == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("damping", [0.0, 12.0])
def test_two_masses_swing_at_their_frequency(damping):
    """Frictionless: the centre is driven by u/m, the lead by u/mm - (K r + D r')/mu."""
    u, stiffness, share = 5.0, 3e4, 0.4
    reduced = MASS * share * (1.0 - share)
    axis = axis_with(dfc.effects.Compliance(stiffness, damping, share), coulomb=0.0)
    resp = axis.simulate(np.full(400, u), DT, v0=0.5)
    decay = 0.5 * damping / reduced
    swing = math.sqrt(stiffness / reduced - decay**2)
    turn = np.cos(swing * resp.t) + decay / swing * np.sin(swing * resp.t)
    lead = u * share / stiffness * (1.0 - np.exp(-decay * resp.t) * turn)
    want = 0.5 * resp.t + 0.5 * u / MASS * resp.t**2 + share * lead
    assert np.all(resp.mode == 1)
    # 3e-9 of 1 m/s a step, some 1000 steps, over the 250 rad/s at which it swings.
    np.testing.assert_allclose(resp.y[0], want, rtol=0, atol=1.2e-8)


VANISHING = {
    "presliding": ((1e-5, 1e-7, 1e-9), lambda size: dfc.effects.Presliding(size)),
    "backlash": ((1e-5, 1e-7, 1e-9), lambda size: dfc.effects.Backlash(size, 0.4)),
    # Damped at 0.7, as a very stiff transmission that swung would only cost time.
    "compliance": (
        (1e5, 1e7, 1e9),
        lambda size: dfc.effects.Compliance(size, 1.4 * math.sqrt(size * MASS * 0.24), 0.4),
    ),
}


@pytest.mark.parametrize("slug", VANISHING)
def test_a_vanishing_effect_is_the_base_model(slug):
    u, (sizes, effect) = shaken(400), VANISHING[slug]
    base = rich_axis().simulate(u, DT).y[0]
    gap = [np.abs(rich_axis(effect(size)).simulate(u, DT).y[0] - base).max() for size in sizes]
    # A contact builds up, a play is crossed and a swing dies in a time of order sqrt(size):
    # ten times less for each step.
    assert gap[2] < 0.2 * gap[1] < 0.04 * gap[0]
    assert gap[2] < 2e-5


MORE = (
    dfc.effects.InputDelay(2.4e-3),
    dfc.effects.ActuatorLag(3e-3),
    dfc.effects.BiasForce(0.5),
    dfc.effects.DwellTime(2.0, 0.1),
)


@pytest.mark.parametrize("effects", STRUCTURES, ids=slugs)
@pytest.mark.parametrize("more", [(), MORE], ids=["alone", "with others"])
def test_all_faces_of_the_axis_agree(effects, more):
    axis = rich_axis(*effects, *more)
    u = shaken(600)
    resp = axis.simulate(u, DT, x0=0.01, v0=0.02)
    assert len(resp.events) > 5 and np.all(np.isfinite(resp.y))
    block = dfc.axis_block(axis, DT)
    start = np.zeros(block.nstates)
    start[:2] = 0.01, 0.02
    start[2] = resp.mode[0]
    t = np.arange(u.size) * DT
    out = ct.input_output_response(block, t, u, start).outputs
    np.testing.assert_allclose(out, resp.y, rtol=1e-12, atol=1e-15)
    plant = axis.stepper(DT, x0=0.01, v0=0.02)
    for k in range(200):
        plant.step(float(u[k]))
    assert plant.x == pytest.approx(resp.y[0, 200], rel=1e-12)


def test_without_a_coulomb_level_there_is_no_contact():
    u = shaken(200)
    one = axis_with(PRESLIDING, coulomb=0.0).simulate(u, DT)
    assert np.array_equal(one.y, axis_with(coulomb=0.0).simulate(u, DT).y)


@pytest.mark.parametrize(
    ("effect", "shares"),
    [
        (dfc.effects.StribeckAsymmetry(difference=0.5, speed=0.01), (0.5, -0.5)),
        (dfc.effects.VelocityStrengthening(deficit=0.5, speed=0.01), (-0.5, -0.5)),
    ],
)
def test_shares_outside_the_peak_are_of_the_level_of_the_map(effect, shares):
    """Beside a peak of a quarter and an asymmetry of 2 N, which the peak raises, on 8 and 6 N."""
    axis = dfc.FrictionAxis(
        mass=2.0, viscous=0.0, coulomb=(8.0, 6.0), stribeck=dfc.Stribeck(0.25, 0.01),
        stick_speed=1e-9, effects=(dfc.effects.CoulombAsymmetry(2.0), effect),
    )  # fmt: skip
    for s, level, share in ((1, 8.0, shares[0]), (-1, 6.0, shares[1])):
        holds = 1.25 * (level + 2.0 * s) + share * level
        for u, mode in ((0.999 * s * holds, 0), (1.001 * s * holds, s)):
            assert axis.simulate([u] * 3, dt=1e-6).mode[0] == mode


TOO_STIFF = [
    (dfc.effects.Compliance(stiffness=1e11, damping=60.0, load_fraction=0.5), "compliance: .*447"),
    (dfc.effects.Presliding(distance=1e-13), "presliding: .*6.32e\\+03"),
]


@pytest.mark.parametrize(("effect", "says"), TOO_STIFF, ids=["compliance", "presliding"])
@pytest.mark.parametrize(
    "begin",
    [
        lambda axis: axis.simulate(np.ones(1_000_000), dt=DT),
        lambda axis: axis.stepper(DT),
        lambda axis: dfc.axis_block(axis, DT),
    ],
    ids=["simulate", "stepper", "block"],
)
def test_what_is_too_stiff_for_the_samples_is_refused(effect, says, begin):
    with pytest.raises(ValueError, match=says + " rad .* Use at most .* N/m, a dt of at most"):
        begin(axis_with(effect))


def test_a_damping_that_samples_cannot_resolve_is_refused():
    effect = dfc.effects.Compliance(stiffness=1e5, damping=1e12, load_fraction=0.5)
    with pytest.raises(ValueError, match=r"2e\+09 time constants .* units of its damping"):
        axis_with(effect).simulate(np.ones(1_000_000), dt=DT)
