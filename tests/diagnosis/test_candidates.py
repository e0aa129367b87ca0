"""Candidates and causes: what a record shows of one, what is said of it, when a search ends."""

import dataclasses
import math

import numpy as np
import pytest
from diagnosis_cases import among, driven

import dryfric_control as dfc
from dryfric_control.diagnosis.candidates import forms, held_by, is_within_records, with_held
from dryfric_control.diagnosis.causes import (
    cause_of,
    changing_cause,
    hardly_determined,
    varying_parameters,
    with_weights_apart,
)
from dryfric_control.diagnosis.force_view import ForceView
from dryfric_control.diagnosis.gram import Gram, Proposal
from dryfric_control.diagnosis.invariants import infeasible_reason, is_negligible, rejection_reason
from dryfric_control.diagnosis.looks import ProposalFits
from dryfric_control.diagnosis.problem import Problem
from dryfric_control.diagnosis.search import Model, Search
from dryfric_control.estimation.likelihood import prepare

AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
SPRUNG = AXIS.replace(effects=(dfc.effects.Spring(stiffness=40.0, rest=0.05),))
SPRING = ("spring.stiffness", "spring.rest")


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({"spring.stiffness": 3.0, "spring.rest": 0.109}, True),
        ({"spring.stiffness": 3.0, "spring.rest": 0.311}, False),
        ({"spring.stiffness": 3.0, "spring.rest": -0.21}, False),
        ({"input_delay.delay": 3e-5}, True),
        ({"input_delay.delay": 1e-5}, False),
        ({"stribeck.excess": 0.3, "stribeck.speed": 0.44}, True),
        ({"stribeck_asymmetry.speed": 0.47}, False),
        ({"cogging_2.amplitude": 9.0, "cogging_2.phase": 50.0}, True),
        ({"cogging.period": 0.047}, True),
        ({"cogging.period": 0.049}, False),
        ({"time_periodic.frequency": 3.2}, True),
        ({"time_periodic.frequency": 3.1}, False),
        ({"dwell_time.rise": 0.1, "dwell_time.time_constant": 1.1e-3}, True),
        ({"dwell_time.rise": 0.1, "dwell_time.time_constant": 0.9e-3}, False),
        ({"backlash.gap": 1.1e-6, "backlash.load_fraction": 0.5}, True),
        ({"backlash.gap": 0.9e-6, "backlash.load_fraction": 0.5}, False),
    ],
)
def test_a_cause_acts_where_the_machine_has_been_and_as_the_record_can_show(values, expected):
    t = 1e-3 * np.arange(400)
    x = np.linspace(0.0, 0.06, 400)
    records = [dfc.Record(t, np.sin(t), one, quantum=1e-5) for one in (x, x + 0.04)]
    assert is_within_records(values, records, None) is expected


@pytest.fixture(scope="module")
def sprung():
    """A record that shows a spring."""
    return Problem(AXIS, (prepare(driven(SPRUNG)),))


def test_a_cause_is_sound_where_the_record_determines_it(sprung):
    assert rejection_reason(sprung, sprung.fit(SPRUNG, SPRING), "spring", SPRING) == ""
    both = SPRUNG.replace(effects=(*SPRUNG.effects, dfc.effects.BiasForce(force=0.0)))
    fit = sprung.fit(both, (*SPRING, "bias_force.force"))
    assert rejection_reason(sprung, fit, "bias_force", ("bias_force.force",)) == "not determined"
    assert rejection_reason(sprung, fit, "gravity", ()) == "not in the model"


def test_a_cause_acts_within_the_travel_of_the_record(sprung):
    far = AXIS.replace(effects=(dfc.effects.Spring(stiffness=0.1, rest=50.0),))
    likelihood = sprung.likelihood(far, SPRING)
    x = sprung.runs[0].record.x
    rest = likelihood.axis_at(likelihood.start()).effects[0].rest
    assert x.max() < rest < x.max() + 2.1 * np.ptp(x)


# -- what is said of a cause -----------------------------------------------------------

OWN = {name: f"cogging_2.{name}" for name in ("amplitude", "period", "phase")}


def cause(amplitude_error, axis=AXIS):
    fitted = (0.5, amplitude_error, "N"), (0.01, 0.02, "m"), (0.2, 5.0, "rad")
    fitted = dict(zip(OWN.values(), fitted, strict=True))
    return cause_of(axis, "cogging", OWN, fitted, (2.0, 0.1), ["spring"])


def test_a_cause_has_the_numbers_of_the_fit_under_its_own_names():
    found = cause(0.01)
    assert found.parameters == {"amplitude": 0.5, "period": 0.01, "phase": 0.2}
    assert found.standard_errors["amplitude"] == 0.01
    assert found.units == {"amplitude": "N", "period": "m", "phase": "rad"}
    assert found.interval == pytest.approx((2.0 - 0.1645, 2.0 + 0.1645))
    assert found.held_out_gain == 2.0 and found.alternatives == ("spring",)
    assert "Already" not in found.explanation
    known = AXIS.replace(effects=(dfc.effects.Cogging(amplitude=1.0, period=0.01),))
    assert "Already in the nominal axis" in cause(0.01, known).explanation


@pytest.mark.parametrize(
    ("error", "nominal", "open_"),
    [
        *((error, None, True) for error in (0.16, math.inf, math.nan)),
        (0.14, None, False),
        # An amount that has gone is determined beside its nominal value.
        (0.16, dfc.effects.Cogging(amplitude=10.0, period=0.1), False),
    ],
)
def test_what_a_record_leaves_open_is_said(error, nominal, open_):
    axis = AXIS.replace(effects=(nominal,) if nominal else ())
    # The phase, an angle, has no size to hold its error against.
    said = [m for m in hardly_determined(axis, [cause(error)]) if "amplitude" in m or "phase" in m]
    assert said == ["cogging.amplitude is hardly determined by this record"] * open_


def test_a_parameter_called_as_its_cause_is_named_once():
    fitted = {"viscous": (15.0, 9.0, "N s/m")}
    open_ = cause_of(AXIS, "viscous", {"viscous": "viscous"}, fitted, (2.0, 0.1))
    assert hardly_determined(AXIS, [open_]) == ["viscous is hardly determined by this record"]


# -- when the search ends: what is left, by force, by event, by assumption --------------


@pytest.mark.parametrize(
    ("machine", "push", "noise", "expected"),
    [
        (AXIS, 0.0, 0.0, True),
        (AXIS.replace(mass=2.02), 0.0, 0.0, True),
        # Its tail is no rare event.
        (AXIS, 0.0, 3.0, True),
        (AXIS.replace(effects=(dfc.effects.BiasForce(0.2),)), 0.0, 0.0, False),
        (AXIS, 15.0, 0.0, False),  # a single event, which the record does not contain
        (AXIS, 15.0, 0.5, False),
        # The same as three base parameters 43 % too small: one cause would spare them.
        (AXIS.replace(effects=(dfc.effects.InputGain(0.7),)), 0.0, 0.0, False),
    ],
    ids="nominal,a base parameter,noise,a force,an event,an event in noise,assumptions".split(","),
)
def test_nothing_is_left_of_an_axis_with_other_base_parameters_alone(
    machine, push, noise, expected
):
    t = 1e-3 * np.arange(4000)
    u = np.round(22.0 * np.sin(5.0 * t) + 12.0 * np.sin(16.0 * t + 1.0), 4)
    acts = u + push * ((t > 1.9995) & (t < 2.0045))
    scatter = noise * np.random.default_rng(5).standard_normal(t.size)
    x = 1e-6 * np.round(1e6 * machine.simulate(acts, dt=1e-3).y[0] + scatter)
    problem = Problem(AXIS, (prepare(dfc.Record(t, u, x)),))
    assert problem.is_exhausted(problem.fit(AXIS)) == expected


# -- a law explains a record only if it is the same throughout it ------------------------


def changed(first, second):
    """A record of one axis that goes on as another one."""
    t = 2e-3 * np.arange(2000)
    u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
    early = first.simulate(u[:1001], dt=2e-3).y
    x0, v0 = (float(row[-1]) for row in early[:2])
    late = second.simulate(u[1000:], dt=2e-3, x0=x0, v0=v0).y
    x = np.concatenate((early[0, :-1], late[0]))
    return dfc.Record(t, u, 1e-6 * np.round(1e6 * x))


@pytest.mark.slow
def test_friction_that_rises_half_way_is_not_explained():
    record = changed(AXIS.replace(coulomb=9.0), AXIS.replace(coulomb=9.4))
    with among("bias_force"):
        found = dfc.diagnose(AXIS, record, jobs=1, progress=False)
    assert found.verdict == "partly explained", str(found)
    (warning,) = (m for m in found.messages if "half" in m)
    assert "Coulomb level" in warning


@pytest.mark.parametrize(("payload", "expected"), [(0.2, "mass"), (0.02, "mass"), (0.006, "")])
def test_a_payload_that_comes_half_way_is_a_change_of_the_mass_if_it_would_be_an_error(
    payload, expected
):
    problem = Problem(AXIS, (prepare(changed(AXIS, AXIS.replace(mass=2.0 + payload))),))
    fit = problem.fit(AXIS)
    assert changing_cause(Search(problem), Model(fit), fit) == expected


def test_a_cause_that_acts_in_one_half_alone_is_the_same_throughout():
    whole = driven(SPRUNG)
    u = np.where(np.arange(len(whole)) < len(whole) // 2, whole.u, 0.0)
    x = 1e-6 * np.round(1e6 * SPRUNG.simulate(u, dt=1e-3).y[0])
    problem = Problem(AXIS, (prepare(dfc.Record(whole.t, u, x)),))
    search = Search(problem)
    now = search.eliminate_causes(Model(problem.fit(SPRUNG, SPRING), ("spring",)))
    assert now.causes == ("spring",)
    assert changing_cause(search, now, now.fit) == ""


def under_weights(*weights):
    """The problem of an axis under a constant force that differs between records."""
    t = 2e-3 * np.arange(2000)
    records = []
    for weight in weights:
        u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0) - weight
        x = AXIS.replace(effects=(dfc.effects.BiasForce(weight),)).simulate(u, dt=2e-3).y[0]
        records.append(prepare(dfc.Record(t, u, 1e-6 * np.round(1e6 * x))))
    return Problem(AXIS, tuple(records))


@pytest.mark.parametrize(("weights", "apart"), [((0.0, -60.0), True), ((-60.0, -60.0), False)])
def test_weights_that_differ_between_records_are_apart_from_the_start(weights, apart):
    problem = with_weights_apart(under_weights(*weights))
    assert problem.own == (("bias_force.force",) if apart else ())


def test_a_nominal_weight_may_differ_between_records():
    problem = under_weights(-20.0, -60.0)
    axis = AXIS.replace(effects=(dfc.effects.BiasForce(-40.0),))
    problem = dataclasses.replace(problem, believed=axis)
    varies, _ = varying_parameters(problem, problem.fit(axis), ())
    assert varies["bias_force.force"]["values"] == pytest.approx([-20.0, -60.0], rel=1e-3)


# -- what no machine can have, and what is looked at again -------------------------------


@pytest.mark.parametrize("force, reason", [(0.01, True), (0.2, False)])
def test_a_force_below_a_thousandth_of_the_drive_is_no_cause(sprung, force, reason):
    bias = dfc.effects.BiasForce(force=force)
    fit = sprung.fit(SPRUNG.replace(effects=(*SPRUNG.effects, bias)), SPRING, turns=0)
    assert is_negligible(sprung, fit, "bias_force") is reason


def test_slopes_of_the_force_view_are_those_of_its_columns():
    record = driven(SPRUNG)
    view = ForceView(Problem(AXIS, (prepare(record),)), AXIS)
    rng = np.random.default_rng(4)
    left = rng.standard_normal(view.y.size)
    # Differences at the ends of a record are one-sided.
    inside = np.where((record.t > 0.2) & (record.t < 2.8), 1.0, 0.0)
    change = inside * rng.standard_normal(len(record))
    force, reading = view.slopes(left)
    assert left @ view.of_forces([change])[:, 0] == pytest.approx(-force @ change, rel=1e-9)
    assert left @ view.of_readings([change])[:, 0] == pytest.approx(-reading @ change, rel=1e-9)


def test_the_force_view_knows_an_eccentric_encoder_of_its_axis():
    wheel = dfc.effects.EccentricEncoder(amplitude=2e-4, period=0.03, phase=0.4)
    machine = AXIS.replace(effects=(wheel,))
    problem = Problem(AXIS, (prepare(driven(machine)),))
    without, known = (ForceView(problem, axis) for axis in (AXIS, machine))
    assert known.squares < 0.02 * without.squares


@pytest.mark.parametrize("apart, reason", [(1e-4, "implausible values"), (0.25, "")])
def test_an_end_stop_has_travel_before_it(apart, reason):
    # Two stops that lie together in the middle of the travel push as a spring does.
    ends = dfc.effects.EndStop(0.05 - 0.5 * apart, 0.05 + 0.5 * apart, 40.0)
    axis = AXIS.replace(effects=(ends,), travel=(-1.0, 1.0))
    problem = Problem(axis, (prepare(driven(SPRUNG)),))
    own = [f"end_stop.{n}" for n in ("low", "high", "stiffness")]
    assert infeasible_reason(problem, problem.fit(axis, own, turns=0), "end_stop", own) == reason


def test_a_round_beside_an_explanation_is_not_that_of_the_model_alone():
    play = AXIS.replace(effects=(dfc.effects.Backlash(gap=2e-3, load_fraction=0.3),))
    problem = Problem(AXIS, (prepare(driven(play, 2.0)),))
    own = ("backlash.gap", "backlash.load_fraction")
    now, clean = Model(problem.fit(AXIS)), problem.fit(play, own)
    with among("backlash", "bias_force"):
        search = Search(problem)
        beside = [row.names for row in search.round(now, clean)]
        alone = [row.names for row in search.round(now)]
    assert ("backlash",) not in beside
    assert ("backlash",) in alone


def test_a_joined_proposal_goes_on_without_what_comes_to_nothing():
    problem = Problem(AXIS, (prepare(driven(SPRUNG)),))
    axis = AXIS.replace(effects=(dfc.effects.Saturation(60.0), *SPRUNG.effects))
    both = Proposal(("saturation", "spring"), axis, ("saturation.limit", *SPRING), 0.0, 100.0)
    with among("saturation", "spring"):
        odds = {"saturation": 0.0, "spring": 0.0}
        looks = ProposalFits(problem, problem.fit(AXIS), odds, lambda names, reason: None)
        looks.fit([both])
    (row,) = looks.rows
    assert row.names == ("spring",)
    assert row.fit.values()["spring.stiffness"] == pytest.approx(40.0, rel=1e-3)


def test_a_start_is_sought_where_the_strokes_are_fastest():
    record = driven(AXIS, 8.0)
    slow = record.t < 4.0
    # The first half at a third of the speed: the same reversals over shorter strokes.
    x = np.where(slow, record.x / 3.0, record.x)
    whole = prepare(dfc.Record(record.t, record.u, x, units=record.units))
    problem = Problem(AXIS, (whole,))
    (part,) = problem.fast_stretches
    ((start, end),) = part.pieces
    assert start > 3900 and end - start < 4000
    assert part.active.sum() == end - start
    # What it costs there is what the filter finds when it begins there.
    likelihood = problem.likelihood(AXIS)
    point = likelihood.on((part,)).at(likelihood.start())
    assert np.all(point.out[0][:, :start] == 0.0)
    assert math.isfinite(point.cost)


def test_a_record_with_few_reversals_is_sought_as_a_whole():
    problem = Problem(AXIS, (prepare(driven(AXIS, 1.0)),))
    assert problem.fast_stretches[0] is problem.runs[0]


def test_one_effect_at_a_time_builds_friction_up():
    play = AXIS.replace(effects=(dfc.effects.Presliding(2e-4),))
    problem = Problem(AXIS, (prepare(driven(play, 2.0)),))
    names = ("presliding", "backlash", "compliance", "bias_force")
    with among(*names):
        gram = Gram(problem, problem.fit(AXIS), names, lambda name, reason: None)
        gram.simulate()
        sets = [{gram.items[g].name for g in some} for _, some in gram.sets()]
    assert {"presliding"} in sets
    assert all(len(some - {"bias_force"}) == 1 for some in sets)


@pytest.mark.parametrize("effect", [dfc.effects.BiasForce(3.0), dfc.effects.Spring(80.0, 0.1)])
def test_a_force_of_any_shape_does_not_stand_for_a_law(effect):
    problem = Problem(AXIS, (prepare(driven(AXIS.replace(effects=(effect,)))),))
    assert Search(problem).with_any_shape(Model(problem.nominal_fit)) is None


def test_no_shape_with_a_memory_is_tried_after_the_time_limit():
    problem = Problem(AXIS, (prepare(driven(SPRUNG)),))
    failed = list[str]()
    fit = problem.fit(AXIS)
    late = dataclasses.replace(problem, until=0.0)
    for one, tried in ((problem, True), (late, False)):
        gram = Gram(one, fit, ["presliding"], lambda name, reason: failed.append(name))
        gram.simulate()
        assert any(item.name == "presliding" for item in gram.items) is tried
    assert not failed  # it may be right


def test_the_base_alone_is_that_of_the_model_where_none_is_free():
    problem = Problem(AXIS, (prepare(driven(SPRUNG)),), known=("mass", "viscous", "coulomb"))
    assert Search(problem)._by_force(problem.nominal_fit).base_alone == AXIS


def test_what_came_to_nothing_is_not_fitted_again_with_other_inputs():
    problem = Problem(AXIS, (prepare(driven(SPRUNG)),))
    now = Model(problem.fit(AXIS))
    with among("spring", "bias_force"):
        first = Search(problem)
        (row,) = first.round(now)
        first.idle[frozenset()].add(frozenset(row.names))
        again = Search(problem, before=first)
        assert row.names == ("spring",)
        assert again.round(now) == []


def test_an_effect_that_was_fitted_before_is_a_row_of_the_round():
    problem = Problem(AXIS, (prepare(driven(SPRUNG)),))
    found, odds = problem.fit(SPRUNG, SPRING), {"spring": 0.0}
    looks = ProposalFits(problem, problem.fit(AXIS), odds, lambda names, reason: None)
    looks.begin_with("spring", found)
    (row,) = looks.good
    assert row.fit is found
    assert row.free == SPRING


def test_starts_from_two_bases_are_put_in_order_beside_one_model():
    """A cost of one base at its own noises says nothing beside one of another."""
    problem = Problem(AXIS, (prepare(driven(SPRUNG)),))
    now, other = problem.fit(AXIS), problem.fit(AXIS.replace(coulomb=20.0), turns=0)
    one, two = (
        Gram(problem, fit, ["backlash"], lambda name, reason: None, beside=now)
        for fit in (now, other)
    )
    assert one._levels != two._levels
    assert one._fit_levels == two._fit_levels
    assert np.array_equal(one._fit_noises, two._fit_noises)


def test_what_a_play_holds_is_free_in_the_form_that_uses_it():
    free = ("backlash.gap", "backlash.load_fraction")
    rigid = dfc.effects.Backlash(gap=2e-3, load_fraction=0.3)
    ends = dataclasses.replace(rigid, compliance=1e-5, damping=2.0)
    for play, own in ((rigid, ()), (ends, ("backlash.compliance", "backlash.damping"))):
        axis = AXIS.replace(effects=(play,))
        assert held_by(axis, "backlash") == own
        assert with_held(axis, ["backlash"], free) == (*free, *own)
        # From the other form what it does not use is not free any more.
        assert with_held(axis, ["backlash"], (*free, "backlash.compliance"))[: len(free)] == free
        assert {*with_held(axis, ["backlash"], (*free, "backlash.compliance"))} == {*free, *own}
    every = [forms(AXIS.replace(effects=(play,)), ["backlash"]) for play in (rigid, ends)]
    assert [sum(axis.effects[0].compliance > 0.0 for axis in some) for some in every] == [3, 2]
