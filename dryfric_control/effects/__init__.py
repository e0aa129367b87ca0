"""Physical effects beyond the base model, one class each, by where they act."""

from dryfric_control.effects.base import CoulombFriction, Inertia, StribeckPeak, ViscousFriction
from dryfric_control.effects.drive import ActuatorLag, DeadZone, InputDelay, InputGain, Saturation
from dryfric_control.effects.effect import (
    ACTIONS,
    REGISTRY,
    Effect,
    law_address,
    parameter,
    register_effect,
)
from dryfric_control.effects.elastic import Backlash, Compliance, Presliding
from dryfric_control.effects.forces import (
    BiasForce,
    Cogging,
    Gravity,
    QuadraticDrag,
    Spring,
    TimePeriodic,
    ViscousAsymmetry,
)
from dryfric_control.effects.levels import (
    CoulombAsymmetry,
    Drift,
    DwellTime,
    LoadDependence,
    PositionDependence,
)

__all__ = [
    "ACTIONS",
    "REGISTRY",
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
    "Effect",
    "Gravity",
    "Inertia",
    "InputDelay",
    "InputGain",
    "LoadDependence",
    "PositionDependence",
    "Presliding",
    "QuadraticDrag",
    "Saturation",
    "Spring",
    "StribeckPeak",
    "TimePeriodic",
    "ViscousAsymmetry",
    "ViscousFriction",
    "law_address",
    "parameter",
    "register_effect",
]
