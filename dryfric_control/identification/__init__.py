"""Identification: from measured records to an axis."""

from dryfric_control.identification.coulomb import CoulombIdentification, identify_coulomb
from dryfric_control.identification.first_axis import ForceRegression, axis_from, force_regression
from dryfric_control.identification.fit import Fit, FitWarning, fit
from dryfric_control.identification.replay import replay, replay_loop
from dryfric_control.identification.slow_ramp import SlowRamp, slow_ramp_experiment
from dryfric_control.identification.stribeck import identify_stribeck, ripple

__all__ = [
    "CoulombIdentification",
    "Fit",
    "FitWarning",
    "ForceRegression",
    "SlowRamp",
    "axis_from",
    "fit",
    "force_regression",
    "identify_coulomb",
    "identify_stribeck",
    "replay",
    "replay_loop",
    "ripple",
    "slow_ramp_experiment",
]
