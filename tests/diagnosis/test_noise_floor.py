"""The noise floor: what chance makes of a perfect model, and what is beyond chance."""

import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control.diagnosis.verdict import Floor, far_above, noise_floor, usual_rms
from dryfric_control.estimation.windows import Windows, cut

DT = 1e-3
AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
QUANTUM = 5e-6


def made(quantum=QUANTUM, noise=0.0, steps=0.0):
    """A record of the axis itself, its encoder's grid and noise in it, its input in steps."""
    t = DT * np.arange(6000)
    u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
    x = AXIS.simulate(u, dt=DT).y[0] + noise * np.random.default_rng(3).standard_normal(t.size)
    if steps:
        u = steps * np.round(u / steps)
    return dfc.Record(t, u, quantum * np.round(x / quantum) if quantum else x)


def begun(record):
    """Windows of a record of the axis, all of them known, and the axis' free runs in them."""
    bench = cut(record)
    known = np.ones(len(bench), bool)
    return bench, known, bench.evaluate(AXIS, known)


def floor_of(record, model=AXIS, seed=0):
    """The floor of four replays, and the windows."""
    bench, known, at = begun(record)
    return noise_floor(bench, model, [AXIS] * 4, at, known, seed), bench


def scores_of(bench, model=AXIS):
    known = np.ones(len(bench), bool)
    return bench.scores(bench.evaluate(model, known, thorough=True).costs)


def test_the_integral_of_a_velocity_drifts_in_replays_too():
    run, t = AXIS.simulate(made().u, dt=DT), DT * np.arange(6000)
    v = run.y[1] + 5e-3 * np.random.default_rng(4).standard_normal(t.size)
    bench, active, at = begun(dfc.Record(t, made().u, None, channels={"v": v}))
    still, drifting, more = (
        noise_floor(bench, AXIS, [AXIS] * 8, at, active, velocity=s) for s in (0.0, 5e-3, 1e-2)
    )
    errors = bench.mean_squares(at.errors).mean()
    assert usual_rms([still.squares]) ** 2 < 0.2 * errors
    assert usual_rms([drifting.squares]) ** 2 == pytest.approx(errors, rel=0.4)
    assert usual_rms([more.squares]) ** 2 == pytest.approx(4.0 * errors, rel=0.4)
    scores = bench.scores(at.costs)
    assert drifting.is_noise(scores, active) and not still.is_noise(scores, active)


def of_scores(*replays):
    return Floor(np.array(replays, dtype=float), np.array(replays, dtype=float))


ALL = np.ones(80, bool)
QUIET = of_scores(np.zeros(80), np.zeros(80))


def raised(value, count):
    return np.where(np.arange(80) < count, value, 0.0)


def test_replays_give_each_window_its_mean_and_its_worst():
    floor = of_scores([0.1, 0.5], [0.3, 0.1])
    np.testing.assert_allclose(floor.expected, [0.2, 0.3])
    np.testing.assert_allclose(floor.worst, [0.3, 0.5])
    both = np.array([True, True])
    assert floor.outliers(np.array([1.29, 1.51]), both).tolist() == [False, True]
    assert floor.outliers(np.array([1.29, 1.51]), ~both).tolist() == [False, False]
    assert not np.any(QUIET.outliers(raised(1.0, 1), ALL))  # as far as that is no outlier


def test_one_window_in_ten_may_be_out_of_line():
    assert QUIET.is_noise(raised(9.0, 8), ALL)
    assert not QUIET.is_noise(raised(9.0, 9), ALL)
    # And two in any case.
    few = np.arange(80) < 15
    assert QUIET.is_noise(raised(9.0, 2), few)
    assert not QUIET.is_noise(raised(9.0, 3), few)


def test_the_mean_of_the_others_must_be_near_that_of_the_replays():
    assert QUIET.is_noise(np.full(80, 0.199), ALL)
    assert not QUIET.is_noise(np.full(80, 0.201), ALL)
    # The one out of line has no say in the mean.
    assert QUIET.is_noise(np.full(80, 0.19) + raised(9.0, 1), ALL)
    # Windows not asked for have none either.
    half = np.arange(80) < 40
    assert QUIET.is_noise(np.where(half, 0.0, 0.9), half)
    # Scores that scatter say less: four standard errors.
    rough = np.tile([0.9, -0.5], 40)
    assert QUIET.excess(rough, ALL) == pytest.approx((0.2, 0.7 / np.sqrt(80)))
    assert QUIET.is_noise(rough, ALL)
    assert not QUIET.is_noise(rough + 0.12, ALL)


def test_the_error_of_a_mean_is_that_of_the_record_or_of_the_replays():
    apart = of_scores(np.zeros(80), np.full(80, 0.4))
    excess, error = apart.excess(np.full(80, 0.3), ALL)
    assert (excess, error) == pytest.approx((0.1, 0.2))
    assert apart.excess(np.full(80, 0.3), np.arange(80) < 1) == (0.0, np.inf)
    two = np.arange(80) < 2
    assert apart.excess(np.full(80, 0.3), two) == pytest.approx((0.1, 0.2))


def test_a_true_model_leaves_the_noise_of_the_encoder():
    floor, bench = floor_of(made())
    rms = np.sqrt(floor.squares[:, bench.moving].mean())
    # Two coordinates of the start are fitted in each window, and correct little of 250 samples.
    assert rms == pytest.approx(QUANTUM / np.sqrt(12.0), rel=0.05)
    # log(1 + 1/c^2) is the score of noise alone; a start beside the truth would cost more.
    assert floor.expected[bench.moving].mean() == pytest.approx(0.22, abs=0.04)
    assert np.all(floor.scores >= 0.0) and floor.scores.shape == (4, len(bench))


def test_noise_that_is_no_quantum_is_replayed_too():
    noise = 3e-6
    floor, bench = floor_of(made(quantum=None, noise=noise))
    assert np.sqrt(floor.squares[:, bench.moving].mean()) == pytest.approx(noise, rel=0.1)
    coarse, bench = floor_of(made(noise=noise))
    both = np.hypot(noise, QUANTUM / np.sqrt(12.0))
    assert np.sqrt(coarse.squares[:, bench.moving].mean()) == pytest.approx(both, rel=0.15)


def test_replays_differ_and_come_again_with_their_seed():
    first, again, other = (floor_of(made(), seed=seed)[0] for seed in (0, 0, 1))
    np.testing.assert_array_equal(first.scores, again.scores)
    assert not np.any(np.all(first.scores == other.scores, axis=1))
    # Another grid and other starts in every replay.
    assert np.unique(first.scores, axis=0).shape[0] == 4


def test_the_record_itself_is_within_its_floor_and_another_axis_is_not():
    record = made()
    floor, bench = floor_of(record)
    known, wrong = np.ones(len(bench), bool), AXIS.replace(mass=2.1)
    assert floor.is_noise(scores_of(bench), known)
    assert not floor.is_noise(scores_of(bench, wrong), known)
    # The same wrong model, scored on replays of the truth.
    lifted, _ = floor_of(record, model=wrong)
    assert lifted.expected.mean() > 5.0 * floor.expected.mean()


@pytest.mark.parametrize("row", [0, 1])
def test_replays_start_where_the_model_was_found_to_start_unless_a_run_is_lost(row):
    bench, known, at = begun(made())
    starts, error = at.starts.copy(), (bench.x0_error, bench.v0_error)[row]
    at.starts[row] += 30.0 * error
    moved = noise_floor(bench, AXIS, [AXIS] * 4, at, known)
    assert moved.expected[bench.moving].mean() == pytest.approx(0.22, abs=0.04)
    at.starts[:] = starts
    sound = noise_floor(bench, AXIS, [AXIS] * 4, at, known)
    at.starts[row, 3] += 300.0 * error[3]
    floor = noise_floor(bench, AXIS, [AXIS] * 4, at, known)
    # The other windows as before; that one from where the readings put it.
    np.testing.assert_array_equal(np.delete(floor.scores, 3, 1), np.delete(sound.scores, 3, 1))
    assert floor.expected[3] == pytest.approx(0.22, abs=0.06)


def test_an_input_recorded_in_steps_acted_between_them():
    steps = 0.2
    record = made(steps=steps)
    assert record.input_quantum == pytest.approx(steps) and made().input_quantum == 0.0
    floor, bench = floor_of(record)
    known, scores = np.ones(len(bench), bool), scores_of(bench)
    # Far beyond the noise of the readings, yet nothing that the rounding does not cause.
    assert not floor_of(made())[0].is_noise(scores, known)
    assert floor.is_noise(scores, known)
    # A level that is wrong by more than the rounding shows all the same.
    assert not floor.is_noise(scores_of(bench, AXIS.replace(coulomb=9.0)), known)


def test_a_drive_that_acts_in_steps_has_no_rounding():
    bench, known, at = begun(made(steps=0.2))
    small, some, large, larger = (
        noise_floor(bench, AXIS, [AXIS] * 4, at, known, force=part * 0.2 / np.sqrt(12.0))
        for part in (0.01, 0.6, 0.9, 3.0)
    )
    assert np.median(small.squares) == pytest.approx(QUANTUM**2 / 12.0, rel=0.1)
    assert np.median(large.squares) > 4.0 * np.median(small.squares)
    # A random force up to that of the rounding is the rounding; beyond, the rounding is a part.
    np.testing.assert_array_equal(some.squares, large.squares)
    assert np.median(larger.squares) > 2.0 * np.median(large.squares)


def test_replays_that_diverge_are_left_out(monkeypatch):
    (bench, known, at), far, run = begun(made()), AXIS.replace(mass=2.5), Windows.run
    monkeypatch.setattr(
        Windows, "run", lambda w, one, **how: run(w, one, **how) + (np.inf if one is far else 0.0)
    )
    floor = noise_floor(bench, AXIS, [AXIS, far, AXIS], at, known)
    assert floor.scores.shape == floor.squares.shape == (2, len(bench))
    assert noise_floor(bench, AXIS, [far], at, known).scores.tolist() == [[0.0] * len(bench)]


def test_only_windows_asked_for_are_scored():
    bench = cut(made())
    active = np.arange(len(bench)) % 2 == 0
    floor = noise_floor(bench, AXIS, [AXIS] * 4, bench.evaluate(AXIS, active), active)
    assert np.all(floor.scores[:, active] > 0.0)
    assert np.all(floor.scores[:, ~active] == 0.0)


def test_one_late_breakaway_in_a_replay_moves_no_floor():
    # Three replays of two records, of the first a fourth; one window errs a hundred times as much.
    first, second = np.full((4, 3), 4.0), np.full((3, 1), 16.0)
    assert usual_rms([first, second]) == pytest.approx(np.sqrt(7.0))
    first[1, 2] = 4e4
    assert usual_rms([first, second]) == pytest.approx(np.sqrt(7.0))
    assert usual_rms([np.zeros((0, 3))]) == 0.0


def test_errors_are_far_above_where_no_replay_errs_as_much():
    replays = np.full((6, 4), 1e-10)
    assert not far_above([np.full(4, 1.8e-9)], [replays])
    assert far_above([np.full(4, 1.9e-9)], [replays])
    # One window a hundred times as far off, and none of two records but that.
    late = np.array([1e-10, 1e-6, 1e-10, 1e-10])
    assert far_above([late], [replays])
    assert far_above([np.full(4, 1e-10), late], [replays, replays[:5]])
    # One replay broke away as late: that is chance.
    replays[2, 1] = 1e-6
    assert not far_above([late], [replays])
