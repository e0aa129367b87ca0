"""Blind tests of the diagnosis: the hidden cause is found from (t, u, x) alone.

The records come from the bench of tests/truth, which shares no code with the
package.  benchmarks/diagnosis.py runs hundreds of them; here is a subset, with
the proof that it would catch a diagnosis that cheats.
"""

import importlib
import json
import sys
from contextlib import contextmanager
from dataclasses import dataclass, make_dataclass, replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from diagnosis_cases import believed, foreign, named_right, parameter_errors, record
from truth import Plant, closed_loop, make_case, make_null, make_outside, make_pair

import dryfric_control as dfc
from dryfric_control.diagnosis import selection
from dryfric_control.diagnosis.diagnose import diagnose
from dryfric_control.model.effects.effect import REGISTRY

# The package exports the function under the module's own name.
module = importlib.import_module("dryfric_control.diagnosis.diagnose")

DT = 1e-3
FLAGGED = ("partly explained", "unexplained")

# One record each: effect, seed, condition of the bench.  The benchmark has them all.
HIDDEN = [
    ("inertia", 0, "short"),
    ("coulomb", 0, "short"),
    ("bias_force", 0, "short"),
    ("coulomb_asymmetry", 0, "short"),
    ("stribeck", 0, "exact"),
    ("quadratic_drag", 0, "short"),
    ("position_dependence", 0, "short"),
    ("spring", 0, "coarse"),
    ("gravity", 0, "short"),
    ("cogging", 0, "off"),
    ("drift", 1, "short"),
    ("presliding", 0, "exact"),
    ("compliance", 1, "short"),
    ("input_delay", 0, "coarse"),
    ("actuator_lag", 1, "short"),
    ("time_periodic", 0, "exact"),
]
CLEAN = [(0, "exact"), (1, "coarse")]
OUTSIDE = [("impacts", 1), ("lost_steps", 3)]


@cache
def case_of(slug, seed, condition):
    return make_case(slug, seed, condition)


@cache
def answer(slug, seed, condition):
    case = case_of(slug, seed, condition)
    return diagnose(believed(case), record(case), jobs=1)


def causes(found):
    return [cause.effect for cause in found.causes]


def passes(case, found):
    """The blind test itself: cause, verdict and parameters."""
    if not case.truth:
        return not causes(found) and found.verdict == "nothing to find"
    if not named_right([*case.truth], case.twins, causes(found)):
        return False
    errors = parameter_errors(case, found).values()
    # The bar that the benchmark sets for the median; a twin has other parameters.
    return found.verdict == "explained" and (not errors or np.median([*errors]) < 0.15)


@pytest.mark.slow
@pytest.mark.parametrize(("slug", "seed", "condition"), HIDDEN)
def test_hidden_effect_is_named(slug, seed, condition):
    case, found = case_of(slug, seed, condition), answer(slug, seed, condition)
    assert passes(case, found), f"hidden {case.truth}; answered:\n{found}"
    # Errors of data that neither selection nor fit has seen are at their floor.
    assert found.gain.after < 1.15 * found.gain.floor
    assert found.gain.ratio > 2.0


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "condition"), CLEAN)
def test_clean_record_is_not_accused(seed, condition):
    found = answer((), seed, condition)
    assert passes(case_of((), seed, condition), found), str(found)
    assert found.extended == found.axis.effective()
    assert found.unexplained.fraction == 0.0


@pytest.mark.slow
def test_slightly_wrong_parameters_are_mended_and_nothing_else_is_accused():
    case = make_null(0, "off")
    found = diagnose(believed(case), record(case), jobs=1)
    assert not foreign(causes(found)), str(found)
    for name in ("mass", "viscous"):
        # Believed up to 3 % wrong; what is left is a tenth of that.
        assert getattr(found.extended, name) == pytest.approx(case.actual[name], rel=3e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "seed"), OUTSIDE)
def test_what_no_candidate_explains_is_admitted(kind, seed):
    case = make_outside(seed, kind=kind)
    found = diagnose(believed(case), record(case), jobs=1)
    assert found.verdict in FLAGGED, str(found)
    assert found.unexplained.significant
    assert found.unexplained.where


@pytest.mark.slow
def test_both_causes_of_a_pair_are_found():
    case = make_pair(0, "short", pair=("spring", "input_delay"))
    found = diagnose(believed(case), record(case), jobs=1)
    assert sorted(causes(found)) == ["input_delay", "spring"], str(found)
    assert found.verdict == "explained"
    assert max(parameter_errors(case, found).values()) < 0.15


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effects", "seed", "condition"),
    [
        (("input_gain",), 7, "exact"),
        (("input_gain",), 4, "short"),
        (("input_gain", "stribeck"), 5, "short"),
    ],
)
def test_a_gain_is_not_taken_for_three_wrong_base_parameters(effects, seed, condition):
    # The very same machine; one cause is plainer than three.
    case = make_case(effects, seed, condition)
    found = diagnose(believed(case), record(case), jobs=1)
    assert sorted(causes(found)) == sorted(effects), str(found)


# -- the blind test would catch a diagnosis that cheats -----------------------------


@pytest.mark.slow
def test_a_constant_answer_fails_the_blind_test():
    """Whatever the constant is, it passes on records of its own cause alone."""
    work = [*HIDDEN, *(((), seed, condition) for seed, condition in CLEAN)]
    for slug, seed, condition in work:
        constant = answer(slug, seed, condition)
        for other in work:
            case = case_of(*other)
            twins = {twin for all_ in case.twins.values() for twin in all_}
            assert other[0] == slug or slug in twins or not passes(case, constant)


@contextmanager
def registry(order):
    """The same effects, registered in another order."""
    before = dict(REGISTRY)
    try:
        REGISTRY.clear()
        REGISTRY.update((slug, before[slug]) for slug in order)
        yield
    finally:
        REGISTRY.clear()
        REGISTRY.update(before)


def lies(slug, seed, condition, other):
    """The same record under a false name, and the believed axis too."""
    case = case_of(slug, seed, condition)
    told = dfc.Record(case.t, case.u, case.x, name=other)
    return believed(case).replace(name=other), told


def first_registered(axis, measured, **options):
    """An impostor: names the first effect of the registry that is no base value."""
    found = answer("bias_force", 0, "short")
    slug = foreign([*REGISTRY])[0]
    return replace(found, causes=(replace(found.causes[0], effect=slug),))


def by_name(axis, measured, **options):
    """An impostor: repeats what the record is called."""
    found = answer("bias_force", 0, "short")
    return replace(found, causes=(replace(found.causes[0], effect=measured.name or axis.name),))


def looks_at_names(candidate):
    """Whether the answer changes when only names and their order do."""
    right = answer("bias_force", 0, "short")
    axis, told = lies("bias_force", 0, "short", "spring")
    with registry(sorted(REGISTRY)[::-1]):
        found = candidate(axis, told, jobs=1)
    if causes(found) != causes(right):
        return True
    # The order in which candidates are fitted leaves no trace in the numbers.
    return found.causes[0].parameters != right.causes[0].parameters


@pytest.mark.slow
def test_the_answer_hangs_on_no_name_and_no_order():
    assert not looks_at_names(diagnose)


@pytest.mark.slow
@pytest.mark.parametrize("impostor", [first_registered, by_name])
def test_a_diagnosis_that_looks_at_names_is_caught(impostor):
    assert looks_at_names(impostor)


class OnFitted(module.Race):
    """A race that judges on the very windows it fitted on."""

    def __init__(self, bench, axis, fit, judge, *rest, **options):
        super().__init__(bench, axis, fit, fit, *rest, **options)


def wanders(seed, condition):
    """A friction level that wanders at random, so that nothing may be accused."""
    case = make_outside(seed, condition, kind="wandering_friction")
    return diagnose(believed(case), record(case), jobs=1)


@pytest.mark.slow
@pytest.mark.parametrize("judge", ["held out", "fitted"])
def test_without_the_held_out_step_chance_is_accused(monkeypatch, judge):
    """Fits always lower the error they were fitted on; unseen data tell."""
    if judge == "fitted":
        monkeypatch.setattr(module, "Race", OnFitted)
    # One accusation is enough, and so is the step of the free runs: what a random force makes
    # of it is another judge's matter.
    monkeypatch.setattr(selection, "_MOST_CAUSES", 1)
    monkeypatch.setattr(module, "_nothing", lambda *_: True)
    monkeypatch.setattr(module, "answer", lambda *_: SimpleNamespace(verdict="unexplained"))
    found = wanders(1, "short")
    assert found.verdict in FLAGGED
    assert bool(found.causes) == (judge == "fitted"), str(found)


SECONDS = 12


def by_heart_law(t, x, v, u, level, direction, rest, p):
    return p[min(int(t), SECONDS - 1)]


@contextmanager
def registered(effect):
    """An effect that is known inside the block only."""
    dfc.effects.register_effect(effect)
    try:
        yield effect
    finally:
        del REGISTRY[effect.slug]


@pytest.mark.slow
def test_a_candidate_that_learns_by_heart_is_refused():
    """A friction level for every second fits any record; it says nothing of the others."""
    # Bounds that keep the level of 8 N positive.
    every = {
        f"second{k:02d}": dfc.effects.parameter("N", "level", default=0.0, bounds=(-6.0, 6.0))
        for k in range(SECONDS)
    }
    heart = make_dataclass(
        "Heart", [(name, float, one) for name, one in every.items()],
        bases=(dfc.effects.Effect,), frozen=True,
        namespace={"slug": "by_heart", "title": "learned by heart", "action": "friction",
                   "law": staticmethod(by_heart_law)},
    )  # fmt: skip
    rng = np.random.default_rng(0)
    n = SECONDS * 1000
    targets = np.repeat(rng.uniform(0.03, 0.27, 90), 250)[: n + 400]
    bell = np.hanning(400)
    reference = np.convolve(targets, bell / bell.sum(), "same")[200 : 200 + n]
    plant = Plant(mass=2.0, viscous=15.0, coulomb=8.0, middle=0.15, half_travel=0.15)
    wander = np.repeat(rng.uniform(-0.4, 0.4, SECONDS), 1000)
    zero = np.zeros(n)
    u, x, _ = closed_loop(
        plant, reference, DT, 30, 2450.0, 0.0, 112.0, 3e-3, 200.0, 2e-6, zero, zero, zero, wander
    )
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, travel=(0.0, 0.3))
    with registered(heart):
        found = diagnose(axis, dfc.Record(DT * np.arange(n), u, x), jobs=1)
    assert "by_heart" not in causes(found), str(found)
    assert found.verdict in FLAGGED


# -- a user's own effect --------------------------------------------------------------


def magnet_law(t, x, v, u, level, direction, rest, p):
    return p[0] / (0.1 + x) ** 2


@dataclass(frozen=True)
class Magnet(dfc.effects.Effect):
    """A magnet at x = -0.1 m that pushes away."""

    strength: float = dfc.effects.parameter("N m^2", "push times distance squared")

    slug = "magnet"
    title = "magnet at the end"
    action = "force"
    depends_on_speed = False
    explanation = "A magnet repels the carriage."
    experiment = "Crawl towards it."
    law = staticmethod(magnet_law)


def made_record(push):
    """Closed loop over a mass with dry friction and a force push(x, v), 20 steps a sample.

    Semi-implicit Euler, the speed clipped at zero while friction can hold.
    """
    mass, viscous, coulomb, inner = 2.0, 15.0, 8.0, 20
    rng = np.random.default_rng(4)
    reference = np.convolve(np.repeat(rng.uniform(0.05, 0.25, 20), 300), np.ones(150) / 150, "same")
    n, h, quantum = 6000, DT / 20, 2e-6
    x, v = float(reference[0]), 0.0
    u, y = np.zeros(n), np.zeros(n)
    before = 0.0
    for k in range(n):
        y[k] = quantum * round(x / quantum)
        error = reference[k] - y[k]
        u[k] = 2000.0 * error + (90.0 * (error - before) / DT if k else 0.0)
        before = error
        for _ in range(inner):
            x += 0.5 * h * v
            drive = u[k] + push(x, v) - viscous * v
            free = v + h * drive / mass
            v = np.sign(free) * max(abs(free) - h * coulomb / mass, 0.0)
            x += 0.5 * h * v
    return dfc.Record(DT * np.arange(n), u, y)


@pytest.mark.slow
def test_an_effect_of_the_user_is_found_like_any_other():
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, travel=(0.0, 0.3))
    measured = made_record(lambda x, v: 0.03 / (0.1 + x) ** 2)
    with registered(Magnet):
        found = diagnose(axis, measured, jobs=1)
    assert causes(found) == ["magnet"], str(found)
    # Truth is first order in its step of 50 us: a few permille of force.
    assert found.causes[0].parameters["strength"] == pytest.approx(0.03, rel=0.01)
    assert found.causes[0].units == {"strength": "N m^2"}
    assert "magnet" not in REGISTRY


def brake_law(t, x, v, u, level, direction, rest, p):
    return -2.0 * p[0] * (v / p[1]) / (1.0 + (v / p[1]) ** 2)


@dataclass(frozen=True)
class Brake(dfc.effects.Effect):
    """An eddy-current brake: the drag rises with speed and falls again."""

    force: float = dfc.effects.parameter("N", "largest drag", bounds=(0.0, np.inf))
    speed: float = dfc.effects.parameter(
        "m/s", "speed at which it is reached", bounds=(1e-3, np.inf)
    )

    slug = "brake"
    title = "eddy-current brake"
    action = "force"
    explanation = "A magnet induces currents in a conductor that it passes."
    experiment = "Run at several constant speeds."
    law = staticmethod(brake_law)


@pytest.mark.slow
def test_an_effect_that_is_not_linear_in_its_parameters_is_found_from_any_start():
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    measured = made_record(lambda x, v: -6.0 * (v / 0.12) / (1.0 + (v / 0.12) ** 2))
    with registered(Brake):
        found = diagnose(axis, measured, jobs=1)
    assert causes(found) == ["brake"], str(found)
    assert found.causes[0].parameters["force"] == pytest.approx(3.0, rel=0.02)
    assert found.causes[0].parameters["speed"] == pytest.approx(0.12, rel=0.02)


# -- effects in the believed axis ------------------------------------------------------


@pytest.mark.slow
def test_an_effect_in_the_believed_axis_may_have_the_wrong_numbers():
    case = case_of("spring", 0, "short")
    true = case.truth["spring"]
    half = dfc.effects.Spring(stiffness=0.5 * true["stiffness"], rest=true["centre"])
    found = diagnose(believed(case).replace(effects=(half,)), record(case), jobs=1)
    assert causes(found) == ["spring"], str(found)
    assert found.causes[0].parameters["stiffness"] == pytest.approx(true["stiffness"], rel=0.05)
    assert "lready in the nominal axis" in found.causes[0].explanation
    assert len(found.extended.effects) == 1


@pytest.mark.slow
def test_a_believed_peak_that_is_not_there_is_taken_away():
    case = case_of("input_gain", 4, "short")
    peak = dfc.Stribeck(excess=0.3, speed=0.02)
    found = diagnose(believed(case).replace(stribeck=peak), record(case), jobs=1)
    assert sorted(causes(found)) == ["input_gain", "stribeck"], str(found)
    assert found.extended.stribeck.excess < 0.02


# -- what must not matter -----------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(("length", "force"), [(1e3, 1.0), (1.0, 1e3)])
def test_units_do_not_matter(length, force):
    """The same record in mm or mN, the axis told in the same units."""
    case, plain = case_of("bias_force", 0, "short"), answer("bias_force", 0, "short")
    axis = believed(case)
    peak = axis.stribeck and dfc.Stribeck(axis.stribeck.excess, axis.stribeck.speed * length)
    scaled = axis.replace(
        mass=axis.mass * force / length, viscous=axis.viscous * force / length,
        coulomb=case.believed["coulomb"] * force, stribeck=peak,
        stick_speed=axis.stick_speed * length, travel=(0.0, case.believed["travel"][1] * length),
    )  # fmt: skip
    found = diagnose(scaled, dfc.Record(case.t, force * case.u, length * case.x), jobs=1)
    assert (found.verdict, causes(found)) == (plain.verdict, causes(plain)), str(found)
    mine, theirs = found.causes[0], plain.causes[0]
    # Rounding alone differs; the fits stop within a standard error of their end.
    error = theirs.standard_errors["force"]
    assert mine.parameters["force"] / force == pytest.approx(theirs.parameters["force"], abs=error)
    assert found.gain.ratio == pytest.approx(plain.gain.ratio, rel=1e-2)


@pytest.mark.slow
def test_two_calls_agree_and_so_do_one_and_two_jobs():
    which = "position_dependence", 0, "short"
    case, first = case_of(*which), answer(*which)
    axis, measured = believed(case), record(case)
    arrays = [a.copy() for a in (measured.t, measured.u, measured.x)]
    known = dict(REGISTRY)
    for jobs in (1, 2):
        again = diagnose(axis, measured, jobs=jobs)
        assert again.to_json() == first.to_json()
    for now, before in zip((measured.t, measured.u, measured.x), arrays, strict=True):
        np.testing.assert_array_equal(now, before)
    assert axis == believed(case) and known == REGISTRY


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shell", "progress", "shown"),
    [(None, None, False), ("imported", None, False), ("running", None, True), (None, True, True)],
)
def test_it_keeps_silent_unless_asked_or_in_a_notebook(capfd, monkeypatch, shell, progress, shown):
    module = SimpleNamespace(get_ipython=lambda: shell if shell == "running" else None)
    monkeypatch.setitem(sys.modules, "IPython", module if shell else None)
    case = case_of((), 0, "exact")
    diagnose(believed(case), record(case), jobs=1, progress=progress)
    told = capfd.readouterr()
    assert told.out == "" and bool(told.err) == ("diagnose" in told.err) == shown


# -- bad input ---------------------------------------------------------------------


def moving(seconds):
    t = DT * np.arange(round(seconds / DT))
    return dfc.Record(t, np.sin(t), 0.1 + 1e-6 * np.round(5e4 * np.sin(9.0 * t)))


AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        (("axis", moving(5)), {}, "axis must be a FrictionAxis, got 'axis'"),
        ((AXIS, np.zeros(100)), {}, "record must be a Record .*got a value of type ndarray"),
        ((AXIS, moving(2)), {}, "record lasts 2 s.*give at least 10 windows"),
        ((AXIS, moving(5)), {"window": -1.0}, "window must be"),
        ((AXIS, moving(5)), {"window": "long"}, "window must be"),
        ((AXIS, moving(5)), {"window": 1e-3}, "window = 0.001 s is 1 samples"),
        ((AXIS, moving(5)), {"hold": "second"}, 'hold must be "zero" or "first"'),
    ],
)
def test_bad_input_is_refused_by_name(arguments, options, message):
    with pytest.raises(ValueError, match=message):
        diagnose(*arguments, **options)


def test_a_record_without_motion_is_refused():
    rng = np.random.default_rng(0)
    t = DT * np.arange(5000)
    still = dfc.Record(t, np.sin(t), 0.1 + 1e-6 * rng.integers(0, 2, t.size))
    with pytest.raises(ValueError, match="hardly moves"):
        diagnose(AXIS, still)


# -- what is handed back -----------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(("slug", "seed", "condition"), HIDDEN)
def test_the_answer_can_be_used(slug, seed, condition):
    case, found = case_of(slug, seed, condition), answer(slug, seed, condition)
    told = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert [cause["effect"] for cause in told["causes"]] == causes(found)
    for cause in found.causes:
        low, high = cause.interval
        assert low <= cause.held_out_gain <= high
        assert cause.parameters.keys() == cause.standard_errors.keys() == cause.units.keys()
        for name, error in cause.standard_errors.items():
            assert error > 0.0
            # What the record leaves open is infinite, and said.
            assert np.isfinite(error) or any(name in text for text in found.messages)
    run = found.extended.simulate(case.u[:500], dt=DT, x0=float(case.x[0]))
    assert np.all(np.isfinite(run.y[:2]))
