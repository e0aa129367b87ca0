"""What a diagnosis found, as plain data, and its numbers as text."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dryfric_control.diagnosis.candidates import BASE, holds
from dryfric_control.diagnosis.remaining import Remaining, mutes_friction
from dryfric_control.estimation.parameters import values_of
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects.naming import class_of, titles_of
from dryfric_control.records.bad_readings import Masks
from dryfric_control.records.record import Record
from dryfric_control.text import (
    Result,
    documented,
    length_text,
    percent,
    rotary_words,
    stated,
    table,
    wrap_lines,
)

if TYPE_CHECKING:
    from dryfric_control.diagnosis.experiment import Experiment

#: Relative change of a nominal value up to which it is a correction and no
#: finding: datasheets round, and friction changes by as much with the weather.
SMALL = 0.05
# Standard error over the value from which a record leaves that open.
_OPEN = 1000.0
#: Said where a search has run out of time.
LATE = (
    "the time limit ended the search: the best answer so far; causes may be missing, and a base "
    "parameter may replace one: allow more time"
)


@documented
@dataclass(frozen=True, repr=False)
class Cause(Result):
    """One physical cause of what the simulation gets wrong.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> cause = dfc.diagnosis.Cause(
    ...     effect="bias_force", title="bias force", parameters={"force": 2.0},
    ...     standard_errors={"force": 0.1}, units={"force": "N"}, held_out_gain=1.5,
    ...     interval=(1.2, 1.8), alternatives=("spring",),
    ...     explanation=dfc.effects.BiasForce.explanation,
    ...     experiment=dfc.effects.BiasForce.experiment,
    ... )
    >>> print(cause.summary())
    bias force (bias_force): force = 2.00 +- 0.10 N; alternatives: spring
    """

    effect: str = stated("Id of the effect; inertia, viscous or coulomb for a base parameter.")
    title: str = stated("Its name in words.")
    parameters: dict[str, float] = stated("Fitted values.")
    standard_errors: dict[str, float] = stated("From blocks of the record; infinite: undetermined.")
    units: dict[str, str] = stated("Units of the parameters.")
    held_out_gain: float = stated(
        "Twice the gain of log-likelihood per sample, of one-step predictions that the fit did not "
        "see, when this cause joins the others."
    )
    interval: tuple[float, float] = stated("90 % interval of `held_out_gain`.")
    alternatives: tuple[str, ...] = stated("Effects that explain this record equally well.")
    explanation: str = stated("What it is physically.")
    experiment: str = stated("What would expose it alone.")

    def _summary_parts(self) -> list[str]:
        return [cause_text(self)]


class Causes(tuple[Cause, ...]):
    """Causes that show themselves, in print and in notebooks; a tuple otherwise."""

    __slots__ = ()

    def __repr__(self) -> str:
        lines = [f"{i}. {cause_text(one)}" for i, one in enumerate(self, start=1)]
        return wrap_lines(lines) or "no causes"

    def _repr_html_(self) -> str:
        rows = [("", "cause", "parameters", "alternatives")]
        for i, one in enumerate(self, start=1):
            others = ", ".join(map(titles_of, one.alternatives)) or "none"
            rows.append((str(i), one.title, ", ".join(parameter_texts(one)), others))
        return table(rows, as_html=True) if self else f"<p>{self!r}</p>"


@dataclass(frozen=True, repr=False)
class Gain(Result):
    """Error of free runs on data that neither selection nor fit has seen."""

    before: float  # RMS error of position, nominal axis
    after: float  # with the causes
    floor: float  # of the extended axis on a record that it made itself, read by the same encoder
    interval: tuple[float, float]  # 90 % block-bootstrap interval of `ratio`
    unit: str  # of the errors
    _told = ("before", "after", "floor", "interval", "unit", "ratio", "left")

    @property
    def ratio(self) -> float:
        """Error reduction (factor), before/after."""
        return self.before / self.after

    @property
    def headline(self) -> str:
        """Errors and their ratio in one line."""
        values = self.before, self.after, self.floor
        before, after, floor = (length_text(value, self.unit) for value in values)
        low, high = map(plain_number, self.interval)
        return (
            f"{before} RMS before, {after} after; error reduction (factor) "
            f"{plain_number(self.ratio)} (90 %: {low} to {high}); noise floor {floor}"
        )

    def _summary_parts(self) -> list[str]:
        return [self.headline]

    @property
    def left(self) -> float:
        """Share of the error above the noise floor that is left, 0 to 1."""
        if self.after >= self.before:
            return 1.0
        rest = max(self.after**2 - self.floor**2, 0.0)
        return min(math.sqrt(rest / (self.before**2 - self.floor**2)), 1.0) if rest else 0.0


@dataclass(frozen=True, repr=False)
class Unexplained(Result):
    """Structure that is left when the found causes are in the model."""

    fraction: float  # `Gain.left`; 0 where what is left is no more than noise
    significant: bool  # whether it is more than the noise floor makes
    where: tuple[str, ...]  # position, velocity, time or time since reversal, in words

    def __float__(self) -> float:
        return self.fraction

    def _summary_parts(self) -> list[str]:
        if not self.significant:
            return [*self.where] or ["nothing unexplained beyond noise"]
        return [f"{percent(self.fraction)} of the error above noise is left", *self.where]


@dataclass(frozen=True, eq=False, repr=False)
class Findings:
    """What a diagnosis found, without words and figures; see `Diagnosis`."""

    axis: FrictionAxis = stated("The nominal axis.")
    record: Record = stated("The measured record.")
    verdict: str = stated(
        '"nothing to find", "explained", "partly explained", "unexplained", or "not finished" '
        "where a time limit or an interrupt cut the search off."
    )
    causes: tuple[Cause, ...] = stated("In the order found.")
    extended: FrictionAxis = stated("The axis with the causes fitted in.")
    gain: Gain = stated("Error before and after, on data not used for anything else.")
    unexplained: Unexplained = stated("Structure that is left.")
    next_experiment: Experiment | None = stated(
        "Excitation that best separates a cause from its alternatives, if any is left to separate."
    )
    messages: tuple[str, ...] = stated("What the record leaves undetermined.")
    scores: dict[str, float] = stated(
        "Mean held-out score of every candidate as the first cause, for the report: lower is "
        'better, "" is the axis with its base parameters fitted.'
    )
    window: float = stated("Length of the free runs [s].")
    roles: NDArray[np.int64] = stated(
        "Half of the record, 0 or 1, that each window belongs to: it is judged with parameters "
        "fitted to the other one."
    )
    hold: str = stated('How the input runs between samples, "zero" or "first".', "zero")
    remaining: Remaining = stated("The random force that is left.", default_factory=Remaining)
    references: dict[str, float] = stated(
        "Gain of log-likelihood of the answer over the nominal axis and over a straight line, "
        "which ignores the drive.",
        default_factory=dict,
    )
    varies: dict[str, dict[str, list[float]]] = stated(
        'Parameters that differ from record to record: "values" and "standard_errors", one a '
        "record.",
        default_factory=dict,
    )
    others: tuple[Record, ...] = stated("The records after the first.", ())
    not_tried: dict[str, str] = stated(
        "Effects that could not be tried, with the reason.", default_factory=dict
    )
    standard_errors: dict[str, float] = stated(
        "Of every fitted parameter of `extended`; infinite: undetermined.", default_factory=dict
    )

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "causes", Causes(self.causes))
        left = self.unexplained
        if self.is_muted and not (left.significant or left.where):
            put(self, "unexplained", replace(left, where=(self.random_force,)))

    @property
    def masked(self) -> Masks:
        """Readings that were left out: indices and reasons, one entry a record."""
        return Masks(record.masked for record in (self.record, *self.others))

    @property
    def is_muted(self) -> bool:
        """Whether the random force left is too large, beside the friction, to explain anything."""
        imposed = self.gain.unit == self.axis.units[1]
        return not imposed and mutes_friction(self.remaining.rms, self.extended)

    @property
    def random_force(self) -> str:
        """The random force that is left, beside friction and drive, in words."""
        rms = self.remaining.rms
        sizes = {
            "Coulomb level": self.extended.coulomb.mean,
            "drive": float(np.sqrt(np.mean(self.record.u**2))),
        }
        ratios = [f"{plain_number(rms / v)} times the {k}" for k, v in sizes.items() if v > 0.0]
        unit = self.axis.units[1]
        text = f"a random force of {rms:.3g} {unit} RMS hides what is left"
        return rotary_words(f"{text}, {' and '.join(ratios)}" if ratios else text, unit)

    @property
    def small_corrections(self) -> Causes:
        """Causes that only move nominal values by a few per cent."""
        return Causes(cause for cause in self.causes if self.is_small(cause))

    @property
    def main_causes(self) -> Causes:
        """Causes that are more than small corrections, in the order found."""
        return Causes(cause for cause in self.causes if not self.is_small(cause))

    def is_small(self, cause: Cause) -> bool:
        """Whether a cause only corrects nominal values by a few per cent."""
        nominal = believed_values(self.axis, cause)
        # Places count beside the range of the record, angles beside 1 rad.
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
    owner = "" if cause.effect in BASE else f"{cause.effect}."
    if owner and not holds(axis, cause.effect):
        return {}
    values = values_of(axis, [f"{owner}{name}" for name in cause.parameters])
    return dict(zip(cause.parameters, map(float, values), strict=True))


def with_error(value: float, error: float | None, unit: str = "1") -> str:
    """A value and its standard error, if any, with two digits; a huge one leaves it open."""
    unit = "" if unit == "1" else f" {unit}"
    if error is None:
        return f"{value:.4g}{unit}"
    if not math.isfinite(error) or error > _OPEN * abs(value) > 0.0:
        return f"{value:.3g}{unit} (undetermined)"
    if error <= 0.0:
        return f"{value:.5g}{unit}"
    last = int(f"{error:.1e}".split("e")[1]) - 1
    size = max(abs(value), error)
    if value != 0.0 and round(value, -last) == 0.0:  # the value, not a zero that was not found
        wide = f"{round(error, -last):.0f}" if 100.0 <= size < 1e6 else f"{error:.2g}"
        return f"{value:.2g} +- {wide}{unit}"
    if 1e-3 <= size < 1e6:
        digits = max(-last, 0)
        return f"{round(value, -last):.{digits}f} +- {round(error, -last):.{digits}f}{unit}"
    power = int(f"{size:.15e}".split("e")[1])
    digits = max(power - last, 0)
    scale = 10.0**power
    return f"({value / scale:.{digits}f} +- {error / scale:.{digits}f})e{power:+03d}{unit}"


def change_text(kind: str, before: float, after: float, unit: str = "1") -> str:
    """Change of a nominal value in words; nothing where it was zero."""
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
        text = with_error(value, cause.standard_errors[name], unit)
        if name in nominal:
            change = change_text(kind_of(cause.effect, name), nominal[name], value, unit)
            text = f"{nominal[name]:.5g} -> {text}" + (f" ({change})" if change else "")
        else:
            text = f"= {text}"
        texts.append(f"{rotary_words(name, unit)} {text}")
    return texts


def short_cause_text(cause: Cause, axis: FrictionAxis) -> str:
    """Title of a cause, and how far it takes a nominal value."""
    nominal = believed_values(axis, cause)
    changes = (
        change_text(kind_of(cause.effect, name), nominal[name], value, cause.units[name])
        for name, value in cause.parameters.items()
        if name in nominal
    )
    change = next(filter(None, changes), "")
    return cause.title + (f" ({change})" if change else "")


def cause_text(cause: Cause, axis: FrictionAxis | None = None) -> str:
    """Cause, parameters and alternatives in one line."""
    name = cause.title if cause.title == cause.effect else f"{cause.title} ({cause.effect})"
    text = f"{name}: {', '.join(parameter_texts(cause, axis))}"
    if cause.alternatives:
        text += f"; alternatives: {', '.join(map(titles_of, cause.alternatives))}"
    return rotary_words(text, " ".join(cause.units.values()))


def plain_number(value: float) -> str:
    """A ratio with three digits and, up to a million, no exponent."""
    return f"{float(f'{value:.3g}'):g}"
