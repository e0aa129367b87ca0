"""Friction of an axis in the words of a simulator, and what those words cannot say."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy.optimize
from numpy.typing import ArrayLike

from dryfric_control.arrays import Floats
from dryfric_control.checks import describe_value, positive, samples, string
from dryfric_control.diagnosis import Diagnosis
from dryfric_control.diagnosis.report.findings import with_error
from dryfric_control.estimation.force_residual import Sliding, at_the_mass
from dryfric_control.estimation.parameters import SHIFT, values_of, with_values
from dryfric_control.identification import Fit, replay
from dryfric_control.model.axis import FrictionAxis, without_effects
from dryfric_control.model.effects.effect import Effect
from dryfric_control.model.effects.naming import titles_of
from dryfric_control.model.friction import CoulombMap
from dryfric_control.model.friction_curve import net_force, usual_speed
from dryfric_control.records.record import Record
from dryfric_control.text import Result, documented, length_text, percent, stated
from dryfric_control.units import powers

# Sliding samples that are sufficient.
_SAMPLES = 5000
# Number of velocities in place of those of a record.
_VELOCITIES = 101
# Number of positions in place of those of a record.
_PLACES = 9
# Part of a number below which what a record leaves open does not change it.
_SAID = 1e-6
# Part of the friction below which the error of a feature is none.
_STATED = 1e-4
# Ratio of the errors of friction above which a richer format is not worth its parameters.
_NEAR = 0.9
# Change of a parameter for the propagation of its standard error, as a part of that error.
_STEP = 1e-2
# Causes that scale all forces together or one by one.
_SCALES = {"inertia", "viscous", "coulomb", "input_gain"}
# Where the drive hardly ever brakes, friction by load is the same as a weaker drive.
_LOAD = "load_dependence"
_USABLE = ("explained", "nothing to find")
#: Where a simulator keeps what is no friction of a joint.
_ELSEWHERE = {
    "input": "the actuator of the simulator",
    "delay": "the actuator of the simulator",
    "lag": "the actuator of the simulator",
    "reading": "the sensor of the simulator",
    "gravity": "weight of the bodies",
    "end_stop": "range of the joint",
}


_Systems = Sequence[tuple[str, str]]  # units of position and force


def _linear_axis(axis: FrictionAxis, c: Floats, shape: Any) -> FrictionAxis:
    """An axis of a level and a viscous coefficient."""
    return axis.replace(coulomb=float(c[0]), viscous=float(c[1]), stribeck=None, effects=())


class Format(NamedTuple):
    """How a simulator states the friction of a joint."""

    values: Callable[[Floats, Any, float, FrictionAxis], dict[str, Any]]
    """Of coefficients, shape, breakaway friction force and axis."""
    breakaway: bool = False  # whether it states the breakaway friction force on its own
    armature: str = ""  # name of the inertia beyond that of the bodies
    #: Of v and a shape, friction for each coefficient of 1: by default a level and a viscous one.
    columns: Callable[[Floats, Any], Floats] = lambda v, shape: np.column_stack((np.sign(v), v))
    #: Shapes to choose from, of the speeds and the axis.
    shapes: Callable[[Floats, FrictionAxis], Iterable[Any]] = lambda speed, axis: (None,)
    #: The axis as far as the format states it, of axis, coefficients and shape, where it can.
    reduced: Callable[[FrictionAxis, Floats, Any], FrictionAxis] | None = None
    #: Effects that are no part of the columns and stated nevertheless.
    stated: frozenset[str] = frozenset()


#: A format, or several of which a joint takes the simplest that is as good as any.
Formats = Format | Callable[[FrictionAxis], Sequence[Format]]


class Loss(NamedTuple):
    """What a format cannot say of a joint."""

    joint: str
    what: str  # the effect or property with its numbers
    instead: str  # what takes its place
    error: float  # RMS over the record; NaN where no record shows it
    unit: str  # of force, or of position where the effect is no force


@documented
@dataclass(frozen=True, repr=False)
class SimulatorValues(Result):
    """Values of joints for a simulator, and what it cannot say.

    Made by `to_mjcf`, `to_urdf`, `to_isaac`, `to_modelica` and `to_simscape`.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=0.3, viscous=0.2, coulomb=1.5, units=("rad", "N m"))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "friction.py")
    ...     written = dfc.simulators.to_isaac({"elbow": axis}, file, load=0.1)
    >>> round(written.values["elbow"]["armature"], 9), written.lost
    (0.2, ())
    """

    values: dict[str, dict[str, Any]] = stated("Numbers by joint and name, as the format has them.")
    standard_errors: dict[str, dict[str, float]] = stated("Infinite where a record does not tell.")
    lost: tuple[Loss, ...] = stated("What the format cannot say, and what takes its place.")
    friction_error: dict[str, float] = stated("RMS error of the friction while sliding.")
    free_runs: dict[str, tuple[float, float]] = stated(
        "RMS errors of the axis, and of MuJoCo (`to_mjcf`, where it is installed) or of `reduced`."
    )
    reduced: dict[str, FrictionAxis] = stated("The axes as far as the format states them.")
    messages: tuple[str, ...] = stated("Why the values are not certain.")
    files: tuple[Path, ...] = stated("Files that were written.")
    notes: tuple[str, ...] = stated("What other programs make of the file.", ())
    _told = (*"values standard_errors lost friction_error free_runs messages files notes".split(),)

    def _summary_parts(self) -> Iterator[str | list[tuple[str, ...]]]:
        names = list(dict.fromkeys(n for values in self.values.values() for n in values))
        rows: list[tuple[str, ...]] = [("joint", *names, "error of friction", "free runs")]
        for joint, values in self.values.items():
            errors = self.standard_errors[joint]
            axis = self.reduced[joint]
            runs = [length_text(one, axis.units[0]) for one in self.free_runs.get(joint, ())]
            numbers = [_number(values.get(n, ""), errors.get(n)) for n in names]
            off = _error_text(self.friction_error[joint], axis.units[1])
            rows.append((joint, *numbers, off, " -> ".join(runs) or "no record"))
        yield rows
        if self.lost:
            lost = [(*one[:3], _error_text(one.error, one.unit)) for one in self.lost]
            yield "not stated by the format:"
            yield [("joint", "what", "in its place", "RMS error"), *lost]
        yield from (f"warning: {message}" for message in self.messages)
        yield from (f"note: {note}" for note in self.notes)
        if self.files:
            yield f"written: {', '.join(path.name for path in self.files)}"


def _number(value: Any, error: float | None) -> str:
    if isinstance(value, float):
        return with_error(value, error)
    return value if isinstance(value, str) else f"{len(value)} rows"


def _error_text(error: float, unit: str) -> str:
    if math.isnan(error):
        return "not known"
    if error < 1e-12:  # round-off
        return f"0 {unit}"
    return length_text(error, unit) if unit in ("m", "rad") else f"{error:.2g} {unit}"


class Joint(NamedTuple):
    """A joint with what is known of it."""

    axis: FrictionAxis
    records: tuple[Record, ...] = ()
    #: Names of fitted parameters and the covariance of their estimates.
    names: tuple[str, ...] = ()
    covariance: Floats = np.empty((0, 0))
    shift: float = 0.0
    #: What may be otherwise.
    doubts: tuple[str, ...] = ()


def joints_of(
    result: Any, joint: str | None, there: Mapping[str, _Systems], usual: _Systems = (),
    what: str = "joint",
) -> dict[str, Joint]:  # fmt: skip
    """Joints of a result by name, in units that each in the file, or any, may have."""
    if isinstance(result, Mapping):
        if joint is not None:
            raise ValueError(
                f"joint = {joint!r} is for a single result: a mapping names its joints itself"
            )
        if not result:
            raise ValueError("result is an empty mapping: give results by the name of their joint")
        named = dict(result)
    else:
        made = _joint("result", result)
        if joint is not None:
            string("joint", joint)
        else:
            joint = next(iter(there)) if len(there) == 1 else made.axis.name
        named = {joint: result}
    for name in named:
        try:
            string("joint", name).encode()
        except UnicodeEncodeError:
            raise ValueError(f"joint {name!r} is no text that a file can hold: rename it") from None
        if there and name not in there:
            raise ValueError(
                f"joint {name!r} is not in the file: it has {', '.join(map(repr, there))}; give "
                "joint=... or a mapping of such names to results"
            )
    found = {name: _joint(f"result[{name!r}]", one) for name, one in named.items()}
    for name, one in found.items():
        right = there.get(name, usual)
        if right and one.axis.units not in right:
            raise ValueError(
                f"{what} {name!r} is in {' or '.join(map(str, right))}, and the axis has units = "
                f"{one.axis.units}: convert the record as it is read, see dfc.Scaling"
            )
    return found


def _joint(name: str, result: Any) -> Joint:
    if isinstance(result, FrictionAxis):
        return Joint(result.effective())
    if isinstance(result, Fit):
        return _fit_joint(result)
    if isinstance(result, Diagnosis):
        return _diagnosis_joint(result)
    raise ValueError(
        f"{name} must be a Fit, a Diagnosis or a FrictionAxis, or a mapping of joints to such, got "
        f"{describe_value(result)}"
    )


def _fit_joint(result: Fit) -> Joint:
    """Joint of a fit, with its covariance."""
    names = [n for n in result.parameters if n != SHIFT]
    at = [list(result.parameters).index(n) for n in names]
    errors = np.array([result.standard_errors[n] for n in names])
    correlation = result.correlation[np.ix_(at, at)]
    with np.errstate(invalid="ignore"):
        covariance = np.where(correlation == 0.0, 0.0, correlation * np.outer(errors, errors))
    records = tuple(run.windows.record for run in result.training)
    shift = result.parameters.get(SHIFT, 0.0)
    return Joint(result.axis.effective(), records, tuple(names), covariance, shift)


def _diagnosis_joint(result: Diagnosis) -> Joint:
    """Joint of a diagnosis, with its standard errors."""
    known = {n: e for n, e in result.standard_errors.items() if n != SHIFT}
    return Joint(
        result.extended.effective(),
        (result.record, *result.others),
        tuple(known),
        np.diag(np.square([*known.values()])),
        doubts=tuple(_diagnosis_doubts(result)),
    )


def _diagnosis_doubts(result: Diagnosis) -> Iterator[str]:
    """What of a diagnosis is not certain enough to be written to a model."""
    if result.verdict not in _USABLE:
        yield f"the verdict of the diagnosis is {result.verdict!r}: read d.unexplained"
    for cause in result.causes:
        # A gain or all base parameters: under the recorded drive they are the same.
        more = ["input_gain"] if cause.effect == _LOAD else []
        others = [
            one for one in dict.fromkeys([*cause.alternatives, *more])
            if not {cause.effect, *one.split("+")} <= _SCALES
        ]  # fmt: skip
        if others:
            words = " or ".join([cause.title, *map(titles_of, others)])
            yield f"{words}: the record does not separate them, and the values differ"


def checked_loads(
    load: Any,
    result: Any,
    joints: Mapping[str, Joint],
    computed: Callable[[], dict[str, float]] = dict,
    mend: str = "give load=...",
) -> dict[str, float]:
    """Inertia that the bodies bring, by joint: as given, as a result knows it, or as computed."""
    loads = _given_loads(load, result, joints)
    missing = [name for name in joints if name not in loads]
    for name in missing:
        if any("load" in record.channels for record in joints[name].records):
            raise ValueError(
                f"load of joint {name!r} is not given: beside the known load of its record the "
                "axis has the mean inertia over the motion, which is not that of one pose: give "
                "load=records.body_inertia of the ArmRecords that were fitted, or numbers of your "
                "own"
            )
    if missing:
        loads = computed() | loads
    for name in missing:
        if name not in loads:
            raise ValueError(
                f"load of joint {name!r} is not given, the inertia that the bodies of the model "
                f"have about it: {mend} (0.0 where mass is the armature alone)"
            )
    return loads


def _given_loads(load: Any, result: Any, joints: Mapping[str, Joint]) -> dict[str, float]:
    """Inertia of bodies by joint as a caller gives it, or else as a result knows it."""
    known = getattr(result, "body_inertia", None)
    if load is None:
        return {} if known is None else {name: known[name] for name in joints}
    if not isinstance(load, Mapping):
        return dict.fromkeys(joints, positive("load", load, unit="kg m^2", zero=True))
    for name in load:
        if name not in joints:
            raise ValueError(
                f"load names joint {name!r}: it must be one of {', '.join(map(repr, joints))}"
            )
    return {n: positive(f"load[{n!r}]", one, zero=True) for n, one in load.items()}


def _check_velocities(velocities: ArrayLike | None) -> Floats | None:
    """Velocities at which friction is fitted, as an array; None where the motion says them."""
    if velocities is None:
        return None
    given = samples("velocities", velocities)
    if not np.any(given):
        raise ValueError(
            f"velocities must hold velocities of sliding, got {describe_value(velocities)}"
        )
    return given


def describe_joints(
    formats: Formats,
    joints: Mapping[str, Joint],
    velocities: ArrayLike | None,
    loads: Mapping[str, float] | None = None,
) -> SimulatorValues:
    """Numbers of each joint in a format; `loads` are the inertias that its bodies bring."""
    given = _check_velocities(velocities)
    messages = tuple(f"{name}: {one}" for name, joint in joints.items() for one in joint.doubts)
    made = SimulatorValues({}, {}, (), {}, {}, {}, messages, ())
    lost: list[Loss] = []
    for name, joint in joints.items():
        recorded, gain = refer_to_input(joint.axis)
        load = (loads or {}).get(name, 0.0)
        states = _States.from_joint(joint, recorded, given)
        form = _choose_format(formats, recorded, states)
        numbers = functools.partial(_numbers, form, load, states)
        made.values[name] = numbers(joint.axis)
        made.standard_errors[name] = _errors(joint, made.values[name], numbers)
        straight = form if form.reduced else _STRAIGHT
        reduced = (form.reduced or _linear_axis)(recorded, *_fit_format(straight, recorded, states))
        made.reduced[name] = reduced.replace(name=name)
        made.friction_error[name], found = _format_losses(
            form, name, recorded, states, joint.records
        )
        lost += found
        if gain != 1.0:
            words = "the drive is the recorded one: all values are divided by the gain"
            lost.append(Loss(name, f"input_gain: gain = {gain:.4g}", words, 0.0, recorded.units[1]))
        if form.armature and recorded.mass < load:
            unit = recorded.unit("kg")
            words = f"inertia {recorded.mass:.4g} "
            instead = f"the bodies have {load:.4g} {unit} already"
            lost.append(Loss(name, words + unit, instead, load - recorded.mass, unit))
        if joint.records:
            whole, less = (
                [replay(a, r, shift=joint.shift).errors for r in joint.records]
                for a in (joint.axis, made.reduced[name])
            )
            made.free_runs[name] = _rms(np.concatenate(whole)), _rms(np.concatenate(less))
    return replace(made, lost=tuple(lost))


def _choose_format(formats: Formats, axis: FrictionAxis, states: _States) -> Format:
    """The format, or of several the first whose friction is nearly as good as that of the best."""
    if isinstance(formats, Format):
        return formats
    forms = formats(axis)
    friction = _friction(axis, states)
    errors = []
    for form in forms:
        coefficients, shape = _fit_format(form, axis, states)
        errors.append(_rms(friction - form.columns(states.v, shape) @ coefficients))
    most = max(min(errors) / _NEAR, _STATED * _rms(friction))
    return next(form for form, error in zip(forms, errors, strict=True) if error <= most)


def _numbers(form: Format, load: float, states: _States, axis: FrictionAxis) -> dict[str, Any]:
    """Numbers of an axis in a format by name."""
    axis, _ = refer_to_input(axis)
    found = form.values(*_fit_format(form, axis, states), _breakaway(axis, states), axis)
    return found | ({form.armature: max(axis.mass - load, 0.0)} if form.armature else {})


def refer_to_input(axis: FrictionAxis) -> tuple[FrictionAxis, float]:
    """The axis with all forces over the input gain, which move it alike, and that gain."""
    gains = [e for e in axis.effects if e.slug == "input_gain"]
    gain = math.prod(e.values[0] for e in gains)
    if not gains or gain <= 0.0:
        return axis, 1.0
    effects = []
    for one in (e for e in axis.effects if e not in gains):
        parameters = one.parameters().items()
        values = {n: getattr(one, n) / gain ** powers(p["unit"])[0] for n, p in parameters}
        effects.append(type(one)(**values))
    scaled = axis.replace(
        mass=axis.mass / gain, viscous=axis.viscous / gain,
        coulomb=axis.coulomb.scaled(1.0 / gain), effects=tuple(effects),
    )  # fmt: skip
    return scaled, gain


_STRAIGHT = Format(lambda c, *_: {})


class _States(NamedTuple):
    """States in which friction is compared."""

    t: Floats
    x: Floats
    v: Floats
    u: Floats

    @classmethod
    def from_joint(cls, joint: Joint, axis: FrictionAxis, velocities: Floats | None) -> _States:
        """Sliding samples of the records; without one, velocities at places of the travel."""
        if velocities is None and joint.records:
            parts = []
            for record in joint.records:
                bare, behind = at_the_mass(axis, record)
                one = Sliding(behind, _SAMPLES // len(joint.records))
                fast = np.abs(one.v) > bare.stick_speed
                parts.append([a[fast] for a in (one.t, one.x, one.v, one.u)])
            if all(part[0].size == 0 for part in parts):
                raise ValueError("the record has no sliding samples: give velocities=...")
            return cls(*map(np.concatenate, zip(*parts, strict=True)))
        if velocities is None:
            speed = usual_speed(axis) * np.arange(1, _VELOCITIES) / (_VELOCITIES - 1)
            velocities = np.concatenate((-speed[::-1], speed))
        low, high = axis.travel or (0.0, 0.0)
        places = np.linspace(low, high, _PLACES if high > low else 1)
        v, x = (a.ravel() for a in np.meshgrid(velocities[velocities != 0.0], places))
        return cls(np.zeros_like(v), x, v, np.zeros_like(v))


def _resistance(axis: FrictionAxis, states: _States) -> Floats:
    """Force against the motion of a rigid axis, less the drive, shape (n,)."""
    return np.asarray(states.u - net_force(without_effects(axis), *states, np.sign(states.v)))


def _is_friction(effect: Effect) -> bool:
    """Whether an effect is friction of the joint; a stop is one of the simulator's own."""
    if effect.slug in _ELSEWHERE:
        return False
    return effect.action == "friction" or (effect.action == "force" and effect.depends_on_speed)


def _friction(axis: FrictionAxis, states: _States) -> Floats:
    """Friction force with the load that acts, shape (n,)."""
    rest = tuple(e for e in axis.effects if not _is_friction(e))
    without = axis.replace(coulomb=0.0, viscous=0.0, stribeck=None, effects=rest)
    return _resistance(axis, states) - _resistance(without, states)


def _breakaway(axis: FrictionAxis, states: _States) -> float:
    """Mean breakaway friction force over both directions and the places of the record."""
    return float(np.mean([np.mean(axis.breakaway(states.x, s)) for s in (1, -1)]))


def _fit_format(form: Format, axis: FrictionAxis, states: _States) -> tuple[Floats, Any]:
    """Coefficients of a format, none negative, and its shape, by least squares."""
    friction = _friction(axis, states)
    # Scaled columns: a viscous coefficient may be a million times the level.
    found = []
    for shape in form.shapes(np.abs(states.v), axis):
        columns = form.columns(states.v, shape)
        size = np.maximum(np.abs(columns).max(axis=0), 1e-300)
        c, misfit = scipy.optimize.nnls(columns / size, friction)
        found.append((misfit, c / size, shape))
    _, coefficients, shape = min(found, key=lambda one: one[0])
    return coefficients, shape


def _errors(
    joint: Joint, values: Mapping[str, Any], numbers: Callable[[FrictionAxis], dict[str, Any]]
) -> dict[str, float]:
    """Standard errors of the numbers of a format, from those of the parameters."""
    single = [n for n, value in values.items() if isinstance(value, float)]
    if not joint.names:
        return {}
    slopes = np.zeros((len(single), len(joint.names)))
    at = values_of(joint.axis, joint.names)
    deviation = np.sqrt(np.diag(joint.covariance))
    for i, value in enumerate(at):
        step = _STEP * deviation[i] if math.isfinite(deviation[i]) else _STEP * abs(value)
        ends = []
        for side in (-1.0, 1.0):
            moved = at.copy()
            moved[i] = value + side * step
            try:
                ends.append((moved[i], numbers(with_values(joint.axis, joint.names, moved))))
            except ValueError:  # beyond a bound of the parameter
                ends.append((value, dict(values)))
        (a, low), (b, high) = ends
        if b > a:
            slopes[:, i] = [(high[n] - low[n]) / (b - a) for n in single]
    known = np.isfinite(deviation)
    covariance = joint.covariance[np.ix_(known, known)]
    part = slopes[:, known]
    error = np.sqrt(np.einsum("ij,jk,ik->i", part, covariance, part))
    # What no record determines determines nothing.
    unsure = np.abs(slopes[:, ~known]) @ np.maximum(np.abs(at[~known]), 1e-300)
    scale = np.array([abs(values[n]) for n in single])
    return {
        n: math.inf if unsure[i] > _SAID * scale[i] else float(error[i])
        for i, n in enumerate(single)
    }


def _features(axis: FrictionAxis, places: Floats) -> Iterator[tuple[str, Any, FrictionAxis]]:
    """What an axis has beyond a level and a viscous coefficient, and the axis without it."""
    if axis.stribeck is not None and axis.stribeck.excess > 0.0:
        speed = f"{axis.stribeck.speed:.3g} {axis.unit('m/s')}"
        words = f"stribeck: excess = {percent(axis.stribeck.excess)}, speed = {speed}"
        yield words, None, axis.replace(stribeck=None)
    levels = [float(np.mean(axis.coulomb(places, s))) for s in (1, -1)]
    if not axis.coulomb.constant:
        constant = axis.replace(coulomb=CoulombMap.of(tuple(levels)))
        yield "Coulomb level over position", None, constant
    if not math.isclose(*levels, rel_tol=1e-9):
        words = f"Coulomb level {levels[0]:.4g} forwards, {levels[1]:.4g} {axis.units[1]} backwards"
        factors = [float(np.mean(levels)) / max(level, 1e-300) for level in levels]
        yield words, None, axis.replace(coulomb=axis.coulomb.scaled(*factors))
    for effect in axis.effects:
        others = tuple(e for e in axis.effects if e is not effect)
        yield effect.describe(axis.units), effect, axis.replace(effects=others)


def _format_losses(
    form: Format, joint: str, axis: FrictionAxis, states: _States, records: tuple[Record, ...]
) -> tuple[float, list[Loss]]:
    """RMS error of the friction, and everything that a format cannot say."""
    coefficients, shape = _fit_format(form, axis, states)
    columns = form.columns(states.v, shape)
    friction, (length, force) = _friction(axis, states), axis.units
    off = _rms(friction - columns @ coefficients)
    size = _rms(friction)
    found = []
    for what, effect, without in _features(axis, states.x):
        if effect is not None and effect.slug in form.stated:
            continue
        if effect is None or _is_friction(effect):
            part = friction - _friction(without, states)
            # What columns of the format do as well is no loss.
            left = part - columns @ np.linalg.lstsq(columns, part, rcond=None)[0]
            if _rms(left) > _STATED * size or not np.any(part):
                found.append(Loss(joint, what, "least squares", _rms(left), force))
            continue
        instead = _ELSEWHERE.get(effect.slug, _ELSEWHERE.get(effect.action, "none"))
        part = _resistance(axis, states) - _resistance(without, states)
        if effect.action in ("force", "input") and np.any(part):
            found.append(Loss(joint, what, instead, _rms(part), force))
        else:
            moved = [replay(axis, r).positions - replay(without, r).positions for r in records]
            error = _rms(np.concatenate(moved)) if moved else math.nan
            found.append(Loss(joint, what, instead, error, length))
    holds = float(np.abs(form.columns(np.full(1, 1e-9), shape) @ coefficients)[0])
    needed = _breakaway(axis, states)
    if not form.breakaway and abs(holds - needed) > 0.01 * needed:
        words = f"breakaway friction force {needed:.4g} {force}"
        found.append(Loss(joint, words, f"{holds:.4g} {force}", abs(holds - needed), force))
    return off, found


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else 0.0
