"""Comparison friction laws against closed forms and an independent integration."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import odeint

import dryfric_control as dfc
from dryfric_control import effects as fx
from dryfric_control.model.laws import Dahl, Karnopp, LuGre, Sign, Tanh

DT = 1e-3
SMOOTH = Tanh(speed=1e-3), Dahl(stiffness=1e4), LuGre(stiffness=1e4, damping=100.0)
EVERY_LAW = (Sign(), Karnopp(band=1e-4), *SMOOTH)
each_law = pytest.mark.parametrize("law", EVERY_LAW, ids=lambda law: type(law).__name__)


def coulomb_axis(**changes):
    """m = 2, Fc = 3 and nothing else, unless changed."""
    base = dict(mass=2.0, viscous=0.0, coulomb=3.0, stick_speed=1e-6)
    return dfc.FrictionAxis(**(base | changes))


def rich_axis(**changes):
    """Asymmetric, position-dependent, Stribeck, viscous, with a spring."""
    return dfc.FrictionAxis(
        mass=1.5, viscous=0.4, coulomb=dfc.CoulombMap(plus=[1.0, 0.3, 0.2], minus=[1.3, -0.2]),
        stribeck=dfc.Stribeck(excess=0.4, speed=0.05), stick_speed=1e-3, travel=(-1.0, 1.0),
        effects=(fx.Spring(stiffness=2.0, rest=0.1),),
    ).replace(**changes)  # fmt: skip


def test_sign_stops_after_the_closed_form_distance():
    v0 = 0.77
    x, v, force, mode = Sign().run(coulomb_axis(), np.zeros(1000), DT, v0=v0)
    t = DT * np.arange(1000)
    # The speed is linear in time, so the method is exact; what is left is round-off.
    np.testing.assert_allclose(v, np.maximum(v0 - 3.0 / 2.0 * t, 0.0), atol=1e-13)
    assert x[-1] == pytest.approx(2.0 * v0**2 / (2 * 3.0), abs=1e-13)
    assert (mode[0], force[0]) == (1, 3.0) and (mode[-1], force[-1]) == (0, 0.0)


def test_sign_with_viscous_drag_stops_after_the_closed_form_time():
    v0 = 0.77
    _, v, _, _ = Sign().run(coulomb_axis(viscous=0.8), np.zeros(1000), DT, v0=v0)
    stop = int(2.0 / 0.8 * math.log1p(0.8 * v0 / 3.0) / DT)
    assert v[stop] > 0.0 and v[stop + 1] == 0.0
    moving = (v0 + 3.0 / 0.8) * np.exp(-0.8 / 2.0 * DT * np.arange(1000)) - 3.0 / 0.8
    # tolerance = 1e-8 per step of a speed that loses at most Fc dt / m in one.
    np.testing.assert_allclose(v, np.maximum(moving, 0.0), atol=1e-9)


def test_sign_loses_two_friction_widths_each_half_swing():
    # A mass on a spring under Coulomb friction turns at |x0| - 2 n Fc/k and
    # stops at the first turn with |x| <= Fc/k.
    axis = coulomb_axis(effects=fx.Spring(stiffness=40.0, rest=0.0))
    x, _, _, mode = Sign(tolerance=1e-10).run(axis, np.zeros(6000), DT, x0=1.0)
    width, half_swings = 3.0 / 40.0, 7
    # Seven half swings of some 700 steps each, 1e-10 of the speed in each.
    assert x[-1] == pytest.approx(-(1.0 - 2 * half_swings * width), abs=1e-8)
    assert np.count_nonzero(np.diff(mode)) >= half_swings


@pytest.mark.parametrize(("effect", "u", "braking"), [
    (fx.BiasForce(-1.0), 0.0, 4.0), (fx.CoulombAsymmetry(0.5), 0.0, 3.5),
    (fx.InputGain(0.5), -2.0, 4.0),
], ids=lambda value: getattr(value, "slug", None))  # fmt: skip
@pytest.mark.parametrize("law", [Sign(), Karnopp(band=1e-12)], ids=lambda law: type(law).__name__)
def test_effects_of_every_kind_reach_the_laws(law, effect, u, braking):
    x, _, _, mode = law.run(coulomb_axis(effects=effect), np.full(1000, u), DT, v0=0.77)
    assert mode[-1] == 0
    assert x[-1] == pytest.approx(2.0 * 0.77**2 / (2 * braking), abs=1e-12)


@pytest.mark.parametrize("direction", [1, -1])
def test_sign_breaks_away_inside_the_sample_of_a_ramp(direction):
    axis = coulomb_axis(coulomb=(3.0, 2.0))
    level, slope, t = 3.0 if direction > 0 else 2.0, 4.4444, DT * np.arange(1500)
    x, v, _, _ = Sign().run(axis, direction * slope * t, DT, hold="first")
    past = np.maximum(t - level / slope, 0.0)
    # Polynomials in time of degree 2 and 3: exact for a fifth-order method.
    np.testing.assert_allclose(v, direction * slope * past**2 / (2 * 2.0), atol=1e-12)
    np.testing.assert_allclose(x, direction * slope * past**3 / (6 * 2.0), atol=1e-12)


def test_karnopp_rests_below_breakaway_and_leaves_the_band_on_time():
    axis = coulomb_axis(stribeck=dfc.Stribeck(excess=0.5, speed=0.01))
    law = Karnopp(band=1e-3)
    held = np.full(300, 4.49)  # Fc = 3 < u < Fs = 4.5
    x, v, force, mode = law.run(axis, held, DT, x0=0.2)
    assert np.all(x == 0.2) and np.all(v == 0.0) and np.all(mode == 0)
    np.testing.assert_allclose(force, held, rtol=1e-15)
    # Beyond breakaway the momentum builds up at u - Fs: out after m band / (u - Fs).
    x, v, force, mode = law.run(axis, np.full(300, 4.63), DT, x0=0.2)
    first = int(np.argmax(mode))
    assert first == math.ceil(2.0 * 1e-3 / 0.13 / DT)
    assert np.all(x[:first] == 0.2) and np.all(force[:first] == 4.5)
    assert np.all(np.diff(v[first:]) > 0.0)


def test_karnopp_gathers_momentum_over_pulses():
    # Two triangles of 1.2 mN s above Fc: 1.2e-3 of the 2e-3 = m band after the first, out
    # inside the second; without other losses the speed is that of both impulses.
    u = np.full(300, 3.0)
    u[100] = u[200] = 3.0 + 1.2
    x, v, _, mode = Karnopp(band=1e-3).run(coulomb_axis(), u, DT, hold="first")
    assert np.all(mode[:201] == 0) and np.all(x[:201] == 0.0)
    np.testing.assert_allclose(v[201:], 2 * 1.2e-3 / 2.0, rtol=1e-9)
    # A load that falls from 1.2 N above Fc to 1.2 N below gives half a triangle, 0.3 mN s.
    u = np.full(300, 3.0)
    u[0], u[1] = 3.0 + 1.2, 3.0 - 1.2
    u[200] = u[201] = 3.0 + 1.2
    _, v, _, _ = Karnopp(band=1e-3).run(coulomb_axis(), u, DT, hold="first")
    np.testing.assert_allclose(v[202:], (0.3e-3 + 2.4e-3) / 2.0, rtol=1e-9)


def test_karnopp_stops_at_the_edge_of_its_band():
    v0, band = 0.77, 0.01
    x, v, _, mode = Karnopp(band=band).run(coulomb_axis(), np.zeros(1000), DT, v0=v0)
    assert x[-1] == pytest.approx(2.0 * (v0**2 - band**2) / (2 * 3.0), abs=1e-13)
    assert mode[-1] == 0 and v[-1] == 0.0


def stiff_reference(law, u, hold, x0, v0):
    """x, v, F of the rich axis by LSODA, written from the published equations."""

    def friction(y):
        x, v, z = y
        coulomb = 1.0 + 0.3 * x + 0.2 * x * x if v >= 0 else 1.3 - 0.2 * x
        g = coulomb * (1 + 0.4 * math.exp(-((v / 0.05) ** 2)))
        if isinstance(law, Tanh):
            return g * math.tanh(v / law.speed), 0.0
        dz = v - law.stiffness * abs(v) / g * z
        return law.stiffness * z + getattr(law, "damping", 0.0) * dz, dz

    y, out = np.array([x0, v0, 0.0]), []
    slopes = np.diff(u, append=u[-1]) / DT if hold == "first" else np.zeros(len(u))
    for start, slope in zip(u, slopes, strict=True):
        out.append((y[0], y[1], friction(y)[0]))

        def rates(t, y, start=start, slope=slope):
            force, dz = friction(y)
            load = start + slope * t - 2.0 * (y[0] - 0.1) - 0.4 * y[1]
            return [y[1], (load - force) / 1.5, dz]

        y = odeint(
            rates, y, (0.0, DT), rtol=1e-11, atol=[1e-14, 1e-13, 1e-15], mxstep=5000, tfirst=True
        )[-1]
    return np.array(out).T


@pytest.mark.parametrize("hold", ["zero", "first"])
@pytest.mark.parametrize("law", [Tanh(speed=0.05), *SMOOTH], ids=lambda law: type(law).__name__)
def test_smooth_laws_agree_with_lsoda(law, hold):
    u = 3.0 * np.sin(2 * np.pi * 8.0 * DT * np.arange(150))
    x, v, force, _ = law.run(rich_axis(), u, DT, x0=0.05, v0=0.1, hold=hold)
    expected = stiff_reference(law, u, hold, 0.05, 0.1)
    # 150 samples, steps within 1e-8 of speeds of order 0.1; friction is 1e3 (tanh)
    # to 1e4 (bristles) times steeper than its arguments, its own scale being 1 N.
    np.testing.assert_allclose(x, expected[0], atol=2e-8)
    np.testing.assert_allclose(v, expected[1], atol=2e-7)
    np.testing.assert_allclose(force, expected[2], atol=2e-5)


@pytest.mark.slow
@each_law
def test_mirrored_axis_gives_the_mirrored_motion(law):
    u = -6.0 * np.sin(2 * np.pi * 10.0 * DT * np.arange(100))
    levels = dfc.CoulombMap(plus=[1.3, 0.2], minus=[1.0, -0.3, 0.2])
    mirrored = rich_axis(coulomb=levels, effects=fx.Spring(stiffness=2.0, rest=-0.1))
    one = law.run(rich_axis(), u, DT, x0=0.02, v0=0.1, hold="first")
    other = law.run(mirrored, -u, DT, x0=-0.02, v0=-0.1, hold="first")
    assert np.ptp(np.sign(one[1])) == 2.0
    for a, b in zip(one, other, strict=True):
        # Every operation is symmetric under the mirror, rounding included.
        np.testing.assert_array_equal(a, -b)


@pytest.mark.slow
@settings(max_examples=10)
@given(
    amplitude=st.floats(0.0, 20.0), frequency=st.floats(0.5, 40.0), v0=st.floats(-1.0, 1.0),
    band=st.floats(1e-8, 1e-2), hold=st.sampled_from(["zero", "first"]),
)  # fmt: skip
def test_discontinuous_laws_dissipate_and_rest_only_when_held(amplitude, frequency, v0, band, hold):
    u = amplitude * np.sin(2 * np.pi * frequency * DT * np.arange(200))
    for law in (Sign(), Karnopp(band=band)):
        x, v, force, mode = law.run(rich_axis(), u, DT, v0=v0, hold=hold)
        assert np.all(np.isfinite([x, v, force, mode])) and np.all(force * v >= 0.0)
        rest = mode == 0
        assert np.all(v[rest] == 0.0)
        plus, minus = 1.4 * (1.0 + 0.3 * x + 0.2 * x * x), 1.4 * (1.3 - 0.2 * x)
        held = np.clip(u - 2.0 * (x - 0.1), -minus, plus)
        # Round-off of the level's polynomials.
        np.testing.assert_allclose(force[rest], held[rest], rtol=1e-12, atol=1e-12)


@pytest.mark.slow
@each_law
def test_sampling_time_does_not_matter(law):
    # A triangle is the same input at both sampling times; the long samples need steps.
    u = 2.5 * (1 - 2 * np.abs((DT * np.arange(1001) / 0.5) % 2 - 1))
    law = dataclasses.replace(law, tolerance=1e-9)
    often = law.run(rich_axis(), u, DT, v0=0.1, hold="first")
    seldom = law.run(rich_axis(), u[::50], 50 * DT, v0=0.1, hold="first")
    # 1e-9 of the speed a step, 0.15 m/s here; friction forgets most of it.
    for row in (0, 1):
        np.testing.assert_allclose(seldom[row], often[row][::50], atol=1e-8)


@each_law
def test_simulate_is_the_same_run_behind_one_interface(law):
    u = 3.0 * np.sin(2 * np.pi * 5.0 * DT * np.arange(50))
    kept = u.copy()
    response = rich_axis().simulate(u, dt=DT, x0=0.02, v0=0.1, hold="first", law=law)
    alone = law.run(rich_axis(), u, DT, 0.02, 0.1, "first")
    np.testing.assert_array_equal(response.outputs, np.stack(alone))
    np.testing.assert_array_equal(u, kept)
