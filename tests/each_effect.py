"""One of every effect of the package, of a size that matters on an axis of 2 kg and 4 to 8 N."""

from dryfric_control import effects as fx
from dryfric_control.model.effects.effect import REGISTRY

EFFECTS = (
    fx.Inertia(0.5), fx.ViscousFriction(3.0), fx.CoulombFriction(1.0), fx.StribeckPeak(0.4, 3e-3),
    fx.InputDelay(2.3e-3), fx.ActuatorLag(3e-3), fx.InputGain(1.1), fx.DeadZone(0.5), fx.Saturation(25.0),
    fx.Presliding(2e-5, 300.0, 1.0), fx.Backlash(1e-4, 0.4), fx.LoadEncoderBacklash(1e-4, 0.4),
    fx.Compliance(1e5, 10.0, 0.4), fx.EccentricEncoder(1e-4, 0.01, 0.5), fx.BiasForce(1.0),
    fx.ViscousAsymmetry(2.0), fx.ViscousWarmUp(3.0, 0.3), fx.QuadraticDrag(5.0),
    fx.Spring(100.0, 0.01), fx.Gravity(2.0, 0.5),
    fx.Cogging(0.5, 0.01, 0.5), fx.TimePeriodic(0.5, 11.0, 0.5), fx.CoulombAsymmetry(1.0),
    fx.PositionDependence(2.0, 30.0, 0.01), fx.FrictionRipple(0.2, 0.02, 0.5), fx.LoadDependence(0.1), fx.LoadAsymmetry(0.1),
    fx.StribeckAsymmetry(0.3, 0.02), fx.VelocityStrengthening(0.3, 0.02), fx.WarmUp(0.4, 0.3),
    fx.PositionForce(0.02, 0.05, 0.3, -0.8, 0.5, 0.2, -0.1, 0.3, 0.1, -0.2, 0.1, 0.05, -0.1, 0.05, 0.02),
    fx.Drift(0.2), fx.DwellTime(1.0, 0.1), fx.EndStop(0.0199, 0.0262, 3e3, 20.0),
)  # fmt: skip
BY_SLUG = {effect.slug: effect for effect in EFFECTS}
OWN = {slug for slug, cls in REGISTRY.items() if cls.__module__.startswith("dryfric_control.")}
assert set(BY_SLUG) == OWN, "an effect of the package is missing here"
