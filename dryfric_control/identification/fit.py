"""Fit an axis to measured records by windowed free runs."""

from __future__ import annotations

import html
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import joblib
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from dryfric_control.checks import finite, instance, positive, whole
from dryfric_control.estimation.force_residual import force_start
from dryfric_control.estimation.parameters import Parameter, Scales, choose
from dryfric_control.estimation.plausibility import warn_if_implausible
from dryfric_control.estimation.problem import Problem, minimise
from dryfric_control.estimation.uncertainty import (
    block_labels,
    bootstrap,
    degrees_of_freedom,
    expanded,
    half_width,
    jackknife,
)
from dryfric_control.estimation.windows import Windows, cut
from dryfric_control.identification.identifiability import cannot_tell
from dryfric_control.identification.replay import Replay, replay
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.records.record import Record
from dryfric_control.text import wrapped
from dryfric_control.ties import SQUARES, ranked

if TYPE_CHECKING:
    import control as ct

FloatArray = NDArray[np.float64]

# Starts by default where a parameter acts by break-away: the cost has several valleys.
_STARTS = 6


class FitWarning(UserWarning):
    """A record that cannot tell what was asked of it.

    Examples
    --------
    An input gain is the same as all other parameters over it:

    >>> import warnings
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> t = 1e-3 * np.arange(4000)
    >>> u = 20.0 * np.sin(6.0 * t)
    >>> x = 1e-6 * np.round(1e6 * axis.simulate(u, dt=1e-3).y[0])
    >>> free = ("viscous", "input_gain", "mass", "coulomb")
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     found = dfc.fit(axis, dfc.Record(t, u, x), free=free)
    >>> any(issubclass(one.category, dfc.FitWarning) for one in caught)
    True
    """


@dataclass(frozen=True, eq=False)
class Fit:
    """Axis fitted to records, and how sure its parameters are.

    Made by `fit`.

    Attributes
    ----------
    axis : FrictionAxis
        The fitted axis.
    parameters : dict of str to float
        Fitted values.
    standard_errors : dict of str to float
        Standard errors, from leaving out blocks of the record; infinite for
        what the record does not determine.
    correlation : ndarray, shape (nparameters, nparameters)
        Correlation of the estimates, in the order of `parameters`.
    units : dict of str to str
        Units of the parameters.
    messages : tuple of str
        What the record cannot tell, and why.
    training : tuple of Replay
        Windowed free runs over the records of the fit, one for each, from the
        smoothed state at the start of each window.

    Examples
    --------
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> true = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> t = 1e-3 * np.arange(4000)
    >>> u = 20.0 * np.sin(6.0 * t) + 10.0 * np.sin(17.0 * t)
    >>> x = 1e-6 * np.round(1e6 * true.simulate(u, dt=1e-3).y[0])
    >>> found = dfc.fit(true.replace(mass=3.0), dfc.Record(t, u, x), free=("mass",))
    >>> round(found.parameters["mass"], 2), found.units["mass"]
    (2.0, 'kg')
    """

    axis: FrictionAxis
    parameters: dict[str, float]
    standard_errors: dict[str, float]
    correlation: FloatArray
    units: dict[str, str]
    messages: tuple[str, ...]
    training: tuple[Replay, ...]
    _terms: tuple[Any, ...] = field(repr=False)

    def interval(self, level: float = 0.9) -> dict[str, tuple[float, float]]:
        """Confidence intervals from the standard errors.

        Parameters
        ----------
        level : float, optional
            Probability with which an interval covers the truth.

        Returns
        -------
        dict of str to tuple of float
            Lower and upper end for each parameter.
        """
        _check_level(level)
        searched, z, _, normals, labels, covariance = self._terms
        freedom = degrees_of_freedom(normals, labels, _prior(searched))
        reach = half_width(level, freedom) * np.sqrt(np.diag(covariance))
        return {
            p.name: (p.value(c - r), p.value(c + r))
            for p, c, r in zip(searched, z, reach, strict=True)
        }

    def bootstrap(
        self, level: float = 0.9, repeats: int = 1000, seed: int = 0
    ) -> dict[str, tuple[float, float]]:
        """Confidence intervals from a block bootstrap.

        Parameters
        ----------
        level : float, optional
            Probability with which an interval covers the truth.
        repeats : int, optional
            Number of drawings of blocks, each followed by one Gauss-Newton step.
        seed : int, optional
            Seed of the drawings.

        Returns
        -------
        dict of str to tuple of float
            Lower and upper end for each parameter.
        """
        _check_level(level)
        whole("repeats", repeats)
        whole("seed", seed, least=0)
        searched, z, gradients, normals, labels, _ = self._terms
        steps = bootstrap(gradients, normals, labels, _prior(searched), repeats, seed)
        freedom = degrees_of_freedom(normals, labels, _prior(searched))
        ends = expanded(steps, level, freedom)
        return {
            p.name: (p.value(c + a), p.value(c + b))
            for p, c, a, b in zip(searched, z, *ends, strict=True)
        }

    def replay(self, record: Record, window: float = 0.25) -> Replay:
        """Windowed free runs of the fitted axis over another record.

        Parameters
        ----------
        record : Record
            The record.
        window : float, optional
            Length of a window [s].

        Returns
        -------
        Replay
        """
        shift = self.parameters.get("input_shift", 0.0)
        return replay(self.axis, record, window, self.training[0].windows.hold, shift=shift)

    def _rows(self) -> list[tuple[str, str, str, str]]:
        ends = self.interval(0.9)
        return [
            (
                name,
                f"{value:.6g} {self.units[name]}".removesuffix(" 1"),
                f"{self.standard_errors[name]:.2g}",
                f"{ends[name][0]:.6g} to {ends[name][1]:.6g}",
            )
            for name, value in self.parameters.items()
        ]

    def summary(self) -> str:
        """Parameters, errors of the free runs, what to beware of."""
        rows = [("parameter", "value", "std. error", "90 % interval"), *self._rows()]
        widths = [max(len(row[i]) for row in rows) for i in range(4)]
        lines = [
            "  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip() for row in rows
        ]
        lines += [run.summary() for run in self.training]
        lines += [f"beware: {message}" for message in self.messages]
        return wrapped(lines)

    def __repr__(self) -> str:
        return self.summary()

    def _repr_html_(self) -> str:
        head = "".join(
            f"<th>{h}</th>" for h in ("parameter", "value", "standard error", "90 % interval")
        )
        body = "".join(
            "<tr>" + "".join(f"<td>{html.escape(c)}</td>" for c in row) + "</tr>"
            for row in self._rows()
        )
        notes = "".join(f"<p>{html.escape(m)}</p>" for m in self.messages)
        runs = "".join(f"<p>{html.escape(r.summary())}</p>" for r in self.training)
        return f"<table><tr>{head}</tr>{body}</table>{runs}{notes}"

    def to_dict(self) -> dict[str, Any]:
        """Numbers of the fit, ready for JSON.

        Returns
        -------
        dict
        """
        return {
            "parameters": dict(self.parameters),
            "standard_errors": {
                k: (v if np.isfinite(v) else None) for k, v in self.standard_errors.items()
            },
            "units": dict(self.units),
            "intervals_90": {k: list(v) for k, v in self.interval(0.9).items()},
            "correlation": self.correlation.tolist(),
            "messages": list(self.messages),
            "training": [run.to_dict() for run in self.training],
        }

    def plot(self, ax: Any = None, title: str | None = None) -> ct.ControlPlot:
        """Draw friction over speed, and the free runs' errors over time.

        Parameters
        ----------
        ax : sequence of two Axes, optional
            Where to draw; a new figure when left out.
        title : str, optional
            Title.  Default: name of the axis.

        Returns
        -------
        control.ControlPlot
        """
        from dryfric_control.identification.figures import plot_fit

        return plot_fit(self.axis, self.training, ax, title)


def fit(
    axis: FrictionAxis,
    record: Record | Sequence[Record],
    free: Sequence[str] = ("mass", "viscous", "coulomb"),
    *,
    window: float = 0.25,
    hold: str = "zero",
    starts: int | None = None,
    block: float | None = None,
    seed: int = 0,
    jobs: int = 1,
    progress: bool = False,
) -> Fit:
    """Fit parameters of an axis to one or more records.

    Parameters
    ----------
    axis : FrictionAxis
        The axis as believed: start of the search, and values of what is not
        free.
    record : Record or sequence of Record
        Measured runs, all of the same axis.
    free : sequence of str, optional
        What to fit: mass, viscous, coulomb (both directions alike),
        coulomb_plus, coulomb_minus, coulomb_map (all coefficients of both
        polynomials), stribeck (excess and speed), stick_speed, stick_rate, or
        an effect: "bias_force", "spring.stiffness".  An effect that the axis
        does not have is added.  "input_shift" is a time by which the recorded
        input acts late (or early, negative): a property of the recording.
    window : float, optional
        Length of the free runs [s].
    hold : {"zero", "first"}, optional
        Whether the recorded input is held or runs linearly between samples.
    starts : int, optional
        Number of starting points.  Default: 2 (the believed values, and a
        regression of the drive force), 6 where Stribeck or stick parameters
        are free, whose cost has several valleys.
    block : float, optional
        Length of the blocks for the uncertainty [s].  Default: 1 s.
    seed : int, optional
        Seed of the further starting points.
    jobs : int, optional
        Number of starts that run at the same time.
    progress : bool, optional
        Whether to show a progress bar.

    Returns
    -------
    Fit

    Raises
    ------
    ValueError
        If a name is unknown or an argument out of its range.

    Warns
    -----
    FitWarning
        When the record cannot tell a parameter, or two of them apart.
    RecordWarning
        When a unit or a sign seems wrong, see `warn_if_implausible`.

    Notes
    -----
    The record is cut into windows.  In each the axis runs freely from the
    smoothed state at its start; the errors of position are minimised over the
    parameters and, within what encoder noise allows, over the states at the
    starts, which are projected out.  So the noise of a start does not bias
    the parameters, and no force error is integrated for longer than a window.
    Windows are weighted by the loss log(1 + (RMS/c)^2), c twice the median
    RMS, against single mistimed break-aways.

    Where the axis lacks something that the record has, parameters take on
    what they can of it, and depend on `window`: compare two lengths.

    Examples
    --------
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> from dryfric_control.records.record import Record
    >>> true = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> t = 1e-3 * np.arange(4000)
    >>> u = 20.0 * np.sin(6.0 * t) + 10.0 * np.sin(17.0 * t)
    >>> x = 1e-6 * np.round(1e6 * true.simulate(u, dt=1e-3).y[0])
    >>> found = dfc.fit(true.replace(mass=3.0, coulomb=5.0), dfc.Record(t, u, x))
    >>> round(found.axis.mass, 2), round(found.axis.viscous, 1)
    (2.0, 15.0)
    """
    instance("axis", axis, FrictionAxis)
    if isinstance(record, Record) or not isinstance(record, Sequence):
        record = (record,)
    records = tuple(record)
    if not records:
        raise ValueError("record is empty: give at least one Record")
    if starts is not None:
        whole("starts", starts)
    if block is not None:
        positive("block", block, unit="s")
    whole("seed", seed, least=0)
    whole("jobs", jobs)
    parts = [cut(r, window, hold) for r in records]
    for r in records:
        warn_if_implausible(axis, r)
    return fit_windows(axis, parts, free, starts, block, seed, jobs, progress, window)


def fit_windows(
    axis: FrictionAxis,
    parts: Sequence[Windows],
    free: Sequence[str],
    starts: int | None = None,
    block: float | None = None,
    seed: int = 0,
    jobs: int = 1,
    progress: bool = False,
    window: float = 0.25,
) -> Fit:
    """The fit itself, on records that are already cut; see `fit`."""
    records = [w.record for w in parts]
    axis, parameters = choose(axis, free, typical(records))
    problem = Problem(axis, parameters, parts)
    first = problem.start
    if starts is None:
        starts = _STARTS if problem.breaks_away.any() else 2
    points = _starting_points(problem, first, records, starts, seed)

    def search(point: FloatArray) -> tuple[FloatArray, list[float]]:
        own = Problem(axis, parameters, parts)
        return minimise(own, point), own.scales

    run = joblib.Parallel(n_jobs=jobs, backend="threading", return_as="generator")
    found = list(
        tqdm(
            run(joblib.delayed(search)(p) for p in points),
            total=len(points),
            desc="fit",
            unit="start",
            disable=not progress,
        )
    )
    # Ends are compared, and their uncertainty found, at the scale of the closest.
    problem.scales = np.min([scales for _, scales in found], axis=0).tolist()
    losses = [problem.loss(z, problem.evaluate(z)) for z, _ in found]
    z = found[ranked(losses, SQUARES)[0]][0]
    return _result(problem, z, first, block, window)


def assess(axis: FrictionAxis, parts: Sequence[Windows], free: Sequence[str]) -> Fit:
    """How sure the parameters of an axis are where it stands, without a search."""
    axis, parameters = choose(axis, free, typical([w.record for w in parts]))
    problem = Problem(axis, parameters, parts)
    z = problem.start
    problem.narrow(z)
    return _result(problem, z, z, None, 0.25)


def _check_level(level: float) -> None:
    if not 0.0 < finite("level", level) < 1.0:
        raise ValueError(f"level must lie between 0 and 1, got {level!r}")


def typical(records: Sequence[Record]) -> Scales:
    """Typical force, length and time in records."""
    force = float(np.sqrt(np.mean([np.mean(r.u**2) for r in records])))
    length = float(np.mean([np.std(r.x) for r in records]))
    speed = float(np.sqrt(np.mean([np.mean(r.derivatives().v ** 2) for r in records])))
    return Scales(force or 1.0, length, length / speed, records[0].dt)


def _starting_points(
    problem: Problem, first: FloatArray, records: Sequence[Record], starts: int, seed: int
) -> list[FloatArray]:
    """The believed values, the force regression, and points around them."""
    points = [first]
    if starts > 1:
        points.append(_possible(problem, force_start(problem, first, records), first))
    rng = np.random.default_rng(seed)
    while len(points) < starts:
        base = points[len(points) % 2]
        spread = np.array([_spread(p, c) for p, c in zip(problem.parameters, base, strict=True)])
        point = base + spread * rng.standard_normal(base.size)
        points.append(_possible(problem, np.clip(point, problem.low, problem.high), base))
    return points


def _possible(problem: Problem, point: FloatArray, base: FloatArray) -> FloatArray:
    """The point, moved towards a base until there is such an axis."""
    for _ in range(8):
        try:
            problem.model_at(point)
        except ValueError:  # a Coulomb map that turns negative inside the travel
            point = 0.5 * (point + base)
        else:
            return point
    return base


def _spread(parameter: Parameter, z: float) -> float:
    """How far from a first guess to look."""
    if parameter.name.endswith("]"):
        return 0.0  # a map is linear and well known; its terms cancel each other
    if parameter.logarithmic:
        return 0.3 if parameter.name == "mass" else 1.0
    return max(0.3 * abs(z), 0.1 if parameter.breaks_away else 0.03)


def _prior(parameters: Sequence[Parameter]) -> FloatArray:
    """Precision of what physics says beforehand: magnitudes within a decade."""
    return np.array([1.0 / np.log(10.0) ** 2 if p.logarithmic else 0.0 for p in parameters])


def _result(
    problem: Problem,
    z: FloatArray,
    first: FloatArray,
    block: float | None,
    window: float,
) -> Fit:
    at = problem.evaluate(z)
    problem.refine(problem.terms(z, at)[1].sum(axis=0))
    gradients, normals, _ = problem.terms(z, at)
    labels = block_labels(problem.windows, block)
    covariance, away = jackknife(gradients, normals, labels, _prior(problem.parameters))
    if away.size:
        # What the record leaves open stays as near to the believed values as it can.
        basis = np.linalg.qr(away.T)[0]
        z = np.clip(z - basis @ (basis.T @ (z - first)), problem.low, problem.high)
    model = problem.model_at(z)
    values = np.array(list(problem.values(z).values()))
    slopes = np.array([p.slope(v) for p, v in zip(problem.parameters, values, strict=True)])
    errors = slopes * np.sqrt(np.diag(covariance))
    blind = np.any(np.abs(away) > 1e-3, axis=0)
    errors[blind] = np.inf
    covariance[np.diag_indices_from(covariance)] += np.where(blind, np.inf, 0.0)
    spread = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = covariance / np.outer(spread, spread)
    correlation = np.where(np.isfinite(correlation), correlation, 0.0)
    np.fill_diagonal(correlation, 1.0)
    names = problem.names
    records = [w.record for w in problem.windows]
    messages = cannot_tell(
        model.axis, records, problem.parameters, values, errors, correlation, away, slopes
    )
    for message in messages:
        warnings.warn(message, FitWarning, stacklevel=4)  # the caller of fit
    return Fit(
        model.axis,
        dict(zip(names, values.tolist(), strict=True)),
        dict(zip(names, errors.tolist(), strict=True)),
        correlation,
        {p.name: p.unit for p in problem.parameters},
        messages,
        tuple(
            replay(model.axis, w.record, window, w.hold, shift=model.shift) for w in problem.windows
        ),
        (problem.parameters, z, gradients, normals, labels, covariance),
    )
