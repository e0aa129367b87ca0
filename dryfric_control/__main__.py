"""Command line: ``python -m dryfric_control`` demo, diagnose, joints, arm, export, simulator."""

from __future__ import annotations

import argparse
import json
import re
import sys
import warnings
from argparse import Namespace
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, NoReturn

import matplotlib

from dryfric_control import demo, simulators
from dryfric_control._version import __version__
from dryfric_control.arm import diagnose_arm
from dryfric_control.checks import positive
from dryfric_control.compensation import Compensation
from dryfric_control.diagnosis import Diagnosis, diagnose, diagnose_joints
from dryfric_control.diagnosis.report.diagnosis import write_report
from dryfric_control.estimation.parameters import checked_knowledge
from dryfric_control.export.c_code import export_c
from dryfric_control.export.fmu import export_fmu
from dryfric_control.export.objects import export_object
from dryfric_control.identification import Fit, axis_from
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.observer import Observer
from dryfric_control.records import Record, Scaling, read_record
from dryfric_control.records.scaling import read_sampling
from dryfric_control.simulators.mujoco_model import axes_of
from dryfric_control.store.axis_file import read_axes, read_axis, read_knowledge
from dryfric_control.store.files import existing_folder, output_folder, write_file
from dryfric_control.store.saved import load_any
from dryfric_control.text import did_you_mean
from dryfric_control.units import check_units

#: Format of a model by its extension.
_SIMULATORS = {".xml": "mjcf", ".urdf": "urdf", ".mo": "modelica", ".m": "simscape", ".py": "isaac"}
# Coulomb level to start from, over the largest drive, where a model has none.
_GUESS = 0.2


def _pairs_as_option(told: re.Match[str]) -> str:
    """A mapping of an argument in Python as it is given on the command line."""
    pairs = re.findall(r"""["'](\w+)["']: (?:"([^"]*)"|'([^']*)'|([^,]*))""", told[2])
    return f"--{told[1]} " + ",".join(f"{role}={''.join(said)}" for role, *said in pairs)


#: What messages say of arguments in Python, and how it is said of options.
_AS_OPTIONS = tuple(
    (re.compile(pattern), option)
    for pattern, option in (
        (r"Split there .*read_record\(\.\.\., dt=(\S+)\)", r"Fill them by --dt \1"),
        (r"Use Record\.split_at_gaps\(\.\.\.\), or allow it with max_gap=(\S+)",
         r"Allow it with --max-gap \1"),
        (r"these samples, or bridge and mask them by .*",
         "these rows, or give --dt, which fills and masks them"),
        (r"give rate= and", "give --rate and"),
        (r"or one joint: joint=\.\.\.", "or one joint: --joint"),
        (r"leave rate= out, .*", "leave --rate out"),
        (r" Of files with one channel each, .*", ""),
        (r"give (dt|rate)= \[", r"give --\1 ["),
        (r'pass name="\.\.\."', "give --name"),
        (r"pass t \* \S+ or (units=\S+ \S+) to read_record", r"give \1"),
        (r"dfc\.axis_from\(record\) makes another", "correct its file"),
        (r"anyway=True goes on", "--anyway goes on"),
        (r"read_record\(\.\.\., ((?:gain|units)=[^()]*)\)", r"\1"),
        (r"\bgain=-1\b", "--gain -1"),
        (r"\b(gain|units)=\.\.\.", r"--\1"),
        (r"gain=dfc\.Scaling\([^()]*\)", "the numbers of the machine (--help lists them)"),
        (r"with units=\('(.*?)', '(.*?)'\)", r'with units = ["\1", "\2"] in its file'),
        (r"\b(columns|gain|units)=\{([^{}]*)\}", _pairs_as_option),
    )
)  # fmt: skip


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are one line: what is wrong stands there, not below the usage."""

    def error(self, message: str) -> NoReturn:
        """End with what is wrong and where the options are listed."""
        mark = "" if message.endswith("?") else ";"
        self.exit(2, f"{self.prog}: {message}{mark} {self.prog} --help lists all options\n")


def parser() -> argparse.ArgumentParser:
    """Parser of the command line."""
    top = _Parser(
        prog="python -m dryfric_control", description="Control of machines with dry friction."
    )
    top.add_argument("--version", action="version", version=__version__)
    commands = top.add_subparsers(
        required=True, metavar="{demo,diagnose,joints,arm,export,simulator}"
    )

    def command(
        run: Callable[[Namespace], int | None], words: str, more: str, *options: tuple[Any, ...]
    ) -> None:
        """One with options: name, type (None for a switch), placeholder, meaning, settings."""
        made = commands.add_parser(run.__name__[1:], help=words, description=more or None)
        made.set_defaults(run=run, own=made)
        for name, kind, metavar, meaning, *settings in options:
            own = {"action": "store_true"} if kind is None else {"type": kind, "metavar": metavar}
            made.add_argument(name, help=meaning, **own, **dict(*settings))

    command(
        _demo,
        "stick-slip, a fit with its replay, the figures of the paper, a diagnosis",
        "",
        ("--out", str, "DIR", "folder for the results", {"default": "demo"}),
        ("--record", str, "FILE", "measured record (CSV or MAT); default: a simulated one"),
        ("--dt", float, "S", "step of its time, where rows were lost"),
    )

    command(
        _diagnose,
        "find what the simulation of an axis gets wrong about a record, and why",
        "Writes report.html, report.png, diagnosis.json, extended.toml and saved.json, "
        "which dfc.Diagnosis.load reads in Python. Options on counts, gear, motor and sampling "
        "(dt, rate, max_gap) may also be given in the table [record] of the axis file; an option "
        "overrides it.",
        ("record", str, "RUN.csv", "measured records of one machine (CSV, MAT, xlsx, parquet)",
         {"nargs": "+"}),
        ("--axis", str, "FILE", "the nominal axis, TOML; default: mass and friction that the first "
         "record shows"),
        ("--out", str, "DIR", "folder of the results", {"default": "diagnosis"}),
        ("--joint", str, "NAME", "joint of a log of several, as in its headings"),
        *_READING,
    )  # fmt: skip

    command(
        _joints,
        "diagnose the joints of a log, and set their values in the file of a simulator",
        "Writes joints.json, saved.json and report.html of each joint in a folder of "
        "its name, and the model with the values of the joints. joints.jsonl keeps every joint "
        "that is finished: the same command goes on where it was interrupted.",
        ("record", str, "LOG", "logs with columns for each joint (mcap, CSV, ..)", {"nargs": "+"}),
        ("--out", str, "DIR", "folder for the results", {"default": "joints"}),
        ("--jobs", int, "N", "joints in parallel, by default one a core", {"default": -1}),
        ("--axes", str, "FILE", "nominal axes, TOML with a table for each joint; default: those of "
         "the MJCF model, by MuJoCo"),
        ("--model", str, "FILE", "MJCF (.xml) or URDF (.urdf) file"),
        ("--joints", _names, "elbow,..", "joints to take, by default all of the axes"),
        *_INTO_MODEL,
        *_READING,
    )  # fmt: skip

    command(
        _arm,
        "diagnose an arm: its joints with the coupling of its model, and errors of the model",
        "Writes arm.html, arm.json, report.html of each joint in a folder of its name, and the "
        "model with the values of the joints. joints.jsonl keeps every joint that is finished: the "
        "same command goes on where it was interrupted.",
        ("log", str, "LOG", "log with columns for all joints (mcap, CSV, ..)"),
        ("--model", str, "FILE", "MJCF (.xml) or URDF (.urdf) file", _NEEDED),
        ("--out", str, "DIR", "folder for the results", {"default": "arm"}),
        ("--jobs", int, "N", "joints in parallel, by default one a core", {"default": -1}),
        ("--axes", str, "FILE", "nominal axes, TOML with a table for each joint; default: inertia "
         "and friction of the model"),
        ("--held", _parse_held, "hand=0.3,..", "joints that do not move and are not in the log, "
         "with their positions [rad or m], default: those of the model"),
        ("--payload", _payloads, "hand=0.8,..", "masses that bodies carry beyond the model "
         "[kg]"),
        *_READING,
    )  # fmt: skip

    command(
        _export,
        "write an axis or a design as C99 or as an FMU",
        "",
        ("file", str, "FILE", "axis (TOML), observer or compensation (JSON, as saved)"),
        ("--to", str, None, "what to write", _NEEDED | {"choices": ("c", "fmu")}),
        ("--out", str, "DIR", "folder for the files", {"default": "export"}),
        ("--name", str, "NAME", "prefix of the names in C"),
        ("--dt", float, "S", "sampling time of an axis [s], default 0.001"),
        ("--precision", str, None, "of the C code, default double",
         {"choices": ("double", "single", "mixed")}),
        ("--version", str, None, "of the FMU, default 3.0", {"choices": ("3.0", "2.0")}),
    )  # fmt: skip

    command(
        _simulator,
        "set friction, damping and armature of joints in the file of a simulator",
        "Every other byte of the model stays. What the format cannot state is listed "
        "with what takes its place and the error that makes.",
        ("result", str, "[JOINT=]FILE", "axis (TOML), fit or diagnosis (JSON, as saved), by the "
         "name of its joint if there are several", {"nargs": "+"}),
        ("--model", str, "FILE", "MJCF (.xml), URDF (.urdf) or Modelica (.mo) file; the file to "
         "write for isaac (.py) and simscape (.m)", _NEEDED),
        ("--to", str, None, "format, by default that of the extension",
         {"choices": (*_SIMULATORS.values(),)}),
        ("--out", str, "FILE", "file to write in place of the model"),
        *_INTO_MODEL,
    )  # fmt: skip
    return top


def _parse_held(text: str) -> dict[str, float] | list[str]:
    """Positions by joint, or names of joints."""
    return _numbers("such as hand=0.3,gripper=0")(text) if "=" in text else _names(text)


def _names(text: str) -> list[str]:
    """Names between commas."""
    return [name.strip() for name in text.split(",")]


def _pairs(text: str) -> dict[str, str | None]:
    """Mapping from ``t=a,u=b``; None for none."""
    pairs: dict[str, str | None] = {}
    for part in text.split(","):
        role, mark, value = (word.strip() for word in part.partition("="))
        if not (mark and value):
            raise argparse.ArgumentTypeError(f"{part!r} must be such as u=force")
        pairs[role] = None if value.lower() == "none" else value
    return pairs


def _numbers(right: str, alone: Callable[[float], Any] | None = None) -> Callable[[str], Any]:
    """Reader of numbers by name, or of one alone for `alone`; `right` is said in errors."""

    def read(text: str) -> Any:
        try:
            if alone and "=" not in text:
                return alone(float(text))
            return {name: float(value or "none") for name, value in _pairs(text).items()}
        except (ValueError, argparse.ArgumentTypeError):
            raise argparse.ArgumentTypeError(f"{text!r} must be {right}") from None

    return read


_gains = _numbers("a number or such as u=35,x=1e-6", lambda factor: {"u": factor})
_tolerances = _numbers("such as viscous=0.5,mass=0.1")
_payloads = _numbers("such as hand=0.8")
_loads = _numbers("a number or such as elbow=0.1,wrist=0.02", float)


def _machine_options() -> Iterator[tuple[Any, ...]]:
    """Numbers of the machine, by the fields of a scaling; None where an option is not given."""
    for item in fields(Scaling)[1:]:  # but the factors by channel
        name = item.name.replace("_", "-")
        words = item.metadata["doc"].replace("%", "%%")
        kind, metavar = (None, None) if item.default is False else (float, "X")
        yield f"--{name}", kind, metavar, words, {"default": None}


_NEEDED = {"required": True}
#: How values come into the file of a simulator.
_INTO_MODEL = (
    ("--load", _loads, "J or JOINT=J,..", "inertia that the bodies of the model have about the "
     "joint [kg m^2]; MJCF: computed by MuJoCo if it is installed"),
    ("--stiff", None, None, "MJCF: let joints at rest creep fifty times less",
     {"default": None}),
    ("--dialect", str, "3.2|4.0", "MJCF: version of MuJoCo whose words are used, by default that "
     "which is installed", {"choices": ["auto", "3.2", "4.0"]}),
)  # fmt: skip
#: How records are read, and what a diagnosis may rely on.
_READING = (
    ("--columns", _pairs, "t=..,u=..,x=..", "headings or numbers of time, input and position "
     "where they are not the usual ones, none for none"),
    ("--units", _pairs, "t=..,u=..,x=..", "units as stored, such as t=ms,x=mm, where the "
     "headings do not give them"),
    ("--gain", _gains, "K or u=..,x=..", "factor of the input, such as N per V, or factors by "
     "channel"),
    *_machine_options(),
    ("--dt", float, "S", "resample irregular time stamps to this step [s]; without a time "
     "column, the step"),
    ("--rate", float, "HZ", "samples per second of a file without time column"),
    ("--max-gap", float, "S", "longest gap that --dt may fill [s]"),
    ("--known", _names, "mass,..", "nominal values that are right"),
    ("--tolerance", _tolerances, "viscous=0.5,..", "relative standard deviations of nominal "
     "values"),
    ("--time-limit", float, "S", "time after which the best answer so far is returned [s]"),
    ("--window", float, "S", "length of the free runs [s], 0.25 by default"),
    ("--anyway", None, None, "go on where a record certainly has a wrong unit or sign",
     {"default": None}),
    ("--quiet", None, None, "no progress bar"),
)  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line: 0, 1 where a joint failed, 2 after an error, 130 after an interrupt."""
    chosen, unknown = parser().parse_known_args(arguments)
    if unknown:
        near = did_you_mean(unknown[0], chosen.own._option_string_actions)
        chosen.own.error(f"{' '.join(unknown)} is not known{near}")
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_, **__: _print_message(f"warning: {message}")
        matplotlib.use("Agg")
        try:
            return chosen.run(chosen) or 0
        except (ValueError, OSError, ImportError) as problem:
            _print_message(str(problem))
            return 2
        except KeyboardInterrupt:
            _print_message("interrupted")
            return 130


def _print_message(words: str) -> None:
    """Print an error or a warning in one line, with options for arguments."""
    words = " ".join(words.split())
    for pattern, option in _AS_OPTIONS:
        words = pattern.sub(option, words)
    print(f"{parser().prog}: {words}", file=sys.stderr)


def _demo(chosen: Namespace) -> None:
    demo.run(chosen.out, chosen.record, dt=chosen.dt)


def _read_options(
    chosen: Namespace, file: str | None
) -> tuple[Scaling, dict[str, Any], dict[str, Any]]:
    """Factors, sampling and knowledge of the options and of a file of axes."""
    scaling = Scaling() if file is None else Scaling.from_file(file)
    scaling = replace(scaling, **_given_options(chosen, *(item.name for item in fields(Scaling))))
    knowledge = {} if file is None else read_knowledge(file)
    knowledge |= _given_options(chosen, "known", "tolerance", "time_limit", "window", "anyway")
    checked_knowledge(knowledge.get("known", ()), knowledge.get("tolerance"))
    for name in ("time_limit", "window"):
        if name in knowledge:
            positive(name, knowledge[name], unit="s")
    # A rate excludes dt and max_gap: an option also replaces what it excludes in the file.
    sampling = {} if file is None or chosen.rate is not None else read_sampling(file)
    if chosen.dt is not None:
        sampling.pop("rate", None)
    return scaling, sampling | _given_options(chosen, "dt", "rate", "max_gap"), knowledge


def _given_options(chosen: Namespace, *names: str) -> dict[str, Any]:
    """Values of the options that were given, of some names."""
    found = {name: getattr(chosen, name) for name in names}
    return {name: value for name, value in found.items() if value is not None}


def _read_records(
    chosen: Namespace, axis: FrictionAxis | None, end: str, **options: Any
) -> list[Record]:
    """Records of an axis, or of one that is not known, with what a first look at each shows."""
    records = []
    for path in chosen.record:
        name = f"{Path(path).name}{end}"
        record = read_record(path, chosen.columns, units=chosen.units, **options)
        check = record.check()
        if check.assumed:
            print(f"{name}: units: {check.assumed}")
            check = replace(check, units=check.units if axis is None else axis.units)
        print(f"{name}: {check.headline}")
        records.append(record)
    return records


def _diagnose(chosen: Namespace) -> None:
    axis = None if chosen.axis is None else read_axis(chosen.axis)
    scaling, sampling, knowledge = _read_options(chosen, chosen.axis)
    records = _read_records(chosen, axis, "", gain=scaling, joint=chosen.joint, **sampling)
    if axis is None:
        axis = axis_from(records[0])
        print(f"no --axis: that of the record\n{axis}")
    for path, record in zip(chosen.record, records, strict=True):
        check_units(axis, record, Path(path).name)
    folder = output_folder(chosen.out)
    found = diagnose(
        axis,
        records if len(records) > 1 else records[0],
        progress=not chosen.quiet and sys.stderr.isatty(),
        **knowledge,
    )
    try:  # What was found outlives a disk that is full, and a reader that closed the pipe.
        print(found.summary(), flush=True)
    finally:
        write_report(found, folder, scaling.to_dict() | sampling)
    print(f"report.html, report.png, diagnosis.json, extended.toml and saved.json are in {folder}")


def _joints(chosen: Namespace) -> int:
    model = _joints_model(chosen)
    scaling, sampling, knowledge = _read_options(chosen, chosen.axes)
    axes = _joint_axes(chosen, model)
    cases, refused = _read_joints(chosen, axes, scaling, sampling)
    folder = output_folder(chosen.out)
    found = diagnose_joints(
        cases,
        store=folder / "joints.jsonl",
        jobs=chosen.jobs,
        progress=not chosen.quiet and sys.stderr.isatty(),
        **knowledge,
    )
    found.failed.update({name: str(problem) for name, problem in refused.items()})
    print(found.summary(), flush=True)
    write_file(folder / "joints.json", json.dumps(found.to_dict(), indent=1))
    if model is not None:
        kind = _SIMULATORS[model.suffix.lower()]
        given = _given_options(chosen, "load", "stiff", "dialect") if kind == "mjcf" else {}
        put = getattr(simulators, f"to_{kind}")
        print(put(found, model, out=folder / model.name, **given).summary(), flush=True)
    for name, one in found.items():
        write_report(one, folder / name, scaling.to_dict() | sampling)
    print(f"joints.json and a report for each joint are in {folder}")
    if found.failed:
        _print_message(
            f"not diagnosed: {', '.join(found.failed)}; the table and joints.json say why"
        )
    return 1 if found.failed else 0


def _joints_model(chosen: Namespace) -> Path | None:
    """Path of the model of the machine, if there is one."""
    model = Path(chosen.model) if chosen.model else None
    suffix = "" if model is None else model.suffix.lower()
    if model is not None and suffix not in (".xml", ".urdf"):
        raise ValueError(f"--model {model} must be an MJCF (.xml) or URDF (.urdf) file")
    if chosen.axes is None and suffix != ".xml":
        raise ValueError("give --axes, or an MJCF file as --model, which has nominal axes")
    return model


def _joint_axes(chosen: Namespace, model: Path | None) -> dict[str, FrictionAxis]:
    """Nominal axes of the joints that are to be diagnosed."""
    if chosen.axes is None and model is not None:
        axes = axes_of(model)
    else:
        axes = read_axes(chosen.axes)
    for name in chosen.joints or ():
        if name not in axes:
            raise ValueError(f"--joints {name} is not there{did_you_mean(name, axes)}")
    return {name: axes[name] for name in chosen.joints or axes}


def _read_joints(
    chosen: Namespace, axes: Mapping[str, FrictionAxis], scaling: Scaling, sampling: dict[str, Any]
) -> tuple[dict[str, tuple[FrictionAxis, list[Record]]], dict[str, ValueError]]:
    """Axis and records of each joint, and what is wrong with those that cannot be read."""
    cases = {}
    refused = {}
    for name, axis in axes.items():
        options = {"gain": scaling, "joint": name, "name": name, **sampling}
        try:
            records = _read_records(chosen, axis, f", {name}", **options)
        except ValueError as problem:
            refused[name] = problem
            continue
        if axis.coulomb.mean == 0.0:  # a model that nobody has given any friction
            guess = _GUESS * float(abs(records[0].u).max())
            print(f"{name}: the model has no friction: {guess:.3g} {axis.units[1]} to start with")
            axis = axis.replace(coulomb=guess)
        cases[name] = axis, records
    if not cases:
        raise next(iter(refused.values()))
    return cases, refused


def _arm(chosen: Namespace) -> int:
    model = Path(chosen.model)
    kind = _SIMULATORS.get(model.suffix.lower())
    if kind not in ("mjcf", "urdf"):
        raise ValueError(f"--model {model} must be an MJCF (.xml) or URDF (.urdf) file")
    scaling, sampling, knowledge = _read_options(chosen, chosen.axes)
    axes = None if chosen.axes is None else read_axes(chosen.axes)
    given = _given_options(chosen, "held", "payload", "units")
    folder = output_folder(chosen.out)
    found = diagnose_arm(
        model,
        chosen.log,
        axes=axes,
        scaling=scaling,
        store=folder / "joints.jsonl",
        jobs=chosen.jobs,
        progress=not chosen.quiet and sys.stderr.isatty(),
        **given,
        **sampling,
        **knowledge,
    )
    print(found.summary(), flush=True)
    write_file(folder / "arm.json", json.dumps(found.to_dict(), indent=1))
    found.to_html(folder / "arm.html")
    put = getattr(simulators, f"to_{kind}")
    print(put(found, model, out=folder / model.name).summary(), flush=True)
    for name, one in found.items():
        write_report(one, folder / name, scaling.to_dict() | sampling)
    print(f"arm.html, arm.json and a report for each joint are in {folder}")
    return 1 if found.failed else 0


def _export(chosen: Namespace) -> None:
    given = _given_options(chosen, "name", "dt", "precision", "version")
    for option, to in (("precision", "c"), ("version", "fmu")):
        if chosen.to != to and option in given:
            raise ValueError(f"--{option} {given[option]} is for --to {to}: leave it out")
    mend = (
        "can not be exported: give an axis (TOML), or what `save` wrote of an observer design or "
        "a compensation (JSON)"
    )
    obj = load_any(chosen.file, (*Observer.__subclasses__(), Compensation), mend)
    if chosen.to == "c":
        files = export_c(obj, chosen.out, **given)
    else:
        name = export_object(obj, chosen.name, chosen.dt).name
        files = [export_fmu(obj, existing_folder(chosen.out) / f"{name}.fmu", **given)]
    print(f"{', '.join(file.name for file in files)} in {chosen.out}")


def _simulator(chosen: Namespace) -> None:
    kind = chosen.to or _SIMULATORS.get(Path(chosen.model).suffix.lower())
    if kind is None:
        raise ValueError(
            f"--model {chosen.model} has no extension of {', '.join(_SIMULATORS)}: give --to"
        )
    given = _given_options(chosen, "load", "stiff", "dialect", "out")
    for option, right in (
        ("load", "mjcf isaac"), ("stiff", "mjcf"), ("dialect", "mjcf"),
        ("out", "mjcf urdf modelica"),
    ):  # fmt: skip
        if option in given and kind not in right.split():
            right = right.replace(" ", " and ")
            raise ValueError(f"--{option} is for {right}, not {kind}: leave it out")
    named = [one.rpartition("=")[::2] for one in chosen.result]
    if len(named) > 1 and not all(joint for joint, _ in named):
        raise ValueError("several results: give each by its joint, such as elbow=fit.json")
    mend = (
        "is no result: give an axis (TOML), or what `save` wrote of a fit or a diagnosis (JSON; "
        "saved.json of the command diagnose)"
    )
    results = {joint: load_any(file, (Fit, Diagnosis), mend) for joint, file in named}
    if len(results) < len(named):
        raise ValueError("two results have one joint: give each joint once")
    result = results if all(results) else results[""]
    found = getattr(simulators, f"to_{kind}")(result, chosen.model, **given)
    print(found.summary())


if __name__ == "__main__":
    raise SystemExit(main())
