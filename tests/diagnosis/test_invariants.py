"""What an answer must keep, whatever the nominal values, the samples, the names and the order.

Round-off chooses nothing: a record off by 1e-12 of its range, or one whose numbers were summed in
another order, differs by less than anything that it resolves, and is told the same.
"""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from diagnosis_cases import among, believed, causes, driven, foreign, record
from truth import make_case

import dryfric_control as dfc
from dryfric_control.diagnosis import search as search_module
from dryfric_control.diagnosis.diagnose import _Answer
from dryfric_control.diagnosis.problem import Problem
from dryfric_control.estimation.windows import cut
from dryfric_control.identification import slow_ramp_experiment
from dryfric_control.identification.stribeck import stick_phases
from dryfric_control.model.effects.effect import REGISTRY
from dryfric_control.records.motion import directions
from dryfric_control.ties import NEAR, exceeds, samples, stable_order

BASE = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, travel=(-1.0, 1.0))
SLIPPING = BASE.replace(travel=(0.0, 0.1), stribeck=dfc.Stribeck(excess=0.3, speed=0.01))
BIAS = dfc.effects.BiasForce(force=2.0)
CHANGES = ("noise", "thirds", "tenths")


def changed(record, how):
    """The record off by less than it resolves."""
    rng = np.random.default_rng(3)
    change = {
        "noise": lambda v: v + 1e-12 * np.ptp(v) * rng.standard_normal(v.size),
        "thirds": lambda v: v * (1.0 / 3.0) * 3.0,
        "tenths": lambda v: sum([v * 0.1] * 10),
    }[how]
    u, x = change(record.u), change(record.x)
    assert not np.array_equal(x, record.x)
    return dfc.Record(record.t, u, x, record.reference)


@cache
def run(*effects):
    return driven(BASE.replace(effects=effects))


@cache
def crawl():
    ramp = slow_ramp_experiment(SLIPPING, duration=20.0, quantum=1e-6).record
    return dfc.Record(ramp.t, ramp.u, ramp.x, ramp.reference)


def test_equal_numbers_keep_their_order_and_others_are_sorted():
    rng = np.random.default_rng(0)
    values = np.repeat(rng.permutation(20) + 1.0, 3) * (1.0 + 1e-14 * rng.standard_normal(60))
    expected = np.argsort(np.round(values), kind="stable")
    assert stable_order(values) == expected.tolist()
    assert stable_order([np.nan, np.inf, 1.0, -np.inf]) == [3, 2, 0, 1]
    assert stable_order([0.0, -0.5e-6], 1e-6) == [0, 1]
    assert stable_order([0.0, -2.0e-6], 1e-6) == [1, 0]
    assert stable_order([]) == []


def test_only_what_exceeds_round_off_is_above():
    assert exceeds([0.3 * (1.0 + 1e-15), 0.3 * (1.0 + 3.0 * NEAR)], 0.3).tolist() == [False, True]
    assert exceeds([1e-300, -1.0], 0.0).tolist() == [True, False]


@pytest.mark.parametrize("dt", [0.004, 0.02, 0.1 / 3.0, 1e-3, 0.25 / 7.5])
def test_whole_samples_do_not_depend_on_the_last_digit_of_the_step(dt):
    whole = samples(0.25, dt)
    assert abs(whole * dt - 0.25) <= 0.5 * dt * (1.0 + 1e-9)
    assert {samples(0.25, dt * (1.0 + k * 2e-16)) for k in range(-5, 6)} == {whole}


@pytest.mark.parametrize("how", CHANGES)
def test_what_moves_and_where_windows_lie_is_the_same(how):
    record = crawl()
    other = changed(record, how)
    assert np.array_equal(directions(record), directions(other))
    for window in (0.25, 0.0625, 0.0125):
        one, two = cut(record, window), cut(other, window)
        assert np.array_equal(one.edges, two.edges)
        assert np.array_equal(one.rest >= 0.05, two.rest >= 0.05)
    sticks, again = stick_phases(record), stick_phases(other)
    assert sticks.end.size > 3
    assert np.array_equal(sticks.begin, again.begin) and np.array_equal(sticks.end, again.end)


def test_an_exact_rest_is_no_motion():
    # Most of it at rest, without an encoder: neither quantum nor noise bounds a motion.
    t = 1e-3 * np.arange(4000)
    x = 0.1 * np.clip(t - 3.0, 0.0, 0.5)
    moving = directions(dfc.Record(t, np.cos(t), x, quantum=0.0))
    assert not moving[:2900].any() and not moving[3600:].any() and np.all(moving[3100:3400] == 1)


@pytest.mark.parametrize(
    ("how", "quantum", "known"),
    [*((h, 1e-6, True) for h in CHANGES), ("noise", 0.0, True), ("thirds", 0.0, False)],
)
def test_degrees_are_the_same(how, quantum, known):
    axis, record = ramp(quantum)
    for one in (record, changed(record, how)):
        assert dfc.identify_coulomb(one, axis=axis if known else None).degrees == (1, 0)


@cache
def ramp(quantum):
    axis = BASE.replace(travel=(0.0, 0.3), coulomb=dfc.CoulombMap([8.0, 10.0], 7.0))
    return axis, slow_ramp_experiment(axis, quantum=quantum).record


def test_a_fit_ends_in_the_same_place():
    off, names = BASE.replace(mass=3.0, coulomb=5.0), ("mass", "viscous", "coulomb")
    one, two = (dfc.fit(off, record, names) for record in (run(), changed(run(), "noise")))
    assert two.parameters == pytest.approx(one.parameters, rel=1e-6)
    assert two.messages == one.messages


@pytest.mark.parametrize("how", ["noise", "thirds"])
def test_the_next_experiment_is_the_same(how):
    bias = BASE.replace(effects=(BIAS,))
    rivals = [
        BASE.replace(effects=(dfc.effects.Spring(stiffness=10.0, rest=0.2),)),
        BASE.replace(effects=(dfc.effects.CoulombAsymmetry(force=-2.0),)),
    ]
    records = run(BIAS), changed(run(BIAS), how)
    one, two = (dfc.next_experiment(bias, rivals, record) for record in records)
    assert (one.name, one.separates) == (two.name, two.separates)
    assert list(one.tried) == list(two.tried)
    assert np.allclose(one.reference, two.reference, rtol=0.0, atol=1e-6 * np.ptp(one.reference))


# -- whole diagnoses ---------------------------------------------------------------------

# A cause of each kind: one way, over position, over velocity, in the drive, none.
HIDDEN = ("bias_force", "position_dependence", "quadratic_drag", "actuator_lag", ())
CANDIDATES = (
    "bias_force", "coulomb_asymmetry", "position_dependence", "spring", "quadratic_drag",
    "stribeck", "input_delay", "actuator_lag",
)  # fmt: skip


@cache
def case_of(slug):
    return make_case(slug, 3, "short")


def asked(axis, measured, jobs=1, candidates=CANDIDATES):
    with among(*candidates):
        return dfc.diagnose(axis, measured, jobs=jobs, progress=False)


@cache
def plain(slug):
    return asked(believed(case_of(slug)), record(case_of(slug)))


def nominal(axis, measured):
    return axis.replace(mass=1.1 * axis.mass, viscous=0.9 * axis.viscous), measured


def shorter(axis, measured):
    return axis, dfc.Record(measured.t[:-1], measured.u[:-1], measured.x[:-1])


def rounded(axis, measured):
    return axis, changed(measured, "noise")


@pytest.mark.slow
@pytest.mark.parametrize("slug", HIDDEN, ids=str)
@pytest.mark.parametrize("change", [nominal, shorter, rounded])
def test_the_answer_is_the_same(change, slug):
    right = plain(slug)
    found = asked(*change(believed(case_of(slug)), record(case_of(slug))))
    new, old = (sorted(foreign([c.effect for c in one.main_causes])) for one in (found, right))
    assert new == old, str(found)
    assert found.verdict in ("explained", "nothing to find")
    if change is not nominal:
        assert (found.verdict, causes(found)) == (right.verdict, causes(right))
    if change is rounded:
        for first, second in zip(right.causes, found.causes, strict=True):
            assert first.alternatives == second.alternatives
            for parameter, error in first.standard_errors.items():
                # Where the cost is rough, a search ends within a standard error of the minimum.
                there = (second.parameters[parameter] - first.parameters[parameter]) / error
                assert abs(there) < 1.0


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_two_calls_agree_and_so_do_one_and_two_jobs(jobs):
    case, first, known = case_of("bias_force"), plain("bias_force"), dict(REGISTRY)
    axis, measured = believed(case), record(case)
    assert asked(axis, measured, jobs).to_json() == first.to_json()
    assert known == REGISTRY and axis == believed(case)


@pytest.mark.slow
def test_the_answer_hangs_on_no_name_and_no_order():
    case = make_case("bias_force", 0, "short")
    rivals = "bias_force coulomb_asymmetry spring quadratic_drag stribeck input_gain".split()
    right = asked(believed(case), record(case), candidates=rivals)
    told = dfc.Record(case.t, case.u, case.x, name="spring")
    classes = dict(REGISTRY)
    REGISTRY.clear()  # until the end of the test
    REGISTRY.update((slug, classes[slug]) for slug in sorted(classes)[::-1])
    found = asked(believed(case).replace(name="spring"), told, candidates=rivals)
    assert causes(found) == causes(right)
    # The order in which candidates are fitted leaves no trace in the numbers.
    assert found.causes[0].parameters == right.causes[0].parameters


def test_a_model_that_explains_nothing_states_no_lead_of_the_input():
    answer = _Answer(
        SimpleNamespace(problem=Problem(BASE, (), shift=-4e-3)), None, (), ["shifted"], ["late"],
        0.25, print, 0.0, [], lead="4 ms", stamped=(["as recorded"], ["in time"]),
    )  # fmt: skip
    answer._withdraw_lead()
    assert (answer.records, answer.windows, answer.lead) == (["as recorded"], ["in time"], "")
    assert answer.problem.shift is None


@pytest.mark.parametrize(
    ("slug", "bound", "reported"),
    [("coulomb", (), True), ("coulomb", ("mass",), False), ("inertia", ("mass",), True)],
)
def test_no_cause_is_named_beside_a_mass_that_no_one_would_name(slug, bound, reported):
    """It ended at its bound to make up for what is missing: the forces of causes follow it."""
    answer = SimpleNamespace(
        causes=[SimpleNamespace(effect=slug, title=slug)], messages=[],
        found=SimpleNamespace(left=SimpleNamespace(significant=False, fraction=0.0)),
        problem=SimpleNamespace(believed=BASE),
    )  # fmt: skip
    fit = SimpleNamespace(
        at_bound=bound, axis=BASE.replace(mass=8.0), gradients=np.zeros((1, 1)) + 30.0,
        z=np.zeros(1), problem=SimpleNamespace(names=("mass",)),
    )  # fmt: skip
    assert _Answer._reject_causes(answer, [], fit) is not reported
    assert reported or "4 times its nominal value" in answer.messages[0]


@pytest.mark.parametrize(
    ("name", "fall", "kept"),
    [
        ("compliance", -0.10, False),
        ("compliance", 0.01, False),  # less than a fall that shows
        ("compliance", 0.10, True),
        ("dwell_time", -0.10, False),
        ("dwell_time", -0.01, True),  # the filter has no other states beside it
        ("stribeck", -0.10, True),  # which the force alone shows
    ],
)
def test_a_memory_that_free_runs_do_not_show_is_no_cause(monkeypatch, name, fall, kept):
    """A coarse record with a Stribeck peak: likelier by 333 with a compliance, and 20 times off."""
    monkeypatch.setattr(search_module, "in_free_runs", lambda problem, less, more: (fall, 0.01))
    monkeypatch.setattr(search_module, "nominal_error_costs", lambda fit: np.zeros(1))
    search = search_module.Search(problem=SimpleNamespace(is_imposed=False))
    search.weigh_causes = search._remove_implausible = lambda model: model
    bare = search_module.Model(SimpleNamespace())
    worth = {name: 333.0}
    model = search_module.Model(SimpleNamespace(), (name,), worth, less={name: bare})
    assert search.eliminate_causes(model) is (model if kept else bare)
