"""From what a drive and an encoder say to the position and force of the axis."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Any, NamedTuple

from dryfric_control.arguments import with_argument_hints
from dryfric_control.checks import check_boolean, finite, known_keys, positive
from dryfric_control.records.record_warning import warn
from dryfric_control.store.files import read_toml
from dryfric_control.text import stated, with_parameters
from dryfric_control.units import si_unit

_CHANNELS = ("t", "u", "x", "v", "a", "x2")
# A lead [m] that was meant in millimetres.
_LONG_LEAD = 1.0
# What the table [record] says of the sampling, which `read_record` takes beside a scaling.
_SAMPLING = ("dt", "rate", "max_gap")


# What users call an argument, and what it is here.
_MEANT = {
    **dict.fromkeys(("pitch", "screw_pitch", "spindle_pitch", "travel_per_turn"), "lead"),
    **dict.fromkeys(("counts_per_rev", "counts_per_revolution", "cpr", "ppr", "resolution",
                     "encoder_resolution", "lines", "increments_per_turn"), "counts_per_turn"),
    **dict.fromkeys(("ratio", "gear", "reduction", "gearbox"), "gear_ratio"),
    **dict.fromkeys(("kt", "km", "motor_constant"), "torque_constant"),
    **dict.fromkeys(("kf",), "force_constant"),
    **dict.fromkeys(("nominal_torque", "rated", "torque"), "rated_torque"),
    **dict.fromkeys(("nominal_force", "force"), "rated_force"),
    **dict.fromkeys(("radius", "pulley_radius"), "pinion_radius"),
    **dict.fromkeys(("area",), "piston_area"),
}  # fmt: skip


class Conversion(NamedTuple):
    """Factor from a raw unit to the unit of the axis."""

    factor: float
    raw: str
    unit: str


def _with_right_names(cls: type[Any]) -> type[Any]:
    """Let the class say which argument is meant by one that it does not have."""
    known = {item.name: item.metadata.get("doc", "") for item in fields(cls)}

    def meant(name: str) -> str:
        own = _MEANT.get(name)
        return f"{own}=, {known[own].rstrip('.')}" if own else ""

    return with_argument_hints(cls, meant)


@_with_right_names
@with_parameters
@dataclass(frozen=True, kw_only=True)
class Scaling:
    """Factors of a machine from raw readings to SI units.

    Notes
    -----
    A gain, such as newtons per volt, converts the number in the file, in place of all else.
    ``x = counts / counts_per_turn / gear_ratio`` turns of the load, times 2 pi [rad] or `lead` [m];
    ``u = torque_constant * current * gear_ratio`` [N m], times 2 pi / `lead` [N], or
    ``u = piston_area * pressure`` [N]. A channel without a unit is taken to be in counts, amperes
    or per cent if the number for these is given. Losses of the gear are friction of the axis.

    Examples
    --------
    A ball screw of 5 mm behind a gear of 4, an encoder with 10000 counts on the motor:

    >>> import dryfric_control as dfc
    >>> scaling = dfc.Scaling(counts_per_turn=10000, gear_ratio=4, lead=5e-3, torque_constant=0.1)
    >>> scaling.conversion("x", "counts"), round(scaling.conversion("u", "A").factor, 3)
    (Conversion(factor=1.25e-07, raw='counts', unit='m'), 502.655)
    """

    gain: Mapping[str, float] = stated(
        "Factors on `u`, `x` with its reference, `v`, `a`, `x2`.", default_factory=dict
    )
    counts_per_turn: float | None = stated("Encoder counts per turn of its shaft.", None)
    gear_ratio: float = stated("Turns of the motor per turn of the load.", 1.0)
    lead: float | None = stated("Travel of a linear axis per turn of the load [m].", None)
    load_encoder: bool = stated("Whether the encoder sits on the load, behind the gear.", False)
    torque_constant: float | None = stated("Torque of the motor's shaft per current [N m/A].", None)
    rated_torque: float | None = stated("Torque of the motor's shaft at 100 % [N m].", None)
    force_constant: float | None = stated("Force of a linear motor per current [N/A].", None)
    rated_force: float | None = stated("Force of a linear motor at 100 % [N].", None)
    pinion_radius: float | None = stated("Radius of a rack's pinion or a belt's pulley [m].", None)
    piston_area: float | None = stated("Area on which a measured pressure acts [m^2].", None)

    def __post_init__(self) -> None:
        put = object.__setattr__
        if not isinstance(self.gain, Mapping):
            raise ValueError(f'gain must be a mapping such as {{"x": 1e-6}}, got {self.gain!r}')
        gains = {}
        for role, value in self.gain.items():
            if role not in _CHANNELS:
                raise ValueError(
                    f"gain: {role!r} is no channel; the channels are {', '.join(_CHANNELS)}"
                    + ("; the reference takes the gain of x" if role == "reference" else "")
                )
            gains[role] = _gain(f"gain[{role!r}]", value)
        put(self, "gain", MappingProxyType(gains))
        for item in fields(self):
            if item.default is None and (value := getattr(self, item.name)) is not None:
                put(self, item.name, positive(item.name, value))
        put(self, "gear_ratio", positive("gear_ratio", self.gear_ratio))
        for name, what in (("lead", "a screw"), ("pinion_radius", "a pinion")):
            if (value := getattr(self, name)) is not None and value >= _LONG_LEAD:
                warn(f"{name} = {value:g} is in metres: {what} of {value:g} mm has "
                     f"{name}={1e-3 * value:g}")  # fmt: skip
        put(self, "load_encoder", check_boolean("load_encoder", self.load_encoder))
        for one, other, what in (
            ("torque_constant", "force_constant", "a motor"),
            ("rated_torque", "rated_force", "a motor"),
            ("lead", "pinion_radius", "an axis"),
        ):
            if getattr(self, one) is not None and getattr(self, other) is not None:
                raise ValueError(f"{one} and {other} are both given: {what} has one of them")

    @classmethod
    def of(cls, gain: Any) -> Scaling:
        """Scaling from what `read_record` takes as its gain.

        Parameters
        ----------
        gain : float, mapping or Scaling
            Factor on the input, factors by channel, or a scaling as it is.
        """
        if isinstance(gain, Scaling):
            return gain
        if isinstance(gain, Mapping):
            return cls(gain=gain)
        number = _gain("gain", gain)
        return cls() if number == 1 else cls(gain={"u": number})

    @classmethod
    def from_file(cls, path: str | os.PathLike[str]) -> Scaling:
        """Scaling in the table ``[record]`` of an axis file.

        Parameters
        ----------
        path : path-like
            The file that `read_axis` reads; without the table nothing is scaled.
        """
        return read_toml(path, cls.from_dict, "record")

    def to_dict(self) -> dict[str, Any]:
        """What was given, as `from_dict` reads it."""
        default = Scaling()
        return {
            item.name: dict(value) if isinstance(value, Mapping) else value
            for item in fields(self)
            if (value := getattr(self, item.name)) != getattr(default, item.name)
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Scaling:
        """Scaling from the keys and values of a table.

        Parameters
        ----------
        data : mapping
            Such as the table ``[record]`` of an axis file; its sampling is passed over.
        """
        if not isinstance(data, Mapping):
            raise ValueError(
                f'data must be a mapping such as {{"counts_per_turn": 4096}}, got {data!r}'
            )
        known_keys("record.", data, [*(item.name for item in fields(cls)), *_SAMPLING])
        return cls(**{key: value for key, value in data.items() if key not in _SAMPLING})

    def conversion(self, role: str, unit: str) -> Conversion | None:
        """Factor that brings a channel to the axis, None for none.

        Parameters
        ----------
        role : str
            ``"u"``, ``"x"``, ``"reference"`` or ``"v"``, ``"a"``; others are left alone.
        unit : str
            Unit it is in, such as ``"mA"``, empty if it is not known.
        """
        if role not in ("u", "x", "reference", "v", "a"):
            return None
        factor, si = si_unit(role, unit) if unit else (1.0, "")
        found = self._drive(si) if role == "u" else self._motion(role, si)
        return found and Conversion(factor * found.factor, unit or found.raw, found.unit)

    @property
    def _travel(self) -> float | None:
        """Travel per turn of the load [m], None of a rotary axis."""
        return self.lead if self.pinion_radius is None else 2 * math.pi * self.pinion_radius

    def _motion(self, role: str, unit: str) -> Conversion | None:
        """Turns of the encoder to way of the load."""
        tail = {"v": "/s", "a": "/s^2"}.get(role, "")
        ratio = 1.0 if self.load_encoder else self.gear_ratio
        if not tail and unit in ("", "counts") and self.counts_per_turn is not None:
            turn = self.counts_per_turn
            raw = "counts"
        elif unit == "rad" + tail and (ratio != 1.0 or self._travel is not None):
            turn = 2 * math.pi
            raw = unit
        else:
            return None
        if self._travel is None:
            return Conversion(2 * math.pi / (turn * ratio), raw, "rad" + tail)
        return Conversion(self._travel / (turn * ratio), raw, "m" + tail)

    def _drive(self, unit: str) -> Conversion | None:
        """Current, per cent or torque of the motor to force or torque of the load."""
        if self.piston_area is not None and unit in ("Pa", ""):
            if not unit:
                raise ValueError(
                    "piston_area is given and u has no unit: name that of the pressure, such as "
                    'units={"u": "bar"}'
                )
            return Conversion(self.piston_area, unit, "N")
        motor = {  # of amperes, of per cent: force, torque, the number that this is for
            "A": (self.force_constant, self.torque_constant, 1.0),
            "%": (self.rated_force, self.rated_torque, 100.0),
        }
        unit = unit or next((one for one in motor if motor[one][:2] != (None, None)), "")
        force, torque, per = motor.get(unit, (None, None, 1.0))
        if force is not None:
            return Conversion(force / per, unit, "N")
        if unit == "N m" and (self.gear_ratio != 1.0 or self._travel is not None):
            torque = 1.0
        if torque is None:
            return None
        factor = torque / per * self.gear_ratio
        if self._travel is None:
            return Conversion(factor, unit, "N m")
        return Conversion(factor * 2 * math.pi / self._travel, unit, "N")


#: What `read_record` takes as its gain.
Gain = float | Mapping[str, float] | Scaling


def read_sampling(path: str | os.PathLike[str]) -> dict[str, float]:
    """Arguments `dt`, `rate` and `max_gap` of `read_record` in the table ``[record]`` of a file."""
    return read_toml(
        path,
        lambda data: {k: positive(f"record.{k}", data[k]) for k in _SAMPLING if k in data},
        "record",
    )


def _gain(name: str, value: Any) -> float:
    """A factor that is finite and not zero."""
    number = finite(name, value)
    if number == 0:
        raise ValueError(f"{name} must be finite and not zero, got {number}")
    return number
