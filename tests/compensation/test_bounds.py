"""Certificates read laws over all time, load and place, and within the axis' own limits."""

from collections import Counter
from dataclasses import dataclass

import numpy as np
import pytest
import tube_attack

import dryfric_control as dfc
from dryfric_control import effects as fx

DT, QUANTUM = 1e-3, 1e-6
AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, travel=(-0.1, 0.1))


def design(*effects, **options):
    return dfc.design_compensation(AXIS.replace(effects=effects), DT, QUANTUM, **options)


def there_and_back(dwell=0.3, velocity=0.1):
    return dfc.motion_profile(
        [0.0, 0.02, 0.0], DT, velocity=velocity, acceleration=20.0 * velocity,
        jerk=800.0 * velocity, dwell=dwell,
    )  # fmt: skip


def error_and_tube(comp, move, plant=None):
    run = dfc.simulate_loop(plant or comp.axis, comp.controller, move, quantum=QUANTUM)
    error = np.abs(move.position - run.y[0]).max()
    return error, comp.certify(reference=move).tube


# At 3 Hz the drive was held at rest while the force went on; at 200 Hz what is fed forward a
# sample early adds to the force.  At mismatch 0 nothing else is left.
@pytest.mark.parametrize(("amplitude", "frequency"), [(5.0, 50.0), (40.0, 3.0), (20.0, 200.0)])
@pytest.mark.parametrize("mismatch", [0.0, 0.2])
def test_a_force_periodic_in_time_stays_in_the_tube(amplitude, frequency, mismatch):
    comp = design(fx.TimePeriodic(amplitude, frequency, 1.0), mismatch=mismatch)
    error, tube = error_and_tube(comp, there_and_back())
    assert error <= tube < 5e-3


@pytest.mark.parametrize("effect", [fx.Spring(2000.0, -0.04), fx.Gravity(60.0, 0.5 * np.pi)])
def test_a_late_drive_lets_go_of_an_axis_at_the_start(effect):
    """60 to 80 N against 8 N of friction, before the drive that holds them has arrived."""
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, effects=(effect,))
    comp = dfc.design_compensation(axis, DT, QUANTUM, 2.0 * DT, mismatch=0.0)
    late = axis.replace(effects=(effect, fx.InputDelay(2.0 * DT)))
    move = dfc.motion_profile([0.0, 2e-4, 0.0], DT, velocity=5e-4, acceleration=0.02, jerk=2.0)
    certificate = comp.certify(reference=move)
    run = dfc.simulate_loop(late, comp.controller, move, QUANTUM)
    error = np.abs(run.y[0] - move.position).max()
    # Without what happens at the start the error is beyond the tube.
    assert certificate.tube - certificate.parts["start"] < error <= certificate.tube


def test_a_held_drive_goes_on_with_a_force_that_is_known():
    """40 N at 3 Hz against 8 N of friction: the axis rests, as the drive follows the force."""
    comp = design(fx.TimePeriodic(40.0, 3.0, 1.0))
    run = dfc.simulate_loop(comp.axis, comp.controller, there_and_back(dwell=1.0), QUANTUM)
    rest = slice(-500, None)
    # A sample's change, 0.8 N, is far below friction.
    assert np.ptp(run.y[4, rest]) > 60.0 and np.ptp(run.y[0, rest]) == 0.0


@pytest.mark.parametrize(
    ("effects", "mismatch"),
    [
        ((fx.LoadDependence(0.47),), 0.0), ((fx.LoadDependence(0.2),), 0.2),
        ((fx.LoadAsymmetry(-0.28),), 0.0), ((fx.LoadDependence(0.2), fx.BiasForce(3.65)), 0.0),
        ((fx.DwellTime(4.0, 0.05),), 0.0), ((fx.VelocityStrengthening(0.6, 0.02),), 0.0),
        ((fx.StribeckAsymmetry(0.4, 5e-3),), 0.0), ((fx.WarmUp(0.8, 0.2),), 0.0), ((), 0.0),
    ],
    ids=str,
)  # fmt: skip
def test_levels_of_load_rest_velocity_and_time_stay_in_the_tube(effects, mismatch):
    comp = design(*effects, mismatch=mismatch)
    for velocity in (0.1, 0.005):
        error, tube = error_and_tube(comp, there_and_back(velocity=velocity))
        assert error <= tube < 5e-4


def test_the_level_fed_forward_is_that_under_the_drive_itself():
    """F = L + c u with u = f v + F: both by hand, at a constant velocity without an error."""
    share, v = 0.4, 0.05
    comp = design(fx.LoadDependence(share), law="fixed")
    stepper, at = comp.controller.stepper(), comp.block().state_labels.index("compensation")
    for k in range(200):
        stepper.step(v * DT * (k + comp.lead), v, 0.0, v * DT * k)
    drive = 15.0 * v + stepper._memory[at]
    assert drive == pytest.approx((15.0 * v + 8.0) / (1.0 - share), rel=1e-9)


@pytest.mark.parametrize("frequency", [0.4, 10.0, 50.0, 100.0])
def test_no_multiple_of_a_reading_time_hides_a_force(frequency):
    certificate = design(fx.TimePeriodic(40.0, frequency), limit=200.0).certificate
    (failed,) = (one for one in certificate.conditions if not one.holds)
    assert "change by 80 of" in failed.detail and not certificate.no_hunting
    assert certificate.drive_needed > 40.0


def test_no_pitch_hides_between_places():
    """Cogging whose period is the distance of 400 places on the travel."""
    comp = design(fx.Cogging(3.0, 5e-4))
    error, tube = error_and_tube(comp, there_and_back())
    # 3 N over 5 mm, ten times as long, are a tenth as steep.
    _, wide = error_and_tube(design(fx.Cogging(3.0, 5e-3)), there_and_back())
    assert error <= tube < np.inf and tube > 1.5 * wide


def test_growth_with_rest_does_not_end_a_rest_and_a_fall_with_time_may():
    assert design(fx.DwellTime(4.0, 0.05)).certificate.no_hunting
    assert not design(fx.WarmUp(0.8, 5.0)).certificate.no_hunting
    assert not design(fx.Drift(-0.01)).certificate.no_hunting
    drifting = design(fx.Drift(0.02))
    assert drifting.certificate.tube == np.inf and "over time" in drifting.certificate.reasons[0]
    assert drifting.certify(reference=there_and_back()).tube < np.inf


def test_the_limit_of_the_axis_itself_counts_as_one_of_the_drive():
    plain = design().certify(reference=there_and_back())
    for limit in (0.99 * plain.drive_needed, 1.01 * plain.drive_needed):
        comp = design(fx.Saturation(0.5 * limit), fx.InputGain(2.0))
        certificate = comp.certify(reference=there_and_back())
        assert certificate.limit == pytest.approx(limit)
        assert bool(certificate.tube < np.inf) is bool(limit > plain.drive_needed)
    weak = design(fx.BiasForce(-20.0), fx.Saturation(20.0)).certificate
    failed = [one.name for one in weak.conditions if not one.holds]
    assert failed == ["the drive can give the force that it holds"]


@dataclass(frozen=True)
class Pull(fx.Effect):
    """A force that the package knows nothing of."""

    strength: float = fx.parameter("N", "pull at x = 0")
    slug = "pull"
    action = "force"

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):
        return p[0] * x


@dataclass(frozen=True)
class BoundedPull(Pull):
    """The same with bounds."""

    slug = "bounded_pull"

    def bounds(self, box):
        return self.strength * box.x


def test_an_effect_without_bounds_is_not_covered_by_any_statement():
    certificate = design(Pull(20.0)).certificate
    assert certificate.tube == np.inf and not certificate.no_hunting
    assert certificate.delay_margin == 0.0 and certificate.uncovered == ("pull",)
    words = " ".join(certificate.summary().split())
    for line in ("delay no margin, not covered: pull", "FAILS: every effect", "not covered: pull."):
        assert line in words
    bounded = design(BoundedPull(20.0)).certificate
    assert bounded.tube < np.inf and bounded.no_hunting and bounded.uncovered == ()
    # A spring of that stiffness pulls as much.
    assert bounded.tube == pytest.approx(design(fx.Spring(20.0)).certificate.tube)


@pytest.mark.slow
@pytest.mark.parametrize("slug", tube_attack.EFFECTS)
@pytest.mark.filterwarnings("ignore")
def test_no_certificate_is_broken_by_a_simulation(slug):
    """A sample of `benchmarks/tube_attack.py`."""
    told = tube_attack.attack_effect(slug, 1, 69, 2)
    assert told["designs"] + told["not designed"] == 1
    assert +Counter({what: n for what, n in told.items() if "BROKEN" in what}) == Counter()
