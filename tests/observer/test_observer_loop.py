"""The paper's closed loop: two ways of running it, its promises, and its rivals."""

import control as ct
import numpy as np
import pytest
import scipy.signal
from truth.plant import NSTATES, Plant, open_loop

import dryfric_control as dfc
from dryfric_control import presets
from dryfric_control.observer import filter_reference, score_estimate, switch_delays
from dryfric_control.observer.monte_carlo import MonteCarlo

DT = 1e-3
#: The promises: position [inc], speed, friction, commutation.
POSITION, SPEED, FRICTION, COMMUTATION = 2.0, 0.03, 0.05, 0.02


@pytest.fixture(scope="module")
def design():
    return presets.clutch_observer()


@pytest.mark.parametrize("rule", ["reading", "paper"])
def test_interconnect_and_compiled_agree(design, rule):
    """4.4 s: all the crawls, stick-slip included, and the first step."""
    compiled = presets.clutch_experiment(design, switching=rule, duration=4.4)
    assert len(compiled.plant.events) > 8
    loop = dfc.observer.observed_loop(
        presets.clutch_actuator(), presets.clutch_controller(), design,
        bandwidth=presets.CORNER, quantum=presets.QUANTUM, switching=rule,
    )  # fmt: skip
    time, reference = presets.crawl_and_steps(DT, 4.4)
    start = np.zeros(loop.nstates)
    start[loop.find_state("observer_xhat")] = presets.FIRST_ESTIMATE
    start[loop.find_state("plant_mode")] = 0.0
    slow = ct.input_output_response(loop, time, reference, start)
    both = np.vstack([compiled.plant.y, compiled.reference, compiled.estimate.y])
    # The same functions on the same numbers; 1e-9 of each signal's size is round-off.
    scale = np.abs(both).max(axis=1, keepdims=True)
    assert np.abs((slow.outputs - both) / scale).max() < 1e-9


def test_reference_filter_is_a_butterworth_and_rests_where_the_axis_does():
    r = np.random.default_rng(0).normal(size=500)
    b, a = scipy.signal.butter(2, 20.0, fs=2.0 * np.pi / DT)
    # Transfer-function form loses digits near z = 1: (1 - pole)^2 is 4e-4.
    expected = scipy.signal.lfilter(b, a, r)
    np.testing.assert_allclose(filter_reference(r, 20.0, DT), expected, atol=1e-11)
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    design = dfc.design_pi_observer(axis, DT, encoder_quantum=1e-6)
    loop = (axis, dfc.PositionController.from_bandwidth(axis, 20.0, DT), design)
    run = dfc.observer.simulate_observed_loop(*loop, [0.1] * 200, quantum=1e-6, x0=0.1)
    # 16 digits of 0.1 m
    np.testing.assert_allclose(run.reference, 0.1, atol=1e-16)
    assert np.ptp(run.plant.y[0]) == 0.0 and repr(run) == run.summary()


@pytest.mark.parametrize(
    "method",
    ["slack", *(pytest.param(m, marks=pytest.mark.slow) for m in ("paper", "path"))],
)
def test_the_observer_keeps_its_promises(method):
    run = presets.clutch_experiment(presets.clutch_observer(method=method))
    # The first reading corrects the estimate, by the gain of an observer that has settled.
    assert 0.0 < run.estimate.y[0, 0] < 0.2 * presets.FIRST_ESTIMATE
    assert run.plant.y[0, 0] == run.plant.y[1, 0] == 0.0
    score, (_, delay) = run.score, run.delays
    assert score.position < POSITION and score.speed < SPEED
    assert score.friction < FRICTION and abs(score.friction_bias) < FRICTION
    assert score.commutation < COMMUTATION
    assert delay.size == 40 and not np.isnan(delay).any()


def test_promises_hold_on_a_plant_from_elsewhere():
    """A plant simulated by clipped impulses, with no automaton and no shared code."""
    quantum = 2e-5
    true = Plant(mass=2.0, viscous=10.0, coulomb=8.0, excess=0.3, stribeck_speed=3e-3,
                 stick_speed=3e-3)  # fmt: skip
    t = np.arange(8000) * DT
    rng = np.random.default_rng(3)
    u = 11.0 * np.sin(8.0 * t) + 5.0 * np.repeat(rng.uniform(-1.0, 1.0, 20), 400)
    x, v = open_loop(true, u, DT, 20, np.zeros(NSTATES))[:-1, :2].T
    mode = np.where(np.abs(v) <= 1e-12, 0.0, np.sign(v))
    assert 20 < np.count_nonzero(np.diff(mode)) < 200
    believed = dfc.FrictionAxis(mass=2.2, viscous=10.0, coulomb=(6.8, 9.2), stick_speed=1.5e-3)
    given = {"encoder_quantum": quantum, "discretization": "zoh", "stick_speed": 1.5e-3}
    design = dfc.design_pi_observer(believed, DT, **given)
    y = quantum * np.round(x / quantum)
    estimate = dfc.observe(design, u, y, xhat0=0.02, encoder_quantum=quantum)
    assert np.abs(x - estimate.y[0])[100:].max() < 2.0 * quantum
    error = np.sqrt(np.mean((v - estimate.y[1])[200:] ** 2) / np.mean(v[200:] ** 2))
    assert error < SPEED
    assert np.mean(mode != estimate.y[4]) < COMMUTATION


def test_random_mismatches_do_not_upset_it(design):
    """500 plants are the benchmark's business; 40 show the quantiles."""
    found = presets.clutch_monte_carlo(design, runs=40, seed=1, progress=False)
    assert found.diverged == {"reading": 0, "paper": 0}
    middle, most, worst = found.quantiles((0.5, 0.95, 1.0))["reading"]
    assert worst[0] < POSITION and worst[1] < SPEED
    # An inertia off by 15 % cannot be told from friction while accelerating.
    assert most[2] < FRICTION
    assert middle[4] < COMMUTATION
    paper = found.quantiles((0.5,))["paper"][0]
    # The position lies within the increment, for both; the rest is what differs.
    assert [middle[0], paper[0]] == pytest.approx([0.5, 0.5], abs=0.01)
    assert np.all(middle[1:] < paper[1:])
    rows = np.full((4, 5), 0.01)
    rows[1, 0], rows[2, 0] = np.nan, 1e4
    assert MonteCarlo((), {"one": rows}, "inc", 100.0).diverged == {"one": 2}


def test_score_by_hand():
    """Errors that can be read off: 3 increments, 10 %, 0.8 of a level of 8, 1 in 4."""
    axis = dfc.FrictionAxis(mass=1.0, viscous=0.0, coulomb=8.0)
    plant = np.outer([0.0, 1.0, -8.0, -1.0], np.ones(1000))
    estimate = np.outer([3.0, 1.1, -8.8, 0.0, -1.0], np.ones(1000))
    estimate[0, :100] = estimate[1, :200] = estimate[2, :200] = 1e6
    estimate[4, :250] = 0.0
    score = score_estimate(axis, DT, plant, estimate)
    assert score.position == 3.0
    assert [score.speed, score.friction, score.friction_bias] == pytest.approx([0.1] * 3)
    assert score.commutation == 0.25


def test_switch_delays_by_hand():
    true = [0, 0, 1, 1, 1, 1, 0, 0, 0, 0, -1, -1, 0, 0, 0]
    seen = [0, 0, 0, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]
    time, delay = switch_delays(np.array(true, float), np.array(seen, float), 0.5)
    assert time.tolist() == [1.0, 3.0, 5.0, 6.0]
    np.testing.assert_array_equal(delay, [0.5, -0.5, np.nan, -1.0])
