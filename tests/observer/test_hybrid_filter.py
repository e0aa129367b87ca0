"""The hybrid filter against closed forms, its own faces, and plants it does not know."""

import math

import control as ct
import numpy as np
import pytest
from dryfric_control.effects import Cogging, Gravity, InputDelay, Presliding, Spring
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from scipy.integrate import trapezoid
from scipy.stats import norm, truncnorm

import dryfric_control as dfc
from dryfric_control.compiled import axis_step
from dryfric_control.compiled import hybrid_filter as kernel
from dryfric_control.observer import ObserverWarning, filter_reference

DT = 1e-3
# The reading's rounding makes the estimate jump where two ways of writing the same
# numbers differ in the last digit; the filter forgets a jump of 1e-16 at once.
ROUND_OFF = 1e-9


def stage(**changes):
    given = {"mass": 2.0, "viscous": 15.0, "coulomb": 8.0, "stick_speed": 1e-3}
    return dfc.FrictionAxis(**(given | changes))


def reference(n=6000):
    """Reversals of a sine, steps and rests."""
    t = np.arange(n) * DT
    r = np.where(t < 2.5, 0.02 * np.sin(5.0 * t), np.where((t - 2.5) % 1.0 < 0.5, 0.05, 0.01))
    return filter_reference(r, 40.0, DT)


def loop(plant, quantum, n=6000):
    """A closed loop, with its drive and what the encoder reads."""
    controller = dfc.PositionController.from_bandwidth(stage(), 25.0, DT, limit=80.0)
    run = dfc.simulate_loop(plant, controller, reference(n), quantum=quantum)
    return run, run.outputs[4], run.outputs[5]


def speed_error(estimate, run):
    v = run.outputs[1]
    return np.sqrt(np.mean((estimate.outputs[1] - v)[200:] ** 2)) / np.std(v[200:])


def mismatched(rng):
    """A stage with everything off by a fifth, levels of its own, and a Stribeck peak."""
    m, f, plus, minus = rng.uniform(0.8, 1.2, 4)
    return stage(
        mass=2.0 * m, viscous=15.0 * f, coulomb=(8.0 * plus, 8.0 * minus),
        stribeck=dfc.Stribeck(rng.uniform(0.02, 0.6), 0.01 * rng.uniform(0.5, 2.0)),
        stick_speed=1e-3 * rng.uniform(1.0, 3.0),
    )  # fmt: skip


@pytest.mark.parametrize("e", [-4.0, -0.6, 0.0, 0.3, 2.5])
@pytest.mark.parametrize("sd", [0.05, 0.4, 2.0, 30.0])
def test_a_cell_cuts_the_normal_density(e, sd):
    low, high = (e - 0.5) / sd, (e + 0.5) / sd
    mass, mean, variance = kernel._cell(e, sd)
    if min(abs(low), abs(high)) > 5.0 and low * high > 0.0:
        # far out, a normal reading of the cell's variance
        total = sd**2 + 1 / 12
        assert mean == pytest.approx(sd**2 / total * e)
        assert variance == pytest.approx(sd**2 / 12 / total)
        assert 0.0 < mass < 1e-5 / sd
    else:
        exact = truncnorm(low, high, scale=sd)
        assert mass == pytest.approx(norm.cdf(high) - norm.cdf(low), rel=1e-9)
        assert mean == pytest.approx(exact.mean(), rel=1e-6, abs=1e-9)
        # the cancellation of a variance near 1/12 in one of sd^2
        assert variance == pytest.approx(exact.var(), rel=1e-4)


@pytest.mark.parametrize("mean", [-2.0, -0.1, 0.0, 0.7, 9.0])
def test_what_has_not_crossed_zero(mean):
    mass, centre, variance = kernel._positive_part(mean, 1.3)
    exact = truncnorm(-mean / 1.3, np.inf, loc=mean, scale=1.3)
    assert mass == pytest.approx(0.5 * math.erfc(-mean / 1.3 / math.sqrt(2.0)))
    assert centre == pytest.approx(exact.mean(), rel=1e-6)
    assert variance == pytest.approx(exact.var(), rel=1e-4)


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_a_tail_is_cut_in_part(share):
    mean, sd = 0.4, 1.3
    tail = kernel._positive_part(mean, sd)
    total, centre, variance = kernel._truncated_moments(share, mean, sd * sd, *tail)
    x = np.linspace(mean - 10 * sd, mean + 10 * sd, 200_001)
    density = norm.pdf(x, mean, sd) * np.where(x > 0.0, 1.0, 1.0 - share)
    mass = trapezoid(density, x)
    middle = trapezoid(x * density, x) / mass
    assert (total, centre) == (pytest.approx(mass, abs=1e-4), pytest.approx(middle, abs=1e-4))
    assert variance == pytest.approx(trapezoid((x - middle) ** 2 * density, x) / mass, abs=1e-3)
    # Of a density that is nearly all tail the rest is left.
    assert kernel._truncated_moments(1.0, 0.4, 1.7, 1e-20, 0.1, 0.2) == pytest.approx(
        (1e-20, 0.1, 0.2)
    )
    assert np.all(np.isfinite(kernel._truncated_moments(1.0, 0.4, 1.7, 0.0, 0.1, 0.2)))


@njit
def make_positive(s):
    kernel._make_positive(axis_step.pointer(s), kernel.MODE_STATES)


@njit
def condition(s, column, change, removed, variance):
    kernel._condition(axis_step.pointer(s), kernel.MODE_STATES, column, change, removed, variance)


LOWER = np.tril_indices(kernel.STATES)


BELIEF = slice(kernel.MODE_STATES, kernel.MODE_STATES + kernel.STATES)
COVARIANCE = slice(kernel.MODE_STATES + kernel.COVARIANCE, kernel.MODE_STATES + kernel.GAUSSIAN)


def covariance(s):
    P = np.zeros((kernel.STATES, kernel.STATES))
    P[LOWER] = s[COVARIANCE]
    return P + np.tril(P, -1).T


def believing(mean, P):
    """The memory of a filter whose first belief is that."""
    s = np.zeros(kernel.SIZE)
    s[BELIEF], s[COVARIANCE] = mean, P[LOWER]
    return s


def spread(rng):
    scale = 10.0 ** rng.uniform(-4, 3, kernel.STATES)
    root = rng.standard_normal((kernel.STATES, kernel.STATES)) * scale[:, None]
    return root @ root.T


@pytest.mark.parametrize("seed", range(20))
def test_a_covariance_is_kept_or_made_positive(seed):
    rng = np.random.default_rng(seed)
    P = spread(rng)
    s = believing(0.0, P)
    make_positive(s)
    np.testing.assert_array_equal(covariance(s), P)
    # one direction negative, as a downdate that cancels leaves it
    d = np.sqrt(np.diag(P))
    values, vectors = np.linalg.eigh(P / np.outer(d, d))
    values[0] = -1e-3 * rng.uniform()
    bad = np.outer(d, d) * (vectors * values @ vectors.T)
    s = believing(0.0, bad)
    make_positive(s)
    mended = covariance(s)
    assert np.linalg.eigvalsh(mended / np.outer(d, d))[0] > -1e-14
    # nothing grows: a small pivot must not become a large column
    assert np.all(np.diag(mended) <= np.diag(bad) * (1.0 + 1e-9))


@pytest.mark.parametrize("column", [0, 1])
def test_a_correction_moves_all_states_by_their_correlation(column):
    rng = np.random.default_rng(4)
    P, mean = spread(rng), rng.standard_normal(6)
    s, variance, removed = believing(mean, P), P[column, column] + 0.1, 0.6
    condition(s, column, 0.7, removed, variance)
    k = P[:, column] / variance
    np.testing.assert_allclose(s[BELIEF], mean + k * 0.7)
    np.testing.assert_allclose(covariance(s), P - np.outer(k, k) * removed, rtol=1e-9)


FULL = stage(
    coulomb=dfc.CoulombMap(plus=[8.0, 4.0], minus=[7.0, -3.0]), travel=(-0.3, 0.3),
    stribeck=dfc.Stribeck(0.3, 0.01),
    effects=(Spring(stiffness=40.0), Cogging(amplitude=0.5, period=0.01), InputDelay(delay=2.3e-3)),
)  # fmt: skip


@pytest.mark.parametrize("axis", [stage(), FULL], ids=["plain", "effects"])
def test_run_block_and_stepper_agree(axis):
    run, u, y = loop(axis, 1e-5, n=1500)
    observer = dfc.hybrid_filter(axis, DT, 1e-5)
    whole = observer.run(u, y)
    stepper = observer.stepper()
    by_hand = np.array([stepper.step(*sample) for sample in zip(u, y, strict=True)]).T
    np.testing.assert_allclose(by_hand, whole.outputs, rtol=ROUND_OFF, atol=ROUND_OFF)
    assert stepper.vhat_sd == pytest.approx(whole.vhat_sd[-1], rel=1e-6)
    assert stepper.log_likelihood == pytest.approx(whole.log_likelihood[-1], rel=1e-6)
    response = ct.input_output_response(observer.block(), whole.time, np.vstack([u, y]))
    np.testing.assert_allclose(response.outputs, whole.outputs, rtol=ROUND_OFF, atol=ROUND_OFF)


def test_a_record_is_run_like_its_columns():
    run, u, y = loop(stage(), 1e-5, n=1500)
    observer = dfc.hybrid_filter(stage(), DT, 1e-5)
    record = dfc.Record(t=run.time, u=u, x=y)
    np.testing.assert_array_equal(observer.run(record).outputs, observer.run(u, y).outputs)
    with pytest.raises(ValueError, match="y must be left out"):
        observer.run(record, y)
    with pytest.raises(ValueError, match=r"record.dt is 0\.001 s and filter.dt 0\.002 s"):
        dfc.hybrid_filter(stage(), 2 * DT, 1e-5).run(record)


def test_a_loop_over_the_estimates_needs_no_algebraic_solution():
    """Position and velocity do not depend on the drive of their own sample."""
    gain = ct.nlsys(
        None, lambda t, x, u, params: np.array([3000.0 * (0.01 - u[0]) - 100.0 * u[1]]),
        inputs=["xhat", "vhat"], outputs=["u"], dt=DT, name="gain",
    )  # fmt: skip
    observer, plant = dfc.hybrid_filter(stage(), DT, 1e-5).block(), dfc.axis_block(stage(), DT)
    parts = [observer, gain, plant, dfc.encoder(1e-5, DT)]
    closed = ct.interconnect(parts, inputs=[], outputs=["v", "vhat"], dt=DT)
    v, estimate = ct.input_output_response(closed, np.arange(400) * DT, 0.0).outputs
    assert np.max(np.abs(v)) > 0.01
    assert np.sqrt(np.mean((v - estimate) ** 2)) < 0.1 * np.std(v)


@pytest.mark.parametrize(("quantum", "most"), [(1e-6, 0.0016), (2e-5, 0.007)])
def test_velocity_of_plants_it_does_not_know(quantum, most):
    """The median the benchmark asks for, on plants of this test alone."""
    rng = np.random.default_rng(11)
    errors, plain = [], []
    observer = dfc.hybrid_filter(stage(), DT, quantum)
    design = dfc.design_pi_observer(stage(), DT, encoder_quantum=quantum)
    for _ in range(5):
        run, u, y = loop(mismatched(rng), quantum)
        errors.append(speed_error(observer.run(u, y), run))
        plain.append(speed_error(dfc.observe(design, u, y), run))
    assert np.median(errors) < most
    assert all(mine < other for mine, other in zip(errors, plain, strict=True))


def test_known_effects_are_used():
    plant = stage(effects=(Gravity(amplitude=3.0, phase=0.4), InputDelay(delay=2.5e-3)))
    run, u, y = loop(plant, 1e-5)
    knows = speed_error(dfc.hybrid_filter(plant, DT, 1e-5).run(u, y), run)
    ignores = speed_error(dfc.hybrid_filter(stage(), DT, 1e-5).run(u, y), run)
    assert knows < 0.6 * ignores


def test_noise_beyond_the_cell_is_followed():
    run, u, _ = loop(stage(stribeck=dfc.Stribeck(0.3, 0.01)), 1e-6)
    rng = np.random.default_rng(2)
    y = rounded(run.outputs[0] + 5e-6 * rng.standard_normal(6000), 1e-6)
    assert speed_error(dfc.hybrid_filter(stage(), DT, 1e-6).run(u, y), run) < 0.02


def test_units_do_not_matter():
    """The same machine in millimetres."""
    run, u, y = loop(stage(), 1e-5)
    small = stage(mass=2e-3, viscous=15e-3, stick_speed=1.0)
    metres = dfc.hybrid_filter(stage(), DT, 1e-5).run(u, y).outputs
    millimetres = dfc.hybrid_filter(small, DT, 1e-2).run(u, 1e3 * y).outputs
    np.testing.assert_allclose(millimetres[1], 1e3 * metres[1], atol=1e-6)
    np.testing.assert_array_equal(millimetres[4], metres[4])


EXACT = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)


def driven(dt, frequency, ratio, phase, n):
    """Drive and motion of a plant that is its own model, without any noise."""
    w = 2.0 * np.pi * frequency * dt * np.arange(n)
    u = 20.0 * np.sin(w) + 8.0 * np.sin(ratio * w + phase)
    return u, EXACT.simulate(u, dt=dt)


def rounded(x, quantum):
    return quantum * np.round(x / quantum) if quantum else x


@pytest.mark.parametrize(
    ("quantum", "drive"), [(1e-7, (7.5, 3.3, 1.0)), (1e-6, (14.56, 2.8115, 4.9707))]
)
def test_an_exact_plant_is_not_lost_at_50_khz(quantum, drive):
    u, run = driven(2e-5, *drive, 20_000)
    seen = dfc.hybrid_filter(EXACT, 2e-5, quantum).run(u, rounded(run.y[0], quantum))
    late = slice(5000, None)
    error = np.abs(seen.outputs[1] - run.y[1])[late]
    assert error.max() < 0.1 * np.abs(run.y[1]).max()
    assert np.mean((seen.mode != run.mode)[late]) < 0.05


def test_a_reversal_inside_a_sample_is_followed():
    u, run = driven(5e-3, 4.0, 3.1, 2.0, 2000)
    seen = dfc.hybrid_filter(EXACT, 5e-3, 1e-7).run(u, rounded(run.y[0], 1e-7))
    after = np.flatnonzero(run.mode[1:] * run.mode[:-1] < 0.0)[5:] + 1
    assert after.size > 20
    error = np.abs(seen.outputs[1] - run.y[1])[after]
    assert np.median(error / np.abs(run.y[1][after])) < 0.02


@pytest.mark.parametrize("dt", [2e-2, 1e-3, 2e-5])
@pytest.mark.parametrize("quantum", [0.0, 1e-6, 1e-4])
def test_the_error_is_what_the_filter_expects_of_itself(dt, quantum):
    """Few errors are beyond five standard deviations: the samples of a switch."""
    n = int(np.clip(4.0 / dt, 2000, 40_000))
    frequency = min(max(4.0 / (n * dt), 2.0), 0.02 / dt)
    for seed in range(2):
        rng = np.random.default_rng(seed)
        pace, ratio, phase = rng.uniform([0.7, 2.5, 0.0], [1.3, 4.0, 6.0])
        u, run = driven(dt, frequency * pace, ratio, phase, n)
        seen = dfc.hybrid_filter(EXACT, dt, quantum or 1e-9).run(u, rounded(run.y[0], quantum))
        error = np.abs(seen.outputs[1] - run.y[1])[200:]
        assert np.mean(error > 5.0 * seen.vhat_sd[200:]) < 0.01
        # The coarsest encoder leaves up to 0.013, at 50 Hz.
        assert np.sqrt(np.mean(error**2)) < 0.02 * np.std(run.y[1])


@pytest.mark.slow
def test_wild_plants_leave_it_finite_and_near():
    """Plants that the nominal axis has nothing to do with, encoders of 1 nm to 0.3 mm."""
    rng = np.random.default_rng(5)
    for _ in range(15):
        plant = stage(
            mass=2.0 * rng.uniform(0.5, 2.0), viscous=15.0 * rng.uniform(0.1, 5.0),
            coulomb=8.0 * rng.uniform(0.4, 2.0),
            stribeck=dfc.Stribeck(rng.uniform(0.02, 1.0), 10.0 ** rng.uniform(-4, -1)),
            stick_speed=10.0 ** rng.uniform(-5, -2.5),
        )  # fmt: skip
        quantum = 10.0 ** rng.uniform(-9, -3.5)
        run, u, y = loop(plant, quantum)
        estimate = dfc.hybrid_filter(stage(), DT, quantum).run(u, y)
        assert np.isfinite(estimate.outputs).all()
        assert np.isfinite(estimate.vhat_sd).all()
        assert speed_error(estimate, run) < 0.3


@settings(max_examples=40)
@given(
    seed=st.integers(0, 2**32 - 1), drive=st.floats(-3, 9), reading=st.floats(-9, 9),
    quantum=st.floats(-9, -1), dt=st.floats(-4.9, -1), walk=st.booleans(),
)  # fmt: skip
def test_any_signals_leave_it_finite(seed, drive, reading, quantum, dt, walk):
    """Exponents of ten; a shorter dt is taken for one exchanged with the quantum."""
    rng = np.random.default_rng(seed)
    u, y = 10.0**drive * rng.standard_normal(300), 10.0**reading * rng.standard_normal(300)
    observer = dfc.hybrid_filter(stage(), 10.0**dt, 10.0**quantum)
    estimate = observer.run(u, np.cumsum(y) if walk else y)
    assert np.isfinite(estimate.outputs).all()
    assert np.isfinite(estimate.vhat_sd).all()
    assert np.isfinite(estimate.log_likelihood).all()


def test_bad_samples_leave_the_stepper_as_it_was():
    stepper = dfc.hybrid_filter(stage()).stepper()
    twin = stepper.observer.stepper()
    assert stepper.step(1.0, 0.0) == twin.step(1.0, 0.0)
    with pytest.raises(ValueError, match="y must be a finite number"):
        stepper.step(1.0, math.nan)
    assert stepper.step(9.0, 1e-6) == twin.step(9.0, 1e-6)
    with pytest.raises(ValueError, match="u has 3 samples and y 2"):
        stepper.observer.run([1.0, 2.0, 3.0], [0.0, 0.0])
    with pytest.raises(ValueError, match="y is missing"):
        stepper.observer.run([1.0, 2.0])
    with pytest.warns(ObserverWarning, match="leaves out presliding"):
        dfc.hybrid_filter(stage(effects=(Presliding(distance=1e-5),)))


def test_the_mode_is_wrong_in_less_than_two_percent_of_the_samples():
    u = 12.0 * np.sin(3e-3 * np.arange(4000))
    plant = EXACT.simulate(u, dt=DT)
    estimate = dfc.hybrid_filter(EXACT, DT, 1e-5).run(u, rounded(plant.y[0], 1e-5))
    assert np.mean(estimate.mode != plant.mode) < 0.02
    assert set(plant.mode) == {-1, 0, 1}
