"""Effects with states of their own, against an integrator of tiny steps that shares no code."""

import itertools
import math

import control as ct
import each_effect
import numpy as np
import pytest
from remembering import BOND, SLIP, WARM, BrittleBond, MaxwellSlip, Remembering

import dryfric_control as dfc

DT = 1e-3
# An axis that rests below a low velocity only, as that of the reference does at none.
AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=4.0, stick_speed=1e-8)
TIME = np.arange(400) * DT
DRIVE = 16.0 * np.sin(25.0 * TIME) + 6.0 * np.sin(90.0 * TIME)


def slip_state(z, v, h):
    k = np.array([SLIP.stiffness_1, SLIP.stiffness_2])
    most = np.array([SLIP.level_1, SLIP.level_2]) / k
    z = np.clip(z + h * v, -most, most)
    return z, -k @ z, 0.0


def bond_state(z, v, h):
    z = z + h * v
    z = z - np.sign(z) * BOND.strain * (np.abs(z) >= BOND.strain)  # what it let go of is gone
    return z, -BOND.stiffness * z[0], 0.0


def warm_state(z, v, h):
    z = z + h * (WARM.heating * AXIS.coulomb.plus[0] * abs(v) - z / WARM.cooling)
    return z, 0.0, WARM.rise * z[0]


def euler(axis, state, n_states, u, parts):
    """Positions at the samples by semi-implicit Euler steps, `parts` a sample."""
    h = DT / parts
    x = v = force = more = 0.0
    z = np.zeros(n_states)
    out = np.empty(u.size)
    for n, drive in enumerate(u):
        out[n] = x
        for _ in range(parts):
            free = v + h * (drive + force - axis.viscous * v) / axis.mass
            # Dry friction takes what it can of the velocity, and no more.
            level = axis.coulomb.plus[0] * (1.0 + more)
            v = math.copysign(max(abs(free) - h * level / axis.mass, 0.0), free)
            x += h * v
            z, force, more = state(z, v, h)
    return out


@pytest.mark.parametrize(
    ("effect", "state", "coulomb", "near"),
    [
        (SLIP, slip_state, 4.0, 1e-5), (SLIP, slip_state, 0.0, 1e-7), (WARM, warm_state, 4.0, 3e-5),
        (BOND, bond_state, 0.0, 2e-3),
    ],
)  # fmt: skip
def test_it_moves_as_its_equations_say(effect, state, coulomb, near):
    axis = AXIS.replace(coulomb=coulomb, effects=(effect,))
    found = axis.simulate(DRIVE, dt=DT).y[0]
    n = len(effect.states)
    coarse, fine = (euler(axis, state, n, DRIVE, parts) for parts in (100, 200))
    # Euler's error falls with its step: without any the way would be as far again.
    assert np.abs(found - (2.0 * fine - coarse)).max() < near * np.ptp(found)


@pytest.mark.parametrize("effect", [SLIP, BOND, WARM])
@pytest.mark.parametrize("coulomb", [4.0, 0.0])
def test_what_it_does_within_a_sample_is_resolved(effect, coulomb):
    axis = AXIS.replace(coulomb=coulomb, effects=(effect,))
    found = axis.simulate(DRIVE, dt=DT).y[0]
    fine = axis.simulate(np.repeat(DRIVE, 64), dt=DT / 64.0).y[0, ::64]
    assert np.abs(found - fine).max() < 1e-7 * np.ptp(found)


def test_what_rests_relaxes():
    # At rest a temperature decays as exp(-t/cooling); with it the level, until the load breaks away.
    hot = np.r_[np.full(100, 20.0), np.zeros(120), np.full(300, 4.4)]
    resp = AXIS.replace(effects=(WARM,)).simulate(hot, dt=DT)
    assert resp.events.times(1, 0)[0] < 0.22
    block = dfc.axis_block(AXIS.replace(effects=(WARM,)), DT)
    state = np.zeros(block.nstates)
    for k in range(220):
        state = block.dynamics(k * DT, state, [hot[k]])
    # 4.4 N are held until rise * temperature = 0.1.
    after = WARM.cooling * math.log(state[-1] / (0.1 / WARM.rise))
    assert after > 0.04
    assert resp.events.times(0, 1)[-1] == pytest.approx(0.22 + after, abs=1e-9)


def test_a_block_of_it_has_its_states_and_the_same_motion():
    axis = AXIS.replace(effects=(dfc.effects.InputDelay(delay=2.5e-3), SLIP))
    block = dfc.axis_block(axis, DT)
    assert block.state_labels[-2:] == ["maxwell_slip_spring_1", "maxwell_slip_spring_2"]
    resp = ct.input_output_response(block, TIME, DRIVE)
    np.testing.assert_array_equal(resp.outputs[0], axis.simulate(DRIVE, dt=DT).y[0])
    limits = np.abs(resp.states[-2:]).max(axis=1)
    np.testing.assert_allclose(limits, [s[1] for s in SLIP.limits], rtol=1e-12)


def test_a_stepper_and_a_copy_of_it_share_nothing():
    axis = AXIS.replace(effects=(SLIP,))
    steppers = [axis.stepper(DT), axis.stepper(DT)]
    for u in DRIVE[:100]:
        steppers[0].step(u)
        steppers[1].step(-u)
    assert steppers[0].x == pytest.approx(-steppers[1].x, rel=1e-12)


def test_springs_alone_hold_an_axis_without_dry_friction():
    axis = AXIS.replace(coulomb=0.0, viscous=300.0, effects=(SLIP,))
    resp = axis.simulate(np.full(2000, 3.0), dt=DT)
    assert resp.y[0, -1] == pytest.approx(3.0 / 4.8e4, rel=1e-9)
    # Beyond both levels together it goes, and comes back by what the springs were strained.
    back = axis.simulate(np.r_[np.full(1000, 6.0), np.zeros(3000)], dt=DT)
    first, second = (s[1] for s in SLIP.limits)
    # The second spring is back first: 8 kN/m pull as much as 40 kN/m push, between their limits.
    ways = 4e4 * first + 8e3 * second
    assert back.y[0].max() - back.y[0, -1] == pytest.approx(ways / 4.8e4, rel=1e-2)


@pytest.mark.parametrize(
    ("without", "problem"),
    [
        ({"states": {}}, "needs its states"),
        ({"states": ("z",)}, "must be a dict of names and units"),
        ({"flow": None}, "needs a static method flow"),
        ({"action": "force"}, 'set action = "memory"'),
        ({"adds_to": "reading"}, "adds_to must be"),
    ],
)
def test_a_class_that_lacks_something_says_what(without, problem):
    body = {
        **{name: BrittleBond.__dict__[name] for name in ("law", "flow", "states")},
        "__annotations__": {"stiffness": float, "strain": float},
        "stiffness": dfc.effects.parameter("N/m", "stiffness"),
        "strain": dfc.effects.parameter("m", "strain"),
    }
    with pytest.raises(ValueError, match=problem):
        dfc.effects.register_effect(type("Lacking", (Remembering,), body | without))


@pytest.mark.parametrize(
    ("use", "problem"),
    [
        (
            lambda axis: axis.replace(effects=(*axis.effects, dfc.effects.Presliding(1e-5))),
            "presliding",
        ),
        (lambda axis: axis.mode(1), "maxwell_slip"),
        (lambda axis: axis.mode_ss(1), "maxwell_slip"),
        (lambda axis: axis.simulate(DRIVE, DT, law=dfc.laws.Sign()), "maxwell_slip"),
        (lambda axis: dfc.supervisor(axis, DT), "maxwell_slip"),
        (lambda axis: dfc.switched_axis(axis, DT), "maxwell_slip"),
        (
            lambda axis: axis.replace(effects=(MaxwellSlip(1e9, 3.0, 1e9, 3.0),)).simulate(
                DRIVE, 0.1
            ),
            "too stiff",
        ),
    ],
)
def test_what_has_no_place_for_its_states_refuses_it(use, problem):
    with pytest.raises(ValueError, match=problem):
        use(AXIS.replace(effects=(SLIP,)))


def test_what_is_left_of_the_drive_is_net_of_it():
    # The states follow the motion that was read.
    slide = AXIS.replace(stick_speed=1e-4, effects=(SLIP,))
    t = np.arange(4000) * DT
    drive = 14.0 * np.sin(7.0 * t) + 6.0 * np.sin(31.0 * t)
    record = dfc.Record(t, drive, slide.simulate(drive, dt=DT).y[0], quantum=1e-9)
    axes = (slide, slide.replace(effects=()))
    with_it, without = (record.force_map(axis).rms for axis in axes)
    assert with_it < 0.05 * without, (with_it, without)


def test_observers_leave_it_out_and_certificates_do_not_cover_it():
    axis = AXIS.replace(stick_speed=1e-4, effects=(SLIP,))
    with pytest.warns(UserWarning, match="leaves out maxwell_slip"):
        comp = dfc.design_compensation(axis, dt=DT)
    assert comp.certificate.uncovered == ("maxwell_slip",)
    assert comp.certificate.tube == math.inf


@pytest.mark.slow
@pytest.mark.parametrize("coulomb", [4.0, pytest.param(0.0, marks=pytest.mark.long)])
def test_it_is_fitted_to_a_record_that_begins_within_the_motion(coulomb):
    # The record does not hold what the springs were strained at its start.
    slide = AXIS.replace(coulomb=coulomb, stick_speed=1e-4, effects=(SLIP,))
    t, rng = np.arange(6300) * DT, np.random.default_rng(0)
    drive = 14.0 * np.sin(7.0 * t) + 6.0 * np.sin(31.0 * t) * np.sin(1.3 * t)
    y = slide.simulate(drive + rng.normal(0.0, 0.3, t.size), dt=DT).y[0]
    y = 1e-6 * np.round(1e6 * (y + rng.normal(0.0, 2e-6, t.size)))
    record = dfc.Record(t[:5000], drive[1300:], y[1300:])
    dfc.effects.register_effect(MaxwellSlip)
    off = slide.replace(mass=2.3, effects=(MaxwellSlip(5e4, 2.5, 1e4, 1.5),))
    found = dfc.fit(off, record, free=("mass", "maxwell_slip"))
    for name, value in found.parameters.items():
        true = slide.mass if name == "mass" else getattr(SLIP, name.partition(".")[2])
        assert abs(value - true) < 3.0 * found.standard_errors[name] < 0.3 * true, name


def test_windows_of_a_record_pass_its_states_on():
    slide = AXIS.replace(coulomb=0.5, stick_speed=1e-4, effects=(SLIP,))
    t = np.arange(2000) * DT
    drive = 14.0 * np.sin(7.0 * t) + 6.0 * np.sin(31.0 * t)
    x = slide.simulate(drive, dt=DT).y[0]
    record = dfc.Record(t, drive, x, quantum=1e-9)
    off = dfc.replay(slide, record).positions - x
    assert np.abs(off).max() < 0.05 * np.abs(SLIP.limits).min()


def test_an_effect_excludes_what_an_axis_with_it_refuses():
    """Of all pairs of effects, one that remembers among them."""
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=4.0)
    for one, other in itertools.combinations([*each_effect.EFFECTS, SLIP], 2):
        refused = ""
        try:
            axis.replace(effects=(one, other))
        except ValueError as problem:
            refused = str(problem)
        assert (other.action in one.excluded_actions()) == bool(refused), (one, other, refused)
        assert (one.action in other.excluded_actions()) == bool(refused), (one, other, refused)


def test_of_its_states_only_those_of_the_drive_are_linear():
    linear = {effect.action: effect.has_linear_states() for effect in (*each_effect.EFFECTS, SLIP)}
    assert {action for action, one in linear.items() if not one} == {
        "contact", "transmission", "memory",
    }  # fmt: skip
