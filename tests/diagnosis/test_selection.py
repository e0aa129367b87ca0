"""The rules by which a cause is named, kept, exchanged or dropped, one at a time."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from diagnosis_cases import believed, record
from truth import make_case

import dryfric_control as dfc
from dryfric_control.diagnosis.candidate_fits import CAUSE_COST, Race
from dryfric_control.diagnosis.candidates import BASE
from dryfric_control.diagnosis.diagnose import FIT, JUDGE, roles
from dryfric_control.diagnosis.noise_floor import Floor
from dryfric_control.diagnosis.selection import Selection, Selector, in_place
from dryfric_control.estimation.parameters import typical
from dryfric_control.estimation.problem import BASE_COST, BASE_SPREAD
from dryfric_control.estimation.windows import cut

SPRING = ("spring.stiffness", "spring.rest")
DRAG = ("quadratic_drag.drag",)


def selector_of(axis, measured):
    bench = cut(measured)
    part = roles(bench)
    race = Race(bench, axis, part == FIT, part == JUDGE, typical([measured]), jobs=1)
    return Selector(race, axis, lambda word: None)


@pytest.fixture(scope="module")
def sprung():
    """A search on a record with a hidden spring, before it begins."""
    case = make_case("spring", 0, "exact")
    return selector_of(believed(case), record(case)[:8000])


@pytest.fixture(scope="module")
def ideal(sprung):
    """A floor of nothing: scores are what they are above it."""
    return Floor(np.zeros((2, len(sprung.bench))), np.zeros((2, len(sprung.known))))


@pytest.fixture(scope="module")
def quiet(ideal):
    """A floor so high that no window is out of line."""
    return Floor(ideal.scores + 9.0, ideal.squares)


def spread(selector, values):
    """Scores of all windows: `values` in turn on those that judge, zero elsewhere."""
    scores = np.zeros(len(selector.bench))
    places = np.flatnonzero(selector.race.judge)
    scores[places] = np.resize(values, places.size)
    return scores


def single(selector, of, value, count):
    """Scores with `value` in the first `count` windows of a kind, zero elsewhere."""
    scores = np.zeros(len(selector.bench))
    scores[np.flatnonzero(getattr(selector.race, of))[:count]] = value
    return scores


def fitted(selector, *effects, free=()):
    """The fit of the believed axis with effects in it."""
    return selector.race.alone(selector.axis.replace(effects=effects), free)


# -- scores -------------------------------------------------------------------------------------


def test_a_gain_has_the_error_of_its_blocks(sprung):
    judge = np.flatnonzero(sprung.race.judge)
    before = np.zeros(len(sprung.bench))
    labels = sprung.labels[judge]
    blocks = np.unique(labels)
    before[judge] = 1.0 + np.searchsorted(blocks, labels)
    mean, error = sprung.gain(before, np.zeros_like(before))
    assert blocks.size > 2
    values = [1.0 + np.flatnonzero(blocks == label)[0] for label in labels]
    assert mean == pytest.approx(np.mean(values))
    # Blocks of unequal size: what each holds above the mean, over the mean size.
    above = [sum(v - mean for v, of in zip(values, labels, strict=True) if of == b) for b in blocks]
    above = np.array(above) / (len(values) / blocks.size)
    assert error == pytest.approx(np.std(above, ddof=1) / np.sqrt(blocks.size))
    # Windows that do not judge have no say.
    elsewhere = np.where(sprung.race.judge, 0.0, 9.0)
    assert sprung.gain(elsewhere, 0.0 * elsewhere) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("values", "better"),
    [
        ([0.5], True),  # everywhere
        ([0.029], False),  # too little to be worth a word
        ([0.031], True),
        ([0.9, -0.8], False),  # as often worse as better
    ],
)
def test_a_fall_of_the_scores_must_be_sure_and_worth_it(sprung, quiet, values, better):
    fall = spread(sprung, values)
    assert sprung.better(fall, np.zeros_like(fall), quiet) is better


def test_what_is_rare_must_win_twice_and_cost_nowhere(sprung, quiet):
    none = np.zeros(len(sprung.bench))
    count = int(sprung.race.judge.sum())
    once, twice = (single(sprung, "judge", 0.05 * count, n) for n in (1, 2))
    assert not sprung.better(once, none, quiet)
    assert sprung.better(twice, none, quiet)
    last = np.flatnonzero(sprung.race.judge)[-1]
    lost = none.copy()
    lost[last] = 0.05 * count  # a third of what is won is the limit
    assert not sprung.better(twice, lost, quiet)


def test_a_small_part_of_a_large_error_names_nothing(sprung, ideal):
    large = spread(sprung, [10.0])
    assert not sprung.better(large, large - spread(sprung, [0.4]), ideal)
    assert sprung.better(large, large - spread(sprung, [0.6]), ideal)


def test_windows_that_fall_into_line_name_a_cause(sprung, ideal):
    none = np.zeros(len(sprung.bench))
    bad = single(sprung, "judge", 2.0, 1) + single(sprung, "fit", 2.0, 2)
    assert sprung.rids(bad, none, ideal)
    assert not sprung.rids(
        single(sprung, "judge", 2.0, 1) + single(sprung, "fit", 2.0, 1), none, ideal
    )
    assert not sprung.rids(single(sprung, "fit", 2.0, 3), none, ideal)  # none that judges
    assert not sprung.rids(bad, single(sprung, "judge", 2.0, 1), ideal)  # that one stays
    # A third of them may stay, if it is not among those that judge.
    many = single(sprung, "judge", 2.0, 2) + single(sprung, "fit", 2.0, 4)
    assert sprung.rids(many, single(sprung, "fit", 2.0, 2), ideal)
    assert not sprung.rids(many, single(sprung, "fit", 2.0, 3), ideal)
    # Below the line nothing falls into it.
    assert not sprung.rids(0.45 * bad, none, ideal)


def test_when_nothing_is_left_to_name(sprung, ideal):
    none = np.zeros(len(sprung.bench))
    assert sprung.nothing_left(none, ideal)
    assert sprung.nothing_left(single(sprung, "fit", 2.0, 2), ideal)
    assert not sprung.nothing_left(single(sprung, "fit", 2.0, 3), ideal)
    assert sprung.nothing_left(single(sprung, "judge", 2.0, 1), ideal)
    assert not sprung.nothing_left(single(sprung, "judge", 2.0, 2), ideal)
    assert sprung.nothing_left(none + 0.049, ideal)
    assert not sprung.nothing_left(none + 0.051, ideal)


def test_scores_tie_within_little_or_within_their_error(sprung, ideal):
    none = np.zeros(len(sprung.bench))
    assert sprung.ties(spread(sprung, [0.029]), none, ideal)
    assert not sprung.ties(spread(sprung, [0.031]), none, ideal)
    # Two in a hundred of what the best leaves.
    best = spread(sprung, [0.9])  # still in line
    assert sprung.ties(best * 1.019, best, Floor(ideal.scores - 4.0, ideal.squares))
    rough = spread(sprung, [0.9, -0.78])
    mean, error = sprung.gain(rough, none)
    assert 0.03 < mean < 2.0 * error and mean < 0.1
    assert sprung.ties(rough, none, ideal)
    rougher = spread(sprung, [0.9, -0.6])  # not sure either, but too much to shrug off
    mean, error = sprung.gain(rougher, none)
    assert 0.1 < mean < 2.0 * error
    assert not sprung.ties(rougher, none, ideal)
    sure = spread(sprung, [0.2, -0.04])  # small, but three times its error
    mean, error = sprung.gain(sure, none)
    assert 2.0 * error < mean < min(4.0 * error, 0.1)
    assert not sprung.ties(sure, none, ideal)
    # One that leaves windows out of line does not tie with one that mends them.
    bad = single(sprung, "judge", 1.1, 1) + single(sprung, "fit", 1.1, 2)
    assert not sprung.ties(bad, none, ideal)


def test_excess_is_what_judges_above_the_floor(sprung, ideal):
    floor = Floor(ideal.scores + 0.25, ideal.squares)
    assert sprung.excess(spread(sprung, [1.0]), floor) == pytest.approx(0.75)


# -- assumptions --------------------------------------------------------------------------------


def test_a_wrong_base_parameter_costs_less_than_a_cause(sprung):
    plain = fitted(sprung)
    values = plain.hypothesis.values(plain.z)
    expected = sum(
        min(
            BASE_COST * np.log1p(((values[n] / b - 1.0) / BASE_SPREAD) ** 2),
            0.8 * CAUSE_COST,
        )
        for n, b in sprung.race.believed.items()
    )
    assert sprung.cost(plain, 0) == pytest.approx(expected)
    assert sprung.cost(plain, 2) == pytest.approx(expected + 2.0 * CAUSE_COST)
    assert 0.0 < expected < 3 * 0.8 * CAUSE_COST + 1e-9
    held = sprung.race.alone(sprung.axis, (), base=())
    assert sprung.cost(held, 1) == CAUSE_COST


def test_changes_of_base_parameters_are_relative_to_what_was_believed(sprung):
    plain = fitted(sprung)
    values = plain.hypothesis.values(plain.z)
    for name, was in sprung.race.believed.items():
        assert sprung.change(plain, name) == pytest.approx(abs(values[name] / was - 1.0))
    changes = {n: sprung.change(plain, n) for n in sprung.race.believed}
    assert max(changes.values()) > 0.004  # the spring bends one of them
    assert sprung.wrong(plain, list(changes)) == [n for n, c in changes.items() if c > 0.004]
    assert sprung.wrong(plain, []) == []
    back = sprung.hold(plain.axis, ["mass"])
    assert back.mass == sprung.axis.mass and back.viscous == plain.axis.viscous


# -- the choice ---------------------------------------------------------------------------------


def runner(scores, assumes=0.0, slug=""):
    """What the choice looks at in a fit; `assumes` is what it costs beside its causes."""
    return SimpleNamespace(scores=np.asarray(scores), assumes=assumes, slug=slug, loss=assumes)


@pytest.fixture
def judge(sprung, monkeypatch):
    """The choice among runners, each with a plain cost; the first that is level wins."""
    selector = Selector(sprung.race, sprung.axis, lambda word: None)
    monkeypatch.setattr(selector, "cost", lambda r, causes: CAUSE_COST * causes + r.assumes)
    monkeypatch.setattr(selector, "_plainest", lambda level, causes, floor: level[0])
    return selector


def test_of_those_level_only_the_plain_are_rivals(judge, quiet):
    current = runner(spread(judge, [0.8]))
    best, tied, bold = (
        runner(spread(judge, [v]), a) for v, a in ((0.1, 0.0), (0.11, 3.9), (0.1, 4.1))
    )
    behind = runner(spread(judge, [0.3]))
    winner, rivals = judge._choose([best, tied, bold, behind], current, quiet, 0)
    assert winner is best and rivals == [tied]
    assert judge._choose([behind], current, quiet, 2) == (behind, [])


def test_a_rival_does_something_or_assumes_less(judge, quiet):
    current = runner(spread(judge, [0.8, 0.1]), assumes=2.0 * CAUSE_COST)
    best = runner(spread(judge, [0.1]), assumes=2.0 * CAUSE_COST)
    scores = spread(judge, [0.8, 0.1])
    assert judge.better(current.scores, best.scores, quiet)
    idle, cheap = runner(scores, 1.5 * CAUSE_COST), runner(scores, 0.5 * CAUSE_COST)
    judge.ties = lambda one, other, floor: one is not current.scores
    assert judge._choose([best, idle, cheap], current, quiet, 1) == (best, [cheap])


def test_where_the_fit_without_is_as_good_a_cause_must_earn_its_name(judge, quiet):
    scores = spread(judge, [0.1])
    bent = runner(scores, assumes=2.5 * CAUSE_COST)
    plain, dear = runner(scores, 0.0), runner(scores, 2.0 * CAUSE_COST)
    # Everything here is at the floor, where any saving counts.
    assert judge._choose([plain, dear], bent, quiet, 1) == (plain, [])
    assert judge._choose([dear], bent, quiet, 1) == (None, [])
    assert judge._choose([plain], runner(scores, 0.9 * CAUSE_COST), quiet, 1)[0] is None


def likeliest(sprung, runs, on_all, floor, costs=None):
    """The plainest of runs, whose fits on all windows have the scores `on_all`."""
    selector = Selector(sprung.race, sprung.axis, lambda word: None)
    selector.cost = lambda r, causes: (costs or {}).get(r.slug, 0.0)
    for run in runs:
        run.hypothesis, run.axis = SimpleNamespace(names=["mass", f"{run.slug}.x"]), run.slug
    asked = []

    def alone(axis, own, slug, base, active):
        asked.append((axis, tuple(own), slug, tuple(base)))
        assert active is selector.known
        return SimpleNamespace(scores=on_all[slug])

    race = sprung.race
    selector.race = SimpleNamespace(judge=race.judge, believed=race.believed, alone=alone)
    return selector._plainest(runs, 1, floor), asked


def test_the_likeliest_of_those_level_needs_no_further_look(sprung, ideal):
    none = np.zeros(len(sprung.bench))
    spring, gravity = runner(none, slug="spring"), runner(none, slug="gravity")
    best, asked = likeliest(sprung, [gravity, spring], {}, ideal, {"gravity": 5.0})
    assert best is spring and asked == []


def test_all_that_may_be_looked_at_tells_two_apart_but_no_stroke_of_luck(sprung, ideal):
    none = np.zeros(len(sprung.bench))
    spring, gravity = runner(none, slug="spring"), runner(none, slug="gravity")
    # As likely: the plainer.
    best, asked = likeliest(sprung, [gravity, spring], {"spring": none, "gravity": none}, ideal)
    assert best is spring
    assert ("gravity", ("gravity.x",), "gravity", ("mass",)) in asked and len(asked) == 2
    # Everywhere a little better: the likelier.
    rough = none + 0.05
    best, _ = likeliest(sprung, [gravity, spring], {"spring": rough, "gravity": none}, ideal)
    assert best is gravity
    # One window that only the other hits has no say.
    known = np.flatnonzero(sprung.known)
    lucky, missed = none + 0.05, none.copy()
    missed[known[3]] = 9.0
    best, _ = likeliest(sprung, [spring, gravity], {"spring": lucky, "gravity": missed}, ideal)
    assert best is gravity


# -- the passes ---------------------------------------------------------------------------------


def selection(best, **causes):
    """A selection that named causes, given as slug=names of their parameters."""
    return Selection(best, causes=list(causes), free=causes)


@pytest.fixture(scope="module")
def both(sprung):
    """The spring, and a drag that is not there."""
    case = make_case("spring", 0, "exact")
    spring = dfc.effects.Spring(stiffness=case.truth["spring"]["stiffness"], rest=0.0)
    return fitted(sprung, spring, dfc.effects.QuadraticDrag(0.1), free=(*SPRING, *DRAG))


def test_a_backward_pass_drops_what_is_superfluous(sprung, both):
    found = selection(both, quadratic_drag=DRAG, spring=SPRING)
    found.alternatives["quadratic_drag"] = ("viscous_asymmetry",)
    found.rivals["quadratic_drag"] = {}
    floor = sprung._backward(found, sprung.floor_of(both))
    assert found.causes == ["spring"]
    assert set(found.free) == {"spring"} and not found.alternatives and not found.rivals
    assert [e.slug for e in found.best.axis.effects] == ["spring"]
    # The floor is that of what is left.
    np.testing.assert_array_equal(floor.scores, sprung.floor_of(found.best).scores)
    assert floor.reached(found.best.scores, sprung.known)


def test_an_earlier_fit_without_a_cause_counts_if_it_ended_lower(sprung, both):
    less = sprung.race.alone(sprung.without(both.axis, "quadratic_drag"), SPRING)
    worse = selection(both, quadratic_drag=DRAG, spring=SPRING)
    bad = fitted(sprung)
    worse.earlier[frozenset(["spring"])] = bad
    assert bad.loss > less.loss
    sprung._backward(worse, sprung.floor_of(both))
    assert worse.best.loss == less.loss
    lower = selection(both, quadratic_drag=DRAG, spring=SPRING)
    good = replace(less, loss=less.loss - 1.0)
    lower.earlier[frozenset(["spring"])] = good
    sprung._backward(lower, sprung.floor_of(both))
    assert lower.best is good


def test_a_cause_without_support_is_refuted_and_remembered(sprung, both):
    fresh = Selector(sprung.race, sprung.axis, lambda word: None)
    real = selection(both, spring=SPRING)
    best = fresh.race.alone(fresh.without(both.axis, "quadratic_drag"), SPRING)
    real.best = best
    floor = fresh.floor_of(best)
    assert not fresh.refutes(real, best, [], floor) and fresh.refuted == set()
    false = selection(both, quadratic_drag=DRAG, spring=SPRING)
    assert fresh.refutes(false, both, list(BASE.values()), floor)
    assert fresh.refuted == {"quadratic_drag"}


def test_base_parameters_that_nothing_speaks_for_go_back(sprung, both):
    found = selection(both, quadratic_drag=DRAG, spring=SPRING)
    sprung._backward(found, sprung.floor_of(both))
    best, kept = sprung.base(found, sprung.floor_of(found.best))
    assert kept == []  # all three were believed right, and are
    assert best.axis.mass == sprung.axis.mass and best.axis.viscous == sprung.axis.viscous


def test_a_wrong_mass_is_kept_and_nothing_else():
    case = make_case("inertia", 0, "exact")
    selector = selector_of(believed(case), record(case)[:8000])
    best = fitted(selector)
    found = Selection(best)
    best, kept = selector.base(found, selector.floor_of(best))
    assert kept == ["mass"] and selector.wrong(best, kept) == ["mass"]


def test_a_gain_that_leaves_base_parameters_far_off_is_named_as_these(both):
    # All forces over the gain make the motion: that the base is wrong is certain then.
    t = 1e-3 * np.arange(8000)
    u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
    nominal = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    for machine, far in (((1.8, 13.5, 9.6), True), ((1.8, 13.5, 7.2), False)):
        axis = dfc.FrictionAxis(mass=machine[0], viscous=machine[1], coulomb=machine[2])
        measured = dfc.Record(t, u, 1e-6 * np.round(axis.simulate(u, 1e-3).y[0] * 1e6))
        selector = selector_of(nominal, measured)
        kept = ["coulomb"] if far else []
        gain = nominal.replace(effects=(dfc.effects.InputGain(gain=1.1),))
        names = ("input_gain.gain",)
        best = selector.race.alone(gain, names, base=kept)
        found = selection(best, input_gain=names)
        ended, base = selector.without_a_gain(found, best, kept, selector.floor_of(best))
        assert (found.causes == []) is far and base == (list(BASE.values()) if far else [])
        if far:
            values = ended.hypothesis.values(ended.z)
            assert [values[n] for n in base] == pytest.approx(machine, rel=1e-3)
        # What is known of the axis tells.
        selector.race.known = ("mass",)
        found = selection(best, input_gain=names)
        assert selector.without_a_gain(found, best, kept, None) == (best, kept)


def exchanged(selector, both, effect, names):
    """What becomes of a cause beside a drag when the spring is its alternative."""
    stand_in = fitted(selector, effect, dfc.effects.QuadraticDrag(0.1), free=(*names, *DRAG))
    # As after a backward pass: the fit is one that another cause was taken from.
    stand_in = replace(stand_in, slug="")
    found = selection(stand_in, **{effect.slug: names, "quadratic_drag": DRAG})
    found.rivals = {effect.slug: {"spring": both.axis, "quadratic_drag": both.axis}}
    found.alternatives = {effect.slug: ("spring",)}
    floor = selector._swap(found, selector.floor_of(stand_in))
    np.testing.assert_array_equal(floor.scores, selector.floor_of(found.best).scores)
    assert found.causes[1] == "quadratic_drag" and found.free["quadratic_drag"] == DRAG
    return found, stand_in


def test_a_rival_takes_the_place_of_a_cause_that_fits_worse(sprung, both):
    """Once the other cause is known, the spring in the place of what stood in for it."""
    found, stand_in = exchanged(sprung, both, dfc.effects.BiasForce(0.1), ("bias_force.force",))
    judge = sprung.race.judge
    assert both.scores[judge].mean() < stand_in.scores[judge].mean() - 0.03
    assert found.causes[0] == "spring" and found.free["spring"] == SPRING
    assert "bias_force" not in found.free
    assert found.alternatives["spring"] == () and found.rivals["spring"] == {}
    assert {e.slug for e in found.best.axis.effects} == {"spring", "quadratic_drag"}


def test_a_rival_that_fits_as_well_stays_an_alternative(sprung, both):
    """A spring and gravity are the same over a short way: the plainer is named."""
    gravity = dfc.effects.Gravity(amplitude=0.1, phase=0.0)
    found, _ = exchanged(sprung, both, gravity, ("gravity.amplitude", "gravity.phase"))
    other = {"spring": "gravity", "gravity": "spring"}[found.causes[0]]
    assert found.alternatives[found.causes[0]] == (other,)
    assert {e.slug for e in found.rivals[found.causes[0]][other].effects} == {
        other, "quadratic_drag",
    }  # fmt: skip


def test_every_fit_that_is_weighed_bears_the_name_of_its_cause(sprung, both, monkeypatch):
    """The rank of its effect decides, also for a fit that another cause was taken from."""
    weighed = []
    rule = Selector._plainest

    def watched(self, level, *rest):
        weighed.extend(r.slug for r in level)
        return rule(self, level, *rest)

    monkeypatch.setattr(Selector, "_plainest", watched)
    gravity = dfc.effects.Gravity(amplitude=0.1, phase=0.0)
    exchanged(sprung, both, gravity, ("gravity.amplitude", "gravity.phase"))
    assert set(weighed) == {"gravity", "spring"}


def test_the_axis_without_a_cause_is_as_believed(sprung, both):
    spring = both.axis.effects[0]
    assert sprung.without(both.axis, "quadratic_drag").effects == (spring,)
    had = sprung.axis.replace(
        effects=(dfc.effects.Spring(1.0, 0.0),), stribeck=dfc.Stribeck(0.2, 0.01)
    )
    selector = Selector(sprung.race, had, lambda word: None)
    # It keeps its place among the others.
    assert selector.without(both.axis, "spring").effects[0] == dfc.effects.Spring(1.0, 0.0)
    assert selector.without(both.axis, "stribeck").stribeck == dfc.Stribeck(0.2, 0.01)


def test_an_alternative_brings_the_base_that_goes_with_it(sprung):
    rival = sprung.axis.replace(
        mass=9.0, viscous=8.0, coulomb=7.0, effects=(dfc.effects.BiasForce(1.0),)
    )
    axis = sprung.axis.replace(effects=(dfc.effects.BiasForce(3.0), dfc.effects.Spring(1.0, 0.0)))
    there = in_place(axis, rival, "bias_force")
    assert there.mass == 9.0 and there.viscous == 8.0 and there.coulomb == rival.coulomb
    assert there.effects == (dfc.effects.BiasForce(1.0), dfc.effects.Spring(1.0, 0.0))
    peaked = rival.replace(stribeck=dfc.Stribeck(0.4, 0.02))
    assert in_place(axis, peaked, "stribeck").stribeck == dfc.Stribeck(0.4, 0.02)
    assert in_place(axis, peaked, "stribeck").effects == axis.effects


@pytest.mark.slow
def test_a_cause_at_a_place_where_nothing_has_been_is_not_judged(sprung):
    def at(rest):
        values = {"mass": 2.0, "spring.stiffness": 1.0, "spring.rest": rest}
        hypothesis = SimpleNamespace(names=[*values], values=lambda z: values)
        return SimpleNamespace(slug="spring", hypothesis=hypothesis, z=None)

    middle = float(sprung.bench.record.x.mean())
    assert sprung._placed("spring", at(middle), SPRING)
    assert not sprung._placed("spring", at(50.0), SPRING)


@pytest.mark.slow
def test_a_cause_that_has_left_the_travel_is_refuted(sprung, both):
    fresh = Selector(sprung.race, sprung.axis, lambda word: None)
    fresh.standard_errors = lambda best: dict.fromkeys(SPRING, 0.0)
    values = {**both.hypothesis.values(both.z), "spring.rest": 50.0}
    gone = SimpleNamespace(hypothesis=SimpleNamespace(values=lambda z: values), z=None)
    assert fresh.refutes(selection(both, spring=SPRING), gone, [], None)
    assert fresh.refuted == {"spring"}


@pytest.mark.parametrize(
    ("slug", "errors", "expected"),
    [
        ("warm_up", (0.011, 380.0), False),
        ("warm_up", (0.002, 380.0), True),
        ("dwell_time", (1.0, 1.0), True),  # acts only at breakaway: its gain alone decides
    ],
)
def test_a_cause_of_which_nothing_is_determined_is_none(sprung, slug, errors, expected):
    names = [f"{slug}.rise", f"{slug}.time_constant"]
    values = dict(zip(names, (0.005, 4.0), strict=True))
    fitted = SimpleNamespace(hypothesis=SimpleNamespace(values=lambda z: values), z=None)
    found = sprung._determined(slug, fitted, names, dict(zip(names, errors, strict=True)))
    assert found is expected


@pytest.mark.slow
def test_a_refuted_cause_goes_where_no_search_takes_its_place(sprung, both):
    fresh = Selector(sprung.race, sprung.axis, lambda word: None)
    found = selection(both, quadratic_drag=DRAG, spring=SPRING)
    fresh.refuted.add("quadratic_drag")
    floor = fresh.without_refuted(found)
    assert found.causes == ["spring"]
    assert [e.slug for e in found.best.axis.effects] == ["spring"]
    np.testing.assert_array_equal(floor.scores, fresh.floor_of(found.best).scores)


def test_a_search_finds_the_spring_and_stops(sprung):
    words = []
    selector = Selector(sprung.race, sprung.axis, words.append)
    found, floor = selector.run()
    assert found.causes == ["spring"] and floor.reached(found.best.scores, selector.known)
    assert found.first[""] > found.first["spring"] and len(found.first) > 15
    assert words[:2] == ["base parameters", "cause 1"] and "cause 2" not in words
    # What the search went on from is kept for the backward pass.
    assert found.earlier[frozenset()].loss > found.best.loss
    # Asked all the same, it has no more to name.
    assert selector._step(found, floor) is None and found.causes == ["spring"]


class Hasty(Selector):
    """A search whose only step names two causes at once."""

    named = None

    def _step(self, found, floor):
        if found.causes:
            return None
        best, found.causes, found.free, found.rivals = self.named
        return best


def test_a_search_ends_with_a_backward_pass(sprung, both):
    hasty = Hasty(sprung.race, sprung.axis, lambda word: None)
    free = {"quadratic_drag": DRAG, "spring": SPRING}
    hasty.named = (both, ["quadratic_drag", "spring"], free, {})
    found, floor = hasty.run()
    assert found.causes == ["spring"] and floor.reached(found.best.scores, hasty.known)


def test_a_search_ends_by_weighing_the_alternatives(sprung, both):
    hasty = Hasty(sprung.race, sprung.axis, lambda word: None)
    hasty._backward = lambda found, floor: floor
    free = {"bias_force": ("bias_force.force",), "quadratic_drag": DRAG}
    names = [n for own in free.values() for n in own]
    stand_in = fitted(
        sprung, dfc.effects.BiasForce(0.1), dfc.effects.QuadraticDrag(0.1), free=names
    )
    hasty.named = (stand_in, [*free], free, {"bias_force": {"spring": both.axis}})
    found, floor = hasty.run()
    assert found.causes == ["spring", "quadratic_drag"]
    assert floor.reached(found.best.scores, hasty.known)
