"""Control of machines with dry friction, on top of python-control."""

from dryfric_control._version import __version__
from dryfric_control.axis import AxisStepper, FrictionAxis
from dryfric_control.blocks import (
    axis_block,
    encoder,
    position_controller,
    reference_filter,
    supervisor,
    switched_axis,
)
from dryfric_control.effects import (
    ActuatorLag,
    BiasForce,
    Cogging,
    CoulombAsymmetry,
    DeadZone,
    Effect,
    Gravity,
    InputDelay,
    InputGain,
    QuadraticDrag,
    Saturation,
    Spring,
    ViscousAsymmetry,
    parameter,
    register_effect,
)
from dryfric_control.friction import CoulombMap, Stribeck
from dryfric_control.loops import PositionController, simulate_loop
from dryfric_control.responses import Events, SimulationResponse

__all__ = [
    "ActuatorLag",
    "AxisStepper",
    "BiasForce",
    "Cogging",
    "CoulombAsymmetry",
    "CoulombMap",
    "DeadZone",
    "Effect",
    "Events",
    "FrictionAxis",
    "Gravity",
    "InputDelay",
    "InputGain",
    "PositionController",
    "QuadraticDrag",
    "Saturation",
    "SimulationResponse",
    "Spring",
    "Stribeck",
    "ViscousAsymmetry",
    "__version__",
    "axis_block",
    "encoder",
    "parameter",
    "position_controller",
    "reference_filter",
    "register_effect",
    "simulate_loop",
    "supervisor",
    "switched_axis",
]
