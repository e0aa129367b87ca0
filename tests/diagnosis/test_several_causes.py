"""Effects that the axis has already, with the wrong numbers; causes that hide each other."""

import numpy as np
import pytest
from diagnosis_cases import among, believed, causes, record
from truth import make_case, make_machine

import dryfric_control as dfc
from dryfric_control.diagnosis.candidates import own_names
from dryfric_control.diagnosis.problem import Problem
from dryfric_control.diagnosis.search import Model, Search
from dryfric_control.estimation.likelihood import prepare
from dryfric_control.estimation.windows import cut


@pytest.mark.slow
def test_an_effect_in_the_believed_axis_may_have_the_wrong_numbers():
    case = make_case("spring", 0, "short")
    true = case.truth["spring"]
    half = dfc.effects.Spring(stiffness=0.5 * true["stiffness"], rest=true["centre"])
    with among("spring", "gravity", "position_dependence", "bias_force", "cogging"):
        found = dfc.diagnose(believed(case).replace(effects=(half,)), record(case), jobs=1)
    assert causes(found) == ["spring"], str(found)
    assert found.causes[0].parameters["stiffness"] == pytest.approx(true["stiffness"], rel=0.05)
    assert "lready in the nominal axis" in found.causes[0].explanation
    assert len(found.extended.effects) == 1


@pytest.mark.slow
def test_a_nominal_force_of_the_wrong_sign_hides_no_cause():
    case = make_case(("bias_force", "quadratic_drag"), 5, "short")
    force = case.truth["bias_force"]["force"]
    wrong = dfc.effects.BiasForce(force=-0.6 * force)
    rivals = ("viscous_asymmetry", "spring", "stribeck", "end_stop")
    with among("bias_force", "quadratic_drag", *rivals):
        found = dfc.diagnose(believed(case).replace(effects=(wrong,)), record(case), jobs=1)
    assert causes(found) == ["quadratic_drag", "bias_force"], str(found)
    assert found.causes[1].parameters["force"] == pytest.approx(force, rel=1e-3)


@pytest.mark.slow
def test_a_nominal_weight_of_the_wrong_side_ends_nothing():
    # The linear prediction is a weight below zero, which no axis can have.
    axis = dfc.FrictionAxis(mass=0.1, viscous=0.3, coulomb=0.4, units=("rad", "N m"))
    nominal, true = (
        axis.replace(effects=(dfc.effects.Gravity(1.0, phase=phase),)) for phase in (0.3, 0.3 + np.pi)
    )  # fmt: skip
    t = 2e-3 * np.arange(3000)
    u = 2.5 * np.sin(3.0 * t) + 1.2 * np.sin(7.3 * t)
    seen = np.round(true.simulate(u, dt=2e-3).y[0] / 1e-5) * 1e-5
    with among("gravity", "bias_force", "spring"):
        found = dfc.diagnose(nominal, dfc.Record(t, u, seen), jobs=1)
    assert causes(found) == ["gravity"], str(found)
    phase = found.causes[0].parameters["phase"] - 0.3
    assert np.cos(phase) == pytest.approx(-1.0, abs=1e-6)


@pytest.mark.slow
def test_a_nominal_amount_that_is_predicted_beyond_its_bound_ends_nothing():
    case = make_case("velocity_strengthening", 3, "short")
    true = case.truth["velocity_strengthening"]
    wrong = dfc.effects.VelocityStrengthening(2.5 * true["deficit"], 1.7 * true["speed"])
    with among("velocity_strengthening"):
        found = dfc.diagnose(believed(case).replace(effects=(wrong,)), record(case), jobs=1)
    assert causes(found) == ["velocity_strengthening"], str(found)
    assert found.causes[0].parameters["deficit"] == pytest.approx(true["deficit"], rel=0.01)


@pytest.mark.long
def test_causes_that_free_runs_show_only_beside_each_other_are_found():
    cases = make_machine(203)
    records = [record(case) for case in cases]
    hidden = ("saturation", "position_dependence")
    guess = (dfc.effects.Saturation(40.0), dfc.effects.PositionDependence(0.1, 0.0))
    axis = believed(cases[0]).replace(effects=guess)
    with among(*hidden, "gravity"):
        windows = tuple(cut(one, 0.25) for one in records)
        problem = Problem(believed(cases[0]), tuple(map(prepare, records)), windows=windows)
        search = Search(problem)
        joined = Model(problem.fit(axis, [n for one in hidden for n in own_names(one)]), hidden)
        assert search.eliminate_causes(joined).causes == ("saturation",)
        found = search.add_hidden_cause(joined)
    assert found is not None
    assert {*found.causes} == {*cases[0].truth}


@pytest.mark.slow
def test_the_answer_is_the_likeliest_on_the_way(monkeypatch):
    case = make_case("spring", 0, "short")
    spring = dfc.effects.Spring(case.truth["spring"]["stiffness"], case.truth["spring"]["centre"])
    with among("spring"):
        problem = Problem(believed(case), (prepare(record(case)),))
        search = Search(problem)
        none, axis = Model(search.fit_nominal()), believed(case).replace(effects=(spring,))
        one = search.eliminate_causes(Model(problem.fit(axis, own_names("spring")), ("spring",)))
        monkeypatch.setattr(Search, "exchange_cause", lambda self, now: none)
        monkeypatch.setattr(Search, "best_proposal", lambda self, now: None)
        assert search.run(one).causes == ("spring",)


@pytest.mark.slow
def test_the_strongest_cause_gives_way_to_a_simpler_one_that_does_the_same():
    # A weight is a cogging of one period a turn: with its period free it may be chosen first.
    nominal = dfc.FrictionAxis(mass=0.1, viscous=0.3, coulomb=0.4, units=("rad", "N m"))
    weaker = dfc.effects.ViscousAsymmetry(0.1), dfc.effects.CoulombAsymmetry(0.1)
    true = nominal.replace(effects=(dfc.effects.Gravity(1.0, phase=0.3), *weaker))
    t = 2e-3 * np.arange(2500)
    u = 2.5 * np.sin(3.0 * t) + 1.2 * np.sin(7.3 * t)
    seen = np.round(true.simulate(u, dt=2e-3).y[0] / 1e-5) * 1e-5
    noisy = u + 0.02 * np.random.default_rng(4).standard_normal(t.size)
    chosen = "cogging", "viscous_asymmetry", "coulomb_asymmetry"
    with among("gravity", *chosen):
        problem = Problem(nominal, (prepare(dfc.Record(t, noisy, seen)),))
        start = nominal.replace(effects=(dfc.effects.Cogging(1.0, 6.3, 0.3 + np.pi / 2), *weaker))
        fit = problem.fit(start, [n for one in chosen for n in own_names(one)])
        search = Search(problem)
        assert search.best_proposal(Model(search.fit_nominal())) is not None
        now = search.eliminate_causes(Model(fit, chosen))
        assert max(now.worth, key=now.worth.get) == "cogging"
        assert search.best_proposal(now) is None
        assert {*search.exchange_cause(now).causes} == {"gravity", *chosen[1:]}
