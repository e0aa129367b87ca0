"""Friction blocks of Simscape."""

from __future__ import annotations

import math
import os
import re
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dryfric_control.arrays import Floats
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.simulators import joint_values
from dryfric_control.simulators.files import number, write_values
from dryfric_control.simulators.joint_values import SimulatorValues
from dryfric_control.store.files import file_path

# Breakaway velocities that are tried.
_TRIED = 60
# Characters that end or hide a line of MATLAB, or that an editor may change.
_NO_TEXT = re.compile("([\x00-\x1f\x7f-\x9f\u2028\u2029])")
_NAMES = {
    ("rad", "N m"): (("brkwy_trq", "N*m"), ("Col_trq", "N*m"), ("visc_coef", "N*m*s/rad"),
                     ("brkwy_vel", "rad/s")),
    ("m", "N"): (("brkwy_frc", "N"), ("Col_frc", "N"), ("visc_coef", "N*s/m"),
                 ("brkwy_vel", "m/s")),
}  # fmt: skip


def _speeds(speed: Floats, axis: FrictionAxis) -> Floats:
    top = float(np.max(speed))
    return np.geomspace(1e-3 * top, top, _TRIED)


def _friction_columns(v: Floats, breakaway_velocity: float) -> Floats:
    """Columns of the excess of the breakaway force, the Coulomb level and the viscous part."""
    near = v / (math.sqrt(2.0) * breakaway_velocity)
    peak = math.sqrt(2.0 * math.e) * near * np.exp(-np.minimum(near**2, 700.0))
    return np.column_stack((peak, np.tanh(10.0 * v / breakaway_velocity), v))


_SIMSCAPE = joint_values.Format(
    lambda c, shape, breakaway, axis: {
        "breakaway": float(c[0] + c[1]),
        "coulomb": float(c[1]),
        "viscous": float(c[2]),
        "breakaway_velocity": float(shape),
    },
    breakaway=True,
    columns=_friction_columns,
    shapes=_speeds,
)


def to_simscape(
    result: Any,
    path: str | os.PathLike[str],
    joint: str | None = None,
    *,
    velocities: ArrayLike | None = None,
) -> SimulatorValues:
    """Write a script that sets friction blocks of Simscape.

    Parameters
    ----------
    result : Fit, Diagnosis, FrictionAxis, or mapping of str to such
        What is known of the joint, or of each by the path of its block: ``{"arm/Elbow": found}``.
    path : path-like
        MATLAB script to write.
    joint, velocities
        As for `to_mjcf`; a joint is the path of its block.

    Notes
    -----
    The blocks state, with w_b the breakaway velocity,

    .. math:: T = \\sqrt{2e} (T_b - T_C) \\frac{w}{\\sqrt 2 w_b} e^{-(w / \\sqrt 2 w_b)^2}
              + T_C \\tanh(10 w / w_b) + f w

    whose peak has another shape than that of `Stribeck`: it is fitted by least squares.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=0.3, viscous=0.2, coulomb=1.5, units=("rad", "N m"))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     script = pathlib.Path(folder, "friction.m")
    ...     found = dfc.simulators.to_simscape({"arm/Elbow": axis}, script)
    ...     print(script.read_text().splitlines()[0])
    set_param('arm/Elbow', 'brkwy_trq', '1.5', 'brkwy_trq_unit', 'N*m');
    """
    joints = joint_values.joints_of(result, joint, {}, tuple(_NAMES))
    place = file_path("path", path)
    found = joint_values.describe_joints(_SIMSCAPE, joints, velocities)
    lines = []
    for name, values in found.values.items():
        block = _matlab_literal(name)
        names = _NAMES[joints[name].axis.units]
        for (parameter, unit), value in zip(names, map(number, values.values()), strict=True):
            words = f"{block}, '{parameter}', '{value}', '{parameter}_unit', '{unit}'"
            lines.append(f"set_param({words});\n")
    return write_values(found, place, "".join(lines).encode())


def _matlab_literal(name: str) -> str:
    """A name as text of MATLAB, where a line break and the like must be numbers."""
    pieces = _NO_TEXT.split(name)
    texts = [f"'{one.replace(chr(39), 2 * chr(39))}'" if i % 2 == 0 else f"char({ord(one)})"
             for i, one in enumerate(pieces) if one]  # fmt: skip
    return texts[0] if len(texts) == 1 else f"[{' '.join(texts)}]"
