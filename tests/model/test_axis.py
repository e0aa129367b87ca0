"""The switched axis against closed forms, and what it refuses."""

import math

import control as ct
import numpy as np
import pytest

import dryfric_control as dfc

DT = 1e-3


def plain(**changes):
    base = dict(mass=2.0, viscous=0.0, coulomb=8.0, stick_speed=1e-9)
    return dfc.FrictionAxis(**(base | changes))


def test_a_mass_stops_in_closed_form_and_turns_under_a_load():
    m, f, fc, v0 = 2.0, 3.0, 8.0, -1.5
    resp = plain().simulate(np.zeros(2001), DT, v0=1.0)
    # x = m v0^2 / (2 Fc) and t = m v0 / Fc; the stick speed of 1e-9 costs 1e-9.
    assert resp.y[0, -1] == pytest.approx(0.125, abs=2e-9)
    ((time, *modes),) = resp.events
    assert time == pytest.approx(0.25, abs=2e-9) and modes == [1, 0]
    resp = plain(viscous=f).simulate(np.zeros(2001), DT, v0=v0)
    stop = m / f * math.log1p(f * abs(v0) / fc)
    assert resp.events.time == pytest.approx([stop], abs=1e-9)
    assert resp.y[0, -1] == pytest.approx(-(m * abs(v0) / f - fc / f * stop), abs=1e-9)
    resp = plain().simulate(np.full(1001, -30.0), DT, v0=0.5)
    # Decelerates at (30 + 8)/2, then accelerates at (30 - 8)/2.
    assert [(b, a) for _, b, a in resp.events] == [(1, -1)]
    assert resp.events.time[0] == pytest.approx(0.5 / 19.0, abs=1e-12)
    assert resp.y[1, -1] == pytest.approx(-11.0 * (1.0 - 0.5 / 19.0), rel=1e-12)


def test_stuck_axis_holds_what_is_below_breakaway_and_moves_above():
    axis = plain(coulomb=(8.0, 6.0), stribeck=dfc.Stribeck(excess=0.5, speed=0.01))
    for force, mode in ((11.9, 0), (12.1, 1), (-8.9, 0), (-9.1, -1)):
        resp = axis.simulate(np.full(20, force), DT)
        assert resp.mode[-1] == mode, force
        if mode == 0:
            assert np.all(resp.y[2] == force) and np.all(resp.y[:2] == 0.0)


def test_leftover_speed_dies_at_the_stick_rate():
    axis = plain(stick_speed=1e-2, stick_rate=200.0)
    resp = axis.simulate(np.zeros(100), DT, v0=5e-3)
    expected = 5e-3 * np.exp(-200.0 * resp.t)
    np.testing.assert_allclose(resp.y[1], expected, rtol=1e-12)
    np.testing.assert_allclose(resp.y[0], (5e-3 - expected) / 200.0, rtol=1e-9, atol=1e-18)


def test_level_follows_position_direction_and_stops_at_the_travel():
    level = dfc.CoulombMap(plus=[4.0, 2.0], minus=[5.0, -1.0, 0.5])
    axis = plain(coulomb=level, travel=(-1.0, 2.0), viscous=1.0)
    for x, v, expected in ((1.0, 1.0, 6.0), (1.0, -1.0, -4.5), (9.0, 1.0, 8.0), (-9.0, -1.0, -6.5)):
        resp = axis.simulate([0.0, 0.0], DT, x0=x, v0=v)
        assert resp.y[2, 0] == pytest.approx(expected, rel=1e-15)


def test_stribeck_level_is_the_printed_one():
    axis = plain(stribeck=dfc.Stribeck(excess=0.4, speed=0.02), stick_speed=5e-3)
    for v in (5e-3 + 1e-9, 0.01, 0.03, 0.5):
        expected = 8.0 * (1.0 + 0.4 * math.exp(-(((v - 5e-3) / 0.02) ** 2)))
        for s in (1, -1):
            resp = axis.simulate([0.0, 0.0], DT, v0=s * v)
            assert resp.y[2, 0] == pytest.approx(s * expected, rel=1e-15)


def chatter_case(switching):
    """Load between the Coulomb and the breakaway level while the axis slows."""
    peak = dfc.Stribeck(excess=0.5, speed=0.05)
    axis = plain(mass=1.0, coulomb=1.0, stribeck=peak, stick_speed=1e-5, switching=switching)
    return axis.simulate(np.full(3001, 1.2), DT, v0=0.02)


def test_completed_rule_sticks_where_the_printed_one_chatters():
    completed, printed = chatter_case("filippov"), chatter_case("paper")
    assert [(b, a) for _, b, a in completed.events] == [(1, 0)]
    assert completed.mode[-1] == 0
    # The printed rule flips the sign of the speed again and again, to the end.
    assert len(printed.events) > 1000 and printed.events.time[-1] > 2.99
    assert 0 not in printed.mode[200:]


def test_first_order_hold_integrates_a_ramp_exactly():
    t = np.arange(1001) * DT
    resp = plain(coulomb=2.0).simulate(10.0 * t, DT, hold="first")
    assert resp.events.time == pytest.approx([0.2], abs=1e-12)
    assert resp.y[1, -1] == pytest.approx(10.0 * (t[-1] - 0.2) ** 2 / 4.0, rel=1e-9)
    held = plain(coulomb=2.0).simulate(10.0 * t, DT)
    assert held.events.time == pytest.approx([0.2 + DT], abs=1e-12)


def test_response_is_a_time_response_of_python_control():
    pytest.importorskip("pandas")
    u = np.linspace(0.0, 20.0, 50)
    resp = plain().simulate(u, DT)
    assert isinstance(resp, ct.TimeResponseData)
    assert resp.output_labels == ["x", "v", "F", "mode"] and resp.input_labels == ["u"]
    assert resp.outputs.shape == (4, 50) and resp.states.shape == (2, 50)
    assert resp.t[-1] == pytest.approx(49 * DT)
    assert np.array_equal(u, np.linspace(0.0, 20.0, 50))
    assert resp(squeeze=True).events is resp.events
    frame = resp.to_pandas()
    assert list(frame.columns) == ["time", "u", "x", "v", "F", "mode"]
    assert frame.attrs["units"] == {"time": "s", "u": "N", "x": "m", "v": "m/s", "F": "N"}
    assert repr(resp) == (
        "SimulationResponse of 50 samples from 0 to 0.049 s; outputs x, v, F, mode; inputs u"
    )


def test_an_axis_without_its_friction_is_told_what_to_give():
    for given in (dict(mass=3.0), dict(inertia=3.0)):
        with pytest.raises(TypeError, match=r"lacks viscous=, coulomb=: .*dfc.axis_from\(record\)"):
            dfc.FrictionAxis(**given)
    assert dfc.FrictionAxis(3.0, 0.0, 0.0) == dfc.FrictionAxis(3.0, viscous=0.0, coulomb=0.0)


def test_a_rotary_axis_takes_its_inertia():
    axis = dfc.FrictionAxis(inertia=0.02, viscous=0.1, coulomb=0.5)
    assert (axis.mass, axis.inertia, axis.units) == (0.02, 0.02, ("rad", "N m"))
    assert axis.replace(inertia=0.03).mass == 0.03
    raw = dfc.FrictionAxis(inertia=0.02, viscous=0.1, coulomb=0.5, units=("counts", "V"))
    assert raw.units == ("counts", "V")
    for call, words in (
        (lambda: plain(inertia=0.02), r"mass = 2.0 and inertia = 0.02 .* give one"),
        (lambda: plain().replace(inertia=1.0), r"of a rotary axis.*\('m', 'N'\) .*mass="),
    ):
        with pytest.raises(ValueError, match=words):
            call()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("visc", "give viscous="), ("damping", "give viscous="), ("Fc", "give coulomb="),
        ("J", "inertia="), ("vs", r"dfc.Stribeck\("), ("gravity", "effects.Gravity"),
        ("stik_speed", "Did you mean 'stick_speed'"), ("qqqq", "it has mass, viscous, coulomb"),
    ],
)  # fmt: skip
def test_an_argument_of_another_name_is_told_the_right_one(name, words):
    with pytest.raises(TypeError, match=f"no argument '{name}'.*{words}"):
        plain(**{name: 1.0})
    with pytest.raises(TypeError, match=words):
        plain().replace(**{name: 1.0})
