"""Control of machines with dry friction, on top of python-control."""

import sys

from dryfric_control import datasets, presets
from dryfric_control._version import __version__
from dryfric_control.compensation import Compensation, design_compensation, load_compensation
from dryfric_control.diagnosis import (
    Cause,
    Diagnosis,
    diagnose,
    diagnose_batch,
    diagnose_joints,
    next_experiment,
)
from dryfric_control.diagnosis.report.diagnosis import load_diagnosis
from dryfric_control.export import export_c, export_fmu
from dryfric_control.identification import (
    Fit,
    FitWarning,
    fit,
    identify_coulomb,
    identify_stribeck,
    load_fit,
    replay,
    replay_loop,
    slow_ramp_experiment,
)
from dryfric_control.model import effects, laws
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.blocks import (
    axis_block,
    encoder,
    position_controller,
    reference_filter,
    supervisor,
    switched_axis,
)
from dryfric_control.model.friction import CoulombMap, Stribeck
from dryfric_control.model.loops import PositionController, simulate_loop
from dryfric_control.model.profiles import MotionProfile, motion_profile
from dryfric_control.model.state_machine import plot_state_machine
from dryfric_control.observer import (
    Certificate,
    CertificateError,
    ObserverDesign,
    ObserverStepper,
    design_pi_observer,
    hybrid_filter,
    load_design,
    monte_carlo,
    observe,
    observed_loop,
    pi_observer,
    simulate_observed_loop,
)
from dryfric_control.records import (
    Record,
    RecordWarning,
    Scaling,
    load_record,
    read_bam,
    read_record,
)
from dryfric_control.simulators import to_isaac, to_mjcf, to_modelica, to_simscape, to_urdf
from dryfric_control.store.axis_file import read_axis, write_axis
from dryfric_control.store.batch import run_batch

__all__ = [
    "Cause",
    "Certificate",
    "CertificateError",
    "Compensation",
    "CoulombMap",
    "Diagnosis",
    "Fit",
    "FitWarning",
    "FrictionAxis",
    "MotionProfile",
    "ObserverDesign",
    "ObserverStepper",
    "PositionController",
    "Record",
    "RecordWarning",
    "Scaling",
    "Stribeck",
    "__version__",
    "axis_block",
    "datasets",
    "design_compensation",
    "design_pi_observer",
    "diagnose",
    "diagnose_batch",
    "diagnose_joints",
    "effects",
    "encoder",
    "export_c",
    "export_fmu",
    "fit",
    "hybrid_filter",
    "identify_coulomb",
    "identify_stribeck",
    "laws",
    "load_compensation",
    "load_design",
    "load_diagnosis",
    "load_fit",
    "load_record",
    "monte_carlo",
    "motion_profile",
    "next_experiment",
    "observe",
    "observed_loop",
    "pi_observer",
    "plot_state_machine",
    "position_controller",
    "presets",
    "read_axis",
    "read_bam",
    "read_record",
    "reference_filter",
    "replay",
    "replay_loop",
    "run_batch",
    "simulate_loop",
    "simulate_observed_loop",
    "slow_ramp_experiment",
    "supervisor",
    "switched_axis",
    "to_isaac",
    "to_mjcf",
    "to_modelica",
    "to_simscape",
    "to_urdf",
    "write_axis",
]

# Public namespaces: `from dryfric_control.effects import Cogging` reads them too.
sys.modules[f"{__name__}.effects"] = effects
sys.modules[f"{__name__}.laws"] = laws


def __dir__() -> list[str]:
    """Public names alone, for tab completion."""
    return __all__
