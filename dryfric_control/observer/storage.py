"""Observer designs from files, checked."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np

from dryfric_control.checks import one_of, positive, whole
from dryfric_control.model.axis import MODES
from dryfric_control.observer.certificate import CertificateError
from dryfric_control.observer.design import KIND, METHODS, SAVED, ObserverDesign
from dryfric_control.observer.error_model import (
    DISCRETIZATIONS,
    FORMS,
    check_sampling,
    mode_classes,
)
from dryfric_control.store.saved import load_object

_NUMBERS = {name: name in ("noise", "encoder_quantum", "drift") for name in (
    "dt", "noise", "encoder_quantum", "drift", "decay", "gamma", "output_scale")}  # fmt: skip
_WORDS = {"method": METHODS, "discretization": DISCRETIZATIONS, "form": FORMS}


def load_design(path: str | os.PathLike[str]) -> ObserverDesign:
    """Read a design back and check its certificate.

    Parameters
    ----------
    path : str or path
        File written by `ObserverDesign.save`.

    Returns
    -------
    ObserverDesign
        Its certificate is computed anew from the gains; a ValueError if they fail it, or the file
        is damaged or newer than this package.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> import tempfile, pathlib
    >>> axis = dfc.FrictionAxis(mass=1.0, viscous=0.4, coulomb=8.0)
    >>> design = dfc.design_pi_observer(axis, dt=1e-3)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     design.save(pathlib.Path(folder) / "observer.json")
    ...     again = dfc.load_design(pathlib.Path(folder) / "observer.json")
    >>> bool((again.node_gains == design.node_gains).all())
    True
    """
    found: ObserverDesign = load_object(path, KIND, SAVED, checked, CertificateError)
    return found


def checked(design: ObserverDesign) -> ObserverDesign:
    """A design of a file, every part in its range, with its certificate computed anew."""
    graph, edges = design.graph, design.graph.edges
    nodes = len(graph.labels)
    if len(graph.names) != nodes or not all(0 <= k < nodes for edge in edges for k in edge):
        raise ValueError("graph does not fit together")
    following: dict[int, set[int]] = {}
    for node, label in enumerate(graph.labels):
        after = {graph.labels[j] for i, j in edges if i == node}
        if label not in after or following.setdefault(label, after) != after:
            raise ValueError(f"graph.edges: changes of mode are missing after node {node}")
    square = (nodes, 3, 3)
    shapes = {"node_gains": (nodes, 3), "state_scale": (3,), "lyapunov": square,
              "lyapunov_decay": square}  # fmt: skip
    for name, shape in shapes.items():
        array = getattr(design, name)
        if array.shape != shape or array.dtype.kind != "f" or not np.all(np.isfinite(array)):
            raise ValueError(f"{name} must hold numbers in shape {shape}")
    if not np.all(design.state_scale > 0.0):
        raise ValueError(f"state_scale must be positive, got {design.state_scale.tolist()!r}")
    for name, zero in _NUMBERS.items():
        positive(name, getattr(design, name), zero=zero)
    for name, known in _WORDS.items():
        one_of(name, getattr(design, name), known)
    if not design.decay <= 1.0:
        raise ValueError(f"decay must be at most 1, got {design.decay!r}")
    for mode in MODES:
        positive(f"uncertainty[{mode}]", design.uncertainty[mode], zero=True)
    for mode in design.integral_modes:
        one_of("integral_modes", mode, MODES)
    if set(graph.labels) != set(mode_classes(design.uncertainty).values()):
        raise ValueError(f"graph.labels do not fit the classes of the modes: {graph.labels!r}")
    check_sampling(design.axis, design.dt, design.discretization)
    if len(design.performance) != 3:
        raise ValueError(f"performance must be three weights, got {design.performance!r}")
    for weight in design.performance:
        positive("performance", weight, zero=True)
    whole("window", design.window)
    return replace(design, certificate=design.check())
