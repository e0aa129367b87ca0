"""Diagnosis of records in which a random force acts beside the model."""

import numpy as np
import pytest
from diagnosis_cases import among, causes, driven

import dryfric_control as dfc
from dryfric_control.diagnosis.thresholds import EQUAL_EVIDENCE, MIN_EVIDENCE
from dryfric_control.estimation.likelihood import Likelihood, prepare
from dryfric_control.estimation.scoring import maximise

# The inputs have 3 % of the Coulomb level as noise.
AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
# Effects that scale forces, all of them or those against the load, and some that do not.
RIVALS = (
    "input_gain", "load_dependence", "load_asymmetry", "stribeck", "bias_force", "spring",
    "input_delay",
)  # fmt: skip


@pytest.mark.slow
def test_names_a_bias_in_noise():
    record = driven(AXIS.replace(effects=(dfc.effects.BiasForce(1.0),)), 6.0, 0.24, 1)
    with among(*RIVALS):
        biased = dfc.diagnose(AXIS, record, known=("mass",), jobs=1)
    assert causes(biased) == ["bias_force"]
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
@pytest.mark.parametrize("noise", [0.002, 0.02])
def test_names_causes_in_a_velocity(noise):
    """Read by an eccentric encoder; the pitch of the cogging is not its period."""
    t, rng = 5e-3 * np.arange(2000), np.random.default_rng(3)
    u = np.array([14.0, 8.0, 5.0]) @ np.sin(np.array([1.3, 3.7, 9.1])[:, None] * t)
    machine = AXIS.replace(effects=(dfc.effects.Cogging(2.0, 0.05),))
    x, v = machine.simulate(u, dt=5e-3).y[:2]
    v = v * (1.0 + 2e-4 * 2.0 * np.pi / 0.03 * np.cos(2.0 * np.pi * x / 0.03))
    seen = v + noise * v.std() * rng.standard_normal(t.size)
    with among("cogging", "eccentric_encoder", "compliance", "load_encoder_backlash", "stribeck"):
        record = dfc.Record(t, u, None, channels={"v": seen})
        d = dfc.diagnose(AXIS.replace(mass=2.2, coulomb=7.0), record, jobs=1)
    found = {cause.effect: cause.parameters for cause in d.causes}
    assert found.keys() == {"cogging", "eccentric_encoder", "inertia", "coulomb"}
    assert d.verdict == "explained"
    assert found["cogging"]["amplitude"] == pytest.approx(2.0, rel=0.01)
    assert found["eccentric_encoder"]["amplitude"] == pytest.approx(2e-4, rel=0.1)
    assert d.extended.mass == pytest.approx(2.0, rel=0.003)


@pytest.mark.slow
def test_finds_nothing_in_noise_alone():
    d = dfc.diagnose(AXIS, driven(AXIS, 6.0, 0.24, 2), jobs=1)
    assert (d.verdict, d.causes) == ("nothing to find", ())
    assert d.remaining.rms == pytest.approx(0.24, rel=0.3)


@pytest.mark.slow
def test_two_records_show_what_has_changed():
    records = [driven(AXIS, 6.0, 0.24, 3), driven(AXIS.replace(coulomb=9.6), 6.0, 0.24, 4)]
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
    t = 1e-3 * np.arange(4000)
    x = 4e-5 * np.sin(4.0 * t) + 1e-8 * np.random.default_rng(1).normal(size=t.size)
    with among("bias_force", "viscous_asymmetry"):
        d = dfc.diagnose(AXIS, dfc.Record(t, 4.0 * np.sin(4.0 * t), x), jobs=1)
    assert (d.verdict, d.causes) == ("unexplained", ())
    assert d.references["straight line"] < 0.0
    assert any("straight line" in message for message in d.messages)


def test_a_muted_mass_is_out_of_reach():
    """Whatever the record, a mass stays within a factor of 4 of the nominal one."""
    problem = Likelihood(AXIS, ("mass",), [prepare(driven(AXIS, 1.0, 0.24, 5))])
    z = problem.start()
    assert problem.axis_at(z + 50.0).mass > 1e3
    far = maximise(problem, z + 50.0, 0)
    assert far.axis.mass == pytest.approx(4.0 * AXIS.mass)
    assert far.at_bound == ("mass",)


def test_nominal_values_are_trusted_together_or_not():
    run = prepare(driven(AXIS, 1.0, 0.24, 5))
    problem = Likelihood(AXIS, ("mass", "viscous", "coulomb"), [run], wonder=True)
    start = problem.start()

    def at(*factors: float) -> np.ndarray:
        values = np.array(factors) * [AXIS.mass, AXIS.viscous, AXIS.coulomb.mean]
        off = [p.search(v) for p, v in zip(problem.parameters, values, strict=True)]
        return np.concatenate((off, start[3:]))

    assert problem.prior(at(1.0, 1.0, 1.0)) == pytest.approx(0.0)
    alike, apart = problem.prior(at(1.2, 1.2, 1.2)), problem.prior(at(1.2, 1.2, 0.8))
    # A gain scales all three: one cause instead, but for the value that stays wrong beside it.
    assert alike > MIN_EVIDENCE + EQUAL_EVIDENCE
    assert apart < MIN_EVIDENCE + problem.prior(at(1.0, 1.0, 0.8 / 1.2))
    assert problem.prior(at(1.2, 1.0, 1.0)) < MIN_EVIDENCE + EQUAL_EVIDENCE < apart
    for z in (at(1.01, 0.98, 1.0), at(1.1, 1.0, 0.97), at(1.2, 1.2, 0.8)):
        slopes = [
            (problem.prior(z + step) - problem.prior(z - step)) / 2e-6
            for step in 1e-6 * np.eye(z.size)
        ]  # fmt: skip
        np.testing.assert_allclose(problem.prior_terms(z)[1], slopes, rtol=1e-5, atol=1e-6)


@pytest.mark.slow
def test_a_gain_beside_which_another_value_is_wrong_is_none():
    believed = AXIS.replace(mass=0.8 * AXIS.mass, viscous=0.8 * AXIS.viscous)
    believed = believed.replace(coulomb=AXIS.coulomb.scaled(1.2))
    with among("input_gain", "load_dependence"):
        d = dfc.diagnose(believed, driven(AXIS, 6.0, 0.24, 5), jobs=1)
    assert sorted(causes(d)) == ["coulomb", "inertia", "viscous"], str(d)
    told = {cause.effect: cause.alternatives for cause in d.causes}
    assert told["inertia"][0] == told["viscous"][0] == "input_gain+coulomb"
