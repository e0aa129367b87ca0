"""Physical effects beyond the base model, one class each, by where they act."""

from dryfric_control.model.effects.base import (
    CoulombFriction,
    Inertia,
    StribeckPeak,
    ViscousFriction,
)
from dryfric_control.model.effects.drive import (
    ActuatorLag,
    DeadZone,
    InputDelay,
    InputGain,
    Saturation,
)
from dryfric_control.model.effects.effect import Effect, Inner, parameter, register_effect
from dryfric_control.model.effects.elastic import (
    Backlash,
    Compliance,
    LoadEncoderBacklash,
    Presliding,
)
from dryfric_control.model.effects.encoder import EccentricEncoder
from dryfric_control.model.effects.forces import (
    BiasForce,
    Cogging,
    EndStop,
    Gravity,
    QuadraticDrag,
    Spring,
    TimePeriodic,
    ViscousAsymmetry,
)
from dryfric_control.model.effects.levels import (
    CoulombAsymmetry,
    Drift,
    DwellTime,
    LoadAsymmetry,
    LoadDependence,
    PositionDependence,
    StribeckAsymmetry,
    VelocityStrengthening,
    WarmUp,
)

__all__ = [
    "ActuatorLag",
    "Backlash",
    "BiasForce",
    "Cogging",
    "Compliance",
    "CoulombAsymmetry",
    "CoulombFriction",
    "DeadZone",
    "Drift",
    "DwellTime",
    "EccentricEncoder",
    "Effect",
    "EndStop",
    "Gravity",
    "Inertia",
    "Inner",
    "InputDelay",
    "InputGain",
    "LoadAsymmetry",
    "LoadDependence",
    "LoadEncoderBacklash",
    "PositionDependence",
    "Presliding",
    "QuadraticDrag",
    "Saturation",
    "Spring",
    "StribeckAsymmetry",
    "StribeckPeak",
    "TimePeriodic",
    "VelocityStrengthening",
    "ViscousAsymmetry",
    "ViscousFriction",
    "WarmUp",
    "parameter",
    "register_effect",
]
