"""Friction compensation: position controllers with what they guarantee."""

from dryfric_control.compensation.certificate import TrackingCertificate
from dryfric_control.compensation.design import Compensation, design_compensation, load_compensation
from dryfric_control.compensation.runtime import CompensatedController, CompensationStepper

__all__ = [
    "CompensatedController",
    "Compensation",
    "CompensationStepper",
    "TrackingCertificate",
    "design_compensation",
    "load_compensation",
]
