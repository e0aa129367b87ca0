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
from dryfric_control import effects as fx
from dryfric_control.estimation.windows import cut

DT = 1e-3
MASS, COULOMB, DISTANCE = 2.0, 8.0, 40e-6
MOTOR, LOAD = 0.6 * MASS, 0.4 * MASS
STIFFNESS = COULOMB / DISTANCE
OMEGA = math.sqrt(STIFFNESS / MASS)

PRESLIDING = fx.Presliding(distance=DISTANCE)
BRISTLES = fx.Presliding(distance=DISTANCE, damping=300.0, bristles=1.0)
BACKLASH = fx.Backlash(gap=2e-4, load_fraction=0.4)
COMPLIANCE = fx.Compliance(stiffness=3e4, damping=12.0, load_fraction=0.4)
MOTOR_RUBS = dataclasses.replace(COMPLIANCE, friction_on_motor=1.0)
LOOSE = dataclasses.replace(BACKLASH, friction_on_motor=1.0)
TEETH = dataclasses.replace(BACKLASH, compliance=1.0 / 3e4, damping=12.0)
# Damped well: a load without friction rattles on.
LOOSE_TEETH = dataclasses.replace(TEETH, friction_on_motor=1.0, damping=120.0)
STRUCTURES = [
    (PRESLIDING,), (BACKLASH,), (COMPLIANCE,), (PRESLIDING, BACKLASH), (PRESLIDING, COMPLIANCE),
    (MOTOR_RUBS,), (LOOSE,), (BRISTLES, MOTOR_RUBS), (PRESLIDING, LOOSE),
    (BRISTLES,), (BRISTLES, BACKLASH), (BRISTLES, COMPLIANCE), (TEETH,), (LOOSE_TEETH,),
    (PRESLIDING, TEETH),
]  # fmt: skip
each_structure = pytest.mark.parametrize(
    "effects", STRUCTURES, ids=lambda effects: "+".join(effect.slug for effect in effects)
)


def axis_with(*effects, **changes):
    return dfc.FrictionAxis(MASS, 0.0, COULOMB, effects=effects).replace(**changes)


def rich_axis(*effects):
    return axis_with(
        *effects, viscous=6.0, coulomb=dfc.CoulombMap(plus=[8.0, 3.0], minus=[7.0, -2.0]),
        stribeck=dfc.Stribeck(0.3, 0.02), travel=(-0.5, 0.5),
    )  # fmt: skip


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
    force = COULOMB - STIFFNESS * (way - resp.y[0, rest])
    np.testing.assert_allclose(resp.y[2, rest], force, rtol=0, atol=1e-4)


@pytest.mark.parametrize(("damping", "stribeck"), [(300.0, None), (30.0, dfc.Stribeck(0.4, 5e-3))])
def test_bristles_are_the_model_of_lugre(damping, stribeck):
    """Against the published equations, integrated by a general solver."""
    bristles = fx.Presliding(distance=DISTANCE, damping=damping, bristles=1.0)
    # The peak of the axis begins at its stick velocity, that of the published law at zero.
    bare = axis_with(viscous=15.0, stribeck=stribeck, stick_speed=1e-9)
    t = 1e-3 * np.arange(400)
    u = 1.2 * COULOMB * np.sin(44.0 * t) + 0.4 * COULOMB * np.sin(195.0 * t + 1.0)
    found = bare.replace(effects=bristles).simulate(u, dt=1e-3).y[0]
    law = dfc.laws.LuGre(stiffness=STIFFNESS, damping=damping, tolerance=1e-9)
    truth = bare.simulate(u, dt=1e-3, law=law).y[0]
    np.testing.assert_allclose(found, truth, atol=3e-5 * np.ptp(truth))


@pytest.mark.parametrize("s", [1.0, -1.0])
@pytest.mark.parametrize("c", [0.0, 0.3])
def test_impact_keeps_the_momentum_but_for_the_friction_under_the_blow(s, c):
    # J = m_m (v0 - v) of the motor, J - c J = m_l v of the load.
    v0, rtol = 0.05 * s, 1e-9 if c else 1e-12
    axis = axis_with(BACKLASH, fx.LoadDependence(c), coulomb=0.0)
    resp = axis.simulate(np.r_[MOTOR * v0 / DT, np.zeros(50)], DT)
    # The motor alone gets v0 in the first sample and has 75 um left at its end, 1.5 ms.
    np.testing.assert_allclose(resp.y[1, 1:3], v0, rtol=1e-12)
    v = (1.0 - c) * MOTOR * v0 / (LOAD + (1.0 - c) * MOTOR)
    np.testing.assert_allclose(resp.y[1, 3:], v, rtol=rtol)
    way = s * 0.5 * BACKLASH.gap + v * (resp.t[3:] - 0.0025)
    np.testing.assert_allclose(resp.y[0, 3:], way, rtol=rtol)


def test_teeth_without_damping_lose_no_energy():
    """An elastic blow: the motor keeps (mm - ml)/m of its velocity, the load gets 2 mm/m of it."""
    v0, stiffness = 0.05, 3e4
    axis = axis_with(
        dataclasses.replace(TEETH, compliance=1.0 / stiffness, damping=0.0), coulomb=0.0
    )
    resp = axis.simulate(np.r_[MOTOR * v0 / DT, np.zeros(50)], DT)
    touch = 0.5 * DT + 0.5 * TEETH.gap / v0
    swing = math.sqrt(stiffness * (1.0 / MOTOR + 1.0 / LOAD))
    part = touch + math.pi / swing
    centre = 0.6 * v0
    during = (resp.t > touch) & (resp.t < part)
    want = centre + 0.4 * v0 * np.cos(swing * (resp.t - touch))
    # 3e-9 of the speed a step.
    np.testing.assert_allclose(resp.y[1, during], want[during], rtol=0, atol=1e-7 * v0)
    gone = (resp.t > part) & (resp.t < part + TEETH.gap / v0)
    assert during.sum() > 10 and gone.sum() > 2
    np.testing.assert_allclose(resp.y[1, gone], 0.2 * v0, rtol=1e-6)


def test_teeth_push_and_never_pull():
    # Overdamped, they would hold the motor back as it leaves.
    v0, teeth = 0.05, dataclasses.replace(TEETH, damping=600.0)
    resp = axis_with(teeth, coulomb=0.0).simulate(np.r_[MOTOR * v0 / DT, np.zeros(100)], DT)
    late = resp.y[1, 3:]  # the other end is reached after 0.18 s
    assert np.all(np.diff(late) < 1e-12)
    assert 0.2 * v0 < late[-1] < 0.6 * v0


def test_teeth_without_a_gap_are_a_spring():
    u = shaken(1500)
    one, other = (
        rich_axis(effect).simulate(u, DT).y[0]
        for effect in (
            dataclasses.replace(TEETH, gap=1e-12, damping=0.0),
            dataclasses.replace(COMPLIANCE, damping=0.0),
        )
    )
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-9)


def test_teeth_beside_friction_are_as_plain_steps_have_them():
    """Against steps of 0.4 us of the equations, the load held while friction can."""
    u = shaken(300)
    # The axis decays to rest below its stick velocity, the plain steps at zero.
    found = axis_with(TEETH, viscous=6.0, stick_speed=1e-7).simulate(u, DT).y[0]
    x = v = y = p = 0.0
    h, sub = DT / 2500, 2500
    truth = np.empty(u.size)
    for i, push in enumerate(u):
        truth[i] = x
        for _ in range(sub):
            over = x - y - math.copysign(min(abs(x - y), 1e-4), x - y)
            teeth = over and 3e4 * over + 12.0 * (v - p)
            if teeth * over < 0.0:
                teeth = 0.0
            v += h * (push - teeth) / MOTOR
            if p != 0.0 or abs(teeth) > COULOMB:
                s = math.copysign(1.0, p if p != 0.0 else teeth)
                new = p + h * (teeth - COULOMB * s - 6.0 * p) / LOAD
                p = 0.0 if p * new < 0.0 else new
            x += h * v
            y += h * p
    np.testing.assert_allclose(found, truth, rtol=0, atol=3e-5 * np.ptp(truth))


@pytest.mark.parametrize("hold", ["zero", "first"])
def test_motor_crosses_the_play_alone(hold):
    u = 10.0
    resp = axis_with(BACKLASH).simulate(np.full(50, u), DT, hold=hold)
    meeting = math.sqrt(BACKLASH.gap * MOTOR / u)
    assert resp.events.times(0, 1)[0] == pytest.approx(meeting, rel=1e-12)
    # From the impact on the whole mass is driven by u - Fc.
    speed = 0.6 * u * meeting / MOTOR + (u - COULOMB) / MASS * (resp.t - meeting)
    late = resp.t > meeting
    np.testing.assert_allclose(resp.y[1, late], speed[late], rtol=1e-10)


def test_lagged_drive_crosses_the_play_in_closed_form():
    """w = u (1 - exp(-t/T)): the motor's way is u/m (t^2/2 - T t + T^2 (1 - exp))."""
    u, lag, t = 4.0, 5e-3, np.arange(12) * DT
    axis = axis_with(fx.Backlash(1e-3, 0.4), fx.ActuatorLag(lag))
    way = u / MOTOR * (0.5 * t**2 - lag * t - lag**2 * np.expm1(-t / lag))
    np.testing.assert_allclose(axis.simulate(np.full(12, u), DT).y[0], way, rtol=0, atol=1e-15)


def test_braked_motor_leaves_the_load_and_meets_it_behind():
    """Apart both brake evenly: the whole gap takes sqrt(2 gap/(am - al))."""
    push, brake, n = 20.0, -30.0, 100
    resp = axis_with(BACKLASH).simulate(np.r_[np.full(n, push), np.full(200, brake)], DT)
    t0, v0 = n * DT, resp.y[1, n]
    am, al = brake / MOTOR, -COULOMB / LOAD
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
    [(fx.LoadDependence(0.3), 1.0), (fx.LoadDependence(0.3), -1.0), (fx.LoadAsymmetry(0.3), 1.0)],
)
def test_teeth_do_not_carry_the_inertia_of_the_motor(effect, s):
    # The load needs N = m_l a + f v + F of the drive, and F = F_c + c N.
    viscous, c = 6.0, effect.coefficient
    run = axis_with(BACKLASH, effect, viscous=viscous).simulate(np.full(400, s * 25.0), dt=DT)
    v = s * run.y[1, 100:]  # the play has been crossed
    inertia, drag = MASS + c / (1.0 - c) * LOAD, viscous / (1.0 - c)
    last = (25.0 - COULOMB / (1.0 - c)) / drag
    expected = last + (v[0] - last) * np.exp(-drag / inertia * DT * np.arange(300))
    assert v == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("damping", [0.0, 12.0])
def test_two_masses_swing_at_their_frequency(damping):
    """Frictionless: the centre is driven by u/m, the lead by u/mm - (K r + D r')/mu."""
    u, stiffness, share = 5.0, 3e4, 0.4
    reduced = MASS * share * (1.0 - share)
    axis = axis_with(fx.Compliance(stiffness, damping, share), coulomb=0.0)
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
    u = 4.0
    axis = axis_with(fx.Compliance(stiffness=3e4, damping=0.0, load_fraction=0.4))
    resp = axis.simulate(np.full(300, u), DT)
    # Twice u is the peak of the spring's force, just below breakaway.
    assert np.all(resp.mode == 0)
    want = u / 3e4 * (1.0 - np.cos(math.sqrt(3e4 / MOTOR) * resp.t))
    np.testing.assert_allclose(resp.y[0], want, rtol=0, atol=2e-5 * u / 3e4)
    np.testing.assert_allclose(resp.y[2], 3e4 * resp.y[0], rtol=1e-9)


@pytest.mark.parametrize(("sizes", "effect"), [
    ((1e-5, 1e-7, 1e-9), fx.Presliding),
    ((1e-5, 1e-7, 1e-9), lambda size: fx.Backlash(size, 0.4)),
    # Damped at 0.7, as a very stiff transmission that swung would only cost time.
    ((1e5, 1e7, 1e9), lambda size: fx.Compliance(size, 1.4 * math.sqrt(size * MASS * 0.24), 0.4)),
], ids=["presliding", "backlash", "compliance"])  # fmt: skip
def test_a_vanishing_effect_is_the_base_model(sizes, effect):
    u = shaken(400)
    base = rich_axis().simulate(u, DT).y[0]
    gap = [np.abs(rich_axis(effect(size)).simulate(u, DT).y[0] - base).max() for size in sizes]
    # A contact builds up, a play is crossed and a swing dies in a time of order sqrt(size):
    # ten times less for each step.
    assert gap[2] < 0.2 * gap[1] < 0.04 * gap[0] and gap[2] < 2e-5


@each_structure
def test_directions_are_alike(effects):
    u = shaken(1500)
    axis = axis_with(*effects, viscous=6.0, stribeck=dfc.Stribeck(0.3, 0.02))
    one, other = axis.simulate(u, DT), axis.simulate(-u, DT)
    np.testing.assert_allclose(other.y[:3], -one.y[:3], rtol=1e-9, atol=1e-12)


MORE = (
    fx.InputDelay(2.4e-3), fx.ActuatorLag(3e-3), fx.BiasForce(0.5), fx.DwellTime(2.0, 0.1),
    fx.EccentricEncoder(amplitude=2e-4, period=0.01, phase=0.5),
)  # fmt: skip


@each_structure
@pytest.mark.parametrize("more", [(), MORE], ids=["alone", "with others"])
def test_all_faces_of_the_axis_agree(effects, more):
    axis, u = rich_axis(*effects, *more), shaken(600)
    resp = axis.simulate(u, DT, x0=0.01, v0=0.02)
    assert len(resp.events) > 5 and np.all(np.isfinite(resp.y))
    block = dfc.axis_block(axis, DT)
    start = np.zeros(block.nstates)
    start[:3] = 0.01, 0.02, resp.mode[0]
    out = ct.input_output_response(block, resp.t, u, start).outputs
    np.testing.assert_allclose(out, resp.y, rtol=1e-12, atol=1e-15)
    plant = axis.stepper(DT, x0=0.01, v0=0.02)
    for k in range(200):
        plant.step(float(u[k]))
    assert plant.x == pytest.approx(resp.y[0, 200], rel=1e-12)


@each_structure
def test_windows_carry_the_inner_states_over(effects):
    axis = rich_axis(*effects)
    t = np.arange(3000) * DT
    u = 14.0 * np.sin(2 * np.pi * 0.7 * t)
    x, v = axis.simulate(u, DT).y[:2]
    windows = cut(dfc.Record(t, u, x), window=0.05)
    edges = windows.edges
    exact = {"dx": x[edges[:-1]] - windows.x0, "dv": v[edges[:-1]] - windows.v0}
    carried = windows.run(axis, **exact)
    # A window run alone has nothing to go on with.
    alone = np.zeros_like(carried)
    for i, (a, b) in enumerate(zip(edges[:-1], edges[1:], strict=True)):
        one = {name: getattr(windows, name)[i : i + 1] for name in ("x0", "v0", "rest")}
        window = dataclasses.replace(windows, edges=edges[i : i + 2], **one)
        start = {name: values[i : i + 1] for name, values in exact.items()}
        alone[a:b] = window.run(axis, **start)[a:b]
    # The first window settles, the record has started unstrained: left out.
    error, forgotten = (np.abs(run - x)[edges[10] :].max() for run in (carried, alone))
    # What the first window has started wrong dies out in friction: what stays is small.
    assert error < 0.2 * forgotten and error < 1e-5
    # All windows are run, whichever are asked for.
    some = np.arange(len(windows)) % 3 == 0
    assert np.array_equal(windows.run(axis, **exact, active=some), carried)


@pytest.mark.parametrize("u", [4.0, -4.0])
@each_structure
def test_the_first_window_settles_under_its_load(effects, u):
    """An axis that has rested under a load since long ago goes on resting."""
    # A record must not be constant: this much noise moves the axis by some 1e-14 m.
    noise = 1e-9 * np.random.default_rng(1).standard_normal((2, 1000))
    windows = cut(dfc.Record(np.arange(1000) * DT, u + noise[0], 0.1 + noise[1]), window=0.25)
    run = windows.run(axis_with(*effects), dx=0.1 - windows.x0, dv=-windows.v0)
    # Unstrained it would move by u/k, at least 20 um.
    assert np.abs(run - 0.1).max() < 1e-12


def test_without_a_coulomb_level_there_is_no_contact():
    u = shaken(200)
    one = axis_with(PRESLIDING, coulomb=0.0).simulate(u, DT)
    assert np.array_equal(one.y, axis_with(coulomb=0.0).simulate(u, DT).y)


@pytest.mark.parametrize("share", [0.01, 0.001])
def test_a_compliance_with_hardly_any_load_is_an_elastic_contact(share):
    spring = fx.Compliance(stiffness=4e4, damping=20.0, load_fraction=share)
    contact = fx.Presliding(distance=COULOMB / 4e4)
    t = DT * np.arange(4000)
    u = 20.0 * np.sin(6.0 * t) + 10.0 * np.sin(17.0 * t)
    x, y, z = (
        axis_with(*effects, viscous=15.0).simulate(u, dt=DT).y[0]
        for effects in ((spring,), (contact,), ())
    )
    assert np.max(np.abs(x - y)) < 0.15 * np.max(np.abs(z - y))


@pytest.mark.parametrize(("effect", "shares"), [
    (fx.StribeckAsymmetry(difference=0.5, speed=0.01), (0.5, -0.5)),
    (fx.VelocityStrengthening(deficit=0.5, speed=0.01), (-0.5, -0.5)),
])  # fmt: skip
def test_shares_outside_the_peak_are_of_the_level_of_the_map(effect, shares):
    """Beside a peak of a quarter and an asymmetry of 2 N, which the peak raises, on 8 and 6 N."""
    axis = axis_with(
        fx.CoulombAsymmetry(2.0), effect, coulomb=(8.0, 6.0), stribeck=dfc.Stribeck(0.25, 0.01),
        stick_speed=1e-9,
    )  # fmt: skip
    for s, level, share in ((1, 8.0, shares[0]), (-1, 6.0, shares[1])):
        holds = 1.25 * (level + 2.0 * s) + share * level
        for u, mode in ((0.999 * s * holds, 0), (1.001 * s * holds, s)):
            assert axis.simulate([u] * 3, dt=1e-6).mode[0] == mode


TOO_STIFF = [
    (fx.Compliance(stiffness=1e11, damping=60.0, load_fraction=0.5), "compliance: .*447"),
    (fx.Presliding(distance=1e-13), "presliding: .*6.32e\\+03"),
]


@pytest.mark.parametrize(("effect", "says"), TOO_STIFF, ids=["compliance", "presliding"])
@pytest.mark.parametrize("begin", [
    lambda axis: axis.simulate(np.ones(1_000_000), dt=DT),
    lambda axis: axis.stepper(DT),
    lambda axis: dfc.axis_block(axis, DT),
], ids=["simulate", "stepper", "block"])  # fmt: skip
def test_what_is_too_stiff_for_the_samples_is_refused(effect, says, begin):
    with pytest.raises(ValueError, match=says + " rad .* Use at most .* N/m, a dt of at most"):
        begin(axis_with(effect))


def test_a_damping_that_samples_cannot_resolve_is_refused():
    effect = fx.Compliance(stiffness=1e5, damping=1e12, load_fraction=0.5)
    with pytest.raises(ValueError, match=r"2e\+09 time constants .* units of its damping"):
        axis_with(effect).simulate(np.ones(1_000_000), dt=DT)


@pytest.mark.parametrize("effect, _", TOO_STIFF, ids=["compliance", "presliding"])
def test_the_stiffness_that_a_refusal_offers_runs_and_is_rigid(effect, _):
    with pytest.raises(ValueError, match="too stiff") as refused:
        axis_with(effect).stepper(DT)
    most = 0.99 * float(str(refused.value).split("Use at most ")[1].split()[0])
    changed = {"stiffness": most} if hasattr(effect, "stiffness") else {"distance": COULOMB / most}
    elastic = axis_with(dataclasses.replace(effect, **changed), viscous=15.0)
    u = 12.0 * np.sin(0.01 * np.arange(700))
    x, y = (axis.simulate(u, dt=DT).y[0] for axis in (elastic, elastic.replace(effects=())))
    # Each stop leaves energy in a swing, which the rigid axis has not: 5e-4 of the travel.
    assert np.abs(x - y).max() < 1e-3 * np.ptp(y)
