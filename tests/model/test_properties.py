"""What holds for every axis and every input, over wide scales."""

import math
from typing import NamedTuple

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

import dryfric_control as dfc

DT = 1e-3


@st.composite
def axes(draw):
    mass = 10.0 ** draw(st.floats(-3, 3))
    level = 10.0 ** draw(st.floats(-3, 3)) * mass
    ratio = draw(st.floats(0.3, 3.0))
    stribeck = None
    if draw(st.booleans()):
        stribeck = dfc.Stribeck(draw(st.floats(0.0, 1.5)), 10.0 ** draw(st.floats(-4, 0)))
    return dfc.FrictionAxis(
        mass, viscous=mass * draw(st.floats(0.0, 100.0)), coulomb=(level, ratio * level),
        stribeck=stribeck, stick_speed=10.0 ** draw(st.floats(-7, -2)),
        stick_rate=draw(st.floats(50.0, 1500.0)),
    )  # fmt: skip


class Case(NamedTuple):
    axis: dfc.FrictionAxis
    u: np.ndarray
    v0: float
    hold: str

    def __repr__(self):
        return f"{self.axis}, u={self.u[:3]}..., v0={self.v0!r}, hold={self.hold}"


@st.composite
def cases(draw):
    axis = draw(axes())
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n = 400
    scale = draw(st.floats(0.2, 4.0)) * axis.coulomb.plus[0]
    kind = draw(st.sampled_from(["steps", "noise", "sine"]))
    if kind == "noise":
        u = scale * rng.standard_normal(n)
    elif kind == "sine":
        u = scale * np.sin(2.0 * math.pi * draw(st.floats(0.5, 40.0)) * np.arange(n) * DT)
    else:
        u = np.repeat(scale * rng.standard_normal(n // 20), 20)
    v0 = draw(st.floats(-1.0, 1.0))
    return Case(axis, u, v0, draw(st.sampled_from(["zero", "first"])))


@settings(max_examples=150)
@given(cases())
def test_run_is_finite_dissipative_and_balanced(case):
    axis, u, v0, hold = case
    resp = axis.simulate(u, DT, v0=v0, hold=hold)
    x, v, friction, mode = resp.y
    assert np.all(np.isfinite(resp.y))
    stuck = mode == 0
    # Friction takes power while the axis slides, and acts against the motion.
    assert np.all((friction * v)[~stuck] >= 0.0) and np.all(mode * v >= 0.0)
    # While stuck, friction is the load, within what it can hold.
    assert np.array_equal(friction[stuck], u[stuck])
    assert np.all(np.abs(v[stuck]) <= axis.stick_speed)
    top, bottom = float(axis.breakaway(0.0, 1)), float(axis.breakaway(0.0, -1))
    assert np.all((u[stuck] <= top) & (u[stuck] >= -bottom))
    # The leftover speed dies at the stick rate where no switch comes between.
    switched = np.zeros(u.size, bool)
    switched[np.minimum((resp.events.time / DT * (1.0 - 1e-12)).astype(int), u.size - 1)] = True
    calm = stuck[:-1] & stuck[1:] & ~switched[:-1] & ~switched[1:]
    calm &= np.abs(v[:-1]) > 1e-240
    expected = v[:-1][calm] * math.exp(-axis.stick_rate * DT)
    np.testing.assert_allclose(v[1:][calm], expected, rtol=1e-12)


@settings(max_examples=150)
@given(cases())
def test_switching_is_well_posed(case):
    axis, u, v0, _ = case
    resp = axis.simulate(u, DT, v0=v0)
    places = np.round(resp.events.time / DT - 0.5, 9).astype(int)
    _, counts = np.unique(places, return_counts=True)
    # Under a constant load an axis can break away, or pass through zero, and
    # then come to rest; it cannot leave the rest it has come to.
    assert counts.max(initial=0) <= 3
    time = resp.events.time
    for k in np.flatnonzero(resp.events.after[:-1] == 0):
        if not math.isclose(time[k] % DT, DT, rel_tol=1e-9):
            assert time[k + 1] >= math.floor(time[k] / DT + 1e-9) * DT + DT * (1.0 - 1e-9)
