"""Control of machines with dry friction, on top of python-control."""

import sys
from typing import TYPE_CHECKING

from dryfric_control import arguments as _arguments
from dryfric_control import datasets as datasets
from dryfric_control import drawing as drawing
from dryfric_control import observer as observer
from dryfric_control import presets as presets
from dryfric_control import simulators as simulators
from dryfric_control._version import __version__ as __version__
from dryfric_control.arm import arm_records as arm_records
from dryfric_control.arm import diagnose_arm as diagnose_arm
from dryfric_control.compensation import Compensation as Compensation
from dryfric_control.compensation import design_compensation as design_compensation
from dryfric_control.compensation import load_compensation as load_compensation
from dryfric_control.diagnosis import Diagnosis as Diagnosis
from dryfric_control.diagnosis import diagnose as diagnose
from dryfric_control.diagnosis import diagnose_batch as diagnose_batch
from dryfric_control.diagnosis import diagnose_joints as diagnose_joints
from dryfric_control.diagnosis import next_experiment as next_experiment
from dryfric_control.export import export_c as export_c
from dryfric_control.export import export_fmu as export_fmu
from dryfric_control.identification import Fit as Fit
from dryfric_control.identification import FitWarning as FitWarning
from dryfric_control.identification import axis_from as axis_from
from dryfric_control.identification import fit as fit
from dryfric_control.identification import identify_coulomb as identify_coulomb
from dryfric_control.identification import identify_stribeck as identify_stribeck
from dryfric_control.identification import replay as replay
from dryfric_control.identification import replay_loop as replay_loop
from dryfric_control.identification import slow_ramp_experiment as slow_ramp_experiment
from dryfric_control.model import effects as effects
from dryfric_control.model import laws as laws
from dryfric_control.model.axis import FrictionAxis as FrictionAxis
from dryfric_control.model.blocks import axis_block as axis_block
from dryfric_control.model.blocks import encoder as encoder
from dryfric_control.model.blocks import position_controller as position_controller
from dryfric_control.model.blocks import reference_filter as reference_filter
from dryfric_control.model.blocks import supervisor as supervisor
from dryfric_control.model.blocks import switched_axis as switched_axis
from dryfric_control.model.friction import CoulombMap as CoulombMap
from dryfric_control.model.friction import Stribeck as Stribeck
from dryfric_control.model.loops import PositionController as PositionController
from dryfric_control.model.loops import simulate_loop as simulate_loop
from dryfric_control.model.profiles import MotionProfile as MotionProfile
from dryfric_control.model.profiles import motion_profile as motion_profile
from dryfric_control.model.sampled import sampled as sampled
from dryfric_control.model.state_machine import plot_state_machine as plot_state_machine
from dryfric_control.observer import CertificateError as CertificateError
from dryfric_control.observer import ObserverDesign as ObserverDesign
from dryfric_control.observer import design_pi_observer as design_pi_observer
from dryfric_control.observer import extended_state_observer as extended_state_observer
from dryfric_control.observer import hybrid_filter as hybrid_filter
from dryfric_control.observer import monte_carlo as monte_carlo
from dryfric_control.observer import observe as observe
from dryfric_control.observer import pi_observer as pi_observer
from dryfric_control.records import Record as Record
from dryfric_control.records import RecordWarning as RecordWarning
from dryfric_control.records import Scaling as Scaling
from dryfric_control.records import load_record as load_record
from dryfric_control.records import read_bam as read_bam
from dryfric_control.records import read_record as read_record
from dryfric_control.records import record_arguments as _around_records
from dryfric_control.simulators import to_mjcf as to_mjcf
from dryfric_control.simulators import to_modelica as to_modelica
from dryfric_control.simulators import to_simscape as to_simscape
from dryfric_control.simulators import to_urdf as to_urdf
from dryfric_control.store.axis_file import read_axis as read_axis
from dryfric_control.store.axis_file import write_axis as write_axis
from dryfric_control.store.batch import run_batch as run_batch

load_design = ObserverDesign.load
load_diagnosis = Diagnosis.load

# Every name above is public: `X as X` says so to type checkers, and here it is said to `dir`, but
# for those that are listed where they are at home: in `simulators`, or as a method of their class.
_AT_HOME = ("load_design", "load_diagnosis", "to_modelica", "to_simscape", "to_urdf")
__all__ = [
    "__version__",
    "datasets",
    "drawing",
    "effects",
    "laws",
    "observer",
    "presets",
    "simulators",
]
__all__ += [
    name for name, one in globals().items() if hasattr(one, "__qualname__") and name not in _AT_HOME
]

# Each says which argument is meant by a wrong one.
_hints = {"Record": _around_records.record_hint, "record": _around_records.reading_hint}
_arguments.add_argument_hints(globals(), __all__, _hints)

# Public namespaces: `from dryfric_control.effects import Cogging` reads them too.
sys.modules[f"{__name__}.effects"] = effects
sys.modules[f"{__name__}.laws"] = laws


def __dir__() -> list[str]:
    """Public names alone, for tab completion."""
    return __all__


if not TYPE_CHECKING:  # which would take every name for one of this package

    def __getattr__(name: str) -> object:
        """Say which name is meant by one that is not there."""
        raise AttributeError(_arguments.unknown_name(__name__, name, __all__))
