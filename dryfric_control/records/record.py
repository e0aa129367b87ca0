"""Measured data, validated at the door: nothing behind `Record` has to ask again."""

from __future__ import annotations

import itertools
import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.signal import savgol_coeffs, savgol_filter

from dryfric_control import drawing
from dryfric_control.arrays import Bools, Floats
from dryfric_control.checks import finite, instance, positive, string, whole
from dryfric_control.compiled.windowed_runs import NO_FORCE
from dryfric_control.records import bad_readings
from dryfric_control.records import record_checks as checks
from dryfric_control.records.bad_readings import NONE, Masked
from dryfric_control.records.clock import stamp_text
from dryfric_control.records.data_check import RecordCheck, assumed_units, check_record, factors
from dryfric_control.records.motion import directions
from dryfric_control.records.readers.channels import EXTRAS, MAX_ROWS, ROLES
from dryfric_control.records.readers.reading import read_as
from dryfric_control.records.readers.text_file import FORMAT, SIGNATURE
from dryfric_control.records.record_warning import RecordWarning, warn
from dryfric_control.records.refusal import RefusalError
from dryfric_control.records.resolution import ROUNDING, Resolution
from dryfric_control.store.files import file_path, replace_file
from dryfric_control.store.saved import Saved
from dryfric_control.text import table
from dryfric_control.ties import samples
from dryfric_control.units import check_units

if TYPE_CHECKING:
    import pandas
    import xarray

    from dryfric_control.estimation.force_explorer import ForceExplorer
    from dryfric_control.estimation.force_map import ForceMap
    from dryfric_control.model.axis import FrictionAxis

__all__ = ["Derivatives", "Record", "RecordWarning"]

_WINDOWS = (5, 7, 9, 11, 13, 15, 19, 23, 27, 33, 41, 51, 61, 75, 91, 101)


class Derivatives(NamedTuple):
    """Smoothed position, velocity and acceleration, each shape (n,)."""

    x: Floats
    v: Floats
    a: Floats


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Record(Saved):
    """Measured run of one axis, uniformly sampled.

    The arrays are copied to float64 and made read-only.

    Parameters
    ----------
    t : array_like, shape (n,)
        Time [s], increasing in steps that agree within 1 %.
    u : array_like, shape (n,)
        Drive force or torque, ``u[k]`` held from ``t[k]`` to ``t[k+1]``; None for a free motion.
    x : array_like, shape (n,)
        Measured position at ``t[k]``; None for the integral of ``channels["v"]``, from 0.
    reference : array_like, shape (n,), optional
        Commanded position.
    units : mapping, optional
        Units of the channels, such as ``{"u": "N", "x": "m"}``, kept through every
        operation and held against those of an axis; scaled units such as mm are refused.
    name : str, optional
        Title in plots and tables.
    notes : sequence of str, optional
        What was done to the data before.
    quantum : float, optional
        Encoder quantum [unit of x]; 0 for none; estimated when left out.
    unwrap : float, optional
        Period of an encoder that wraps around [unit of x]; jumps of over half of it are undone.
    load : array_like, shape (n,), optional
        Force or torque on the mass beside the drive that a model knows, in the unit of `u`, held
        as it is, and positive as it is; no effect on the drive changes it.
    channels : mapping, optional
        Measured velocity ``"v"``, acceleration ``"a"`` and position of a second encoder ``"x2"``,
        each shape (n,); kept and cut with the rest, see `compare`.
    raw : mapping, optional
        Unit in which a channel was stored and its factor, such as ``{"x": ("counts", 1e-6)}``.
    good : array_like of bool, shape (n,), optional
        Readings of ``x`` that may be used.  Default: all but jumps, and repetitions in motion.

    Attributes
    ----------
    dt : float
        Sampling step [s].
    masked : Masked
        Readings that are not used: ``indices``, ``reasons`` and ``readings``; ``x`` bridges them.

    Warns
    -----
    RecordWarning
        Of a time that is not in seconds, a clipped input, jumps, or readings that are masked.

    Notes
    -----
    An estimated quantum is the largest step of which 98 % of the differences of positions are whole
    multiples (within a tenth).

    A velocity from ``x[k+1] - x[k-1]`` sees the mean of ``u[k-1]`` and ``u[k]``, not ``u[k]``.

    Examples
    --------
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> t = 1e-3 * np.arange(2000)
    >>> record = dfc.Record(t=t, u=np.cos(t), x=1e-6 * np.round(1e4 * np.sin(3 * t)))
    >>> record.dt, len(record), round(1e6 * record.quantum, 9)
    (0.001, 2000, 1.0)
    >>> train, test = record.split(0.6)
    >>> len(train), float(test.t[0])
    (1200, 1.2)
    """

    t: Floats
    u: Floats
    x: Floats
    reference: Floats | None
    dt: float
    units: Mapping[str, str]
    name: str | None
    notes: tuple[str, ...]
    quantum: float | None
    channels: Mapping[str, Floats]
    raw: Mapping[str, tuple[str, float]]
    masked: Masked
    _kind = "record"
    _otherwise = "; files of measurements are read by read_record"

    def __init__(
        self,
        t: npt.ArrayLike,
        u: npt.ArrayLike | None,
        x: npt.ArrayLike | None,
        reference: npt.ArrayLike | None = None,
        *,
        units: Mapping[str, str] | None = None,
        name: str | None = None,
        notes: Sequence[str] = (),
        quantum: float | None = None,
        unwrap: float | None = None,
        load: npt.ArrayLike | None = None,
        channels: Mapping[str, npt.ArrayLike] | None = None,
        raw: Mapping[str, tuple[str, float]] | None = None,
        good: npt.ArrayLike | None = None,
    ) -> None:
        labels = checks.without_load(checks.checked_units(units))
        if name is not None:
            string("name", name)
        if quantum is not None:
            quantum = positive("quantum", quantum, zero=True)
        channels = checks.with_load(channels, load)
        found, made = checks.vectors(t, u, x, reference, channels)
        notes = checks.checked_notes(notes) + made
        stored = checks.checked_raw(raw)
        if x is None:
            quantum = 0.0
            labels = labels | position_unit(labels)
        dt = checks.uniform_step(found["t"])
        usable = usable_readings(good, found["x"].size)
        factor = stored.get("x", ("", 1.0))[1]
        found = checks.unwrap_encoder(found, unwrap, factor)
        if unwrap is not None:
            notes += (f"x unwrapped with period {unwrap:g}",)
        found["x"], masked, seen = repair_positions(found["x"], quantum, factor, usable)
        checks.check_motion(found["u"], found["x"], seen or None)
        if quantum is not None and quantum > (span := np.ptp(found["x"])):
            raise ValueError(
                f"quantum = {quantum:g} exceeds the range, {span:.6g}: give it in the unit of x"
            )
        checks.warn_if_suspect(found["t"], dt, found["u"], "t" in stored)
        name = None if name is None else checks.plain_text(name)
        parts = {"dt": dt, "units": labels, "name": name, "notes": notes, "raw": stored}
        parts |= {"quantum": seen or None, "masked": masked}
        self.__setstate__(_channels_apart(found) | parts)
        if usable is None and masked.indices.size:
            k = int(masked.indices[0])
            warn(
                f"of {len(self)} readings of x these are masked: "
                f"{counts_text(self.bad | {'clipped': 0})}; the first is x[{k}] = "
                f"{masked.readings[0]:.6g} at t = {stamp_text(self.t[k], dt)} s. "
                "record.masked lists them, good=np.ones(len(x), bool) keeps all"
            )

    def __setstate__(self, parts: Mapping[str, Any]) -> None:
        """Take parts as they are, arrays read-only."""
        self.__dict__.update(parts, masked=Masked(*parts["masked"]))
        for array in (*self._arrays().values(), *self.masked[::2]):
            array.setflags(write=False)
        for name in ("units", "channels", "raw"):
            self.__dict__[name] = MappingProxyType(dict(parts[name]))

    def _arrays(self) -> dict[str, Floats]:
        """Time, input, position and whatever else there is, by name."""
        own = {"t": self.t, "u": self.u, "x": self.x}
        if self.reference is not None:
            own["reference"] = self.reference
        return own | dict(self.channels)

    def _with_changes(self, note: str = "", **changes: Any) -> Record:
        """A record made from this one; a part of it may well stand still."""
        kept = self.__getstate__() | changes
        return _assemble_record(kept | {"notes": kept["notes"] + (note,) * bool(note)})

    def _at_samples(self, pick: slice) -> dict[str, Any]:
        """What is left of the channels and the mask at some samples."""
        # One after another in memory, as compiled functions want them.
        arrays = {name: np.ascontiguousarray(one[pick]) for name, one in self._arrays().items()}
        return _channels_apart(arrays) | {"masked": self.masked.in_slice(pick)}

    def __getstate__(self) -> dict[str, Any]:
        """What a record holds, as plain values and arrays."""
        parts = {name: self.__dict__[name] for name in _PARTS}
        return {k: dict(v) if isinstance(v, Mapping) else v for k, v in parts.items()}

    def __len__(self) -> int:
        return int(self.t.size)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Record):
            return NotImplemented
        one, two = (r._arrays() | {"masked": r.masked.indices} for r in (self, other))
        return (
            (self.units, self.name) == (other.units, other.name)
            and one.keys() == two.keys()
            and all(np.array_equal(one[name], two[name]) for name in one)
        )

    __hash__ = None  # type: ignore[assignment]

    @property
    def known_load(self) -> Floats | None:
        """Known force on the mass beside the drive, shape (n,) [unit of u]; None for none."""
        return self.channels.get("load")

    @property
    def known_force(self) -> Floats:
        """The same as kernels take it: shape (0,) for none."""
        return self.channels.get("load", NO_FORCE)

    @property
    def net_input(self) -> Floats:
        """Input and load together, shape (n,) [unit of u]."""
        return self.u if self.known_load is None else self.u + self.known_load

    @property
    def duration(self) -> float:
        """Time covered [s], the last held sample included."""
        return len(self) * self.dt

    @cached_property
    def range(self) -> float:
        """Distance between the extreme positions [unit of x]."""
        return float(np.ptp(self.x))

    @cached_property
    def integrated(self) -> bool:
        """Whether the position is the integral of the velocity, not a reading."""
        v = self.channels.get("v")
        if v is None:
            return False
        steps = 0.5 * self.dt * (v[1:] + v[:-1])
        return bool(np.allclose(np.diff(self.x), steps, rtol=1e-6, atol=1e-9 * self.range))

    @cached_property
    def noise(self) -> float:
        """Standard deviation of the fast position noise [unit of x].

        From the median size of fourth differences; at least quantum / sqrt(12).
        """
        return checks.spread_of(self.x, self.quantum or 0.0)

    @cached_property
    def good(self) -> Bools:
        """Readings that may be used, shape (n,)."""
        good = bad_readings.mask_without(len(self), self.masked.indices)
        good.setflags(write=False)
        return good

    @cached_property
    def measured(self) -> Floats:
        """Positions as they were recorded, those not used included, shape (n,)."""
        x = self.x.copy()
        x[self.masked.indices] = self.masked.readings
        x.setflags(write=False)
        return x

    @cached_property
    def bad(self) -> dict[str, int]:
        """Number of bad samples by kind; masked are all but those of a clipped input.

        "jump": a single reading away from both neighbours; "repeated": the reading
        before once more, while the axis moves; "filled": none was recorded; "given":
        left out by the user; "clipped": the input rests at both its extremes.  Where
        it was clipped on its way to the record, the force is not known.
        """
        counts = {reason: self.masked.reasons.count(reason) for reason in bad_readings.REASONS}
        return counts | {"clipped": int(self._input_clipped.sum())}

    @cached_property
    def _input_clipped(self) -> Bools:
        return checks.clipped_samples(self.u, self.x)

    @cached_property
    def resolution(self) -> Resolution:
        """Noise, quantum and rounding: what this record cannot separate."""
        return Resolution(self.noise, self.quantum or 0.0, ROUNDING * self.range)

    @cached_property
    def input_quantum(self) -> float:
        """Steps in which the input was recorded [unit of u]; 0 for none."""
        return checks.estimated_quantum(self.u) or 0.0

    @cached_property
    def smoothing_window(self) -> int:
        """Default window of `derivatives` [samples].

        The shortest at which noise is at most 5 % of the large accelerations, 101 at most.
        """
        middle = max(0, len(self) // 2 - 500_000)
        x = self.x[middle : middle + 1_000_000]
        for size in _WINDOWS:
            if size > len(x) // 5:
                break
            left = self.noise * float(np.linalg.norm(savgol_coeffs(size, 3, 2, self.dt)))
            a = np.abs(savgol_filter(x, size, 3, 2, self.dt))
            if left <= 0.05 * float(np.quantile(a, 0.95)):
                break
        return max(_WINDOWS[0], min(size, (len(self) - 1) | 1))

    def read(
        self, positions: npt.ArrayLike, rng: np.random.Generator, origin: float | None = None
    ) -> Record:
        """Another path as this record's encoder would read it.

        Parameters
        ----------
        positions : array_like, shape (n,)
            Position at each ``t[k]`` [unit of x]; it may stand still.
        rng : numpy.random.Generator
            Source of the noise, which is normal and white.
        origin : float, optional
            A place of the encoder's grid [unit of x]; anywhere when left out.
        """
        path = self._one_each("positions", positions)
        instance("rng", rng, np.random.Generator, "numpy.random.default_rng(0)")
        shift = None if origin is None else finite("origin", origin)
        x = path + self.resolution.fast * rng.standard_normal(path.size)
        if quantum := self.resolution.quantum:
            shift = rng.uniform(0.0, quantum) if shift is None else shift
            x = quantum * np.round((x - shift) / quantum) + shift
        kept = {name: one for name, one in self.channels.items() if name == "load"}
        return self._with_changes("read anew", x=x, channels=kept, masked=NONE)

    def replace(self, u: npt.ArrayLike | None = None, x: npt.ArrayLike | None = None) -> Record:
        """The record with another input or other positions.

        Parameters
        ----------
        u, x : array_like, shape (n,), optional
            What takes the place of the input and of the positions.
        """
        given = {name: values for name, values in (("u", u), ("x", x)) if values is not None}
        new: dict[str, Any] = {name: self._one_each(name, one) for name, one in given.items()}
        return self._with_changes(**new)

    def _one_each(self, name: str, values: npt.ArrayLike) -> Floats:
        """Finite numbers, one for each sample."""
        array = checks.vector(name, values)
        if array.size != len(self):
            raise ValueError(
                f"{name} has {array.size} samples but the record has {len(self)}; give one each"
            )
        return array

    def __getitem__(self, key: slice) -> Record:
        """The samples of a slice with step 1."""
        if not isinstance(key, slice):
            raise TypeError(f"a record takes slices, record[a:b]; got {key!r}. Use record.x[k]")
        start, stop, step = key.indices(len(self))
        if step != 1:
            raise ValueError(f"slice step {step}: use record.decimated({abs(step)}) instead")
        if stop - start < 2:
            raise ValueError(
                f"the slice {start}:{stop} of a record of {len(self)} samples holds "
                f"{max(0, stop - start)}, at least 2 are needed"
            )
        return self._with_changes(**self._at_samples(slice(start, stop)))

    def window(self, t0: float | None = None, t1: float | None = None) -> Record:
        """The samples with t0 <= t < t1.

        Parameters
        ----------
        t0, t1 : float, optional
            Limits [s] on the record's own time axis; open when left out.
        """
        a = -math.inf if t0 is None else t0
        b = math.inf if t1 is None else t1
        for limit, value in (("t0", a), ("t1", b)):
            if not isinstance(value, (int, float, np.number)):
                raise ValueError(f"{limit} must be a number in s, got {value!r}")
        if a > b:
            raise ValueError(
                f"window: t0 = {stamp_text(a, self.dt)} s is after t1 = {stamp_text(b, self.dt)} "
                "s: exchange them, the start goes first"
            )
        start, stop = np.searchsorted(self.t, [a, b])
        if not a < b or stop - start < 2:
            raise ValueError(
                f"the window from {stamp_text(a, self.dt)} s to {stamp_text(b, self.dt)} s holds "
                f"fewer than 2 samples; the record runs from {self._time_span()}"
            )
        return self[int(start) : int(stop)]

    def split(self, parts: float | int | Sequence[float]) -> tuple[Record, ...]:
        """Contiguous parts that keep their absolute time.

        Parameters
        ----------
        parts : float, int or sequence of float
            Fraction of the first of two parts; number of equal parts; or fractions with sum 1.
        """
        if isinstance(parts, bool):
            raise ValueError(f"split needs a fraction, a number or fractions, got {parts}")
        if isinstance(parts, (int, np.integer)):
            if not 1 <= parts <= len(self) // 2:
                raise ValueError(f"{len(self)} samples do not make {parts} parts of 2 or more")
            fractions = np.full(int(parts), 1 / int(parts))
        elif isinstance(parts, (float, np.floating)):
            if parts > 1:
                raise ValueError(
                    f"split takes the fraction of the first of two parts, from 0 to 1, such as 0.6 "
                    f"for 60 %, or a whole number of equal parts; got {parts}"
                )
            fractions = np.array([parts, 1 - parts], dtype=float)
        else:
            fractions = checks.vector("fractions", parts)
        if not np.all(fractions > 0) or abs(fractions.sum() - 1) > 1e-9:
            raise ValueError(f"fractions must be positive with sum 1, got {fractions.tolist()}")
        edges = np.rint(np.cumsum(fractions) * len(self)).astype(int)[:-1].tolist()
        return tuple(self[a:b] for a, b in itertools.pairwise([0, *edges, len(self)]))

    def blocks(self, seconds: float) -> tuple[Record, ...]:
        """Contiguous blocks of equal length.

        Parameters
        ----------
        seconds : float
            Length of a block [s], rounded to whole samples. What is left at the end is a block of
            its own if at least half as long, else part of the last one.
        """
        size = min(len(self), samples(min(positive("seconds", seconds), self.duration), self.dt))
        if size < 2:
            raise ValueError(f"blocks of {seconds:g} s hold fewer than 2 samples of {self.dt:g} s")
        edges = list(range(0, len(self), size))
        if len(self) - edges[-1] < max(2, size / 2) and len(edges) > 1:
            edges.pop()
        return tuple(self[a:b] for a, b in itertools.pairwise([*edges, len(self)]))

    def decimated(self, factor: int) -> Record:
        """Every factor-th position with the mean input in between.

        The mean keeps the impulse of the held input. An incomplete group at the end is dropped.

        Parameters
        ----------
        factor : int
            Samples per group, 1 or more.
        """
        factor = whole("factor", factor)
        groups = len(self) // factor
        if groups < 2:
            raise ValueError(f"decimating {len(self)} samples by {factor} leaves fewer than 2")
        if factor == 1:
            return self
        pick = slice(0, groups * factor, factor)
        held = {"u": self.u} | ({} if self.known_load is None else {"load": self.known_load})
        means = {k: one[: pick.stop].reshape(groups, -1).mean(axis=1) for k, one in held.items()}
        parts = self._at_samples(pick) | {"u": means.pop("u"), "dt": self.dt * factor}
        parts["channels"] |= means
        return self._with_changes(f"decimated by {factor}", **parts)

    def commanded(self, gain: float | None = None) -> Record:
        """The record of a position servo, its drive a proportional law.

        For a log of commands and positions alone: the input is ``gain * (reference - x)``.

        Parameters
        ----------
        gain : float, optional
            Gain of the position controller [N/m].  Default: 1.  Forces are then known only in
            ratio to it: give the axis an effect `InputGain` with a guess of the gain.
        """
        if self.reference is None:
            raise ValueError(
                "record has no reference: read the commands of the servo as one, "
                'columns={"reference": ...}'
            )
        u = self.reference - self.x
        if not np.any(u):
            raise ValueError("record.reference is the position itself: give the commands")
        units = {k: v for k, v in self.units.items() if k != "u"}
        if gain is None:
            note = "u is reference - x: forces are known only in ratio to the gain of the servo"
            units |= {"u": units["x"]} if "x" in units else {}
        else:
            u *= positive("gain", gain)
            note = f"u is {float(gain):g} (reference - x)"
        others = tuple(one for one in self.notes if one != checks.NO_DRIVE)
        return self._with_changes(note, u=u, units=units, notes=others)

    def resampled(self, dt: float) -> Record:
        """The record at another step, as `from_irregular` does it.

        Parameters
        ----------
        dt : float
            New step [s].
        """
        dt = positive("dt", dt)
        new = checks.resample(self._arrays(), dt, "zero", "monotone")
        note = f"resampled from {self.dt:g} s to {dt:g} s"
        masked = bad_readings.mask_filled(self.t[self.good], new["t"], new["x"], dt)
        return self._with_changes(note, dt=dt, masked=masked, **_channels_apart(new))

    @classmethod
    def from_irregular(
        cls,
        t: npt.ArrayLike,
        u: npt.ArrayLike | None,
        x: npt.ArrayLike | None,
        reference: npt.ArrayLike | None = None,
        *,
        dt: float | None = None,
        hold: str = "zero",
        interpolation: str = "monotone",
        max_gap: float | None = None,
        **options: Any,
    ) -> Record:
        """Record on a uniform grid from irregular time stamps.

        Parameters
        ----------
        t, u, x, reference : array_like, shape (n,)
            As for `Record`; ``t`` increasing with any steps.  Samples that are not finite, and up
            to 5 % that repeat a stamp, count as lost.
        dt : float, optional
            Step of the grid [s]; the median step when left out.
        hold : {"zero", "first"}
            How ``u`` runs between stamps. Held (``"zero"``), a new sample is the mean of the held
            input over its step, which keeps the impulse; where samples were lost, values in
            between are linear. Linear (``"first"``), it is the value at the new stamp.
        interpolation : {"monotone", "linear", "cubic"}
            For ``x`` and ``reference``. ``"monotone"`` (PCHIP) does not overshoot, so an axis at
            rest stays at rest; ``"cubic"`` is a spline.
        max_gap : float, optional
            Longest step that may be filled [s], 5 median steps when left out.
        **options
            Those of `Record`.

        Examples
        --------
        >>> import numpy as np
        >>> import dryfric_control as dfc
        >>> t = np.cumsum(np.tile([0.004, 0.005, 0.006], 40))
        >>> dfc.Record.from_irregular(t, np.cos(t), np.sin(t)).dt
        0.005
        """
        more = checks.with_load(options.pop("channels", None), options.pop("load", None))
        found, made = checks.vectors(t, u, x, reference, more, gaps=True)
        good = usable_readings(options.pop("good", None), found["x"].size)
        found, good, lacking = checks.sound_rows(found, good)
        tv = found["t"]
        if x is None:
            labels = checks.checked_units(options.get("units"))
            options |= {"units": labels | position_unit(labels), "quantum": 0.0}
        steps = checks.increasing_steps(tv)
        median = float(np.median(steps))
        step = float(f"{median:.3g}") if dt is None else positive("dt", dt)
        limit = 5 * median if max_gap is None else positive("max_gap", max_gap)
        limit += 1e-3 * median  # time stamps are rounded
        if np.any(steps > limit):
            k = int(np.argmax(steps > limit))
            raise RefusalError(
                f"gap of {steps[k]:.4g} s after t[{k}] = {stamp_text(tv[k], median)} s, longer "
                f"than {limit:.3g} s: filling it would invent data. Use "
                "Record.split_at_gaps(...), or allow it with "
                f"max_gap={1.01 * float(steps.max()):.3g}",
                **checks.short_gap(steps),
            )
        factor = checks.checked_raw(options.get("raw")).get("x", ("", 1.0))[1]
        found = checks.unwrap_encoder(found, options.pop("unwrap", None), factor)
        notes = [*checks.checked_notes(options.get("notes", ())), *made, *filter(None, [lacking])]
        xv, masked, seen = repair_positions(found["x"], options.get("quantum"), factor, good)
        checks.check_motion(found["u"], xv, seen or None)
        even = bad_readings.uniform_stamps(tv, xv, checks.spread_of(xv, seen))
        if even is not None:
            late = float(np.ptp(tv - even))
            notes.append(f"stamps off by up to {late:.3g} s put back on a uniform clock")
            tv = even
        notes.append(
            f"resampled from stamps {steps.min():.4g} to {steps.max():.4g} s apart to {step:g} s"
        )
        new = checks.resample(found | {"t": tv, "x": xv}, step, hold, interpolation)
        # Readings that were bad leave a gap as those that were lost do.
        stamps = tv[bad_readings.mask_without(tv.size, masked.indices)]
        gaps = bad_readings.mask_filled(stamps, new["t"], new["x"], step)
        lost = len(gaps.reasons)
        usable = bad_readings.mask_without(new["t"].size, gaps.indices)
        options |= {"notes": notes, "good": usable, "quantum": seen, **_channels_apart(new)}
        record = cls(**options)
        if lost or even is not None or lacking:
            parts = [f"{lost} filled and masked"] * bool(lost) + notes[-2:-1] * (even is not None)
            before = f"{lacking} in the source; " if lacking else ""
            after = "; ".join(parts) or "none lost"
            warn(f"{before}of {len(record)} samples of the new record: {after}")
        return record._with_changes(masked=gaps)

    @classmethod
    def split_at_gaps(
        cls,
        t: npt.ArrayLike,
        u: npt.ArrayLike | None,
        x: npt.ArrayLike | None,
        reference: npt.ArrayLike | None = None,
        *,
        units: Mapping[str, str] | None = None,
        name: str | None = None,
        channels: Mapping[str, npt.ArrayLike] | None = None,
    ) -> tuple[Record, ...]:
        """One record for each stretch without a gap in time.

        Parameters
        ----------
        t, u, x, reference, units, name, channels
            As for `Record`.

        Warns
        -----
        RecordWarning
            When stretches of fewer than 10 samples are left out.
        """
        if name is not None:
            string("name", name)
        found, _ = checks.vectors(t, u, x, reference, channels)
        tv = found["t"]
        steps = checks.increasing_steps(tv)
        edges = [0, *(np.flatnonzero(steps > 1.5 * np.median(steps)) + 1).tolist(), tv.size]
        checks.check_motion(found["u"], found["x"])
        labels = checks.checked_units(units)
        step = float(np.median(steps))
        quantum = checks.estimated_quantum(found["x"], 1.0)
        parts = {"dt": step, "units": labels, "name": name, "notes": (), "raw": {}}
        parts |= {"quantum": quantum, "masked": NONE}
        whole = _assemble_record(_channels_apart(found) | parts)
        stretches = [(a, b) for a, b in itertools.pairwise(edges) if b - a >= checks.MIN_SAMPLES]
        if not stretches:
            raise ValueError(
                f"the longest stretch without a gap has {max(np.diff(edges))} samples, at least "
                f"{checks.MIN_SAMPLES} are needed; use Record.from_irregular"
            )
        if lost := tv.size - sum(b - a for a, b in stretches):
            warn(f"{lost} samples in stretches of fewer than {checks.MIN_SAMPLES} were left out")
        return tuple(
            whole[a:b]._with_changes(dt=checks.uniform_step(tv[a:b])) for a, b in stretches
        )

    def derivatives(self, window: int | None = None) -> Derivatives:
        """Zero-phase position, velocity and acceleration.

        Parameters
        ----------
        window : int, optional
            Odd number of samples, 5 or more; `smoothing_window` when left out.

        Returns
        -------
        Derivatives
            Named tuple ``(x, v, a)``, each shape (n,).

        Notes
        -----
        Cubic Savitzky-Golay fit. With white noise of standard deviation s, that of the acceleration
        is about s sqrt(720 / N^5) / dt^2 for a window of N samples. What happens within a window, a
        breakaway say, is smeared over it.
        """
        size = self.smoothing_window if window is None else window
        if isinstance(size, bool) or not isinstance(size, (int, np.integer)) or size % 2 == 0:
            raise ValueError(f"window must be an odd number of samples, got {size!r}")
        if not _WINDOWS[0] <= size <= len(self):
            raise ValueError(
                f"window of {size} samples: it must be at least {_WINDOWS[0]} and at most the "
                f"{len(self)} samples of the record"
            )
        x, v, a = (savgol_filter(self.x, int(size), 3, deriv, self.dt) for deriv in (0, 1, 2))
        return Derivatives(x, v, a)

    def force_map(self, axis: FrictionAxis | None = None, hold: str = "zero") -> ForceMap:
        """What remains of the drive: over position, velocity and time.

        The force that the motion requires, beyond drive and friction of a model: a picture of what
        the model lacks, before any fit.  It has the drive and what follows a reversal, too.

        Parameters
        ----------
        axis : FrictionAxis, optional
            The model.  Default: ``dfc.axis_from(record)``.
        hold : {"zero", "first"}, optional
            Whether the recorded input is held or interpolated linearly between samples.

        Returns
        -------
        ForceMap

        Raises
        ------
        ValueError
            If an argument is of the wrong kind, or the units differ from those of the axis.

        Warns
        -----
        RecordWarning
            When a unit or a sign seems wrong.

        Examples
        --------
        >>> import dryfric_control as dfc
        >>> axis = dfc.FrictionAxis(mass=2.4, viscous=12.0, coulomb=9.0)
        >>> found = dfc.datasets.belt_stage().force_map(axis)
        >>> sorted(found.curves)
        ['after_reversal', 'drive', 'place', 'time', 'velocity']
        """
        # Here: estimation is made of records.
        from dryfric_control.estimation.force_map import force_map

        return force_map(self._axis_to_look_with(axis), self, hold)

    def _axis_to_look_with(self, axis: FrictionAxis | None) -> FrictionAxis:
        """The model of a first look, the record's own where none is given; doubts are told."""
        # Here: they are made of records.
        from dryfric_control.estimation.plausibility import warn_if_implausible
        from dryfric_control.identification.first_axis import axis_from
        from dryfric_control.model.axis import FrictionAxis

        if axis is None:
            return axis_from(self)
        instance("axis", axis, FrictionAxis)
        check_units(axis, self)
        warn_if_implausible(axis, self)
        return axis

    def explore(self, axis: FrictionAxis | None = None, hold: str = "zero") -> ForceExplorer:
        """What remains of the drive, with sliders for the model.

        In a notebook with ipywidgets (the extra ``interactive``) the picture is redrawn while mass,
        viscous coefficient, Coulomb level, Stribeck peak and a line over position are turned;
        without it, it is a picture.  ``explore(axis).axis`` is the model as it stands.

        Parameters
        ----------
        axis : FrictionAxis, optional
            The model to start from.  Default: ``dfc.axis_from(record)``.
        hold : {"zero", "first"}, optional
            Whether the recorded input is held or interpolated linearly between samples.
        """
        # Here: estimation is made of records.
        from dryfric_control.estimation.force_explorer import ForceExplorer

        return ForceExplorer(self, self._axis_to_look_with(axis), hold)

    def compare(self, name: str, window: int | None = None) -> checks.Comparison:
        """Compare a measured channel with what the position implies.

        The channel is close to gain * expected + offset, `delay` later.

        Parameters
        ----------
        name : {"v", "a", "x2"}
            Velocity, acceleration or position of the second encoder.
        window : int, optional
            Smoothing of the position, as in `derivatives`.
        """
        measured = [one for one in self.channels if one != "load"]
        if string("name", name) not in measured:
            raise ValueError(
                f"the record has no channel {name!r}; it has {', '.join(measured) or 'none'}"
            )
        smooth = self.derivatives(window)
        expected = {"x2": smooth.x, "v": smooth.v, "a": smooth.a}[name]
        return checks.compare_channels(np.asarray(expected), self.channels[name], self.dt)

    @classmethod
    def from_frame(
        cls, frame: Any, columns: Mapping[str, str | int | None] | None = None, **options: Any
    ) -> Record:
        """Record from a data frame.

        Parameters
        ----------
        frame : DataFrame
            The time may be its index.
        columns : mapping, optional
            Role to column.
        **options
            All as in `read_record`.
        """
        if not hasattr(frame, "columns"):
            raise ValueError(f"from_frame needs a data frame, got {type(frame).__name__}")
        return read_as(cls, frame, columns, **{"max_rows": MAX_ROWS, **options})

    def to_pandas(self) -> pandas.DataFrame:
        """Data frame that `from_frame` turns back into this record.

        Columns such as ``"x [m]"``; name, quantum and notes in ``attrs``.
        """
        try:
            import pandas
        except ImportError as err:
            raise ImportError("to_pandas needs pandas: pip install pandas") from err
        frame = pandas.DataFrame({h: a.copy() for h, a in self._columns().items()})
        frame.attrs["dryfric_control"] = self._meta()
        return frame

    def to_xarray(self) -> xarray.Dataset:
        """Dataset over time, with units as attributes.

        Each channel is a variable along ``time`` with its unit in ``attrs["units"]``; readings
        that are masked are not a number in ``x``; name, quantum and notes are attributes.
        """
        try:
            import xarray
        except ImportError as err:
            raise ImportError("to_xarray needs xarray: pip install xarray") from err
        arrays = {name: array.copy() for name, array in self._arrays().items()}
        arrays["x"] = np.where(self.good, self.measured, np.nan)
        of = {role: self.units.get("x" if role == "reference" else role, "") for role in arrays}
        of["t"] = "s"
        variables = {
            role: ("time", array, {"units": of[role]} if of[role] else {})
            for role, array in arrays.items()
        }
        found = xarray.Dataset({k: v for k, v in variables.items() if k != "t"})
        found = found.assign_coords(time=variables["t"])
        found.attrs = {"name": self.name, "quantum": self.quantum or 0.0, "dt": self.dt}
        found.attrs["notes"] = "\n".join(self.notes)
        return found

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write a CSV file that `read_record` reads back bit for bit.

        Where readings are masked, ``x`` has what was recorded and the column ``good`` is 0.

        Parameters
        ----------
        path : path-like
            Replaced as a whole or not at all.
        """
        target = file_path("path", path)
        if target.suffix.lower() != ".csv":
            raise ValueError(f"to_csv writes .csv files, got {target.name!r}")
        columns = self._columns()
        with replace_file(target) as part, part.open("w", encoding="utf-8", newline="\n") as file:
            file.write(f"{SIGNATURE} {FORMAT} {json.dumps(self._meta())}\n")
            file.write(",".join(columns) + "\n")
            for a in range(0, len(self), 65_536):
                chunk = (c[a : a + 65_536].tolist() for c in columns.values())
                file.writelines(",".join(map(repr, row)) + "\n" for row in zip(*chunk, strict=True))

    def _columns(self) -> dict[str, npt.NDArray[Any]]:
        """Channels under headings with units."""
        arrays = self._arrays() | {"x": self.measured}
        named = {"load": "known_load"}
        columns = {self._label(named.get(r, r), r): array for r, array in arrays.items()}
        return columns | ({"good": self.good.astype(np.int64)} if self.masked.reasons else {})

    def _meta(self) -> dict[str, Any]:
        kept = {"name": self.name, "quantum": self.quantum or 0.0, "notes": list(self.notes),
                "masked": list(self.masked.reasons)}  # fmt: skip
        return kept | ({"raw": {k: list(v) for k, v in self.raw.items()}} if self.raw else {})

    def _label(self, text: str, role: str) -> str:
        unit = self.units.get({"reference": "x", "load": "u"}.get(role, role))
        return f"{text} [{unit}]" if unit else text

    def summary(self) -> str:
        """A few lines of text: size, ranges, quantum, noise, notes."""
        return table(self._rows())

    def _rows(self) -> list[tuple[str, str]]:
        unit_x = self._unit("x")
        rows = [
            ("record", self.name or "(no name)"),
            ("samples", f"{len(self)} at {self.dt:.6g} s, {self.duration:.6g} s"),
            ("time", self._time_span()),
            ("input", self._span("u", ".6g")),
            ("position", self._span("x", ".6g")),
            ("load", "" if self.known_load is None else self._span("load", ".6g")),
            ("reference", "yes" if self.reference is not None else "no"),
            ("units", assumed_units(self.units)),
            *(("channel", self._label(one, one)) for one in self.channels if one != "load"),
            ("factors", factors(self.raw)),
            ("quantum", f"{self.quantum:.6g}{unit_x}" if self.quantum else "none seen"),
            ("noise", f"{self.noise:.3g}{unit_x}"),
            ("bad samples", counts_text(self.bad)),
            *(("note", n) for n in self.notes),
        ]
        return [(what, words) for what, words in rows if words]

    def __repr__(self) -> str:
        title = f"{self.name!r}, " if self.name else ""
        u = self._span("u", ".4g")
        x = self._span("x", ".4g")
        return f"Record({title}{len(self)} samples, dt={self.dt:.6g} s, u {u}, x {x})"

    def _unit(self, role: str) -> str:
        """Unit behind a number."""
        return f" {self.units[role]}" if role in self.units else ""

    def _time_span(self) -> str:
        """First and last moment."""
        return f"{stamp_text(self.t[0], self.dt)} s to {stamp_text(self.t[-1], self.dt)} s"

    def _span(self, role: str, digits: str) -> str:
        """Range of a channel."""
        values = self._arrays()[role]
        unit = self._unit("u" if role == "load" else role)
        return f"{values.min():{digits}} to {values.max():{digits}}{unit}"

    def _repr_html_(self) -> str:
        return table(self._rows(), as_html=True)

    def check(self, axis: FrictionAxis | None = None) -> RecordCheck:
        """Reversals, rest, lost readings, clipping, gaps: before any fit.

        Parameters
        ----------
        axis : FrictionAxis, optional
            An axis that the record should be of: whether units, sign and columns agree with it.
        """
        if axis is None:
            return check_record(self, self._known_units())
        # Here: estimation is made of records.
        from dryfric_control.estimation.plausibility import record_doubts
        from dryfric_control.model.axis import FrictionAxis

        instance("axis", axis, FrictionAxis)
        check_units(axis, self)
        told = [doubt.message for doubt in record_doubts(axis, self)]
        return check_record(self, axis.units, told)

    def _known_units(self) -> tuple[str, str]:
        """Units of position and drive: those an axis has by default if nothing is said."""
        if not {"x", "u"} & set(self.units):
            return "m", "N"
        return self.units.get("x", ""), self.units.get("u", "")

    @drawing.panels(2)
    def plot(self, axes: Any) -> str:
        """Draw position and input over time; a grey band at rest."""
        top, bottom = axes
        top.plot(self.t[self.good], self.x[self.good], ".", color="0.6", ms=3, label="measured")
        left_out = self.masked.indices
        if left_out.size:
            top.plot(self.t[left_out], self.masked.readings, "C3x", ms=4, label="masked")
        if self.reference is not None:
            top.plot(self.t, self.reference, "C0--", lw=1, label="reference")
        moving = directions(self)
        for one, label in ((top, "at rest"), (bottom, None)):
            drawing.shade_stuck(one, self.t, moving, label)
        drawing.legend_above(top)
        bottom.plot(self.t, self.u, "-", color="0.4", lw=0.8, drawstyle="steps-post")
        if self.known_load is not None:
            style = {"color": "C1", "lw": 0.8, "drawstyle": "steps-post", "label": "known load"}
            bottom.plot(self.t, self.known_load, "-", **style)
            drawing.legend_above(bottom)
        if self.bad["clipped"]:
            upper = self.u > 0.5 * (self.u.min() + self.u.max())
            for side, label in ((~upper, None), (upper, "clipped")):
                limit = np.where(self._input_clipped & side, self.u, np.nan)
                bottom.plot(self.t, limit, "C3", lw=2.5, label=label)
            drawing.legend_above(bottom)
        named = zip(("position", "input"), self._known_units(), strict=True)
        drawing.over_time(axes, [f"{name} [{unit}]" if unit else name for name, unit in named])
        return self.name or "record"


def position_unit(units: Mapping[str, str]) -> dict[str, str]:
    """Unit of a position that is the integral of a velocity."""
    unit = units.get("v", "").removesuffix("/s")
    return {"x": unit} if unit else {}


def usable_readings(good: Any, size: int) -> Bools | None:
    """The user's own mask, checked; None for none."""
    if good is None:
        return None
    array = np.asarray(good)
    if array.shape != (size,) or array.dtype != np.bool_:
        raise ValueError(
            f"good must be {size} values True or False, one for each reading, got shape "
            f"{array.shape} of {array.dtype}"
        )
    if np.count_nonzero(array) < checks.MIN_SAMPLES:
        raise ValueError(
            f"good leaves {np.count_nonzero(array)} readings, at least {checks.MIN_SAMPLES} needed"
        )
    return array


def repair_positions(
    x: Floats, quantum: float | None, factor: float, good: Bools | None
) -> tuple[Floats, Masked, float]:
    """Positions bridged over what is bad, found or given, and their quantum, 0 for none."""

    def grid(sound: Bools) -> float:
        return quantum if quantum is not None else checks.estimated_quantum(x[sound], factor) or 0.0

    faults = np.array(bad_readings.fault_codes(x) if good is None else (), np.int64)
    step = grid(bad_readings.mask_without(x.size, faults) if good is None else good)
    if good is None:
        found = bad_readings.find(x, checks.spread_of(x, step), step)
        index = np.fromiter(found, np.int64, len(found))
        reasons = tuple(found.values())
    else:
        index = np.flatnonzero(~good)
        reasons = (bad_readings.GIVEN,) * index.size
    if not index.size:
        return x, NONE, step
    sound = bad_readings.mask_without(x.size, index)
    return bad_readings.interpolate_bad(x, sound), Masked(index, reasons, x[index]), grid(sound)


def counts_text(counts: Mapping[str, int]) -> str:
    """Counts in words."""
    return ", ".join(f"{count} {kind}" for kind, count in counts.items() if count)


def _channels_apart(arrays: Mapping[str, Floats]) -> dict[str, Any]:
    """Arrays by name as a record has them."""
    own = {role: arrays.get(role) for role in ROLES}
    return own | {"channels": {name: arrays[name] for name in EXTRAS if name in arrays}}


def _assemble_record(parts: Mapping[str, Any]) -> Record:
    """A record of parts as they are."""
    record = object.__new__(Record)
    record.__setstate__(parts)
    return record


_PARTS = tuple(item.name for item in fields(Record))
