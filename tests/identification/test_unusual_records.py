"""Records without a drive, of velocity alone, of a servo without its torque."""

import warnings

import numpy as np
import pytest
from truth.plant import NSTATES, Plant, V, X, closed_loop, open_loop

import dryfric_control as dfc

pytestmark = pytest.mark.slow

PENDULUM = Plant(mass=0.0224, viscous=0.45e-3, coulomb=4.1e-3, gravity=0.6927, stick_speed=1e-4)
SLIDE = Plant(mass=2.0, viscous=15.0, coulomb=8.0, stick_speed=1e-4)
SERVO = Plant(mass=0.02, viscous=0.3, coulomb=0.5, stick_speed=1e-3)
TURNING = ("rad", "N m")
SEEDS = range(3)


def swinging(seed):
    """A pendulum let go, seen by an encoder of 4000 counts for 20 s."""
    start = np.zeros(NSTATES)
    start[X] = -2.0 - 0.5 * np.random.default_rng(seed).random()
    x = open_loop(PENDULUM, np.zeros(4000), 5e-3, 50, start)[:-1, X]
    counts, t = 2.0 * np.pi / 4000, 5e-3 * np.arange(4000)
    return dfc.Record(t, None, counts * np.round(x / counts), units={"x": "rad"})


def rolling(seed):
    """A slide of which a noisy velocity was recorded, 1 % of the largest, for 8 s."""
    rng = np.random.default_rng(seed)
    t = 1e-3 * np.arange(8000)
    tones, phases = np.array([6.0, 17.0, 2.3])[:, None] * t, rng.uniform(0.0, 6.0, 3)[:, None]
    u = np.array([20.0, 12.0, 6.0]) @ np.sin(tones + phases)
    v = open_loop(SLIDE, u, 1e-3, 20, np.zeros(NSTATES))[:-1, V]
    return dfc.Record(t, u, None, channels={"v": v + 5e-3 * rng.standard_normal(t.size)})


def near(found, true, most=0.02):
    """A fit within a relative error."""
    parameters = {name: found.parameters[name] for name in true}
    assert parameters == pytest.approx(true, rel=most)


def within(fits, true, most):
    """Every fit within a relative error, and intervals that cover as often as they say."""
    covered = []
    for found in fits:
        near(found, true, most)
        ends = found.interval(0.9)
        covered += [ends[name][0] <= value <= ends[name][1] for name, value in true.items()]
    # Of intervals of 90 %, more than three quarters: two standard deviations of this few.
    assert np.mean(covered) > 0.75


def test_a_free_decay_is_fitted_in_long_free_runs():
    axis = dfc.FrictionAxis(
        mass=PENDULUM.mass, viscous=1e-3, coulomb=2e-3, units=TURNING, stick_speed=1e-3,
        effects=(dfc.effects.Gravity(0.65),),
    )  # fmt: skip
    free = ("viscous", "coulomb", "gravity")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", dfc.FitWarning)  # twice the nominal level
        fits = [dfc.fit(axis, swinging(seed), free=free) for seed in SEEDS]
    true = {"viscous": 0.45e-3, "coulomb": 4.1e-3, "gravity.amplitude": 0.6927}
    within(fits, true, 0.02)
    # An eighth of the record each.
    assert len(fits[0].training[0].windows) == 8


@pytest.mark.parametrize("noise", [0.001, 0.005, 0.04])
def test_a_velocity_at_100_hz_is_enough(noise):
    """30 s in which the slide sticks a third of the time; noise in parts of the velocity's RMS."""
    axis = dfc.FrictionAxis(mass=1.7, viscous=17.0, coulomb=9.0)
    t, fits = 0.01 * np.arange(3000), []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        tones = np.array([1.3, 3.7, 9.1])[:, None] * t + rng.uniform(0.0, 6.0, 3)[:, None]
        u = np.array([14.0, 8.0, 5.0]) @ np.sin(tones)
        v = open_loop(SLIDE, u, 0.01, 200, np.zeros(NSTATES))[:-1, V]
        assert 0.2 < np.mean(np.abs(v) < 1e-3) < 0.6
        seen = v + noise * v.std() * rng.standard_normal(t.size)
        fits.append(dfc.fit(axis, dfc.Record(t, u, None, channels={"v": seen})))
        # It is noise of the readings: an integral would have made it a random force.
        assert fits[-1].random_force == (0.0,)
        assert fits[-1].reading_noise[0] == pytest.approx(noise * v.std(), rel=0.1)
    within(fits, {"mass": 2.0, "viscous": 15.0, "coulomb": 8.0}, 0.3 * noise)


@pytest.mark.parametrize(
    ("plant", "effect", "name", "true"),
    [
        (SLIDE._replace(load_fraction=0.4, coupling_stiffness=3000.0, coupling_damping=4.0),
         dfc.effects.Compliance(stiffness=2400.0, damping=4.0, load_fraction=0.4),
         "compliance.stiffness", 3000.0),
        (SLIDE._replace(presliding=1e-3), dfc.effects.Presliding(distance=8e-4),
         "presliding.distance", 1e-3),
    ],
)  # fmt: skip
def test_a_velocity_shows_inner_states(plant, effect, name, true):
    t, rng = 1e-3 * np.arange(6000), np.random.default_rng(2)
    u = np.array([14.0, 8.0, 5.0]) @ np.sin(np.array([1.3, 3.7, 9.1])[:, None] * t)
    v = open_loop(plant, u, 1e-3, 40, np.zeros(NSTATES))[:-1, V]
    seen = v + 0.01 * v.std() * rng.standard_normal(t.size)
    axis = dfc.FrictionAxis(mass=1.7, viscous=17.0, coulomb=9.0, effects=(effect,))
    free = ("mass", "viscous", "coulomb", name)
    found = dfc.fit(axis, dfc.Record(t, u, None, channels={"v": seen}), free)
    assert found.parameters[name] == pytest.approx(true, rel=0.01)
    assert found.parameters["mass"] == pytest.approx(2.0, rel=0.003)


def test_free_runs_of_a_slow_record_are_longer():
    """0.25 s would be four samples."""
    slow = rolling(0).decimated(60)
    found = dfc.fit(dfc.FrictionAxis(2.0, 15.0, 8.0), slow, free=("viscous",), starts=1)
    assert np.diff(found.training[0].windows.edges)[0] == 8


def test_a_position_beside_a_velocity_is_a_reading():
    t = 1e-3 * np.arange(2000)
    both = dfc.Record(t, np.cos(t), 1e-4 * np.round(1e4 * np.sin(3.0 * t)),
                      channels={"v": 3.0 * np.cos(3.0 * t)})  # fmt: skip
    assert rolling(0).integrated and not both.integrated and not swinging(0).integrated


@pytest.fixture(scope="module")
def followed():
    """A position servo of 60 N m/rad: command and reading, no torque."""
    t, none = 1e-3 * np.arange(10000), np.zeros(10000)
    tones = np.array([3.1, 7.7, 19.0])[:, None] * t + np.array([0.3, 1.0, 4.0])[:, None]
    command = np.array([0.6, 0.3, 0.1]) @ np.sin(tones)
    command -= command[0]
    counts = 2.0 * np.pi / 65536
    loop = (60.0, 0.0, 0.0, 1e-3, 1e9, counts, none, none, none, none)
    x = closed_loop(SERVO, command, 1e-3, 20, *loop)[1]
    return dfc.Record(t, None, x, command, units={"x": "rad"})


def test_a_servo_is_fitted_by_its_commands(followed):
    axis = dfc.FrictionAxis(mass=0.015, viscous=0.2, coulomb=0.7, units=TURNING, stick_speed=1e-3)
    true = {"mass": 0.02, "viscous": 0.3, "coulomb": 0.5}
    known = followed.commanded(60.0)
    assert known.notes == ("u is 60 (reference - x)",)
    near(dfc.fit(axis, known), true)

    # Without the gain all forces are known over it.
    unknown = followed.commanded()
    assert unknown.units["u"] == "rad" and "only in ratio" in unknown.notes[-1]
    with pytest.raises(ValueError, match="InputGain"):
        dfc.fit(axis, unknown)
    guessed = axis.replace(effects=(dfc.effects.InputGain(50.0),))
    near(dfc.fit(guessed, unknown), {name: 50.0 / 60.0 * value for name, value in true.items()})
    with pytest.warns(dfc.FitWarning, match=r"input_gain"):
        dfc.fit(guessed, unknown, free=("mass", "viscous", "coulomb", "input_gain"))


def test_a_servo_needs_its_commands(followed):
    with pytest.raises(ValueError, match="record has no reference: read the commands"):
        swinging(0).commanded()
    same = dfc.Record(followed.t, None, followed.x, followed.x)
    with pytest.raises(ValueError, match="give the commands"):
        same.commanded()
