"""Which parameters a record does not determine, and why."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from dryfric_control.arrays import Bools, Floats
from dryfric_control.estimation.parameters import Parameter
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects.naming import class_of
from dryfric_control.records.motion import directions, is_undriven, usual_speeds
from dryfric_control.records.record import Record
from dryfric_control.text import page_reference, percent
from dryfric_control.ties import samples

# A standard error beyond this part of the value leaves the value open.
_OPEN = 0.3
# Correlation of two estimates beyond which only a combination is known.
_TOGETHER = 0.98
# Standard error, as a part of the value, from which such an estimate is reported.
_NOTICED = 0.02
# Most pairs named in full.
_PAIRS = 3


# Periods from position 0 to the record up to which phase and period are found beside each other:
# 50 change nothing, at 600 the standard errors are wrong.
_FAR = 100.0


def far_from_zero_messages(axis: FrictionAxis, records: Sequence[Record]) -> list[str]:
    """What to say of forces that are periodic in position, with a phase far from it."""
    found = []
    for effect in axis.effects:
        period = getattr(effect, "period", None)
        if period is None or not hasattr(effect, "phase"):
            continue
        middle = min((float(np.median(r.x)) for r in records), key=abs)
        away = abs(middle) / period
        if away > _FAR:
            length = axis.units[0]
            found.append(
                f"{effect.slug}: the record runs {away:.3g} periods from x = 0, where its phase "
                "is: phase and period hardly separate, and their errors are not to be trusted. "
                f"Count x from near the motion: record.replace(x=record.x - {middle:.3g}) "
                f"[{length}], and the places of the axis with it"
            )
    return found


def cannot_tell(
    axis: FrictionAxis,
    records: Sequence[Record],
    parameters: Sequence[Parameter],
    values: Floats,
    errors: Floats,
    correlation: Floats,
    away: Floats,
    slopes: Floats,
) -> list[str]:
    """Messages on what the records leave open, each with its cause.

    `away`: directions without effect, as rows, in search coordinates; `slopes`: of the values.
    """
    named: set[str] = set()
    return [
        *_no_effect_messages(axis, records, parameters, away, slopes, named),
        *_uncertainty_messages(axis, records, parameters, values, errors, named),
        *_correlation_messages(parameters, errors > _NOTICED * np.abs(values), correlation, named),
    ]


def _no_effect_messages(
    axis: FrictionAxis, records: Sequence[Record], parameters: Sequence[Parameter], away: Floats,
    slopes: Floats, named: set[str],
) -> Iterator[str]:  # fmt: skip
    """Messages on parameters and combinations that change nothing; adds them to `named`."""
    names = [p.name for p in parameters]
    for row in away:
        parts = [(n, c * s) for n, c, s in zip(names, row, slopes, strict=True) if abs(c) > 1e-3]
        *most, last = together = [n for n, _ in parts]
        named.update(together)
        if not most:
            why = _low_sensitivity_reason(axis, records, parameters[names.index(last)])
            yield f"the data are uninformative about {last}: {why}"
            continue
        change = ", ".join(f"{n} by {c / parts[0][1]:+.3g}" for n, c in parts)
        yield (
            f"{', '.join(most)} and {last} cannot be separated: changing {change} gives the "
            f"same motion. The values given are those nearest to the nominal ones; hold one of "
            f"them{_reason({*together})}"
        )


def _uncertainty_messages(
    axis: FrictionAxis, records: Sequence[Record], parameters: Sequence[Parameter],
    values: Floats, errors: Floats, named: set[str],
) -> Iterator[str]:  # fmt: skip
    """Messages on single parameters of large standard error; adds them to `named`."""
    for i, p in enumerate(parameters):
        size = abs(values[i])
        if p.name in named or p.kind in ("place", "angle"):
            continue
        if values[i] == p.low and p.low == 0.0:
            # At its bound the estimate has no spread to speak of.
            yield f"{p.name} ended at its lowest value: the record shows none of it"
            named.add(p.name)
        elif (p.logarithmic or p.low == 0.0) and errors[i] > _OPEN * size:
            share = errors[i] / size
            much = f"{percent(share)} of" if share < 10.0 else "more than ten times"
            yield (
                f"{p.name} is hardly determined (standard error {much} its value): "
                f"{_low_sensitivity_reason(axis, records, p)}" + page_reference("troubleshooting")
            )
            named.add(p.name)


def _correlation_messages(
    parameters: Sequence[Parameter], loose: Bools, correlation: Floats, named: set[str]
) -> Iterator[str]:
    """Messages on pairs of which only a combination is known."""
    names = [p.name for p in parameters]
    # Coefficients of a polynomial always trade; its value is what counts.
    polynomial = {n for n in names if "[" in n}
    pairs = [
        (i, j)
        for i, j in zip(*np.tril_indices(len(names), -1), strict=True)
        if abs(correlation[i, j]) > _TOGETHER
        and (loose[i] or loose[j])
        and not ({names[i], names[j]} & named or {names[i], names[j]} <= polynomial)
    ]
    pairs.sort(key=lambda pair: -abs(correlation[pair]))
    for pair in pairs[:_PAIRS]:
        other, one = (names[k] for k in pair)
        sign = "sum" if correlation[pair] < 0.0 else "difference"
        yield (
            f"{one} and {other} trade against each other (correlation {correlation[pair]:+.3f}): "
            f"the record fixes their weighted {sign} far better than either{_reason({one, other})}"
        )
    if len(pairs) > _PAIRS:
        yield f"{len(pairs) - _PAIRS} more pairs trade like these, see .correlation"


def _reason(names: set[str]) -> str:
    """What separates two parameters that trade, from the class of an effect among them."""
    for name in sorted(names):
        effect = class_of(name.partition(".")[0])
        if effect is not None and effect.trades[0]:
            base, advice = effect.trades
            if any(other.startswith(base) for other in names - {name}):
                return f"; {advice}"
    return ""


def _low_sensitivity_reason(
    axis: FrictionAxis, records: Sequence[Record], parameter: Parameter
) -> str:
    """Why a parameter has little effect in the records."""
    axis = axis.effective()
    name = parameter.name
    if all(map(is_undriven, records)) and name.startswith(("mass", "viscous", "coulomb")):
        return 'no drive acts, so forces show only as ratios to the mass: hold it, known=("mass",)'
    if name == "mass":
        return _low_acceleration(axis, records)
    if name == "viscous":
        return _narrow_speeds(axis, records)
    if name.startswith("coulomb"):
        return _large_drive(name, records)
    if parameter.breaks_away or name == "stick_rate":
        return _little_creep(axis, records)
    return "the motion excites it too little"


def _drive_rms(records: Sequence[Record]) -> np.float64:
    """RMS of the drive force in all records, by which numpy may divide where it is zero."""
    return np.sqrt(np.mean(np.concatenate([r.u for r in records]) ** 2))


def _speeds(records: Sequence[Record]) -> tuple[Floats, Floats]:
    """Velocities in all records, and their directions, 0 at rest."""
    speeds = np.concatenate([r.derivatives().v for r in records])
    return speeds, np.concatenate([directions(r) for r in records])


def _low_acceleration(axis: FrictionAxis, records: Sequence[Record]) -> str:
    """Why the mass has little effect."""
    # A longer smoothing: here the noise of the acceleration would count as motion.
    sizes = [max(r.smoothing_window, samples(0.05, r.dt) // 2 * 2 + 1) for r in records]
    pairs = zip(records, sizes, strict=True)
    long = [r.derivatives(min(size, 501, (len(r) - 1) | 1)).a for r, size in pairs]
    share = axis.mass * np.sqrt(np.mean(np.concatenate(long) ** 2)) / _drive_rms(records)
    return (
        f"the axis hardly accelerates, m a is {percent(share)} of the drive force; "
        "excite it with quick reversals"
    )


def _narrow_speeds(axis: FrictionAxis, records: Sequence[Record]) -> str:
    """Why the viscous coefficient has little effect."""
    speeds, way = _speeds(records)
    slow, fast = usual_speeds(speeds[way != 0])
    share = axis.viscous * (fast - slow) / _drive_rms(records)
    return (
        f"90 % of the motion is at {slow:.3g} to {fast:.3g} {axis.unit('m/s')}, over which f v "
        f"changes by {percent(share)} of the drive force; run "
        "at several velocities, up to the fastest"
    )


def _large_drive(name: str, records: Sequence[Record]) -> str:
    """Why a Coulomb level has little effect."""
    for side, s in (("plus", 1), ("minus", -1)):
        moved = sum(float(np.mean(directions(r) == s)) for r in records) / len(records)
        if side in name and moved < 0.01:
            return f"the axis moves in this direction in {percent(moved)} of the samples"
    return "the drive force is large against it; crawl slowly both ways"


def _little_creep(axis: FrictionAxis, records: Sequence[Record]) -> str:
    """Why a parameter of breakaway has little effect."""
    speeds, way = _speeds(records)
    slow = axis.stick_speed + (axis.stribeck.speed if axis.stribeck else 0.0)
    share = float(np.mean((way != 0) & (np.abs(speeds) < slow)))
    return (
        f"the axis slides below {slow:.3g} {axis.unit('m/s')} in {percent(share)} of the "
        "samples; crawl slowly, with stops"
    )
