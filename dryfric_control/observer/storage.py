"""Observer designs as text files: JSON, versioned, checked when read."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from dryfric_control.checks import positive, whole
from dryfric_control.model.axis import MODES
from dryfric_control.observer.certificate import Certificate, CertificateError
from dryfric_control.observer.design import (
    ARRAYS,
    KIND,
    NUMBERS,
    VERSION,
    WORDS,
    ObserverDesign,
)
from dryfric_control.observer.error_model import check_sampling, mode_classes
from dryfric_control.observer.memory import ModeGraph
from dryfric_control.store.axis_file import axis_from_dict
from dryfric_control.store.files import load_document

_MAY_BE_ZERO = ("noise", "encoder_quantum", "drift")


def load_design(path: str | os.PathLike[str]) -> ObserverDesign:
    """Read a design back and check its certificate.

    Parameters
    ----------
    path : str or path
        File written by `ObserverDesign.save`.

    Returns
    -------
    ObserverDesign
        Its certificate is computed anew from the gains in the file.

    Raises
    ------
    ValueError
        If the file is no observer design, is damaged or newer than this
        package, or its gains fail the certificate.

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
    return load_document(path, KIND, VERSION, design_of, CertificateError)


def design_of(data: dict[str, Any]) -> ObserverDesign:
    """The design that `design_data` wrote, its certificate computed anew.

    Parameters
    ----------
    data : dict
        Numbers and words.

    Raises
    ------
    CertificateError
        If the gains fail the certificate.
    """
    design = _rebuild(data)
    return dataclasses.replace(design, certificate=design.check())


def _rebuild(data: dict[str, Any]) -> ObserverDesign:
    axis = axis_from_dict(data["axis"])
    graph = data["graph"]
    edges = tuple((int(i), int(j)) for i, j in graph["edges"])
    nodes = len(graph["labels"])
    if len(graph["names"]) != nodes or not all(0 <= k < nodes for edge in edges for k in edge):
        raise ValueError("graph does not fit together")
    following: dict[int, set[int]] = {}
    for node, label in enumerate(graph["labels"]):
        after = {graph["labels"][j] for i, j in edges if i == node}
        if label not in after or following.setdefault(label, after) != after:
            raise ValueError(f"graph.edges: changes of mode are missing after node {node}")
    arrays: dict[str, Any] = {name: np.array(data[name], dtype=float) for name in ARRAYS}
    shapes = {
        "node_gains": (nodes, 3), "state_scale": (3,),
        "lyapunov": (nodes, 3, 3), "lyapunov_decay": (nodes, 3, 3),
    }  # fmt: skip
    for name, shape in shapes.items():
        if arrays[name].shape != shape or not np.all(np.isfinite(arrays[name])):
            raise ValueError(f"{name} must hold numbers in shape {shape}")
    if not np.all(arrays["state_scale"] > 0.0):
        raise ValueError(f"state_scale must be positive, got {data['state_scale']!r}")
    plain: dict[str, Any] = {
        name: positive(name, data[name], zero=name in _MAY_BE_ZERO) for name in NUMBERS
    }
    plain |= {name: _one_of(name, data[name], known) for name, known in WORDS.items()}
    if not plain["decay"] <= 1.0:
        raise ValueError(f"decay must be at most 1, got {plain['decay']!r}")
    uncertainty = {
        mode: positive(f"uncertainty[{mode}]", data["uncertainty"][str(mode)], zero=True)
        for mode in MODES
    }
    integral = tuple(_one_of("integral_modes", mode, MODES) for mode in data["integral_modes"])
    if set(graph["labels"]) != set(mode_classes(uncertainty).values()):
        raise ValueError(f"graph.labels do not fit the classes of the modes: {graph['labels']!r}")
    check_sampling(axis, plain["dt"], plain["discretization"])
    q_x, q_v, q_w = (positive("performance", q, zero=True) for q in data["performance"])
    return ObserverDesign(
        axis=axis,
        graph=ModeGraph(
            tuple(int(k) for k in graph["labels"]), edges, tuple(str(n) for n in graph["names"])
        ),
        uncertainty=uncertainty,
        performance=(q_x, q_v, q_w),
        integral_modes=integral,
        certificate=Certificate(0.0, 0.0, (), 0.0, (), 1.0, {}, 0.0, ()),
        **arrays,
        window=whole("window", data["window"]),
        **plain,
    )


def _one_of(name: str, value: Any, known: Sequence[Any]) -> Any:
    if value not in known or isinstance(value, bool):
        raise ValueError(f"{name} must be one of {', '.join(map(str, known))}, got {value!r}")
    return value
