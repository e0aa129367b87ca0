"""Observer designs as text files: JSON, versioned, checked when read."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from dryfric_control.checks import positive, whole
from dryfric_control.model.axis import MODES, FrictionAxis
from dryfric_control.model.effects.effect import REGISTRY
from dryfric_control.model.friction import CoulombMap
from dryfric_control.observer.certificate import Certificate, CertificateError
from dryfric_control.observer.design import METHODS, ObserverDesign
from dryfric_control.observer.error_model import (
    DISCRETIZATIONS,
    FORMS,
    check_sampling,
    mode_classes,
)
from dryfric_control.observer.memory import ModeGraph
from dryfric_control.store.files import existing_file, replacing

FORMAT, VERSION = "dryfric-control observer design", 2
_ARRAYS = ("node_gains", "state_scale", "lyapunov", "lyapunov_decay")
_NUMBERS = ("dt", "noise", "encoder_quantum", "drift", "decay", "gamma", "output_scale")
_MAY_BE_ZERO = ("noise", "encoder_quantum", "drift")
_WORDS = {"method": METHODS, "discretization": DISCRETIZATIONS, "form": FORMS}


def save_design(design: ObserverDesign, path: str | os.PathLike[str]) -> None:
    """Write a design to a text file, as a whole or not at all.

    Parameters
    ----------
    design : ObserverDesign
        What to write.
    path : str or path
        File to write.
    """
    axis = design.axis
    data: dict[str, Any] = {"format": FORMAT, "version": VERSION}
    data["axis"] = {
        "mass": axis.mass,
        "viscous": axis.viscous,
        "coulomb": {"plus": axis.coulomb.plus, "minus": axis.coulomb.minus},
        "stick_speed": axis.stick_speed,
        "stick_rate": axis.stick_rate,
        "travel": axis.travel,
        "switching": axis.switching,
        "name": axis.name,
        "units": axis.units,
        "effects": [{"slug": e.slug, "parameters": dataclasses.asdict(e)} for e in axis.effects],
    }
    data |= {name: getattr(design, name) for name in (*_NUMBERS, *_WORDS, "window")}
    data["uncertainty"] = {str(mode): value for mode, value in design.uncertainty.items()}
    data["performance"] = design.performance
    data["integral_modes"] = design.integral_modes
    data["graph"] = dataclasses.asdict(design.graph)
    data |= {name: getattr(design, name).tolist() for name in _ARRAYS}
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        # repr of a float is exact, so a design survives bit by bit
        json.dump(data, file, indent=1, allow_nan=False)
        file.write("\n")


def load_design(path: str | os.PathLike[str]) -> ObserverDesign:
    """Read a design back and check that it keeps its promises.

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
    try:
        data = json.loads(existing_file(path).read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is damaged: not readable as JSON ({error})") from None
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise ValueError(f"{path} is no observer design: it lacks format = {FORMAT!r}")
    if data.get("version") == 1:  # before the current form
        data["form"] = "prediction"
    elif data.get("version") != VERSION:
        raise ValueError(
            f"{path} has version {data.get('version')!r}, this package reads {VERSION}: design "
            "again, or use a newer package"
        )
    try:
        # Numbers beyond all reason overflow somewhere; a sound design does nowhere.
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            design = _rebuild(data)
            return dataclasses.replace(design, certificate=design.check())
    except CertificateError as error:
        raise CertificateError(f"{path} was changed: {error}") from None
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, ArithmeticError) as error:
        raise ValueError(
            f"{path} is damaged: {type(error).__name__}: {error}; save the design again"
        ) from None


def _rebuild(data: dict[str, Any]) -> ObserverDesign:
    axis = dict(data["axis"])
    axis["coulomb"] = CoulombMap(axis["coulomb"]["plus"], axis["coulomb"]["minus"])
    axis["units"] = tuple(axis["units"])
    axis["effects"] = tuple(REGISTRY[e["slug"]](**e["parameters"]) for e in axis["effects"])
    graph = data["graph"]
    edges = tuple((int(i), int(j)) for i, j in graph["edges"])
    nodes = len(graph["labels"])
    if len(graph["names"]) != nodes or not all(0 <= k < nodes for edge in edges for k in edge):
        raise ValueError("graph does not fit together")
    arrays: dict[str, Any] = {name: np.array(data[name], dtype=float) for name in _ARRAYS}
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
        name: positive(name, data[name], zero=name in _MAY_BE_ZERO) for name in _NUMBERS
    }
    plain |= {name: _one_of(name, data[name], known) for name, known in _WORDS.items()}
    if not plain["decay"] <= 1.0:
        raise ValueError(f"decay must be at most 1, got {plain['decay']!r}")
    uncertainty = {
        mode: positive(f"uncertainty[{mode}]", data["uncertainty"][str(mode)], zero=True)
        for mode in MODES
    }
    integral = tuple(_one_of("integral_modes", mode, MODES) for mode in data["integral_modes"])
    if set(graph["labels"]) != set(mode_classes(uncertainty).values()):
        raise ValueError(f"graph.labels do not fit the classes of the modes: {graph['labels']!r}")
    check_sampling(FrictionAxis(**axis), plain["dt"], plain["discretization"])
    q_x, q_v, q_w = (positive("performance", q, zero=True) for q in data["performance"])
    return ObserverDesign(
        axis=FrictionAxis(**axis),
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
