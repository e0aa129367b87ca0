"""Command line: ``python -m dryfric_control`` demo, diagnose, joints, export or simulator."""

from __future__ import annotations

import argparse
import json
import re
import sys
import warnings
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from dryfric_control._version import __version__
from dryfric_control.checks import positive
from dryfric_control.store.files import replacing
from dryfric_control.text import did_you_mean

if TYPE_CHECKING:
    from dryfric_control.records import Scaling

#: Format of a model by its extension.
_SIMULATORS = {
    ".xml": "mjcf",
    ".urdf": "urdf",
    ".mo": "modelica",
    ".m": "simscape",
    ".py": "isaac",
}
# Coulomb level to start from, over the largest drive, where a model has none.
_GUESS = 0.2
_LOAD = (
    "inertia that the bodies of the model have about the joint [kg m^2]; MJCF: computed by MuJoCo "
    "if it is installed"
)
_STIFF = "MJCF: let joints at rest creep fifty times less"
_ROOM = 4_000_000  # bytes, more than a report takes

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
        (r"gain=dfc\.Scaling\(\.\.\.\)", "the numbers of the machine (--help lists them)"),
        (r"with units=\('(.*?)', '(.*?)'\)", r'with units = ["\1", "\2"] in its file'),
        (r"""\b(columns|gain|units)=\{["'](\w+)["']: ["']?([^"'}]*)["']?\}""", r"--\1 \2=\3"),
    )
)  # fmt: skip


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are one line: what is wrong stands there, not below the usage."""

    def error(self, message: str) -> NoReturn:
        """End with what is wrong and where the options are listed."""
        mark = "" if message.endswith("?") else ";"
        self.exit(2, f"{self.prog}: {message}{mark} {self.prog} --help lists all options\n")


def parser() -> argparse.ArgumentParser:
    """Parser of the command line.

    Returns
    -------
    argparse.ArgumentParser
    """
    top = _Parser(
        prog="python -m dryfric_control",
        description="Control of machines with dry friction.",
    )
    top.add_argument("--version", action="version", version=__version__)
    commands = top.add_subparsers(required=True, metavar="{demo,diagnose,joints,export,simulator}")

    demo = commands.add_parser("demo", help="fit an axis to a record, replay it, draw the figures")
    demo.add_argument("--out", default="demo", metavar="DIR", help="folder for the results")
    demo.add_argument(
        "--record", metavar="FILE", help="measured record (CSV or MAT); default: a simulated one"
    )
    demo.add_argument(
        "--dt",
        type=float,
        metavar="S",
        help="step of its time, where rows were lost",
    )
    demo.set_defaults(run=_demo, own=demo)

    diagnose = commands.add_parser(
        "diagnose",
        help="find what the simulation of an axis gets wrong about a record, and why",
        description="Writes report.html, report.png, diagnosis.json, extended.toml and saved.json, "
        "which dfc.load_diagnosis reads in Python. Options on counts, gear, motor and sampling "
        "(dt, rate, max_gap) may also be given in the table [record] of the axis file; an option "
        "overrides it.",
    )
    diagnose.add_argument(
        "record",
        nargs="+",
        metavar="RUN.csv",
        help="measured records of one machine (CSV, MAT, xlsx, parquet)",
    )
    diagnose.add_argument("--axis", required=True, metavar="FILE", help="the nominal axis, TOML")
    diagnose.add_argument(
        "--out", default="diagnosis", metavar="DIR", help="folder for the results"
    )
    diagnose.add_argument(
        "--joint", metavar="NAME", help="joint of a log of several, as in its headings"
    )
    _add_reading(diagnose)
    diagnose.set_defaults(run=_diagnose, own=diagnose)

    joints = commands.add_parser(
        "joints",
        help="diagnose the joints of a log, and set their values in the file of a simulator",
        description="Writes joints.json, saved.json and report.html of each joint in a folder of "
        "its name, and the model with the values of the joints. joints.jsonl keeps every joint "
        "that is finished: the same command goes on where it was interrupted.",
    )
    joints.add_argument(
        "record", nargs="+", metavar="LOG", help="logs with columns for each joint (mcap, CSV, ..)"
    )
    joints.add_argument(
        "--axes",
        metavar="FILE",
        help="nominal axes, TOML with a table for each joint; default: those of the MJCF model, "
        "by MuJoCo",
    )
    joints.add_argument("--model", metavar="FILE", help="MJCF (.xml) or URDF (.urdf) file")
    joints.add_argument(
        "--joints",
        type=lambda text: [name.strip() for name in text.split(",")],
        metavar="elbow,..",
        help="joints to take, by default all of the axes",
    )
    joints.add_argument("--out", default="joints", metavar="DIR", help="folder for the results")
    joints.add_argument(
        "--jobs",
        type=int,
        default=-1,
        metavar="N",
        help="joints in parallel, by default one a core",
    )
    joints.add_argument("--load", type=_loads, metavar="J or JOINT=J,..", help=_LOAD)
    joints.add_argument("--stiff", action="store_true", help=_STIFF)
    _add_reading(joints)
    joints.set_defaults(run=_joints, own=joints)

    export = commands.add_parser("export", help="write an axis or a design as C99 or as an FMU")
    export.add_argument(
        "file", metavar="FILE", help="axis (TOML), observer or compensation (JSON, as saved)"
    )
    export.add_argument("--to", required=True, choices=("c", "fmu"), help="what to write")
    export.add_argument("--out", default="export", metavar="DIR", help="folder for the files")
    export.add_argument("--name", metavar="NAME", help="prefix of the names in C")
    export.add_argument(
        "--dt", type=float, metavar="S", help="sampling time of an axis [s], default 0.001"
    )
    export.add_argument(
        "--precision", choices=("double", "single", "mixed"), help="of the C code, default double"
    )
    export.add_argument("--version", choices=("3.0", "2.0"), help="of the FMU, default 3.0")
    export.set_defaults(run=_export, own=export)

    simulator = commands.add_parser(
        "simulator",
        help="set friction, damping and armature of joints in the file of a simulator",
        description="Every other byte of the model stays. What the format cannot state is listed "
        "with what takes its place and the error that makes.",
    )
    simulator.add_argument(
        "result",
        nargs="+",
        metavar="[JOINT=]FILE",
        help="axis (TOML), fit or diagnosis (JSON, as saved), by the name of its joint if there "
        "are several",
    )
    simulator.add_argument(
        "--model",
        required=True,
        metavar="FILE",
        help="MJCF (.xml), URDF (.urdf) or Modelica (.mo) file; the file to write for isaac "
        "(.py) and simscape (.m)",
    )
    simulator.add_argument(
        "--to", choices=(*_SIMULATORS.values(),), help="format, by default that of the extension"
    )
    simulator.add_argument(
        "--load",
        type=_loads,
        metavar="J or JOINT=J,..",
        help=_LOAD,
    )
    simulator.add_argument("--out", metavar="FILE", help="file to write in place of the model")
    simulator.add_argument("--stiff", action="store_true", help=_STIFF)
    simulator.set_defaults(run=_simulator, own=simulator)
    return top


def _add_reading(command: argparse.ArgumentParser) -> None:
    """Options on how records are read and what a diagnosis may rely on."""
    command.add_argument(
        "--columns",
        type=_pairs,
        metavar="t=..,u=..,x=..",
        help="headings or numbers of time, input and position where they are not the usual ones, "
        "none for none",
    )
    command.add_argument(
        "--units",
        type=_pairs,
        metavar="t=..,u=..,x=..",
        help="units as stored, such as t=ms,x=mm, where the headings do not give them",
    )
    command.add_argument(
        "--gain",
        type=_gains,
        metavar="K or u=..,x=..",
        help="factor of the input, such as N per V, or factors by channel",
    )
    for option, metavar, words in (
        ("--counts-per-turn", "N", "encoder counts per turn"),
        ("--gear-ratio", "N", "turns of the motor per turn of the load"),
        ("--lead", "M", "travel of a linear axis per turn of the load [m]"),
        ("--pinion-radius", "R", "radius of a pinion or belt pulley [m]"),
        ("--piston-area", "A", "area on which a measured pressure acts [m^2]"),
        ("--torque-constant", "K", "torque of the motor per current [N m/A]"),
        ("--rated-torque", "T", "torque of the motor at 100 %% [N m]"),
        ("--force-constant", "K", "force of a linear motor per current [N/A]"),
        ("--rated-force", "F", "force of a linear motor at 100 %% [N]"),
    ):
        command.add_argument(option, type=float, metavar=metavar, help=words)
    command.add_argument(
        "--load-encoder", action="store_true", default=None, help="the encoder is on the load"
    )
    command.add_argument(
        "--dt",
        type=float,
        metavar="S",
        help="resample irregular time stamps to this step [s]; without a time column, the step",
    )
    command.add_argument(
        "--rate", type=float, metavar="HZ", help="samples per second of a file without time column"
    )
    command.add_argument(
        "--max-gap", type=float, metavar="S", help="longest gap that --dt may fill [s]"
    )
    command.add_argument(
        "--known",
        type=lambda text: [name.strip() for name in text.split(",")],
        metavar="mass,..",
        help="nominal values that are right",
    )
    command.add_argument(
        "--tolerance",
        type=_tolerances,
        metavar="viscous=0.5,..",
        help="relative standard deviations of nominal values",
    )
    command.add_argument(
        "--time-limit",
        type=float,
        metavar="S",
        help="time after which the best answer so far is returned [s]",
    )
    command.add_argument(
        "--window", type=float, metavar="S", help="length of the free runs [s], 0.25 by default"
    )
    command.add_argument("--quiet", action="store_true", help="no progress bar")


def _pairs(text: str) -> dict[str, str | None]:
    """Mapping from ``t=a,u=b``; None for none."""
    pairs: dict[str, str | None] = {}
    for part in text.split(","):
        role, mark, value = (word.strip() for word in part.partition("="))
        if not (mark and value):
            raise argparse.ArgumentTypeError(f"{part!r} must be such as u=force")
        pairs[role] = None if value.lower() == "none" else value
    return pairs


def _gains(text: str) -> dict[str, float]:
    """Factors by channel, a number alone being that of the input."""
    return _numbers(text if "=" in text else f"u={text}", text, "a number or such as u=35,x=1e-6")


def _loads(text: str) -> float | dict[str, float]:
    """An inertia, or inertias by joint."""
    right = "a number or such as elbow=0.1,wrist=0.02"
    found = _numbers(text if "=" in text else f"all={text}", text, right)
    return found if "=" in text else found["all"]


def _tolerances(text: str) -> dict[str, float]:
    """Relative standard deviations by name."""
    return _numbers(text, text, "such as viscous=0.5,mass=0.1")


def _numbers(pairs: str, text: str, right: str) -> dict[str, float]:
    """Numbers by name; what is right is said where they are none."""
    try:
        return {name: float(value or "none") for name, value in _pairs(pairs).items()}
    except (ValueError, argparse.ArgumentTypeError):
        raise argparse.ArgumentTypeError(f"{text!r} must be {right}") from None


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        Default: those of the process.

    Returns
    -------
    int
        0; 2 after an error of the user's, 130 after an interrupt, each reported in one line.
    """
    chosen, unknown = parser().parse_known_args(arguments)
    if unknown:
        near = did_you_mean(unknown[0], chosen.own._option_string_actions)
        chosen.own.error(f"{' '.join(unknown)} is not known{near}")
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_, **__: _say(f"warning: {message}")
        try:
            import matplotlib

            matplotlib.use("Agg")
            chosen.run(chosen)
        except (ValueError, OSError, ImportError) as problem:
            _say(str(problem))
            return 2
        except KeyboardInterrupt:
            _say("interrupted")
            return 130
    return 0


def _say(words: str) -> None:
    """Print an error or a warning in one line, with options for arguments."""
    words = " ".join(words.split())
    for pattern, option in _AS_OPTIONS:
        words = pattern.sub(option, words)
    print(f"{parser().prog}: {words}", file=sys.stderr)


def _demo(chosen: argparse.Namespace) -> None:
    from dryfric_control import demo

    demo.run(chosen.out, chosen.record, dt=chosen.dt)


def _reading(
    chosen: argparse.Namespace, file: str | None
) -> tuple[Scaling, dict[str, Any], dict[str, Any]]:
    """Factors, sampling and knowledge of the options and of a file of axes."""
    from dryfric_control.estimation.parameters import checked_knowledge
    from dryfric_control.records import Scaling
    from dryfric_control.records.scaling import read_sampling
    from dryfric_control.store.axis_file import read_knowledge

    given = {
        item.name: value
        for item in fields(Scaling)
        if (value := getattr(chosen, item.name, None)) is not None
    }
    scaling = replace(Scaling() if file is None else Scaling.from_file(file), **given)
    knowledge = {} if file is None else read_knowledge(file)
    for name in ("known", "tolerance", "time_limit", "window"):
        if getattr(chosen, name) is not None:
            knowledge[name] = getattr(chosen, name)
    checked_knowledge(knowledge.get("known", ()), knowledge.get("tolerance"))
    for name in ("time_limit", "window"):
        if name in knowledge:
            positive(name, knowledge[name], unit="s")
    # A rate excludes dt and max_gap: an option also replaces what it excludes in the file.
    sampling: dict[str, Any] = {}
    if chosen.rate is None and file is not None:
        sampling = read_sampling(file)
    if chosen.dt is not None:
        sampling.pop("rate", None)
    for name in ("dt", "rate", "max_gap"):
        if getattr(chosen, name) is not None:
            sampling[name] = getattr(chosen, name)
    return scaling, sampling, knowledge


def _diagnose(chosen: argparse.Namespace) -> None:
    from dryfric_control.diagnosis.diagnose import diagnose
    from dryfric_control.diagnosis.report.diagnosis import write_report
    from dryfric_control.records import read_record
    from dryfric_control.store.axis_file import read_axis
    from dryfric_control.units import check_units

    folder = Path(chosen.out)
    axis = read_axis(chosen.axis)
    scaling, sampling, knowledge = _reading(chosen, chosen.axis)
    records = []
    for path in chosen.record:
        record = read_record(
            path,
            chosen.columns,
            scaling,
            units=chosen.units,
            joint=chosen.joint,
            **sampling,
        )
        check_units(axis, record, Path(path).name)
        check = record.check()
        print(f"{Path(path).name}: {check.headline}")
        if check.assumed:
            print(f"{Path(path).name}: units: {check.assumed}")
        records.append(record)
    _make_room(folder)
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


def _joints(chosen: argparse.Namespace) -> None:
    from dryfric_control import simulators
    from dryfric_control.diagnosis.joints import diagnose_joints
    from dryfric_control.diagnosis.report.diagnosis import write_report
    from dryfric_control.records import read_record
    from dryfric_control.simulators.mujoco_file import axes_of
    from dryfric_control.store.axis_file import read_axes

    folder, model = Path(chosen.out), chosen.model and Path(chosen.model)
    if model and model.suffix.lower() not in (".xml", ".urdf"):
        raise ValueError(f"--model {model} must be an MJCF (.xml) or URDF (.urdf) file")
    if chosen.axes is None and (not model or model.suffix.lower() != ".xml"):
        raise ValueError("give --axes, or an MJCF file as --model, which has nominal axes")
    scaling, sampling, knowledge = _reading(chosen, chosen.axes)
    axes = axes_of(model) if chosen.axes is None else read_axes(chosen.axes)
    for name in chosen.joints or ():
        if name not in axes:
            raise ValueError(f"--joints {name} is not there{did_you_mean(name, axes)}")
    cases = {}
    for name in chosen.joints or axes:
        axis, records = axes[name], []
        for path in chosen.record:
            record = read_record(
                path, chosen.columns, scaling, units=chosen.units, joint=name, name=name, **sampling
            )
            check = record.check()
            if check.assumed:
                print(f"{Path(path).name}, {name}: units: {check.assumed}")
                check = replace(check, units=axis.units)
            print(f"{Path(path).name}, {name}: {check.headline}")
            records.append(record)
        if axis.coulomb.mean == 0.0:  # a model that nobody has given any friction
            guess = _GUESS * float(abs(records[0].u).max())
            print(f"{name}: the model has no friction: {guess:.3g} {axis.units[1]} to start with")
            axis = axis.replace(coulomb=guess)
        cases[name] = axis, records
    _make_room(folder)
    found = diagnose_joints(
        cases,
        store=folder / "joints.jsonl",
        jobs=chosen.jobs,
        progress=not chosen.quiet and sys.stderr.isatty(),
        **knowledge,
    )
    print(found.summary(), flush=True)
    with replacing(folder / "joints.json") as part:
        part.write_text(json.dumps(found.to_dict(), indent=1), encoding="utf-8")
    if model:
        kind = _SIMULATORS[model.suffix.lower()]
        given = {"load": chosen.load, "stiff": chosen.stiff} if kind == "mjcf" else {}
        put = getattr(simulators, f"to_{kind}")
        print(put(found, model, out=folder / model.name, **given).summary(), flush=True)
    for name, one in found.items():
        write_report(one, folder / name, scaling.to_dict() | sampling)
    print(f"joints.json and a report for each joint are in {folder}")


def _export(chosen: argparse.Namespace) -> None:
    from dryfric_control.export.c_code import existing_folder, export_c
    from dryfric_control.export.fmu import export_fmu
    from dryfric_control.export.objects import exported, read_exportable

    for option, to in (("precision", "c"), ("version", "fmu")):
        if chosen.to != to and (value := getattr(chosen, option)) is not None:
            raise ValueError(f"--{option} {value} is for --to {to}: leave it out")
    obj = read_exportable(chosen.file)
    given = {"name": chosen.name, "dt": chosen.dt}
    if chosen.to == "c":
        files = export_c(obj, chosen.out, chosen.precision or "double", **given)
    else:
        name = exported(obj, **given).name
        target = existing_folder(chosen.out) / f"{name}.fmu"
        files = [export_fmu(obj, target, chosen.version or "3.0", **given)]
    print(f"{', '.join(file.name for file in files)} in {chosen.out}")


def _simulator(chosen: argparse.Namespace) -> None:
    from dryfric_control import simulators
    from dryfric_control.simulators.files import read_result

    kind = chosen.to or _SIMULATORS.get(Path(chosen.model).suffix.lower())
    if kind is None:
        raise ValueError(
            f"--model {chosen.model} has no extension of {', '.join(_SIMULATORS)}: give --to"
        )
    given: dict[str, Any] = {}
    for option, kinds in (
        ("load", ("mjcf", "isaac")),
        ("stiff", ("mjcf",)),
        ("out", ("mjcf", "urdf", "modelica")),
    ):
        value = getattr(chosen, option)
        if value is None or value is False:
            continue
        if kind not in kinds:
            raise ValueError(f"--{option} is for {' and '.join(kinds)}, not {kind}: leave it out")
        given[option] = value
    named = [one.rpartition("=")[::2] for one in chosen.result]
    if len(named) > 1 and not all(joint for joint, _ in named):
        raise ValueError("several results: give each by its joint, such as elbow=fit.json")
    results = {joint: read_result(file) for joint, file in named}
    if len(results) < len(named):
        raise ValueError("two results have one joint: give each joint once")
    result = results if all(results) else results[""]
    found = getattr(simulators, f"to_{kind}")(result, chosen.model, **given)
    print(found.summary())


def _make_room(folder: Path) -> None:
    """Make the folder of the results and see that it can be written, before any work."""
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"--out {folder} is a file: name a folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with replacing(folder / "report.html.try") as part:
            part.write_bytes(bytes(_ROOM))
            raise _Enough
    except _Enough:
        return
    except OSError as problem:
        raise ValueError(
            f"--out {folder} cannot be written ({problem.strerror}): name another folder"
        ) from None


class _Enough(Exception):  # noqa: N818  (no error: what was tried went well)
    """Ends the trial of a folder, of which nothing stays."""


if __name__ == "__main__":
    raise SystemExit(main())
