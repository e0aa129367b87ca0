"""Physical effects beyond the base model, one class each, by where they act."""

from dryfric_control.model.effects.base import CoulombFriction as CoulombFriction
from dryfric_control.model.effects.base import Inertia as Inertia
from dryfric_control.model.effects.base import StribeckPeak as StribeckPeak
from dryfric_control.model.effects.base import ViscousFriction as ViscousFriction
from dryfric_control.model.effects.drive import ActuatorLag as ActuatorLag
from dryfric_control.model.effects.drive import DeadZone as DeadZone
from dryfric_control.model.effects.drive import InputDelay as InputDelay
from dryfric_control.model.effects.drive import InputGain as InputGain
from dryfric_control.model.effects.drive import Saturation as Saturation
from dryfric_control.model.effects.effect import Effect as Effect
from dryfric_control.model.effects.effect import Inner as Inner
from dryfric_control.model.effects.effect import Slopes as Slopes
from dryfric_control.model.effects.effect import parameter as parameter
from dryfric_control.model.effects.effect import register_effect as register_effect
from dryfric_control.model.effects.elastic import Backlash as Backlash
from dryfric_control.model.effects.elastic import Compliance as Compliance
from dryfric_control.model.effects.elastic import LoadEncoderBacklash as LoadEncoderBacklash
from dryfric_control.model.effects.elastic import Presliding as Presliding
from dryfric_control.model.effects.encoder import EccentricEncoder as EccentricEncoder
from dryfric_control.model.effects.forces import BiasForce as BiasForce
from dryfric_control.model.effects.forces import Cogging as Cogging
from dryfric_control.model.effects.forces import EndStop as EndStop
from dryfric_control.model.effects.forces import Gravity as Gravity
from dryfric_control.model.effects.forces import PositionForce as PositionForce
from dryfric_control.model.effects.forces import QuadraticDrag as QuadraticDrag
from dryfric_control.model.effects.forces import Spring as Spring
from dryfric_control.model.effects.forces import TimePeriodic as TimePeriodic
from dryfric_control.model.effects.forces import ViscousAsymmetry as ViscousAsymmetry
from dryfric_control.model.effects.forces import ViscousWarmUp as ViscousWarmUp
from dryfric_control.model.effects.interval import Box as Box
from dryfric_control.model.effects.interval import Interval as Interval
from dryfric_control.model.effects.levels import CoulombAsymmetry as CoulombAsymmetry
from dryfric_control.model.effects.levels import Drift as Drift
from dryfric_control.model.effects.levels import DwellTime as DwellTime
from dryfric_control.model.effects.levels import FrictionRipple as FrictionRipple
from dryfric_control.model.effects.levels import LoadAsymmetry as LoadAsymmetry
from dryfric_control.model.effects.levels import LoadDependence as LoadDependence
from dryfric_control.model.effects.levels import PositionDependence as PositionDependence
from dryfric_control.model.effects.levels import StribeckAsymmetry as StribeckAsymmetry
from dryfric_control.model.effects.levels import VelocityStrengthening as VelocityStrengthening
from dryfric_control.model.effects.levels import WarmUp as WarmUp

# Every name above is public: `X as X` says so to type checkers, and here it is said to `dir`.
__all__ = [name for name, one in globals().items() if hasattr(one, "__qualname__")]
