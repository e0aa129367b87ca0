"""Diagnosis: from measured data to the cause of a discrepancy."""

from dryfric_control.diagnosis.diagnose import diagnose, diagnose_batch
from dryfric_control.diagnosis.evidence import Evidence, evidence
from dryfric_control.diagnosis.excitations import Limits
from dryfric_control.diagnosis.experiment import Experiment, next_experiment
from dryfric_control.diagnosis.joints import JointDiagnoses, diagnose_joints
from dryfric_control.diagnosis.remaining import Remaining
from dryfric_control.diagnosis.report.diagnosis import Diagnosis
from dryfric_control.diagnosis.report.findings import Cause, Gain, Unexplained
from dryfric_control.store.axis_file import read_axis, write_axis

__all__ = [
    "Cause",
    "Diagnosis",
    "Evidence",
    "Experiment",
    "Gain",
    "JointDiagnoses",
    "Limits",
    "Remaining",
    "Unexplained",
    "diagnose",
    "diagnose_batch",
    "diagnose_joints",
    "evidence",
    "next_experiment",
    "read_axis",
    "write_axis",
]
