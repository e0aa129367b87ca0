"""The compensated loop: its faces agree, it learns, it rests, it keeps its tube."""

import itertools
import re
import warnings
from dataclasses import dataclass, replace

import control as ct
import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control import effects as fx
from dryfric_control.compensation.certificate import loop_matrices
from dryfric_control.compensation.tuning import LAWS
from dryfric_control.model.profiles import MotionProfile

DT, QUANTUM = 1e-3, 1e-6
NOMINAL = dfc.FrictionAxis(
    mass=2.0, viscous=15.0, coulomb=8.0, stribeck=dfc.Stribeck(0.3, 0.01), stick_speed=1e-3
)


@pytest.fixture(scope="module")
def comp():
    return dfc.design_compensation(NOMINAL, DT, QUANTUM, input_delay=3e-3)


def sine(seconds=3.0):
    """10 mm at 0.5 Hz."""
    t, w = np.arange(round(seconds / DT)) * DT, np.pi
    x, v, a = 1.0 - np.cos(w * t), w * np.sin(w * t), w**2 * np.cos(w * t)
    return MotionProfile(DT, 0.01 * x, 0.01 * v, 0.01 * a)


def moves(dwell=0.3, points=(0.0, 0.02, 0.0)):
    return dfc.motion_profile(points, DT, velocity=0.1, acceleration=2.0, jerk=80.0, dwell=dwell)


def mismatched(seed):
    """An axis with everything off by up to a fifth, and a delay."""
    rng = np.random.default_rng(seed)
    m, f, plus, minus, excess, speed = rng.uniform(0.8, 1.2, 6)
    return dfc.FrictionAxis(
        mass=2.0 * m, viscous=15.0 * f, coulomb=(8.0 * plus, 8.0 * minus),
        stribeck=dfc.Stribeck(0.3 * excess, 0.01 * speed), stick_speed=2e-3,
        effects=(fx.InputDelay(delay=rng.uniform(0.0, 3e-3)),),
    )  # fmt: skip


EXTENDED = NOMINAL.replace(
    travel=(-0.1, 0.1),
    effects=(
        fx.Cogging(amplitude=2.0, period=8e-3, phase=0.5), fx.InputGain(gain=0.8),
        fx.DeadZone(width=1.0), fx.PositionDependence(slope=2.0), fx.Presliding(distance=1e-5),
    ),
)  # fmt: skip


def by_hand(comp, plant, motion):
    """The loop stepped sample by sample: x, u."""
    stepper, axis, rows = comp.controller.stepper(), plant.stepper(DT), []
    # A motion in samples that are no numbers leaves the stepper as it was.
    with pytest.raises(ValueError, match="vref"):
        stepper.step(0.0, np.nan, 0.0, 0.0)
    samples = motion.rows.T
    for k in range(len(samples)):
        y = QUANTUM * np.floor(axis.x / QUANTUM + 0.5)
        u = stepper.step(*samples[min(k + comp.lead, len(samples) - 1)], y)
        rows.append((axis.x, u))
        axis.step(u)
    return np.array(rows).T, stepper


@pytest.mark.parametrize("law", LAWS)
def test_loop_stepper_and_block_agree(law):
    comp = dfc.design_compensation(EXTENDED, DT, QUANTUM, 1e-3, bandwidth=80.0, law=law)
    plant, motion = mismatched(3), moves(dwell=[0.05, 0.1, 0.2])
    loop = dfc.simulate_loop(plant, comp.controller, motion, quantum=QUANTUM)
    # The motion starts at rest: a controller that knows no more than its first sample
    # has the same line of references.
    x_and_u, _ = by_hand(comp, plant, motion)
    np.testing.assert_array_equal(x_and_u, loop.y[[0, 4]])

    n = 700
    j = np.minimum(np.arange(n) + comp.lead, motion.position.size - 1)
    diagram = ct.interconnect(
        [comp.block("law"), dfc.axis_block(plant, DT, name="plant"), dfc.encoder(QUANTUM, DT)],
        connections=[["law.y", "encoder.y"], ["plant.u", "law.u"], ["encoder.x", "plant.x"]],
        inplist=["law.xref", "law.vref", "law.aref"], outlist=["plant.x", "law.u"], dt=DT,
    )  # fmt: skip
    run = ct.input_output_response(diagram, np.arange(n) * DT, motion.rows[:, j])
    np.testing.assert_array_equal(run.outputs, loop.y[[0, 4], :n])


def test_the_axis_may_start_elsewhere_and_moving(comp):
    """Controllers know the reference before it is followed: no jump at the start."""
    late = MotionProfile(DT, *sine().rows[:, 400:])
    start = {"x0": late.position[0], "v0": late.velocity[0]}
    run = dfc.simulate_loop(NOMINAL, comp.controller, late, **start)
    assert np.abs(late.position - run.y[0]).max() < 5e-5


def test_levels_are_learned_within_bounds(comp):
    """From 15 % above and 15 % below to within 4 %, on a sine of three periods."""
    plant = NOMINAL.replace(coulomb=(9.2, 6.8), effects=(fx.InputDelay(delay=1e-3),))
    _, stepper = by_hand(comp, plant, sine(6.0))
    assert abs(8.0 + stepper.learned["plus"] - 9.2) < 0.04 * 9.2
    assert abs(8.0 + stepper.learned["minus"] - 6.8) < 0.04 * 6.8
    # Five times the friction: levels stop at half a level, the excess at its bound.
    _, stepper = by_hand(comp, NOMINAL.replace(coulomb=40.0), sine(4.0))
    assert max(stepper.learned["plus"], stepper.learned["minus"]) <= 4.0
    assert 0.0 <= stepper.learned["excess"] <= 0.8


@dataclass(frozen=True)
class Magnet(fx.Effect):
    """A force that the package knows nothing of."""

    strength: float = fx.parameter("N", "pull at x = 0")
    slug = "magnet"
    action = "force"

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):
        return p[0] / (1.0 + (x / 0.005) ** 2)


@pytest.mark.parametrize(
    "effect",
    [
        Magnet(strength=6.0), fx.Cogging(amplitude=3.0, period=6e-3, phase=0.2),
        fx.Spring(stiffness=500.0, rest=0.02), fx.CoulombAsymmetry(force=2.0),
        fx.PositionDependence(slope=20.0), fx.QuadraticDrag(drag=800.0), fx.InputGain(gain=0.7),
        fx.DeadZone(width=2.0), fx.InputDelay(delay=8e-3),
    ],
    ids=lambda effect: effect.slug,
)  # fmt: skip
def test_effects_of_the_axis_enter_by_their_own_laws(effect):
    """Error of the axis with the effect, compensated with and without knowing it."""
    plant, motion = NOMINAL.replace(effects=(effect,)), moves()
    errors = []
    for axis in (plant, NOMINAL):
        comp = dfc.design_compensation(axis, DT, QUANTUM, bandwidth=80.0, law="fixed")
        run = dfc.simulate_loop(plant, comp.controller, motion, quantum=QUANTUM)
        moving = motion.velocity != 0.0
        errors.append(np.sqrt(np.mean((motion.position - run.y[0])[moving] ** 2)))
    assert errors[0] < 0.5 * errors[1]


@pytest.mark.parametrize("presliding", [False, True])
def test_rest_is_quiet_and_the_tube_holds(comp, presliding):
    """Three seconds after a move: the drive is constant, no slip, no motion."""
    motion = moves(points=[0.0, 0.02], dwell=[0.1, 6.0])
    if presliding:
        axis = NOMINAL.replace(effects=(fx.Presliding(distance=1e-5),))
        comp = dfc.design_compensation(axis, DT, QUANTUM, input_delay=3e-3)
    tube = comp.certify(reference=motion).tube
    for seed in range(6):
        plant = mismatched(seed)
        if presliding:
            distance = np.random.default_rng(seed).uniform(5e-6, 2e-5)
            plant = plant.replace(effects=(*plant.effects, fx.Presliding(distance=distance)))
        run = dfc.simulate_loop(plant, comp.controller, motion, quantum=QUANTUM)
        late = run.y[:, -3000:]
        assert np.ptp(late[4]) == 0.0
        # Below the least Coulomb level within the mismatch.
        assert abs(late[4, -1]) <= 0.8 * 8.0
        assert np.ptp(late[0]) < 1e-8
        assert np.abs(motion.position - run.y[0]).max() <= tube


@pytest.mark.parametrize("hard", [1.0, 5.0, 10.0])
def test_the_tube_of_a_hard_reference_holds(hard):
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    comp = dfc.design_compensation(axis, DT, QUANTUM, input_delay=1e-3)
    motion = dfc.motion_profile(
        [0.0, 0.03 * hard, 0.0], DT, velocity=0.2 * hard, acceleration=4.0 * hard,
        jerk=160.0 * hard, dwell=0.3,
    )  # fmt: skip
    certificate = comp.certify(reference=motion)
    for mass, rest, delay in itertools.product((0.8, 1.2), (0.8, 1.2), (0.0, 1e-3)):
        plant = dfc.FrictionAxis(
            mass=2.0 * mass, viscous=15.0 * rest, coulomb=8.0 * rest,
            effects=(fx.InputDelay(delay),) if delay else (),
        )  # fmt: skip
        run = dfc.simulate_loop(plant, comp.controller, motion, quantum=QUANTUM)
        assert np.abs(motion.position - run.y[0]).max() <= certificate.tube
        assert np.abs(run.y[4]).max() <= certificate.drive_needed
    assert certificate.parts["inertia"] < certificate.tube < 3.0 * hard * comp.certificate.tube


def test_a_tube_without_a_reference_is_of_slow_ones(comp):
    slow, moved = comp.certificate, comp.certify(reference=moves())
    assert slow.slow and "of mismatch, slow references: " in slow.summary()
    assert not moved.slow and "slow" not in moved.summary()
    assert moved.tube > slow.tube and set(moved.parts) - set(slow.parts) == {"inertia"}


def test_a_pid_hunts_where_the_compensated_loop_rests(comp):
    """Static friction above Coulomb: the integral slips for ever."""
    pid = dfc.design_compensation(NOMINAL, DT, QUANTUM, input_delay=3e-3, law="pid")
    motion = moves(points=[0.0, 0.02], dwell=[0.1, 12.0])
    slips = []
    for one in (comp, pid):
        run = dfc.simulate_loop(mismatched(0), one.controller, motion, quantum=QUANTUM)
        slips.append(np.count_nonzero(run.events.time > motion.duration - 10.0))
    assert slips[0] == 0 < slips[1]
    assert comp.certificate.no_hunting and not pid.certificate.no_hunting


@pytest.mark.parametrize("dt", [1e-2, 5e-5])
@pytest.mark.parametrize("samples", [1.5, 20])
@pytest.mark.parametrize("known", [False, True])
def test_the_loop_is_stable_at_every_rate_and_delay(dt, samples, known):
    """For every axis within the mismatch, a delay that the axis has as one that it may have."""
    delay = samples * dt
    axis = NOMINAL.replace(effects=(fx.InputDelay(delay=delay),) if known and delay else ())
    comp = dfc.design_compensation(axis, dt, QUANTUM, 0.0 if known else delay)
    # It forgets an error in at most 25 times 1 / bandwidth.
    assert comp.certificate.worst.radius < np.exp(-0.04 * comp.bandwidth * dt)
    assert comp.certificate.tube < np.inf


@pytest.mark.parametrize("law", ["learned", "pid"])
@pytest.mark.parametrize("designed", [0.0, 3e-3])
def test_delay_margin_is_where_the_simulated_loop_diverges(law, designed):
    """A tenth below it the loop follows in silence; well above it diverges with a warning."""
    comp = dfc.design_compensation(NOMINAL, DT, QUANTUM, designed, law=law)
    margin = comp.certificate.delay_margin
    assert margin > designed
    assert f"less than {1e3 * margin:.3g} ms beyond" in comp.summary()
    near, far = (NOMINAL.replace(effects=fx.InputDelay(part * margin)) for part in (0.9, 1.3))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = dfc.simulate_loop(near, comp.controller, moves(), quantum=QUANTUM)
    assert np.abs(moves().position - run.y[0]).max() < 1e-3
    with pytest.warns(RuntimeWarning, match=r"diverges.*delay_margin.*input_delay=") as caught:
        dfc.simulate_loop(far, comp.controller, moves(), quantum=QUANTUM)
    assert caught[0].filename == __file__
    # It counts beyond the delay of the axis, not beyond one that a design assumes.
    late = NOMINAL.replace(effects=(fx.InputDelay(delay=designed),)) if designed else NOMINAL
    known = dfc.design_compensation(late, DT, QUANTUM, law=law).certificate.delay_margin
    assert known + designed == pytest.approx(margin, rel=0.05)


def test_a_drive_at_its_limit_is_named_and_a_loop_that_sags_is_not():
    """A load of 20 N on a drive of 15 N, and on a proportional loop that holds it."""
    plant = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=1.0, effects=fx.BiasForce(20.0))
    weak = dfc.PositionController(kp=400.0, ki=0.0, kd=40.0, dt=DT, limit=15.0)
    with pytest.warns(RuntimeWarning, match="drive stays at its limit"):
        dfc.simulate_loop(plant, weak, np.linspace(0.0, 1e-3, 2000))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = dfc.simulate_loop(plant, replace(weak, limit=50.0), np.linspace(0.0, 1e-3, 2000))
    assert abs(run.y[0, -1]) > 0.04


@pytest.mark.parametrize("law", LAWS)
def test_drive_step_is_that_of_the_law(law):
    """Two runs whose last readings differ by one increment, at a constant velocity."""
    comp = dfc.design_compensation(NOMINAL, DT, QUANTUM, 3e-3, law=law)
    last = []
    for more in (0.0, QUANTUM):
        stepper, n = comp.controller.stepper(), 300
        for k in range(n):
            y = 5e-5 * k + more * (k == n - 1)
            u = stepper.step(5e-5 * (k + comp.lead), 0.05, 0.0, y)
        last.append(u)
    assert comp.drive_step == pytest.approx(abs(last[1] - last[0]), rel=0.05)
    share = f"{100.0 * comp.drive_step / 8.0:.3g} % of the Coulomb level"
    assert f"by {comp.drive_step:.3g} N, {share}" in comp.summary()
    given = dict(input_delay=3e-3, law=law, bandwidth=comp.bandwidth, noise=2.0)
    finer = dfc.design_compensation(NOMINAL, DT, 0.1 * QUANTUM, **given)
    assert finer.drive_step == pytest.approx(0.1 * comp.drive_step, rel=0.1)
    assert dfc.design_compensation(NOMINAL, DT, 0.0, **given).drive_step == 0.0


def test_certificate_names_what_fails(comp):
    shaken = NOMINAL.replace(effects=fx.TimePeriodic(amplitude=3.0, frequency=0.37, phase=0.0))
    certificate = dfc.design_compensation(shaken, DT, QUANTUM).certificate
    failed = [condition.name for condition in certificate.conditions if not condition.holds]
    assert failed == ["other forces and levels do not change with time by more than is left"]
    assert "FAILS" in certificate.summary()
    # Stable as designed, not with a mass 60 % lower.
    unstable = comp.certify(mismatch=0.7)
    assert unstable.tube == np.inf and not unstable.no_hunting
    assert "stable" in next(c.name for c in unstable.conditions if not c.holds)
    with pytest.raises(ValueError, match="a drive delay of 4 s .*: check dt and input_delay"):
        dfc.design_compensation(NOMINAL, dt=1e-3, input_delay=4.0)


SLOW = dict(dt=1e-2, encoder_quantum=1e-5)


@pytest.mark.parametrize(
    ("effects", "failing", "remedy", "words"),
    [
        ((), SLOW | dict(bandwidth=40.0, mismatch=0.5), dict(bandwidth=20.0), "is unstable.*lower"),
        ((), SLOW | dict(bandwidth=40.0, mismatch=0.5), dict(mismatch=0.1), "is unstable.*lower"),
        ((fx.Spring(2e3),), SLOW, dict(bandwidth=45.0), "by up to 2000 N/m, .*raise bandwidth"),
        ((fx.Spring(2e3),), SLOW, dict(dt=5e-3), "by up to 2000 N/m, .*shorter dt"),
        ((), dict(limit=14.0), dict(limit=40.0), "may need .* its limit of 14 N: raise limit"),
    ],
)
def test_an_infinite_tube_says_why_and_what_to_change(effects, failing, remedy, words):
    axis = NOMINAL.replace(effects=effects)
    without = dfc.design_compensation(axis, **failing).certificate
    with_remedy = dfc.design_compensation(axis, **failing | remedy).certificate
    assert without.tube == np.inf
    (reason,) = without.reasons
    assert re.search(words, reason)
    shown = " ".join(without.summary().split())
    assert "none is finite" in shown and reason in shown
    assert with_remedy.tube < np.inf and with_remedy.reasons == ()


def test_levels_over_place_ask_for_a_travel_or_a_reference():
    axis = NOMINAL.replace(effects=(fx.PositionDependence(slope=3.0),))
    comp = dfc.design_compensation(axis, DT, QUANTUM)
    (failed,) = (one for one in comp.certificate.conditions if not one.holds)
    assert "from -1 to 1 m" in failed.detail and "axis.replace(travel=" in failed.detail
    along = comp.certify(reference=moves())
    assert along.no_hunting and "travel" not in along.summary()
    assert along.tube < 0.5 * comp.certificate.tube
    given = dfc.design_compensation(axis.replace(travel=(0.0, 0.02)), DT, QUANTUM)
    assert given.certificate.no_hunting and "travel" not in given.summary()
    assert "travel" not in dfc.design_compensation(NOMINAL, DT, QUANTUM).summary()


@pytest.mark.parametrize("levels", [(9.0, 7.0), (7.0, 9.0)])
def test_an_axis_rests_although_its_levels_differ_by_direction(levels):
    axis = NOMINAL.replace(coulomb=levels)
    comp = dfc.design_compensation(axis, DT, QUANTUM)
    assert comp.certificate.no_hunting
    last = dfc.simulate_loop(axis, comp.controller, moves(dwell=2.0), QUANTUM).y[:, -1000:]
    assert np.ptp(last[0]) == 0.0 and np.ptp(last[4]) == 0.0
    assert abs(last[4, 0]) <= 0.9 * 0.8 * 7.0 * (1 + 1e-9)
    weaker = comp.certify(mismatch=0.3)
    (failed,) = (one for one in weaker.conditions if not one.holds)
    assert "lower mismatch" in failed.detail


def test_no_error_is_certified_beyond_what_the_drive_can_do():
    plant = NOMINAL.replace(mass=2.4, viscous=18.0, coulomb=9.6)
    strong = dfc.design_compensation(NOMINAL, DT, QUANTUM, limit=100.0)
    needed = strong.certify(reference=moves()).drive_needed
    for limit in (11.0, 0.99 * needed, 1.01 * needed):
        comp = dfc.design_compensation(NOMINAL, DT, QUANTUM, limit=limit)
        certificate = comp.certify(reference=moves())
        assert bool(certificate.reasons) is (limit < needed)
        run = dfc.simulate_loop(plant, comp.controller, moves(), QUANTUM)
        assert np.abs(moves().position - run.y[0]).max() <= certificate.tube
        assert (certificate.tube < 1e-3) is (limit > needed)


def impulse(comp, mass, viscous, delay, n):
    """Response of the linear loop to a force of one sample."""
    A, B = loop_matrices(comp, mass, viscous, delay)
    state, found = B[:, 0], [0.0]
    for _ in range(n - 1):
        found.append(state[0])
        state = A @ state
    return np.array(found)


@pytest.mark.parametrize("law", ["pid", "disturbance observer", "adrc"])
@pytest.mark.parametrize("delay", [0.0, 1.4e-3])
def test_linear_loop_is_that_of_the_simulation(law, delay):
    """Without friction, a force of one sample through `simulate_loop` and the matrices."""
    plant = dfc.FrictionAxis(
        mass=1.7, viscous=12.0, coulomb=0.0, stick_speed=1e-12,
        effects=(fx.InputDelay(delay=delay),) if delay else (),
    )  # fmt: skip
    comp = dfc.design_compensation(NOMINAL, DT, 0.0, input_delay=3e-3, law=law)
    n = 300
    # A disturbance passes the axis' delay as the drive does: it acts that much later.
    run = dfc.simulate_loop(plant, comp.controller, np.zeros(n), disturbance=np.eye(n)[0])
    expected = impulse(comp, 1.7, 12.0, delay, n)
    if delay == 0.0:
        # Runge-Kutta in the plant against the exact sampled matrices.
        np.testing.assert_allclose(run.y[0], expected, atol=1e-9 * np.abs(expected).max())
    else:
        # The pulse is late by one sample and 0.4: interpolated between its shifts.
        shifted = np.concatenate([[0.0, 0.0], expected])
        late = (0.6 * shifted[1:] + 0.4 * shifted[:-1])[: n - 1]
        assert np.abs(run.y[0, : n - 1] - late).max() < 0.05 * np.abs(late).max()


def test_summary_and_plot(comp):
    assert "tube" in comp.summary() and "128" not in comp._repr_html_()[:5]
    plot = comp.plot()
    assert plot.axes.shape == (3, 1)
    # In the prefix in which the tube is readable.
    assert plot.axes[1, 0].get_ylabel() == "error [mm]"
    (tube,) = (line for line in plot.axes[1, 0].lines if line.get_label() == "tube")
    bound = comp.certify(reference=comp._there_and_back()).tube
    assert tube.get_ydata()[0] == pytest.approx(1e3 * bound)
    assert replace(comp, law="fixed").summary() != comp.summary()
    axis = dfc.FrictionAxis(mass=0.02, viscous=0.05, coulomb=0.6, units=("rad", "N m"))
    plot = dfc.design_compensation(axis, dt=1e-3, encoder_quantum=1e-5).plot()
    assert plot.axes[0, 0].get_ylabel() == "position [rad]"


def test_a_move_that_starts_elsewhere_is_simulated_from_there():
    # A start at 0 is a step of the reference, which no bound on the error of the move covers.
    axis = dfc.FrictionAxis(
        mass=3.0, viscous=20.0, coulomb=9.0, stribeck=dfc.Stribeck(0.35, 0.02),
        travel=(0.0, 0.6), effects=(fx.InputDelay(4e-3),),
    )  # fmt: skip
    comp = dfc.design_compensation(axis, dt=1e-3, encoder_quantum=2e-6)
    bounds, runs = [], []
    for start in (0.0, 0.3):
        move = moves(points=[start, start + 0.1], dwell=0.1)
        bounds.append(comp.certify(reference=move).tube)
        runs.append(dfc.simulate_loop(axis, comp.controller, move, quantum=2e-6).y[0] - start)
    assert bounds[1] == pytest.approx(bounds[0], rel=1e-3)
    assert np.abs(runs[1] - runs[0]).max() < 4e-6
    assert dfc.simulate_loop(axis, comp.controller, np.full(10, 1e-3)).y[0, 0] == 0.0
    position = comp.plot().axes[0, 0].lines[1].get_ydata()
    assert position[0] == pytest.approx(comp._there_and_back().position[0])
