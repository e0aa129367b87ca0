"""What a diagnosis found, as an object that shows itself."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dryfric_control.diagnosis.report.wording import (
    SMALL,
    believed_values,
    cause_text,
    is_small,
    level_table,
    meaning,
    plain,
)
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.records.record import Record
from dryfric_control.store.axis_file import axis_to_dict
from dryfric_control.store.files import replacing
from dryfric_control.text import wrapped

if TYPE_CHECKING:
    import control as ct

    from dryfric_control.diagnosis.experiment import Experiment

FloatArray = NDArray[np.float64]

VERDICTS = ("nothing to find", "explained", "partly explained", "unexplained")


@dataclass(frozen=True)
class Cause:
    """One physical cause of what the simulation gets wrong.

    Attributes
    ----------
    effect : str
        Slug of the effect; "inertia", "viscous", "coulomb" for a wrong base
        parameter.
    title : str
        Its name in words.
    parameters : dict of str to float
        Fitted values.
    standard_errors : dict of str to float
        Standard errors from blocks of the record, infinite for what it leaves
        open.
    units : dict of str to str
        Units of the parameters.
    held_out_gain : float
        Fall of the mean log score log(1 + (error/noise)^2 / 4) of free runs that
        the fit did not see, when this cause joins the others.
    interval : tuple of float
        90 % block-bootstrap interval of `held_out_gain`.
    alternatives : tuple of str
        Effects that explain this record as well in its place.
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
    bias force (bias_force): force = 2.00 +- 0.10 N; this record cannot tell it from spring
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

    def summary(self) -> str:
        """Cause, parameters and alternatives in one line."""
        return cause_text(self)

    def to_dict(self) -> dict[str, Any]:
        """Numbers and words, ready for JSON."""
        return {
            "effect": self.effect,
            "title": self.title,
            "parameters": dict(self.parameters),
            "standard_errors": {
                k: (v if np.isfinite(v) else None) for k, v in self.standard_errors.items()
            },
            "units": dict(self.units),
            "held_out_gain": self.held_out_gain,
            "interval": list(self.interval),
            "alternatives": list(self.alternatives),
            "explanation": self.explanation,
            "experiment": self.experiment,
        }


@dataclass(frozen=True)
class Gain:
    """Error of free runs on data that neither selection nor fit has seen.

    Attributes
    ----------
    before, after : float
        RMS error of position of the believed and of the extended axis.
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
        """How many times smaller the error became, before/after."""
        return self.before / self.after

    def to_dict(self) -> dict[str, Any]:
        """Numbers, ready for JSON."""
        return {
            "before": self.before,
            "after": self.after,
            "floor": self.floor,
            "ratio": self.ratio,
            "interval": list(self.interval),
            "unit": self.unit,
        }


@dataclass(frozen=True)
class Unexplained:
    """Structure that is left when the found causes are in the model.

    Attributes
    ----------
    fraction : float
        Part of the structured error (above the noise floor) that is left.
    significant : bool
        Whether what is left is more than the noise floor makes.
    where : tuple of str
        Where it lives: position, speed, time, time since reversal, in words.
    """

    fraction: float
    significant: bool
    where: tuple[str, ...]

    def __float__(self) -> float:
        return self.fraction

    def to_dict(self) -> dict[str, Any]:
        """Numbers and words, ready for JSON."""
        return {
            "fraction": self.fraction,
            "significant": self.significant,
            "where": list(self.where),
        }


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """From data to cause: what is wrong, why, what mending brings.

    Made by `diagnose`.

    Attributes
    ----------
    axis : FrictionAxis
        The axis as believed.
    record : Record
        The measured record.
    verdict : str
        "nothing to find", "explained", "partly explained" or "unexplained".
    causes : tuple of Cause
        In the order found.
    extended : FrictionAxis
        The axis with the causes fitted in.
    gain : Gain
        Error before and after, on data not used for anything else.
    unexplained : Unexplained
    next_experiment : Experiment or None
        Excitation that best parts a cause from its alternatives, or, where
        nothing is left to part, None.
    messages : tuple of str
        What the record leaves undetermined.
    scores : dict of str to float
        Mean held-out score of every candidate as the first cause, for the
        report: lower is better, "" is the axis with its base parameters fitted.
    window : float
        Length of the free runs [s].
    roles : ndarray of int, shape (nwindows,)
        What each window was used for: 0 fit, 1 judge, 2 measure.
    hold : str
        How the input runs between samples, "zero" or "first".

    Examples
    --------
    A torque constant 20 % off, seen from the record alone:

    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> believed = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> machine = believed.replace(effects=(dfc.effects.InputGain(gain=1.2),))
    >>> t = 1e-3 * np.arange(6000)
    >>> u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
    >>> x = 1e-6 * np.round(1e6 * machine.simulate(u, dt=1e-3).y[0])
    >>> d = dfc.diagnose(believed, dfc.Record(t, u, x))
    >>> d.verdict, d.causes[0].effect, d.gain.ratio > 10.0
    ('explained', 'input_gain', True)
    >>> d.extended.effects[0].slug
    'input_gain'
    """

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

    @property
    def small_corrections(self) -> tuple[Cause, ...]:
        """Causes that only move believed numbers by a few per cent."""
        return tuple(cause for cause in self.causes if is_small(self, cause))

    @property
    def main_causes(self) -> tuple[Cause, ...]:
        """Causes that are more than small corrections, in the order found."""
        return tuple(cause for cause in self.causes if not is_small(self, cause))

    def summary(self) -> str:
        """Verdict, causes, gain and what is left, in plain lines."""
        lines = summary_lines(self)
        return "\n".join(wrapped([line], 8 if line.startswith(" ") else 4) for line in lines)

    def __repr__(self) -> str:
        return self.summary()

    def to_dict(self) -> dict[str, Any]:
        """Everything found, ready for JSON."""
        return {
            "verdict": self.verdict,
            "causes": [
                cause.to_dict() | {"believed": believed_values(self.axis, cause)}
                for cause in self.causes
            ],
            "small_corrections": [cause.effect for cause in self.small_corrections],
            "coulomb_level": level_table(self),
            "axis": axis_to_dict(self.axis),
            "extended": axis_to_dict(self.extended),
            "gain": self.gain.to_dict(),
            "unexplained": self.unexplained.to_dict(),
            "next_experiment": self.next_experiment and self.next_experiment.to_dict(),
            "messages": list(self.messages),
            "scores": {k: v for k, v in self.scores.items() if np.isfinite(v)},
        }

    def to_json(self, path: str | os.PathLike[str] | None = None) -> str:
        """The same as text, written to a file if a path is given.

        Parameters
        ----------
        path : path-like, optional
            File to write, replaced as a whole or not at all.

        Returns
        -------
        str
        """
        text = json.dumps(self.to_dict(), indent=2)
        if path is not None:
            with replacing(path) as part:
                part.write_text(text, encoding="utf-8")
        return text

    def plot(self, ax: Any = None) -> ct.ControlPlot:
        """Draw the report on one page.

        Parameters
        ----------
        ax : sequence of Axes, optional
            Where to draw.  Default: a new figure.

        Returns
        -------
        control.ControlPlot
        """
        from dryfric_control.diagnosis.report.figures import plot_diagnosis

        return plot_diagnosis(self, ax)

    def to_html(self, path: str | os.PathLike[str]) -> None:
        """Write a self-contained report that opens without a network.

        Parameters
        ----------
        path : path-like
            File to write, replaced as a whole or not at all.
        """
        from dryfric_control.diagnosis.report.page import html_page

        with replacing(path) as part:
            part.write_text(html_page(self), encoding="utf-8")

    def _repr_html_(self) -> str:
        from dryfric_control.diagnosis.report.page import html_summary

        return html_summary(self)


def summary_lines(diagnosis: Diagnosis) -> list[str]:
    """Lines of a diagnosis' summary, as long as they are.

    Parameters
    ----------
    diagnosis : Diagnosis
        What was found.

    Returns
    -------
    list of str
    """
    from dryfric_control.text import length_text

    g, unit = diagnosis.gain, diagnosis.axis.units[0]
    lines = [f"verdict: {diagnosis.verdict}"]
    for i, cause in enumerate(diagnosis.main_causes, start=1):
        lines.append(f"{i}. {cause_text(cause, diagnosis.axis)}")
        lines += [f"    {line}" for line in meaning(diagnosis, cause)]
    small = diagnosis.small_corrections
    if small:
        lines.append(f"small corrections of believed numbers ({100.0 * SMALL:g} % or less):")
    for cause in small:
        lines.append(f"    {cause_text(cause, diagnosis.axis)}")
    errors = (
        "error of free runs on unseen data, each from its most likely start: "
        f"{length_text(g.before, unit)} RMS"
    )
    if diagnosis.causes:
        errors += (
            f" before, {length_text(g.after, unit)} after; "
            f"{plain(g.ratio)} times smaller "
            f"(90 %: {plain(g.interval[0])} to {plain(g.interval[1])})"
        )
    lines.append(f"{errors}; noise floor {length_text(g.floor, unit)}")
    if diagnosis.unexplained.significant:
        lines.append(
            f"unexplained: {100.0 * diagnosis.unexplained.fraction:.3g} % of the structured error; "
            + "; ".join(diagnosis.unexplained.where)
        )
    lines += [f"beware: {message}" for message in diagnosis.messages]
    if diagnosis.next_experiment is not None:
        lines.append(f"next experiment: {diagnosis.next_experiment.summary()}")
    return lines
