"""The next experiment: the one that best separates causes that fit equally well."""

from __future__ import annotations

import functools
import os
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.checks import instance
from dryfric_control.diagnosis.excitations import EXCITATIONS, Limits, Stage
from dryfric_control.diagnosis.simulated_trial import Refit, Staged, largest_trial, mean_squares
from dryfric_control.drawing import DASHES, legend_above, over_time, panels
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects.naming import class_of, title_of, titles_of
from dryfric_control.records.record import Record
from dryfric_control.store.files import file_path, replace_file
from dryfric_control.text import Result, documented, rotary_words, stated
from dryfric_control.ties import exceeds, stable_order
from dryfric_control.units import check_units

# Mean of log(1 + (error/quantum)^2) over the windows, the largest left out (one mistimed
# breakaway is no evidence), from which hypotheses differ: about two windows in thirty off
# by five quanta.
_MIN_SCORE = 0.1
# RMS error [quanta] up to which hypotheses cannot be separated.
_MIN_RMS_QUANTA = 1.0
_none = functools.partial(np.empty, 0)


@documented
@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Experiment(Result):
    """The experiment that best separates equally good causes.

    Made by `next_experiment`.

    Examples
    --------
    >>> from dryfric_control.diagnosis import Experiment
    >>> plan = Experiment(
    ...     name="crawl", title="crawl", description="Crawl both ways.", separates=("spring",),
    ...     score={"spring": 40.0}, tried={"crawl": 90.0}, cause="bias_force", units=("m", "N"))
    >>> print(plan.summary())
    crawl: Crawl both ways. It separates bias force from spring
    (they differ by 40 encoder quanta RMS).
    """

    name: str = stated(
        'Short name of the excitation; "change_of_bench" if none of the set separates the causes.'
    )
    title: str = stated("Title of the excitation.")
    description: str = stated("Instructions for the bench.")
    t: Floats = stated("Time [s]; empty for a change of the bench.", default_factory=_none)
    reference: Floats = stated(
        "Position reference [m] for the position loop.", default_factory=_none
    )
    force: Floats | None = stated("Force added to the loop's drive [N], if any.", None)
    separates: tuple[str, ...] = stated("Alternatives that it separates from the named cause.", ())
    score: dict[str, float] = stated(
        "For every alternative: remaining windowed error between it and the named cause after the "
        "best refit, RMS in encoder quanta; 0 if they are not separated."
    )
    tried: dict[str, float] = stated(
        "For every excitation that keeps the limits: the same error before any refit, smallest "
        "over the alternatives."
    )
    cause: str = stated("The named cause.")
    positions: dict[str, Floats] = stated(
        "Position [m] that each hypothesis predicts.", default_factory=dict
    )
    drives: dict[str, Floats] = stated(
        "Drive force [N] that each hypothesis predicts.", default_factory=dict
    )
    units: tuple[str, str] = stated("Units of position and force.")
    _told = (*"name title description t reference force separates score tried cause".split(),)

    def _summary_parts(self) -> list[str]:
        return [self.summary()]

    def summary(self) -> str:
        """Instructions and what they separate, in a sentence or two."""
        text = f"{self.title}: {self.description}"
        if self.separates:
            far = "{} (they differ by {:.3g} encoder quanta RMS)".format
            shown = ", ".join(far(titles_of(slug), self.score[slug]) for slug in self.separates)
            text += f" It separates {titles_of(self.cause)} from {shown}."
        left = [slug for slug in self.score if slug not in self.separates]
        if left and self.separates:
            text += f" It leaves {', '.join(map(titles_of, left))} open."
        return rotary_words(text, self.units[1])

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write time, reference and force to a file for the bench.

        Parameters
        ----------
        path : path-like
            File to write, replaced as a whole or not at all.

        Raises
        ------
        ValueError
            If the experiment has no reference to follow.
        """
        file_path("path", path)
        if not self.t.size:
            raise ValueError(
                "this experiment is a change of the bench and has no reference to write: "
                "read its description"
            )
        columns = {"t": self.t, "reference": self.reference}
        columns |= {} if self.force is None else {"force": self.force}
        table = np.column_stack([*columns.values()])
        head = ",".join(columns)
        with replace_file(path) as part:
            np.savetxt(part, table, fmt="%.9g", delimiter=",", header=head, comments="")

    @panels(2)
    def plot(self, axes: Any) -> str:
        """Draw the reference and the prediction of each hypothesis."""
        length, force = self.units
        if not self.t.size:
            for one in axes:
                one.set_axis_off()
            style = {"transform": axes[0].transAxes, "va": "top", "fontsize": "small"}
            axes[0].text(0.0, 0.9, textwrap.fill(self.description, 90), **style)
            return self.title
        axes[0].plot(self.t, self.reference, color="0.6", linewidth=1.5, label="reference")
        for i, name in enumerate(self.positions):
            style = {"color": f"C{i}", "linestyle": DASHES[i % len(DASHES)], "linewidth": 1.2}
            label = rotary_words(titles_of(name), force)
            axes[0].plot(self.t, self.positions[name], label=label, **style)
            axes[1].plot(self.t, self.drives[name], **style)
        if self.force is not None:
            axes[1].plot(self.t, self.force, color="0.6", linewidth=1.0, label="added force")
            legend_above(axes[1])
        over_time(axes, (f"position [{length}]", f"drive force [{force}]"))
        legend_above(axes[0])
        return self.title


def next_experiment(
    axis: FrictionAxis,
    rivals: Sequence[FrictionAxis],
    record: Record,
    *,
    names: Sequence[str] | None = None,
    limits: Limits | None = None,
) -> Experiment | None:
    """Experiment that best separates a cause from its alternatives.

    Parameters
    ----------
    axis : FrictionAxis
        The axis fitted with the named cause.
    rivals : sequence of FrictionAxis
        The axis fitted with each alternative.
    record : Record
        The record that all of them explain.
    names : sequence of str, optional
        Slugs of the named cause and of the alternatives.  Default: the effects
        that distinguish the axes.
    limits : Limits, optional
        Travel, drive and speed that may be used.  Default: travel of the axis or
        else of the record, largest drive and speed of the record.

    Returns
    -------
    Experiment or None
        None if there are no rivals.

    Raises
    ------
    ValueError
        If an argument is of the wrong kind or number.

    Notes
    -----
    Each excitation of a small set is simulated in a position loop, read through the record's
    encoder, with every hypothesis in turn as the truth, and reduced in size until all of them
    keep the limits.  The other hypothesis is then simulated freely over windows of it from the
    true states, after a refit of its parameters that must keep its prediction of the known
    record.  The distance of the two is the mean of log(1 + (error/quantum)^2), net of a straight
    line in time, without the largest window, the smaller of both directions.

    Experiments that need a known mass or force are tried only if no other separates the causes.
    If these do not either, the causes are equivalent on this bench, and the answer is in words.
    It assumes that one of the hypotheses is true.

    Examples
    --------
    A bias and a spring whose force hardly changes over a short way:

    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> base = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, travel=(-0.2, 0.2))
    >>> bias = base.replace(effects=(dfc.effects.BiasForce(force=2.0),))
    >>> spring = base.replace(effects=(dfc.effects.Spring(stiffness=10.0, rest=0.2),))
    >>> t = 1e-3 * np.arange(4000)
    >>> u = 20.0 * np.sin(2 * np.pi * 2.0 * t)
    >>> x = 1e-6 * np.round(1e6 * bias.simulate(u, dt=1e-3, x0=-0.05).y[0])
    >>> found = dfc.next_experiment(bias, [spring], dfc.Record(t, u, x))
    >>> found.separates, found.score["spring"] > 10.0
    (('spring',), True)
    """
    axes = _check_hypotheses(axis, rivals, record, limits)
    names = _hypothesis_names(axes, names)
    if len(axes) == 1:
        return None
    stage = Stage(axis, limits or Limits.from_record(axis, record), record.dt)
    tried, chosen, left = _search(axes, record, stage)
    if chosen is None or not any(pair.is_sufficient for pair in left):
        return _change_of_bench(names, tried, axis.units)
    score = {
        name: pair.rms * pair.is_sufficient for name, pair in zip(names[1:], left, strict=True)
    }
    return Experiment(
        name=chosen.excitation.name,
        title=chosen.excitation.title,
        description=chosen.excitation.description_at(stage),
        t=stage.t,
        reference=chosen.reference,
        force=chosen.force if np.any(chosen.force) else None,
        separates=tuple(name for name, rms in score.items() if rms),
        score=score,
        tried=tried,
        cause=names[0],
        positions=dict(zip(names, (trial.x for trial in chosen.trials), strict=True)),
        drives=dict(zip(names, (trial.u for trial in chosen.trials), strict=True)),
        units=axis.units,
    )


def _search(
    axes: Sequence[FrictionAxis], record: Record, stage: Stage
) -> tuple[dict[str, float], Staged | None, list[Distance]]:
    """Least distance in each experiment, the best one, and the distances left after a refit."""
    quantum = record.resolution.step
    refits = [Refit.from_axis(one, record, quantum) for one in axes]
    tried: dict[str, float] = {}
    best = -1.0
    chosen = None
    left = []
    for changed in (False, True):
        some = [e for e in EXCITATIONS if (e.change is not None) == changed]
        made = (largest_trial(e, stage, axes, quantum, record.dt) for e in some)
        stages = [one for one in made if one is not None]
        raw = [_distances(one, quantum) for one in stages]
        for one, pairs in zip(stages, raw, strict=True):
            tried[one.excitation.name] = min(pair.rms for pair in pairs)
        # A refit can only bring hypotheses closer: the distance before it is an upper bound,
        # so that the search in this order can stop early.
        upper = list(map(_separation_merit, raw))
        for k in stable_order(-np.array(upper)):
            if not exceeds(upper[k], best):
                break
            pairs = _distances(stages[k], quantum, refits, raw[k])
            if exceeds(_separation_merit(pairs), best):
                best = _separation_merit(pairs)
                chosen = stages[k]
                left = pairs
        if left and all(pair.is_sufficient for pair in left):
            break
    return tried, chosen, left


class Distance(NamedTuple):
    """How far two hypotheses are from each other in an experiment."""

    part: float  # mean log score without the worst window
    rms: float  # in quanta

    @classmethod
    def from_squares(cls, squares: Floats, quantum: float) -> Distance:
        """Distance that the mean squares of the windows are."""
        ratio = np.sort(squares) / quantum**2
        part = float(np.mean(np.log1p(ratio[:-1])))
        return cls(part, float(np.sqrt(np.mean(ratio))))

    @property
    def is_sufficient(self) -> bool:
        """Whether that is enough to separate them."""
        return self.part > _MIN_SCORE and self.rms > _MIN_RMS_QUANTA


def _separation_merit(pairs: Sequence[Distance]) -> float:
    """Merit of an experiment; saturates, so that pairs not separated yet count most."""
    return float(np.mean([pair.part / (1.0 + pair.part) for pair in pairs]))


def _distances(
    one: Staged, quantum: float, refits: Sequence[Refit] = (), raw: Sequence[Distance] = ()
) -> list[Distance]:
    """Distance of every rival from the named cause, smaller of both directions.

    `refits`: of every hypothesis, to what the other one does; `raw`: the distances without.
    """
    found = []
    for rival in range(1, len(one.axes)):
        worst = raw[rival - 1] if raw else Distance(np.inf, np.inf)
        for truth, other in ((0, rival), (rival, 0)):
            trial = one.trials[truth]
            if not refits:
                squares = mean_squares(trial.errors(one.axes[other]))
            elif worst.part > _MIN_SCORE:
                squares = refits[other].refit_errors(one, trial)
            else:
                break
            worst = min(worst, Distance.from_squares(squares, quantum))
        found.append(worst)
    return found


def _change_of_bench(
    names: Sequence[str], tried: dict[str, float], units: tuple[str, str]
) -> Experiment:
    """The answer where no motion within the limits separates the causes."""
    effects = {title_of(name): class_of(name) for name in names}
    own = [f"{title}: {known.experiment}" for title, known in effects.items() if known is not None]
    changes = [e.title for e in EXCITATIONS if e.change is not None and e.name in tried]
    nor = f", nor does {' or '.join(changes)}" if changes else ""
    why = (
        f"No motion within these limits separates {titles_of(names[0])} from "
        f"{', '.join(map(titles_of, names[1:]))}{nor}: what they predict differs by less than the "
        "encoder shows."
        if tried
        else "No experiment of the set keeps the limits of travel, drive and speed: widen them."
    )
    return Experiment(
        name="change_of_bench",
        title="a change of the bench",
        description=f"{why} Turn or tilt the axis, or swap its drive, repeat the record, and see "
        f"what stays with the axis. {' '.join(own)}",
        score=dict.fromkeys(names[1:], 0.0),
        tried=tried,
        cause=names[0],
        units=units,
    )


def _check_hypotheses(axis: Any, rivals: Any, record: Any, limits: Any) -> tuple[FrictionAxis, ...]:
    """The axes of all hypotheses, and every argument of its kind."""
    instance("axis", axis, FrictionAxis)
    rivals = (rivals,) if isinstance(rivals, FrictionAxis) else rivals
    if not isinstance(rivals, Iterable):
        raise ValueError(f"rivals must be a sequence of FrictionAxis, got {rivals!r}")
    rivals = tuple(rivals)
    for i, one in enumerate(rivals):
        instance(f"rivals[{i}]", one, FrictionAxis)
    instance("record", record, Record, "from dfc.read_record(...) or dfc.Record(t, u, x)")
    check_units(axis, record)
    if limits is not None:
        instance("limits", limits, Limits, "dfc.diagnosis.Limits(travel=..., drive=..., speed=...)")
    return axis, *rivals


def _hypothesis_names(axes: Sequence[FrictionAxis], names: Sequence[str] | None) -> list[str]:
    """The given names, or those of the effects by which the axes differ."""
    if names is not None:
        if isinstance(names, str) or not isinstance(names, Sequence):
            raise ValueError(f"names must be a sequence of names, got {names!r}")
        if not all(isinstance(name, str) for name in names):
            raise ValueError(f"names must hold names in text, got {names!r}")
        if not len(names) == len(set(names)) == len(axes):
            raise ValueError(
                f"names must hold {len(axes)} different names, of the cause and of each rival, "
                f"got {list(names)!r}"
            )
        return list(names)
    contents = [one.named_effects() for one in axes]
    common = set.intersection(*map(set, contents))
    found: list[str] = []
    for i, content in enumerate(contents):
        own = "+".join(slug for slug in content if slug not in common)
        name = own or ("cause" if i == 0 else f"rival {i}")
        found.append(name if name not in found else f"{name} ({i})")
    return found
