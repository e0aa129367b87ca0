"""Warns of public names that the reference leaves out; the build fails on warnings."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING

import dryfric_control
from dryfric_control import datasets, effects, laws, presets, simulators

if TYPE_CHECKING:
    from sphinx.application import Sphinx
    from sphinx.environment import BuildEnvironment


#: Classes of results where they are made, which everybody reads, the loops of an
#: observer and the regression of the force.
RESULTS = (
    "arm.ArmRecords",
    "compensation.certificate.TrackingCertificate",
    "compensation.runtime.CompensatedController",
    "compensation.runtime.CompensationStepper",
    "diagnosis.Cause",
    "diagnosis.Limits",
    "diagnosis.experiment.Experiment",
    "diagnosis.joints.JointDiagnoses",
    "identification.ForceRegression",
    "identification.force_regression",
    "model.axis.AxisStepper",
    "model.responses.Events",
    "model.responses.SimulationResponse",
    "observer.Certificate",
    "observer.ExtendedStateObserver",
    "observer.HybridFilter",
    "observer.Observer",
    "observer.ObserverStepper",
    "observer.observed_loop",
    "observer.simulate_observed_loop",
    "records.data_check.RecordCheck",
    "simulators.joint_values.SimulatorValues",
)


def public_names() -> list[str]:
    """Every name a user may rely on, below `dryfric_control`."""
    rooms = ("datasets", "drawing", "effects", "laws", "observer", "presets", "simulators")
    names = [name for name in dryfric_control.__all__ if name not in rooms]
    names += [f"datasets.{name}" for name in datasets.__all__]
    names.append("drawing.journal")
    names += [f"effects.{name}" for name in effects.__all__]
    names += [f"laws.{name}" for name in laws.__all__]
    names += [f"simulators.{name}" for name in simulators.__all__ if name not in names]
    ready = inspect.getmembers(presets, inspect.isfunction)
    names += [
        f"presets.{name}"
        for name, item in ready
        if item.__module__ == presets.__name__ and not name.startswith("_")
    ]
    return names + list(RESULTS)


def check(app: Sphinx, env: BuildEnvironment) -> None:
    from sphinx.util import logging  # the tests read the names without Sphinx

    logger = logging.getLogger(__name__)
    described = env.get_domain("py").objects
    for name in public_names():
        if f"dryfric_control.{name}" not in described:
            logger.warning("public name %s is missing in reference.rst", name)


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("env-check-consistency", check)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
