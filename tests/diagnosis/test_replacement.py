"""Causes found reconsidered: what takes another's place, and what goes."""

from types import SimpleNamespace

import numpy as np
import pytest
from diagnosis_cases import among, believed, record, tried
from truth import make_machine

import dryfric_control as dfc
from dryfric_control.diagnosis.candidates import own_names, with_effect
from dryfric_control.diagnosis.causes_found import State
from dryfric_control.diagnosis.confirmation import confirmed
from dryfric_control.diagnosis.likelihood_search import Search
from dryfric_control.diagnosis.replacement import (
    _decide,
    _exchange,
    _spares,
    _with_the_next,
    compare_alternatives,
    delay_or_lag,
    other_memory,
    sift,
    tidy,
)
from dryfric_control.diagnosis.screening import Candidate
from dryfric_control.model.effects.naming import named

DT = 1e-3
PEAK = {"excess": 0.3, "speed": 0.02}
BIAS = {"force": 1.0}


def state_with(search, first, *causes):
    """What a search has found so far, by slug and first values."""
    state = State(first)
    for slug, values in causes:
        one = with_effect(state.fit.axis, slug, dict(values))
        fit = search.fit(one.axis, (*state.names, *one.free))
        state.add(Candidate(slug, own_names(slug), one.axis, fit.cost), fit)
    return state


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "named", "close"),
    [
        # Nearly a constant force on a short way, with a parameter more.
        (
            "bias_force",
            ("gravity", {"amplitude": 1.0, "phase": -1.6}),
            ("bias_force", {"force": -1.0}),
        ),
        # As many parameters; the peak grows with the level of each direction.
        ("coulomb_asymmetry", ("bias_force", BIAS), ("coulomb_asymmetry", BIAS)),
        # The right one stays.
        ("coulomb_asymmetry", ("coulomb_asymmetry", BIAS), ("bias_force", {"force": -1.0})),
    ],
)
def test_a_cause_chosen_in_haste_makes_room(hidden, named, close):
    # The stand-in was chosen before the peak was there.
    case = make_machine(2, (hidden, "stribeck"))[0]
    search = Search(believed(case), [record(case)])
    state = State(search.fit(search.believed, ()))

    def candidate(slug, values):
        return Candidate(slug, own_names(slug), with_effect(state.fit.axis, slug, values).axis, 0.0)

    before = candidate(*close)
    for slug, values in (named, ("stribeck", PEAK)):
        one = candidate(slug, dict(values))
        state.add(one, search.fit(one.axis, (*state.names, *one.free)))
    state.close[named[0]] = [before]
    _exchange(search, state)
    assert state.causes == [hidden, "stribeck"]
    # What had its place is not forgotten: it may do the same.
    if named[0] != hidden:
        assert named[0] in [c.slug for c in state.close[hidden]]
    values = state.fit.values()
    true = case.truth["stribeck"]["excess"]
    assert values["stribeck.excess"] == pytest.approx(true, rel=0.05)
    assert set(state.names) < set(values)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("last", "spared"),
    [
        # It mended what another in place of the asymmetry left.
        (("stribeck_asymmetry", {"difference": 0.05, "speed": 0.02}), True),
        (("stribeck", PEAK), False),
    ],
)
def test_what_an_earlier_choice_is_mended_by_goes_with_it(last, spared):
    case = make_machine(2, ("coulomb_asymmetry", "stribeck"))[0]
    search = Search(believed(case), [record(case)])
    peak = ("stribeck", PEAK)
    state = State(search.fit(search.believed, ()))
    for slug, values in dict([peak, ("coulomb_asymmetry", BIAS), last]).items():
        one = with_effect(state.fit.axis, slug, dict(values))
        free = (*state.names, *one.free)
        fit = search.fit(one.axis, free)
        state.add(Candidate(slug, own_names(slug), one.axis, fit.cost), fit)
    state.causes.remove(last[0])
    state.causes.append(last[0])
    assert _spares(search, state, state.fit, "coulomb_asymmetry") is spared


@pytest.mark.parametrize(
    ("asymmetry", "named", "others"),
    # Costs on all samples: of equals the plainest is named, and the other stated.
    [(-102.0, "bias_force", ("coulomb_asymmetry",)), (-110.0, "coulomb_asymmetry", ())],
)
def test_effects_that_are_equal_on_all_samples_are_told_by_their_plainness(
    asymmetry, named, others
):
    costs = {"coulomb_asymmetry": asymmetry, "bias_force": -100.0}
    state = State(SimpleNamespace(axis="asymmetry", cost=-50.0))
    cause = Candidate("coulomb_asymmetry", ("coulomb_asymmetry.force",), None, -50.0)
    state.add(cause, state.fit)
    rival = Candidate("bias_force", ("bias_force.force",), None, -45.0)
    search = SimpleNamespace(
        weighed=lambda ranked: sorted(
            ((-costs[c.slug], c, f) for _, c, f in ranked), key=lambda one: -one[0]
        )
    )
    ranked = [(0.0, cause, state.fit), (0.0, rival, SimpleNamespace(axis="bias", cost=-45.0))]
    _decide(search, state, "coulomb_asymmetry", ranked)
    assert state.causes == [named]
    assert state.alternatives == {named: others}


@pytest.mark.slow
def test_what_does_the_same_is_stated_beside_all_the_others():
    # Without a peak a bias changes both levels by as much as an asymmetry.
    t = DT * np.arange(6000)
    u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    machine = axis.replace(
        effects=(dfc.effects.CoulombAsymmetry(force=1.0), dfc.effects.QuadraticDrag(drag=20.0))
    )
    x = 1e-6 * np.round(machine.simulate(u, DT).y[0] * 1e6)
    search = Search(
        axis, [dfc.Record(t, u + 0.1 * np.random.default_rng(0).standard_normal(t.size), x)]
    )
    first = search.fit(axis, ())
    drag = ("quadratic_drag", {"drag": 10.0})
    state = state_with(search, first, ("coulomb_asymmetry", BIAS), drag)
    state.close["coulomb_asymmetry"] = [
        tried(search, first, "bias_force", {"force": -1.0}),
        tried(search, first, "viscous_asymmetry", {"viscous": 1.0}),
    ]
    # Found when it was chosen, and no longer so.
    state.rivals["quadratic_drag"] = {"drift": first.axis}
    compare_alternatives(search, state)
    # Of the two the plainer is named.
    assert state.alternatives == {"bias_force": ("coulomb_asymmetry",), "quadratic_drag": ()}
    named = dict(state.fit.axis.named_effects())["bias_force"]
    assert named.force == pytest.approx(-1.0, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "beside", "named"),
    [
        ("compliance", "bias_force", ("load_encoder_backlash", 1e-4)),
        ("presliding", "dead_zone", ("backlash", 3e-4)),
        ("backlash", "bias_force", ("backlash", 3e-4)),
    ],
)
def test_a_memory_named_in_haste_is_compared_with_all_others(hidden, beside, named):
    case = make_machine(2, (hidden, beside))[0]
    search = Search(believed(case), [record(case)])
    first = search.fit(search.believed, ())
    other = {"bias_force": {"force": 1.0}, "dead_zone": {"width": 1.0}}[beside]
    slug, gap = named
    with among(beside, "compliance", "presliding", "backlash", "load_encoder_backlash"):
        play = (slug, {"gap": gap, "load_fraction": 0.5})
        state = state_with(search, first, (beside, other), play)
        changed = other_memory(search, state)
    assert state.causes == [beside, hidden] and changed is (slug != hidden)
    assert not other_memory(search, state)  # settled
    if hidden == "compliance":
        # The first fit of both is less likely than one without the bias, and goes on from there.
        assert state.fit.values()["bias_force.force"] == pytest.approx(
            case.truth["bias_force"]["force"], rel=0.05
        )


@pytest.mark.parametrize(
    ("slug", "values", "gone"),
    [
        ("bias_force", {"force": 0.9}, True),
        ("bias_force", {"force": 1.1}, False),
        ("position_dependence", {"slope": 0.9, "curvature": 0.9}, True),
        # Terms of a sum: one is enough.
        ("position_dependence", {"slope": 0.0, "curvature": 5.0}, False),
        ("position_dependence", {"slope": 5.0, "curvature": 0.0}, False),
    ],
)
def test_a_cause_is_gone_where_no_term_is_larger_than_its_error(slug, values, gone):
    own = {f"{slug}.{n}": v for n, v in values.items()}
    fit = SimpleNamespace(values=lambda: own, standard_errors=lambda: dict.fromkeys(own, 1.0))
    assert Search.vanished(Search.__new__(Search), fit, slug, tuple(own)) is gone


@pytest.mark.slow
def test_a_place_that_further_causes_move_out_of_the_travel_is_none(lopsided):
    search, first = lopsided
    far = {"stiffness": 0.5, "rest": 2.0 * float(np.abs(search.records[0].x).max())}
    state = state_with(search, first, ("stribeck", PEAK), ("spring", far))
    assert not search.sound(state.fit, "spring", state.free["spring"])
    # At the edge it may wait for a further cause that brings it back, but no longer.
    assert search.sound(state.fit, "spring", state.free["spring"], edge=True)
    assert not sift(search, state) and state.causes == ["stribeck", "spring"]
    assert sift(search, state, edge=False)
    assert state.causes == ["stribeck"] and state.refuted == {"spring"}


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 0.5])
@pytest.mark.parametrize("found", ["actuator_lag", "input_delay"])
def test_a_lag_found_beside_other_causes_may_be_a_delay(found, noise):
    # Noise that was recorded with the input, not acted: the lag takes it off.
    case = make_machine(2, ("bias_force", "input_delay"))[0]
    measured = record(case)
    heard = noise * np.random.default_rng(1).normal(size=len(measured))
    search = Search(believed(case), [measured.replace(u=measured.u + heard)])
    time = case.truth["input_delay"]["delay"]
    late = {"actuator_lag": "time_constant", "input_delay": "delay"}
    causes = ("bias_force", BIAS), (found, {late[found]: time})
    state = state_with(search, search.fit(search.believed, ()), *causes)
    delay_or_lag(search, state)
    assert state.causes == ["bias_force", "input_delay"]
    right = pytest.approx(time, rel=0.1 if noise else 0.02)
    assert state.fit.values()["input_delay.delay"] == right


def two_of_a_kind():
    """A record of cogging, and a state that found it as the second of two."""
    case = make_machine(2, ("cogging", "stribeck"))[0]
    values = case.truth["cogging"]
    search = Search(believed(case), [record(case)])
    first = search.fit(search.believed, ())
    right = {"amplitude": values["amplitude"], "period": values["pitch"], "phase": values["phase"]}
    faint = ("cogging", right | {"amplitude": 1e-4, "period": 0.37 * values["pitch"]})
    state = state_with(search, first, faint, ("stribeck", PEAK), ("cogging_2", right))
    return search, state, values


@pytest.mark.slow
def test_a_faint_one_before_another_of_its_kind_goes():
    search, state, values = two_of_a_kind()
    biased = with_effect(state.fit.axis, "bias_force", {"force": 0.5})
    state.close["stribeck"] = [
        Candidate("cogging_2", ("cogging_2.amplitude",), state.fit.axis, 0.0),
        Candidate("bias_force", biased.free, biased.axis, 0.0),
    ]
    tidy(search, state)
    assert sorted(state.causes) == ["cogging", "stribeck"]
    assert set(state.free) == set(state.close) == set(state.rivals) == set(state.causes)
    assert all(name.startswith("cogging.") for name in state.free["cogging"])
    assert state.fit.values()["cogging.period"] == pytest.approx(values["pitch"], rel=0.01)
    assert "cogging_2" not in {c.slug for c in state.close["stribeck"]}


@pytest.mark.slow
def test_what_moves_up_by_a_number_is_no_equivalent():
    search, state, _ = two_of_a_kind()
    final, _, judged = confirmed(search, state)
    assert sorted(state.causes) == ["cogging", "stribeck"]
    assert not any(one.others for one in judged.values())
    assert set(judged) == set(state.causes)
    assert "cogging_2" not in named(final.axis)


@pytest.mark.slow
def test_a_compliance_whose_load_has_no_mass_becomes_the_contact_that_it_is():
    case = make_machine(2, ("presliding", "bias_force"))[0]
    search = Search(believed(case), [record(case)])
    first = search.fit(search.believed, ())
    stiffness = case.actual["coulomb"] / case.truth["presliding"]["distance"]
    spring = {"stiffness": stiffness, "damping": 1.0, "load_fraction": 2e-3}
    state = state_with(search, first, ("bias_force", {"force": 1.0}), ("compliance", spring))
    sift(search, state)
    assert state.causes == ["bias_force", "presliding"]
    assert state.refuted == set()


@pytest.mark.parametrize(
    ("worth", "gain", "found"),
    [
        (480.0, 500.0, True),  # with it the rival is worth 1070, the cause 900
        (200.0, 220.0, False),
        (480.0, 10.0, False),  # what is not modelled may simulate as much
    ],
)
def test_a_rival_counts_with_the_cause_that_it_leaves_to_be_noticed(worth, gain, found):
    contact, load = (Candidate(slug, (), None, 0.0) for slug in ("presliding", "load_dependence"))
    half = SimpleNamespace(cost=-600.0, heard=lambda: 8000.0)
    both = SimpleNamespace(cost=-600.0 - gain)
    search = SimpleNamespace(
        screen=lambda *_: [load], extend=lambda *_: [(worth, load, both)], samples=8000
    )
    pair = _with_the_next(search, [(590.0, contact, half)], 900.0, 900.0)
    assert pair == ([(contact, half), (load, both)] if found else [])


@pytest.mark.slow
@pytest.mark.parametrize("nothing_left", [True, False])
def test_a_memory_that_leaves_nothing_gives_way_to_none_with_more_parameters(nothing_left):
    case = make_machine(2, ("presliding", "bias_force"))[0]
    search = Search(believed(case), [record(case)])
    contact = ("presliding", case.truth["presliding"])
    state = state_with(search, search.fit(search.believed, ()), ("bias_force", BIAS), contact)
    asked = []
    search.screen = lambda *_, **__: asked.append(True) or []
    search.nothing_left = lambda _: nothing_left
    assert not other_memory(search, state)
    assert bool(asked) is not nothing_left
