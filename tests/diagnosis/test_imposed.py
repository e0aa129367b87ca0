"""Records that a likelihood of the readings cannot judge: imposed motion, inputs stamped late."""

from dataclasses import dataclass

import numpy as np
import pytest
import truth
from diagnosis_cases import among, believed, causes, record

import dryfric_control as dfc
from dryfric_control.estimation.force_view import ForceView, prepare_force
from dryfric_control.estimation.likelihood import Likelihood, prepare


def walked(
    level: float, cogging: float = 0.0, seed: int = 0, soft: float = 0.0, seconds: float = 40.0,
    round_: float = 0.0,
) -> dfc.Record:  # fmt: skip
    """An axis that a bench walks to and fro; its force is measured, with noise of 0.1 N.

    After a turn the friction builds up over twice the way `soft`, or as an exponential of the
    length `round_`; it slides at the start.
    """
    rng = np.random.default_rng(seed)
    t = 1e-2 * np.arange(round(100.0 * seconds))
    phase = t / 8.0 % 1.0
    x = 0.04 * np.where(phase < 0.5, 2.0 * phase, 2.0 - 2.0 * phase)
    since = np.where(phase < 0.5, x, 0.04 - x)  # way since the last turn
    part = np.where(t < 4.0, 1.0, np.minimum(since / soft - 1.0, 1.0)) if soft else 1.0
    if round_:
        part = 1.0 - 2.0 * np.exp(-since / round_) * (t > 4.0)
    u = level * part * np.where(phase < 0.5, 1.0, -1.0) + cogging * np.sin(2.0 * np.pi * x / 7e-3)
    u += 0.1 * rng.standard_normal(t.size)
    return dfc.Record(t, u, 4e-6 * np.round(x / 4e-6), quantum=4e-6)


def arm(seed: int) -> dfc.Record:
    """A vertical arm that a tight loop turns to and fro at 0.35 rad/s; its torque is noisy."""
    rng = np.random.default_rng(seed)
    t = 1.5e-2 * np.arange(1600)
    v = 0.35 * np.clip(4.0 * np.sin(2.0 * np.pi * t / 12.0), -1.0, 1.0)
    q = 1.5e-2 * np.cumsum(v) + 3e-5 * rng.standard_normal(t.size)
    u = 2.5 * np.gradient(v, t) + 3.0 * v + 9.0 * np.sign(v) + 38.0 * np.sin(q)
    units = {"u": "N m", "x": "rad"}
    return dfc.Record(t, u + rng.standard_normal(t.size), q, units=units, quantum=0)


AXIS = dfc.FrictionAxis(mass=1.0, viscous=0.0, coulomb=7.0)


def asked(records: dfc.Record | list[dfc.Record]) -> dfc.Diagnosis:
    return dfc.diagnose(AXIS, records, known=("mass",), hold="first", jobs=1, progress=False)


@pytest.mark.slow
def test_gravity_of_an_arm_that_a_tight_loop_turns() -> None:
    # A model that mutes its drive foresees as well as a straight line: a limit far below it.
    axis = dfc.FrictionAxis(mass=2.5, viscous=3.0, coulomb=9.0, units=("rad", "N m"))
    d = dfc.diagnose(axis, arm(1), known=("mass",), hold="first", progress=False)
    assert [cause.effect for cause in d.main_causes] == ["gravity"]
    assert d.causes[0].parameters["amplitude"] == pytest.approx(38.0, rel=0.02)
    assert any("the motion is imposed" in message for message in d.messages)


@pytest.mark.long
def test_level_of_each_record_is_found_where_a_bench_makes_the_motion() -> None:
    # A straight line foresees such readings better than any axis: all would be muted.
    levels = (5.4, 7.3, 8.8)
    d = asked([walked(f, seed=i, seconds=12.0) for i, f in enumerate(levels)])
    assert d.varies["coulomb"]["values"] == pytest.approx(levels, rel=0.02)
    assert d.causes == ()
    assert any("the motion is imposed" in message for message in d.messages)
    assert d.gain.unit == "N" and d.gain.after == pytest.approx(0.1, rel=0.05)
    assert "force that the motion needs" in d.summary()


@pytest.mark.parametrize("gain", [0.5, 2.0])
def test_innovations_are_in_units_of_the_drive(gain: float) -> None:
    """A drive recorded 0.3 too large is off by as much, whatever the gain behind it."""
    one, axis = walked(7.0), AXIS.replace(effects=(dfc.effects.InputGain(gain),))
    view = ForceView(axis, (), [prepare_force(one.replace(u=one.u / gain + 0.3), "first")])
    innovations, variances = view.innovations(view.start(), 0)[0]
    assert np.mean(innovations[variances > 0.0]) == pytest.approx(-0.3, abs=0.02)


@dataclass(frozen=True)
class Settled(dfc.effects.WarmUp):
    """Friction that the past changes."""

    slug = title = "settled"
    remembers = True


@pytest.mark.slow
def test_cogging_is_found_where_a_bench_makes_the_motion() -> None:
    with among("cogging", "time_periodic", "spring", "presliding", "backlash", "saturation"):
        dfc.effects.register_effect(Settled)
        d = asked(walked(7.0, 1.5, seconds=24.0))
    assert causes(d) == ["cogging"]
    # What an effect remembers is not in the motion, but for the strain of a contact.
    assert "presliding" in d.scores and "settled" not in d.scores
    assert d.causes[0].parameters["amplitude"] == pytest.approx(1.5, rel=0.02)
    assert d.causes[0].parameters["period"] == pytest.approx(7e-3, rel=1e-3)
    assert d.verdict == "explained"


def test_a_contact_that_no_steps_can_follow_ends():
    # As a fit tries it; its bristles would take a thousand million steps in one sample.
    record = walked(7.0, 1.5, seconds=24.0)[:60]
    cogging = dfc.effects.Cogging(1.4917816691989847, 0.007000139289450311, 3.1395715262322716)
    contact = dfc.effects.Presliding(
        1.2644839613155417e-06, damping=447.4578554216601, bristles=1.0
    )
    axis = AXIS.replace(viscous=40.1840101707535, coulomb=8.745991912097248)
    axis = axis.replace(effects=(cogging, contact))
    problem = Likelihood(axis, ("viscous", "coulomb"), [prepare(record)], hold="first")
    z = problem.start()
    z[2:] = -6.810125899255679, -27.771663445731015
    assert problem.tried(z).cost > 0.0


@pytest.mark.long
def test_a_soft_contact_is_found_where_a_bench_makes_the_motion() -> None:
    # Without it the force after a turn would pass for viscous friction or a falling level.
    with among("presliding", "stribeck_asymmetry", "warm_up", "spring", "backlash", "drift"):
        d = asked(walked(7.0, soft=1.5e-3, seconds=24.0))
    assert causes(d) == ["presliding"]
    assert d.causes[0].parameters["distance"] == pytest.approx(1.5e-3, rel=0.05)
    assert d.extended.coulomb.plus[0] == pytest.approx(7.0, rel=0.01)
    assert d.verdict == "explained"


@pytest.mark.slow
def test_friction_that_builds_up_after_a_turn_is_not_taken_for_viscous() -> None:
    # A bench turns round through small velocities, and only there would viscous friction show.
    levels = (5.4, 8.8)
    with among("bias_force", "presliding", "velocity_strengthening", "spring", "cogging"):
        d = asked([walked(f, seed=i, round_=1.5e-3, seconds=24.0) for i, f in enumerate(levels)])
    assert d.varies["coulomb"]["values"] == pytest.approx(levels, rel=0.03)
    assert {*causes(d)} <= {"presliding"}
    assert d.extended.viscous == 0.0
    assert any("nearly one velocity" in message for message in d.messages)


@pytest.mark.long
def test_a_level_that_grows_is_not_put_down_to_the_load() -> None:
    # The drive balances the friction, so that the friction follows its own load.
    records = []
    for i, level in enumerate((5.4, 8.8)):
        one = walked(level, seed=i, round_=1.5e-3)
        less = -0.15 * np.exp(-one.t / 15.0) * level * np.sign(np.gradient(one.x))
        records.append(one.replace(u=one.u + less))
    with among("warm_up", "load_dependence", "load_asymmetry", "bias_force", "spring"):
        d = asked(records)
    assert [cause.effect for cause in d.main_causes] == ["warm_up"]
    assert "spring" in d.scores and not {"load_dependence", "load_asymmetry"} & set(d.scores)
    assert d.causes[0].parameters["rise"] == pytest.approx(-0.15, abs=0.02)
    assert d.varies["coulomb"]["values"] == pytest.approx((5.4, 8.8), rel=0.02)


@pytest.mark.long
def test_a_spring_beside_a_force_of_each_record_has_no_rest_of_its_own() -> None:
    walks = (walked(5.4, seed=0), 0.5), (walked(8.8, seed=1), -1.0)
    with among("bias_force", "spring", "presliding", "cogging"):
        d = asked([r.replace(u=r.u + force + 40.0 * r.x) for r, force in walks])
    assert causes(d) == ["spring"]
    assert d.causes[0].parameters == {"stiffness": pytest.approx(40.0, rel=0.05)}
    forces = d.varies["bias_force.force"]
    apart = forces["values"][1] - forces["values"][0]
    assert abs(apart) == pytest.approx(1.5, rel=0.05)
    assert max(forces["standard_errors"]) < 0.1


@pytest.mark.slow
def test_input_that_is_stamped_late_is_found_and_shifted() -> None:
    case = truth.make_case("coulomb_asymmetry", 3, "short")
    good, late = record(case), 3
    u = np.concatenate((np.full(late, good.u[0]), good.u[:-late]))
    rng = np.random.default_rng(1)
    u += 0.02 * believed(case).coulomb.plus[0] * rng.standard_normal(u.size)
    with among("coulomb_asymmetry", "bias_force", "input_delay", "actuator_lag", "presliding"):
        d = dfc.diagnose(believed(case), dfc.Record(good.t, u, good.x), jobs=1, progress=False)
    assert causes(d) == ["coulomb_asymmetry"]
    [told] = [m for m in d.messages if m.startswith("the recorded input acts")]
    # Within three standard errors of 0.0144 ms.  A part of a sample averages the noise of the
    # input, for which 0.03 ms too much are likelier; without noise it is 3.00 ms.
    assert float(told.split()[4]) == pytest.approx(late, abs=0.05) and told.split()[5] == "ms"
    # d.record has it shifted back, but for its noise.
    assert np.std(d.record.u[:-10] - good.u[:-10]) < 0.35 * np.std(u[:-10] - good.u[:-10])


def three_sines(t: float) -> float:
    """A drive of three frequencies [N]."""
    return float(9.0 * np.sin(1.9 * t) + 6.0 * np.sin(5.7 * t + 1.0) + 4.0 * np.sin(13.2 * t + 2.0))


def small_steps(part: float, pitch: float = 0.02, dt: float = 2e-3, n: int = 3000) -> dfc.Record:
    """2 kg, 15 N s/m, 5 N and 1.2 N of cogging in small steps; the held drive is stamped late.

    `part`: by how much of a sample.
    """
    few = 20
    h = dt / few
    x = v = 0.0
    readings = np.empty(n)
    drives = [three_sines(k * dt) for k in range(n + 1)]
    for k in range(n):
        readings[k] = x
        for j in range(few):
            drive = drives[k + (j >= (1.0 - part) * few)]
            force = drive + 1.2 * np.sin(2.0 * np.pi * x / pitch) - 15.0 * v
            way = np.sign(v) if v else np.sign(force) * (abs(force) > 5.0)
            change = h * (force - 5.0 * way) / 2.0 if way else 0.0
            turned = v * (v + change) < 0.0
            x += h * (v if turned else v + 0.5 * change) * (0.5 if turned else 1.0)
            v = 0.0 if turned else v + change
    return dfc.Record(dt * np.arange(n), drives[:n], 1e-6 * np.round(readings / 1e-6))


@pytest.mark.slow
@pytest.mark.parametrize("part", [0.5, 1.0])
def test_a_late_stamp_of_a_few_sines_is_no_force_that_is_periodic_in_time(part) -> None:
    """What a drive of a few frequencies lacks where it is stamped late has just these."""
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=5.0)
    with among("cogging", "time_periodic", "input_delay", "bias_force"):
        d = dfc.diagnose(axis, small_steps(part), jobs=1, progress=False)
    assert causes(d) == ["cogging"]
    [told] = [m for m in d.messages if m.startswith("the recorded input acts")]
    assert float(told.split()[4]) == pytest.approx(part * 2.0, abs=0.1) and told.split()[5] == "ms"
