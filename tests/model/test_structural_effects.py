"""Presliding, backlash and compliance: closed forms, limits, an independent truth.

The tolerance of the kernel's step is 3e-9 of the speed, which bounds most of what
is compared with closed forms; every other tolerance says where it comes from.
"""

import dataclasses
import math

import control as ct
import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control.estimation.windows import cut

DT = 1e-3
MASS, COULOMB, DISTANCE = 2.0, 8.0, 40e-6
STIFFNESS = COULOMB / DISTANCE
OMEGA = math.sqrt(STIFFNESS / MASS)

PRESLIDING = dfc.effects.Presliding(distance=DISTANCE)
BRISTLES = dfc.effects.Presliding(distance=DISTANCE, damping=300.0, bristles=1.0)
BACKLASH = dfc.effects.Backlash(gap=2e-4, load_fraction=0.4)
COMPLIANCE = dfc.effects.Compliance(stiffness=3e4, damping=12.0, load_fraction=0.4)
MOTOR_RUBS = dataclasses.replace(COMPLIANCE, friction_on_motor=1.0)
LOOSE = dataclasses.replace(BACKLASH, friction_on_motor=1.0)
STRUCTURES = [
    (PRESLIDING,),
    (BACKLASH,),
    (COMPLIANCE,),
    (PRESLIDING, BACKLASH),
    (PRESLIDING, COMPLIANCE),
    (MOTOR_RUBS,),
    (LOOSE,),
    (BRISTLES, MOTOR_RUBS),
    (PRESLIDING, LOOSE),
    (BRISTLES,),
    (BRISTLES, BACKLASH),
    (BRISTLES, COMPLIANCE),
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


@pytest.mark.parametrize(
    ("f", "samples", "off"),
    # Without damping, 95 radians at 2.6e-9 of phase a step of 0.05 radian: 5e-6 of the amplitude.
    [(0.0, 300, 2e-5), (400.0, 60, 1e-6)],
)
def test_below_breakaway_the_contact_is_a_spring(f, samples, off):
    u = 3.0
    resp = axis_with(PRESLIDING, viscous=f).simulate(np.full(samples, u), DT)
    decay = 0.5 * f / MASS
    swing = math.sqrt(OMEGA**2 - decay**2)
    turn = np.cos(swing * resp.t) + decay / swing * np.sin(swing * resp.t)
    want = u / STIFFNESS * (1.0 - np.exp(-decay * resp.t) * turn)
    assert np.all(resp.mode == 0)
    np.testing.assert_allclose(resp.y[0], want, rtol=0, atol=off * u / STIFFNESS)
    # The friction reported is the elastic force.
    np.testing.assert_allclose(resp.y[2], STIFFNESS * resp.y[0], rtol=1e-12)


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


@pytest.mark.parametrize(("damping", "stribeck"), [(300.0, None), (30.0, dfc.Stribeck(0.4, 5e-3))])
def test_bristles_are_the_model_of_lugre(damping, stribeck):
    """Against the published equations, integrated by a general solver."""
    bristles = dfc.effects.Presliding(distance=DISTANCE, damping=damping, bristles=1.0)
    bare = axis_with(viscous=15.0, stribeck=stribeck)
    t = 1e-3 * np.arange(400)
    u = 1.2 * COULOMB * np.sin(44.0 * t) + 0.4 * COULOMB * np.sin(195.0 * t + 1.0)
    found = bare.replace(effects=(bristles,)).simulate(u, dt=1e-3)
    law = dfc.laws.LuGre(stiffness=COULOMB / DISTANCE, damping=damping, tolerance=1e-9)
    truth = bare.simulate(u, dt=1e-3, law=law)
    np.testing.assert_allclose(found.y[0], truth.y[0], atol=3e-5 * np.ptp(truth.y[0]))


@pytest.mark.parametrize("s", [1.0, -1.0])
@pytest.mark.parametrize("c", [0.0, 0.3])
def test_impact_keeps_the_momentum_but_for_the_friction_under_the_blow(s, c):
    # J = m_m (v0 - v) of the motor, J - c J = m_l v of the load.
    motor, load, v0 = 0.6 * MASS, 0.4 * MASS, 0.05 * s
    u = np.r_[motor * v0 / DT, np.zeros(50)]
    axis = axis_with(BACKLASH, dfc.effects.LoadDependence(c), coulomb=0.0)
    resp = axis.simulate(u, DT)
    # The motor alone gets v0 in the first sample and has 75 um left at its end, 1.5 ms.
    np.testing.assert_allclose(resp.y[1, 1:3], v0, rtol=1e-12)
    v = (1.0 - c) * motor * v0 / (load + (1.0 - c) * motor)
    np.testing.assert_allclose(resp.y[1, 3:], v, rtol=1e-9 if c else 1e-12)
    way = s * 0.5 * BACKLASH.gap + v * (resp.t[3:] - 0.0025)
    np.testing.assert_allclose(resp.y[0, 3:], way, rtol=1e-9 if c else 1e-12)


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


def test_lagged_drive_crosses_the_play_in_closed_form():
    """w = u (1 - exp(-t/T)): the motor's way is u/m (t^2/2 - T t + T^2 (1 - exp))."""
    u, lag, motor = 4.0, 5e-3, 0.6 * MASS
    axis = axis_with(dfc.effects.Backlash(1e-3, 0.4), dfc.effects.ActuatorLag(lag))
    t = np.arange(12) * DT
    x = axis.simulate(np.full(12, u), DT).y[0]
    way = u / motor * (0.5 * t**2 - lag * t - lag**2 * np.expm1(-t / lag))
    np.testing.assert_allclose(x, way, rtol=0, atol=1e-15)


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


def test_stuck_load_leaves_the_motor_on_its_spring():
    u, motor = 4.0, 0.6 * MASS
    axis = axis_with(dfc.effects.Compliance(stiffness=3e4, damping=0.0, load_fraction=0.4))
    resp = axis.simulate(np.full(300, u), DT)
    # Twice u is the peak of the spring's force, just below breakaway.
    assert np.all(resp.mode == 0)
    omega = math.sqrt(3e4 / motor)
    want = u / 3e4 * (1.0 - np.cos(omega * resp.t))
    np.testing.assert_allclose(resp.y[0], want, rtol=0, atol=2e-5 * u / 3e4)
    np.testing.assert_allclose(resp.y[2], 3e4 * resp.y[0], rtol=1e-9)


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


@pytest.mark.parametrize("effects", STRUCTURES, ids=slugs)
def test_directions_are_alike(effects):
    u = shaken(1500)
    axis = axis_with(*effects, viscous=6.0, stribeck=dfc.Stribeck(0.3, 0.02))
    one, other = axis.simulate(u, DT), axis.simulate(-u, DT)
    np.testing.assert_allclose(other.y[:3], -one.y[:3], rtol=1e-9, atol=1e-12)


MORE = (
    dfc.effects.InputDelay(2.4e-3),
    dfc.effects.ActuatorLag(3e-3),
    dfc.effects.BiasForce(0.5),
    dfc.effects.DwellTime(2.0, 0.1),
    dfc.effects.EccentricEncoder(amplitude=2e-4, period=0.01, phase=0.5),
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


@pytest.mark.parametrize("effects", STRUCTURES, ids=slugs)
def test_windows_carry_the_inner_states_over(effects):
    axis = rich_axis(*effects)
    t = np.arange(3000) * DT
    u = 14.0 * np.sin(2 * np.pi * 0.7 * t)
    truth = axis.simulate(u, DT)
    windows = cut(dfc.Record(t, u, truth.y[0]), window=0.05)
    starts = windows.edges[:-1]
    exact = {"dx": truth.y[0, starts] - windows.x0, "dv": truth.y[1, starts] - windows.v0}
    carried = windows.run(axis, **exact)
    # The first window settles, the record has started unstrained: left out.
    later = slice(int(windows.edges[10]), None)
    error = np.abs(carried - truth.y[0])[later].max()
    # A window run alone has nothing to go on with.
    alone = np.zeros_like(carried)
    for i, (a, b) in enumerate(zip(windows.edges[:-1], windows.edges[1:], strict=True)):
        one = {name: getattr(windows, name)[i : i + 1] for name in ("x0", "v0", "rest")}
        window = dataclasses.replace(windows, edges=windows.edges[i : i + 2], **one)
        start = {name: values[i : i + 1] for name, values in exact.items()}
        alone[a:b] = window.run(axis, **start)[a:b]
    forgotten = np.abs(alone - truth.y[0])[later].max()
    assert error < 0.2 * forgotten
    # What the first window has started wrong dies out in friction: what stays is small.
    assert error < 1e-5
    # All windows are run, whichever are asked for.
    some = np.arange(len(windows)) % 3 == 0
    assert np.array_equal(windows.run(axis, **exact, active=some), carried)


@pytest.mark.parametrize("u", [4.0, -4.0])
@pytest.mark.parametrize("effects", STRUCTURES, ids=slugs)
def test_the_first_window_settles_under_its_load(effects, u):
    """An axis that has rested under a load since long ago goes on resting."""
    t = np.arange(1000) * DT
    rng = np.random.default_rng(1)
    # A record must not be constant: this much noise moves the axis by some 1e-14 m.
    noise = 1e-9 * rng.standard_normal((2, 1000))
    record = dfc.Record(t, u + noise[0], 0.1 + noise[1])
    windows = cut(record, window=0.25)
    run = windows.run(axis_with(*effects), dx=0.1 - windows.x0, dv=-windows.v0)
    # Unstrained it would move by u/k, at least 20 um.
    assert np.abs(run - 0.1).max() < 1e-12


def test_without_a_coulomb_level_there_is_no_contact():
    u = shaken(200)
    one = axis_with(PRESLIDING, coulomb=0.0).simulate(u, DT)
    assert np.array_equal(one.y, axis_with(coulomb=0.0).simulate(u, DT).y)


@pytest.mark.parametrize("share", [0.01, 0.001])
def test_a_compliance_with_hardly_any_load_is_an_elastic_contact(share):
    rigid = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    spring = dfc.effects.Compliance(stiffness=4e4, damping=20.0, load_fraction=share)
    soft = rigid.replace(effects=(spring,))
    t = 1e-3 * np.arange(4000)
    u = 20.0 * np.sin(6.0 * t) + 10.0 * np.sin(17.0 * t)
    contact = rigid.replace(effects=(dfc.effects.Presliding(distance=8.0 / 4e4),))
    x, y, z = (a.simulate(u, dt=1e-3).y[0] for a in (soft, contact, rigid))
    assert np.max(np.abs(x - y)) < 0.15 * np.max(np.abs(z - y))


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


@pytest.mark.parametrize("effect, _", TOO_STIFF, ids=["compliance", "presliding"])
def test_the_stiffness_that_a_refusal_offers_runs_and_is_rigid(effect, _):
    with pytest.raises(ValueError, match="too stiff") as refused:
        axis_with(effect).stepper(DT)
    most = 0.99 * float(str(refused.value).split("Use at most ")[1].split()[0])
    changed = {"stiffness": most} if hasattr(effect, "stiffness") else {"distance": COULOMB / most}
    effect = dataclasses.replace(effect, **changed)
    u = 12.0 * np.sin(0.01 * np.arange(700))
    run = axis_with(effect, viscous=15.0).simulate(u, dt=DT)
    rigid = axis_with(viscous=15.0).simulate(u, dt=DT)
    # Each stop leaves energy in a swing, which the rigid axis has not: 5e-4 of the travel.
    assert np.abs(run.y[0] - rigid.y[0]).max() < 1e-3 * np.ptp(rigid.y[0])
