"""Friction compensation: position controllers with what they guarantee."""

from dryfric_control.compensation.certificate import TrackingCertificate as TrackingCertificate
from dryfric_control.compensation.design import Compensation as Compensation
from dryfric_control.compensation.design import design_compensation as design_compensation
from dryfric_control.compensation.design import load_compensation as load_compensation
from dryfric_control.compensation.runtime import CompensatedController as CompensatedController
from dryfric_control.compensation.runtime import CompensationStepper as CompensationStepper
