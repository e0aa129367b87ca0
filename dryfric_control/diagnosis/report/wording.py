"""Findings in words: levels in newtons, what a cause comes to, the summary."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.diagnosis.causes import GAIN
from dryfric_control.diagnosis.report.findings import (
    LATE,
    SMALL,
    Cause,
    Findings,
    cause_text,
    short_cause_text,
    with_error,
)
from dryfric_control.diagnosis.thresholds import MIN_MODEL_LEAD
from dryfric_control.estimation.likelihood import BASE
from dryfric_control.estimation.parameters import base_unit, values_of
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects.naming import class_of, title_of, titles_of
from dryfric_control.text import length_text, percent, rotary_words

# What separates a gain of the drive from base parameters that are all wrong.
_BY_A_FORCE = (
    "No motion can: add a known mass or pull with a known force, and record again; or state "
    'which value is right, such as known=("mass",).'
)

# Names and units of base parameters that effects change over time.
_CHANGING = {"coulomb": ("Coulomb level", "N"), "viscous": ("viscous friction", "N s/m")}
# Relative change of a base parameter that is reported although no cause names it.
_MOVED = 0.01
# Factor by which a nominal value is off that is said in the first lines.
_FAR_OFF = 2.0
# Most causes, and most warnings, of the brief answer.
_BRIEF_CAUSES = 3
_BRIEF_WARNINGS = 1
# Verdicts that leave nothing to look for.
_SETTLED = ("nothing to find", "explained")
#: Directions of motion in words.
WAYS = ((1, "forwards"), (-1, "backwards"))


def gain_of(d: Findings, fall: float) -> float:
    """Gain of log-likelihood that a fall of the mean score of a sample is."""
    # One step errs hardly less with a cause than without: all of them together show it.
    return 0.5 * sum(map(len, (d.record, *d.others))) * fall


def check_text(d: Findings) -> str:
    """What to check on the machine, in one sentence."""
    if d.main_causes:
        cause = d.main_causes[0]
        return f"{cause.title}: {cause.experiment[:1].lower()}{cause.experiment[1:]}"
    if d.is_muted and not _drive_moves_it(d):
        return "units, signs and clocks of the record, then what else pushes the axis."
    if d.is_muted:
        return "what else pushes the axis: record.force_map(axis) shows over what it acts."
    if d.unexplained.significant and d.unexplained.where:
        return f"what happens where the error is largest: {places_text(d)}."
    if d.unexplained.significant:
        return "the same motion again: the error is spread over the record, with no clear location."
    if d.causes or d.varies:
        return "the values above, against data sheets and a second record."
    if d.verdict in _SETTLED:
        return "nothing, as long as it moves as in this record; other motions are not tested."
    return "what the warnings name: the record does not settle what is wrong."


def _drive_moves_it(d: Findings) -> bool:
    """Whether the nominal axis clearly beats a straight line: the units of its drive are right."""
    lead = d.references.get("straight line", 0.0) - d.references.get("nominal axis", 0.0)
    return lead > MIN_MODEL_LEAD * sum(map(len, (d.record, *d.others)))


def levels(axis: FrictionAxis, x: Floats, direction: int) -> list[float]:
    """Coulomb level in one direction at time zero, without load and Stribeck peak."""
    acting = axis.effective()
    kept = tuple(e for e in acting.effects if e.action == "friction")
    block = acting.replace(stribeck=None, effects=kept).mode(direction)
    return [float(direction * block.output(0.0, [place, 0.0], [0.0])[2]) for place in x]


def viscous_coefficient(axis: FrictionAxis, direction: int) -> float:
    """Viscous coefficient in one direction."""
    acting = axis.effective()
    return acting.viscous + sum(effect.viscous_in(direction) for effect in acting.effects)


def level_table(d: Findings, points: int = 3) -> dict[str, Any]:
    """Coulomb levels, by side and direction, at "x", positions over the range of the record."""
    x = np.linspace(float(d.record.x.min()), float(d.record.x.max()), points)
    table: dict[str, Any] = {"x": x.tolist()}
    for side, axis in (("believed", d.axis), ("found", d.extended)):
        table[side] = {way: levels(axis, x, s) for s, way in WAYS}
    return table


def level_varies(table: dict[str, Any], in_place: bool = False) -> bool:
    """Whether a table's level depends on position, or else on position or direction."""
    levels = np.array([[table[side][way] for _, way in WAYS] for side in ("believed", "found")])
    parts = levels.reshape(4 if in_place else 2, -1)
    return bool(np.any(np.ptp(parts, axis=1) > 1e-9 * parts.max(axis=1)))


def level_text(table: dict[str, Any], side: str, units: tuple[str, str]) -> str:
    """Levels of one side of a table in words."""
    length, force = units
    ways = []
    for _, way in WAYS:
        values = [f"{value:.3g} {force}" for value in table[side][way]]
        if len(set(values)) > 1:
            places = zip(values, table["x"], strict=True)
            values = [f"{v} at x = {x:.3g} {length}" for v, x in places]
        ways.append(", ".join(dict.fromkeys(values)))
    if ways[0] == ways[1]:
        return f"{ways[0]}, both ways"
    mark, between = (": ", "; ") if "," in "".join(ways) else (" ", ", ")
    return between.join(f"{way}{mark}{one}" for (_, way), one in zip(WAYS, ways, strict=True))


def cause_meaning(d: Findings, cause: Cause) -> list[str]:
    """What a cause comes to in the axis, a line each; none where its parameters say it."""
    lines = []
    effect = d.extended.named_effects().get(cause.effect)
    if effect is not None and effect.viscous_in(1) != 0.0:
        unit = d.axis.unit("N s/m")
        sides = []
        for axis in (d.extended, d.axis):
            one, other = (f"{viscous_coefficient(axis, s):.4g} {unit}" for s, _ in WAYS)
            both = one == other
            sides.append(f"{one}, both ways" if both else f"forwards {one}, backwards {other}")
        lines.append(f"viscous friction (x grows forwards): {sides[0]}; nominal: {sides[1]}")
    if effect is not None and effect.meaning(d.axis.units):
        lines.append(effect.meaning(d.axis.units))
    # The level is that of all causes: it stands once.
    first = next((one.effect for one in shown_causes(d) if acts_on_level(one)), None)
    if cause.effect == first:
        table = level_table(d)
        drifts = any(e.action == "friction" and e.depends_on_time for e in d.extended.effects)
        when = ", at the start" if drifts else ""
        for side, name in (("found", "found"), ("believed", "nominal")):
            words = level_text(table, side, d.axis.units)
            lines.append(f"Coulomb level {name} (x grows forwards{when}): {words}")
    return lines


def acts_on_level(cause: Cause) -> bool:
    """Whether a cause makes the Coulomb level depend on position or direction."""
    effect = class_of(cause.effect)
    if effect is None or effect.action != "friction":
        return False
    return bool(effect.depends_on_direction or effect.depends_on_place)


def gain_title(d: Findings) -> str:
    """What the gain is of."""
    if d.gain.unit == d.axis.units[1]:
        return "force that the motion needs in addition to the drive"
    return "error of free runs on unseen data, each from its most likely start"


def gain_text(d: Findings) -> str:
    """Error of free runs before and after, and how much of it is left, in one line."""
    g = d.gain
    if not (d.causes or d.varies):
        before, floor = (length_text(v, g.unit) for v in (g.before, g.floor))
        return f"{before} RMS; noise floor {floor}"
    share = d.unexplained.fraction
    left = "less than 1 %" if share < 0.01 else percent(share)
    rest = f"; {left} of the error above noise is left" if d.unexplained.significant else ""
    return g.headline + rest


def places_text(d: Findings) -> str:
    """Where the remaining error occurs."""
    # What is said of several records alike is said once.
    said: dict[str, str] = {}
    for place in d.unexplained.where:
        head, _, numbers = place.partition(": ")
        said[head] = f"{said[head]}, {numbers}" if head in said else place
    return "; ".join(said.values()) or "no clear location"


def next_steps(d: Findings) -> list[str]:
    """What to do with a diagnosis, a line each."""
    steps = []
    if d.verdict == "nothing to find":
        steps.append("Use the nominal axis as it is, for motions like those in this record.")
    elif d.causes:
        steps.append("Use the axis with the causes instead of the nominal one, see below.")
    if d.is_muted and not _drive_moves_it(d):
        steps.append(
            "Look at the record first, d.record.check(d.axis): its units, factors and signs, "
            "whether u is the force that acted, and whether u and x have one clock."
        )
    if d.is_muted:
        steps.append(
            "Find what else pushes the axis: keep it away, or record it as load=... and diagnose "
            "again."
        )
    if d.unexplained.significant:
        steps += _steps_to_the_rest(d)
    steps += _steps_by_cause(d)
    if d.next_experiment is not None:
        steps.append(f"Next experiment: {d.next_experiment.summary()}")
    return steps


def _steps_to_the_rest(d: Findings) -> Iterator[str]:
    """What to do to explain the remaining error."""
    if d.unexplained.where:
        yield f"See where the remaining error occurs: {places_text(d)}."
    if LATE in d.messages:
        yield "Allow more time, or start from what was found: diagnose(d.extended, record)."
    more = "" if d.others else ", or diagnose several records of this machine together"
    yield f"Add the effect that you suspect with effects.register_effect and diagnose again{more}."


def _steps_by_cause(d: Findings) -> Iterator[str]:
    """What to do to separate the causes from their alternatives, and to determine them better."""
    by_force = []
    for cause in d.main_causes:
        if cause.alternatives and d.next_experiment is None:
            pair = f"{cause.title} from {' or '.join(map(titles_of, cause.alternatives))}"
            if GAIN in "+".join((cause.effect, *cause.alternatives)).split("+"):
                by_force.append(pair)
            else:
                yield f"Separate {pair}. {cause.experiment}"
        loose = any(one.startswith(f"{cause.effect}.") for one in d.messages)
        if loose or not all(map(math.isfinite, cause.standard_errors.values())):
            yield f"Determine {cause.title} better. {cause.experiment}"
    if by_force:
        yield f"Separate {', '.join(by_force)}. {_BY_A_FORCE}"


def hidden_text(d: Findings, share: float) -> str:
    """What the force residual leaves out, in words."""
    drive = float(np.sqrt(np.mean(d.record.u**2)))
    extended = d.extended.effective()
    names = [e.title for e in extended.effects if any(e.blind(extended, drive))]
    if not names:
        return ""
    return (
        f"Left out: {percent(share)} of the sliding samples, just after a reversal, "
        f"where {' and '.join(names)} cannot be shown as a force; the free runs show it."
    )


def records_text(d: Findings) -> str:
    """Names of the records that were diagnosed together, the first the one that figures show."""
    names = [one.name for one in (d.record, *d.others) if one.name]
    if not d.others:
        return names[0] if names else ""
    count = 1 + len(d.others)
    return f"{count} records" + (f": {', '.join(names)}" if len(names) == count else "")


def shown_record(d: Findings) -> str:
    """The record that curves and tables of free runs are of; nothing where it is the only one."""
    if not d.others:
        return ""
    of = f"the first of {1 + len(d.others)}"
    return f"record {d.record.name}, {of}" if d.record.name else f"{of} records"


def _base_at_ends(d: Findings, cause: Cause) -> list[tuple[str, float]]:
    """Base parameter that a cause changes, at both ends of the record; empty if it does not."""
    effect = d.extended.named_effects().get(cause.effect)
    if effect is None:
        return []
    ends = (effect.base_at(d.extended, float(d.record.t[k])) for k in (0, -1))
    return [one for one in ends if one is not None]


def course_text(d: Findings, cause: Cause) -> str:
    """How a cause changes a base parameter over the record; empty if it does not."""
    found = _base_at_ends(d, cause)
    if not found:
        return ""
    (name, first), (_, last) = found
    title, unit = _CHANGING[name]
    within = f"within {d.record.t[-1] - d.record.t[0]:.3g} s"
    return f"{title} {first:.3g} -> {last:.3g} {d.axis.unit(unit)} {within}"


def shown_causes(d: Findings) -> list[Cause]:
    """Main causes; a value that changes over the record is one, and not its nominal value too."""
    changing = {name for cause in d.main_causes for name, _ in _base_at_ends(d, cause)}
    return [one for one in d.main_causes if one.effect not in changing]


def line_of(d: Findings, cause: Cause) -> str:
    """Cause, what it does over the record, parameters and alternatives in one line."""
    text = cause_text(cause, d.axis)
    course = course_text(d, cause)
    if not course:
        return text
    title, _, parameters = text.partition(": ")
    return f"{title}: {course} ({parameters})"


def _brief_line_of(d: Findings, cause: Cause) -> str:
    """The same, of an effect of any shape its curve in place of its coefficients."""
    effect = d.extended.named_effects().get(cause.effect)
    if effect is None or not effect.any_shape:
        return line_of(d, cause)
    return f"{cause.title} ({cause.effect}): {effect.meaning(d.axis.units)}"


def summary_lines(d: Findings) -> list[str]:
    """Lines of a diagnosis' summary, as long as they are."""
    of = f" (of {records_text(d)})" if d.others else ""
    lines = [f"verdict: {d.verdict if d.causes else verdict_line(d)}{of}"]
    lines += [f"warning: {one}" for one in far_off(d)]
    for i, cause in enumerate(shown_causes(d), start=1):
        lines.append(f"{i}. {line_of(d, cause)}")
        lines += [f"    {line}" for line in cause_meaning(d, cause)]
    small = d.small_corrections
    if small:
        lines.append(f"small corrections of nominal values ({100.0 * SMALL:g} % or less):")
    lines += [f"    {cause_text(cause, d.axis)}" for cause in small]
    lines.append(f"{gain_title(d)}: {gain_text(d)}")
    if d.unexplained.significant:
        lines.append("unexplained: " + places_text(d))
    lines.append(f"check on the machine: {check_text(d)}")
    lines += further_lines(d)
    lines += [f"warning: {message}" for message in d.messages]
    if d.next_experiment is not None:
        lines.append(f"next experiment: {d.next_experiment.summary()}")
    return [rotary_words(line, d.axis.units[1]) for line in lines]


def brief_lines(d: Findings) -> list[str]:
    """Verdict, causes with amounts, error before and after, and what to check: eight lines."""
    of = f" (of {records_text(d)})" if d.others else ""
    lines = [f"verdict: {d.verdict if d.causes else verdict_line(d)}{of}"]
    lines += [f"warning: {one}" for one in far_off(d)][:_BRIEF_WARNINGS]
    varied = [_variation_text(d, name, found) for name, found in d.varies.items()]
    lines += varied[:1]
    shown = shown_causes(d)
    room = _BRIEF_CAUSES - len(varied[:1])
    lines += [f"{i}. {_brief_line_of(d, one)}" for i, one in enumerate(shown[:room], start=1)]
    more = [
        *(short_cause_text(one, d.axis) for one in (*shown[room:], *d.small_corrections)),
        *(f"{_own_name(name)} by record" for name in [*d.varies][1:]),
    ]
    if more:
        lines.append(f"and {len(more)} more: {', '.join(more)}")
    lines.append(f"{gain_title(d)}: {gain_text(d)}")
    if d.is_muted:
        lines.append(d.random_force)
    if d.messages:
        count = len(d.messages)
        lines.append(f"{count} warning{'s' if count > 1 else ''}: see print(d.details())")
    return [rotary_words(line, d.axis.units[1]) for line in lines]


def far_off(d: Findings) -> list[str]:
    """Nominal values of the base that have moved more than twofold, in words."""
    found = []
    pairs = zip(BASE, values_of(d.axis, BASE), values_of(d.extended, BASE), strict=True)
    for name, before, after in pairs:
        if before > 0.0 and not 1.0 / _FAR_OFF < after / before < _FAR_OFF:
            factor = f"{after / before:.2g} times" if after > 0.0 else "zero instead of"
            found.append(f"{name} is {factor} its nominal value {before:.4g}")
    return found


def further_lines(d: Findings) -> list[str]:
    """What is left, what the answer was compared with, and what varies, a line each."""
    lines = []
    if d.remaining.rms > 0.0:
        lines.append(d.random_force if d.is_muted else d.remaining.headline)
    if d.references:
        head = "gain of log-likelihood over references (positive: better than the reference)"
        gains = ", ".join(f"{name} {gain:+z.0f}" for name, gain in d.references.items())
        lines.append(f"{head}: {gains}")
    if moved := _further_changes(d):
        head = "also changed in the extended model, by less than the remaining force shows"
        changes = ", ".join(f"{name} {100.0 * part:+.2g} %" for name, part in moved.items())
        lines.append(f"{head}: {changes}")
    lines += [_variation_text(d, name, found) for name, found in d.varies.items()]
    return lines


def _further_changes(d: Findings) -> dict[str, float]:
    """Relative changes of base parameters that no cause names, those that are reported."""
    named = {name for cause in d.causes for name in cause.parameters} | set(d.varies)
    names = [name for name in BASE if name not in named]
    pairs = zip(names, values_of(d.axis, names), values_of(d.extended, names), strict=True)
    changes = {name: after / before - 1.0 for name, before, after in pairs if before > 0.0}
    return {name: part for name, part in changes.items() if abs(part) > _MOVED}


def _own_name(name: str) -> str:
    """A parameter in words: of an effect that with the effect's title."""
    owner, _, part = name.rpartition(".")
    return f"{title_of(owner)} ({part})" if owner else name


def _variation_text(d: Findings, name: str, found: Mapping[str, Any]) -> str:
    """How a parameter differs from record to record, in one line."""
    values = ", ".join(map(with_error, found["values"], found["standard_errors"]))
    least = min(found["values"], key=abs)
    most = max(found["values"], key=abs)
    ratio = f" (largest: {most / least:.3g} of the smallest)" if least * most > 0.0 else ""
    owner, _, part = name.rpartition(".")
    effect = class_of(owner)
    units = d.axis.units
    unit = d.axis.unit(base_unit(name)) if effect is None else effect.units(units)[part]
    return f"differs from record to record: {_own_name(name)} = {values} {unit}{ratio}"


def cause_names(d: Findings) -> str:
    """Names of all causes, in words of the axis."""
    names = ", ".join(cause.title or cause.effect for cause in d.causes)
    return rotary_words(names, d.axis.units[1])


def verdict_line(d: Findings, most: int | None = None) -> str:
    """Verdict with the names of at most so many causes, the rest counted, in one line."""
    names = [cause.title or cause.effect for cause in d.main_causes]
    if not names:
        what = ": small corrections of nominal values" if d.causes else ""
        what = ": values that differ from record to record" if d.varies and not what else what
        return f"{d.verdict}{what}"
    shown = ", ".join(names[:most])
    if most is not None and len(names) > most:
        shown += f" and {len(names) - most} more"
    return f"{d.verdict}: {shown}"
