"""Bad input, one table for every public name.

A row is a public name, the argument to spoil, what to put there, and a word of the mend.  The
error must name the argument (or what the row says in its place), show the value where it is one
number or word, say the mend, and come before any work is done.  Suspicious input that can be
used is in a table of its own: it brings a warning that says the same.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import inspect
import itertools
import json
import math
import re
import warnings
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import joblib
import numpy as np
import pytest
from scipy.io import savemat

import dryfric_control as dfc
from dryfric_control import effects as fx
from dryfric_control import presets
from dryfric_control.compiled import axis_step
from dryfric_control.diagnosis import Experiment
from dryfric_control.diagnosis.excitations import Limits
from dryfric_control.estimation import windows
from dryfric_control.model import loops
from dryfric_control.model.axis import AxisStepper
from dryfric_control.model.effects.effect import REGISTRY
from dryfric_control.observer import runtime, synthesis

DT = 1e-3
NAN, INF = math.nan, math.inf
N = 2000
T = DT * np.arange(N)
U = 20.0 * np.sin(6.0 * T) + 12.0 * np.sin(17.0 * T + 1.0)
AXIS = dfc.FrictionAxis(
    mass=2.0, viscous=15.0, coulomb=8.0, stribeck=dfc.Stribeck(0.3, 0.01), travel=(-0.3, 0.3)
)
RUN = AXIS.simulate([0.0, 1.0], DT)
X = 1e-6 * np.round(1e6 * AXIS.simulate(U, dt=DT).y[0])
RECORD = dfc.Record(T, U, X, X)
CONTROLLER = dfc.PositionController(kp=400.0, ki=0.0, kd=40.0, dt=DT)
SLOWER = dataclasses.replace(CONTROLLER, dt=2e-3)
HUGE = 10**400  # a whole number that no float holds


def nan_at(array: Any, place: int = 7) -> Any:
    """The array with one bad value."""
    spoiled = np.array(array, dtype=float)
    spoiled[place] = NAN
    return spoiled


@functools.cache
def design() -> dfc.ObserverDesign:
    return dfc.design_pi_observer(AXIS, DT, encoder_quantum=1e-6)


@functools.cache
def fitted() -> dfc.Fit:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", dfc.FitWarning)
        return dfc.fit(AXIS, RECORD, free=("coulomb",), starts=1)


@functools.cache
def experiment() -> Experiment:
    rest = np.empty(0), np.empty(0), None, (), {}, {}, "coulomb", {}, {}, ("m", "N")
    return Experiment("change_of_bench", "a change of the bench", "turn it", *rest)


def method(make: Callable[[], Any], name: str) -> Callable[..., Any]:
    """A method of what is made when it is called."""
    return lambda **given: getattr(make(), name)(**given)


def designed(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, given a design."""
    return lambda **given: function(**({"design": design()} | given))


class Magnet(fx.Effect):
    """An effect of a user's own, sound but for what a row spoils."""

    slug = "magnet"
    action = "force"

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return 0.0


def magnet(**changes: Any) -> Any:
    return fx.register_effect(type("Magnet", (Magnet,), changes))


# A sound call of every name: what the rows below spoil in one argument.
LOOP = dict(controller=CONTROLLER, reference=[0.0, 0.1])
MADE: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
    "FrictionAxis.replace": (AXIS.replace, {}),
    "FrictionAxis.arrays": (AXIS.arrays, dict(dt=DT)),
    "FrictionAxis.breakaway": (AXIS.breakaway, dict(x=[0.0], direction=1)),
    "FrictionAxis.simulate": (AXIS.simulate, dict(u=[0.0, 1.0], dt=DT)),
    "FrictionAxis.stepper": (AXIS.stepper, dict(dt=DT)),
    "FrictionAxis.mode": (AXIS.mode, dict(index=1)),
    "FrictionAxis.mode_ss": (AXIS.mode_ss, dict(index=1, dt=DT)),
    "AxisStepper": (AxisStepper, dict(axis=AXIS, dt=DT)),
    "AxisStepper.step": (AxisStepper(AXIS, DT).step, dict(u=0.0)),
    "CoulombMap.__call__": (dfc.CoulombMap(8.0), dict(x=[0.0], direction=1)),
    "CoulombMap.scaled": (dfc.CoulombMap(8.0).scaled, dict(plus=1.0)),
    "Sign": (dfc.laws.Sign, {}),
    "Tanh": (dfc.laws.Tanh, dict(speed=1e-3)),
    "Karnopp": (dfc.laws.Karnopp, dict(band=1e-3)),
    "Dahl": (dfc.laws.Dahl, dict(stiffness=1e5)),
    "LuGre": (dfc.laws.LuGre, dict(stiffness=1e5, damping=100.0)),
    "Law": (dfc.laws.Sign().run, dict(axis=AXIS, u=[0.0, 1.0], dt=DT)),
    "PositionController.from_bandwidth": (
        dfc.PositionController.from_bandwidth,
        dict(axis=AXIS, bandwidth=20.0, dt=DT),
    ),
    "PositionController.memory": (CONTROLLER.memory, {}),
    "SimulationResponse": (RUN.plot, {}),
    "Events": (RUN.events.times, dict(before=0, after=1)),
    "parameter": (fx.parameter, dict(unit="N", doc="force")),
    "Effect": (fx.Spring, dict(stiffness=10.0)),
    "register_effect": (magnet, {}),
    "Record.from_irregular": (dfc.Record.from_irregular, dict(t=T, u=U, x=X)),
    "Record.split_at_gaps": (dfc.Record.split_at_gaps, dict(t=T, u=U, x=X)),
    "Record.from_frame": (dfc.Record.from_frame, dict(frame={})),
    "Record.window": (RECORD.window, {}),
    "Record.split": (RECORD.split, dict(parts=2)),
    "Record.blocks": (RECORD.blocks, dict(seconds=0.5)),
    "Record.decimated": (RECORD.decimated, dict(factor=2)),
    "Record.resampled": (RECORD.resampled, dict(dt=2e-3)),
    "Record.commanded": (dfc.Record(T, U, X, 1.1 * X).commanded, {}),
    "Record.derivatives": (RECORD.derivatives, {}),
    "Record.to_csv": (RECORD.to_csv, dict(path="run.csv")),
    "Record.plot": (RECORD.plot, {}),
    "Record.read": (RECORD.read, dict(positions=X, rng=np.random.default_rng(0))),
    "Record.compare": (dfc.Record(T, U, X, channels={"v": U}).compare, dict(name="v")),
    "Scaling.of": (dfc.Scaling.of, dict(gain=2.0)),
    "Scaling.from_dict": (dfc.Scaling.from_dict, dict(data={})),
    "Scaling.from_file": (dfc.Scaling.from_file, dict(path="axis.toml")),
    "ObserverDesign.mode_matrices": (method(design, "mode_matrices"), dict(mode=1)),
    "ObserverDesign.error_dynamics": (method(design, "error_dynamics"), dict(mode=1)),
    "ObserverDesign.save": (method(design, "save"), dict(path="/nowhere/observer.json")),
    "ObserverStepper.step": (
        lambda **given: dfc.ObserverStepper(design()).step(**given),
        dict(u=0.0, y=0.0),
    ),
    "Fit.interval": (method(fitted, "interval"), {}),
    "Fit.bootstrap": (method(fitted, "bootstrap"), {}),
    "Fit.replay": (method(fitted, "replay"), dict(record=RECORD)),
    "Fit.plot": (method(fitted, "plot"), {}),
    "Experiment.to_csv": (method(experiment, "to_csv"), dict(path="plan.csv")),
    "Experiment.plot": (method(experiment, "plot"), {}),
    "datasets.emps": (dfc.datasets.emps, dict(path="DATA_EMPS.mat")),
    "presets.clutch_observer": (presets.clutch_observer, {}),
    "presets.clutch_controller": (presets.clutch_controller, {}),
    "presets.crawl_and_steps": (presets.crawl_and_steps, {}),
    "presets.clutch_experiment": (designed(presets.clutch_experiment), {}),
    "presets.clutch_monte_carlo": (designed(presets.clutch_monte_carlo), {}),
    **{
        name: (designed(getattr(dfc, name)), arguments)
        for name, arguments in {
            "pi_observer": {},
            "ObserverStepper": {},
            "observe": dict(u=[0.0, 1.0], y=[0.0, 0.0]),
            "observed_loop": dict(axis=AXIS, controller=CONTROLLER),
            "simulate_observed_loop": dict(axis=AXIS, **LOOP),
            "monte_carlo": LOOP | dict(quantum=1e-6, stribeck_speed=0.01, runs=2, progress=False),
        }.items()
    },
}
ARGUMENTS: dict[str, dict[str, Any]] = {
    "FrictionAxis": dict(mass=2.0, viscous=15.0, coulomb=8.0),
    "CoulombMap": dict(plus=8.0),
    "Stribeck": dict(excess=0.3, speed=0.01),
    "PositionController": dict(kp=400.0, ki=0.0, kd=40.0, dt=DT),
    "simulate_loop": dict(axis=AXIS, **LOOP),
    "axis_block": dict(axis=AXIS, dt=DT),
    "switched_axis": dict(axis=AXIS, dt=DT),
    "supervisor": dict(axis=AXIS, dt=DT),
    "encoder": dict(quantum=1e-6, dt=DT),
    "reference_filter": dict(bandwidth=20.0, dt=DT),
    "position_controller": dict(axis=AXIS, bandwidth=20.0, dt=DT),
    "plot_state_machine": dict(axis=AXIS),
    "Record": dict(t=T, u=U, x=X),
    "read_record": dict(source={"t": T, "u": U, "x": X}),
    "Scaling": {},
    "load_fit": dict(path="fit.json"),
    "load_record": dict(path="record.json"),
    "load_diagnosis": dict(path="diagnosis.json"),
    "read_bam": dict(path="log.json"),
    "read_axis": dict(path="axis.toml"),
    "write_axis": dict(axis=AXIS, path="/nowhere/axis.toml"),
    "load_design": dict(path="observer.json"),
    "design_pi_observer": dict(axis=AXIS, dt=DT),
    "hybrid_filter": dict(axis=AXIS),
    "design_compensation": dict(axis=AXIS, dt=DT),
    "load_compensation": dict(path="/nowhere/compensation.json"),
    "export_c": dict(obj=AXIS, folder="new"),
    "export_fmu": dict(obj=AXIS, path="axis.fmu"),
    "to_mjcf": dict(result=AXIS, model="/nowhere/arm.xml"),
    "to_urdf": dict(result=AXIS, model="/nowhere/arm.urdf"),
    "to_modelica": dict(result=AXIS, model="/nowhere/Arm.mo"),
    "to_isaac": dict(result=AXIS, path="/nowhere/friction.py", load=0.0),
    "to_simscape": dict(result=AXIS, path="/nowhere/friction.m"),
    "motion_profile": dict(
        points=[0.0, 0.1], dt=DT, velocity=0.1, acceleration=1.0, jerk=50.0, dwell=0.0
    ),
    "fit": dict(axis=AXIS, record=RECORD),
    "identify_coulomb": dict(record=RECORD),
    "identify_stribeck": dict(axis=AXIS, record=RECORD),
    "replay": dict(axis=AXIS, record=RECORD),
    "replay_loop": dict(axis=AXIS, record=RECORD, controller=CONTROLLER),
    "slow_ramp_experiment": dict(axis=AXIS, duration=5.0),
    "diagnose": dict(axis=AXIS, record=RECORD),
    "diagnose_batch": dict(axis=AXIS, records=[RECORD], progress=False),
    "diagnose_joints": dict(joints={"elbow": (AXIS, RECORD)}, progress=False),
    "run_batch": dict(function=math.sqrt, cases={"a": 4.0}, progress=False),
    "next_experiment": dict(axis=AXIS, rivals=[AXIS.replace(mass=2.5)], record=RECORD),
}
SOUND = MADE | {name: (getattr(dfc, name), given) for name, given in ARGUMENTS.items()}

PUBLIC = {
    name: getattr(space, name)
    for space in (dfc, dfc.effects, dfc.laws)
    for name in space.__all__
    if name not in ("datasets", "effects", "laws", "presets")
}

# Names that take nothing from a user: errors and warnings, and objects that the package makes,
# whose methods take no argument or are in the table under the name of the function.
NOTHING_TO_SPOIL = set(
    "__version__ Cause Certificate CertificateError Compensation Diagnosis MotionProfile FitWarning "
    "Inner RecordWarning".split()
)


@dataclasses.dataclass(frozen=True)
class Case:
    """One bad input and what the error must say."""

    name: str
    spoil: dict[str, Any]
    mend: str
    says: str | None = None
    call: Callable[..., Any] | None = None
    kind: type[Exception] = ValueError

    def __str__(self) -> str:
        shown = ",".join(f"{k}={_short(v)}" for k, v in self.spoil.items())
        return f"{self.name}({shown or self.mend})"


def _short(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"array{value.shape}"
    return re.sub(r"[^-\w.+*(), ]", "", repr(value))[:30]


CASES: list[Case] = []


class Each(tuple[Any, ...]):
    """Values of an argument that are refused alike."""

    def __new__(cls, *values: Any) -> Each:
        return super().__new__(cls, values)


def rows(*table: tuple[Any, ...]) -> None:
    """Rows: public names, spoiled argument, mend, and further, where it is not the usual one,
    what to say in place of the argument, a call, and last the kind of the error.
    """
    for names, spoil, mend, *more in table:
        kind = more.pop() if more and isinstance(more[-1], type) else ValueError
        values = [v if isinstance(v, Each) else (v,) for v in spoil.values()]
        for name, given in itertools.product(names.split(), itertools.product(*values)):
            CASES.append(
                Case(name, dict(zip(spoil, given, strict=True)), mend, *more, kind=kind)  # type: ignore[arg-type]
            )


def files(name: str, *table: tuple[Any, ...]) -> None:
    """Rows of a reader: file name, content, what the message names, mend, options."""
    for file, content, says, mend, *options in table:
        rows((name, options[0] if options else {}, mend, says, reading(name, file, content)))


def reading(name: str, file: str, content: Any) -> Callable[..., Any]:
    """A call that reads a file with this content."""

    def read(folder: Any, **options: Any) -> Any:
        path = folder / file
        if isinstance(content, dict):
            savemat(path, content)
        else:
            path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return SOUND[name][0](path, **options)

    read.needs_folder = True  # type: ignore[attr-defined]
    return read


def columns(*arrays: Any, heading: str = "t,u,x") -> str:
    rows = zip(*(np.asarray(a).tolist() for a in arrays), strict=True)
    return "\n".join([heading, *(",".join(map(str, row)) for row in rows)]) + "\n"


NUMBER = "must be a (finite )?number|must be finite|not finite"
POSITIVE, NOT_NEGATIVE = "more than zero|positive", "zero or more|more than zero|positive"
FINITE = tuple((bad, NUMBER) for bad in (NAN, INF, "1 m", True))
KINDS = {
    "finite": FINITE,
    "not_negative": (*FINITE, (-1.0, NOT_NEGATIVE)),
    "positive": (*FINITE, (-1.0, POSITIVE), (0.0, POSITIVE)),
}


def numbers(names: str, **kinds: str) -> None:
    """Rows of arguments that are numbers of one kind: finite, not negative, or positive."""
    for kind, arguments in kinds.items():
        for argument, (bad, mend) in itertools.product(arguments.split(), KINDS[kind]):
            rows((names, {argument: bad}, mend))


# ------------------------------------------------------------------ numbers
numbers("FrictionAxis", positive="mass stick_speed stick_rate", not_negative="viscous")
numbers("FrictionAxis.replace", positive="mass")
numbers("AxisStepper.step", finite="u")
numbers("CoulombMap CoulombMap.scaled", finite="plus minus")
numbers("Stribeck", not_negative="excess", positive="speed")
numbers("Sign", positive="tolerance")
numbers("Tanh", positive="speed tolerance")
numbers("Karnopp", positive="band tolerance")
numbers("Dahl", positive="stiffness tolerance")
numbers("LuGre", positive="stiffness tolerance", finite="damping")
numbers("PositionController", positive="kp", not_negative="ki filter_time", finite="kd")
numbers("PositionController.memory", finite="reading speed")
numbers("parameter", finite="default neutral", positive="size")
numbers("Record", positive="unwrap")
numbers("Record.from_irregular", positive="max_gap")
numbers("Record.blocks", positive="seconds")
numbers("read_record", finite="gain", positive="rate unwrap")
numbers("Scaling.of Record.commanded", finite="gain")
numbers(
    "design_pi_observer",
    not_negative="uncertainty noise drift",
    finite="decay",
    positive="stick_speed",
)
numbers(
    "hybrid_filter",
    positive="excess excess_speed force_noise",
    not_negative="level_walk",
    finite="mass_error",
)
numbers(
    "design_compensation",
    not_negative="input_delay learning mismatch correction",
    positive="tolerance disturbance_bandwidth noise",
)
numbers("to_isaac", not_negative="load")
numbers("motion_profile", finite="points jerk", positive="velocity acceleration")
numbers("ObserverStepper.step", finite="u y")
numbers("monte_carlo", positive="stribeck_speed")
numbers("fit", positive="block")
numbers("fit replay Fit.replay diagnose diagnose_batch diagnose_joints", positive="window")
numbers("replay", finite="shift")

# -------------------------------------------------------------------- axis
LATE = AXIS.replace(effects=fx.InputDelay(5e-3))
rows(
    ("FrictionAxis", dict(mass=[2.0]), NUMBER),
    ("FrictionAxis", dict(mass=5e-324), "unit"),
    ("FrictionAxis", dict(coulomb=-8.0), "magnitude"),
    ("FrictionAxis", dict(coulomb=NAN), "finite", "plus"),
    ("FrictionAxis", dict(coulomb=Each(None, True, (1.0, 2.0, 3.0))), "level"),
    ("FrictionAxis", dict(coulomb=()), "pair"),
    ("FrictionAxis", dict(coulomb=(8.0, NAN)), "finite", "minus"),
    ("FrictionAxis", dict(coulomb=(1.0, -1.0)), "magnitude", "minus"),
    ("FrictionAxis", dict(coulomb=dfc.CoulombMap([1.0, 2.0]), travel=None), "give travel"),
    ("FrictionAxis", dict(coulomb=dfc.CoulombMap([1.0, -2.0]), travel=(0.0, 1.0)), "falls to -1"),
    ("FrictionAxis", dict(coulomb=dfc.CoulombMap([1, -4.2, 4.2]), travel=(0.0, 1.0)), "x = 0.5"),
    ("FrictionAxis", dict(stribeck=Each(0.3, (0.3, 0.01))), "dfc.Stribeck"),
    ("FrictionAxis", dict(travel=(0.1, 0.1)), "low to high"),
    ("FrictionAxis", dict(travel=(0.0, 0.1, 0.2)), r"\(low, high\)"),
    ("FrictionAxis", dict(switching="Filippov"), '"filippov" or "paper"'),
    ("FrictionAxis", dict(switching=Each(None, ["paper"])), '"filippov"'),
    ("FrictionAxis", dict(effects=3), "sequence of effects"),
    ("FrictionAxis", dict(effects=Each("spring", (fx.Spring,))), "dfc.effects.Spring"),
    ("FrictionAxis", dict(effects=2 * (fx.InputDelay(0.1),)), "more than one delay"),
    ("FrictionAxis", dict(effects=2 * (fx.Presliding(1e-5),)), "more than one contact"),
    ("FrictionAxis", dict(effects=(fx.Backlash(1e-3, 0.5), fx.Compliance(1e4, 1.0, 0.5))), "one"),
    ("FrictionAxis", dict(effects=(fx.ActuatorLag(0.1), fx.ActuatorLag(0.2))), "add them up"),
    ("FrictionAxis", dict(name=3), "text"),
    ("FrictionAxis", dict(units=Each("m", ("m", 3), 3)), "position and force"),
    ("FrictionAxis", dict(units=("deg", "Nm")), "converted as they are read", "not in 'deg'"),
    ("FrictionAxis", dict(units=("m", "kN")), "converted as they are read", "not in 'kN'"),
    ("FrictionAxis", dict(units=("N m", "rad")), "position first", "position cannot be in 'N m'"),
    ("FrictionAxis", dict(units=("rad", "N")), '"N m"'),
    ("FrictionAxis.replace", dict(weight=1.0), "unexpected keyword", None, TypeError),
    ("FrictionAxis.arrays", dict(dt=0.0), POSITIVE),
    ("FrictionAxis.breakaway", dict(direction=0), r"\+1 or -1"),
    ("FrictionAxis.breakaway", dict(x=["a"]), "array of numbers"),
    ("FrictionAxis.simulate", dict(u=None), r"array of numbers|shape \(n,\)"),
    ("FrictionAxis.simulate", dict(u=Each([1.0, [2.0]], [0.0, HUGE], {"a": 1.0})), "array of num"),
    ("FrictionAxis.simulate", dict(u=U + 1j), "real part"),
    ("FrictionAxis.simulate", dict(u=np.ma.masked_less([1.0, -1.0], 0.0)), "fill or remove"),
    ("FrictionAxis.simulate", dict(u=np.array(["1", "2"])), "numbers"),
    ("FrictionAxis.simulate", dict(x0=[0.0, 1.0]), NUMBER),
    ("FrictionAxis.simulate", dict(law=Each("lugre", dfc.laws.Sign)), r"dfc.laws.LuGre"),
    ("FrictionAxis.mode", dict(index=Each(2, "+1", [1], True)), "stuck", "mode"),
    ("FrictionAxis.mode_ss", dict(index=None), "stuck", "mode"),
    ("FrictionAxis.mode_ss", dict(dt=-1.0), NOT_NEGATIVE),
    ("FrictionAxis.mode_ss", dict(method="tustin"), '"euler" or "zoh"'),
    ("FrictionAxis.mode_ss", dict(input="u"), '"drive" or "force"'),
    ("FrictionAxis.mode_ss", dict(index=0, dt=0.01), 'lower dt|method="zoh"', "stick_rate"),
    ("FrictionAxis.mode_ss", dict(at=Each(0.1, (0.1, 0.2, 3.0, 4.0))), "position, veloc", "at"),
    ("FrictionAxis.mode_ss", dict(at=(NAN, 0.1)), NUMBER, "at"),
    ("FrictionAxis.mode_ss", dict(at=(0.0, -0.1)), "sign of the mode", "at"),
    ("AxisStepper.step", dict(u=[1.0, 2.0]), NUMBER),
    ("CoulombMap", dict(plus=[]), "constant level"),
    ("CoulombMap", dict(plus=Each("8", None)), "coefficients"),
    ("CoulombMap", dict(plus=[8.0, NAN]), "finite", r"plus\[1\]"),
    ("CoulombMap", dict(minus=[[7.0]]), "number", r"minus\[0\]"),
    ("CoulombMap", dict(plus={"c0": 8.0}), "number"),
    ("CoulombMap.__call__", dict(direction=Each(2, None)), r"\+1 or -1"),
    ("CoulombMap.__call__", dict(x="here"), "array of numbers"),
    ("Stribeck", dict(excess=30.0), "for 30 % give 0.3"),
    ("Stribeck", dict(speed=1e-320), "unit"),
    ("Law", dict(axis=LATE), "remove them", "input_delay"),
    ("Law", dict(axis=AXIS.replace(effects=fx.Presliding(1e-5))), "leave out", "presliding"),
)
_FAST = AXIS.replace(viscous=1e12)  # N s/um taken for N s/m, say
_SHARP = AXIS.replace(stribeck=dfc.Stribeck(0.3, 1e-13))
_WALL = AXIS.replace(effects=fx.EndStop(-0.1, 0.1, 1e15))
_STIFF = functools.partial(AXIS.replace(viscous=5000.0).mode_ss, 1, DT, "euler")
_UNITS = "check the units"
rows(
    ("FrictionAxis.mode_ss", {}, "lower dt", "viscous / mass", _STIFF),
    ("FrictionAxis.simulate", {}, _UNITS, "viscous", lambda: _FAST.simulate([0.0], DT)),
    ("FrictionAxis.simulate", {}, _UNITS, "stribeck.speed", lambda: _SHARP.simulate([0.0], DT)),
    ("FrictionAxis.stepper", {}, _UNITS, "viscous", lambda: _FAST.stepper(DT)),
    ("axis_block", {}, _UNITS, "viscous", lambda: dfc.axis_block(_FAST, DT)),
    ("simulate_loop", {}, _UNITS, "viscous", lambda: dfc.simulate_loop(_FAST, CONTROLLER, [0.0])),
    ("FrictionAxis.simulate", {}, "Use at most", "too stiff", lambda: _WALL.simulate([0.0], DT)),
)

# ---------------------------------------------------------- loops and blocks
rows(
    ("PositionController", dict(span=Each(0, 9, 2.5, "2", True)), "1 to 8"),
    ("PositionController.from_bandwidth position_controller", dict(bandwidth=500.0), "below 0.2"),
    ("simulate_loop", dict(reference=0.1), r"shape \(n,\)", "reference"),
    ("simulate_loop", dict(disturbance=[0.0]), "one for each"),
    ("simulate_loop", dict(disturbance=[0.0, NAN]), "fill"),
    ("switched_axis supervisor", dict(axis=LATE), "axis_block", "input_delay"),
    ("reference_filter", dict(bandwidth=4000.0), "lower it"),
    ("reference_filter", dict(order=Each(0, 2.5, "two", [2])), "1 to 8"),
    ("plot_state_machine", dict(ax=[1, 2]), "1 axes"),
    ("plot_state_machine", dict(ax="here"), "Axes"),
    ("SimulationResponse", dict(ax=[1.0]), "3 axes"),
    ("SimulationResponse", dict(ax=["a", "b", "c"]), "Axes"),
    ("Events", dict(before=2), r"0 \(stuck\)"),
    ("Events", dict(after="stuck"), r"0 \(stuck\)"),
)

# ----------------------------------------------------------------- effects
rows(
    ("parameter", dict(bounds=Each((1.0, 0.0), (NAN, 1.0))), "low to high"),
    ("parameter", dict(bounds=3.0), r"\(low, high\)"),
    ("parameter", dict(bounds=(0.0, 1.0), default=2.0), "bounds", "default"),
    ("parameter", dict(unit=3), "text"),
    ("parameter", dict(doc=None), "text"),
    ("parameter", dict(kind="length"), "one of amount"),
    ("parameter", dict(free=1), "True or False"),
    ("parameter", dict(breaks_away="no"), "True or False"),
    ("parameter", dict(logarithmic=None), "True or False"),
    ("Effect", dict(stiffness=None), NUMBER, "spring.stiffness"),
    ("Effect", dict(rest=[0.0, 1.0]), NUMBER),
    ("EndStop", dict(low=0.2, high=0.1, stiffness=1e3), "exchange them", "end_stop.low"),
    ("register_effect", dict(slug=Each("", "a b", 3)), "lower-case word"),
    ("register_effect", dict(action="torque"), "must be one of"),
    ("register_effect", dict(law=None), "static method law"),
    ("register_effect", dict(action="axis"), r"method alter\(axis\)", "Magnet"),
    ("register_effect", dict(slug="spring"), "choose another"),
    ("register_effect", {}, "class", "Effect", lambda: fx.register_effect(3)),
    ("register_effect", {}, "dfc.effects.Effect", "dict", lambda: fx.register_effect(dict)),
)
for _cls in REGISTRY.values():
    _bounds = {name: about["bounds"] for name, about in _cls.parameters().items()}
    # Growing: a lower place comes before an upper one.
    _middle = {n: min(max(0.5 + 0.01 * i, low), high)
               for i, (n, (low, high)) in enumerate(_bounds.items())}  # fmt: skip
    SOUND[_cls.__name__] = (_cls, _middle)
    for _name, _ends in _bounds.items():
        _says = f"{_cls.slug}.{_name}"
        rows((_cls.__name__, {_name: Each(NAN, INF, "1.0 N")}, NUMBER, _says))
        for _end, _beyond in zip(_ends, (-INF, INF), strict=True):
            if math.isfinite(_end):
                _out = math.nextafter(_end, _beyond)
                rows((_cls.__name__, {_name: _out}, "must lie between", _says))

# ------------------------------------------------------------------ records
WRAPPED = np.mod(40.0 * T, 2.0 * np.pi)
KEPT = np.ones(N, bool)
KEPT[700:720] = False  # 20 samples dropped
rows(
    ("Record", dict(t=T[:-1]), "cut them to one length", "u"),
    ("Record", dict(x=X[:-3]), "one length"),
    ("Record", dict(reference=X[:9]), "one length"),
    ("Record", dict(good=[True, False]), "one for each reading", "good"),
    ("Record", dict(good=np.zeros(N, bool)), "at least", "good"),
    ("Record", dict(good=X), "True or False", "good"),
    ("Record", dict(u=nan_at(U)), "from_irregular"),
    ("Record", dict(units={"w": "m/s"}), "t, u and x"),
    ("Record", dict(units={"x": "MM"}), "Did you mean 'mm'", "'MM' of x"),
    ("Record", dict(units={"x": "N"}), "check the columns", "x cannot be in 'N'"),
    ("Record", dict(u=U > 0), "astype", "u holds true and false"),
    ("Record", dict(x=2**62 + np.arange(N)), r"pass x - x\[0\]", "x"),
    ("Record", dict(quantum=1e50), "in the unit of x", "quantum"),
    ("Record", dict(units="m"), "mapping"),
    ("Record", dict(unwrap=1e-9), "period of the encoder", "unwrap"),
    ("Record", dict(channels=3), "mapping", "channels"),
    ("Record", dict(channels={"w": X}), "known are v, a, x2", "channels"),
    ("Record", dict(channels={"v": X[:5]}), "one length", "channels"),
    ("Record", dict(channels={"v": nan_at(X)}), "remove", "channels"),
    ("Record", dict(raw=3), "mapping", "raw"),
    ("Record", dict(raw={"x": "counts"}), "unit and a factor", "raw"),
    ("Record", dict(raw={"x": ("counts", NAN)}), "finite", "raw"),
    ("Record", dict(name=3), "text"),
    ("Record", dict(notes=Each(3, [3])), "text"),
    ("Record", dict(notes="filtered"), "sequence"),
    ("Record", dict(t=[0.0, HUGE, *T[2:]]), "convert it|physical"),
    ("Record.from_irregular", dict(t=T[::-1]), "sort the samples"),
    ("Record.from_irregular", dict(dt=1e-12), "samples"),
    ("Record.from_irregular", dict(dt=10.0), "it takes"),
    ("Record.from_irregular", dict(interpolation="spline"), '"monotone"'),
    ("Record.from_irregular", dict(t=T[KEPT], u=U[KEPT], x=X[KEPT]), "max_gap=", "gap"),
    ("Record.from_irregular", dict(x=np.full(N, np.nan)), "remove"),
    ("Record.from_irregular", dict(x=np.where(T < 1.0, np.nan, X)), "too many", "rows"),
    ("Record.from_irregular", dict(good=[True]), "one for each reading", "good"),
    ("Record.from_irregular", dict(colour="red"), "unexpected", None, TypeError),
    ("Record.split_at_gaps", dict(t=T[::-1]), "sort"),
    ("Record.split_at_gaps", dict(x=nan_at(X)), "remove"),
    ("Record.split_at_gaps", dict(units="m"), "mapping"),
    ("Record.split_at_gaps", dict(channels={"v": X[:5]}), "one length"),
    ("Record.from_frame", dict(frame=Each([1, 2], X)), "data frame"),
    ("Record.window", dict(t0=1.0, t1=0.5), "record runs from", "window"),
    ("Record.window", dict(t0="start"), NUMBER),
    ("Record.window", dict(t0=Each(NAN, 90.0)), "record runs from", "window"),
    ("Record.split", dict(parts=0), "parts"),
    ("Record.split", dict(parts=Each(1.5, [0.5, 0.6], NAN)), "positive with sum 1", "fractions"),
    ("Record.split", dict(parts=True), "fraction", "split"),
    ("Record.split", dict(parts="half"), "convert it", "fractions"),
    ("Record.split", dict(parts=5000), "2 or more"),
    ("Record.split", dict(parts=[0.9999, 0.0001]), "at least 2", "holds"),
    ("Record.split", dict(parts=[]), "empty", "fractions"),
    ("Record.blocks", dict(seconds=1e-3), "fewer than 2", "0.001"),
    ("Record.decimated", dict(factor=0), "at least 1"),
    ("Record.decimated", dict(factor=Each(2.0, True)), "whole number"),
    ("Record.decimated", dict(factor=N), "fewer than 2", "2000"),
    ("Record.resampled", dict(dt=5.0), "it takes"),
    ("Record.commanded", dict(gain=0.0), "more than zero|positive"),
    ("Record.derivatives", dict(window=Each(4, 5.0, True)), "odd"),
    ("Record.derivatives", dict(window=3), "at least 5"),
    ("Record.derivatives", dict(window=9999), "at most"),
    ("Record.read", dict(positions=X[:5]), "give one each", "positions"),
    ("Record.read", dict(positions=nan_at(X)), "remove these samples", "positions"),
    ("Record.compare", dict(name="w"), "it has v", "'w'"),
    ("Record.compare", dict(window=4), "odd"),
    ("Record.to_csv", dict(path="run.xlsx"), "csv", "to_csv"),
    ("Record.plot", dict(ax=3), "one for each row"),
    ("Record", {}, "slice", "record", lambda: RECORD[3], TypeError),
    ("Record", {}, r"use record.decimated\(2\)", "step", lambda: RECORD[::2]),
    ("Record", {}, "holds 1, at least 2", "", lambda: RECORD[5:6]),
)

# ------------------------------------------------------------------ readers
_MOTOR = "counts_per_turn gear_ratio lead torque_constant rated_torque force_constant rated_force "
_MOTOR += "pinion_radius piston_area"
rows(
    ("read_record", dict(source={}), "t, u and x", "no columns"),
    ("read_record", dict(source={"t": T, "u": U}), "columns=", "x"),
    ("read_record", dict(source={"t": T, "u": U > 0, "x": X}, gain=2.0), "astype", "u holds true"),
    ("read_record", dict(gain=0.0), "not zero"),
    ("read_record", dict(gain=HUGE), "finite|number"),
    ("read_record", dict(columns={"t": "zeit"}), "available"),
    ("read_record", dict(columns={"time": "t"}), "roles"),
    ("read_record", dict(columns={"t": 9}), "0 to 2"),
    ("read_record", dict(columns={"t": "u"}), "serves as both", "column"),
    ("read_record", dict(columns="t,u,x"), "map t, u, x"),
    ("read_record", dict(columns={"t": 1.5}), "name or an index"),
    ("read_record", dict(columns={"referense": "x"}), "Did you mean 'reference'"),
    ("read_record", dict(columns={"x": None}), "column of velocity", "x"),
    ("read_record", dict(units={"t": "fortnight"}), "use s, ms", "fortnight"),
    ("read_record", dict(units={"x": "s"}), "check the columns", "x"),
    ("read_record", dict(units={"x": "Ft"}), "Did you mean 'ft'", "'Ft' of x"),
    ("read_record", dict(units="ms"), "mapping"),
    ("read_record", dict(units={"q": "m"}), "t, u and x"),
    ("read_record", dict(max_rows=0), "positive"),
    ("read_record", dict(max_rows=100), "max_rows=", "rows"),
    ("read_record", dict(rate=1e3), "leave rate= out", "column of time"),
    ("read_record", dict(rate=1e3, dt=1e-3), "without a column of time", "rate and dt"),
    ("read_record", dict(max_gap=0.1), "give dt=", "max_gap"),
    ("read_record", dict(dt=1e-3, max_gap=-1.0), "more than zero", "max_gap"),
    ("read_record", dict(gain={"w": 2.0}), "channels are", "'w'"),
    ("read_record", dict(gain={"v": 2.0}), "it has t, u, x", "'v'"),
    ("read_record", dict(name=7), "text"),
    ("read_record", dict(joint="elbow"), "available", "joint 'elbow'"),
    ("Scaling", dict(gain=3), "number or a mapping"),
    ("Scaling", dict(gain={"x": 0.0}), "not zero", "gain"),
    ("Scaling", dict(gain={"x": NAN}), "finite", "gain"),
    ("Scaling", dict(gain={"y": 1.0}), "the channels are", "'y'"),
    ("Scaling", dict(gain={"reference": 2.0}), "takes the gain of x"),
    ("Scaling", dict(torque_constant=1.0, force_constant=1.0), "a motor has one"),
    ("Scaling", dict(rated_torque=1.0, rated_force=1.0), "a motor has one"),
    ("Scaling", dict(lead=0.1, pinion_radius=0.02), "an axis has one"),
    *(("Scaling", {name: 0.0}, "more than zero") for name in _MOTOR.split()),
    ("Scaling", dict(load_encoder="yes"), "True or False"),
    ("Scaling.from_dict", dict(data={"counts_per_trun": 1}), "'counts_per_turn'", "record.counts_"),
)
BACK = T.copy()
BACK[900] = 0.0
files(
    "read_record",
    ("two.csv", columns(T[:20], U[:20], heading="t,u"), "two.csv", "at least t, u and x"),
    ("back.csv", columns(BACK, U, X), "t", "sort"),
    ("twice.csv", columns(np.repeat(T, 2), np.repeat(U, 2), np.repeat(X, 2)), "t", "keep one"),
    ("wrap.csv", columns(T, U, WRAPPED), "x", "unwrap="),
    ("still.csv", columns(T, U, 0 * X), "x", "never moved"),
    ("huge.csv", columns(T, U, X), "huge.csv", "max_rows=", dict(max_rows=1000)),
    ("long.csv", b"t,u,x\n" + b"1" * 1_100_000, "line 2", "too long"),
    ("wide.csv", "t,u,x\n0,0,0\n".encode("utf-16")[:-1], "wide.csv", "plain text"),
    ("comma.csv", "t;u;x\n0,0;1.5;0\n", "comma.csv", "one way"),
    ("run.xlsx", "t", "run.xlsx", "no .xlsx file"),
    ("run.xls", "t", "run.xls", "or CSV"),
    ("run.csv.gz", "t", "run.csv.gz", "not compressed by gzip"),
    ("run.json", "{}", "run.json", "read_bam"),
    ("run.foo", "t", "run.foo", "save it as CSV"),
    ("run", "t", "run", "are not read"),
    ("none.mat", "MATLAB 5.0", "none.mat", "no MAT-file"),
    ("v73.mat", b"MATLAB 7.3 MAT-file" + bytes(200), "v73.mat", "-v7"),
    ("hdf.mat", b"\x89HDF" + bytes(200), "hdf.mat", "-v7"),
    ("names.mat", {"a": T, "b": U}, "names.mat", "columns="),
    ("words.mat", {"t": "abc"}, "words.mat", "no numeric variable"),
    ("short.mat", {"t": T, "u": U[:-1], "x": X}, "u", "one length"),
    ("complex.mat", {"t": T, "u": U + 1j, "x": X}, "u", "real part"),
    ("table.mat", {"t": T, "u": np.zeros((50, 40, 2)), "x": X}, "u", "1-D"),
)


def bam(**changes: Any) -> str:
    """Log of 30 samples, of which the last one is spoiled."""
    sound = {"goal_position": 0.0, "input_volts": 7.5, "temp": 28.0, "torque_enable": True}
    entries = [
        {"timestamp": 4e-3 * k, "position": math.sin(0.1 * k), "load": 100 + k} | sound
        for k in range(30)
    ]
    entries[-1] |= changes
    head = {"mass": 0.5, "length": 0.1, "kp": 100, "vin": 7.4, "motor": "a", "trajectory": "b"}
    return json.dumps(head | {"entries": entries})


files(
    "read_bam",
    ("empty.log", "", "empty.log", "empty"),
    ("torn.log", bam()[:-40], "torn.log", "JSON"),
    ("list.log", "[]", "list.log", "entries"),
    ("none.log", '{"entries": []}', "none.log", "entries"),
    ("bare.log", '{"entries": [1]}', "entry 0", "not a number"),
    ("word.log", bam(position="here"), "position", "not a number"),
    ("null.log", bam(load=None), "load", "not a number"),
    ("nan.log", bam(position=NAN), "x|position", "remove|not finite"),
    ("back.log", bam(timestamp=0.0), "t", "sort"),
    ("gap.log", bam(timestamp=9.0), "gap", "max_gap|split"),
    ("big.log", bam(load=HUGE), "load", "too large"),
    ("deep.log", "[" * 100_000, "deep.log", "JSON"),
    ("step.log", bam(), "dt", "more than zero", dict(dt=0.0)),
)
files("datasets.emps", ("emps.csv", columns(T, U, X), "not the EMPS record", "read_record"))
TOML = "mass = 2.0\nviscous = 15.0\ncoulomb = 8.0\n"
files(
    "read_axis",
    ("empty.toml", "", "empty.toml", "is empty"),
    ("torn.toml", "mass = ", "torn.toml", "TOML"),
    ("latin.toml", b"name = '\xff'", "latin.toml", "TOML"),
    ("deep.toml", "mass=" + "[" * 9999, "deep", "TOML"),
    ("text.toml", TOML.replace("2.0", '"2 kg"'), "mass", NUMBER),
    ("less.toml", TOML.replace("2.0", "-2.0"), "mass", POSITIVE),
    ("nan.toml", TOML.replace("2.0", "nan"), "mass", NUMBER),
    ("date.toml", TOML.replace("2.0", "2026-11-21"), "mass", NUMBER),
    ("vast.toml", TOML.replace("2.0", "9" * 400), "mass", NUMBER),
    ("digits.toml", TOML.replace("2.0", "9" * 9000), "digits.toml", "digits"),
    ("typo.toml", TOML + "stik_speed = 1e-4", "stik_speed", "stick_speed"),
    ("newer.toml", TOML + "flux = 3", "flux", "known are"),
    ("pair.toml", TOML.replace("8.0", "[8.0]"), "coulomb", "pair"),
    ("lone.toml", TOML.replace("8.0", "{minus = 7.0}"), "coulomb", "lacks plus"),
    ("minos.toml", TOML.replace("8.0", "{plus = 7.0, minos = 7.0}"), "coulomb.minos", "'minus'"),
    ("few.toml", "viscous = 1.0\ncoulomb = 1.0", "mass", "give at least"),
    ("stribeck.toml", TOML + "stribeck = 3.0", "stribeck", "a table such as"),
    ("sped.toml", TOML + "[stribeck]\nexcess = 0.3\nsped = 0.1", "stribeck.sped", "'speed'"),
    ("peak.toml", TOML + "[stribeck]\nexcess = 0.3", "stribeck.speed", "add speed"),
    ("low.toml", TOML + "[stribeck]\nexcess = 0.3\nspeed = -1.0", "stribeck.speed", POSITIVE),
    ("who.toml", TOML + "[[effects]]\nstiffness = 1.0", r"effects\[0\]", "name the effect"),
    ("other.toml", TOML + '[[effects]]\neffect = "sprng"', "sprng", "spring"),
    ("lack.toml", TOML + '[[effects]]\neffect = "spring"', "stiffness", "add stiffness"),
    (
        "more.toml",
        TOML + '[[effects]]\neffect = "bias_force"\nforce = 1\nmass = 2',
        "mass",
        "known",
    ),
    ("bound.toml", TOML + '[[effects]]\neffect = "input_delay"\ndelay = -1.0', "delay", "between"),
    ("flat.toml", TOML + "effects = 3", "effects", r"\[\[effects\]\]"),
    ("unit.toml", TOML + 'units = "m"', "units", "position and force"),
    ("name.toml", TOML + "name = 3", "name", "text"),
    ("rule.toml", TOML + 'switching = "none"', "switching", "filippov"),
    ("way.toml", TOML + "travel = [0.3, 0.0]", "travel", "low to high"),
)
_DESIGN = '{"format": "dryfric-control observer design", "version": %d}'
files(
    "load_design",
    ("empty.json", "", "empty.json", "JSON"),
    ("torn.json", '{"format": ', "torn.json", "JSON"),
    ("list.json", "[1, 2]", "list.json", "no observer design"),
    ("other.json", '{"format": "a"}', "other.json", "format = 'a', not"),
    ("newer.json", _DESIGN % 3, "version 3", "newer package"),
    ("bare.json", _DESIGN % 1, "content", "save the observer"),
    ("deep.json", "[" * 100_000, "deep.json", "JSON"),
    ("vast.json", "9" * 9000, "vast.json", "JSON"),
    ("wide.json", b"\xff\xfe{\x00", "wide.json", "JSON"),
)
for _names, _file in (
    ("read_axis Scaling.from_file", "axis.toml"),
    ("read_bam", "log.json"),
    ("load_design", "observer.json"),
    ("load_fit", "fit.json"),
    ("load_record", "record.json"),
    ("load_diagnosis", "diagnosis.json"),
    ("load_compensation", "compensation.json"),
    ("datasets.emps", "DATA_EMPS.mat"),
):
    rows((_names, dict(path=f"/nowhere/{_file}"), "no file", _file, FileNotFoundError))
rows(
    ("read_record", dict(source="/nowhere/run.csv"), "no file", "run.csv", FileNotFoundError),
    ("read_record", dict(source="a\0b.csv"), "no file", "a", FileNotFoundError),
    ("read_record", dict(source="/"), "give one file in it", "directory", IsADirectoryError),
    ("read_record", dict(source=Each(3, None, [T, U, X])), "path", "read_record", TypeError),
    ("read_bam datasets.emps read_axis", dict(path=3), "file name", "3"),
    ("write_axis", {}, "axis.toml", "nowhere", FileNotFoundError),
    ("ObserverDesign.save", {}, "observer.json", "nowhere", FileNotFoundError),
    ("Record.to_csv", dict(path="/nowhere/run.csv"), "make it", "/nowhere", FileNotFoundError),
)

# ----------------------------------------------------------------- observer
_SMOOTH = AXIS.replace(coulomb=0.0)
rows(
    ("design_pi_observer", dict(dt=1.0, discretization="euler"), "lower dt", "dt"),
    ("design_pi_observer", dict(form="filtered"), "must be one of"),
    ("design_pi_observer", dict(method=Each("lqr", ["paper"])), "must be one of"),
    ("design_pi_observer", dict(solver="mosek"), "must be one of"),
    ("design_pi_observer", dict(discretization="tustin"), "must be one of"),
    ("design_pi_observer", dict(uncertainty=0.0), "small force", "uncertainty is zero"),
    ("design_pi_observer", dict(uncertainty={0: 1.0}), "name the modes"),
    ("design_pi_observer", dict(uncertainty={0: 1.0, 1: NAN, -1: 1.0}), "finite"),
    ("design_pi_observer", dict(decay=Each(0.0, 1.5)), "above 0"),
    ("design_pi_observer", dict(performance=Each((1.0, 2.0), 3.0)), "three weights"),
    ("design_pi_observer", dict(performance=(0.0, 0.0, 0.0)), "not all zero"),
    ("design_pi_observer", dict(performance=(1.0, -1.0, 0.0)), NOT_NEGATIVE),
    ("design_pi_observer", dict(window=2), "'path' or 'dwell'"),
    ("design_pi_observer", dict(method="path", window=Each(0, 65)), "1 to 64", "window"),
    ("design_pi_observer", dict(window=Each(1.5, "4")), "whole number"),
    ("design_pi_observer", dict(refine=-1), "at least 0"),
    ("design_pi_observer", dict(refine=Each(0.5, "once")), "whole number"),
    ("design_pi_observer", dict(method="paper", refine=1), "0 for 'paper'", "refine"),
    ("design_pi_observer", dict(pairs=[(0, 3)]), "modes 0, 1, -1"),
    ("design_pi_observer", dict(pairs=3), "changes of mode"),
    ("design_pi_observer", dict(coulomb="8"), "level"),
    ("design_pi_observer", dict(coulomb=-8.0), "magnitude"),
    ("design_pi_observer", dict(integral_modes=(0, 2)), r"must be 0, \+1 or -1", "mode"),
    ("design_pi_observer", dict(integral_modes=3), "modes"),
    ("design_pi_observer", dict(integral_modes=(0,)), "integral_modes", "detectable"),
    ("design_pi_observer", dict(axis=_SMOOTH), "amplitude", "uncertainty has no default"),
    ("design_pi_observer", dict(encoder_quantum=1e-6, noise=HUGE), NUMBER, "noise"),
    ("hybrid_filter", dict(axis=_SMOOTH), "design_pi_observer", "no Coulomb friction"),
    ("design_compensation", dict(bandwidth=1e6), "too high"),
    ("design_compensation", dict(law="magic"), "learned"),
    ("design_compensation", dict(gains=Each(3.0, (1.0, 2.0))), "kp, ki, kd"),
    ("design_compensation", dict(gains=(0.0, 1.0, 1.0)), POSITIVE),
    ("design_compensation", dict(gains=(1e9, 1.0, 1.0)), "lower", "unstable"),
    ("design_compensation", dict(limit=5.0), "breakaway friction force"),
    ("design_compensation", dict(mismatch=1.0), "below 1"),
    ("design_compensation", dict(noise=-0.1, gains=(1.0, 1.0, 1.0)), POSITIVE),
    ("ObserverDesign.mode_matrices", dict(mode=Each(2, None)), r"0, \+1 or -1"),
    ("ObserverDesign.error_dynamics", dict(mode=Each(2, None)), r"0, \+1 or -1"),
    ("observe", dict(u=[0.0]), "one of each", "u"),
    ("observed_loop simulate_observed_loop", dict(bandwidth=9000.0), "lower it"),
    ("observed_loop simulate_observed_loop monte_carlo", dict(controller=SLOWER), "one sampling"),
    ("monte_carlo", dict(runs=0), "at least 1"),
    ("monte_carlo", dict(runs=Each(2.5, "many", NAN)), "whole number"),
    ("monte_carlo", dict(estimators={}), "at least one"),
    ("monte_carlo", dict(estimators=3), "mapping"),
    ("monte_carlo", dict(estimators={"a": 3}), "estimate"),
    ("monte_carlo", dict(store="nowhere/runs.jsonl"), "make it first"),
    ("presets.clutch_monte_carlo", dict(runs=0), "at least 1"),
    ("motion_profile", dict(points=[0.0, NAN]), "finite"),
    ("motion_profile", dict(points=[[0.0, 1.0]]), "shape"),
    ("motion_profile", dict(points=1e12), "units of points", "points"),
    ("motion_profile", dict(unit="rad", velocity=0.0), "rad/s", "velocity"),
    ("motion_profile", dict(jerk=1e-30), "check the units", "jerk"),
    ("motion_profile", dict(dwell=-1.0), NOT_NEGATIVE),
    ("motion_profile", dict(dwell=[0.0, 0.0, 0.0]), "one each"),
    ("motion_profile", dict(unit=Each("deg", None)), '"m" or "rad".*convert'),
)

# ------------------------------------------------------ files that are written
_EXPORTS, _NAMED = "export_c export_fmu", AXIS.replace(name="2 x")
rows(
    (_EXPORTS, dict(obj=2.0), "FrictionAxis"),
    (_EXPORTS, dict(name=Each("2 fast", "na\u00efve")), "no C identifier"),
    (_EXPORTS, dict(name=Each("switch", "dfc_axis")), "taken in C"),
    (_EXPORTS, dict(obj=_NAMED), r"pass name=.* or axis.replace\(name=", "2_x"),
    (_EXPORTS, dict(obj=AXIS.replace(effects=fx.InputDelay(30.0))), "late by", "30 s"),
    ("export_c", dict(precision="half"), "double"),
    ("export_c", dict(folder=3.0), "path"),
    ("export_fmu", dict(name="model"), "is that of a file in every FMU"),
    ("export_fmu", dict(version="1.0"), "2.0"),
    ("export_fmu", dict(path="axis.zip"), "ends in .fmu"),
    ("export_fmu", dict(path="nowhere/axis.fmu"), "make it first", "nowhere"),
    ("export_fmu", dict(path=3.0), "path"),
)


def into(function: Callable[..., Any], file: str, text: str, **sound: Any) -> Callable[..., Any]:
    """A call that writes into a model file with this text."""

    def write(folder: Any, **spoil: Any) -> Any:
        (folder / file).write_text(text)
        return function(**({"result": AXIS, "model": folder / file} | sound | spoil))

    write.needs_folder = True  # type: ignore[attr-defined]
    return write


_SLIDE = '<joint name="{}" type="{}"/>'
_BODY = "<mujoco><worldbody><body>{}</body></worldbody></mujoco>"
_ARM = into(dfc.to_mjcf, "arm.xml", _BODY.format(_SLIDE.format("z", "slide")), load=0.1)
_URDF = into(dfc.to_urdf, "arm.urdf", "<robot>" + _SLIDE.format("z", "prismatic") + "</robot>")
_MO = into(dfc.to_modelica, "Arm.mo", "model Arm SupportFriction z; end Arm;")
_TO_FILES = "to_isaac to_simscape"
_MODELS = {"to_mjcf": _ARM, "to_urdf": _URDF, "to_modelica": _MO, _TO_FILES: None}
for _name, _call in _MODELS.items():
    rows(
        (_name, dict(result=8.0), "a Diagnosis", None, _call),
        (_name, dict(result={}), "by the name of their joint", None, _call),
        (_name, dict(result={3: AXIS}), "must be text", "joint", _call),
        (_name, dict(result={"z": AXIS}, joint="z"), "names its joints itself", "joint", _call),
        (_name, dict(velocities="fast"), "array of numbers", None, _call),
    )
    if _call:
        rows(
            (_name, dict(result={"z": 8.0}), "a Diagnosis", r"result\['z'\]", _call),
            (_name, dict(result={"y": AXIS}), "it has 'z'", "joint 'y'", _call),
            (_name, dict(result=AXIS.replace(units=("rad", "N m"))), "convert", "'z' is in", _call),
            (_name, dict(joint="y"), "it has 'z'", None, _call),
            (_name, dict(velocities=[0.0, 0.0]), "velocities of sliding", None, _call),
            (_name, dict(velocities=[NAN]), "remove or fill", None, _call),
            (_name, dict(out=3), "path of a file", None, _call),
            (_name, dict(model=3), "path of a", None, _call),
        )
for _name, _file, _text, _says, _mend in (
    ("to_mjcf", "arm.xml", "<robot/>", "arm.xml", "not <mujoco>"),
    ("to_mjcf", "arm.xml", "<mujoco", "arm.xml", "no XML"),
    ("to_mjcf", "arm.xml", '<mujoco><include file="b.xml"/></mujoco>', "arm.xml", "b.xml"),
    ("to_mjcf", "arm.xml", _BODY.format("<joint/>"), "arm.xml", "name them"),
    ("to_mjcf", "arm.xml", _BODY.format(_SLIDE.format("z", "ball")), "'z'", "one axis"),
    ("to_urdf", "arm.urdf", "<mujoco/>", "arm.urdf", "not <robot>"),
    ("to_urdf", "arm.urdf", "<robot/>", "arm.urdf", "prismatic joint"),
    ("to_modelica", "Arm.mo", "model Arm end Arm;", "Arm.mo", "SupportFriction"),
    ("to_modelica", "Arm.mo", "model A SupportFriction z(f_pos=[0, 1", "'z'", "file whole"),
):
    rows((_name, {}, _mend, _says, into(getattr(dfc, _name), _file, _text)))
_VOLTS = AXIS.replace(units=("counts", "V"))
rows(
    ("to_mjcf", dict(stiff=1), "True or False"),
    ("to_mjcf", dict(model="/nowhere/arm.xml"), "no file", "arm.xml", FileNotFoundError),
    ("to_mjcf", dict(load=-0.1), NOT_NEGATIVE, None, _ARM),
    ("to_mjcf", dict(load="light"), NUMBER, None, _ARM),
    ("to_mjcf", dict(load={"y": 0.1}), "one of 'z'", None, _ARM),
    ("to_mjcf", dict(load={"z": NAN}), NUMBER, r"load\['z'\]", _ARM),
    (_TO_FILES, dict(joint=3), "must be text"),
    (_TO_FILES, dict(path=3), "path of a file"),
    ("to_isaac", dict(load=None), "give load"),
    ("to_simscape", dict(result=_VOLTS), "and the axis has units", "units"),
)

# ----------------------------------- batches, identification and diagnosis
_JOINT, _BASE = r"joints\['elbow'\]", "choose from mass"
rows(
    ("run_batch", dict(function=3), "callable"),
    ("run_batch", dict(cases=[1.0]), r"dict\(enumerate"),
    ("run_batch", dict(cases={NAN: 1.0}), "finite numbers, text", "cases"),
    ("run_batch", dict(settings=3), "mapping of names"),
    ("run_batch", dict(settings={"x": X}), "finite numbers", "settings"),
    ("run_batch", dict(store="nowhere/a.jsonl"), "make it first"),
    ("diagnose_batch", dict(records=3), "mapping of names"),
    ("diagnose_batch", dict(records=[X]), "read_record", r"records\[0\]"),
    ("diagnose_joints", dict(joints=3), "mapping of names"),
    ("diagnose_joints", dict(joints={}), "not empty"),
    ("diagnose_joints", dict(joints={"elbow": AXIS}), r"\(axis, records\)", _JOINT),
    ("diagnose_joints", dict(joints={"elbow": ("z", RECORD)}), "FrictionAxis", _JOINT + r"\[0\]"),
    ("diagnose_joints", dict(joints={"elbow": (AXIS, X)}), "read_record", _JOINT + r"\[1\]"),
    ("diagnose_joints", dict(joints={"elbow": (AXIS, [])}), "at least one", _JOINT + r"\[1\]"),
    ("diagnose_joints", dict(tolerance={"mass": 0.0}), POSITIVE),
    ("fit replay diagnose", dict(window=1e-3), "choose between"),
    ("fit replay diagnose diagnose_batch diagnose_joints", dict(window=60.0), "choose|windows"),
    ("fit diagnose", dict(known=("weight",)), _BASE),
    ("fit diagnose", dict(tolerance=3), "such as"),
    ("fit diagnose", dict(tolerance={"mass": -1.0}), "more than zero"),
    ("fit diagnose", dict(tolerance={"weight": 0.1}), _BASE),
    ("fit diagnose", dict(known=("mass",), tolerance={"mass": 0.1}), "in one of the two"),
    ("fit", dict(record=[]), "at least one Record", "record"),
    ("fit", dict(record="run.csv"), "read_record", "got 'run.csv'"),
    ("fit", dict(free=()), "at least one parameter"),
    ("fit", dict(free=("masss",)), "choose from|did you mean"),
    ("fit", dict(free=("mass", "mass")), "more than once"),
    ("fit", dict(free=Each((3,), 3)), "names such as"),
    ("fit", dict(free=("spring.mass",)), "it has"),
    ("fit", dict(free=("cogging",)), "neutral", "cogging"),
    ("fit", dict(free=("coulomb", "coulomb_plus")), "one or the other"),
    ("Fit.bootstrap", dict(repeats=0), "at least 1"),
    ("Fit.plot Experiment.plot", dict(ax=3), "2 axes"),
    ("replay_loop", dict(record=dfc.Record(T, U, X)), "reference"),
    ("replay_loop slow_ramp_experiment", dict(controller=SLOWER), "agree"),
    ("identify_coulomb", dict(degree=Each(-1, 99, 1.5, "one")), "whole number from 0"),
    ("identify_stribeck", dict(free=3), "names such as"),
    ("slow_ramp_experiment", dict(axis=AXIS.replace(travel=None)), "give travel", "travel"),
    ("slow_ramp_experiment", dict(duration=2e-3), "longer|samples"),
    ("slow_ramp_experiment", dict(duration=1e12), "samples"),
    ("diagnose", dict(window=0.5), "shorter window"),
    ("diagnose", dict(record=[]), "at least one", "list of records"),
    ("diagnose", dict(on_update=True), "function of a step"),
    ("next_experiment", dict(rivals=3), "sequence of FrictionAxis"),
    ("next_experiment", dict(rivals=["a"]), "FrictionAxis"),
    ("next_experiment", dict(names=Each(["a"], ["a", "a"])), "2 different names"),
    ("next_experiment", dict(names=Each(3, ["a", 3])), "names"),
    ("next_experiment", dict(limits=3), "Limits"),
    ("Experiment.to_csv", {}, "read its description", "no reference"),
)
for _limit, _mend in (
    (dict(travel=(1.0, 0.0)), "low to high"),
    (dict(travel=3.0), "low, high"),
    (dict(drive=0.0), "more than zero"),
    (dict(speed=NAN), "finite"),
):
    _given = dict(travel=(0.0, 1.0), drive=1.0, speed=1.0) | _limit
    _call = functools.partial(Limits, **_given)  # type: ignore[arg-type]
    rows(("next_experiment", {}, _mend, f"limits.{next(iter(_limit))}", _call))


# ---------------------------------------- arguments that mean the same everywhere
SAMPLES = (
    ([], "at least one sample"),
    ([[0.0, 1.0]], r"shape \(n,\)"),
    (nan_at(U), "index 7"),
    ("012", "array of numbers"),
)
EVERYWHERE: dict[str, tuple[tuple[Any, str], ...]] = {
    "axis": (("z", "FrictionAxis"), (2.0, "FrictionAxis")),
    "controller": ((400.0, "PositionController"),),
    "design": ((AXIS, "design_pi_observer"), (3, "design_pi_observer")),
    "record": ((X, "Record"), (3, "Record")),
    "reference": SAMPLES,
    "hold": (("second", '"zero" or "first"'), (0, '"zero" or "first"')),
    "seed": ((-1, "seed"), ("x", "seed")),
    "starts": ((0, "at least 1"), (1.5, "whole number"), ("two", "whole number")),
    "jobs": ((0, "whole number"), ("all", "whole number"), (True, "whole number")),
    "store": ((3, "path of a file"), (".", "name a file in it")),
    "switching": (("printed", "one of|filippov"), (None, "one of|filippov")),
    "known": ((3, "names such as"), (("weight",), "choose from")),
    "level": ((0.0, "between 0 and 1"), (90.0, "between 0 and 1"), (NAN, "between|finite")),
    "travel": ((0.3, r"\(low, high\)"), ((0.3, 0.0), "low to high"), ((0.0, NAN), "finite")),
    **dict.fromkeys(("dt", "bandwidth", "time_limit", "duration"), KINDS["positive"]),
    "limit": ((NAN, "number"), ("5 N", "number"), (0.0, POSITIVE), (-1.0, POSITIVE)),
    **dict.fromkeys(("quantum", "encoder_quantum"), KINDS["not_negative"]),
    **dict.fromkeys(("x0", "v0", "xhat0", "vhat0", "what0"), FINITE),
}


def arguments(name: str) -> Iterable[str]:
    """Names of the arguments of a public function, class or method."""
    first, *rest = name.split(".")
    thing = PUBLIC.get(first) or getattr(dfc, first, None)
    thing = functools.reduce(getattr, rest, thing) if thing else SOUND[name][0]
    return inspect.signature(thing).parameters.keys()


# Records check their columns by rules of their own; a log must be there first.
OTHERWISE = {"Record", "Record.from_irregular", "Record.split_at_gaps", "read_bam", "Saturation"}
# Kept by axis and dt, so that 1.0 and True are one; dt = 0 is continuous time.
OTHERWISE |= {"FrictionAxis.arrays", "FrictionAxis.mode_ss"}
rows(
    *(
        (name, {argument: bad}, mend)
        for name in SOUND
        if name not in OTHERWISE
        for argument, table in EVERYWHERE.items()
        if argument in arguments(name)
        for bad, mend in table
    ),
    *(("FrictionAxis.simulate Law observe", dict(u=bad), mend) for bad, mend in SAMPLES),
    *(("observe", dict(y=bad), mend) for bad, mend in SAMPLES),
)


# -------------------------------------------------------------------- tests


@contextlib.contextmanager
def no_work(patch: pytest.MonkeyPatch) -> Iterator[None]:
    """Nothing is simulated, solved or fitted inside."""

    def refuse(*_: Any, **__: Any) -> Any:
        raise AssertionError("work began before the arguments were looked at")

    with patch.context() as here:
        for room, name in (
            (axis_step, "run"),
            (axis_step, "step"),
            (loops, "run_loop"),
            (windows, "free_runs"),
            (runtime.kernel, "run"),
            (synthesis, "certified_solution"),
            (joblib.Parallel, "__call__"),
        ):
            here.setattr(room, name, refuse)
        yield


def shown(value: Any) -> set[str]:
    """Ways in which a message may show a value; empty if it is too long to be shown."""
    if isinstance(value, float) and not isinstance(value, np.floating):
        return {repr(value), f"{value:g}", "float"}
    if isinstance(value, (bool, str)) or (isinstance(value, int) and abs(value) < 10**20):
        return {str(value), type(value).__name__}
    return set()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("bad_input")


@pytest.mark.parametrize("case", CASES, ids=str)
def test_error_names_argument_value_and_mend(case, folder, monkeypatch):
    call, sound = SOUND[case.name]
    arguments = sound | case.spoil
    if case.call is not None:
        call, arguments = case.call, dict(case.spoil)
        if hasattr(call, "needs_folder"):
            arguments["folder"] = folder
    design()  # made before anything is forbidden
    if case.name.startswith("Fit."):
        fitted()
    monkeypatch.chdir(folder)
    before = sorted(folder.iterdir())
    with no_work(monkeypatch), pytest.raises(case.kind) as caught:
        call(**arguments)
    text = str(caught.value)
    first = next(iter(case.spoil), None)
    says = str(first) if case.says is None else case.says
    assert re.search(says, text), f"{text!r} does not name {says}"
    assert re.search(case.mend, text), f"{text!r} does not say {case.mend!r}"
    if len(case.spoil) == 1 and case.says is None and case.kind is ValueError and first != "ax":
        ways = shown(case.spoil[first])
        assert not ways or any(way in text for way in ways), f"{text!r} does not show {ways}"
    assert len(text) < 1000
    if case.name in ("read_axis", "load_design"):
        assert re.search(r"\w\.(toml|json)", text) or case.spoil == dict(path=3)
    if case.call is None:
        assert sorted(folder.iterdir()) == before


def test_sound_calls_are_sound():
    """What a row spoils works unspoiled, so that the row fails for its own reason."""
    files = "read_ load_ write_ to_csv from_f .save fit presets datasets Fit export_ to_"
    slow = "diagnose next_experiment identify_ slow_ramp monte_carlo design_pi plot Simulation"
    for name, (call, arguments) in SOUND.items():
        if not any(word in name for word in f"{files} {slow}".split()):
            call(**arguments)


def test_every_public_name_is_in_the_table():
    names = {case.name for case in CASES}
    named = {name.split(".")[0] for name in names}
    assert set(PUBLIC) - named <= NOTHING_TO_SPOIL
    assert not NOTHING_TO_SPOIL & named
    assert set(SOUND) == names


def test_every_argument_is_in_the_table():
    """Each argument of each public function is spoiled at least once."""
    # Blocks hand their name to python-control; `progress` is asked for its truth alone.
    free = {"progress", "name"}
    # Made by the package: the table spoils the arguments of their methods.
    made = {"SimulationResponse", "Events", "Fit", "Experiment", "ObserverDesign", "Law"}
    elsewhere = {"register_effect.cls", "write_axis.path"}
    missing = set()
    for name in set(PUBLIC) - NOTHING_TO_SPOIL - made:
        thing = PUBLIC[name]
        if callable(thing):
            spoiled = {key for case in CASES if case.name == name for key in case.spoil}
            asked = set(inspect.signature(thing).parameters) - free - spoiled
            missing |= {f"{name}.{argument}" for argument in asked}
    assert missing == elsewhere


# ------------------------------------------------------------------ warnings

CLIPPED = np.clip(40.0 * np.sin(30.0 * T) + 5.0 * np.sin(211.0 * T), -20.0, 20.0)
JUMP = np.where(np.arange(N) == 900, X + 0.9 * np.ptp(X), X)
STRETCHES = (np.arange(N) < 700) | (np.arange(N) > 1994)
CONTACT = AXIS.replace(effects=fx.Presliding(1e-5))
COUNTS = "one count in m, not a number of counts"
SUSPECT: dict[str, tuple[Callable[..., Any], tuple[Any, ...], str]] = {
    "time in ms": (dfc.Record, (1e3 * T, U, X), "milliseconds.*t \\* 0.001"),
    "time in us": (dfc.Record, (1e6 * T, U, X), "microseconds.*t \\* 1e-06"),
    "input clipped": (dfc.Record, (T, CLIPPED, X), "clipped.*force that acted"),
    "glitch": (dfc.Record, (T, U, JUMP), "masked: 1 jump"),
    "irregular time in ms": (dfc.Record.from_irregular, (1e3 * T, U, X), "milliseconds"),
    "mapping, ms": (dfc.read_record, ({"t": 1e3 * T, "u": U, "x": X},), "milliseconds"),
    "short stretches lost": (
        dfc.Record.split_at_gaps,
        tuple(a[STRETCHES] for a in (T, U, X)),
        "5 samples .* left out",
    ),
    "observer leaves out": (dfc.design_pi_observer, (CONTACT, DT), "leaves out presliding"),
    "observer, counts for metres": (
        functools.partial(dfc.design_pi_observer, encoder_quantum=1.0),
        (AXIS, DT),
        COUNTS,
    ),
    "filter, counts for metres": (dfc.hybrid_filter, (AXIS, DT, 1.0), COUNTS),
    "compensation, counts for metres": (dfc.design_compensation, (AXIS, DT, 1.0), COUNTS),
}


@pytest.mark.filterwarnings("ignore:x jumps")  # the stretch cut out of one of them
@pytest.mark.parametrize("case", SUSPECT)
def test_suspect_input_brings_a_warning(case):
    call, arguments, words = SUSPECT[case]
    with pytest.warns(UserWarning, match=words):
        call(*arguments)
