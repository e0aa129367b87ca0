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
import json
import math
import re
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import joblib
import numpy as np
import pytest
from scipy.io import savemat

import dryfric_control as dfc
from dryfric_control import presets
from dryfric_control.compiled import axis_step
from dryfric_control.diagnosis import Experiment
from dryfric_control.diagnosis.excitations import Limits
from dryfric_control.estimation import windows
from dryfric_control.model import loops
from dryfric_control.model.axis import AxisStepper
from dryfric_control.model.effects.effect import REGISTRY
from dryfric_control.observer import runtime, synthesis


@pytest.fixture(autouse=True)
def effects_as_before():
    """What a call registers must not be a candidate in the tests of others."""
    before = dict(REGISTRY)
    yield
    REGISTRY.clear()
    REGISTRY.update(before)


DT = 1e-3
NAN, INF = math.nan, math.inf
N = 2000
T = DT * np.arange(N)
U = 20.0 * np.sin(6.0 * T) + 12.0 * np.sin(17.0 * T + 1.0)
AXIS = dfc.FrictionAxis(
    mass=2.0, viscous=15.0, coulomb=8.0, stribeck=dfc.Stribeck(0.3, 0.01), travel=(-0.3, 0.3)
)
X = 1e-6 * np.round(1e6 * AXIS.simulate(U, dt=DT).y[0])
RECORD = dfc.Record(T, U, X, X)
CONTROLLER = dfc.PositionController(kp=400.0, ki=0.0, kd=40.0, dt=DT)
HUGE = 10**400  # a whole number that no float holds


def nan_at(array: Any, place: int = 7, value: float = NAN) -> Any:
    """The array with one bad value."""
    spoiled = np.array(array, dtype=float)
    spoiled[place] = value
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
    nothing = np.empty(0)
    return Experiment(
        "change_of_bench",
        "a change of the bench",
        "turn it",
        nothing,
        nothing,
        None,
        (),
        {},
        {},
        "coulomb",
        {},
        {},
        ("m", "N"),
    )


class Magnet(dfc.effects.Effect):
    """An effect of a user's own, sound but for what a row spoils."""

    slug = "magnet"
    action = "force"

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return 0.0


def magnet(**changes: Any) -> Any:
    return dfc.effects.register_effect(type("Magnet", (Magnet,), changes))


def content(name: str, text: Any) -> Callable[..., Any]:
    """A call that reads a file with this text."""
    readers = {
        ".toml": dfc.read_axis,
        ".json": dfc.load_design,
        ".log": dfc.read_bam,
        "emps.csv": dfc.datasets.emps,
    }
    reader = readers.get(name) or readers.get(
        name[name.rindex(".") :] if name != "run.json" else "", dfc.read_record
    )

    def read(folder: Any, **options: Any) -> Any:
        path = folder / name
        if isinstance(text, dict):
            savemat(path, text)
        else:
            path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return reader(path, **options)

    read.needs_folder = True  # type: ignore[attr-defined]
    return read


def columns(*arrays: Any, heading: str = "t,u,x") -> str:
    rows = zip(*(np.asarray(a).tolist() for a in arrays), strict=True)
    return "\n".join([heading, *(",".join(map(str, row)) for row in rows)]) + "\n"


# A sound call of every name: what the rows below spoil in one argument.
SOUND: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
    "FrictionAxis": (dfc.FrictionAxis, dict(mass=2.0, viscous=15.0, coulomb=8.0)),
    "FrictionAxis.replace": (AXIS.replace, {}),
    "FrictionAxis.arrays": (AXIS.arrays, dict(dt=DT)),
    "FrictionAxis.breakaway": (AXIS.breakaway, dict(x=[0.0], direction=1)),
    "FrictionAxis.simulate": (AXIS.simulate, dict(u=[0.0, 1.0], dt=DT)),
    "FrictionAxis.stepper": (AXIS.stepper, dict(dt=DT)),
    "FrictionAxis.mode": (AXIS.mode, dict(index=1)),
    "FrictionAxis.mode_ss": (AXIS.mode_ss, dict(index=1, dt=DT)),
    "AxisStepper": (AxisStepper, dict(axis=AXIS, dt=DT)),
    "AxisStepper.step": (AxisStepper(AXIS, DT).step, dict(u=0.0)),
    "CoulombMap": (dfc.CoulombMap, dict(plus=8.0)),
    "CoulombMap.__call__": (dfc.CoulombMap(8.0), dict(x=[0.0], direction=1)),
    "CoulombMap.scaled": (dfc.CoulombMap(8.0).scaled, dict(plus=1.0)),
    "Stribeck": (dfc.Stribeck, dict(excess=0.3, speed=0.01)),
    "Sign": (dfc.laws.Sign, {}),
    "Tanh": (dfc.laws.Tanh, dict(speed=1e-3)),
    "Karnopp": (dfc.laws.Karnopp, dict(band=1e-3)),
    "Dahl": (dfc.laws.Dahl, dict(stiffness=1e5)),
    "LuGre": (dfc.laws.LuGre, dict(stiffness=1e5, damping=100.0)),
    "Law": (dfc.laws.Sign().run, dict(axis=AXIS, u=[0.0, 1.0], dt=DT)),
    "PositionController": (dfc.PositionController, dict(kp=400.0, ki=0.0, kd=40.0, dt=DT)),
    "PositionController.from_bandwidth": (
        dfc.PositionController.from_bandwidth,
        dict(axis=AXIS, bandwidth=20.0, dt=DT),
    ),
    "PositionController.memory": (CONTROLLER.memory, {}),
    "simulate_loop": (
        dfc.simulate_loop,
        dict(axis=AXIS, controller=CONTROLLER, reference=[0.0, 0.1]),
    ),
    "axis_block": (dfc.axis_block, dict(axis=AXIS, dt=DT)),
    "switched_axis": (dfc.switched_axis, dict(axis=AXIS, dt=DT)),
    "supervisor": (dfc.supervisor, dict(axis=AXIS, dt=DT)),
    "encoder": (dfc.encoder, dict(quantum=1e-6, dt=DT)),
    "reference_filter": (dfc.reference_filter, dict(bandwidth=20.0, dt=DT)),
    "position_controller": (dfc.position_controller, dict(axis=AXIS, bandwidth=20.0, dt=DT)),
    "plot_state_machine": (dfc.plot_state_machine, dict(axis=AXIS)),
    "SimulationResponse": (AXIS.simulate([0.0, 1.0], DT).plot, {}),
    "Events": (AXIS.simulate([0.0, 1.0], DT).events.times, dict(before=0, after=1)),
    "parameter": (dfc.effects.parameter, dict(unit="N", doc="force")),
    "Effect": (dfc.effects.Spring, dict(stiffness=10.0)),
    "register_effect": (magnet, {}),
    "Record": (dfc.Record, dict(t=T, u=U, x=X)),
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
    "read_record": (dfc.read_record, dict(source={"t": T, "u": U, "x": X})),
    "Scaling": (dfc.Scaling, {}),
    "Scaling.of": (dfc.Scaling.of, dict(gain=2.0)),
    "Scaling.from_dict": (dfc.Scaling.from_dict, dict(data={})),
    "Scaling.from_file": (dfc.Scaling.from_file, dict(path="axis.toml")),
    "load_fit": (dfc.load_fit, dict(path="fit.json")),
    "load_record": (dfc.load_record, dict(path="record.json")),
    "load_diagnosis": (dfc.load_diagnosis, dict(path="diagnosis.json")),
    "read_bam": (dfc.read_bam, dict(path="log.json")),
    "read_axis": (dfc.read_axis, dict(path="axis.toml")),
    "write_axis": (dfc.write_axis, dict(axis=AXIS, path="/nowhere/axis.toml")),
    "load_design": (dfc.load_design, dict(path="observer.json")),
    "design_pi_observer": (dfc.design_pi_observer, dict(axis=AXIS, dt=DT)),
    "hybrid_filter": (dfc.hybrid_filter, dict(axis=AXIS)),
    "design_compensation": (dfc.design_compensation, dict(axis=AXIS, dt=DT)),
    "load_compensation": (dfc.load_compensation, dict(path="/nowhere/compensation.json")),
    "export_c": (dfc.export_c, dict(obj=AXIS, folder="/dev/null/no")),
    "export_fmu": (dfc.export_fmu, dict(obj=AXIS, path="/nowhere/axis.fmu")),
    "to_mjcf": (dfc.to_mjcf, dict(result=AXIS, model="/nowhere/arm.xml")),
    "to_urdf": (dfc.to_urdf, dict(result=AXIS, model="/nowhere/arm.urdf")),
    "to_modelica": (dfc.to_modelica, dict(result=AXIS, model="/nowhere/Arm.mo")),
    "to_isaac": (dfc.to_isaac, dict(result=AXIS, path="/nowhere/friction.py", load=0.0)),
    "to_simscape": (dfc.to_simscape, dict(result=AXIS, path="/nowhere/friction.m")),
    "motion_profile": (
        dfc.motion_profile,
        dict(points=[0.0, 0.1], dt=DT, velocity=0.1, acceleration=1.0, jerk=50.0),
    ),
    "ObserverDesign.mode_matrices": (lambda **k: design().mode_matrices(**k), dict(mode=1)),
    "ObserverDesign.error_dynamics": (lambda **k: design().error_dynamics(**k), dict(mode=1)),
    "ObserverDesign.save": (lambda **k: design().save(**k), dict(path="/nowhere/observer.json")),
    "pi_observer": (lambda **k: dfc.pi_observer(k.pop("design", design()), **k), {}),
    "ObserverStepper": (lambda **k: dfc.ObserverStepper(k.pop("design", design()), **k), {}),
    "ObserverStepper.step": (
        lambda **k: dfc.ObserverStepper(design()).step(**k),
        dict(u=0.0, y=0.0),
    ),
    "observe": (
        lambda **k: dfc.observe(k.pop("design", design()), k.pop("u"), k.pop("y"), **k),
        dict(u=[0.0, 1.0], y=[0.0, 0.0]),
    ),
    "observed_loop": (
        lambda **k: dfc.observed_loop(**({"design": design()} | k)),
        dict(axis=AXIS, controller=CONTROLLER),
    ),
    "simulate_observed_loop": (
        lambda **k: dfc.simulate_observed_loop(**({"design": design()} | k)),
        dict(axis=AXIS, controller=CONTROLLER, reference=[0.0, 0.1]),
    ),
    "monte_carlo": (
        lambda **k: dfc.monte_carlo(**({"design": design()} | k)),
        dict(
            controller=CONTROLLER,
            reference=[0.0, 0.1],
            quantum=1e-6,
            stribeck_speed=0.01,
            runs=2,
            progress=False,
        ),
    ),
    "fit": (dfc.fit, dict(axis=AXIS, record=RECORD)),
    "Fit.interval": (lambda **k: fitted().interval(**k), {}),
    "Fit.bootstrap": (lambda **k: fitted().bootstrap(**k), {}),
    "Fit.replay": (lambda **k: fitted().replay(**k), dict(record=RECORD)),
    "Fit.plot": (lambda **k: fitted().plot(**k), {}),
    "identify_coulomb": (dfc.identify_coulomb, dict(record=RECORD)),
    "identify_stribeck": (dfc.identify_stribeck, dict(axis=AXIS, record=RECORD)),
    "replay": (dfc.replay, dict(axis=AXIS, record=RECORD)),
    "replay_loop": (dfc.replay_loop, dict(axis=AXIS, record=RECORD, controller=CONTROLLER)),
    "slow_ramp_experiment": (dfc.slow_ramp_experiment, dict(axis=AXIS, duration=5.0)),
    "diagnose": (dfc.diagnose, dict(axis=AXIS, record=RECORD)),
    "diagnose_batch": (dfc.diagnose_batch, dict(axis=AXIS, records=[RECORD], progress=False)),
    "diagnose_joints": (
        dfc.diagnose_joints,
        dict(joints={"elbow": (AXIS, RECORD)}, progress=False),
    ),
    "run_batch": (dfc.run_batch, dict(function=math.sqrt, cases={"a": 4.0}, progress=False)),
    "next_experiment": (
        dfc.next_experiment,
        dict(axis=AXIS, rivals=[AXIS.replace(mass=2.5)], record=RECORD),
    ),
    "Experiment.to_csv": (lambda **k: experiment().to_csv(**k), dict(path="plan.csv")),
    "Experiment.plot": (lambda **k: experiment().plot(**k), {}),
    "datasets.emps": (dfc.datasets.emps, dict(path="DATA_EMPS.mat")),
    "presets.clutch_observer": (presets.clutch_observer, {}),
    "presets.clutch_controller": (presets.clutch_controller, {}),
    "presets.crawl_and_steps": (presets.crawl_and_steps, {}),
    "presets.clutch_experiment": (
        lambda **k: presets.clutch_experiment(**({"design": design()} | k)),
        {},
    ),
    "presets.clutch_monte_carlo": (
        lambda **k: presets.clutch_monte_carlo(**({"design": design()} | k)),
        {},
    ),
}
SOUND |= {cls.__name__: (cls, {}) for cls in REGISTRY.values()}

PUBLIC = {
    name: getattr(space, name)
    for space in (dfc, dfc.effects, dfc.laws)
    for name in space.__all__
    if name not in ("datasets", "effects", "laws", "presets")
}

# Names that take nothing from a user: errors and warnings, and objects that the package makes,
# whose methods take no argument or are in the table under the name of the function.
NOTHING_TO_SPOIL = {
    "__version__",
    "Cause",
    "Certificate",
    "CertificateError",
    "Compensation",
    "Diagnosis",
    "MotionProfile",
    "FitWarning",
    "Inner",
    "RecordWarning",
}


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


def rows(name: str, *table: tuple[Any, ...]) -> None:
    """Rows of one public name: spoiled argument, mend, and what to say in its place."""
    for spoil, mend, *says in table:
        CASES.append(Case(name, spoil, mend, *says))


def files(name: str, *table: tuple[Any, ...]) -> None:
    """Rows of a reader: file name, content, what the message names, mend, options."""
    for file, text, says, mend, *options in table:
        spoil = options[0] if options else {}
        CASES.append(Case(name, spoil, mend, says, content(file, text)))


NUMBER, POSITIVE, NOT_NEGATIVE = "must be a (finite )?number", "more than zero", "zero or more"

# -------------------------------------------------------------------- axis
rows(
    "FrictionAxis",
    (dict(mass=-2.0), POSITIVE),
    (dict(mass=0.0), POSITIVE),
    (dict(mass=NAN), NUMBER),
    (dict(mass=INF), NUMBER),
    (dict(mass="two"), NUMBER),
    (dict(mass=None), NUMBER),
    (dict(mass=True), NUMBER),
    (dict(mass=[2.0]), NUMBER),
    (dict(mass=HUGE), NUMBER),
    (dict(mass=2 + 1j), NUMBER),
    (dict(mass=5e-324), "unit"),
    (dict(viscous=-1.0), NOT_NEGATIVE),
    (dict(viscous=NAN), NUMBER),
    (dict(coulomb=-8.0), "magnitude"),
    (dict(coulomb=NAN), "finite", "plus"),
    (dict(coulomb=None), "level"),
    (dict(coulomb=True), "level"),
    (dict(coulomb=()), "pair"),
    (dict(coulomb=(8.0, NAN)), "finite", "minus"),
    (dict(stribeck=0.3), "dfc.Stribeck"),
    (dict(stribeck=(0.3, 0.01)), "dfc.Stribeck"),
    (dict(stick_speed=0.0), POSITIVE),
    (dict(stick_speed=-1e-4), POSITIVE),
    (dict(stick_rate=0.0), POSITIVE),
    (dict(stick_rate=INF), NUMBER),
    (dict(travel=(0.3, 0.0)), "low to high"),
    (dict(travel=(0.1, 0.1)), "low to high"),
    (dict(travel=(0.0, NAN)), "finite"),
    (dict(travel=(0.0, 0.1, 0.2)), r"\(low, high\)"),
    (dict(travel=0.3), r"\(low, high\)"),
    (dict(switching="Filippov"), '"filippov" or "paper"'),
    (dict(switching=None), '"filippov"'),
    (dict(switching=["paper"]), '"filippov"'),
    (dict(effects=3), "sequence of effects"),
    (dict(effects="spring"), "dfc.effects.Spring"),
    (dict(effects=(dfc.effects.Spring,)), "dfc.effects.Spring"),
    (
        dict(effects=(dfc.effects.Backlash(1e-3, 0.5), dfc.effects.Compliance(1e4, 1.0, 0.5))),
        "keep one",
    ),
    (dict(effects=(dfc.effects.ActuatorLag(0.1), dfc.effects.ActuatorLag(0.2))), "add them up"),
    (dict(name=3), "text"),
    (dict(units="m"), "position and force"),
    (dict(units=("m", 3)), "position and force"),
    (dict(units=3), "position and force"),
    (dict(units=("deg", "Nm")), "converted as they are read", "numbers in 'rad', not in 'deg'"),
    (dict(units=("m", "kN")), "converted as they are read", "numbers in 'N', not in 'kN'"),
    (dict(units=("N m", "rad")), "position first", "position cannot be in 'N m'"),
    (dict(units=("rad", "N")), '"N m"'),
)
rows(
    "FrictionAxis.replace",
    (dict(mass=-1.0), POSITIVE),
    (dict(travel=(1.0, 0.0)), "low to high"),
)
CASES.append(Case("FrictionAxis.replace", dict(weight=1.0), "unexpected keyword", kind=TypeError))
rows("FrictionAxis.arrays", (dict(dt=0.0), POSITIVE), (dict(dt=NAN), NUMBER))
rows(
    "FrictionAxis.breakaway",
    (dict(direction=0), r"\+1 or -1"),
    (dict(x=["a"]), "array of numbers"),
)
rows(
    "FrictionAxis.simulate",
    (dict(u=[]), "at least one sample"),
    (dict(u=[[0.0, 1.0]]), r"shape \(n,\)"),
    (dict(u=nan_at(U)), "remove or fill"),
    (dict(u=nan_at(U, 7, INF)), "index 7"),
    (dict(u="012"), "array of numbers"),
    (dict(u=None), r"array of numbers|shape \(n,\)"),
    (dict(u=[1.0, [2.0]]), "array of numbers"),
    (dict(u=[0.0, HUGE]), "array of numbers"),
    (dict(u=U + 1j), "real part"),
    (dict(u={"a": 1.0}), "array of numbers"),
    (dict(u=np.ma.masked_less([1.0, -1.0], 0.0)), "fill or remove"),
    (dict(u=np.array(["1", "2"])), "numbers"),
    (dict(dt=0.0), POSITIVE),
    (dict(dt=-1e-3), POSITIVE),
    (dict(dt=NAN), NUMBER),
    (dict(dt="1 ms"), NUMBER),
    (dict(dt=T), NUMBER),
    (dict(x0=NAN), NUMBER),
    (dict(x0=[0.0, 1.0]), NUMBER),
    (dict(v0=INF), NUMBER),
    (dict(v0="fast"), NUMBER),
    (dict(hold="second"), '"zero" or "first"'),
    (dict(hold=0), '"zero" or "first"'),
    (dict(law="lugre"), "dfc.laws.LuGre"),
    (dict(law=dfc.laws.Sign), r"dfc.laws.LuGre\("),
)
_FAST = AXIS.replace(viscous=1e12)  # N s/um taken for N s/m, say
_SHARP = AXIS.replace(stribeck=dfc.Stribeck(0.3, 1e-13))
for _name, _says, _call in (
    ("FrictionAxis.simulate", "viscous", lambda: _FAST.simulate([0.0], DT)),
    ("FrictionAxis.simulate", "stribeck.speed", lambda: _SHARP.simulate([0.0], DT)),
    ("FrictionAxis.stepper", "viscous", lambda: _FAST.stepper(DT)),
    ("axis_block", "viscous", lambda: dfc.axis_block(_FAST, DT)),
    ("simulate_loop", "viscous", lambda: dfc.simulate_loop(_FAST, CONTROLLER, [0.0])),
):
    CASES.append(Case(_name, {}, "check the units", _says, _call))
rows("FrictionAxis.stepper", (dict(dt=0.0), POSITIVE), (dict(x0=NAN), NUMBER))
rows(
    "FrictionAxis.mode",
    (dict(index=2), "stuck", "mode"),
    (dict(index="+1"), "stuck", "mode"),
    (dict(index=[1]), "stuck", "mode"),
    (dict(index=True), "stuck", "mode"),
)
rows(
    "FrictionAxis.mode_ss",
    (dict(index=None), "stuck", "mode"),
    (dict(dt=-1.0), NOT_NEGATIVE),
    (dict(method="tustin"), '"euler" or "zoh"'),
    (dict(input="u"), '"drive" or "force"'),
    (dict(index=0, dt=0.01), 'lower dt|method="zoh"', "stick_rate"),
    (dict(at=0.1), "position, velocity"),
    (dict(at=(NAN, 0.1)), NUMBER, "at"),
    (dict(at=(0.0, -0.1)), "sign of the mode", "at"),
)
rows(
    "AxisStepper",
    (dict(axis="z"), "FrictionAxis"),
    (dict(dt=0.0), POSITIVE),
    (dict(x0=None), NUMBER),
    (dict(v0=NAN), NUMBER),
)
rows(
    "AxisStepper.step", (dict(u=NAN), NUMBER), (dict(u=[1.0, 2.0]), NUMBER), (dict(u="1N"), NUMBER)
)
rows(
    "CoulombMap",
    (dict(plus=[]), "constant level"),
    (dict(plus="8"), "coefficients"),
    (dict(plus=[8.0, NAN]), "finite", r"plus\[1\]"),
    (dict(plus=NAN), NUMBER),
    (dict(plus=None), "coefficients"),
    (dict(plus=True), "number"),
    (dict(minus=[[7.0]]), "number", r"minus\[0\]"),
    (dict(minus=INF), NUMBER),
    (dict(plus={"c0": 8.0}), "number"),
)
rows(
    "CoulombMap.__call__",
    (dict(direction=2), r"\+1 or -1"),
    (dict(direction=None), r"\+1 or -1"),
    (dict(x="here"), "array of numbers"),
)
rows("CoulombMap.scaled", (dict(plus=NAN), "finite"), (dict(minus="twice"), NUMBER))
rows(
    "Stribeck",
    (dict(excess=-0.1), NOT_NEGATIVE),
    (dict(excess=NAN), NUMBER),
    (dict(excess=30.0), "for 30 % give 0.3"),
    (dict(speed=0.0), POSITIVE),
    (dict(speed=-0.01), POSITIVE),
    (dict(speed=None), NUMBER),
    (dict(speed=HUGE), NUMBER),
    (dict(speed=1e-320), "unit"),
)

# -------------------------------------------------------------------- laws
rows("Sign", (dict(tolerance=0.0), POSITIVE), (dict(tolerance=NAN), NUMBER))
rows(
    "Tanh",
    (dict(speed=0.0), POSITIVE),
    (dict(speed="slow"), NUMBER),
    (dict(tolerance=-1.0), POSITIVE),
)
for _law in ("Karnopp", "Dahl", "LuGre"):
    rows(_law, (dict(tolerance=0.0), POSITIVE))
rows("Karnopp", (dict(band=-1e-3), POSITIVE), (dict(band=None), NUMBER))
rows("Dahl", (dict(stiffness=0.0), POSITIVE), (dict(stiffness=INF), NUMBER))
rows(
    "LuGre",
    (dict(stiffness=-1.0), POSITIVE),
    (dict(damping=NAN), NUMBER),
    (dict(damping=True), NUMBER),
)
rows(
    "Law",
    (dict(axis=None), "FrictionAxis"),
    (dict(u=[NAN]), "finite"),
    (dict(u=[[0.0]]), r"shape \(n,\)"),
    (dict(u=[]), "at least one sample"),
    (dict(dt=0.0), POSITIVE),
    (dict(x0=NAN), NUMBER),
    (dict(v0="0"), NUMBER),
    (dict(hold="none"), "zero"),
    (
        dict(axis=AXIS.replace(effects=(dfc.effects.InputDelay(5e-3),))),
        "remove them",
        "input_delay",
    ),
    (dict(axis=AXIS.replace(effects=(dfc.effects.Presliding(1e-5),))), "leave out", "presliding"),
)

# ---------------------------------------------------------- loops and blocks
rows(
    "PositionController",
    (dict(kp=0.0), POSITIVE),
    (dict(kp=NAN), NUMBER),
    (dict(ki=-1.0), NOT_NEGATIVE),
    (dict(kd=INF), NUMBER),
    (dict(kd="big"), NUMBER),
    (dict(dt=0.0), POSITIVE),
    (dict(limit=0.0), POSITIVE),
    (dict(limit=NAN), NUMBER),
    (dict(limit="5 N"), "number"),
    (dict(limit=None), "number"),
    (dict(filter_time=-1.0), NOT_NEGATIVE),
    (dict(span=0), "1 to 8"),
    (dict(span=2.5), "1 to 8"),
    (dict(span="2"), "1 to 8"),
    (dict(span=True), "1 to 8"),
)
rows(
    "PositionController.from_bandwidth",
    (dict(axis=2.0), "FrictionAxis"),
    (dict(bandwidth=0.0), POSITIVE),
    (dict(bandwidth=NAN), NUMBER),
    (dict(bandwidth=500.0), "below 0.2"),
    (dict(dt=-1e-3), POSITIVE),
    (dict(limit=-1.0), POSITIVE),
)
rows("PositionController.memory", (dict(reading=NAN), NUMBER), (dict(speed="v"), NUMBER))
rows(
    "simulate_loop",
    (dict(axis="axis"), "FrictionAxis"),
    (dict(controller=400.0), "PositionController"),
    (dict(reference=[]), "at least one sample"),
    (dict(reference=nan_at(X)), "index 7"),
    (dict(reference=0.1), r"shape \(n,\)", "reference"),
    (dict(quantum=-1e-6), NOT_NEGATIVE),
    (dict(quantum=NAN), NUMBER),
    (dict(x0=NAN), NUMBER),
    (dict(v0=INF), NUMBER),
    (dict(disturbance=[0.0]), "one for each"),
    (dict(disturbance=[0.0, NAN]), "fill"),
)
for _block in ("axis_block", "switched_axis", "supervisor"):
    rows(
        _block,
        (dict(axis=None), "FrictionAxis"),
        (dict(dt=0.0), POSITIVE),
        (dict(dt=True), NUMBER),
    )
for _block in ("switched_axis", "supervisor"):
    rows(
        _block,
        (
            dict(axis=AXIS.replace(effects=(dfc.effects.InputDelay(5e-3),))),
            "axis_block",
            "input_delay",
        ),
    )
rows(
    "encoder",
    (dict(quantum=-1e-6), NOT_NEGATIVE),
    (dict(quantum="1 um"), NUMBER),
    (dict(dt=NAN), NUMBER),
)
rows(
    "reference_filter",
    (dict(bandwidth=-20.0), POSITIVE),
    (dict(bandwidth=4000.0), "lower it"),
    (dict(dt=0.0), POSITIVE),
    (dict(order=0), "1 to 8"),
    (dict(order=2.5), "1 to 8"),
    (dict(order="two"), "1 to 8"),
    (dict(order=[2]), "1 to 8"),
)
rows(
    "position_controller",
    (dict(axis=[AXIS]), "FrictionAxis"),
    (dict(bandwidth=500.0), "below 0.2"),
    (dict(dt=None), NUMBER),
    (dict(limit=0.0), POSITIVE),
)
rows(
    "plot_state_machine",
    (dict(axis=8.0), "FrictionAxis"),
    (dict(ax=[1, 2]), "1 axes"),
    (dict(ax="here"), "Axes"),
)
rows("SimulationResponse", (dict(ax=[1.0]), "3 axes"), (dict(ax=["a", "b", "c"]), "Axes"))
rows("Events", (dict(before=2), r"0 \(stuck\)"), (dict(after="stuck"), r"0 \(stuck\)"))

# ----------------------------------------------------------------- effects
rows(
    "parameter",
    (dict(bounds=(1.0, 0.0)), "low to high"),
    (dict(bounds=3.0), r"\(low, high\)"),
    (dict(bounds=(NAN, 1.0)), "low to high"),
    (dict(default=NAN), NUMBER),
    (dict(bounds=(0.0, 1.0), default=2.0), "bounds", "default"),
    (dict(unit=3), "text"),
    (dict(doc=None), "text"),
    (dict(kind="length"), "one of amount"),
    (dict(free=1), "True or False"),
    (dict(breaks_away="no"), "True or False"),
    (dict(logarithmic=None), "True or False"),
    (dict(neutral=NAN), NUMBER),
    (dict(size=0.0), POSITIVE),
)
rows("Effect", (dict(stiffness=None), NUMBER, "spring.stiffness"), (dict(rest=[0.0, 1.0]), NUMBER))
rows(
    "register_effect",
    (dict(slug=""), "lower-case word"),
    (dict(slug="a b"), "lower-case word"),
    (dict(slug=3), "lower-case word"),
    (dict(action="torque"), "must be one of"),
    (dict(law=None), "static method law"),
    (dict(action="axis"), r"method alter\(axis\)", "Magnet"),
    (dict(slug="spring"), "choose another"),
)
CASES.append(
    Case("register_effect", {}, "class", "Effect", call=lambda: dfc.effects.register_effect(3))  # type: ignore[arg-type]
)
CASES.append(
    Case(
        "register_effect",
        {},
        "dfc.effects.Effect",
        "dict",
        lambda: dfc.effects.register_effect(dict),
    )
)  # type: ignore[type-var]
for _slug, _cls in REGISTRY.items():
    for _field in dataclasses.fields(_cls):
        _low, _high = _field.metadata["bounds"]
        _sound = {f.name: _cls.parameters()[f.name]["bounds"] for f in dataclasses.fields(_cls)}
        # Growing: a lower place comes before an upper one.
        _values = {
            k: min(max(0.5 + 0.01 * i, low), high)
            for i, (k, (low, high)) in enumerate(_sound.items())
        }
        SOUND[_cls.__name__] = (_cls, _values)
        _says = f"{_slug}.{_field.name}"
        rows(
            _cls.__name__,
            ({_field.name: NAN}, NUMBER, _says),
            ({_field.name: INF}, NUMBER, _says),
            ({_field.name: "1.0 N"}, NUMBER, _says),
        )
        if math.isfinite(_low):
            rows(_cls.__name__, ({_field.name: _low - 1.0}, "must lie between", _says))
        if math.isfinite(_high):
            rows(_cls.__name__, ({_field.name: _high + 1.0}, "must lie between", _says))

# ------------------------------------------------------------------ records
WRAPPED = np.mod(40.0 * T, 2.0 * np.pi)
KEPT = np.ones(N, bool)
KEPT[700:720] = False  # 20 samples dropped
rows(
    "Record",
    (dict(t=T[:-1]), "cut them to one length", "u"),
    (dict(x=X[:-3]), "one length"),
    (dict(reference=X[:9]), "one length"),
    (dict(x=X[:, None]), "use .ravel"),
    (dict(good=[True, False]), "one for each reading", "good"),
    (dict(good=np.zeros(N, bool)), "at least", "good"),
    (dict(good=X), "True or False", "good"),
    (dict(u=nan_at(U)), "from_irregular"),
    (dict(x=nan_at(X, 3, -INF)), "remove these samples"),
    (dict(t=nan_at(T, 5)), "remove these samples"),
    (dict(x=nan_at(X, 8, 1e200)), "check the column"),
    (dict(t=T[:5], u=U[:5], x=X[:5]), "at least 10", "samples"),
    (dict(x=[]), "empty"),
    (dict(x=None), "missing"),
    (dict(t=T[::-1]), "sort the samples"),
    (dict(t=np.r_[T[:1000], T[:1000]]), "split where runs were joined"),
    (dict(t=nan_at(T, 50, T[49])), "keep one of each"),
    (dict(t=T[KEPT], u=U[KEPT], x=X[KEPT]), "split_at_gaps", "dropped"),
    (dict(t=T + 2e-4 * np.sin(np.arange(N))), "Resample"),
    (dict(x=WRAPPED), "unwrap=6.283185307"),
    (dict(x=np.full(N, 0.1)), "never moved"),
    (dict(u=np.full(N, 0.3)), "without excitation"),
    (dict(u=U + 1j), "real part"),
    (dict(x=X.astype(str)), "convert it"),
    (dict(t=np.arange(N).astype("M8[ms]")), "pass seconds"),
    (dict(x=[*X[:-1].tolist(), None]), "convert it to float"),
    (dict(units={"x": "mm"}), r"x \* 0.001"),
    (dict(units={"t": "ms"}), "0.001"),
    (dict(units={"w": "m/s"}), "t, u and x"),
    (dict(units={"x": "MM"}), "Did you mean 'mm'", "'MM' of x"),
    (dict(units={"x": "N"}), "check the columns", "x cannot be in 'N'"),
    (dict(u=U > 0), "astype", "u holds true and false"),
    (dict(x=2**62 + np.arange(N)), r"pass x - x\[0\]", "x"),
    (dict(quantum=1e50), "in the unit of x", "quantum"),
    (dict(unwrap=1e-9), "period of the encoder", "unwrap"),
    (dict(channels=3), "mapping", "channels"),
    (dict(channels={"w": X}), "known are v, a, x2", "channels"),
    (dict(channels={"v": X[:5]}), "one length", "channels"),
    (dict(channels={"v": nan_at(X)}), "remove", "channels"),
    (dict(raw=3), "mapping", "raw"),
    (dict(raw={"x": "counts"}), "unit and a factor", "raw"),
    (dict(raw={"x": ("counts", NAN)}), "finite", "raw"),
    (dict(units=["m"]), "mapping"),
    (dict(units={"x": 3}), "text", "unit of x"),
    (dict(name=3), "text"),
    (dict(notes=3), "text"),
    (dict(notes=[3]), "text"),
    (dict(notes="filtered"), "sequence"),
    (dict(quantum=-1e-6), "positive"),
    (dict(quantum=NAN), "positive"),
    (dict(quantum="fine"), "number"),
    (dict(unwrap=0.0), "positive"),
    (dict(unwrap="2 pi"), "number"),
    (dict(t=[0.0, HUGE, *T[2:]]), "convert it|physical"),
)
rows(
    "Record.from_irregular",
    (dict(t=T[::-1]), "sort the samples"),
    (dict(dt=0.0), "positive"),
    (dict(dt=1e-12), "samples"),
    (dict(dt=10.0), "it takes"),
    (dict(hold="cubic"), '"zero" or "first"'),
    (dict(interpolation="spline"), '"monotone"'),
    (dict(max_gap=-1.0), "positive"),
    (dict(t=T[KEPT], u=U[KEPT], x=X[KEPT]), "max_gap=", "gap"),
    (dict(x=np.full(N, np.nan)), "remove"),
    (dict(x=np.where(T < 1.0, np.nan, X)), "too many", "rows"),
    (dict(good=[True]), "one for each reading", "good"),
)
CASES.append(Case("Record.from_irregular", dict(colour="red"), "unexpected", kind=TypeError))
rows(
    "Record.split_at_gaps",
    (dict(t=T[::-1]), "sort"),
    (dict(x=nan_at(X)), "remove"),
    (dict(units="m"), "mapping"),
    (dict(channels={"v": X[:5]}), "one length"),
)
rows("Record.from_frame", (dict(frame=[1, 2]), "data frame"))
rows(
    "Record.window",
    (dict(t0=1.0, t1=0.5), "record runs from", "window"),
    (dict(t0=NAN), "record runs", "window"),
    (dict(t0=90.0), "record runs from", "window"),
    (dict(t0="start"), NUMBER),
)
rows(
    "Record.split",
    (dict(parts=0), "parts"),
    (dict(parts=1.5), "positive with sum 1", "fractions"),
    (dict(parts=[0.5, 0.6]), "sum 1", "fractions"),
    (dict(parts=NAN), "positive", "fractions"),
    (dict(parts=True), "fraction", "split"),
    (dict(parts="half"), "convert it", "fractions"),
    (dict(parts=5000), "2 or more"),
)
rows(
    "Record.blocks",
    (dict(seconds=0.0), "positive"),
    (dict(seconds=1e-3), "fewer than 2", "0.001"),
    (dict(seconds="1"), "number"),
)
rows(
    "Record.decimated",
    (dict(factor=0), "at least 1"),
    (dict(factor=2.0), "whole number"),
    (dict(factor=N), "fewer than 2", "2000"),
)
rows(
    "Record.resampled",
    (dict(dt=0.0), "positive"),
    (dict(dt=5.0), "it takes"),
    (dict(dt=NAN), "positive"),
)
rows(
    "Record.derivatives",
    (dict(window=4), "odd"),
    (dict(window=3), "at least 5"),
    (dict(window=9999), "at most"),
    (dict(window=5.0), "odd"),
)
rows(
    "Record.read",
    (dict(positions=X[:5]), "give one each", "positions"),
    (dict(positions=nan_at(X)), "remove these samples", "positions"),
)
rows(
    "Record.compare",
    (dict(name="w"), "it has v", "'w'"),
    (dict(window=4), "odd"),
)
rows("Record.to_csv", (dict(path="run.xlsx"), "csv", "to_csv"))
CASES.append(
    Case(
        "Record.to_csv",
        dict(path="/nowhere/run.csv"),
        "make it first",
        "/nowhere",
        kind=FileNotFoundError,
    )
)
rows("Record.plot", (dict(ax=3), "one for each row"))
CASES.append(Case("Record", {}, "slice", "record", call=lambda: RECORD[3], kind=TypeError))  # type: ignore[index]
CASES.append(Case("Record", {}, "decimated", "step", call=lambda: RECORD[::2]))

# ------------------------------------------------------------------ readers
rows(
    "read_record",
    (dict(source={}), "t, u and x", "no columns"),
    (dict(source={"t": T, "u": U}), "columns=", "x"),
    (dict(gain=0.0), "not zero"),
    (dict(gain=NAN), "finite"),
    (dict(gain="2 N/V"), "number"),
    (dict(gain=HUGE), "finite|number"),
    (dict(columns={"t": "zeit"}), "available"),
    (dict(columns={"time": "t"}), "roles"),
    (dict(columns={"t": 9}), "0 to 2"),
    (dict(columns={"t": "u"}), "serves as both", "column"),
    (dict(columns="t,u,x"), "map t, u, x"),
    (dict(columns={"t": 1.5}), "name or an index"),
    (dict(units={"t": "fortnight"}), "use s, ms", "fortnight"),
    (dict(units={"x": "s"}), "check the columns", "x"),
    (dict(units="ms"), "mapping"),
    (dict(units={"q": "m"}), "t, u and x"),
    (dict(max_rows=0), "positive"),
    (dict(max_rows=100), "max_rows=", "rows"),
    (dict(dt=-1e-3), "positive"),
    (dict(rate=0.0), "positive"),
    (dict(rate=1e3), "leave rate= out", "column of time"),
    (dict(rate=1e3, dt=1e-3), "without a column of time", "rate and dt"),
    (dict(max_gap=0.1), "give dt=", "max_gap"),
    (dict(dt=1e-3, max_gap=-1.0), "positive", "max_gap"),
    (dict(gain={"w": 2.0}), "channels are", "'w'"),
    (dict(gain={"v": 2.0}), "it has t, u, x", "'v'"),
    (dict(units={"x": "Ft"}), "Did you mean 'ft'", "'Ft' of x"),
    (dict(unwrap=-1.0), "positive"),
    (dict(name=7), "text"),
    (dict(joint="elbow"), "available", "joint 'elbow'"),
)
rows(
    "Scaling",
    (dict(gain=3), "number or a mapping"),
    (dict(gain={"x": 0.0}), "not zero", "gain"),
    (dict(gain={"reference": 2.0}), "takes the gain of x"),
    *(
        (dict([(name, 0.0)]), "more than zero", name)
        for name in (
            "counts_per_turn",
            "gear_ratio",
            "lead",
            "torque_constant",
            "rated_torque",
            "force_constant",
            "rated_force",
            "pinion_radius",
            "piston_area",
        )
    ),
    (dict(load_encoder="yes"), "True or False"),
    (dict(rated_torque=1.0, rated_force=1.0), "a motor has one"),
    (dict(lead=0.1, pinion_radius=0.02), "an axis has one"),
)
rows("Scaling.of", (dict(gain="2"), "number"))
rows(
    "Scaling.from_dict",
    (dict(data={"counts_per_trun": 1}), "Did you mean 'counts_per_turn'", "record.counts_per_trun"),
)
CASES.append(
    Case(
        "Scaling.from_file",
        dict(path="/nowhere/a.toml"),
        "no file",
        "a.toml",
        kind=FileNotFoundError,
    )
)
CASES += [
    Case("read_record", dict(source=3), "path", "read_record", kind=TypeError),
    Case("read_record", dict(source=None), "path", "read_record", kind=TypeError),
    Case(
        "read_record", dict(source="/nowhere/run.csv"), "no file", "run.csv", kind=FileNotFoundError
    ),
    Case("read_record", dict(source="/"), "one file", "directory", kind=IsADirectoryError),
    Case("read_record", dict(source="a\0b.csv"), "no file", "a", kind=FileNotFoundError),
]
BACK = T.copy()
BACK[900] = 0.0
files(
    "read_record",
    ("empty.csv", "", "empty.csv", "empty"),
    ("blank.csv", "\n\n# only this\n", "blank.csv", "no data"),
    ("heads.csv", "t,u,x\n", "heads.csv", "no data rows"),
    ("text.csv", columns(T[:20], U[:20], ["zero"] * 20), "row 2", "not a number"),
    ("hole.csv", columns(T[:20], U[:20], X[:20]) + "0.02,,1\n", "row 22", "empty"),
    ("ragged.csv", columns(T[:20], U[:20], X[:20]) + "0.02,1\n0.03,1,1\n", "row 22", "columns"),
    ("two.csv", columns(T[:20], U[:20], heading="t,u"), "two.csv", "at least t, u and x"),
    ("who.csv", columns(T, U, X, heading="a,b,c"), "who.csv", "columns="),
    ("nan.csv", columns(T, nan_at(U), X), "u", "dt="),
    ("back.csv", columns(BACK, U, X), "t", "sort"),
    ("gap.csv", columns(T[KEPT], U[KEPT], X[KEPT]), "dropped", "split_at_gaps"),
    ("twice.csv", columns(np.repeat(T, 2), np.repeat(U, 2), np.repeat(X, 2)), "t", "keep one"),
    ("wrap.csv", columns(T, U, WRAPPED), "x", "unwrap="),
    ("still.csv", columns(T, U, 0 * X), "x", "never moved"),
    ("huge.csv", columns(T, U, X), "huge.csv", "max_rows=", dict(max_rows=1000)),
    ("long.csv", b"t,u,x\n" + b"1" * 1_100_000, "line 2", "too long"),
    ("binary.csv", bytes(range(256)), "binary.csv", "plain text"),
    ("wide.csv", "t,u,x\n0,0,0\n".encode("utf-16")[:-1], "wide.csv", "plain text"),
    ("comma.csv", "t;u;x\n0,0;1.5;0\n", "comma.csv", "one way"),
    ("newer.csv", "# dryfric-control record 99 {}\n" + columns(T, U, X), "format 99", "update"),
    ("torn.csv", "# dryfric-control record 1 {\n" + columns(T, U, X), "torn.csv", "remove it"),
    ("unit.csv", columns(T, U, X, heading="t [h],u,x"), "'h'", "use s, ms"),
    ("run.xlsx", "t", "run.xlsx", "no .xlsx file"),
    ("run.xls", "t", "run.xls", "or CSV"),
    ("run.csv.gz", "t", "run.csv.gz", "not compressed by gzip"),
    ("run.json", "{}", "run.json", "read_bam"),
    ("run.foo", "t", "run.foo", "save it as CSV"),
    ("none.mat", "MATLAB 5.0", "none.mat", "no MAT-file"),
    ("hdf.mat", b"\x89HDF" + bytes(200), "hdf.mat", "-v7"),
    ("names.mat", {"a": T, "b": U}, "names.mat", "columns="),
    ("words.mat", {"t": "abc"}, "words.mat", "no numeric variable"),
    ("short.mat", {"t": T, "u": U[:-1], "x": X}, "u", "one length"),
    ("complex.mat", {"t": T, "u": U + 1j, "x": X}, "u", "real part"),
    ("table.mat", {"t": T, "u": np.zeros((50, 40, 2)), "x": X}, "u", "1-D"),
)


def bam(**changes: Any) -> str:
    """Log of 30 samples, of which the last one is spoiled."""
    entries = [
        {
            "timestamp": 4e-3 * k,
            "position": math.sin(0.1 * k),
            "goal_position": 0.0,
            "load": 100 + k,
            "input_volts": 7.5,
            "temp": 28.0,
            "torque_enable": True,
        }
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
    ("word.log", bam(position="here"), "position", "not a number"),
    ("null.log", bam(load=None), "load", "not a number"),
    ("nan.log", bam(position=NAN), "x|position", "remove|not finite"),
    ("back.log", bam(timestamp=0.0), "t", "sort"),
    ("gap.log", bam(timestamp=9.0), "gap", "max_gap|split"),
    ("big.log", bam(load=HUGE), "load", "too large"),
    ("deep.log", "[" * 100_000, "deep.log", "JSON"),
    ("step.log", bam(), "dt", "positive", dict(dt=0.0)),
)
CASES += [
    Case("read_bam", dict(path="/nowhere/log.json"), "no file", "log.json", kind=FileNotFoundError),
    Case("read_bam", dict(path=3), "file name", "3"),
]
CASES += [
    Case("datasets.emps", dict(path="/nowhere/DATA_EMPS.mat"), "download", "no file",
         kind=FileNotFoundError),
    Case("datasets.emps", dict(path=3), "file name", "3"),
]  # fmt: skip
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
    ("peak.toml", TOML + "[stribeck]\nexcess = 0.3", "stribeck.speed", "add speed"),
    ("low.toml", TOML + "[stribeck]\nexcess = 0.3\nspeed = -1.0", "stribeck.speed", POSITIVE),
    ("who.toml", TOML + "[[effects]]\nstiffness = 1.0", r"effects\[0\]", "name the effect"),
    ("other.toml", TOML + '[[effects]]\neffect = "sprng"', "sprng", "spring"),
    ("lack.toml", TOML + '[[effects]]\neffect = "spring"', "stiffness", "add stiffness"),
    (
        "more.toml",
        TOML + '[[effects]]\neffect = "spring"\nstiffness = 1\nmass = 2',
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
CASES += [
    Case(
        "read_axis",
        dict(path="/nowhere/axis.toml"),
        "axis.toml",
        kind=FileNotFoundError,
        says="nowhere",
    ),
    Case("read_axis", dict(path=3), "is no file name", "3"),
    Case("write_axis", dict(axis="axis"), "FrictionAxis"),
    Case("write_axis", {}, "axis.toml", "nowhere", kind=FileNotFoundError),
]
files(
    "load_design",
    ("empty.json", "", "empty.json", "JSON"),
    ("torn.json", '{"format": ', "torn.json", "JSON"),
    ("list.json", "[1, 2]", "list.json", "no observer design"),
    ("other.json", '{"format": "a"}', "other.json", "format = 'a', not"),
    (
        "newer.json",
        '{"format": "dryfric-control observer design", "version": 3}',
        "version 3",
        "newer package",
    ),
    (
        "bare.json",
        '{"format": "dryfric-control observer design", "version": 2}',
        "axis",
        "save the observer design again",
    ),
    ("deep.json", "[" * 100_000, "deep.json", "JSON"),
    ("vast.json", "9" * 9000, "vast.json", "JSON"),
    ("wide.json", b"\xff\xfe{\x00", "wide.json", "JSON"),
)
CASES += [
    Case(
        "load_design",
        dict(path="/nowhere/o.json"),
        "o.json",
        kind=FileNotFoundError,
        says="nowhere",
    ),
    Case("ObserverDesign.save", {}, "observer.json", "nowhere", kind=FileNotFoundError),
    Case("load_fit", dict(path="/nowhere/f.json"), "no file", "f.json", kind=FileNotFoundError),
    Case("load_record", dict(path="/nowhere/r.json"), "no file", "r.json", kind=FileNotFoundError),
    Case(
        "load_diagnosis", dict(path="/nowhere/d.json"), "no file", "d.json", kind=FileNotFoundError
    ),
]

# ----------------------------------------------------------------- observer
rows(
    "design_pi_observer",
    (dict(axis=2.0), "FrictionAxis"),
    (dict(dt=0.0), POSITIVE),
    (dict(dt=NAN), NUMBER),
    (dict(dt="1 ms"), "number"),
    (dict(dt=True), "number"),
    (dict(dt=1.0, discretization="euler"), "lower dt", "dt"),
    (dict(form="filtered"), "must be one of"),
    (dict(method="lqr"), "must be one of"),
    (dict(solver="mosek"), "must be one of"),
    (dict(method=["paper"]), "must be one of"),
    (dict(discretization="tustin"), "must be one of"),
    (dict(uncertainty=-1.0), NOT_NEGATIVE),
    (dict(uncertainty=0.0), "small force", "uncertainty is zero"),
    (dict(uncertainty={0: 1.0}), "name the modes"),
    (dict(uncertainty="big"), NUMBER),
    (dict(uncertainty={0: 1.0, 1: NAN, -1: 1.0}), "finite"),
    (dict(noise=-1e-6), NOT_NEGATIVE),
    (dict(noise=NAN), NUMBER),
    (dict(drift=-1.0), NOT_NEGATIVE),
    (dict(drift=INF), NUMBER),
    (dict(decay=0.0), "above 0"),
    (dict(decay=1.5), "above 0"),
    (dict(decay=NAN), NUMBER),
    (dict(performance=(1.0, 2.0)), "three weights"),
    (dict(performance=(0.0, 0.0, 0.0)), "not all zero"),
    (dict(performance=3.0), "three weights"),
    (dict(performance=(1.0, -1.0, 0.0)), NOT_NEGATIVE),
    (dict(encoder_quantum=0.0), POSITIVE),
    (dict(encoder_quantum=-1e-6), POSITIVE),
    (dict(window=2), "'path' or 'dwell'"),
    (dict(method="path", window=0), "1 to 64", "window"),
    (dict(window=1.5), "whole number"),
    (dict(method="path", window=65), "1 to 64", "window"),
    (dict(window="4"), "whole number"),
    (dict(refine=-1), "at least 0"),
    (dict(refine=0.5), "whole number"),
    (dict(refine="once"), "whole number"),
    (dict(method="paper", refine=1), "0 for 'paper'", "refine"),
    (dict(pairs=[(0, 3)]), "modes 0, 1, -1"),
    (dict(pairs=3), "changes of mode"),
    (dict(coulomb="8"), "level"),
    (dict(coulomb=-8.0), "magnitude"),
    (dict(stick_speed=0.0), POSITIVE),
    (dict(integral_modes=(0, 2)), "must be 0, +1 or -1".replace("+", r"\+"), "mode"),
    (dict(integral_modes=3), "modes"),
    (dict(integral_modes=(0,)), "integral_modes", "detectable"),
    (dict(axis=AXIS.replace(coulomb=0.0)), "amplitude of the unknown force", "uncertainty"),
    (dict(encoder_quantum=1e-6, noise=HUGE), NUMBER, "noise"),
)
rows(
    "hybrid_filter",
    (dict(axis=2.0), "FrictionAxis"),
    (dict(axis=AXIS.replace(coulomb=0.0)), "design_pi_observer", "no Coulomb friction"),
    (dict(dt=0.0), POSITIVE),
    (dict(dt="1 ms"), "number"),
    (dict(encoder_quantum=0.0), POSITIVE),
    (dict(encoder_quantum=NAN), NUMBER),
    (dict(excess=0.0), POSITIVE),
    (dict(excess_speed=-1.0), POSITIVE),
    (dict(level_walk=-0.1), NOT_NEGATIVE),
    (dict(force_noise=0.0), POSITIVE),
    (dict(mass_error="much"), NUMBER),
)
rows(
    "design_compensation",
    (dict(axis=2.0), "FrictionAxis"),
    (dict(dt=0.0), POSITIVE),
    (dict(encoder_quantum=-1e-6), NOT_NEGATIVE),
    (dict(input_delay=-1e-3), NOT_NEGATIVE),
    (dict(bandwidth=0.0), POSITIVE),
    (dict(bandwidth=1e6), "too high"),
    (dict(law="magic"), "learned"),
    (dict(gains=3.0), "kp, ki, kd"),
    (dict(gains=(0.0, 1.0, 1.0)), POSITIVE),
    (dict(limit=0.0), POSITIVE),
    (dict(limit=5.0), "breakaway friction force"),
    (dict(tolerance=-1e-6), POSITIVE),
    (dict(learning=-1.0), NOT_NEGATIVE),
    (dict(disturbance_bandwidth=0.0), POSITIVE),
    (dict(mismatch=1.0), "below 1"),
    (dict(mismatch=-0.1), NOT_NEGATIVE),
    (dict(correction=-0.1), NOT_NEGATIVE),
    (dict(correction=math.nan), "finite number"),
    (dict(noise=0.0), POSITIVE),
    (dict(noise=-0.1, gains=(1.0, 1.0, 1.0)), POSITIVE),
)
for _export in ("export_c", "export_fmu"):
    rows(
        _export,
        (dict(obj=2.0), "FrictionAxis"),
        (dict(name="2 fast"), "no C identifier"),
        (dict(name="switch"), "taken in C"),
        (dict(dt=0.0), POSITIVE),
        (dict(dt="1 ms"), NUMBER),
    )
rows("export_c", (dict(precision="half"), "double"), (dict(folder=3.0), "path"))
rows(
    "export_fmu",
    (dict(version="1.0"), "2.0"),
    (dict(path="axis.zip"), "ends in .fmu"),
    (dict(path=3.0), "path"),
)
CASES.append(
    Case(
        "load_compensation", dict(path="/nowhere/compensation.json"), "no file",
        "compensation.json", kind=FileNotFoundError,
    )
)  # fmt: skip


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
_WITHIN = (
    (dict(result=8.0), "a Diagnosis"),
    (dict(result={}), "by the name of their joint"),
    (dict(result={"z": 8.0}), "a Diagnosis", r"result\['z'\]"),
    (dict(result={"y": AXIS}), "it has 'z'", "joint 'y'"),
    (dict(result={3: AXIS}), "must be text", "joint"),
    (dict(result=AXIS.replace(units=("rad", "N m"))), "convert", "'z' is in"),
    (dict(joint="y"), "it has 'z'"),
    (dict(result={"z": AXIS}, joint="z"), "names its joints itself", "joint"),
    (dict(velocities="fast"), "array of numbers"),
    (dict(velocities=[0.0, 0.0]), "velocities of sliding"),
    (dict(velocities=[NAN]), "remove or fill"),
    (dict(out=3), "path of a file"),
    (dict(model=3), "path of a"),
)
for _name, _call in (("to_mjcf", _ARM), ("to_urdf", _URDF), ("to_modelica", _MO)):
    for _spoil, _mend, *_says in _WITHIN:
        CASES.append(Case(_name, _spoil, _mend, *(_says or (None,)), call=_call))
for _name, _file, _text, _says, _mend in (
    ("to_mjcf", "arm.xml", "<robot/>", "arm.xml", "not <mujoco>"),
    ("to_mjcf", "arm.xml", "<mujoco", "arm.xml", "no XML"),
    ("to_mjcf", "arm.xml", '<mujoco><include file="b.xml"/></mujoco>', "arm.xml", "b.xml"),
    ("to_mjcf", "arm.xml", _BODY.format("<joint/>"), "arm.xml", "name them"),
    ("to_mjcf", "arm.xml", _BODY.format(_SLIDE.format("z", "ball")), "'z'", "one axis"),
    ("to_urdf", "arm.urdf", "<mujoco/>", "arm.urdf", "not <robot>"),
    ("to_urdf", "arm.urdf", "<robot/>", "arm.urdf", "prismatic joint"),
    ("to_modelica", "Arm.mo", "model Arm end Arm;", "Arm.mo", "SupportFriction"),
):
    CASES.append(Case(_name, {}, _mend, _says, into(getattr(dfc, _name), _file, _text)))
rows(
    "to_mjcf",
    (dict(stiff=1), "True or False"),
    (dict(model="/nowhere/arm.xml"), "no file", "arm.xml", None, FileNotFoundError),
)
for _spoil, _mend, *_says in (
    (dict(load=-0.1), NOT_NEGATIVE),
    (dict(load="light"), NUMBER),
    (dict(load={"y": 0.1}), "one of 'z'"),
    (dict(load={"z": NAN}), NUMBER, r"load\['z'\]"),
):
    CASES.append(Case("to_mjcf", _spoil, _mend, *(_says or (None,)), call=_ARM))
for _name in ("to_isaac", "to_simscape"):
    rows(
        _name,
        (dict(result=8.0), "a Diagnosis"),
        (dict(result={}), "by the name of their joint"),
        (dict(result={3: AXIS}), "must be text", "joint"),
        (dict(result={"z": AXIS}, joint="z"), "names its joints itself", "joint"),
        (dict(joint=3), "must be text"),
        (dict(velocities="fast"), "array of numbers"),
        (dict(path=3), "path of a file"),
    )
rows("to_isaac", (dict(load=None), "give load"), (dict(load=-1.0), NOT_NEGATIVE))
rows(
    "to_simscape",
    (dict(result=AXIS.replace(units=("counts", "V"))), "the blocks take", "units"),
)
rows(
    "motion_profile",
    (dict(points="far"), "number"),
    (dict(points=[0.0, NAN]), "finite"),
    (dict(dt=0.0), POSITIVE),
    (dict(velocity=0.0), POSITIVE),
    (dict(acceleration=-1.0), POSITIVE),
    (dict(jerk=NAN), NUMBER),
    (dict(jerk=1e-30), "check the units", "jerk"),
    (dict(dwell=-1.0), "zero or more"),
    (dict(dwell=[0.0, 0.0, 0.0]), "one each"),
    (dict(unit="deg"), '"m" or "rad".*convert'),
    (dict(unit=None), '"m" or "rad".*convert'),
)
for _method in ("mode_matrices", "error_dynamics"):
    rows(f"ObserverDesign.{_method}", (dict(mode=2), r"0, \+1 or -1"), (dict(mode=None), r"0, \+1"))
for _face in ("pi_observer", "ObserverStepper", "observe"):
    rows(
        _face,
        (dict(design=AXIS), "design_pi_observer"),
        (dict(switching="printed"), "must be one of"),
        (dict(switching=None), "must be one of"),
        (dict(encoder_quantum=-1.0), NOT_NEGATIVE),
        (dict(encoder_quantum="1"), NUMBER),
    )
rows(
    "ObserverStepper",
    (dict(xhat0=NAN), NUMBER),
    (dict(vhat0="0"), NUMBER),
    (dict(what0=INF), NUMBER),
)
rows("ObserverStepper.step", (dict(u=NAN), NUMBER), (dict(y=INF), NUMBER), (dict(y=None), NUMBER))
rows(
    "observe",
    (dict(u=[0.0]), "one of each", "u"),
    (dict(u=[]), "at least one sample"),
    (dict(u=[0.0, NAN]), "fill"),
    (dict(y=[INF, 0.0]), "index 0"),
    (dict(y="01"), "array of numbers"),
    (dict(y=[[0.0, 0.0]]), r"shape \(n,\)"),
    (dict(xhat0=NAN), NUMBER),
    (dict(vhat0=None), NUMBER),
    (dict(what0=NAN), NUMBER),
)
for _loop in ("observed_loop", "simulate_observed_loop"):
    rows(
        _loop,
        (dict(axis=None), "FrictionAxis"),
        (dict(controller=1.0), "PositionController"),
        (dict(design="d"), "design_pi_observer"),
        (dict(bandwidth=0.0), POSITIVE),
        (dict(bandwidth=9000.0), "lower it"),
        (dict(quantum=-1.0), NOT_NEGATIVE),
        (dict(switching="printed"), "must be one of"),
        (dict(controller=dataclasses.replace(CONTROLLER, dt=2e-3)), "one sampling time"),
    )
rows(
    "simulate_observed_loop",
    (dict(reference=nan_at(X)), "fill"),
    (dict(reference=[]), "at least one sample"),
    (dict(x0=NAN), NUMBER),
    (dict(v0=NAN), NUMBER),
    (dict(xhat0=INF), NUMBER),
    (dict(vhat0="0"), NUMBER),
    (dict(what0=NAN), NUMBER),
)
rows(
    "monte_carlo",
    (dict(design=None), "design_pi_observer"),
    (dict(controller=None), "PositionController"),
    (dict(controller=dataclasses.replace(CONTROLLER, dt=2e-3)), "one sampling time"),
    (dict(reference=[NAN]), "fill"),
    (dict(axis=3), "FrictionAxis"),
    (dict(quantum=-1.0), NOT_NEGATIVE),
    (dict(quantum="1"), NUMBER),
    (dict(stribeck_speed=0.0), POSITIVE),
    (dict(stribeck_speed=NAN), NUMBER),
    (dict(runs=0), "at least 1"),
    (dict(runs=2.5), "whole number"),
    (dict(runs="many"), "whole number"),
    (dict(runs=NAN), "whole number"),
    (dict(xhat0=NAN), NUMBER),
    (dict(estimators={}), "at least one"),
    (dict(estimators=3), "mapping"),
    (dict(estimators={"a": 3}), "estimate"),
    (dict(seed=-1), "seed"),
    (dict(seed="x"), "seed"),
    (dict(store=3), "path of a file"),
    (dict(store="."), "name a file in it"),
    (dict(store="nowhere/runs.jsonl"), "make it first"),
    (dict(jobs=0), "whole number other than 0"),
    (dict(jobs="all"), "whole number other than 0"),
)
rows(
    "run_batch",
    (dict(function=3), "callable"),
    (dict(cases=[1.0]), r"dict\(enumerate"),
    (dict(cases={NAN: 1.0}), "finite numbers, text", "cases"),
    (dict(settings=3), "mapping of names"),
    (dict(store=3), "path of a file"),
    (dict(store="."), "name a file in it"),
    (dict(jobs=0), "whole number other than 0"),
    (dict(jobs=True), "whole number other than 0"),
)
rows(
    "diagnose_batch",
    (dict(axis="z"), "FrictionAxis"),
    (dict(records=3), "mapping of names"),
    (dict(records=[X]), "read_record", r"records\[0\]"),
    (dict(window=0.0), POSITIVE),
    (dict(window=60.0), "choose"),
    (dict(hold="second"), '"zero" or "first"'),
    (dict(store=3), "path of a file"),
    (dict(jobs=0), "whole number other than 0"),
)

rows(
    "EndStop",
    (dict(low=0.2, high=0.1, stiffness=1e3), "exchange them", "end_stop.low"),
)
_WALL = AXIS.replace(effects=(dfc.effects.EndStop(-0.1, 0.1, 1e15),))
CASES.append(
    Case(
        "FrictionAxis.simulate", {}, "Use at most", "end_stop.* is too stiff",
        lambda: _WALL.simulate([0.0], DT),
    )
)  # fmt: skip
rows(
    "Record.commanded",
    (dict(gain=0.0), "more than zero|positive"),
    (dict(gain="stiff"), "number"),
)
rows(
    "diagnose_joints",
    (dict(joints=3), "mapping of names"),
    (dict(joints={}), "not empty"),
    (dict(joints={"elbow": AXIS}), r"\(axis, records\)", r"joints\['elbow'\]"),
    (dict(joints={"elbow": ("z", RECORD)}), "FrictionAxis", r"joints\['elbow'\]\[0\]"),
    (dict(joints={"elbow": (AXIS, X)}), "read_record", r"joints\['elbow'\]\[1\]"),
    (dict(joints={"elbow": (AXIS, [])}), "at least one", r"joints\['elbow'\]\[1\]"),
    (dict(known=("weight",)), "choose from"),
    (dict(tolerance={"mass": 0.0}), POSITIVE),
    (dict(time_limit=0.0), POSITIVE),
    (dict(window=60.0), "choose"),
    (dict(hold="second"), '"zero" or "first"'),
    (dict(store=3), "path of a file"),
    (dict(jobs=0), "whole number other than 0"),
)

# ----------------------------------------------- identification and diagnosis
for _name in ("fit", "replay", "replay_loop", "identify_stribeck", "diagnose", "next_experiment"):
    rows(_name, (dict(axis="z"), "FrictionAxis"))
for _name in (
    "fit",
    "replay",
    "replay_loop",
    "identify_coulomb",
    "identify_stribeck",
    "diagnose",
    "next_experiment",
    "Fit.replay",
):
    rows(_name, (dict(record=X), "Record"), (dict(record=None), "Record"))
for _name in ("fit", "replay", "diagnose"):
    rows(
        _name,
        (dict(window=0.0), POSITIVE),
        (dict(window=NAN), NUMBER),
        (dict(window="1 s"), NUMBER),
        (dict(window=1e-3), "choose between"),
        (dict(window=60.0), "choose|windows"),
        (dict(hold="second"), '"zero" or "first"'),
    )
rows(
    "fit",
    (dict(record=[]), "at least one Record", "record"),
    (dict(record=[RECORD, 3]), "Record"),
    (dict(record="run.csv"), "read_record", "got 'run.csv'"),
    (dict(free=()), "at least one parameter"),
    (dict(free=("masss",)), "choose from|did you mean"),
    (dict(free=("mass", "mass")), "more than once"),
    (dict(free=(3,)), "names such as"),
    (dict(free=3), "names such as"),
    (dict(free=("spring.mass",)), "it has"),
    (dict(free=("coulomb", "coulomb_plus")), "one or the other"),
    (dict(starts=0), "at least 1"),
    (dict(starts=1.5), "whole number"),
    (dict(starts="two"), "whole number"),
    (dict(block=0.0), POSITIVE),
    (dict(block=NAN), NUMBER),
    (dict(seed=-1), "seed"),
    (dict(seed="x"), "seed"),
    (dict(jobs=0), "jobs"),
    (dict(jobs="all"), "jobs"),
)
rows(
    "Fit.interval",
    (dict(level=0.0), "between 0 and 1"),
    (dict(level=90.0), "between 0 and 1"),
    (dict(level=NAN), "between|finite"),
)
rows(
    "Fit.bootstrap",
    (dict(level=1.0), "between 0 and 1"),
    (dict(repeats=0), "at least 1"),
    (dict(seed=-1), "seed"),
)
rows("Fit.replay", (dict(window=0.0), POSITIVE))
rows("Fit.plot", (dict(ax=3), "2 axes"))
rows("replay", (dict(shift=NAN), NUMBER), (dict(shift="late"), NUMBER))
rows(
    "replay_loop",
    (dict(controller=3.0), "PositionController"),
    (dict(record=dfc.Record(T, U, X)), "reference"),
    (dict(controller=dataclasses.replace(CONTROLLER, dt=2e-3)), "agree"),
)
rows(
    "identify_coulomb",
    (dict(degree=-1), "whole number from 0"),
    (dict(degree=99), "whole number from 0"),
    (dict(degree=1.5), "whole number from 0"),
    (dict(degree="one"), "whole number from 0"),
    (dict(axis=3.0), "FrictionAxis"),
)
rows(
    "identify_stribeck",
    (dict(free=3), "names such as"),
    (dict(starts=0), "at least 1"),
    (dict(starts="two"), "whole number"),
    (dict(jobs=0), "jobs"),
    (dict(controller=3.0), "PositionController"),
)
rows(
    "slow_ramp_experiment",
    (dict(axis=None), "FrictionAxis"),
    (dict(axis=AXIS.replace(travel=None)), "give travel", "travel"),
    (dict(duration=0.0), POSITIVE),
    (dict(duration=NAN), NUMBER),
    (dict(duration=2e-3), "longer|samples"),
    (dict(dt=0.0), POSITIVE),
    (dict(dt="1 ms"), NUMBER),
    (dict(bandwidth=-1.0), POSITIVE),
    (dict(travel=(0.3, 0.0)), "low to high"),
    (dict(travel=0.3), r"\(low, high\)"),
    (dict(travel=(0.0, NAN)), "finite"),
    (dict(quantum=-1.0), NOT_NEGATIVE),
    (dict(quantum=NAN), NUMBER),
    (dict(controller=3.0), "PositionController"),
    (dict(controller=dataclasses.replace(CONTROLLER, dt=2e-3)), "agree"),
    (dict(duration=1e12), "samples"),
)
for _name in ("fit", "diagnose"):
    rows(
        _name,
        (dict(known=3), "names such as"),
        (dict(known=("weight",)), "choose from mass"),
        (dict(tolerance=3), "such as"),
        (dict(tolerance={"mass": -1.0}), "more than zero"),
        (dict(tolerance={"weight": 0.1}), "choose from mass"),
        (dict(known=("mass",), tolerance={"mass": 0.1}), "in one of the two"),
    )
rows(
    "diagnose",
    (dict(time_limit=0.0), POSITIVE),
    (dict(window=0.5), "shorter window"),
    (dict(jobs=0), "jobs"),
    (dict(jobs="all"), "jobs"),
    (dict(on_update=True), "function of a step"),
)
rows(
    "next_experiment",
    (dict(rivals=3), "sequence of FrictionAxis"),
    (dict(rivals=["a"]), "FrictionAxis"),
    (dict(names=["a"]), "2 different names"),
    (dict(names=["a", "a"]), "2 different names"),
    (dict(names=3), "names"),
    (dict(names=["a", 3]), "names"),
    (dict(limits=3), "Limits"),
)
for _limits in (dict(travel=(1.0, 0.0)), dict(drive=0.0), dict(speed=NAN), dict(travel=3.0)):
    CASES.append(
        Case(
            "next_experiment",
            {},
            "low to high|more than zero|finite|low, high",
            f"limits.{next(iter(_limits))}",
            functools.partial(Limits, **(dict(travel=(0.0, 1.0), drive=1.0, speed=1.0) | _limits)),
        )
    )
rows("Experiment.to_csv", ({}, "read its description", "no reference"))
rows("Experiment.plot", (dict(ax=3), "2 axes"))
for _name in ("presets.clutch_observer", "presets.clutch_controller", "presets.crawl_and_steps"):
    rows(_name, (dict(dt=0.0), "positive|more than zero"), (dict(dt="1 ms"), "number"))
rows("presets.crawl_and_steps", (dict(duration=-1.0), POSITIVE), (dict(duration=NAN), NUMBER))
rows(
    "presets.clutch_experiment",
    (dict(design=3), "design_pi_observer"),
    (dict(duration=0.0), POSITIVE),
)
rows(
    "presets.clutch_monte_carlo",
    (dict(design=3), "design_pi_observer"),
    (dict(runs=0), "at least 1"),
)


# -------------------------------------------------------------------- tests


@contextlib.contextmanager
def no_work(patch: pytest.MonkeyPatch) -> Iterator[None]:
    """Nothing is simulated, solved or fitted inside."""

    def refuse(*_: Any, **__: Any) -> Any:
        raise AssertionError("work began before the arguments were looked at")

    with patch.context() as here:
        here.setattr(axis_step, "run", refuse)
        here.setattr(axis_step, "step", refuse)
        here.setattr(loops, "run_loop", refuse)
        here.setattr(windows, "free_runs", refuse)
        here.setattr(runtime.kernel, "run", refuse)
        here.setattr(synthesis, "certified_solution", refuse)
        here.setattr(joblib.Parallel, "__call__", refuse)
        yield


def shown(value: Any) -> set[str]:
    """Ways in which a message may show a value; empty if it is too long to be shown."""
    if isinstance(value, float) and not isinstance(value, np.floating):
        return {repr(value), f"{value:g}", "float"}
    if isinstance(value, (bool, str)) or (isinstance(value, int) and abs(value) < 10**20):
        return {str(value), type(value).__name__}
    return set()


@pytest.mark.parametrize("case", CASES, ids=str)
def test_bad_input_is_told(case, tmp_path, monkeypatch):
    call, sound = SOUND[case.name]
    arguments = sound | case.spoil
    if case.call is not None:
        call, arguments = case.call, dict(case.spoil)
        if hasattr(call, "needs_folder"):
            arguments["folder"] = tmp_path
    design()  # made before anything is forbidden
    if case.name.startswith("Fit."):
        fitted()
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.iterdir())
    with no_work(monkeypatch), pytest.raises(case.kind) as caught:
        call(**arguments)
    text = str(caught.value)
    first = next(iter(case.spoil), None)
    assert re.search(case.says or str(first), text), f"{text!r} does not name {case.says or first}"
    assert re.search(case.mend, text), f"{text!r} does not say {case.mend!r}"
    if len(case.spoil) == 1 and case.says is None and case.kind is ValueError and first != "ax":
        ways = shown(case.spoil[first])
        assert not ways or any(way in text for way in ways), f"{text!r} does not show {ways}"
    assert len(text) < 1000
    if case.call is None:
        assert sorted(tmp_path.iterdir()) == before


def test_sound_calls_are_sound():
    """What a row spoils works unspoiled, so that the row fails for its own reason."""
    reads = (
        "read_",
        "load_",
        "write_",
        "to_csv",
        "from_f",
        ".save",
        "fit",
        "presets",
        "datasets",
        "Fit",
        "export_",
        "to_mjcf",
        "to_urdf",
        "to_modelica",
        "to_isaac",
        "to_simscape",
    )
    slow = ("diagnose", "next_experiment", "identify_", "slow_ramp", "monte_carlo", "design_pi")
    for name, (call, arguments) in SOUND.items():
        if not any(word in name for word in (*reads, *slow, "plot", "SimulationResponse")):
            call(**arguments)


def test_every_public_name_is_in_the_table():
    named = {name.split(".")[0] for name in {case.name for case in CASES}}
    assert set(PUBLIC) - named <= NOTHING_TO_SPOIL
    assert not NOTHING_TO_SPOIL & named
    assert not {case.name for case in CASES} - set(SOUND)
    assert set(SOUND) == {case.name for case in CASES}


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


def test_no_two_rows_are_the_same():
    rows = [(case.name, repr(case.spoil), case.mend, case.says, case.call) for case in CASES]
    assert len({str(row) for row in rows}) == len(rows)
    assert len(rows) >= 200


# ------------------------------------------------------------------ warnings

CLIPPED = np.clip(40.0 * np.sin(30.0 * T) + 5.0 * np.sin(211.0 * T), -20.0, 20.0)
JUMP = np.where(np.arange(N) == 900, X + 0.9 * np.ptp(X), X)
SUSPECT: dict[str, tuple[Callable[[], Any], str]] = {
    "time in ms": (lambda: dfc.Record(1e3 * T, U, X), "milliseconds.*t \\* 0.001"),
    "time in us": (lambda: dfc.Record(1e6 * T, U, X), "microseconds.*t \\* 1e-06"),
    "input clipped": (lambda: dfc.Record(T, CLIPPED, X), "clipped.*force that acted"),
    "glitch": (lambda: dfc.Record(T, U, JUMP), "masked: 1 jump"),
    "irregular time in ms": (
        lambda: dfc.Record.from_irregular(1e3 * T, U, X),
        "milliseconds",
    ),
    "mapping, time in ms": (
        lambda: dfc.read_record({"t": 1e3 * T, "u": U, "x": X}),
        "milliseconds",
    ),
    "short stretches lost": (
        lambda: dfc.Record.split_at_gaps(
            *(a[(np.arange(N) < 700) | (np.arange(N) > 1994)] for a in (T, U, X))
        ),
        "5 samples .* left out",
    ),
    "observer leaves out": (
        lambda: dfc.design_pi_observer(
            AXIS.replace(effects=(dfc.effects.Presliding(1e-5),)), DT, encoder_quantum=1e-6
        ),
        "leaves out presliding",
    ),
    "observer, counts for metres": (
        lambda: dfc.design_pi_observer(AXIS, DT, encoder_quantum=1.0),
        "one count in m, not a number of counts",
    ),
    "filter, counts for metres": (
        lambda: dfc.hybrid_filter(AXIS, DT, encoder_quantum=1.0),
        "one count in m, not a number of counts",
    ),
    "compensation, counts for metres": (
        lambda: dfc.design_compensation(AXIS, DT, encoder_quantum=1.0),
        "one count in m, not a number of counts",
    ),
}


@pytest.mark.filterwarnings("ignore:x jumps")  # the stretch cut out of one of them
@pytest.mark.parametrize("case", SUSPECT)
def test_suspect_input_brings_a_warning(case):
    call, words = SUSPECT[case]
    with pytest.warns(UserWarning, match=words):
        call()
