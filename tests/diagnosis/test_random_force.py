"""Diagnosis of records in which a random force acts beside the model."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import truth
from diagnosis_cases import among, believed, record

import dryfric_control as dfc
from dryfric_control.diagnosis.candidates import own_names
from dryfric_control.diagnosis.causes_found import State
from dryfric_control.diagnosis.confirmation import Judged, _louder, _sure, _weakest
from dryfric_control.diagnosis.forward_search import forward
from dryfric_control.diagnosis.gain_or_base import every, or_a_gain
from dryfric_control.diagnosis.held_out import HeldOut
from dryfric_control.diagnosis.likelihood_search import Search
from dryfric_control.diagnosis.random_force import LINE
from dryfric_control.diagnosis.report.findings import Cause
from dryfric_control.diagnosis.wrong_base import _with_a_load, or_equivalents, wrong_base
from dryfric_control.estimation.likelihood import Likelihood, prepare
from dryfric_control.estimation.parameters import values_of
from dryfric_control.estimation.scoring import maximise
from dryfric_control.model.effects.naming import named

DT = 1e-3
AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
# Effects that scale forces, all of them or those against the load, and some that do not.
RIVALS = (
    "input_gain", "load_dependence", "load_asymmetry", "stribeck", "bias_force", "spring",
    "input_delay",
)  # fmt: skip


def noisy(machine, seed, seconds=6.0):
    """A record whose input has 3 % of the Coulomb level as noise."""
    rng = np.random.default_rng(seed)
    t = DT * np.arange(round(seconds / DT))
    u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
    x = np.round(machine.simulate(u, dt=DT).y[0] * 1e6) * 1e-6
    return dfc.Record(t, u + 0.24 * rng.standard_normal(t.size), x)


@pytest.fixture(scope="module")
def biased():
    record = noisy(AXIS.replace(effects=(dfc.effects.BiasForce(1.0),)), 1)
    with among(*RIVALS):
        return dfc.diagnose(AXIS, record, known=("mass",), jobs=1)


@pytest.mark.slow
def test_names_a_bias_in_noise(biased):
    assert [c.effect for c in biased.causes] == ["bias_force"]
    cause = biased.causes[0]
    assert abs(cause.parameters["force"] - 1.0) < 4.0 * cause.standard_errors["force"] + 0.01
    assert biased.verdict == "explained"
    # The random force that was put in, in newtons.
    assert biased.remaining.rms == pytest.approx(0.24, rel=0.3)
    assert not biased.remaining.structured
    assert min(biased.references.values()) > 100.0
    assert biased.extended.mass == AXIS.mass
    assert "random force left" in biased.summary()


@pytest.mark.slow
def test_reads_back_as_it_was(biased, tmp_path):
    biased.save(tmp_path / "d.json")
    again = dfc.load_diagnosis(tmp_path / "d.json")
    assert again.remaining == biased.remaining
    assert again.references == biased.references


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "slug"),
    [
        (dfc.effects.InputGain(1.15), "input_gain"),
        (dfc.effects.LoadDependence(0.15), "load_dependence"),
    ],
)
def test_one_cause_is_found_before_three_wrong_base_parameters(effect, slug):
    with among(*RIVALS):
        search = Search(AXIS, [noisy(AXIS.replace(effects=(effect,)), 3)])
        assert forward(search, most=1).causes == [slug]


@pytest.mark.slow
@pytest.mark.parametrize("slug", ["load_dependence", "input_gain"])
def test_the_same_on_records_of_the_bench(slug):
    case = truth.make_case(slug, 0, "noisy")
    with among(*RIVALS):
        assert forward(Search(believed(case), [record(case)]), most=1).causes == [slug]


@pytest.mark.slow
def test_a_limited_drive_is_no_imposed_motion():
    # A straight line foresees this record better than any axis without a limit does.
    case = truth.make_case("saturation", 12, "noisy")
    with among(*RIVALS, "saturation"):
        search = Search(believed(case), [record(case)])
        assert forward(search, most=1).causes == ["saturation"]
    assert not search.imposed


@pytest.mark.slow
@pytest.mark.parametrize("known", [(), ("mass",)])
def test_three_wrong_base_parameters_may_be_a_gain_and_two(known):
    # All forces over the gain make the motion: nothing but knowledge tells which is right.
    machine = AXIS.replace(mass=1.15 * AXIS.mass, viscous=0.8 * AXIS.viscous, coulomb=9.6)
    with among("input_gain", "stribeck"):
        d = dfc.diagnose(AXIS, noisy(machine, 7), known=known, jobs=1)
    alternatives = {c.effect: c.alternatives for c in d.causes}
    if known:
        assert not any("input_gain+" in a for one in alternatives.values() for a in one)
    else:
        assert set(alternatives) == {"inertia", "viscous", "coulomb"}
        assert {*alternatives["inertia"][0].split("+")} == {"input_gain", "viscous", "coulomb"}


@pytest.mark.slow
def test_finds_nothing_in_noise_alone():
    d = dfc.diagnose(AXIS, noisy(AXIS, 2), jobs=1)
    assert (d.verdict, d.causes) == ("nothing to find", ())
    assert d.remaining.rms == pytest.approx(0.24, rel=0.3)


@pytest.mark.slow
def test_two_records_show_what_has_changed():
    records = [noisy(AXIS, 3), noisy(AXIS.replace(coulomb=9.6), 4)]
    with among(*RIVALS):
        d = dfc.diagnose(AXIS, records, known=("mass",), jobs=1, time_limit=600.0)
    assert list(d.varies) == ["coulomb"]
    first, second = d.varies["coulomb"]["values"]
    assert second / first == pytest.approx(1.2, rel=0.02)
    assert d.others == (records[1],)
    # Each record is explained by a level of its own.
    assert d.verdict == "explained"
    assert d.causes or "explained: values that differ from record to record" in d.summary()


@pytest.mark.slow
def test_a_model_behind_a_straight_line_explains_nothing():
    # The contact gives way below breakaway: the nominal axis is stuck.
    t = DT * np.arange(4000)
    x = 4e-5 * np.sin(4.0 * t) + 1e-8 * np.random.default_rng(1).normal(size=t.size)
    with among("bias_force", "viscous_asymmetry"):
        d = dfc.diagnose(AXIS, dfc.Record(t, 4.0 * np.sin(4.0 * t), x), jobs=1)
    assert (d.verdict, d.causes) == ("unexplained", ())
    assert d.references["straight line"] < 0.0 and LINE in d.messages


@pytest.mark.slow
@pytest.mark.parametrize(
    ("slug", "condition", "seed"),
    [
        # The drive crosses its dead zone where the samples on which causes are compared are not.
        ("dead_zone", "10-bit", 2),
        # It crosses twice, and nothing in between tells it from a Coulomb level.
        ("dead_zone", "decimated", 13),
        # One breakaway comes late, by far more than all other free runs are nearer.
        ("dwell_time", "decimated", 17),
    ],
)
def test_a_cause_that_acts_rarely_is_named(slug, condition, seed):
    case = truth.make_case(slug, seed, condition)
    with among(slug, "bias_force"):
        d = dfc.diagnose(believed(case), record(case), jobs=1)
    assert (d.verdict, [c.effect for c in d.causes]) == ("explained", [slug])
    for name, value in case.truth[slug].items():
        assert d.causes[0].parameters[name] == pytest.approx(value, rel=0.05)


def test_a_muted_mass_is_out_of_reach():
    """Whatever the record, a mass stays within a factor of 4 of the nominal one."""
    problem = Likelihood(AXIS, ("mass",), [prepare(noisy(AXIS, 5, 1.0))])
    z = problem.start()
    assert problem.axis_at(z + 50.0).mass > 1e3
    far = maximise(problem, z + 50.0, 0)
    assert far.axis.mass == pytest.approx(4.0 * AXIS.mass)
    assert far.at_bound == ("mass",)


def test_three_wrong_parameters_cost_more_than_one_cause():
    problem = Likelihood(
        AXIS, ("mass", "viscous", "coulomb"), [prepare(noisy(AXIS, 5, 1.0))], wonder=True
    )
    z = problem.start()
    assert problem.prior(z) == pytest.approx(0.0)
    scaled = AXIS.replace(mass=2.0 / 1.15, viscous=15.0 / 1.15, coulomb=8.0 / 1.15)
    values = (scaled.mass, scaled.viscous, 8.0 / 1.15)
    off = [p.search(v) for p, v in zip(problem.parameters, values, strict=True)]
    assert problem.prior(np.concatenate((off, z[3:]))) > 20.0


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"known": ("masss",)}, "known: 'masss' is no base parameter"),
        ({"tolerance": {"viscous": -1.0}}, "tolerance"),
        ({"known": ("mass",), "tolerance": {"mass": 0.1}}, "mass"),
        ({"time_limit": 0.0}, "time_limit"),
    ],
)
def test_bad_knowledge_is_refused(settings, words):
    with pytest.raises(ValueError, match=words):
        dfc.diagnose(AXIS, noisy(AXIS, 5, 1.0), **settings)


@pytest.mark.parametrize(
    ("falls", "sure"),
    [
        # A drive that is limited four times, and says nothing in between.
        ([0, 0, 0, 900, -1, -1, -1, -1, 40, 2400, 0, 0, 0, -1, 300, 0, 0, 0, 0, 70], True),
        # The same in one stretch: anything may have happened there.
        ([0, 0, 0, 900, 2400, 300, 70, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1], False),
        # What others lose is no small part of what some gain.
        ([900, -700, 0, 40, -300, 2400, -800, 0, 300, -500], False),
        # Most gain, few of them by far.
        ([5, 6, -4, 7, 5, -3, 6, 900, 5, -4, 2500, 6, -4, 5, 6, -3], True),
        ([5, -6, 4, -7, 5, -3, 6, -9, 5, -4], False),
        # So much in so many places is no chance, though others lose a quarter of it.
        ([600, -80, 0, -90, 500, 2, -60, 200, -70, 0, 1, -50, 3, 0, -10], True),
        ([60, -8, 0, -9, 50, 2, -6, 20, -7, 0, 1, -5, 3, 0, -1], False),
        # A short record: what gains in six blocks without a pause is three events, in four two.
        ([0, 90, 40, 300, 30, 70, 120, -4, 0], True),
        ([0, 90, 40, 3000, 30, -4, 0, -1, -2], False),
        # A dead zone that the drive crosses twice.
        ([0, 0, -1, 28, 32, 0, -1, -3, 0, 118, 0, -1, 0, 0], True),
        ([0, 0, -1, 12, 17, 0, -1, -3, 0, 58, 0, -1, 0, 0], False),
        ([0, 0, -1, -28, 132, 0, -1, -3, 0, 318, 0, -75, 0, 0], False),
    ],
)
def test_unseen_data_speak_for_causes_that_act_now_and_then(falls, sure):
    assert HeldOut.of(np.full(len(falls), 100.0), 100.0 - np.array(falls, float)).sure is sure


@pytest.mark.parametrize(
    ("gain", "error", "louder", "sure"),
    [
        (1337.0, 722.0, 38.0, True),  # a compliance on 8 s, whose halves tell it badly
        (1337.0, 722.0, 1.3, False),
        (106.0, 36.7, 1.55, True),  # load-dependent friction beside a play, on four short logs
        (106.0, 36.7, 1.0, False),
        (1337.0, 1000.0, 38.0, False),
        (3.0, 1.0, 38.0, False),
        (3000.0, 722.0, 1.0, True),
    ],
)
def test_what_most_of_the_random_force_was_is_a_cause(gain, error, louder, sure):
    usual = gain / error if sure and louder < 2.0 else 0.0
    assert _sure(HeldOut(gain, error, 1.0, usual), louder) is sure


def test_of_causes_that_weaken_each_other_the_one_with_less_evidence_goes():
    def judged(strength, louder):
        found = HeldOut(100.0, 100.0 / strength, 0.0)
        return Judged(_sure(found, louder), found, louder=louder)

    search = SimpleNamespace(believed=AXIS)
    state = SimpleNamespace(causes=["load_dependence", "stribeck", "backlash"])
    evidence = {
        "load_dependence": judged(2.5, 1.1), "stribeck": judged(6.0, 1.1),
        "backlash": judged(1.8, 2.5),
    }  # fmt: skip
    # The play is sure for its share of the random force alone, and has less evidence.
    assert evidence["backlash"].sure and not evidence["load_dependence"].sure
    assert _weakest(search, state, evidence) == "backlash"
    evidence["backlash"] = judged(2.9, 2.5)
    assert _weakest(search, state, evidence) == "load_dependence"
    # What time did not suffice to judge, and what several parameters may replace, stays.
    evidence["backlash"] = Judged(True, HeldOut(0.0, 0.0, 0.0))
    evidence["stribeck"] = judged(1.0, 1.1)._replace(sure=True, others="inertia+viscous")
    assert _weakest(search, state, evidence) == "load_dependence"
    evidence["load_dependence"] = judged(3.5, 1.1)
    assert _weakest(search, state, evidence) is None


def test_no_records_are_refused():
    with pytest.raises(ValueError, match="list of records is empty"):
        dfc.diagnose(AXIS, [])


@pytest.mark.parametrize(("most", "rate", "alike"), [(16.0, 2.0, True), (60.0, 12.0, False)])
def test_a_load_is_a_gain_to_a_drive_that_never_brakes(most, rate, alike):
    # Slow, friction stops it before the drive turns round; fast, the drive does.
    machine = dfc.FrictionAxis(mass=2.5, viscous=18.75, coulomb=10.0)
    rng = np.random.default_rng(4)
    t = DT * np.arange(4000)
    u = most * np.sin(rate * t)
    x = np.round(machine.simulate(u, dt=DT).y[0] * 1e6) * 1e-6
    search = Search(AXIS, [dfc.Record(t, u + 0.2 * rng.standard_normal(t.size), x)])
    state = State(search.alone())
    wrong = wrong_base(search, state.fit, ("mass", "viscous", "coulomb"), state.fit.random_force())
    told = {c.effect: c.alternatives for c in or_equivalents(search, state, state.fit, wrong)}
    assert set(told) == {"inertia", "viscous", "coulomb"}
    for slug, alternatives in told.items():
        rest = {*told} - {slug}
        scales = [{*a.split("+")} - rest for a in alternatives]
        assert scales == ([{"input_gain"}, {"load_dependence"}] if alike else [{"input_gain"}])


@pytest.mark.parametrize(
    "effects",
    [
        (dfc.effects.Gravity(amplitude=3.0, phase=0.5), dfc.effects.Backlash(2e-3, 0.4)),
        (dfc.effects.BiasForce(force=1.0), dfc.effects.Compliance(3e3, 30.0, 0.4)),
        (dfc.effects.CoulombAsymmetry(force=1.0), dfc.effects.Cogging(2.0, 0.1, 0.3)),
    ],
)
@pytest.mark.parametrize("held", ["mass", "coulomb"])
def test_an_axis_with_a_load_that_moves_alike_is_known_beforehand(effects, held):
    base = {"mass": 2.5, "viscous": 18.75, "coulomb": 10.0}
    axis = dfc.FrictionAxis(**base, effects=effects)
    t = DT * np.arange(3000)
    u = 22.0 * np.sin(3.0 * t)
    search = Search(axis, [dfc.Record(t, u, axis.simulate(u, dt=DT).y[0])])
    state = State(search.alone())
    for slug in named(axis):
        state.causes.append(slug)
        state.free[slug] = own_names(slug)
    values = values_of(axis, [*base, *state.names])
    names = dict(zip([*base, *state.names], values, strict=True))
    share = [SimpleNamespace(name=n, kind="share") for n in names if n.endswith("fraction")]
    final = SimpleNamespace(
        axis=axis, values=lambda: names, problem=SimpleNamespace(parameters=share)
    )
    search.nominal = {n: 0.8 * value for n, value in base.items()}
    other = _with_a_load(search, state, final, held).axis
    assert values_of(other, [held]) == pytest.approx([0.8 * base[held]])
    moved = [one.simulate(u, dt=DT).y[0] for one in (axis, other)]
    assert np.ptp(moved[0]) > 0.05
    assert moved[1] == pytest.approx(moved[0], abs=2e-3 * np.ptp(moved[0]))


def test_no_scale_brings_a_value_of_zero_back():
    def off(effect, value):
        few = (1.0, (0.5, 2.0), (), "", "")
        return Cause(effect, effect, {"value": value}, {"value": 0.1}, {"value": ""}, *few)

    wrong = [off("inertia", 3.0), off("viscous", 12.0), off("coulomb", 0.0)]
    told = {c.effect: c.alternatives for c in or_a_gain(AXIS, wrong)}
    assert told["inertia"] == ("input_gain+viscous+coulomb",)
    assert told["coulomb"] == ()
    # An axis without viscous friction has none by whatever gain.
    bare = AXIS.replace(viscous=0.0)
    assert every(bare) == ["inertia", "coulomb"]
    told = {c.effect: c.alternatives for c in or_a_gain(bare, wrong[:2])}
    assert told == {"inertia": (), "viscous": ()}
    told = {c.effect: c.alternatives for c in or_a_gain(bare, [wrong[0], off("coulomb", 9.0)])}
    assert told == {"inertia": ("input_gain+coulomb",), "coulomb": ("input_gain+inertia",)}


@pytest.mark.parametrize(
    ("fall", "without", "ratio"),
    # Twice the innovations though a sixteenth of the force; three times the force; the same.
    [(1000.0 * np.log(2.0), 0.0625, 2.0), (0.0, 3.0, 3.0), (0.0, 1.0, 1.0)],
)
def test_what_is_put_down_to_the_readings_counts_too(fall, without, ratio):
    run = SimpleNamespace(active=np.ones(1000, bool))

    def fit(cost, force):
        return SimpleNamespace(
            point=SimpleNamespace(cost=cost),
            problem=SimpleNamespace(runs=[run]),
            random_force=lambda i: force,
        )

    assert _louder(fit(fall, without), fit(0.0, 1.0)) == pytest.approx(ratio)


def test_a_cause_that_only_single_events_confirm_is_told_from_others():
    events = [0, 0, 0, 900, -1, -1, -1, -1, 40, 2400, 0, 0, 0, -1, 300, 0, 0, 0, 0, 70]
    for falls, few in [(events, True), ([5, 6, 7, 5, 9, 6, 8, 5, 7, 6], False), ([-5, 4], False)]:
        found = HeldOut.of(np.full(len(falls), 100.0), 100.0 - np.array(falls, float))
        assert found.few_events is few
