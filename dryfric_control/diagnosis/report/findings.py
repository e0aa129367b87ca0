"""What a diagnosis found, as plain data, and its numbers as text."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dryfric_control.diagnosis.candidates import BASE, holds
from dryfric_control.diagnosis.remaining import Remaining
from dryfric_control.estimation.parameters import values_of
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects.naming import class_of, titles_of
from dryfric_control.records.bad_readings import Masks
from dryfric_control.records.record import Record
from dryfric_control.text import (
    Result,
    fields_of,
    length_text,
    percent,
    rotary_words,
    table,
    wrapped,
)

if TYPE_CHECKING:
    from dryfric_control.diagnosis.experiment import Experiment

VERDICTS = ("nothing to find", "explained", "partly explained", "unexplained", "not finished")
#: Relative change of a nominal value up to which it is a correction and no
#: finding: datasheets round, and friction changes by as much with the weather.
SMALL = 0.05
#: Said where a search has run out of time.
LATE = (
    "the time limit ended the search: the best answer so far; causes may be missing, and a base "
    "parameter may replace one: allow more time"
)


@dataclass(frozen=True, repr=False)
class Cause(Result):
    """One physical cause of what the simulation gets wrong.

    Attributes
    ----------
    effect : str
        Id of the effect; "inertia", "viscous", "coulomb" for a wrong base
        parameter.
    title : str
        Its name in words.
    parameters : dict of str to float
        Fitted values.
    standard_errors : dict of str to float
        Standard errors from blocks of the record, infinite where it
        leaves a parameter undetermined.
    units : dict of str to str
        Units of the parameters.
    held_out_gain : float
        Fall of the mean log score log(1 + (error/noise)^2 / 4) of free runs that
        the fit did not see, when this cause joins the others; where the likelihood
        decided, twice its gain per sample, which is of one-step predictions.
    interval : tuple of float
        90 % interval of `held_out_gain`.
    alternatives : tuple of str
        Effects that explain this record equally well in its place.
    explanation : str
        What it is physically.
    experiment : str
        What would expose it alone.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> cause = dfc.Cause(
    ...     effect="bias_force", title="bias force", parameters={"force": 2.0},
    ...     standard_errors={"force": 0.1}, units={"force": "N"}, held_out_gain=1.5,
    ...     interval=(1.2, 1.8), alternatives=("spring",),
    ...     explanation=dfc.effects.BiasForce.explanation,
    ...     experiment=dfc.effects.BiasForce.experiment,
    ... )
    >>> print(cause.summary())
    bias force (bias_force): force = 2.00 +- 0.10 N; alternatives: spring
    """

    effect: str
    title: str
    parameters: dict[str, float]
    standard_errors: dict[str, float]
    units: dict[str, str]
    held_out_gain: float
    interval: tuple[float, float]
    alternatives: tuple[str, ...]
    explanation: str
    experiment: str

    def _shown(self) -> list[str]:
        return [cause_text(self)]


class Causes(tuple[Cause, ...]):
    """Causes that show themselves, in print and in notebooks; a tuple otherwise.

    Examples
    --------
    >>> Causes()
    no causes
    """

    __slots__ = ()

    def __repr__(self) -> str:
        lines = [f"{i}. {cause_text(one)}" for i, one in enumerate(self, start=1)]
        return wrapped(lines) or "no causes"

    def _repr_html_(self) -> str:
        rows = [("", "cause", "parameters", "alternatives")]
        for i, one in enumerate(self, start=1):
            others = ", ".join(map(titles_of, one.alternatives)) or "none"
            rows.append((str(i), one.title, ", ".join(parameter_texts(one)), others))
        return table(rows, as_html=True) if self else f"<p>{self!r}</p>"


@dataclass(frozen=True, repr=False)
class Gain(Result):
    """Error of free runs on data that neither selection nor fit has seen.

    Attributes
    ----------
    before, after : float
        RMS error of position of the nominal and of the extended axis.
    floor : float
        The same for the extended axis run on a record that it made itself,
        read by the same encoder.
    interval : tuple of float
        90 % block-bootstrap interval of `ratio`.
    unit : str
        Unit of the errors.
    """

    before: float
    after: float
    floor: float
    interval: tuple[float, float]
    unit: str

    @property
    def ratio(self) -> float:
        """Error reduction (factor), before/after."""
        return self.before / self.after

    @property
    def headline(self) -> str:
        """Errors and their ratio in one line."""
        before, after, floor = (
            length_text(value, self.unit) for value in (self.before, self.after, self.floor)
        )
        low, high = map(plain, self.interval)
        return (
            f"{before} RMS before, {after} after; error reduction (factor) {plain(self.ratio)} "
            f"(90 %: {low} to {high}); noise floor {floor}"
        )

    def _shown(self) -> list[str]:
        return [self.headline]

    @property
    def left(self) -> float:
        """Share of the error above the noise floor that is left, 0 to 1.

        Notes
        -----
        sqrt((after^2 - floor^2) / (before^2 - floor^2))

        Examples
        --------
        >>> from dryfric_control.diagnosis import Gain
        >>> round(Gain(1e-3, 3e-5, 1e-5, (20.0, 50.0), "m").left, 3)
        0.028
        """
        if self.after >= self.before:
            return 1.0
        rest = max(self.after**2 - self.floor**2, 0.0)
        return min(math.sqrt(rest / (self.before**2 - self.floor**2)), 1.0) if rest else 0.0

    def to_dict(self) -> dict[str, Any]:
        """Numbers, ready for JSON."""
        return fields_of(self) | {"ratio": self.ratio, "left": self.left}


@dataclass(frozen=True, repr=False)
class Unexplained(Result):
    """Structure that is left when the found causes are in the model.

    Attributes
    ----------
    fraction : float
        Share of the error above the noise floor that is left, `Gain.left`; 0 where what is
        left is no more than noise.
    significant : bool
        Whether what is left is more than the noise floor makes.
    where : tuple of str
        Where it occurs: position, velocity, time, time since reversal, in words.
    """

    fraction: float
    significant: bool
    where: tuple[str, ...]

    def __float__(self) -> float:
        return self.fraction

    def _shown(self) -> list[str]:
        if not self.significant:
            return ["nothing unexplained beyond noise"]
        return [f"{percent(self.fraction)} of the error above noise is left", *self.where]


@dataclass(frozen=True, eq=False, repr=False)
class Findings:
    """What a diagnosis found, without words and figures; see `Diagnosis`."""

    axis: FrictionAxis
    record: Record
    verdict: str
    causes: tuple[Cause, ...]
    extended: FrictionAxis
    gain: Gain
    unexplained: Unexplained
    next_experiment: Experiment | None
    messages: tuple[str, ...]
    scores: dict[str, float]
    window: float
    roles: NDArray[np.int64]
    hold: str = "zero"
    remaining: Remaining = field(default_factory=Remaining)
    references: dict[str, float] = field(default_factory=dict)
    varies: dict[str, dict[str, list[float]]] = field(default_factory=dict)
    others: tuple[Record, ...] = ()
    not_tried: dict[str, str] = field(default_factory=dict)
    standard_errors: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "causes", Causes(self.causes))

    @property
    def masked(self) -> Masks:
        """Readings that were left out: indices and reasons, one entry a record.

        Examples
        --------
        >>> import numpy as np
        >>> import dryfric_control as dfc
        >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
        >>> t = 1e-3 * np.arange(6000)
        >>> u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
        >>> x = 1e-6 * np.round(1e6 * axis.simulate(u, dt=1e-3).y[0])
        >>> good = np.arange(6000) != 700
        >>> d = dfc.diagnose(axis, dfc.Record(t, u, x, good=good))
        >>> d.verdict, d.masked[0].indices.tolist(), d.masked[0].reasons
        ('nothing to find', [700], ('given',))
        >>> d.masked
        masked  from sample  to sample  readings
        given   700          700        1
        """
        return Masks(record.masked for record in (self.record, *self.others))

    @property
    def small_corrections(self) -> Causes:
        """Causes that only move nominal values by a few per cent."""
        return Causes(cause for cause in self.causes if self.is_small(cause))

    @property
    def main_causes(self) -> Causes:
        """Causes that are more than small corrections, in the order found."""
        return Causes(cause for cause in self.causes if not self.is_small(cause))

    def is_small(self, cause: Cause) -> bool:
        """Whether a cause only corrects nominal values by a few per cent.

        Places count beside the range of the record, angles beside 1 rad.
        """
        nominal = believed_values(self.axis, cause)
        scales = {"place": self.record.range, "angle": 1.0}
        return bool(nominal) and all(
            abs(cause.parameters[name] - before)
            <= SMALL * scales.get(kind_of(cause.effect, name), abs(before))
            for name, before in nominal.items()
        )


def kind_of(effect: str, parameter: str) -> str:
    """Kind of a parameter of a cause; an amount where the class does not know it."""
    cls = class_of(effect)
    known = cls.parameters() if cls else {}
    return str(known.get(parameter, {"kind": "amount"})["kind"])


def believed_values(axis: FrictionAxis, cause: Cause) -> dict[str, float]:
    """Nominal values of a cause's parameters; empty for a cause that is new to the axis."""
    axis = axis.effective()
    if cause.effect in BASE:
        names = {name: name for name in cause.parameters}
    elif holds(axis, cause.effect):
        names = {name: f"{cause.effect}.{name}" for name in cause.parameters}
    else:
        return {}
    values = values_of(axis, list(names.values()))
    return dict(zip(names, map(float, values), strict=True))


def with_error(value: float, error: float, unit: str = "1") -> str:
    """A value and its standard error with two digits; an infinite one leaves it open.

    Examples
    --------
    >>> with_error(-1.010704, 3.78e-5, "N")
    '-1.010704 +- 0.000038 N'
    >>> with_error(1234.5, 160.0), with_error(2.1e-5, 3e-7, "m")
    ('1230 +- 160', '(2.100 +- 0.030)e-05 m')
    >>> with_error(2.36, 54000.0, "N")
    '2.4 +- 5.4e+04 N'
    """
    unit = "" if unit == "1" else f" {unit}"
    if not math.isfinite(error):
        return f"{value:.3g}{unit} (undetermined)"
    if error <= 0.0:
        return f"{value:.5g}{unit}"
    last = int(f"{error:.1e}".split("e")[1]) - 1
    if value != 0.0 and round(value, -last) == 0.0:
        return f"{value:.2g} +- {error:.2g}{unit}"  # the value, not a zero that was not found
    size = max(abs(value), error)
    if 1e-3 <= size < 1e6:
        digits = max(-last, 0)
        return f"{round(value, -last):.{digits}f} +- {round(error, -last):.{digits}f}{unit}"
    power = int(f"{size:.15e}".split("e")[1])
    digits, scale = max(power - last, 0), 10.0**power
    return f"({value / scale:.{digits}f} +- {error / scale:.{digits}f})e{power:+03d}{unit}"


def change_text(kind: str, before: float, after: float, unit: str = "1") -> str:
    """Change of a nominal value in words; nothing where it was zero.

    Examples
    --------
    >>> change_text("amount", 2.8, 2.87), change_text("place", 0.1, 0.12, "m")
    ('+2.5 %', '+0.02 m')
    """
    if kind in ("place", "angle"):
        return f"{after - before:+.2g} {unit}"
    if before == 0.0:
        return ""
    ratio = after / before
    return percent(ratio - 1.0, "+") if abs(ratio) < 3.0 else f"{ratio:.3g} times"


def parameter_texts(cause: Cause, axis: FrictionAxis | None = None) -> list[str]:
    """Parameters of a cause, one text each, beside their nominal values in an axis."""
    nominal = {} if axis is None else believed_values(axis, cause)
    texts = []
    for name, value in cause.parameters.items():
        unit = cause.units[name]
        found = with_error(value, cause.standard_errors[name], unit)
        shown = rotary_words(name, unit)
        if name not in nominal:
            texts.append(f"{shown} = {found}")
            continue
        change = change_text(kind_of(cause.effect, name), nominal[name], value, unit)
        text = f"{shown} {nominal[name]:.5g} -> {found}"
        texts.append(f"{text} ({change})" if change else text)
    return texts


def cause_text(cause: Cause, axis: FrictionAxis | None = None) -> str:
    """Cause, parameters and alternatives in one line."""
    name = cause.title if cause.title == cause.effect else f"{cause.title} ({cause.effect})"
    text = f"{name}: {', '.join(parameter_texts(cause, axis))}"
    if cause.alternatives:
        others = ", ".join(map(titles_of, cause.alternatives))
        text += f"; alternatives: {others}"
    return rotary_words(text, " ".join(cause.units.values()))


def plain(value: float) -> str:
    """A ratio with three digits and, up to a million, no exponent.

    Examples
    --------
    >>> plain(3884.2), plain(0.12345)
    ('3880', '0.123')
    """
    return f"{float(f'{value:.3g}'):g}"
