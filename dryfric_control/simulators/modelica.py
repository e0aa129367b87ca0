"""Friction components of a Modelica model."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dryfric_control.arrays import Floats
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.simulators import joint_values
from dryfric_control.simulators.files import Edit, applied, number, read_model, written
from dryfric_control.simulators.joint_values import SimulatorValues

# Velocities of the table.
_KNOTS = 17
_COMPONENT = re.compile(rb"\b(BearingFriction|SupportFriction)\s+([A-Za-z_]\w*)\s*(\()?")
_TABLE = {"BearingFriction": "tau_pos", "SupportFriction": "f_pos"}
_UNITS = {"BearingFriction": ("rad", "N m"), "SupportFriction": ("m", "N")}
# What may hold brackets that are none: text and comments.
_SKIPPED = re.compile(rb'"(?:\\.|[^"\\])*"|//[^\n]*|/\*.*?\*/', re.S)


def _knots(speed: Floats, axis: FrictionAxis) -> tuple[Floats]:
    """Velocities of the table: closest where the record has most samples, each one of these."""
    return (np.unique(np.quantile(speed, np.linspace(0.0, 1.0, _KNOTS), method="lower")),)


def _hats(v: Floats, knots: Floats) -> Floats:
    """Columns of a table over the speed, the same both ways."""
    columns = [np.interp(np.abs(v), knots, row) for row in np.eye(knots.size)]
    return np.sign(v)[:, None] * np.column_stack(columns)


def _table(c: Floats, knots: Floats, breakaway: float, axis: FrictionAxis) -> dict[str, Any]:
    rows = [[0.0, breakaway], *([float(a), float(b)] for a, b in zip(knots, c, strict=True))]
    return {"table": rows, "peak": 1.0}


_MODELICA = joint_values.Format(_table, breakaway=True, columns=_hats, shapes=_knots)


def to_modelica(
    result: Any,
    model: str | os.PathLike[str],
    joint: str | None = None,
    *,
    velocities: ArrayLike | None = None,
    out: str | os.PathLike[str] | None = None,
) -> SimulatorValues:
    """Set friction tables of components in a Modelica file.

    Parameters
    ----------
    result : Fit, Diagnosis, FrictionAxis, or mapping of str to such
        What is known of the joint, or of each joint by the name of its component.
    model : path-like
        File with components `BearingFriction` or `SupportFriction`; every other byte stays.
    joint, velocities, out
        As for `to_mjcf`; a joint is the name of its component.

    Notes
    -----
    The table `tau_pos` (`f_pos` of a `SupportFriction`) holds friction over speed, the same both
    ways.  Its first row is the breakaway, and `peak` is 1.  Inertia belongs to another component.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=0.3, viscous=0.2, coulomb=1.5, units=("rad", "N m"))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     arm = pathlib.Path(folder, "Arm.mo")
    ...     _ = arm.write_text("model Arm BearingFriction elbow(tau_pos=[0, 1]); end Arm;")
    ...     found = dfc.simulators.to_modelica(axis, arm, velocities=[-2.0, -1.0, 1.0, 2.0])
    ...     print(arm.read_text()[:47])
    model Arm BearingFriction elbow(tau_pos=[0, 1.5
    >>> found.lost
    ()
    """
    path, raw, place = read_model(model, out)
    bare = _SKIPPED.sub(lambda found: b" " * len(found[0]), raw)
    there = {found[2].decode(): found for found in _COMPONENT.finditer(bare)}
    if not there:
        raise ValueError(
            f"model {path.name} has no component BearingFriction or SupportFriction: the tables "
            "of Modelica.Mechanics are those of these"
        )
    units = {name: (_UNITS[one[1].decode()],) for name, one in there.items()}
    joints = joint_values.joints_of(result, joint, units, what="component")
    for name in joints:
        if there[name][3] and _ends(bare, there[name].end(), len(bare), b"") == len(bare):
            raise ValueError(
                f"model {path.name}: a bracket of {name!r} is not closed: is the file whole?"
            )
    found = joint_values.described(_MODELICA, joints, velocities)
    edits: list[Edit] = []
    for name, values in found.values.items():
        rows = "; ".join(f"{number(v)}, {number(f)}" for v, f in values["table"])
        texts = {_TABLE[there[name][1].decode()]: f"[{rows}]", "peak": number(values["peak"])}
        edits += _modified(bare, there[name], texts)
    return written(found, place, applied(raw, edits))


def _modified(bare: bytes, component: re.Match[bytes], texts: dict[str, str]) -> Iterator[Edit]:
    """Modifiers of a component set in a file, `bare` of text and comments."""
    missing = {name: f"{name}={value}" for name, value in texts.items()}
    if component[3] is None:
        yield Edit(component.end(2), component.end(2), f"({', '.join(missing.values())})".encode())
        return
    begin = component.end(3)
    end = _ends(bare, begin, len(bare), b"")
    for name, value in texts.items():
        if old := re.compile(rb"\b%s\s*=\s*" % name.encode()).search(bare, begin, end):
            stop = _ends(bare, old.end(), end)
            if not bare[old.end() : stop].strip():
                raise ValueError(
                    f"component {component[2].decode()!r}: {name} has no value: is the file whole?"
                )
            yield Edit(old.end(), stop, value.encode())
            del missing[name]
    if missing:
        comma = ", " if bare[begin:end].strip() else ""
        yield Edit(end, end, f"{comma}{', '.join(missing.values())}".encode())


def _ends(text: bytes, begin: int, end: int, marks: bytes = b",") -> int:
    """End of a value: a comma, or the bracket that closes what is around it."""
    depth = 0
    for i in range(begin, end):
        one = text[i : i + 1]
        if depth == 0 and (one in (b")", b"]", b"}") or (marks and one == marks)):
            return i
        depth += (one in (b"(", b"[", b"{")) - (one in (b")", b"]", b"}"))
    return end
