"""Columns of effects against the filter itself, run with and without them."""

import math

import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control.diagnosis.candidates import catalogue, effect_class, own_names, with_effect
from dryfric_control.diagnosis.linearised import Linearised
from dryfric_control.diagnosis.problem import Problem
from dryfric_control.diagnosis.search import Model, Search
from dryfric_control.estimation.likelihood import Likelihood, prepare
from dryfric_control.model.effects.columns import difference

DT = 1e-3
AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, travel=(-1.0, 1.0))
ROTARY = AXIS.replace(units=("rad", "N m"))


def driven(machine, seconds=3.0):
    """A record of a machine that slides most of the time, its drive disturbed by noise."""
    t = DT * np.arange(round(seconds / DT))
    u = 25.0 * np.sin(6.0 * t) + 14.0 * np.sin(17.0 * t + 1.0)
    x = 1e-6 * np.round(1e6 * machine.simulate(u, dt=DT).y[0])
    u += 0.2 * np.random.default_rng(0).standard_normal(t.size)
    return dfc.Record(t, u, x, units=dict(zip("xu", machine.units, strict=True)))


def view_of(axis, record, force=0.5):
    """The linearisation at an axis, its base projected out, some of the drive's force random."""
    problem = Problem(axis, (prepare(record),))
    likelihood = problem.likelihood(axis)
    here = Linearised(problem, likelihood, likelihood.start(force))
    here.project_out(here.base(problem.base))
    return here


@pytest.fixture(scope="module")
def here():
    return view_of(AXIS, driven(AXIS))


@pytest.fixture(scope="module")
def turning():
    machine = ROTARY.replace(effects=(dfc.effects.Gravity(2.0, 0.3),))
    return view_of(ROTARY, driven(machine))


@pytest.mark.parametrize(
    ("slug", "coefficients", "which"),
    [
        ("bias_force", (0.02,), 0),
        ("spring", (0.5, 0.0), 0),
        ("viscous_asymmetry", (0.1,), 0),
        ("quadratic_drag", (0.1,), 0),
        # The broadest peak: its breakaway is no longer small beside the sliding.
        ("stribeck", (0.003,), -1),
        ("input_gain", (0.002,), 0),
    ],
)
def test_a_column_is_the_change_that_the_filter_shows(here, slug, coefficients, which):
    """While sliding; a breakaway that moves by a sample is no small change."""
    column = [*effect_class(slug).columns(here)][which]
    forces = here.of_forces([*column.force])
    added = with_effect(AXIS, slug, dict(column.values(coefficients))).axis
    out, states = Likelihood(added, (), here.likelihood.runs).innovations(here.z[-2:], 0)
    moved = (out[0] - here.point.out[0][0]) * here.scale
    expected = forces @ np.array(coefficients)
    sliding = (here.point.states[0][2] != 0.0) & (states[2] == here.point.states[0][2])
    # The two runs may switch at different samples, and the filter recovers within 30.
    for k in np.flatnonzero(np.diff(here.point.states[0][2]) != 0.0):
        sliding[max(k - 2, 0) : k + 30] = False
    sliding &= here.ok
    assert sliding.sum() > 0.4 * sliding.size
    moved, expected = moved[sliding], expected[sliding]
    assert np.linalg.norm(moved - expected) < 0.05 * np.linalg.norm(expected)


@pytest.mark.parametrize("slug", ["load_dependence", "load_asymmetry"])
def test_a_column_of_the_transmitted_force_is_that_of_its_law(slug):
    """Beside a spring and a known load, which a gear carries with the drive."""
    axis = AXIS.replace(effects=(dfc.effects.Spring(stiffness=20.0, rest=0.1),))
    record = driven(axis)
    loaded = dfc.Record(record.t, record.u, record.x, load=6.0 * np.cos(3.0 * record.t))
    here = view_of(axis, loaded)
    column = next(iter(effect_class(slug).columns(here)))
    added = with_effect(axis, slug, dict(column.values([0.01]))).axis
    change = difference(added, here)
    np.testing.assert_allclose(0.01 * column.force[0] * (here.direction != 0.0), change, atol=1e-9)


def test_a_level_behind_bristles_is_the_change_of_their_force():
    """Against small steps of Dahl's law at a level by direction, and at one that is 1 % higher."""
    length, level = 2e-3, 8.0
    bristles = dfc.effects.Presliding(distance=length, bristles=1.0)
    axis = AXIS.replace(effects=(bristles,))
    here = view_of(axis, driven(axis))
    part = 1e-2

    def forces(more):
        found, force = np.zeros(here.x.size), 0.0
        for k in range(1, here.x.size):
            way = (here.x[k] - here.x[k - 1]) / 200
            top = level * (1.0 + more * (way > 0.0))
            for _ in range(200):
                force += level / length * (way - abs(way) * force / top)
            found[k] = force
        return found

    expected = -(forces(part) - forces(0.0)) / part
    raised = -level * (here.direction > 0.0)
    assert here.bristle_length == pytest.approx(length)
    off = np.linalg.norm(here.behind_bristles(raised) - expected)
    assert off < 0.03 * np.linalg.norm(expected)
    assert off < 0.2 * np.linalg.norm(raised - expected)


def test_a_factor_of_the_friction_is_taken_over_by_the_level(here):
    """A warm-up that lasts far longer than the record is one."""
    effect = dfc.effects.WarmUp(rise=0.25, time_constant=1e5)
    change = here.taken_over(effect, ["mass", "viscous", "coulomb"])
    assert change == pytest.approx([0.0, 0.0, 0.25 * 8.0], abs=1e-3)


@pytest.mark.parametrize("name", catalogue(AXIS))
def test_shapes_of_every_effect(here, turning, name):
    """Columns of the length of the records, finite, and values that the effect accepts."""
    effect = effect_class(name)
    view = turning if name == "gravity" else here
    shapes = [*effect.columns(view)]
    assert shapes
    bounds = {n: p["bounds"] for n, p in effect.parameters().items()}
    for shape in shapes:
        width = max(len(shape.force), len(shape.reading), 1)
        for one in (*shape.force, *shape.reading):
            assert one.shape == view.x.shape and np.isfinite(one).all()
        assert not (shape.force and shape.reading)
        size = min(0.1 * view.size, 0.5 * shape.most)
        for sign in (1.0,) if shape.positive else (1.0, -1.0):
            values = shape.values([sign * size] * width)
            assert values.keys() <= bounds.keys()
            start = with_effect(view.axis, name, dict(values))
            assert all(free.startswith(f"{name}.") for free in start.free)
            for own, value in values.items():
                low, high = bounds[own]
                assert math.isfinite(value) and low <= value <= high
        assert shape.shapes >= 1.0 and shape.most > 0.0


def test_the_usual_speed_of_an_axis_that_rests_most_of_the_time_is_that_of_its_motion():
    """Of all samples it would be zero, and a peak over a part of it one that no step resolves."""
    t = DT * np.arange(4000)
    u = np.where(t % 1.0 < 0.03, 20.0, 0.0) * np.where(t % 2.0 < 1.0, 1.0, -1.0)
    x = 1e-6 * np.round(1e6 * AXIS.simulate(u, dt=DT).y[0])
    here = view_of(AXIS, dfc.Record(t, u, x))
    assert (here.direction == 0.0).mean() > 0.9
    assert 0.05 < here.fast < 0.5


def test_bounds_of_a_start_far_below_what_the_record_shows_stay_in_order():
    record = driven(AXIS)
    slow = AXIS.replace(effects=(dfc.effects.StribeckAsymmetry(difference=1.0, speed=5e-10),))
    likelihood = Problem(AXIS, (prepare(record),)).likelihood(slow, ("stribeck_asymmetry.speed",))
    assert np.all(likelihood.low <= likelihood.high)
    assert likelihood.axis_at(likelihood.low, 0).effects[0].speed >= 1e-5


def test_a_force_at_rest_leaves_no_trace_in_the_innovations(here):
    still = np.where(here.direction == 0.0, 1.0, 0.0)
    still[1:] *= still[:-1] > 0.0
    still[:-1] *= here.direction[1:] == 0.0
    assert not here.of_forces([still]).any()


@pytest.mark.parametrize(
    ("effect", "kind", "frequency"),
    [
        (dfc.effects.Cogging(0.8, 0.0173, 0.4), "force", 1.0 / 0.0173),
        (dfc.effects.TimePeriodic(0.8, 4.3, 0.4), "time", 4.3),
        (dfc.effects.EccentricEncoder(4e-5, 0.0173, 0.4), "reading", 1.0 / 0.0173),
    ],
    ids=["force", "time", "reading"],
)
def test_the_strongest_frequency_is_that_of_the_sine(effect, kind, frequency):
    record = driven(AXIS.replace(effects=(effect,)), seconds=4.0)
    found, lobes = view_of(AXIS, record, force=0.1).waves(kind)
    along = record.t if kind == "time" else record.x
    # Half a main lobe, which is one period over the whole length.
    assert found[0] == pytest.approx(frequency, abs=0.5 / np.ptp(along))
    assert lobes > 10.0


@pytest.mark.parametrize("slug", ["coulomb_asymmetry", "position_dependence", "warm_up", "drift"])
def test_a_level_acts_through_the_peak(slug):
    peaked = AXIS.replace(stribeck=dfc.Stribeck(0.5, 0.3))
    here = view_of(peaked, driven(peaked))
    column = next(iter(effect_class(slug).columns(here)))
    size = [0.01 * here.size / np.ptp(force) for force in column.force]
    exact = difference(with_effect(peaked, slug, dict(column.values(size))).axis, here)
    slides = here.direction != 0.0
    force = sum(c * f for c, f in zip(size, column.force, strict=True))
    np.testing.assert_allclose(force[slides], exact[slides], atol=1e-3 * np.abs(exact).max())


def test_two_causes_give_way_to_one_that_acts_as_both(monkeypatch):
    # No cause is exchanged by itself.
    monkeypatch.setattr("dryfric_control.diagnosis.search.MAX_EXCHANGED_CAUSES", 0)
    peak = dfc.Stribeck(0.5, 0.3)
    record = driven(AXIS.replace(stribeck=peak, effects=(dfc.effects.BiasForce(1.0),)))
    # A peak of both levels, each raised by as much as the asymmetry of the peak takes away.
    alike = AXIS.replace(
        stribeck=peak,
        effects=(dfc.effects.CoulombAsymmetry(-1.0), dfc.effects.StribeckAsymmetry(0.0625, 0.3)),
    )
    problem = Problem(AXIS, (prepare(record),))
    causes = ("stribeck", "coulomb_asymmetry", "stribeck_asymmetry")
    fit = problem.fit(alike, [n for one in causes for n in own_names(one)])
    search = Search(problem)
    now = search.eliminate_causes(Model(fit, causes))
    assert {*now.causes} == {*causes}
    search.round(now)
    found = search.exchange_cause(now)
    assert {*found.causes} == {"stribeck", "bias_force"}
    assert found.fit.values()["bias_force.force"] == pytest.approx(1.0, abs=0.02)
