"""Causes one after the other: what takes another's place, and what is too small to name."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from diagnosis_cases import among, believed, record, tried
from truth import make_case, make_machine

import dryfric_control as dfc
from dryfric_control.diagnosis.candidates import own_names, with_effect
from dryfric_control.diagnosis.causes_found import State, least_addition
from dryfric_control.diagnosis.forward_search import (
    _ahead,
    _apart,
    _better,
    _close,
    _ended,
    _from_nominal,
    forward,
    resumed,
)
from dryfric_control.diagnosis.likelihood_search import EQUAL, SLACK, Search
from dryfric_control.diagnosis.screening import Candidate
from dryfric_control.estimation.parameters import SHIFT

DT = 1e-3
PEAK = {"excess": 0.3, "speed": 0.02}
BIAS = {"force": 1.0}


def test_a_replacement_starts_from_what_it_would_be_beside_the_others():
    case = make_case("coulomb_asymmetry", 3)
    search = Search(believed(case), [record(case)])
    now = search.fit(search.believed, (), iterations=6)
    free, noises = own_names("coulomb_asymmetry"), now.z[len(now.problem.names) :]
    true = case.truth["coulomb_asymmetry"]["asymmetry"] * case.actual["coulomb"]
    # Three times its value: what was missing when it was tried first is in it.
    far = with_effect(now.axis, "coulomb_asymmetry", {"force": 3.0 * true}).axis
    candidate = Candidate("coulomb_asymmetry", free, far, 0.0)
    axis = search.nearest(now.axis, candidate, free, noises)
    assert axis.effects[-1].force == pytest.approx(true, rel=0.3)


@pytest.mark.parametrize("notable", [0.0, 1e9])
def test_where_nothing_gains_enough_a_moved_base_is_left_too(notable, monkeypatch):
    case = make_case("bias_force", 4)
    moved = replace(believed(case), mass=0.65 * case.believed["mass"])
    search = Search(believed(case), [record(case)])
    now = search.fit(moved, (), iterations=0)
    asked = []
    monkeypatch.setattr(search, "_at_nominal", lambda fit: asked.append(fit) or fit)
    with among("bias_force"):
        search.screen(now, first=False, notable=notable)
    assert bool(asked) == (notable > 0.0)


@pytest.mark.parametrize("rate", [-0.6, 0.8])
def test_a_guess_worse_than_nothing_is_no_reason_to_find_nothing(rate, monkeypatch):
    case = make_case({"drift": {"rate": 0.01}}, 2)
    search = Search(believed(case), [record(case)])
    now = search.fit(search.believed, (), iterations=6)
    view = "dryfric_control.diagnosis.screening.guesses"
    monkeypatch.setattr(view, lambda effect, view: [({"rate": rate}, {"coulomb": 1e-3})])
    with among("drift"):
        (found,) = search.screen(now, first=False)
    assert found.slug == "drift"
    assert now.cost - found.cost > 100.0
    assert found.axis.named_effects()["drift"].rate == pytest.approx(0.01, rel=0.3)


def test_an_unconfirmed_cause_with_a_large_share_makes_the_search_go_on():
    case = make_case("bias_force", 4)
    search = Search(believed(case), [record(case)])
    state = State(search.fit(search.believed, (), iterations=6))
    state.refuted.add("saturation")
    with among("bias_force", "saturation"):
        assert resumed(search, state, math.inf)
        assert state.causes == ["bias_force"]
        # Not twice for the same.
        assert not resumed(search, state, math.inf)
        # Nor once the time of the search is over.
        state.refuted.add("spring")
        assert not resumed(search, state, 0.0)


@pytest.mark.slow
def test_a_search_goes_on_with_inputs_that_act_early():
    case = make_machine(2, ("bias_force", "stribeck"))[0]
    search = Search(believed(case), [record(case)])
    search.clock = (SHIFT,)
    with among("backlash", "bias_force"):
        state = forward(search, most=1)
    assert state.causes == ["bias_force"]
    assert abs(state.fit.values()[SHIFT]) < 0.1 * DT


@pytest.mark.parametrize(("early", "ended"), [(None, True), (-50.0, True), (-150.0, False)])
def test_free_runs_do_not_judge_inputs_that_act_early(early, ended):
    # They take the inputs as they are, and what imitates the lead reaches the noise.
    lead = None if early is None else SimpleNamespace(cost=early)
    search = SimpleNamespace(earlier=lambda now: lead)
    state = SimpleNamespace(fit=None)
    candidates = [Candidate(s, (), None, c) for s, c in (("lag", -100.0), ("spring", -20.0))]
    assert _ended(search, state, candidates, lambda state, some: True) is ended
    assert not _ended(search, state, candidates, lambda state, some: False)
    assert not _ended(search, state, candidates, None)


def test_beside_inputs_that_act_early_candidates_are_weighed_on_all_samples():
    case = make_case("bias_force", 4, "exact")
    measured = record(case)
    late = measured.replace(u=np.concatenate((measured.u[:2], measured.u[:-2])))
    search = Search(believed(case), [late])
    search.clock, search.shift = (SHIFT,), -2e-3
    now = search.fit(search.believed, (), iterations=6)
    axis = search.believed.replace(effects=(dfc.effects.BiasForce(**case.truth["bias_force"]),))
    assert search.part < 1.0
    assert search._may_gain(now, Candidate("bias_force", (), axis, now.cost), 1e3)
    assert not search._may_gain(now, Candidate("spring", (), now.axis, now.cost), 1e3)
    # The time by which the inputs act early counts where it is not free, too.
    assert search.reference(axis, shift=-2e-3).cost < search.reference(axis).cost - 1e3


@pytest.mark.parametrize(
    ("gain", "whole", "heard", "expected"),
    [
        (190.0, 10_000.0, 8000.0, True),  # 2 % a sample, though 1.9 % of the gain
        (150.0, 10_000.0, 8000.0, False),
        (21.0, 1000.0, 8000.0, True),  # 2 % of a small gain
        (19.0, 1000.0, 8000.0, False),
        (41.0, 10_000.0, 400.0, True),  # a tenth of a random force that readings show faintly
        (39.0, 10_000.0, 400.0, False),
    ],
)
def test_a_further_cause_must_explain_a_part_of_the_gain_or_of_the_force(
    gain, whole, heard, expected
):
    assert (gain >= least_addition(whole - gain, 8000, heard)) is expected


@pytest.mark.slow
def test_one_term_of_a_sum_is_enough():
    # Its level changes along the way, by a straight line.
    middle = dfc.effects.PositionDependence(slope=2.0, centre=0.0)
    t = DT * np.arange(6000)
    u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    measured = dfc.Record(
        t, u, 1e-6 * np.round(axis.replace(effects=(middle,)).simulate(u, DT).y[0] * 1e6)
    )
    search = Search(axis, [measured])
    for slug, values, there in (
        ("position_dependence", {"slope": 2.0, "curvature": 0.0, "centre": 0.0}, True),
        # All of these are needed.
        ("cogging", {"amplitude": 0.01, "period": 0.02, "phase": 0.0}, False),
    ):
        one = with_effect(search.believed, slug, dict(values))
        fit = search.fit(one.axis, one.free)
        assert search.sound(fit, slug, one.free) is there, fit.values()


@pytest.mark.parametrize(("share", "turns"), [(0.25, 6), (0.6, 0), (-0.6, 0)])
def test_friction_that_resists_one_way_alone_is_a_force(share, turns):
    """Half the difference of two levels of more than half their mean: no cause, but a bias."""
    case = make_case({"coulomb_asymmetry": {"asymmetry": 0.2}}, 3)
    search = Search(believed(case), [record(case)])
    force = share * case.actual["coulomb"]
    axis = with_effect(search.believed, "coulomb_asymmetry", {"force": force}).axis
    fit = search.fit(axis, own_names("coulomb_asymmetry"), iterations=turns)
    assert search.sound(fit, "coulomb_asymmetry", own_names("coulomb_asymmetry")) is (turns > 0)


@pytest.mark.slow
def test_what_gains_most_and_is_refused_is_no_measure_for_others(monkeypatch):
    case = make_machine(2, ("bias_force", "stribeck"))[0]
    search = Search(believed(case), [record(case)])
    with among("coulomb_asymmetry", "stribeck"):
        now, candidates = search.first
    gains = {c.slug: now.cost - c.cost for c in candidates}
    assert [c.slug for c in candidates] == ["stribeck", "coulomb_asymmetry"]
    assert gains["coulomb_asymmetry"] < 0.4 * gains["stribeck"]
    monkeypatch.setattr(search, "sound", lambda fit, slug, free: slug == "coulomb_asymmetry")
    monkeypatch.setattr(search, "simpler", lambda fit, less: True)
    assert [c.slug for _, c, _ in search.extend(now, candidates)] == ["coulomb_asymmetry"]


@pytest.mark.slow
def test_what_unseen_data_do_not_confirm_yet_is_remembered(lopsided):
    search, first = lopsided
    slugs = ("spring", {"stiffness": 10.0, "rest": 0.0}), ("bias_force", BIAS), ("stribeck", PEAK)
    spring, bias, peak = (tried(search, first, *one) for one in slugs)
    gain = first.cost - bias.cost
    # Of the others, what gains little is no stand-in.
    chosen = Candidate("spring", spring.free, spring.axis, first.cost - 1.5 * gain)
    small = Candidate("drift", ("drift.rate",), first.axis, first.cost - 0.1 * gain)
    many = Candidate("cogging", own_names("cogging"), first.axis, first.cost - 2.0 * gain)
    near = _close(search, first, chosen, [chosen, many, bias, peak, small])
    slugs = [c.slug for c in near]
    assert "bias_force" in slugs and not {"drift", "cogging", "spring"} & {*slugs}


@pytest.mark.slow
def test_a_fit_that_ended_early_is_gone_on_with_before_causes_are_compared(lopsided):
    # Else the first cause that leads out of there gains what is not its own.
    search, first = lopsided
    stuck = search.fit(search.believed.replace(mass=3.0 * first.axis.mass), (), None, 0)
    peak = tried(search, stuck, "stribeck", PEAK)
    ranked = [(1.0, peak, search.fit(peak.axis, peak.free))]
    better = _better(search, stuck, ranked)
    assert better.cost == pytest.approx(first.cost, abs=EQUAL)
    assert better.problem.names == first.problem.names
    assert _better(search, better, ranked) is None and _better(search, stuck, []) is None


@pytest.mark.slow
def test_two_causes_that_only_together_are_sure_come_before_a_lesser_one(monkeypatch):
    case = make_machine(2, ("bias_force", "stribeck"))[0]
    search = Search(believed(case), [record(case)])

    def held_out(less, fit):
        slugs = {n.partition(".")[0] for n in search.free_of(fit)}
        return SimpleNamespace(sure=slugs != {"stribeck"} and slugs != {"bias_force"}, gain=1e3)

    monkeypatch.setattr(search, "held_out", held_out)
    monkeypatch.setattr(search, "simpler", lambda fit, less: False)
    with among("coulomb_asymmetry", "stribeck", "bias_force"):
        now, candidates = search.first
        ranked = search.extend(now, candidates)
        assert [c.slug for _, c, _ in ranked] == ["coulomb_asymmetry"]
        assert search.unsure[0][0] > ranked[0][0]
        assert sorted(forward(search).causes) == ["bias_force", "stribeck"]


def test_noise_recorded_with_an_input_is_taken_off_where_that_is_the_likelier():
    case = make_case("viscous", 40, "noisy")
    search = Search(believed(case), [record(case)])
    loud = search.fit(search.believed, ())
    quiet = search.quieter(loud)
    assert search.width > 0.0 and quiet.problem.runs[0] is search.few[0]
    assert quiet.cost < loud.cost - EQUAL
    assert quiet.random_force() < 0.9 * loud.random_force()
    # It pushes nothing, but free runs are driven by what was recorded.
    assert search.as_recorded(quiet).random_force() == pytest.approx(loud.random_force(), rel=0.1)
    assert search.quieter(quiet) is quiet

    clean = Search(believed(case), [record(make_case("viscous", 40, "exact"))])
    fit = clean.fit(clean.believed, ())
    assert clean.quieter(fit) is fit and clean.width == 0.0 and clean.as_recorded(fit) is fit


def test_a_model_too_poor_to_feel_the_noise_gets_an_input_without_it():
    # With it the model breaks away too early, and fits have many optima.
    case = make_machine(131)[0]
    search = Search(believed(case), [record(case)])
    loud = search.alone()
    assert search.quieter(loud).cost == pytest.approx(loud.cost, abs=SLACK)
    assert search.width > 0.0


@pytest.mark.slow
def test_a_search_looks_one_round_ahead_of_what_is_unsure_by_itself():
    case = make_machine(2, ("bias_force", "stribeck"))[0]
    search = Search(believed(case), [record(case)])
    now = search.fit(search.believed, ())
    bias = tried(search, now, "bias_force", {"force": -1.0})
    half = search.fit(bias.axis, bias.free)
    twin = tried(search, now, "coulomb_asymmetry", BIAS)
    unsure = [(3.0, bias, half), (2.0, bias, half), (1.0, twin, now)]
    # What costs the same does the same.
    assert _apart(unsure) == [unsure[0], unsure[2]]
    with among("stribeck", "bias_force"):
        (a, b), fit = _ahead(search, now, unsure[:1], 0.0, lambda gain: True)
        assert (a.slug, b.slug) == ("bias_force", "stribeck")
        assert fit.cost < half.cost < now.cost
        # Neither where there is more to be had, nor where it adds little.
        assert (
            _ahead(search, now, unsure[:1], 2.0 * (now.cost - fit.cost), lambda gain: True) is None
        )
        assert _ahead(search, now, unsure[:1], 0.0, lambda gain: False) is None


def test_a_search_whose_time_is_over_while_it_compares_ends_with_what_it_has(monkeypatch):
    case = make_machine(2, ("bias_force", "stribeck"))[0]
    search = Search(believed(case), [record(case)])

    def out_of_time(now, candidates, notable):
        search.until = 0.0
        return []

    monkeypatch.setattr(search, "extend", out_of_time)
    with among("bias_force"):
        state = forward(search)
    assert state.late and state.causes == [] and state.fit is search.first[0]


@pytest.mark.slow
def test_a_base_that_has_bent_is_searched_with_as_believed_too():
    # As if without its causes the base had come out as another machine's.
    case = make_case("coulomb_asymmetry", 3, "short")
    search = Search(believed(case), [record(case)])
    base = search.base
    heavy = search.believed.replace(mass=3.0 * search.believed.mass)
    bent = search.fit(heavy, (), None, 0)
    state = State(bent)
    state.first = {"drift": 1.0}
    with among("bias_force", "viscous_asymmetry", "coulomb_asymmetry"):
        state = _from_nominal(search, state, 4)
    assert search.base == base
    assert state.causes and state.fit.cost < bent.cost
    assert search.bold(bent) and not search.bold(state.fit)
    assert {"mass", "viscous", "coulomb"} <= {*state.fit.values()}
    assert state.first == {"drift": 1.0}


def test_peaks_far_narrower_than_an_increment_a_sample_are_not_searched():
    # Beside a play the load would break away hundreds of times in each sample.
    case = make_machine(2, ("stribeck",))[0]
    search = Search(believed(case), [record(case)])
    problem = search.problem(search.believed, ("stribeck.excess", "stribeck.speed"))
    j = problem.names.index("stribeck.speed")
    slowest = problem.parameters[j].value(problem.low[j])
    assert slowest == pytest.approx(0.1 * case.quantum / search.records[0].dt, rel=0.01)


def test_a_fit_that_has_arrived_is_not_left_for_those_that_promise_more(monkeypatch):
    case = make_machine(2, ("bias_force",))[0]
    search = Search(believed(case), [record(case)])

    def fitted(cost, promised, gap=1e-3):
        problem = SimpleNamespace(names=["backlash.gap"], parameters=[SimpleNamespace(kind="")])
        return SimpleNamespace(
            problem=problem, z=cost, cost=cost, promised=promised, at_bound=(), axis=cost,
            values=lambda: {"backlash.gap": gap},
        )  # fmt: skip

    # Two that promise much, and stay; one that has arrived, and one with a play too narrow to see.
    guesses = [fitted(-10.0, 50.0), fitted(-20.0, 40.0), fitted(-60.0, 0.0), fitted(-80.0, 0, 1e-8)]
    monkeypatch.setattr(
        "dryfric_control.diagnosis.screening.maximise",
        lambda problem, z, turns, until: next(one for one in guesses if one.z == z),
    )
    now = SimpleNamespace(problem=SimpleNamespace(names=[]))
    starts = [SimpleNamespace(problem=one.problem, z=one.z, slug="backlash") for one in guesses]
    assert search._fitted(now, starts, 3, below=0.0).cost == -60.0


@pytest.mark.slow
@pytest.mark.parametrize("leaves", [False, True])
def test_effects_with_a_memory_wait_where_another_cause_leaves_nothing(monkeypatch, leaves):
    case = make_machine(2, ("bias_force",))[0]
    search = Search(believed(case), [record(case)])
    monkeypatch.setattr(search, "nothing_left", lambda fit: leaves)
    asked, screen = [], search.screen

    def noted(now, first=True, stiff=False, *rest, **settings):
        if stiff:
            asked.append(len(now.axis.effects))
        return screen(now, first, stiff, *rest, **settings)

    monkeypatch.setattr(search, "screen", noted)
    with among("bias_force", "backlash"):
        assert forward(search).causes == ["bias_force"]
    # Beside the bias they are asked anyway.
    assert asked == ([1] if leaves else [0, 1])


def test_a_fit_that_fails_leaves_no_other_waiting_for_threads():
    case = make_case("bias_force", 4)
    search = Search(believed(case), [record(case)], jobs=2)
    problem = search.problem(search.believed, ())

    def fails():
        raise ValueError("no such axis")

    with pytest.raises(ValueError, match="no such axis"):
        search._parallel([(fails, ()), *[(lambda: list(problem.map(abs, [-1, -2])), ())] * 8])
    assert list(problem.map(abs, [-1, -2])) == [1, 2]
    assert search._parallel([(abs, (-3,)), (abs, (-4,))]) == [3, 4]


@pytest.mark.parametrize(("error", "there"), [(0.25, True), (0.35, False)])
def test_an_effect_with_a_memory_must_be_well_determined(error, there, monkeypatch):
    case = make_case("bias_force", 4)
    search = Search(believed(case), [record(case)])
    values = {"stiffness": 1e4, "damping": 1.0, "load_fraction": 0.5}
    start = with_effect(search.believed, "compliance", values)
    fit = search.fit(start.axis, start.free, iterations=0)
    errors = {name: error * value for name, value in fit.values().items()}
    monkeypatch.setattr(type(fit), "standard_errors", lambda self: errors)
    assert search.sound(fit, "compliance", start.free) is there


@pytest.mark.parametrize(("part", "there"), [(0.02, True), (2.0, False)])
def test_a_peak_at_most_speeds_must_exceed_its_error(part, there, monkeypatch):
    case = make_case("bias_force", 4)
    search = Search(believed(case), [record(case)])
    fastest = float(np.abs(search.records[0].derivatives().v).max())
    peak = {"excess": 0.01, "speed": part * fastest}
    start = with_effect(search.believed, "stribeck", peak)
    fit = search.fit(start.axis, start.free, iterations=0)
    # Errors of a narrow peak say little, as it acts at breakaway alone.
    errors = {name: 2.0 * abs(value) for name, value in fit.values().items()}
    monkeypatch.setattr(type(fit), "standard_errors", lambda self: errors)
    assert search.sound(fit, "stribeck", start.free) is there
    errors["stribeck.excess"] = 0.001
    assert search.sound(fit, "stribeck", start.free)
