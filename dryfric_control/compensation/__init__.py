"""Friction compensation: position controllers with what they guarantee."""

from dryfric_control.compensation.design import Compensation, design_compensation

__all__ = ["Compensation", "design_compensation"]
