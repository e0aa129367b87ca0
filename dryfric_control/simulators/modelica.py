"""Friction components of a Modelica model."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dryfric_control.arrays import Floats
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.simulators import joint_values
from dryfric_control.simulators.files import Edit, apply_edits, number, read_model, write_values
from dryfric_control.simulators.joint_values import SimulatorValues

# Velocities of the table.
_KNOTS = 17
_TABLE = {"BearingFriction": "tau_pos", "SupportFriction": "f_pos"}
_UNITS = {"BearingFriction": ("rad", "N m"), "SupportFriction": ("m", "N")}
# What may hold brackets that are none: text and comments.
_SKIPPED = re.compile(rb'"(?:\\.|[^"\\])*"|//[^\n]*|/\*.*?\*/', re.S)
# A name in quotation marks.
_QUOTED = re.compile(rb"'(?:\\.|[^'\\])*'")
# The type of components, and whether all of them are arrays.
_TYPE = re.compile(rb"\b(BearingFriction|SupportFriction)\b\s*(\[)?")
_NAME = re.compile(rb"\s*([A-Za-z_]\w*)\s*")
# A modifier of a component: what stands before its name, its name, and its own modifiers.
_MODIFIER = re.compile(rb"\s*((?:(?:each|final)\s+)*)([A-Za-z_]\w*)\s*(?=[=(])")


class _Component(NamedTuple):
    """A component of a file, by bytes."""

    kind: str
    name: str
    array: bool
    name_end: int  # where modifiers are added if there are none: behind name and dimensions
    begin: int  # of the modifiers, behind the bracket; 0 without
    end: int  # of the modifiers, at the bracket that closes them


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
    # A comment may stand anywhere; a text is none, though what it holds is of no account.
    bare = _SKIPPED.sub(lambda one: (b'"' if one[0][:1] == b'"' else b" ") * len(one[0]), raw)
    bare = _QUOTED.sub(lambda found: b"_" * len(found[0]), bare)
    there: dict[str, list[_Component]] = {}
    for one in _find_components(raw, bare):
        there.setdefault(one.name, []).append(one)
    if not there:
        raise ValueError(
            f"model {path.name} has no component BearingFriction or SupportFriction: the tables "
            "of Modelica.Mechanics are those of these"
        )
    units = {name: (_UNITS[ones[0].kind],) for name, ones in there.items()}
    joints = joint_values.joints_of(result, joint, units, what="component")
    for name in joints:
        if len(there[name]) > 1:
            raise ValueError(
                f"model {path.name} has {len(there[name])} components {name!r}: give a file with "
                "one of their models"
            )
        if there[name][0].end == len(bare):
            raise ValueError(
                f"model {path.name}: a bracket of {name!r} is not closed: is the file whole?"
            )
    found = joint_values.describe_joints(_MODELICA, joints, velocities)
    edits: list[Edit] = []
    for name, values in found.values.items():
        rows = "; ".join(f"{number(v)}, {number(f)}" for v, f in values["table"])
        component = there[name][0]
        texts = {_TABLE[component.kind]: f"[{rows}]", "peak": number(values["peak"])}
        edits += _modifier_edits(bare, component, texts)
    return write_values(found, place, apply_edits(raw, edits))


def _find_components(raw: bytes, bare: bytes) -> Iterator[_Component]:
    """Components with friction of a file, `bare` of text and comments."""
    for kind in _TYPE.finditer(bare):
        at = kind.end()
        all_arrays = kind[2] is not None
        if all_arrays:
            at = _ends(bare, at, len(bare), b"") + 1
        while name := _NAME.match(bare, at):
            at = name.end()
            array = all_arrays
            if bare[at : at + 1] == b"[":
                at = _ends(bare, at + 1, len(bare), b"") + 1
                array = True
            behind = at if array and not all_arrays else name.end(1)
            at += len(bare[at:]) - len(bare[at:].lstrip())
            begin = end = 0
            if bare[at : at + 1] == b"(":
                begin = at + 1
                end = _ends(bare, begin, len(bare), b"")
                at = end + 1
            text = raw[name.start(1) : name.end(1)].decode()
            yield _Component(kind[1].decode(), text, array, behind, begin, end)
            at = _ends(bare, at, len(bare), b",;")
            if bare[at : at + 1] != b",":
                break
            at += 1


def _modifier_edits(bare: bytes, component: _Component, texts: dict[str, str]) -> Iterator[Edit]:
    """Modifiers of a component set; those of an array are the same for each of its elements."""
    each = "each " if component.array else ""
    missing = {name: f"{each}{name}={value}" for name, value in texts.items()}
    if not component.begin:
        at = component.name_end
        yield Edit(at, at, f"({', '.join(missing.values())})".encode())
        return
    at = component.begin
    while at < component.end:
        stop = _ends(bare, at, component.end)
        modifier = _MODIFIER.match(bare, at, stop)
        name = modifier[2].decode() if modifier else ""
        if modifier and name in missing:
            yield _set(bare, component, modifier, stop, texts[name])
            del missing[name]
        at = stop + 1
    if missing:
        comma = ", " if bare[component.begin : component.end].strip() else ""
        yield Edit(component.end, component.end, f"{comma}{', '.join(missing.values())}".encode())


def _set(
    bare: bytes, component: _Component, modifier: re.Match[bytes], stop: int, value: str
) -> Edit:
    """One modifier, which ends before `stop`, with another value."""
    name = modifier[2].decode()
    at = modifier.end()
    if bare[at : at + 1] == b"(":
        at = _ends(bare, at + 1, stop, b"") + 1
    equals = re.compile(rb"\s*=\s*").match(bare, at, stop)
    if equals is not None and not bare[equals.end() : stop].strip():
        raise ValueError(f"component {component.name!r}: {name} has no value: is the file whole?")
    begin = equals.end() if equals is not None else at
    text = value if equals is not None else f"={value}"
    if not component.array or b"each" in modifier[1]:
        return Edit(begin, stop, text.encode())
    final = "final " if b"final" in modifier[1] else ""
    return Edit(modifier.start(1), stop, f"each {final}{name}={value}".encode())


def _ends(text: bytes, begin: int, end: int, marks: bytes = b",") -> int:
    """End of a value: a comma, or the bracket that closes what is around it."""
    depth = 0
    for i in range(begin, end):
        one = text[i : i + 1]
        if depth == 0 and (one in (b")", b"]", b"}") or (marks and one in marks)):
            return i
        depth += (one in (b"(", b"[", b"{")) - (one in (b")", b"]", b"}"))
    return end
