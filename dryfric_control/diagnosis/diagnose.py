"""Diagnose records: the whole procedure from data to cause."""

from __future__ import annotations

import functools
import math
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from dryfric_control._version import __version__
from dryfric_control.checks import instance, positive, whole
from dryfric_control.diagnosis.candidate_fits import Fitted, Race
from dryfric_control.diagnosis.candidates import SLUGS, catalogue
from dryfric_control.diagnosis.causes import cause_of, hardly_determined
from dryfric_control.diagnosis.evidence import where
from dryfric_control.diagnosis.experiment import next_experiment
from dryfric_control.diagnosis.gain_or_base import GAIN, every, left_open, or_a_gain
from dryfric_control.diagnosis.gate import Gate
from dryfric_control.diagnosis.likelihood_search import Search
from dryfric_control.diagnosis.noise_floor import (
    REPLAYS,
    Floor,
    far_above,
    noise_floor,
    usual_rms,
)
from dryfric_control.diagnosis.random_force import Answer, answer, apart
from dryfric_control.diagnosis.remaining import Remaining, remaining
from dryfric_control.diagnosis.report.diagnosis import Diagnosis
from dryfric_control.diagnosis.report.findings import LATE, Cause, Gain, Unexplained
from dryfric_control.diagnosis.selection import Selection, Selector, in_place
from dryfric_control.estimation.parameters import checked_knowledge, typical, values_of, with_values
from dryfric_control.estimation.plausibility import check_distinct, warn_if_implausible
from dryfric_control.estimation.uncertainty import ratio_interval
from dryfric_control.estimation.windows import Windows, cut, shifted
from dryfric_control.identification.replay import replay
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.records.bad_readings import REASONS
from dryfric_control.records.record import Record, told
from dryfric_control.store.batch import fingerprint, run_batch
from dryfric_control.text import length_text
from dryfric_control.ties import ranked, samples
from dryfric_control.units import check_units

FloatArray = NDArray[np.float64]

#: What a window is used for.
FIT, JUDGE, MEASURE = 0, 1, 2
# Sequence of the uses of a record's blocks; longest block [s], and least number of blocks.
_TURN = (FIT, JUDGE, FIT, JUDGE, MEASURE)
_BLOCK, _FEWEST_BLOCKS = 1.0, 12
_LEAST_WINDOWS = 10
# Verdicts that leave nothing unexplained.
_CLEAN = ("nothing to find", "explained")
# Wrong Coulomb levels, over the nominal one, of which free runs must reject at least one.
_FAR_OFF = (0.7, 1.3)
# Ratio of free-run errors without and with the drive below which the drive has no effect.
_IDLE = 5.0
# Largest number of searches, each without the causes that the previous one refuted.
_SEARCHES = 3
# Largest number of alternatives for which an experiment is sought.
_RIVALS = 4
# Fraction of the time limit after which no further cause is sought.
_SEARCHING = 0.6
# Fraction of the time limit after which the causes found are no longer tested.
_ANSWERING = 0.9


def roles(windows: Windows) -> NDArray[np.int64]:
    """What each window is used for, in contiguous blocks."""
    length = windows.record.duration / len(windows)
    block = min(_BLOCK, windows.record.duration / _FEWEST_BLOCKS)
    size = max(1, samples(block, length))
    return np.asarray(_TURN, dtype=np.int64)[(np.arange(len(windows)) // size) % len(_TURN)]


def diagnose(
    axis: FrictionAxis,
    record: Record | Sequence[Record],
    *,
    known: Sequence[str] = (),
    tolerance: Mapping[str, float] | None = None,
    window: float = 0.25,
    hold: str = "zero",
    time_limit: float | None = None,
    jobs: int = 2,
    progress: bool | None = None,
) -> Diagnosis:
    """Find where simulation and measurement differ, and why.

    Parameters
    ----------
    axis : FrictionAxis
        The nominal axis.
    record : Record or sequence of Record
        The measured record: time, drive force, position.  Several records of one
        machine share their causes.
    known : sequence of str, optional
        Parameters whose nominal values are right, such as ``("mass",)``.
    tolerance : mapping of str to float, optional
        Relative standard deviation of a nominal value, such as
        ``{"viscous": 0.5}``: a change within it is not reported as a finding.
    window : float, optional
        Length of the free runs [s].
    hold : {"zero", "first"}, optional
        Whether the recorded input is held or interpolated linearly between samples.
    time_limit : float, optional
        Wall time [s] after which the best answer so far is returned, with a message.
    jobs : int, optional
        Number of candidates fitted in parallel.
    progress : bool, optional
        Whether to show a progress bar.  Default: in a terminal or a notebook.

    Returns
    -------
    Diagnosis

    Raises
    ------
    ValueError
        If an argument is of the wrong kind, or a record is too short to fit
        on one part and judge on another, or the axis does not move in it.

    Notes
    -----
    If some hypothesis brings free runs down to the noise of the readings, free runs
    decide.  Every hypothesis is simulated over short windows of the record, each
    from its most likely start state, and scored by the mean of
    log(1 + cost/(4 n)), where cost is the squared error over the variance of the
    readings' noise.  Blocks of 1 s are used in turn to fit, to judge and (every fifth)
    only to measure the final error reduction.  Candidates are added one at a time as
    long as the score on the judging blocks falls.  The noise floor comes from replays
    of the model itself through the record's own encoder.

    Otherwise, and with several records, a random force acts in addition to the model:
    noise of the drive, or unmodelled effects.  Its size and that of the readings' noise
    are then estimated together with the parameters of each hypothesis by the
    likelihood of a hybrid filter, and the likelihood decides.  Errors of base parameters
    count as assumptions; a factor of 2 is already a strong one.

    The answer holds for what the record excites: a cause that never acts in it
    is not found, and "nothing to find" is no proof of its absence.

    Examples
    --------
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> believed = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> machine = believed.replace(effects=(dfc.effects.Spring(stiffness=40.0, rest=0.05),))
    >>> t = 1e-3 * np.arange(6000)
    >>> u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
    >>> x = 1e-6 * np.round(1e6 * machine.simulate(u, dt=1e-3).y[0])
    >>> d = dfc.diagnose(believed, dfc.Record(t, u, x))
    >>> d.verdict, [cause.effect for cause in d.causes]
    ('explained', ['spring'])
    >>> round(d.causes[0].parameters["stiffness"], 1)
    40.0
    """
    begun = time.monotonic()
    instance("axis", axis, FrictionAxis)
    whole("jobs", jobs)
    window = positive("window", window, unit="s")
    limit = math.inf if time_limit is None else positive("time_limit", time_limit, unit="s")
    known, tolerance = checked_knowledge(known, tolerance)
    axis = axis.effective()
    several = isinstance(record, (list, tuple))
    records: list[Any] = list(record) if several else [record]  # type: ignore[arg-type]
    if not records:
        raise ValueError("record: the list of records is empty: give at least one")
    cuts = []
    for i, one in enumerate(records):
        name = f"record[{i}]" if several else "record"
        windows = _cut(axis, one, window, hold, name, _LEAST_WINDOWS // len(records))
        if len(records) == 1 or len(windows) >= _LEAST_WINDOWS:
            _check_motion(windows, roles(windows), name)
        cuts.append(windows)
    check_distinct(records)
    if progress is None:
        # Other libraries import IPython too: show a bar only in a running shell.
        shell = sys.modules.get("IPython")
        progress = sys.stderr.isatty() or (shell is not None and shell.get_ipython() is not None)
    bar = tqdm(desc="diagnose", unit="step", disable=not progress)

    def tell(what: str) -> None:
        bar.set_postfix_str(what)
        bar.update()

    with bar:
        until = begun + _SEARCHING * limit
        settings: dict[str, Any] = {
            "jobs": jobs, "known": known, "tolerance": tolerance, "until": until,
        }  # fmt: skip

        @functools.cache
        def trial(shift: float) -> Trial:
            moved = [cut(one, window, hold) for one in _later(records, shift)] if shift else cuts
            return Trial.of(axis, moved, settings, tell)

        search = Search(
            axis,
            records,
            known,
            tolerance,
            hold=hold,
            jobs=jobs,
            until=until,
            end=begun + _ANSWERING * limit,
            tell=tell,
        )
        found, now = None, trial(0.0)
        alone = len(records) == 1 and not _blind(now.selector)
        judged = alone
        if not (alone and (_nothing(now.selector) or now.gate.at(axis, ()))):
            gate = (lambda shift: trial(shift).gate) if alone else None
            found = answer(search, lambda shift: trial(shift).cuts, gate)
            judged = alone and not search.imposed
        now = trial(search.shift)
        told = _clock(search.shift)
        if (
            found is None
            or (judged and found.free and now.gate.at(found.final.axis, found.free))
            or (
                judged and found.verdict not in _CLEAN and not search.late and now.gate.opens_wide()
            )
        ):
            by_runs = _diagnosis(now, search, window)
            by_runs = replace(by_runs, messages=(*told, *by_runs.messages))
            muted = _muted(by_runs, window, hold)
            if search.late or (by_runs.verdict in _CLEAN and not muted):
                return by_runs
            # A random force near the noise of the readings, or an effect outside the catalogue.
            found = found or answer(search, lambda shift: trial(shift).cuts)
            if found is None or not (muted or _prevails(search, found, by_runs)):
                return by_runs
        # Last, as a cause not yet found may look like a difference between the records.
        if len(records) > 1 and LATE not in found.messages:
            tell("differences between the records")
            apart(search, found, trial(search.shift).cuts)
        found.messages[:0] = told
        return _likely(axis, now.records, found, window, hold, now.part, limit == math.inf)


def _prevails(search: Search, found: Answer, by_runs: Diagnosis) -> bool:
    """Whether the likelihood's answer replaces that of free runs that left something.

    It must leave nothing, and either contain all causes named by free runs or be likelier.
    """
    if found.verdict not in _CLEAN:
        return False
    return _agree(by_runs, found) or found.final.cost < search.reference(by_runs.extended).cost


def _muted(d: Diagnosis, window: float, hold: str) -> bool:
    """Whether the fitted axis moves as measured even without its drive, as a pendulum does.

    Then the motion does not depend on the drive, and free runs are uninformative.
    """
    if not d.causes:
        return False
    idle = d.record.replace(u=np.zeros(len(d.record)))
    driven, alone = (replay(d.extended, r, window, hold).median for r in (d.record, idle))
    return alone < _IDLE * driven


@dataclass(frozen=True, eq=False)
class Trial:
    """Records cut into windows, and the free-run search and gate of the first one.

    Attributes
    ----------
    cuts : list of Windows
    part : ndarray of int64, shape (nwindows,)
        Use of each window of the first record: FIT, JUDGE or MEASURE.
    selector : Selector
    gate : Gate
    """

    cuts: list[Windows]
    part: NDArray[np.int64]
    selector: Selector
    gate: Gate

    @classmethod
    def of(
        cls, axis: FrictionAxis, cuts: list[Windows], settings: dict[str, Any],
        tell: Callable[[str], None],
    ) -> Trial:  # fmt: skip
        """Trial of records that have been cut into windows."""
        first, part = cuts[0], roles(cuts[0])
        race = Race(first, axis, part == FIT, part == JUDGE, typical([first.record]), **settings)
        gate = Gate(first, axis, race.fit, race.judge, settings)
        return cls(cuts, part, Selector(race, axis, tell), gate)

    @property
    def records(self) -> list[Record]:
        """The records, with the inputs of their windows."""
        return [one.record for one in self.cuts]


def _later(records: Sequence[Record], shift: float) -> list[Record]:
    """Records with their inputs delayed by `shift` [s]; negative values advance them."""
    return [one.replace(u=shifted(one.u, shift / one.dt)) for one in records]


def _clock(shift: float) -> list[str]:
    """Message about inputs that act before their time stamps, if they do."""
    if shift == 0.0:
        return []
    early = length_text(-shift, "s")
    return [f"the recorded input acts {early} before its time stamp: d.record has it shifted"]


def _agree(by_runs: Diagnosis, found: Answer) -> bool:
    """Whether all causes named by free runs are also named by the likelihood."""
    return {c.effect for c in by_runs.causes} <= {c.effect for c in found.causes}


def _cut(
    axis: FrictionAxis, record: Record, window: float, hold: str, name: str, least: int
) -> Windows:
    """Windows of a record; ValueError if it cannot be diagnosed."""
    windows = cut(record, window, hold)
    check_units(axis, record, name)
    warn_if_implausible(axis, record, 4)
    if len(windows) < least:
        raise ValueError(
            f"{name} lasts {record.duration:.3g} s, which is {len(windows)} windows of "
            f"{window:g} s: give at least {least} windows, or a shorter window"
        )
    return windows


def _check_motion(windows: Windows, part: NDArray[np.int64], name: str) -> None:
    moving = windows.moving
    if not np.any(moving & (part == FIT)) or not np.any(moving & (part == JUDGE)):
        raise ValueError(
            f"{name}: the axis hardly moves, so friction cannot be determined; use a record with "
            "slow and fast moves in both directions"
        )


def _nothing(selector: Selector, axis: FrictionAxis | None = None) -> bool:
    """Whether an axis, by default the nominal one, reaches the noise without a fit."""
    race = selector.race
    before = race.judged(race.alone(selector.axis if axis is None else axis, (), base=()))
    return selector.floor_of(before).nothing(before.scores, selector.known)


def _blind(selector: Selector) -> bool:
    """Whether free runs are too short to reveal a force above the noise of the readings.

    That is so if they accept both a far too low and a far too high Coulomb level.
    """
    level = float(values_of(selector.axis, ["coulomb"])[0])
    off = (with_values(selector.axis, ["coulomb"], [part * level]) for part in _FAR_OFF)
    return level > 0.0 and all(_nothing(selector, one) for one in off)


def _likely(
    axis: FrictionAxis, records: Sequence[Record], found: Answer, window: float, hold: str,
    part: NDArray[np.int64], unhurried: bool,
) -> Diagnosis:  # fmt: skip
    """Diagnosis from the answer of the likelihood."""
    experiment = None
    extended = found.final.axis
    doubtful = next((c for c in found.causes if found.rivals.get(c.effect)), None)
    if doubtful is not None and unhurried:
        rivals = found.rivals[doubtful.effect]
        rivals = dict(list(rivals.items())[:_RIVALS])
        experiment = next_experiment(
            extended, list(rivals.values()), records[0], names=[doubtful.effect, *rivals]
        )
    return Diagnosis(
        axis=axis,
        record=records[0],
        verdict=found.verdict,
        causes=tuple(found.causes),
        extended=extended,
        gain=found.gain,
        unexplained=found.unexplained,
        next_experiment=experiment,
        messages=(*found.messages, *_left_out(records)),
        scores=found.scores,
        window=window,
        hold=hold,
        roles=part,
        remaining=found.remaining,
        references=found.references,
        varies=found.varies,
        others=tuple(records[1:]),
    )


def _left_out(records: Sequence[Record]) -> list[str]:
    """Messages about readings that were not used."""
    found = []
    for i, record in enumerate(records):
        if record.masked.reasons:
            which = f" of record {i + 1}" if len(records) > 1 else ""
            kinds = told({kind: record.bad[kind] for kind in REASONS})
            found.append(f"readings{which} left out: {kinds} (d.masked lists them)")
    return found


def diagnose_batch(
    axis: FrictionAxis,
    records: Mapping[str, Record] | Sequence[Record],
    *,
    window: float = 0.25,
    hold: str = "zero",
    store: str | os.PathLike[str] | None = None,
    jobs: int | None = None,
    progress: bool = True,
) -> dict[Any, dict[str, Any]]:
    """Diagnose many records of one axis, resumable.

    Parameters
    ----------
    axis : FrictionAxis
        The nominal axis.
    records : mapping of str to Record, or sequence of Record
        The measured records by name; those of a sequence are numbered from 0.
    window : float, optional
        Length of the free runs [s].
    hold : {"zero", "first"}, optional
        Whether the recorded inputs are held or interpolated linearly between samples.
    store : path-like, optional
        File that keeps each finished record, see `run_batch`.
    jobs : int, optional
        Number of records in parallel, -1 for one on each core.  Default: the setting
        of `joblib.parallel_config`, else one.
    progress : bool, optional
        Whether to show a progress bar.

    Returns
    -------
    dict
        `Diagnosis.to_dict` of each record, by its name or number.

    Raises
    ------
    ValueError
        If an argument is out of its range, a record cannot be diagnosed (named in
        a note), or the store is of another axis, window, hold or version.

    Notes
    -----
    A store identifies records by their name and their data: a new measurement under
    an old name is diagnosed again.

    Examples
    --------
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> believed = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> machine = believed.replace(effects=(dfc.effects.InputGain(gain=1.2),))
    >>> t = 1e-3 * np.arange(6000)
    >>> u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
    >>> x = 1e-6 * np.round(1e6 * machine.simulate(u, dt=1e-3).y[0])
    >>> found = dfc.diagnose_batch(believed, {"monday": dfc.Record(t, u, x)}, progress=False)
    >>> [cause["effect"] for cause in found["monday"]["causes"]]
    ['input_gain']
    """
    instance("axis", axis, FrictionAxis)
    if not isinstance(records, (Mapping, list, tuple)):
        raise ValueError(
            f"records must be a mapping of names to Record, or a list of Record, got {records!r}"
        )
    named = records.items() if isinstance(records, Mapping) else enumerate(records)
    cases: dict[Any, Record] = {}
    for name, record in named:
        instance(f"records[{name!r}]", record, Record, "see dfc.read_record")
        check_units(axis, record, f"records[{name!r}]")
        try:
            cut(record, window, hold)
        except ValueError as problem:
            problem.add_note(f"in records[{name!r}]")
            raise
        data = fingerprint(record.t, record.u, record.x, record.reference, record.quantum)
        cases[name, data] = record
    found = run_batch(
        functools.partial(_found, axis, window, hold),
        cases,
        store=store,
        settings={
            "task": "diagnose",
            "version": __version__,
            "axis": fingerprint(axis),
            "window": float(window),
            "hold": hold,
        },
        jobs=jobs,
        progress=progress,
    )
    return {name: result for (name, _), result in found.items()}


def _found(axis: FrictionAxis, window: float, hold: str, record: Record) -> dict[str, Any]:
    # Records already run in parallel.
    return diagnose(axis, record, window=window, hold=hold, jobs=1, progress=False).to_dict()


def _diagnosis(trial: Trial, search: Search, window: float) -> Diagnosis:
    """Diagnosis by free runs."""
    selector, part, record = trial.selector, trial.part, trial.records[0]
    axis, race, bench = selector.axis, selector.race, selector.bench
    race.hints = trial.gate.hints
    before = race.judged(race.alone(axis, (), base=()))
    floor_before = selector.floor_of(before)
    if floor_before.nothing(before.scores, selector.known):
        found, best, kept = Selection(before), before, list[str]()
        found.first[""] = float(before.scores[race.judge].mean())
    else:
        for _ in range(_SEARCHES):
            found, floor = selector.run()
            best, kept = selector.base(found, floor)
            if selector.late or not selector.refutes(found, best, kept, floor):
                break
        else:
            floor = selector.without_refuted(found)
            best, kept = selector.base(found, floor)
        if not found.causes and not kept:
            best = before
        best, kept = selector.without_a_gain(found, best, kept, floor)
    selector.tell("all data")
    late = selector.late
    race.until = search.end
    free = [n for names in found.free.values() for n in names]
    final = best
    if free or kept:
        final = race.alone(best.axis, free, base=kept, active=selector.known, search=True)
    floor = selector.floor_of(final)
    explained = floor.reached(final.scores, selector.known)
    gain, confirmed = _gain(selector, axis, final, part == MEASURE)
    # A cause must also hold on the data that served for no choice.
    explained = explained and (confirmed or not (free or kept))
    left = _unexplained(selector, final, floor, gain, explained)
    alike = _alike(selector, before, final, found, kept, floor)
    causes = _causes(selector, found, best, final, kept, tuple(alike))
    if causes:
        verdict = "explained" if explained else "partly explained"
    else:
        verdict = "nothing to find" if explained else "unexplained"
    experiment = None
    doubtful = next((slug for slug in found.causes if found.rivals.get(slug)), None)
    messages = hardly_determined(causes)
    if late:
        messages.append(LATE)
    messages += _left_out([record])
    if doubtful is not None:
        rest = selector.without(final.axis, doubtful)
        alike = {s: in_place(rest, r, s) for s, r in found.rivals[doubtful].items()}
    elif alike:
        doubtful = causes[0].effect
    if doubtful is not None and not late:
        selector.tell("next experiment")
        rivals = dict(list(alike.items())[:_RIVALS])
        experiment = next_experiment(
            final.axis, list(rivals.values()), record, names=[doubtful, *rivals]
        )
    return Diagnosis(
        axis=axis,
        record=record,
        verdict=verdict,
        causes=tuple(causes),
        extended=final.axis,
        gain=gain,
        unexplained=left,
        next_experiment=experiment,
        messages=tuple(messages),
        scores=found.first,
        window=window,
        hold=bench.hold,
        roles=part,
        remaining=_remaining(search, final, left, explained),
    )


def _remaining(search: Search, final: Fitted, left: Unexplained, explained: bool) -> Remaining:
    """Random force left by a fit to free runs; none if they reach the noise."""
    unit = search.believed.units[1]
    if explained:
        return Remaining(0.0, 0.0, False, (), unit=unit)
    return remaining(search.reference(final.axis, runs=search.few), True, left.where, unit)


def _alike(
    selector: Selector, nominal: Fitted, final: Fitted, found: Selection, kept: list[str],
    floor: Floor,
) -> dict[str, FrictionAxis]:  # fmt: skip
    """Axes with one effect each that is equivalent to the one wrong base parameter.

    A search that stops at base parameters has tried no effects.
    """
    race = selector.race
    if found.causes or selector.late or len(selector.wrong(final, kept)) != 1:
        return {}
    selector.tell("equivalents")
    others = race.instead(nominal, catalogue(selector.axis, ()), final)
    return {r.slug: r.axis for r in others if selector.ties(r.scores, final.scores, floor)}


def _causes(
    selector: Selector, found: Selection, best: Fitted, final: Fitted, kept: list[str],
    alike: Sequence[str],
) -> list[Cause]:  # fmt: skip
    race, errors = selector.race, selector.standard_errors(final)
    values = final.hypothesis.values(final.z)
    units = {p.name: p.unit for p in final.hypothesis.parameters}
    open_gain = left_open(selector.axis, {*race.known, *race.tolerance})
    causes = []
    for slug in found.causes:
        less = race.alone(
            selector.without(best.axis, slug),
            selector.names(found, slug),
            base=kept,
        )
        own = {n.partition(".")[2]: n for n in found.free[slug]}
        gain = selector.gain(less.scores, best.scores)
        others = found.alternatives.get(slug, ())
        if slug == GAIN and open_gain:
            others = (*others, "+".join(every(selector.axis)))
        causes.append(cause_of(selector.axis, slug, own, values, errors, units, gain, others))
    bases = []
    for name in selector.wrong(final, kept):
        rest = [n for n in kept if n != name]
        free = [n for names in found.free.values() for n in names]
        less = race.alone(selector.hold(best.axis, [name]), free, base=rest)
        gain, own = selector.gain(less.scores, best.scores), {name: name}
        bases.append(cause_of(selector.axis, SLUGS[name], own, values, errors, units, gain, alike))
    bases = [bases[i] for i in ranked([-cause.held_out_gain for cause in bases])]
    if open_gain and GAIN not in found.causes:
        bases = or_a_gain(selector.axis, bases)
    return causes + bases


def _unexplained(selector, final, floor, gain, explained):  # type: ignore[no-untyped-def]
    if explained:
        return Unexplained(0.0, False, ())
    scores = np.where(selector.known, final.scores, np.nan)
    worst = float(floor.worst[selector.known].max())
    return Unexplained(gain.left, True, where(scores, worst, selector.bench, selector.axis.units))


def _gain(selector, axis, final, measured):  # type: ignore[no-untyped-def]
    bench = selector.bench
    if not np.any(measured & bench.moving):
        measured = selector.race.judge
    rows = []
    for one in (axis, final.axis):
        at = bench.evaluate(one, measured, thorough=True)
        rows.append(bench.mean_squares(at.errors)[measured])
    floor = noise_floor(bench, final.axis, [final.axis] * REPLAYS, at, measured)
    confirmed = floor.reached(bench.scores(at.costs), measured)
    labels = np.unique(selector.labels[np.flatnonzero(measured)], return_inverse=True)[1]
    gain = Gain(
        before=float(np.sqrt(rows[0].mean())),
        after=float(np.sqrt(rows[1].mean())),
        floor=usual_rms([floor.squares[:, measured]]),
        interval=ratio_interval(*rows, labels),
        unit=axis.units[0],
    )
    return gain, confirmed and not far_above(rows[1:], [floor.squares[:, measured]])
