"""Pairs of causes that one record cannot tell apart, and the experiment that can."""

import json
import re
from types import SimpleNamespace

import control as ct
import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control.compiled.axis_step import TooManySwitchesError
from dryfric_control.diagnosis.causes import equivalent_axis as scaled_rival
from dryfric_control.diagnosis.causes import scale_forces
from dryfric_control.diagnosis.excitations import EXCITATIONS, Limits, Stage
from dryfric_control.diagnosis.experiment import Experiment, next_experiment
from dryfric_control.estimation.windows import cut

DT, QUANTUM = 1e-3, 1e-6
#: What the drive of a machine that has only been moved gently can do.
WIDE = Limits(travel=(-0.2, 0.2), drive=40.0, speed=0.6)
pytestmark = pytest.mark.filterwarnings("ignore::dryfric_control.RecordWarning")


def axis(*effects, **changes):
    base = dict(mass=2.0, viscous=15.0, coulomb=8.0, travel=(-0.2, 0.2), effects=effects)
    return dfc.FrictionAxis(**(base | changes))


def recorded(machine, reference, quantum=QUANTUM, v0=0.0, gains=None):
    """A closed-loop record of a machine."""
    loop = gains or dfc.PositionController.from_bandwidth(machine.effective(), 20.0, DT, 60.0)
    run = dfc.simulate_loop(machine, loop, reference, quantum, float(reference[0]), v0)
    return dfc.Record(DT * np.arange(reference.size), run.y[4], run.y[5], quantum=quantum)


def sine(amplitude, frequency, n=8000):
    return amplitude * np.sin(2.0 * np.pi * frequency * DT * np.arange(n))


def jumps(n=8000, seed=0):
    return np.repeat(np.random.default_rng(seed).uniform(-0.05, 0.05, n // 500), 500)


def worst(model, record):
    """Errors of free runs, a line of each window left out, in quanta: the middle one."""
    windows = cut(record)
    errors = (windows.run(model) - record.x)[: 250 * (len(record) // 250)].reshape(-1, 250)
    line = np.vander(np.arange(250.0), 2)
    left = errors.T - line @ np.linalg.lstsq(line, errors.T, rcond=None)[0]
    return float(np.sqrt(np.median(np.mean(left**2, axis=0))) / (record.quantum or 1.0))


def pair(machine, rival, reference, limits=None, **loop):
    """A machine, its rival, a record of the machine, and limits."""
    return machine, rival, recorded(machine, reference, **loop), limits


def cogging_or_time():
    speed = 0.1
    machine = axis(dfc.effects.Cogging(amplitude=0.3, period=0.005))
    record = recorded(machine, -0.16 + speed * DT * np.arange(3000), v0=speed)
    rivals = [
        axis(dfc.effects.TimePeriodic(amplitude=0.3, frequency=speed / 0.005, phase=phase))
        for phase in np.linspace(0.0, 2.0 * np.pi, 65)
    ]
    return machine, min(rivals, key=lambda one: worst(one, record)), record, None


BIASED, UNEVEN = axis(dfc.effects.BiasForce(2.0)), axis(dfc.effects.CoulombAsymmetry(-2.0))
EASED = np.clip(np.arange(500) / 300, 0.0, 1.0)
WAY = 0.05 * EASED**3 * (10.0 - 15.0 * EASED + 6.0 * EASED**2)
FAR = dict(travel=(-1.5, 1.5))
PAIRS = {
    ("dead_zone", "coulomb"): lambda: pair(
        axis(dfc.effects.DeadZone(width=2.0)), axis(coulomb=10.0), sine(0.05, 0.4), WIDE),
    ("input_gain", "load_dependence"): lambda: pair(
        axis(dfc.effects.InputGain(0.85)), axis(dfc.effects.LoadDependence(0.15)),
        sine(0.05, 0.4), WIDE),
    # u 0.8 = 0.8 (2.5 a + 15 v + 8 s): the same motion from the same drive.
    ("inertia", "input_gain"): lambda: pair(
        axis(dfc.effects.Inertia(factor=1.25)),
        axis(dfc.effects.InputGain(gain=0.8), viscous=12.0, coulomb=6.4), jumps()),
    ("spring", "gravity"): lambda: pair(
        axis(dfc.effects.Spring(6.0), **FAR), axis(dfc.effects.Gravity(6.0), **FAR),
        sine(0.1, 1.0)),
    ("input_delay", "actuator_lag"): lambda: pair(
        axis(dfc.effects.InputDelay(3e-3)), axis(dfc.effects.ActuatorLag(3e-3)),
        sine(0.05, 0.8), WIDE, quantum=2e-6),
    # All rests are longer than five time constants: as good as endless.
    ("stribeck", "dwell_time"): lambda: pair(
        axis(stribeck=dfc.Stribeck(excess=0.3, speed=5e-5)),
        axis(dfc.effects.DwellTime(rise=2.4, time_constant=0.05)),
        np.tile(np.concatenate((WAY, 0.05 - WAY)), 8), quantum=5e-6,
        gains=dfc.PositionController(kp=2000.0, ki=0.0, kd=60.0, dt=DT)),
    ("cogging", "time_periodic"): cogging_or_time,
}  # fmt: skip


@pytest.fixture(scope="module", params=PAIRS, ids="-".join)
def found(request):
    machine, rival, record, limits = PAIRS[request.param]()
    experiment = next_experiment(machine, [rival], record, names=request.param, limits=limits)
    return request.param, machine, rival, record, limits, experiment


def test_the_experiment_separates_what_the_record_does_not(found):
    """Several quanta even after the rival's refit, and more than the set does in the middle."""
    names, machine, rival, record, _, experiment = found
    # Free runs of the rival are as close to the record as the truth's, to 1.5 quanta.
    assert worst(rival, record) < worst(machine, record) + 1.5
    assert isinstance(experiment, Experiment)
    assert (experiment.cause, experiment.separates) == (names[0], names[1:])
    assert experiment.score[names[1]] > max(5.0, np.median([*experiment.tried.values()]))
    if names == ("inertia", "input_gain"):
        assert experiment.name in ("added_mass", "known_force")
        # Without them the two are one law, apart by round-off alone.
        plain = {e.name for e in EXCITATIONS if e.change is None} & set(experiment.tried)
        assert len(plain) > 5
        assert max(experiment.tried[name] for name in plain) < 1e-3


def test_travel_speed_and_drive_stay_within_limits(found):
    names, machine, rival, record, limits, experiment = found
    limits = limits or Limits.from_record(machine, record)
    assert limits.drive <= 40.0 or limits.drive == np.abs(record.u).max()
    for name in names:
        x = experiment.positions[name]
        assert limits.travel[0] <= x.min() and x.max() <= limits.travel[1]
        # Mean speed over a sample is not above the largest inside it.
        assert np.abs(np.diff(x)).max() <= limits.speed * DT * (1.0 + 1e-9)
        # The drive is a sum of two numbers that are limited by a difference.
        assert np.abs(experiment.drives[name]).max() <= limits.drive * (1.0 + 1e-12)


def test_the_predictions_are_those_of_the_hypotheses(found):
    """An open-loop run on the predicted drive moves as predicted, and the rival does not."""
    names, machine, rival, record, limits, experiment = found
    change = next(e.change for e in EXCITATIONS if e.name == experiment.name)
    if change is not None:
        stage = Stage(machine, limits or Limits.from_record(machine, record), DT)
        machine, rival = change(stage, machine), change(stage, rival)
    x = experiment.positions[names[0]]
    drive = experiment.drives[names[0]]
    own, other = (one.simulate(drive, DT, x0=float(x[0])).y[0] for one in (machine, rival))
    np.testing.assert_allclose(own, x, atol=1e-9)
    assert np.abs(other - x).max() > 5.0 * record.quantum


def test_equal_causes_ask_for_a_change_of_the_bench():
    """F = s Fc + b and levels Fc + s b are one law: no motion, mass or force parts them."""
    record = recorded(BIASED, jumps())
    experiment = next_experiment(BIASED, [UNEVEN], record)
    assert experiment.name == "change_of_bench"
    assert (experiment.cause, experiment.separates) == ("bias_force", ())
    assert experiment.score == {"coulomb_asymmetry": 0.0}
    assert "tilt" in experiment.description
    assert experiment.t.size == 0
    # The bench changes that the set holds were tried as well.
    assert {"added_mass", "known_force"} <= set(experiment.tried)
    with pytest.raises(ValueError, match="no reference"):
        experiment.to_csv("nowhere.csv")
    assert isinstance(experiment.plot(), ct.ControlPlot)
    # What can be parted is parted; what cannot is named as open, with score 0.
    spring = axis(dfc.effects.Spring(stiffness=40.0, rest=0.05))
    experiment = next_experiment(BIASED, [UNEVEN, spring], record)
    assert experiment.separates == ("spring",)
    assert experiment.score["coulomb_asymmetry"] == 0.0
    assert "Coulomb asymmetry open" in experiment.summary()


SPRUNG = axis(
    dfc.effects.InputGain(gain=1.25), dfc.effects.Spring(stiffness=40.0, rest=0.05),
    dfc.effects.Presliding(distance=40e-6), dfc.effects.WarmUp(rise=0.3, time_constant=2.0),
    coulomb=dfc.CoulombMap(plus=[8.0, 3.0], minus=[7.0]), stribeck=dfc.Stribeck(0.3, 0.01),
)  # fmt: skip


@pytest.mark.parametrize("scale", [0.8, 2.0])
def test_all_forces_scaled_with_the_gain_move_alike(scale):
    """m a = g u - F is m a / c = (g / c) u - F / c."""
    other = scale_forces(SPRUNG, scale)
    left = [e.slug for e in SPRUNG.effects][scale == 0.8 :]  # 0.8 is the inverse of the gain
    assert [e.slug for e in other.effects] == left
    assert other.mass == scale * SPRUNG.mass
    u = 30.0 * np.sin(6.0 * DT * np.arange(4000))
    x, y = (one.simulate(u, DT).y[0] for one in (SPRUNG, other))
    assert np.abs(x).max() > 0.01
    np.testing.assert_allclose(x, y, rtol=0, atol=1e-12)


def cause(effect, alternative, **parameters):
    return SimpleNamespace(effect=effect, parameters=parameters, alternatives=(alternative,))


@pytest.mark.parametrize(
    ("machine", "found"),
    [
        (axis(dfc.effects.InputGain(gain=1.25)),
         cause("input_gain", "inertia+viscous+coulomb", gain=1.25)),
        (axis(mass=1.6, viscous=12.0, coulomb=6.4),
         cause("inertia", "input_gain+viscous", mass=1.6)),
    ],
)  # fmt: skip
def test_a_gain_and_the_base_are_separated_by_what_is_added(machine, found):
    """No fit of the other exists: it is the same axis scaled, and no motion separates it."""
    record = recorded(machine, jumps())
    other, *names = scaled_rival(machine, axis(), [found])
    assert names == [found.effect, *found.alternatives]
    experiment = next_experiment(machine, [other], record, names=names)
    assert experiment.name in ("added_mass", "known_force")
    assert experiment.separates == found.alternatives
    # Nothing is offered where a dead zone may come before or behind the gain.
    behind = machine.replace(effects=(*machine.effects, dfc.effects.DeadZone(width=1.0)))
    assert scaled_rival(behind, axis(), [found]) is None


def test_what_a_refit_takes_away_is_no_difference():
    """A viscous coefficient that the slow record leaves open may not part equal laws."""
    rival, record = UNEVEN.replace(viscous=15.3), recorded(BIASED, sine(0.002, 0.2))
    experiment = next_experiment(BIASED, [rival], record, limits=WIDE)
    assert np.median([*experiment.tried.values()]) > 5.0
    assert (experiment.name, experiment.separates) == ("change_of_bench", ())


def test_presliding_against_backlash_and_compliance():
    """Structural hypotheses run with their inner states."""
    machine = axis(dfc.effects.Presliding(distance=40e-6))
    rivals = [
        axis(dfc.effects.Backlash(gap=40e-6, load_fraction=0.5)),
        axis(dfc.effects.Compliance(stiffness=2e5, damping=60.0, load_fraction=0.5)),
    ]
    experiment = next_experiment(machine, rivals, recorded(machine, jumps(3000)))
    assert set(experiment.separates) == {"backlash", "compliance"}


def test_limits_that_no_experiment_keeps_are_told():
    """A bias of 2 N cannot be held by a drive of 0.1 N: every run would leave the travel."""
    machine = axis(dfc.effects.BiasForce(force=2.0), coulomb=1.0)
    rival = axis(dfc.effects.Spring(stiffness=10.0, rest=0.2), coulomb=1.0)
    limits = Limits(travel=(-0.2, 0.2), drive=0.1, speed=0.6)
    experiment = next_experiment(machine, [rival], recorded(machine, jumps(2000)), limits=limits)
    assert (experiment.tried, experiment.separates) == ({}, ())
    assert "widen them" in experiment.description


def test_a_hypothesis_with_which_the_loop_runs_away_is_no_error(monkeypatch):
    """Its trial cannot be simulated: too many switches in a sample."""
    machine, rival, record, limits = PAIRS["input_delay", "actuator_lag"]()

    def runs_away(*args):
        raise TooManySwitchesError

    monkeypatch.setattr("dryfric_control.diagnosis.simulated_trial.simulate", runs_away)
    assert next_experiment(machine, [rival], record, limits=limits).tried == {}
    # A single cause needs no experiment.
    assert next_experiment(machine, [], record) is None


def test_report_file_and_figure(tmp_path):
    names = ("dead_zone", "coulomb")
    machine, rival, record, limits = PAIRS[names]()
    experiment = next_experiment(machine, [rival], record, names=names, limits=limits)
    assert "dead zone from Coulomb level error" in experiment.summary()
    json.dumps(experiment.to_dict())
    experiment.to_csv(tmp_path / "next.csv")
    rows = np.genfromtxt(tmp_path / "next.csv", delimiter=",", names=True)
    assert rows.dtype.names[:2] == ("t", "reference")
    # Nine digits are written.
    np.testing.assert_allclose(rows["reference"], experiment.reference, rtol=1e-8, atol=1e-12)
    plot = experiment.plot()
    assert isinstance(plot, ct.ControlPlot)
    assert "[m]" in np.ravel(plot.axes)[0].get_ylabel()


def test_limits_are_where_the_message_says() -> None:
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=5.0)
    t = 1e-3 * np.arange(2000)
    record = dfc.Record(t, np.sin(9.0 * t), np.cos(9.0 * t))
    with pytest.raises(ValueError, match=r"dfc\.diagnosis\.Limits\(travel=") as refused:
        dfc.next_experiment(axis, [axis], record, limits={"travel": (0.0, 1.0)})  # type: ignore
    name = re.search(r"dfc\.diagnosis\.(\w+)", str(refused.value))
    assert name and hasattr(dfc.diagnosis, name[1])
