"""Fit an axis to measured records by the likelihood of a hybrid filter."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import joblib
import numpy as np
from tqdm import tqdm

from dryfric_control.arrays import Floats
from dryfric_control.checks import check_boolean, finite, instance, positive, warn, whole
from dryfric_control.drawing import MEASURED, TIME_LABEL, label_axes, panels
from dryfric_control.estimation import uncertainty
from dryfric_control.estimation.force_residual import Sliding, force_start
from dryfric_control.estimation.likelihood import Likelihood, Run, prepare
from dryfric_control.estimation.parameters import (
    SHIFT,
    SPELLINGS,
    Parameter,
    checked_knowledge,
    choose,
    typical,
)
from dryfric_control.estimation.plausibility import check_plausible, checked_records
from dryfric_control.estimation.random_force import (
    away_from_rest,
    has_random_force,
    low_frequency_ratio,
)
from dryfric_control.estimation.scoring import (
    COMPARISON_ITERATIONS,
    FINAL_ITERATIONS,
    FIRST_ITERATIONS,
    breakaway_search,
    force_continuation,
    maximise,
)
from dryfric_control.estimation.solution import Solution
from dryfric_control.estimation.windows import Windows, cut
from dryfric_control.identification.identifiability import cannot_tell, far_from_zero_messages
from dryfric_control.identification.input_error import input_bias
from dryfric_control.identification.replay import Replay, replay
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.friction_curve import draw_curve
from dryfric_control.records.read import RecordLike
from dryfric_control.records.record import Record
from dryfric_control.records.record_arguments import HOW_TO_GIVE, axis_first
from dryfric_control.result_table import Quantity, format_table
from dryfric_control.store.saved import Saved
from dryfric_control.text import (
    Result,
    documented,
    fields_of,
    length_text,
    percent,
    plain_data,
    prefix_unit,
    rotary_words,
    stated,
)
from dryfric_control.ties import stable_order
from dryfric_control.units import check_units

# Number of starts.
_STARTS = 2
# The same where a parameter acts at breakaway: the cost has several minima.
_MANY = 6
# Starts that are searched on, of many.
_KEPT = 2
# Difference of log-likelihoods that prefers no end to that from the nominal values.
_EQUAL = 0.5
# Longest block [s].
_BLOCK = 1.0
# Least number of blocks.
_BLOCKS = 20
# Power of what is left at low frequency over that of white noise, from which the model
# does not fit (`benchmarks/identification.py coverage`).
_LASTING = 1.5
# Factor between start and end of a base parameter beyond which the fit says so, and what shows it.
_BOLD = 2.0
_SHOWN_BY = {
    "mass": "quick reversals",
    "viscous": "several velocities",
    **dict.fromkeys(("coulomb", "coulomb_plus", "coulomb_minus"), "slow motion both ways"),
}
#: Length of the free runs [s].
WINDOW = 0.25
# Their number in a record without a drive.
_UNDRIVEN = 8
# Their least number of samples.
_SHORTEST = 8
# Part of the encoder quantum below which an error is none.
_NOTHING = 1e-2


class FitWarning(UserWarning):
    """A parameter is not determined, or the model does not fit.

    Examples
    --------
    An input gain is the same as all other parameters over it:

    >>> import warnings
    >>> import dryfric_control as dfc
    >>> free = ("viscous", "input_gain", "mass", "coulomb")
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     found = dfc.fit(dfc.datasets.belt_stage_axis(), dfc.datasets.belt_stage(), free)
    >>> any(issubclass(one.category, dfc.FitWarning) for one in caught)
    True
    """


@documented
@dataclass(frozen=True, eq=False, repr=False)
class Fit(Saved, Result):
    """Axis fitted to records, with uncertainty of its parameters.

    Made by `fit`.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> found = dfc.fit(dfc.datasets.belt_stage_axis(), dfc.datasets.belt_stage())
    >>> list(found.parameters), found.units["mass"]
    (['mass', 'viscous', 'coulomb'], 'kg')
    """

    axis: FrictionAxis = stated("The fitted axis.")
    parameters: dict[str, float] = stated("Fitted values.")
    standard_errors: dict[str, float] = stated(
        "Standard errors, from leaving out blocks of the record; infinite for what the record does "
        "not determine.  See Notes of `fit`."
    )
    correlation: Floats = stated("Correlation of the estimates, in the order of `parameters`.")
    units: dict[str, str] = stated("Units of the parameters.")
    messages: tuple[str, ...] = stated("What the record does not determine, and why.")
    random_force: tuple[float, ...] = stated(
        "Standard deviation in each record of a force that changes from sample to sample in "
        "addition to the model, 0 where it moves nothing that the readings show."
    )
    reading_noise: tuple[float, ...] = stated(
        "Standard deviation of the readings of each record, in units of a velocity where one was "
        "read in place of a position."
    )
    training: tuple[Replay, ...] = stated(
        "Windowed free runs over each record of the fit, from the smoothed state at the start of "
        "each window."
    )
    _terms: tuple[Any, ...] = stated("What the intervals follow from.")
    _kind = "fit"
    _holds = (Replay, Windows, Parameter, Record)

    def interval(self, level: float = 0.9) -> dict[str, tuple[float, float]]:
        """Confidence intervals from the standard errors.

        Parameters
        ----------
        level : float, optional
            Probability with which an interval covers the true value.

        Returns
        -------
        dict of str to tuple of float
            Lower and upper end for each parameter.
        """
        reach = uncertainty.half_width(level, self._freedom(level))
        reach *= np.sqrt(np.diag(self._terms[-1]))
        return self._ends(-reach, reach)

    def _freedom(self, level: float) -> Floats:
        """Degrees of freedom of each variance, for an interval of this probability."""
        if not 0.0 < finite("level", level) < 1.0:
            raise ValueError(f"level must lie between 0 and 1, got {level!r}")
        searched, _, _, normals, away, _ = self._terms
        return uncertainty.degrees_of_freedom(normals, _prior(searched), away)

    def _ends(self, low: Floats, high: Floats) -> dict[str, tuple[float, float]]:
        """Values at distances from the estimates, in search coordinates."""
        rows = zip(*self._terms[:2], low, high, strict=True)
        return {p.name: (p.value(c + a), p.value(c + b)) for p, c, a, b in rows}

    def bootstrap(
        self, level: float = 0.9, repeats: int = 1000, seed: int = 0
    ) -> dict[str, tuple[float, float]]:
        """Confidence intervals from a block bootstrap.

        Parameters
        ----------
        level : float, optional
            Probability with which an interval covers the true value.
        repeats : int, optional
            Number of bootstrap samples of blocks, each followed by one Gauss-Newton step.
        seed : int, optional
            Seed of the bootstrap.

        Returns
        -------
        dict of str to tuple of float
            Lower and upper end for each parameter.
        """
        freedom = self._freedom(level)
        whole("repeats", repeats)
        whole("seed", seed, least=0)
        searched, _, gradients, normals, away, _ = self._terms
        steps = uncertainty.bootstrap(gradients, normals, _prior(searched), away, repeats, seed)
        return self._ends(*uncertainty.bootstrap_bounds(steps, level, freedom))

    def replay(self, record: Record, window: float = 0.25) -> Replay:
        """Windowed free runs of the fitted axis over another record.

        Parameters
        ----------
        record : Record
            The record.
        window : float, optional
            Length of a window [s].
        """
        shift = self.parameters.get("input_shift", 0.0)
        return replay(self.axis, record, window, self.training[0].windows.hold, shift=shift)

    def _summary_parts(self) -> Iterator[str | list[tuple[str, ...]]]:
        ends = self.interval(0.9)
        rows: list[tuple[str, ...]] = [("parameter", "value", "std. error", "90 % interval")]
        for name, value in self.parameters.items():
            number = f"{value:.6g} {self.units[name]}".removesuffix(" 1")
            reach = "{:.6g} to {:.6g}".format(*ends[name])
            rows.append((name, number, f"{self.standard_errors[name]:.2g}", reach))
        yield rows
        length, force = self.axis.units
        noises = self.random_force, self.reading_noise
        for run, pushed, noise in zip(self.training, *noises, strict=True):
            yield from run._summary_parts()
            random = f"{pushed:.3g} {force} RMS" if pushed else "none"
            unit = f"{length}/s" if run.windows.record.integrated else length
            yield f"noise of the readings: {length_text(noise, unit)} RMS; random force: {random}"
        yield from (f"warning: {message}" for message in self.messages)

    def table(self, form: str = "markdown") -> str:
        """Parameters with standard errors and 90 % intervals as a table.

        Parameters
        ----------
        form : {"markdown", "latex", "csv"}, optional
            "latex" needs the packages booktabs and siunitx, "csv" has all digits.
        """
        ends = self.interval(0.9)
        rows = []
        for name, value in self.parameters.items():
            unit = self.units[name]
            low, high = (Quantity(end, None, unit) for end in ends[name])
            rows.append((name, Quantity(value, self.standard_errors[name], unit), low, high))
        return format_table(("parameter", "value", "90 % from", "to"), rows, form)

    def to_dict(self) -> dict[str, Any]:
        """Numbers of the fit, ready for JSON."""
        numbers = {name: value for name, value in fields_of(self).items() if name != "axis"}
        return numbers | {"intervals_90": plain_data(self.interval(0.9))}

    @panels(2, sharex=False, figsize=(7.0, 6.0))
    def plot(self, axes: Any) -> str:
        """Draw friction over velocity, and errors of the free runs."""
        axis, (top, bottom) = self.axis, axes
        length, force = axis.units
        bare = axis.replace(coulomb=0.0, viscous=0.0, stribeck=None)
        fastest = 0.0
        for i, run in enumerate(self.training):
            slide = Sliding(run.windows.record, 3000)
            fastest = max(fastest, float(np.max(np.abs(slide.v), initial=0.0)))
            label = None if i else "measured, net of inertia and effects"
            top.plot(slide.v, -slide.force_residual(bare), ".", color=MEASURED, ms=2, label=label)
        x = np.concatenate([run.windows.record.x for run in self.training])
        span = float(x.min()), float(x.max())
        draw_curve(axis.replace(effects=()), top, fastest, span, "fitted", color="k", lw=1.5)
        label_axes(top, f"velocity [{length}/s]", f"friction [{force}]")
        first = self.training[0]
        least = min(float(run.rms_by_window.min()) for run in self.training)
        factor, unit = prefix_unit(float(np.median(first.rms_by_window)), length)
        for i, run in enumerate(self.training):
            label = run.windows.record.name if len(self.training) > 1 else "error of each free run"
            style = {"ms": 3, "lw": 0.8, "color": f"C{i}", "label": label}
            bottom.semilogy(run.windows.start_times, run.rms_by_window / factor, "o-", **style)
        bottom.axhline(first.quantum / factor, color="k", lw=0.8, ls=":", label="encoder quantum")
        if least < _NOTHING * first.quantum:
            # Windows at rest, which every model holds, must not squeeze the others together.
            bottom.set_ylim(bottom=_NOTHING * first.quantum / factor)
        label_axes(bottom, TIME_LABEL, f"RMS error [{unit}]")
        return f"{axis.name}: fit"


@axis_first
def fit(
    axis: FrictionAxis,
    record: RecordLike | Sequence[RecordLike],
    free: Sequence[str] = ("mass", "viscous", "coulomb"),
    *,
    known: Sequence[str] = (),
    tolerance: Mapping[str, float] | None = None,
    window: float | None = None,
    hold: str = "zero",
    starts: int | None = None,
    block: float | None = None,
    seed: int = 0,
    jobs: int = 1,
    progress: bool = False,
    anyway: bool = False,
) -> Fit:
    """Fit parameters of an axis to one or more records.

    Parameters
    ----------
    axis : FrictionAxis
        The nominal axis: start of the search, and values of what is not free.
    record : Record or path-like, or a sequence of them
        Measured runs, all of the same axis; a path is read by `read_record`.
    free : sequence of str, optional
        What to fit: mass, viscous, coulomb (both directions alike), coulomb_plus, coulomb_minus,
        coulomb_map (all coefficients of both polynomials), stribeck (excess and speed),
        stick_speed, stick_rate, or an effect: "bias_force", "spring.stiffness".  An effect that the
        axis does not have is added.  "input_shift" is a time by which the recorded input acts late
        (or early, negative): a property of the recording.
    known : sequence of str, optional
        Parameters among `free` that stay at their nominal values.
    tolerance : mapping of str to float, optional
        Relative standard deviations of nominal values, such as ``{"viscous": 0.5}``.
    window : float, optional
        Length of the free runs that show the fit [s].  Default: 0.25 s; without a drive an eighth
        of the shortest record.
    hold : {"zero", "first"}, optional
        Whether the recorded input is held or runs linearly between samples.
    starts : int, optional
        Number of starting points.  Default: 2 (the nominal values, and a regression of the drive
        force), 6 where Stribeck or stick parameters are free, whose cost has several minima.
    block : float, optional
        Length of the blocks for the uncertainty [s].  Default: 1 s.
    seed : int, optional
        Seed of the further starting points.
    jobs : int, optional
        Number of starts that run at the same time.
    progress : bool, optional
        Whether to show a progress bar.
    anyway : bool, optional
        Whether to go on, with a warning, where a record certainly has a wrong unit or sign.

    Raises
    ------
    ValueError
        If a name is unknown or an argument out of its range; or if the drive certainly has the
        wrong sign, or mass and friction differ from those of the axis as only a wrong unit can
        make them, by more than a factor of 100.

    Warns
    -----
    FitWarning
        When the record does not determine a parameter or does not separate two, one ends at a
        bound, or of the base more than a factor of two from its start value; or when the model does
        not fit (the random force left is correlated in time: parameters absorb part of what the
        axis lacks).
    RecordWarning
        When a unit or a sign seems wrong.

    Notes
    -----
    The likelihood of the readings is maximised, by a filter that runs the hybrid axis and is
    corrected by each reading, as in `diagnose`.  A random force acts in addition to the model:
    noise of the recorded input, or what the axis lacks.  It and the noise of the readings are
    estimated together with the parameters, so that the noise of a start does not bias them, and
    Student's t is their distribution, against single mistimed breakaways.  From each start the
    search begins at a large random force, where the likelihood is smooth.

    Where a random force acts, samples within 10 ms of a start or stop, and slower than 2 % of the
    high velocities, count only if a parameter acts by breakaway: a noisy input releases the model
    but not the machine.

    Standard errors come from leaving out blocks of the record: they hold where what is left is
    correlated in time for less than a block, and for no error that all blocks share, such as
    that of an input which the recorder has averaged.

    Examples
    --------
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> true = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> t = 1e-3 * np.arange(4000)
    >>> u = 20.0 * np.sin(6.0 * t) + 10.0 * np.sin(17.0 * t)
    >>> x = 1e-6 * np.round(1e6 * true.simulate(u, dt=1e-3).y[0])
    >>> found = dfc.fit(true.replace(mass=3.0, coulomb=5.0), dfc.Record(t, u, x))
    >>> round(found.axis.mass, 2), round(found.axis.viscous, 1)
    (2.0, 15.0)
    """
    instance("axis", axis, FrictionAxis, HOW_TO_GIVE)
    if starts is not None:
        whole("starts", starts)
    if block is not None:
        positive("block", block, unit="s")
    whole("seed", seed, least=0)
    whole("jobs", jobs)
    check_boolean("anyway", anyway)
    known, tolerance = checked_knowledge(known, tolerance)
    if known and not isinstance(free, str):
        free = [name for name in free if SPELLINGS.get(name, name) not in known]
        if not free:
            raise ValueError(f"known: {', '.join(known)} leave nothing free")
    records = checked_records(record)
    window = _window(records) if window is None else window
    effects = choose(axis, free, typical(records))[0].effects
    gain_free = any(effect.slug == "input_gain" for effect in effects)
    for i, r in enumerate(records):
        name = f"record[{i}]" if len(records) > 1 else "record"
        cut(r, window, hold)
        check_units(axis, r, name)
        check_plausible(axis, r, name, anyway=anyway, gain_free=gain_free)
    problem = problem_of(axis, records, free, tolerance, hold, block)
    if starts is None:
        starts = _MANY if any(p.breaks_away for p in problem.parameters) else _STARTS
    points = _starting_points(problem, records, starts, seed)
    return maximise_likelihood(problem, points, window, jobs, progress)


def problem_of(
    axis: FrictionAxis,
    records: Sequence[Record],
    free: Sequence[str],
    tolerance: Mapping[str, float] | None = None,
    hold: str = "zero",
    block: float | None = None,
) -> Likelihood:
    """Likelihood of parameters of an axis in records, without a prior but for `tolerance`."""
    axis, parameters = choose(axis, free, typical(records))
    # 1 s by default: model errors of neighbouring windows are correlated, a second apart far
    # less; shorter where that gave under 20 blocks, for the estimate of a variance.
    length = block or min(_BLOCK, sum(r.duration for r in records) / _BLOCKS)
    runs = [prepare(r, None, length, axis.mass) for r in records]
    names = [p.name for p in parameters]
    return Likelihood(axis, names, runs, tolerance=tolerance, priors=(), hold=hold)


def maximise_likelihood(
    problem: Likelihood,
    points: Sequence[Floats],
    window: float,
    jobs: int,
    progress: bool,
    name: str = "fit",
    kept: int = _KEPT,
    breakaways: Sequence[Run] = (),
) -> Fit:
    """The fit from the most likely end of searches from some points, nominal values first.

    `breakaways`: stretches of the records in which to look for what acts at breakaway, if any.
    """
    noises = problem.start(1.0)[len(problem.names) :]
    few = FIRST_ITERATIONS if breakaways or len(points) > kept else COMPARISON_ITERATIONS

    def search(point: Floats) -> Solution:
        own = problem.on(problem.runs)
        return maximise(own, force_continuation(own, np.concatenate((point, noises))), few)

    def refine_fit(z: Floats) -> Solution:
        return maximise(problem.on(problem.runs), z, COMPARISON_ITERATIONS, again=True)

    run = joblib.Parallel(n_jobs=jobs, backend="threading", return_as="generator")
    found = run(joblib.delayed(search)(p) for p in points)
    ends = list(tqdm(found, name, len(points), unit="start", disable=not progress))
    if breakaways:
        there = breakaway_search(problem.on(breakaways), np.concatenate((points[0], noises)))
        found = run(joblib.delayed(refine_fit)(z) for z in there)
        ends += tqdm(found, name, len(there), unit="point", disable=not progress)
    ends = _by_cost(ends)[:kept]
    if few < COMPARISON_ITERATIONS:
        ends = [maximise(one.problem, one.z, COMPARISON_ITERATIONS, again=True) for one in ends]
    best = _by_cost(ends)[0]
    if not best.point.out:
        best.problem.at(best.z)  # says why there is no such axis
    last = maximise(best.problem, best.z, FINAL_ITERATIONS, again=True)
    acting = any(has_random_force(last, i) for i in range(len(problem.runs)))
    if acting and not any(p.breaks_away for p in problem.parameters):
        clear = last.problem.on(list(map(away_from_rest, last.problem.runs, last.point.states)))
        last = maximise(clear, last.z, COMPARISON_ITERATIONS, again=True)
    return _result(last, points[0], window, acting)


def _by_cost(solutions: Sequence[Solution]) -> list[Solution]:
    """Solutions, the most likely first; of equal ones the first stays first."""
    return [solutions[i] for i in stable_order([one.cost for one in solutions], _EQUAL)]


def _window(records: Sequence[Record]) -> float:
    """Length of the free runs where none is given [s]."""
    if any(np.any(r.u) for r in records):
        return max(WINDOW, _SHORTEST * max(r.dt for r in records))
    return max(WINDOW, min(r.duration for r in records) / _UNDRIVEN)


def _starting_points(
    problem: Likelihood, records: Sequence[Record], starts: int, seed: int
) -> list[Floats]:
    """The nominal values, the force regression, and points around them."""
    first = problem.start()[: len(problem.names)]
    points = [first]
    if starts > 1:
        points.append(_nearest_valid_point(problem, force_start(problem, first, records), first))
    rng = np.random.default_rng(seed)
    low = problem.low[: first.size]
    high = problem.high[: first.size]
    while len(points) < starts:
        base = points[len(points) % 2]
        spread = np.array(list(map(_spread, problem.parameters, base)))
        point = base + spread * rng.standard_normal(base.size)
        points.append(_nearest_valid_point(problem, np.clip(point, low, high), base))
    return points


def _nearest_valid_point(problem: Likelihood, point: Floats, base: Floats) -> Floats:
    """The point, moved towards a base until there is such an axis."""
    for _ in range(8):
        try:
            problem.axis_at(point)
            return point
        except ValueError:  # a Coulomb map that turns negative inside the travel
            point = 0.5 * (point + base)
    return base


def _spread(parameter: Parameter, z: float) -> float:
    """How far from a first guess to look."""
    if parameter.name.endswith("]"):
        return 0.0  # a map is linear and well known; its terms cancel each other
    if parameter.logarithmic:
        return 0.3 if parameter.name == "mass" else 1.0
    return max(0.3 * abs(z), 0.1 if parameter.breaks_away else 0.03)


def _prior(parameters: Sequence[Parameter]) -> Floats:
    """Precision of what physics says beforehand: magnitudes within a decade."""
    return np.array([1.0 / np.log(10.0) ** 2 if p.logarithmic else 0.0 for p in parameters])


def _fit_warnings(found: Solution, first: Floats, z: Floats, force: float) -> Iterator[str]:
    """Messages on bounds, a random force that is correlated in time, and far ends."""
    problem = found.problem
    drive = max(run.drive for run in problem.runs)
    if force > drive:
        unit = problem.axis.units[1]
        yield (
            f"the random force, {force:.3g} {unit} RMS, is larger than the drive, {drive:.3g} "
            f"{unit} RMS: it follows the motion without an axis, and these values say nothing; a "
            "force is missing or wrong (in an arm correct the model, "
            "records.without(records.model_errors())), or hold what is known, such as the mass: "
            "free=(...)"
        )
    rows = zip(problem.parameters, first, z, problem.low, problem.high, strict=False)
    far: dict[str, str] = {}
    for p, start, end, low, high in rows:
        before = p.value(start)
        after = p.value(end)
        if (end <= low or end >= high) and after != 0.0:
            yield (
                f"{p.name} ended at its bound, {after:.4g} {p.unit}: the model does not fit, or "
                "the record does not determine it"
            )
        if p.name in _SHOWN_BY and min(before, after) > 0.0:
            factor, way = (after / before, "above") if after > before else (before / after, "below")
            if factor > _BOLD:
                text = f"{p.name} ended {factor:.3g} times {way} its start value"
                far[f"{text} ({after:.4g}, start {before:.4g} {p.unit})"] = _SHOWN_BY[p.name]
    if force > 0.0 and low_frequency_ratio(found) >= _LASTING:
        axis = problem.axis_at(z)
        level = float(np.mean([axis.coulomb([0.0], s)[0] for s in (1, -1)]))
        share = f" ({percent(force / level)} of the Coulomb level)" if level > 0.0 else ""
        yield (
            f"the model does not fit: what it leaves out is like a random force of {force:.3g} "
            f"{axis.units[1]} RMS{share} but is correlated in time; diagnose(axis, record) names "
            "what is missing"
        )
    if far:
        yield (
            f"{', '.join(far)}: if the start is trusted, check the units of u and x, the gain of "
            f"the drive (read_record(..., gain=...)), and that the record has "
            f"{' and '.join(far.values())}"
        )


class _Estimate(NamedTuple):
    """Coordinates of a fit and their covariance, and what this is from."""

    z: Floats
    gradients: Floats  # one row for each block
    normals: Floats
    null_directions: Floats  # in which the records determine nothing
    covariance: Floats


def _estimate(found: Solution, first: Floats, acting: bool) -> _Estimate:
    """The estimate at the end of a search; `acting`: whether a random force acts."""
    problem = found.problem
    count = first.size
    z, low, high = (part[:count] for part in (found.z, problem.low, problem.high))
    gradients = found.gradients[:, :count]
    bias = input_bias(found) if acting else np.zeros_like(gradients)
    gradients = gradients - bias
    normals = found.curvature() * found.information[:, :count, :count]
    prior = _prior(problem.parameters) + problem.prior_terms(found.z)[2][:count]
    away = uncertainty.null_directions(normals.sum(axis=0), found.information_of)
    covariance = uncertainty.jackknife(gradients, normals, prior, away)
    z = np.clip(z + uncertainty.newton_step(bias, normals, prior, away), low, high)
    if away.size:
        # What the record leaves open stays as near to the nominal values as it can.
        basis = np.linalg.qr(away.T)[0]
        z = np.clip(z - basis @ (basis.T @ (z - first)), low, high)
    return _Estimate(z, gradients, normals, away, covariance)


def _correlation(covariance: Floats) -> Floats:
    """Correlation of estimates; with one that nothing determines it is zero."""
    spread = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = np.nan_to_num(covariance / np.outer(spread, spread), posinf=0.0, neginf=0.0)
    np.fill_diagonal(correlation, 1.0)
    return correlation


def _result(found: Solution, first: Floats, window: float, acting: bool) -> Fit:
    """The fit from its end; `acting`: whether a random force acts."""
    problem = found.problem
    z, gradients, normals, away, covariance = _estimate(found, first, acting)
    names = problem.names
    parameters = tuple(problem.parameters)
    axis = problem.axis_at(z)
    values = np.array([p.value(c) for p, c in zip(parameters, z, strict=True)])
    slopes = np.array([p.slope(v) for p, v in zip(parameters, values, strict=True)])
    errors = slopes * np.sqrt(np.diag(covariance))
    blind = np.any(np.abs(away) > 1e-3, axis=0)
    errors[blind] = np.inf
    covariance[np.diag_indices_from(covariance)] += np.where(blind, np.inf, 0.0)
    correlation = _correlation(covariance)
    runs = range(len(problem.runs))
    records = [r.record for r in problem.runs]
    force = tuple(found.random_force(i) if acting else 0.0 for i in runs)
    said = cannot_tell(axis, records, parameters, values, errors, correlation, away, slopes)
    said += _fit_warnings(found, first, z, max(force))
    said += far_from_zero_messages(axis, records)
    messages = tuple(rotary_words(message, axis.units[1]) for message in said)
    for message in messages:
        warn(message, FitWarning)
    given, spreads = (dict(zip(names, v.tolist(), strict=True)) for v in (values, errors))
    units = {p.name: p.unit for p in parameters}
    noise = tuple(found.reading_noise(i) for i in runs)
    hold = "first" if problem.first else "zero"
    shift = given.get(SHIFT, 0.0)
    shown = tuple(replay(axis, r, window, hold, shift=shift) for r in records)
    terms = parameters, z, gradients, normals, away, covariance
    return Fit(axis, given, spreads, correlation, units, messages, force, noise, shown, terms)
