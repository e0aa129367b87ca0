"""Bad input, one table for every public name.

A row is a public name, the argument to spoil, what to put there, and a word of the mend.  The
error must name the argument (or what the row says in its place), show the value where it is one
number or word, say the mend, and come before any work is done.  Suspicious input that can be
used is in a table of its own: it brings a warning that says the same.
"""

import contextlib
import dataclasses
import functools
import importlib.util
import inspect
import itertools
import math
import re
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import control as ct
import damage
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
from dryfric_control.observer import synthesis
from dryfric_control.observer.base import Kernel

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
RECORD = dfc.Record(T, U, X, 1.1 * X, channels={"v": np.gradient(X, DT)})
CONTROLLER = dfc.PositionController(kp=400.0, ki=0.0, kd=40.0, dt=DT)
SLOWER = dataclasses.replace(CONTROLLER, dt=2e-3)
DESIGN = dfc.design_pi_observer(AXIS, DT, encoder_quantum=1e-6)
with warnings.catch_warnings(action="ignore", category=dfc.FitWarning):
    FIT = dfc.fit(AXIS, RECORD, free=("coulomb",), starts=1)
PLAN = Experiment(
    name="change_of_bench", title="a change of the bench", description="turn it", score={}, tried={},
    cause="coulomb", units=("m", "N"),
)  # fmt: skip
HUGE = 10**400  # a whole number that no float holds


def nan_at(array: Any, place: int = 7) -> Any:
    """The array with one bad value."""
    spoiled = np.array(array, dtype=float)
    spoiled[place] = NAN
    return spoiled


class Magnet(fx.Effect):
    """An effect of a user's own, sound but for what a row spoils."""

    slug = "magnet"
    action = "force"

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return 0.0


def magnet(**changes: Any) -> Any:
    return fx.register_effect(type("Magnet", (Magnet,), changes))


PUBLIC = {
    name: getattr(space, name)
    for space in (dfc, dfc.effects, dfc.laws, dfc.simulators)
    for name in space.__all__
    if name not in ("datasets", "drawing", "effects", "laws", "observer", "presets", "simulators")
}
for _name in ("ObserverStepper", "observed_loop", "simulate_observed_loop"):
    PUBLIC[_name] = getattr(dfc.observer, _name)

# An arm of one joint, and a log of it.
ARM = importlib.util.find_spec(
    "mujoco"
) and dfc.arm.rigid_model._import_mujoco().MjModel.from_xml_string(
    '<mujoco><worldbody><body name="a"><joint name="elbow" axis="0 0 1"/>'
    '<inertial pos="0 0 0" mass="1" diaginertia="2 2 2"/></body></worldbody></mujoco>'
)
ARM_LOG = {"t": T, "elbow.effort": U, "elbow.position": X}

# Names that take nothing from a user: errors and warnings, and objects that the package makes,
# whose methods take no argument or are in the table under the name of the function.
NOTHING_TO_SPOIL = {"__version__", "CertificateError", "Compensation", "MotionProfile", "Inner"}
NOTHING_TO_SPOIL |= {"FitWarning", "RecordWarning", "Slopes", "Interval", "Box"}
NOTHING_TO_SPOIL |= set() if ARM else {"arm_records", "diagnose_arm"}
# Made by the package: the table spoils the arguments of their methods.
GIVEN = {"SimulationResponse", "Events", "Diagnosis", "Fit", "Experiment", "ObserverDesign", "Law"}

#: Sound values of the arguments that must be given, by their names.
USUAL: dict[str, Any] = {
    **dict.fromkeys(("axis", "obj", "result"), AXIS),
    **dict(record=RECORD, records=[RECORD], design=DESIGN, controller=CONTROLLER, dt=DT),
    **dict(t=T, u=U, x=X, y=X, positions=X, reference=[0.0, 0.1], points=[0.0, 0.1]),
    **dict(mass=2.0, viscous=15.0, coulomb=8.0, plus=8.0, excess=0.3, speed=0.01, band=1e-3),
    **dict(stiffness=1e5, damping=100.0, quantum=1e-6, bandwidth=20.0, gain=2.0, duration=5.0),
    **dict(kp=400.0, ki=0.0, kd=40.0, velocity=0.1, acceleration=1.0, jerk=50.0, seconds=0.5),
    **dict(direction=1, index=1, mode=1, before=0, after=1, parts=2, factor=2, name="v"),
    **dict(unit="N", doc="force", frame={}, data={}, source={"t": T, "u": U, "x": X}),
    **dict(path="/nowhere/axis.toml", model="/nowhere/arm.xml", folder="new"),
    **dict(rng=np.random.default_rng(0), function=math.sqrt, cases={"a": 4.0}),
    **dict(joints={"elbow": (AXIS, RECORD)}, rivals=[AXIS.replace(mass=2.5)]),
}
#: Further arguments of a sound call.
FURTHER: dict[str, dict[str, Any]] = {
    **{name: dict(progress=False) for name in ("diagnose_batch", "diagnose_joints", "run_batch")},
    "monte_carlo": dict(quantum=1e-6, stribeck_speed=0.01, runs=2, progress=False),
    "FrictionAxis.mode_ss": dict(dt=DT), "AxisStepper.step": dict(u=0.0), "observe": dict(u=U, y=X),
    "ObserverStepper.step": dict(u=0.0, y=0.0), "export_fmu": dict(path="axis.fmu"),
    "sampled": dict(controller=ct.tf([1.0], [1.0, 1.0])),
    "to_isaac": dict(load=0.0), "arm_records": dict(model=ARM, log=ARM_LOG),
    "diagnose_arm": dict(model=ARM, log=ARM_LOG, progress=False),
}  # fmt: skip
CALLS: dict[str, Callable[..., Any]] = {
    **{n: one for n, one in PUBLIC.items() if n not in NOTHING_TO_SPOIL | GIVEN and callable(one)},
    **{
        f"{type(one).__name__}.{name}": getattr(one, name)
        for one, names in (
            (AXIS, "replace arrays breakaway simulate stepper mode mode_ss"),
            (AxisStepper(AXIS, DT), "step"),
            (dfc.CoulombMap(8.0), "__call__ scaled"),
            (CONTROLLER, "from_bandwidth memory"),
            (RECORD, "from_irregular split_at_gaps from_frame window split blocks decimated"),
            (RECORD, "resampled save commanded derivatives to_csv plot read compare"),
            (dfc.Scaling(), "of from_dict from_file"),
            (DESIGN, "mode_matrices error_dynamics save load"),
            (dfc.observer.ObserverStepper(DESIGN), "step"),
            (FIT, "interval bootstrap replay save load plot"),
            (PLAN, "to_csv plot"),
        )
        for name in names.split()
    },
    **{
        f"presets.{name}": getattr(presets, name)
        for name in "clutch_observer clutch_controller crawl_and_steps clutch_experiment "
        "clutch_monte_carlo".split()
    },
    "AxisStepper": AxisStepper,
    "SimulationResponse": RUN.plot,
    "Events": RUN.events.times,
    "Law": dfc.laws.Sign().run,
    "Effect": fx.Spring,
    "register_effect": magnet,
    "datasets.emps": dfc.datasets.emps,
    "Diagnosis.load": dfc.Diagnosis.load,
}


def sound(name: str, call: Callable[..., Any]) -> dict[str, Any]:
    """Arguments of a sound call: what the rows below spoil, one at a time."""
    asked = inspect.signature(call).parameters.values()
    needed = {one.name for one in asked if one.default is one.empty}
    return {key: USUAL[key] for key in needed & USUAL.keys()} | FURTHER.get(name, {})


SOUND = {name: (call, sound(name, call)) for name, call in CALLS.items()}


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
        shown = ",".join(f"{key}={value!r:.30}" for key, value in self.spoil.items())
        return f"{self.name}({shown or self.mend})"


CASES: list[Case] = []


class Each(tuple[Any, ...]):
    """Values of an argument that are refused alike."""

    def __new__(cls, *values: Any) -> "Each":
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

    return read


def columns(*arrays: Any, heading: str = "t,u,x") -> str:
    return "\n".join([heading, *(",".join(map(str, row)) for row in zip(*arrays, strict=True))])


NUMBER = "must be a (finite )?number|must be finite|not finite"
POSITIVE, NOT_NEGATIVE = "more than zero|positive", "zero or more|more than zero|positive"


# ------------------------------------------------------------------ numbers
_FEW = Each(-1.0, 0.0)
_NUMBERS = Each(NAN, INF, "1 m", True)
rows(
    ("CoulombMap", dict(plus=_NUMBERS), NUMBER), ("CoulombMap", dict(minus=_NUMBERS), NUMBER),
    ("motion_profile", dict(points=_NUMBERS), NUMBER), ("to_isaac", dict(load=_NUMBERS), NUMBER),
    ("read_record Scaling.of", dict(gain=_NUMBERS), NUMBER),
    ("design_pi_observer", dict(uncertainty=_NUMBERS), NUMBER),
    ("Stribeck Tanh", dict(speed=_FEW), POSITIVE), ("Dahl LuGre", dict(stiffness=_FEW), POSITIVE),
    ("Record", dict(unwrap=_FEW), POSITIVE), ("Record.from_irregular", dict(max_gap=_FEW), POSITIVE),
)  # fmt: skip

# -------------------------------------------------------------------- axis
LATE = AXIS.replace(effects=fx.InputDelay(5e-3))
rows(
    ("FrictionAxis", dict(mass=5e-324), "unit"),
    ("FrictionAxis design_pi_observer", dict(coulomb=-8.0), "magnitude"),
    ("FrictionAxis", dict(coulomb=NAN), "finite", "plus"),
    ("FrictionAxis", dict(coulomb=Each(None, True, (), (1.0, 2.0, 3.0))), "a level, a pair"),
    ("FrictionAxis", dict(coulomb=(8.0, NAN)), "finite", "minus"),
    ("FrictionAxis", dict(coulomb=(1.0, -1.0)), "magnitude", "minus"),
    ("FrictionAxis", dict(coulomb=dfc.CoulombMap([1.0, 2.0]), travel=None), "give travel"),
    ("FrictionAxis", dict(coulomb=dfc.CoulombMap([1.0, -2.0]), travel=(0.0, 1.0)), "falls to -1"),
    ("FrictionAxis", dict(coulomb=dfc.CoulombMap([1, -4.2, 4.2]), travel=(0.0, 1.0)), "x = 0.5"),
    ("FrictionAxis", dict(coulomb=dfc.CoulombMap([8.0, 3.0]), travel=(-1e308, 0.3)), "-inf"),
    ("FrictionAxis", dict(stribeck=Each(0.3, (0.3, 0.01))), "dfc.Stribeck"),
    ("FrictionAxis", dict(travel=(0.0, 0.1, 0.2)), r"\(low, high\)"),
    ("FrictionAxis", dict(switching="Filippov"), '"filippov" or "paper"'),
    ("FrictionAxis", dict(effects=Each("spring", (fx.Spring,))), "dfc.effects.Spring"),
    ("FrictionAxis", dict(effects=2 * (fx.InputDelay(0.1),)), "more than one delay"),
    ("FrictionAxis", dict(effects=2 * (fx.Presliding(1e-5),)), "more than one contact"),
    ("FrictionAxis", dict(effects=(fx.Backlash(1e-3, 0.5), fx.Compliance(1e4, 1.0, 0.5))), "one"),
    ("FrictionAxis", dict(effects=(fx.ActuatorLag(0.1), fx.ActuatorLag(0.2))), "add them up"),
    ("FrictionAxis", dict(units=Each("m", ("m", 3), 3)), "position and force"),
    ("FrictionAxis", dict(units=("deg", "Nm")), "converted as they are read", "not in 'deg'"),
    ("FrictionAxis", dict(units=("m", "kN")), "converted as they are read", "not in 'kN'"),
    ("FrictionAxis", dict(units=("N m", "rad")), "position first", "position cannot be in 'N m'"),
    ("FrictionAxis", dict(units=("rad", "N")), '"N m"'),
    ("FrictionAxis.replace", dict(weight=1.0), "has no argument", None, TypeError),
    ("FrictionAxis.breakaway", dict(direction=0), r"\+1 or -1"),
    ("FrictionAxis.breakaway", dict(x=["a"]), "array of numbers"),
    ("FrictionAxis.simulate", dict(u=None), r"array of numbers|shape \(n,\)"),
    ("FrictionAxis.simulate", dict(u=Each([1.0, [2.0]], [0.0, HUGE], {"a": 1.0})), "array of num"),
    ("FrictionAxis.simulate", dict(u=U + 1j), "real part"),
    ("FrictionAxis.simulate", dict(u=np.ma.masked_less([1.0, -1.0], 0.0)), "fill or remove"),
    ("FrictionAxis.simulate", dict(u=np.array(["1", "2"])), "numbers"),
    ("FrictionAxis.simulate", dict(law=Each("lugre", dfc.laws.Sign)), r"dfc.laws.LuGre"),
    ("FrictionAxis.mode", dict(index=Each(2, "+1", [1], True)), "stuck", "mode"),
    ("FrictionAxis.mode_ss", dict(dt=-1.0), NOT_NEGATIVE),
    ("FrictionAxis.mode_ss", dict(index=0, dt=0.01), 'lower dt|method="zoh"', "stick_rate"),
    ("FrictionAxis.mode_ss", dict(at=Each(0.1, (0.1, 0.2, 3.0, 4.0))), "position, veloc", "at"),
    ("FrictionAxis.mode_ss", dict(at=(NAN, 0.1)), NUMBER, "at"),
    ("FrictionAxis.mode_ss", dict(at=(0.0, -0.1)), "sign of the mode", "at"),
    ("CoulombMap", dict(plus=[]), "constant level"),
    ("CoulombMap", dict(plus=[8.0, NAN]), "finite", r"plus\[1\]"),
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
_EXCHANGED = dict(dt=1e-6, encoder_quantum=DT)
rows(
    ("PositionController", dict(span=Each(0, 9, 2.5, "2", True)), "1 to 8"),
    ("PositionController.from_bandwidth position_controller", dict(bandwidth=500.0), "below 0.2"),
    ("simulate_loop", dict(reference=0.1), r"shape \(n,\)", "reference"),
    ("simulate_loop", dict(disturbance=[0.0]), "one for each"),
    ("simulate_loop", dict(disturbance=[0.0, NAN]), "fill"),
    ("switched_axis supervisor", dict(axis=LATE), "axis_block", "input_delay"),
    ("reference_filter", dict(bandwidth=4000.0), "lower it"),
    ("reference_filter", dict(order=Each(0, 2.5, "two", [2])), "1 to 8"),
    ("encoder", dict(quantum=DT, dt=1e-6), "give both by name", "quantum = 0.001 and dt = 1e-06"),
    ("hybrid_filter design_compensation", _EXCHANGED, "encoder_quantum=1e-06"),
    ("reference_filter", dict(bandwidth=DT, dt=20.0), "bandwidth=20, dt=0.001"),
    ("position_controller", dict(bandwidth=DT, dt=5.0), "bandwidth=5, dt=0.001"),
    ("plot_state_machine", dict(ax=[1, 2]), "1 axes"),
    ("plot_state_machine", dict(ax="here"), "Axes"),
    ("SimulationResponse", dict(ax=[1.0]), "3 axes"),
    ("SimulationResponse", dict(ax=["a", "b", "c"]), "Axes"),
    ("Events", dict(before=2), r"0 \(stuck\)"),
    ("Events", dict(after=Each("stuck", [])), r"0 \(stuck\)"),
)

# ----------------------------------------------------------------- effects
rows(
    ("parameter", dict(bounds=Each((1.0, 0.0), (NAN, 1.0))), "low to high"),
    ("parameter", dict(bounds=3.0), r"\(low, high\)"),
    ("parameter", dict(bounds=(0.0, 1.0), default=2.0), "bounds", "default"),
    ("Effect", dict(stiffness=None), NUMBER, "spring.stiffness"),
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
        for _end, _beyond in zip(_ends, (-INF, INF), strict=True):
            if math.isfinite(_end):
                _out = math.nextafter(_end, _beyond)
                rows((_cls.__name__, {_name: _out}, "must lie between", _says))
# ------------------------------------------------------------------ records
KEPT = np.delete(np.arange(N), range(700, 720))  # 20 samples dropped
rows(
    ("Record", dict(reference=X[:9]), "one length"),
    ("Record", dict(good=[True, False]), "one for each reading", "good"),
    ("Record", dict(good=np.zeros(N, bool)), "at least", "good"),
    ("Record", dict(good=X), "True or False", "good"),
    ("Record", dict(units={"x": "MM"}), "Did you mean 'mm'", "'MM' of x"),
    ("Record", dict(units={"x": "N"}), "check the columns", "x cannot be in 'N'"),
    ("Record", dict(u=U > 0), "astype", "u holds true and false"),
    ("Record", dict(t=T[::-1]), "sort the samples", "t goes back 1999 times"),
    ("Record", dict(x=X[:5]), "one length", "x has 5 samples but t has 2000"),
    ("Record", dict(quantum=1e50), "in the unit of x", "quantum"),
    ("Record", dict(unwrap=1e-9), "period of the encoder", "unwrap"),
    ("Record", dict(channels={"w": X}), "known are v, a, x2", "channels"),
    ("Record", dict(channels={"v": X[:5]}), "one length", "channels"),
    ("Record", dict(load=X[:5]), "one length", "load has 5 samples"),
    ("Record", dict(raw={"x": "counts"}), "unit and a factor", "raw"),
    ("Record", dict(raw={"x": ("counts", NAN)}), "finite", "raw"),
    ("Record", dict(notes="filtered"), "sequence"),
    ("Record.from_irregular", dict(t=T[::-1]), "sort the samples"),
    ("Record.from_irregular", dict(dt=Each(1e-12, 10.0)), "samples of 1.999 s; it takes"),
    ("Record.from_irregular", dict(t=T[KEPT], u=U[KEPT], x=X[KEPT]), "max_gap=", "gap"),
    ("Record.from_irregular", dict(x=np.full(N, np.nan)), "remove"),
    ("Record.from_irregular", dict(x=np.where(T < 1.0, np.nan, X)), "too many", "rows"),
    ("Record.from_irregular", dict(good=[True]), "one for each reading", "good"),
    ("Record.from_irregular", dict(colour="red"), "has no argument", None, TypeError),
    ("Record.split_at_gaps", dict(t=T[::-1]), "sort"),
    ("Record.split_at_gaps", dict(x=nan_at(X)), "remove"),
    ("Record.from_frame", dict(frame=Each([1, 2], X)), "data frame"),
    ("Record.window", dict(t0=4.0, t1=1.0), "exchange them", "t0 = 4 s is after t1 = 1 s"),
    ("Record.window", dict(t0=Each(NAN, 90.0)), "record runs from", "window"),
    ("Record.split", dict(parts=Each(0, 5000)), "parts of 2 or more"),
    ("Record.split", dict(parts=Each(-0.5, [0.5, 0.6], NAN)), "positive with sum 1", "fractions"),
    ("Record.split", dict(parts=Each(1.5, 60.0)), "0.6 for 60 %", "split"),
    ("Record.split", dict(parts=True), "fraction", "split"),
    ("Record.split", dict(parts="half"), "convert it", "fractions"),
    ("Record.split", dict(parts=[0.9999, 0.0001]), "at least 2", "holds"),
    ("Record.split", dict(parts=[]), "empty", "fractions"),
    ("Record.blocks", dict(seconds=1e-3), "fewer than 2", "0.001"),
    ("Record.decimated", dict(factor=0), "at least 1"),
    ("Record.decimated", dict(factor=N), "fewer than 2", "2000"),
    ("Record.resampled", dict(dt=5.0), "it takes"),
    ("Record.commanded", dict(gain=0.0), "more than zero|positive"),
    ("Record.derivatives", dict(window=Each(4, 5.0, True)), "odd"),
    ("Record.derivatives", dict(window=Each(3, 9999)), "at least 5 and at most"),
    ("Record.read", dict(positions=X[:5]), "give one each", "positions"),
    ("Record.read", dict(positions=nan_at(X)), "remove these samples", "positions"),
    ("Record.compare", dict(name="w"), "it has v", "'w'"),
    ("Record.compare", dict(name=[]), "must be text"),
    ("Record.read", dict(rng=3), "default_rng"),
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
    ("read_record", dict(columns={"t": "zeit"}), "available"),
    ("read_record", dict(columns={"time": "t"}), "roles"),
    ("read_record", dict(columns={"t": 9}), "0 to 2"),
    ("read_record", dict(columns={"t": "u"}), "serves as both", "column"),
    ("read_record", dict(columns={"t": 1.5}), "name or an index"),
    ("read_record", dict(columns={"referense": "x"}), "Did you mean 'reference'"),
    ("read_record", dict(columns={"x": None}), "column of velocity", "x"),
    ("read_record", dict(units={"t": "fortnight"}), "use s, ms", "fortnight"),
    ("read_record", dict(units={"x": "Ft"}), "Did you mean 'ft'", "'Ft' of x"),
    ("read_record", dict(max_rows=0), "positive"),
    ("read_record", dict(max_rows=100), "max_rows=", "rows"),
    ("read_record", dict(rate=1e3), "leave rate= out", "column of time"),
    ("read_record", dict(rate=1e3, dt=1e-3), "without a column of time", "rate and dt"),
    ("read_record", dict(max_gap=0.1), "give dt=", "max_gap"),
    ("read_record", dict(dt=1e-3, max_gap=-1.0), "more than zero", "max_gap"),
    ("read_record", dict(gain={"w": 2.0}), "channels are", "'w'"),
    ("read_record", dict(gain={"v": 2.0}), "it has t, u, x", "'v'"),
    ("read_record", dict(joint="elbow"), "available", "joint 'elbow'"),
    ("Scaling", dict(gain={"x": 0.0}), "not zero", "gain"),
    ("Scaling", dict(gain={"x": NAN}), "finite", "gain"),
    ("Scaling", dict(gain={"y": 1.0}), "the channels are", "'y'"),
    ("Scaling", dict(gain={"reference": 2.0}), "takes the gain of x"),
    ("Scaling", dict(torque_constant=1.0, force_constant=1.0), "a motor has one"),
    ("Scaling", dict(rated_torque=1.0, rated_force=1.0), "a motor has one"),
    ("Scaling", dict(lead=0.1, pinion_radius=0.02), "an axis has one"),
    *(("Scaling", {name: 0.0}, "more than zero") for name in _MOTOR.split()),
    ("Scaling.from_dict", dict(data={3: 4}), "counts_per_turn", "record.3"),
    ("Scaling.from_dict", dict(data={"counts_per_trun": 1}), "'counts_per_turn'", "record.counts_"),
)
files(
    "read_record",
    ("two.csv", columns(T[:20], U[:20], heading="t,u"), "two.csv", "at least t, u and x"),
    ("huge.csv", columns(T, U, X), "huge.csv", "max_rows=", dict(max_rows=1000)),
    ("long.csv", b"t,u,x\n" + b"1" * 1_100_000, "line 2", "too long"),
    ("wide.csv", "t,u,x\n0,0,0\n".encode("utf-16")[:-1], "wide.csv", "plain text"),
    ("run.xlsx", "t", "run.xlsx", "no .xlsx file"),
    ("run.xls", "t", "run.xls", "or CSV"),
    ("run.foo", "t", "run.foo", "save it as CSV"),
    ("none.mat", "MATLAB 5.0", "none.mat", "no MAT-file"),
    ("v73.mat", b"MATLAB 7.3 MAT-file" + bytes(200), "v73.mat", "-v7"),
    ("names.mat", {"a": T, "b": U}, "names.mat", "columns="),
    ("words.mat", {"t": "abc"}, "words.mat", "no numeric variable"),
    ("table.mat", {"t": T, "u": np.zeros((50, 40, 2)), "x": X}, "u", "1-D"),
)
files(
    "read_bam",
    ("torn.log", damage.bam_log()[:-40], "torn.log", "JSON"),
    ("none.log", '{"entries": []}', "none.log", "entries"),
    ("bare.log", '{"entries": [1]}', "entry 0", "not a number"),
    ("step.log", damage.bam_log(), "dt", "more than zero", dict(dt=0.0)),
)
files(
    "load_record", ("m4.csv", columns(T[:9], U[:9], X[:9]), "m4.csv is no JSON", "by read_record")
)
files("datasets.emps", ("emps.csv", columns(T, U, X), "not the EMPS record", "read_record"))
TOML = "mass = 2.0\nviscous = 15.0\ncoulomb = 8.0\n"
HIDDEN = TOML + "[[effects]]\n"
files(
    "read_axis",
    ("empty.toml", "", "empty.toml", "is empty"),
    ("latin.toml", b"name = '\xff'", "latin.toml", "TOML"),
    ("text.toml", TOML.replace("2.0", '"2 kg"'), "mass", NUMBER),
    ("less.toml", TOML.replace("2.0", "-2.0"), "mass", POSITIVE),
    ("date.toml", TOML.replace("2.0", "2026-11-21"), "mass", NUMBER),
    ("digits.toml", TOML.replace("2.0", "9" * 9000), "digits.toml", "digits"),
    ("typo.toml", TOML + "stik_speed = 1e-4", "stik_speed", "stick_speed"),
    ("pair.toml", TOML.replace("8.0", "[8.0]"), "coulomb", "pair"),
    ("lone.toml", TOML.replace("8.0", "{minus = 7.0}"), "coulomb", "lacks plus"),
    ("minos.toml", TOML.replace("8.0", "{plus = 7.0, minos = 7.0}"), "coulomb.minos", "'minus'"),
    ("few.toml", "viscous = 1.0\ncoulomb = 1.0", "mass", "give at least"),
    ("stribeck.toml", TOML + "stribeck = 3.0", "stribeck", "a table such as"),
    ("sped.toml", TOML + "[stribeck]\nexcess = 0.3\nsped = 0.1", "stribeck.sped", "'speed'"),
    ("peak.toml", TOML + "[stribeck]\nexcess = 0.3", "stribeck.speed", "add speed"),
    ("who.toml", HIDDEN + "stiffness = 1.0", r"effects\[0\]", "name the effect"),
    ("other.toml", HIDDEN + 'effect = "sprng"', "sprng", "spring"),
    ("lack.toml", HIDDEN + 'effect = "spring"', "stiffness", "add stiffness"),
    ("more.toml", HIDDEN + 'effect = "bias_force"\nforce = 1\nmass = 2', "mass", "known"),
    ("bound.toml", HIDDEN + 'effect = "input_delay"\ndelay = -1.0', "delay", "between"),
    ("flat.toml", TOML + "effects = 3", "effects", r"\[\[effects\]\]"),
)
for _names, _file in (
    ("read_axis Scaling.from_file", "axis.toml"), ("datasets.emps", "DATA_EMPS.mat"),
    ("read_bam ObserverDesign.load Fit.load", "a.json"),
    ("load_record Diagnosis.load load_compensation", "b.json"),
):  # fmt: skip
    rows((_names, dict(path=f"/nowhere/{_file}"), "no file", _file, FileNotFoundError))
rows(
    ("read_record", dict(source="/nowhere/run.csv"), "no file", "run.csv", FileNotFoundError),
    ("read_record", dict(source="a\0b.csv"), "no file", "a", FileNotFoundError),
    ("read_record", dict(source="/"), "give one file in it", "directory", IsADirectoryError),
    ("read_record", dict(source=Each(3, None, [T, U, X])), "path, a data frame"),
    ("write_axis ObserverDesign.save", {}, "axis.toml", "nowhere", FileNotFoundError),
    ("Record.to_csv", dict(path="/nowhere/run.csv"), "make it", "/nowhere", FileNotFoundError),
)

# ----------------------------------------------------------------- observer
_SMOOTH = AXIS.replace(coulomb=0.0)
rows(
    ("design_pi_observer", dict(dt=1.0, discretization="euler"), "lower dt", "dt"),
    ("design_pi_observer", dict(uncertainty=0.0), "small force", "uncertainty is zero"),
    ("design_pi_observer", dict(uncertainty={0: 1.0}), "name the modes"),
    ("design_pi_observer", dict(uncertainty={0: 1.0, 1: NAN, -1: 1.0}), "finite"),
    ("design_pi_observer", dict(decay=Each(0.0, 1.5)), "above 0"),
    ("design_pi_observer", dict(performance=Each((1.0, 2.0), 3.0)), "three weights"),
    ("design_pi_observer", dict(performance=(0.0, 0.0, 0.0)), "not all zero"),
    ("design_pi_observer", dict(performance=(1.0, -1.0, 0.0)), NOT_NEGATIVE),
    ("design_pi_observer", dict(window=2), "use 'path'"),
    ("design_pi_observer", dict(method="path", window=Each(0, 65)), "1 to 64", "window"),
    ("design_pi_observer", dict(refine=-1), "at least 0"),
    ("design_pi_observer", dict(method="paper", refine=1), "0 for 'paper'", "refine"),
    ("design_pi_observer", dict(pairs=[(0, 3)]), "modes 0, 1, -1"),
    ("design_pi_observer", dict(pairs=3), "changes of mode"),
    ("design_pi_observer", dict(coulomb="8"), "level"),
    ("design_pi_observer", dict(integral_modes=(0, 2)), r"must be 0 \(stuck\), \+1 or -1", "mode"),
    ("design_pi_observer", dict(integral_modes=3), "modes"),
    ("design_pi_observer", dict(integral_modes=(0,)), "integral_modes", "detectable"),
    ("design_pi_observer", dict(axis=_SMOOTH), "amplitude", "uncertainty has no default"),
    ("design_pi_observer", dict(encoder_quantum=1e-6, noise=HUGE), NUMBER, "noise"),
    ("hybrid_filter", dict(axis=_SMOOTH), "design_pi_observer", "no Coulomb friction"),
    ("design_compensation", dict(bandwidth=1e6), "too high"),
    ("design_compensation", dict(gains=Each(3.0, (1.0, 2.0))), "kp, ki, kd"),
    ("design_compensation", dict(gains=(0.0, 1.0, 1.0)), POSITIVE),
    ("design_compensation", dict(gains=(1e9, 1.0, 1.0)), "lower", "unstable"),
    ("design_compensation", dict(limit=5.0), "breakaway friction force"),
    ("design_compensation", dict(mismatch=1.0), "below 1"),
    ("observe", dict(u=[0.0]), "one of each", "u"),
    ("observed_loop simulate_observed_loop", dict(bandwidth=9000.0), "lower it"),
    ("observed_loop simulate_observed_loop monte_carlo", dict(controller=SLOWER), "one sampling"),
    ("monte_carlo", dict(runs=0), "at least 1"),
    ("monte_carlo", dict(estimators={}), "at least one"),
    ("monte_carlo", dict(estimators={"a": 3}), "estimate"),
    ("motion_profile", dict(points=[[0.0, 1.0]]), "shape"),
    ("motion_profile", dict(points=1e12), "units of points", "points"),
    ("motion_profile", dict(unit="rad", velocity=0.0), "rad/s", "velocity"),
    ("motion_profile", dict(jerk=1e-30), "check the units", "jerk"),
    ("motion_profile", dict(dwell=-1.0), NOT_NEGATIVE),
    ("motion_profile", dict(dwell=[0.0, 0.0, 0.0]), "one each"),
)

# ------------------------------------------------------ files that are written
_EXPORTS, _NAMED = "export_c export_fmu", AXIS.replace(name="2 x")
rows(
    (_EXPORTS, dict(obj=2.0), "FrictionAxis"),
    (_EXPORTS, dict(name=Each("2 fast", "na\u00efve")), "no C identifier"),
    (_EXPORTS, dict(name=Each("switch", "dfc_axis")), "taken in C"),
    (_EXPORTS, dict(obj=_NAMED), r"pass name=.* or axis.replace\(name=", "2_x"),
    (_EXPORTS, dict(obj=AXIS.replace(effects=fx.InputDelay(30.0))), "late by", "30 s"),
    ("export_fmu", dict(name="model"), "is that of a file in every FMU"),
    ("export_fmu", dict(path="axis.zip"), "ends in .fmu"),
    ("export_fmu", dict(path="nowhere/axis.fmu"), "make it first", "nowhere"),
)


def into(function: Callable[..., Any], file: str, text: str, **sound: Any) -> Callable[..., Any]:
    """A call that writes into a model file with this text."""

    def write(folder: Any, **spoil: Any) -> Any:
        (folder / file).write_text(text)
        return function(**({"result": AXIS, "model": folder / file} | sound | spoil))

    return write


_SLIDE = '<joint name="{}" type="{}"/>'
_BODY = "<mujoco><worldbody><body>{}</body></worldbody></mujoco>"
_ARM = into(dfc.to_mjcf, "arm.xml", _BODY.format(_SLIDE.format("z", "slide")), load=0.1)
_URDF = into(
    dfc.simulators.to_urdf, "arm.urdf", "<robot>" + _SLIDE.format("z", "prismatic") + "</robot>"
)
_MO = into(dfc.simulators.to_modelica, "Arm.mo", "model Arm SupportFriction z; end Arm;")
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
    ("to_mjcf", dict(model="/nowhere/arm.xml"), "no file", "arm.xml", FileNotFoundError),
    ("to_mjcf", dict(load=-0.1), NOT_NEGATIVE, None, _ARM),
    ("to_mjcf", dict(load={"y": 0.1}), "one of 'z'", None, _ARM),
    ("to_mjcf", dict(load={"z": NAN}), NUMBER, r"load\['z'\]", _ARM),
    ("to_isaac", dict(load=None), "give load"),
    ("to_simscape", dict(result=_VOLTS), "and the axis has units", "units"),
)

# ----------------------------------- batches, identification and diagnosis
_JOINT, _BASE = r"joints\['elbow'\]", "choose from mass"
_LIMITS = functools.partial(Limits, travel=(0.0, 1.0), drive=1.0, speed=1.0)
rows(
    ("run_batch", dict(function=3), "callable"),
    ("run_batch", dict(cases=[1.0]), r"dict\(enumerate"),
    ("run_batch", dict(cases={NAN: 1.0}), "finite numbers, text", "cases"),
    ("run_batch", dict(settings={"x": X}), "finite numbers", "settings"),
    ("run_batch", dict(store="nowhere/a.jsonl"), "make it first"),
    ("diagnose_batch", dict(records=3), "mapping of names"),
    ("diagnose_batch", dict(records=[X]), "read_record", r"records\[0\]"),
    ("diagnose_joints", dict(joints=Each(3, {})), "mapping of names .*not empty"),
    ("diagnose_joints", dict(joints={"elbow": AXIS}), r"\(axis, records\)", _JOINT),
    ("diagnose_joints", dict(joints={"elbow": ("z", RECORD)}), "FrictionAxis", _JOINT + r"\[0\]"),
    ("diagnose_joints", dict(joints={"elbow": (AXIS, X)}), "path of its file", _JOINT + r"\[1\]"),
    ("diagnose_joints", dict(joints={"elbow": (AXIS, [])}), "at least one", _JOINT + r"\[1\]"),
    ("diagnose_joints", dict(tolerance={"mass": 0.0}), POSITIVE),
    ("fit replay diagnose", dict(window=1e-3), "choose between"),
    ("fit replay diagnose", dict(window=9.0), "too short for .* record for longer"),
    ("fit replay diagnose diagnose_batch diagnose_joints", dict(window=60.0), "choose|windows"),
    ("fit diagnose", dict(tolerance={"mass": -1.0}), "more than zero"),
    ("fit diagnose", dict(tolerance={"weight": 0.1}), _BASE),
    ("fit diagnose", dict(known=("mass",), tolerance={"mass": 0.1}), "in one of the two"),
    ("fit", dict(record=[]), "at least one Record", "record"),
    ("sampled", dict(controller=CONTROLLER), "control.StateSpace", "controller"),
    (
        "fit replay axis_from",
        dict(record="/nowhere/run.csv"),
        "no file",
        "run.csv",
        FileNotFoundError,
    ),
    ("fit replay axis_from identify_coulomb identify_stribeck", dict(record=X), "path of its file"),
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
    ("slow_ramp_experiment", dict(axis=AXIS.replace(travel=None)), "give travel", "travel"),
    ("slow_ramp_experiment", dict(duration=Each(2e-3, 1e12)), "samples"),
    ("diagnose", dict(window=0.5), "shorter window"),
    ("diagnose", dict(load_errors=3.0), "shape"),
    ("diagnose", dict(record=[]), "at least one", "list of records"),
    ("diagnose", dict(on_update=True), "function of a step"),
    ("next_experiment", dict(rivals=3), "sequence of FrictionAxis"),
    ("next_experiment", dict(rivals=["a"]), "FrictionAxis"),
    ("next_experiment", dict(names=Each(["a"], ["a", "a"])), "2 different names"),
    ("next_experiment", dict(names=Each(3, ["a", 3])), "names"),
    ("next_experiment", dict(limits=3), "Limits"),
    ("next_experiment", dict(travel=(1.0, 0.0)), "low to high", "limits.travel", _LIMITS),
    ("next_experiment", dict(travel=3.0), "low, high", "limits.travel", _LIMITS),
    ("next_experiment", dict(drive=0.0), "more than zero", "limits.drive", _LIMITS),
    ("next_experiment", dict(speed=NAN), "finite", "limits.speed", _LIMITS),
    ("Experiment.to_csv", {}, "read its description", "no reference"),
)

# ---------------------------------------- arguments that mean the same everywhere
SAMPLES = (([], "at least one sample"), ([[0.0, 1.0]], r"shape \(n,\)"), (nan_at(U), "index 7"),
           ("012", "array of numbers"))  # fmt: skip
#: By the name of an argument.
EVERYWHERE: dict[str, tuple[tuple[Any, str], ...]] = {
    "reference": SAMPLES, "seed": ((-1, "seed"),), "starts": ((0, "at least 1"),),
    "jobs": ((0, "whole number"), (True, "whole number")),
    "store": ((".", "name a file in it"),), "known": ((("weight",), "choose from"),),
    "level": ((0.0, "between 0 and 1"), (90.0, "between 0 and 1")),
    "travel": ((0.3, r"\(low, high\)"), ((0.3, 0.0), "low to high"), ((0.0, NAN), "finite")),
    "limit": ((NAN, "number"), ("5 N", "number"), (-1.0, POSITIVE), (0.0, POSITIVE)),
    **dict.fromkeys(
        ("hold", "switching", "method", "input", "kind", "interpolation", "discretization", "form",
         "solver", "precision", "version"),
        (("printed", "one of|must be .* or "), (None, "one of|must be .* or ")),
    ),
}  # fmt: skip
#: By the name of a number.
SIGNED: dict[str, tuple[tuple[Any, str], ...]] = {
    **dict.fromkeys(
        "dt bandwidth time_limit duration mass stick_speed stick_rate kp band tolerance unwrap "
        "seconds rate excess_speed force_noise disturbance_bandwidth size block velocity "
        "acceleration stribeck_speed window".split(),
        ((-1.0, POSITIVE), (0.0, POSITIVE)),
    ),
    **dict.fromkeys(
        "quantum encoder_quantum viscous excess ki filter_time uncertainty noise drift level_walk "
        "input_delay learning mismatch correction load".split(),
        ((-1.0, NOT_NEGATIVE),),
    ),
}
_WHOLE, _CHOICE = r"whole number|odd number|\+1( or|,)", "text|one of|must be .* or |C identifier"
#: By the start of its annotation.
TYPED: dict[str, tuple[tuple[Any, str], ...]] = {
    "float": tuple((bad, NUMBER) for bad in (NAN, INF, "1 m", True)),
    "int": ((1.5, _WHOLE), ("two", _WHOLE)), "bool": ((1, "True or False"),),
    "str": ((3, _CHOICE),), "str | os.PathLike": ((3, "path|file name"),),
    "Mapping[str": ((3, "mapping|map "),), "Sequence[str]": ((3, "names|text"),),
    "FrictionAxis": (("z", "FrictionAxis"), (2.0, "FrictionAxis")),
    **dict.fromkeys(("LoopController", "PositionController"), ((400.0, "PositionController"),)),
    "ObserverDesign": ((AXIS, "design_pi_observer"), (3, "design_pi_observer")),
    "Record": ((X, "Record"), (3, "Record")),
}  # fmt: skip


def typed(annotation: str) -> tuple[tuple[Any, str], ...]:
    """What an argument of this annotation refuses."""
    starts = [s for s in TYPED if annotation.removesuffix(" | None").startswith(s)]
    plain = max(starts, key=len, default="")
    whole = plain in ("Mapping[str", "str | os.PathLike") or annotation.split(" | None")[0] == plain
    return TYPED[plain] if plain and whole else ()


# Records check their columns by rules of their own; a log must be there first.
OTHERWISE = {"Record", "Record.from_irregular", "Record.split_at_gaps", "read_bam", "Saturation"}
OTHERWISE |= {"FrictionAxis.mode_ss"}  # dt = 0 is continuous time
# Effects have bounds; a model must be there first.
OTHERWISE |= {"Effect", "Law", "to_mjcf", *(cls.__name__ for cls in REGISTRY.values())}
# Handed on to matplotlib, python-control or the file system, endless on purpose, or used only
# where a model, a log or another argument is there: rows of their own, if any.
UNTYPED = set(
    "progress limit source Law.tolerance read_bam.dt Record.window.t0 Record.window.t1 "
    "read_record.max_gap Record.from_frame.columns".split()
) | {f"to_{model}.{name}" for model in ("mjcf", "urdf", "modelica") for name in ("joint", "out")}
for _name, (_call, _) in SOUND.items():
    for _argument, _about in inspect.signature(_call).parameters.items():
        if _about.kind is _about.VAR_KEYWORD:
            continue
        _annotation = str(_about.annotation)
        if _name not in OTHERWISE:
            _signed = SIGNED.get(_argument, ()) if _annotation.startswith("float") else ()
            _table = (*_signed, *EVERYWHERE.get(_argument, ()))
            _table = [row for row in _table if row[0] is not None or "None" not in _annotation]
            rows(*((_name, {_argument: bad}, mend) for bad, mend in _table))
        if not UNTYPED & {_argument, f"{_name}.{_argument}"}:
            _says = (
                "3|path" if "PathLike" in _annotation else "mode" if _argument == "index" else None
            )
            rows(*((_name, {_argument: bad}, mend, _says) for bad, mend in typed(_annotation)))
rows(
    *(("FrictionAxis.simulate Law observe", dict(u=bad), mend) for bad, mend in SAMPLES),
    *(("observe", dict(y=bad), mend) for bad, mend in SAMPLES),
    ("design_compensation", dict(law="magic"), "learned"),
)

# --------------------------------------------------------------------- arms
if ARM:
    _BOTH = "arm_records diagnose_arm"
    rows(
        (_BOTH, dict(model=3), "MJCF or URDF file"), (_BOTH, dict(log=None), "one log of all joints"),
        (_BOTH, dict(axes=3), "mapping of joints"), (_BOTH, dict(axes={"hip": AXIS}), "no joint 'hip'", "axes"),
        (_BOTH, dict(held=3), "gripper"), (_BOTH, dict(held=["hip"]), "no joint 'hip'", "held"),
        (_BOTH, dict(gravity=9.81), "three numbers"), (_BOTH, dict(payload=3), "mapping such as"),
        (_BOTH, dict(scaling=3), "dfc.Scaling"),
        ("arm_records", dict(reading=3), "has no argument", None, TypeError),
        ("diagnose_arm", dict(options=3), "has no argument", None, TypeError),
        ("diagnose_arm", dict(known=3), "names such as"), ("diagnose_arm", dict(known=("weight",)), _BASE),
        ("diagnose_arm", dict(tolerance={"mass": 0.0}), POSITIVE),
        ("diagnose_arm", dict(time_limit=_FEW), POSITIVE), ("diagnose_arm", dict(hold="last"), "zero"),
        ("diagnose_arm", dict(store="nowhere/a.jsonl"), "make it first"),
        ("diagnose_arm", dict(window=60.0, known="model"), "choose|windows", "window"),
        ("diagnose_arm", dict(jobs=0, known="model"), "whole number other than 0", "jobs"),
    )  # fmt: skip


# -------------------------------------------------------------------- tests


@contextlib.contextmanager
def no_work(patch: pytest.MonkeyPatch) -> Iterator[None]:
    """Nothing is simulated, solved or fitted inside."""

    def refuse(*_: Any, **__: Any) -> Any:
        raise AssertionError("work began before the arguments were looked at")

    with patch.context() as here:
        for room, name in (
            (axis_step, "run"), (axis_step, "step"), (loops.kernel, "run_loop"),
            (windows, "free_runs"), (synthesis, "certified_solution"),
            (joblib.Parallel, "__call__"),
        ):  # fmt: skip
            here.setattr(room, name, refuse)
        here.setattr(dfc.ObserverDesign, "sample_kernel", Kernel(refuse, refuse))
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
        if "folder" in inspect.signature(call).parameters:
            arguments["folder"] = folder
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
    if case.name in ("read_axis", "ObserverDesign.load"):
        assert re.search(r"\w\.(toml|json)", text) or case.spoil == dict(path=3)
    if case.call is None:
        assert sorted(folder.iterdir()) == before


def test_sound_calls_are_sound():
    """What a row spoils works unspoiled, so that the row fails for its own reason."""
    files = "read_ load write_ to_csv from_f .save fit presets datasets Fit export_ to_"
    slow = "diagnose next_experiment identify_ slow_ramp monte_carlo design_pi plot Simulation"
    for name, (call, arguments) in SOUND.items():
        if not any(word in name for word in f"{files} {slow}".split()):
            call(**arguments)


def test_every_public_name_is_in_the_table():
    names = {case.name for case in CASES}
    named = {name.split(".")[0] for name in names}
    assert set(PUBLIC) - named <= NOTHING_TO_SPOIL and not NOTHING_TO_SPOIL & named
    assert set(SOUND) == names


def test_every_argument_is_in_the_table():
    spoiled = {f"{case.name}.{argument}" for case in CASES for argument in case.spoil}
    missing = set()
    for name in set(PUBLIC) - NOTHING_TO_SPOIL - GIVEN:
        if callable(PUBLIC[name]):
            asked = set(inspect.signature(PUBLIC[name]).parameters)
            asked -= {"progress"}  # asked for its truth alone
            missing |= {f"{name}.{argument}" for argument in asked} - spoiled
    assert missing == {"register_effect.cls"}  # its rows call it themselves


# ------------------------------------------------------------------ warnings

PLAY = AXIS.replace(effects=fx.Backlash(1e-4, 0.5))
CONTACT = AXIS.replace(effects=fx.Presliding(1e-5))
COUNTS = "one count in m, not a number of counts"
SUSPECT: dict[str, tuple[Callable[[], Any], str]] = {
    "time in ms": (lambda: dfc.Record(1e3 * T, U, X), "milliseconds.*t \\* 0.001"),
    "mapping, ms": (lambda: dfc.read_record({"t": 1e3 * T, "u": U, "x": X}), "milliseconds"),
    "observer leaves out": (lambda: dfc.design_pi_observer(CONTACT, DT), "leaves out presliding"),
    "compensation leaves out": (lambda: dfc.design_compensation(PLAY, DT), "leaves out backlash"),
    "observer, counts": (lambda: dfc.design_pi_observer(AXIS, DT, encoder_quantum=1.0), COUNTS),
    "filter, counts": (lambda: dfc.hybrid_filter(AXIS, DT, 1.0), COUNTS),
    "compensation, counts": (lambda: dfc.design_compensation(AXIS, DT, 1.0), COUNTS),
}


@pytest.mark.parametrize("case", SUSPECT)
def test_suspect_input_brings_a_warning(case):
    call, words = SUSPECT[case]
    with pytest.warns(UserWarning, match=words) as told:
        call()
    assert {one.filename for one in told} == {__file__}, "points into the package"
