"""Command line: ``python -m dryfric_control demo`` or ``diagnose RUN.csv``."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from pathlib import Path

from dryfric_control._version import __version__


def parser() -> argparse.ArgumentParser:
    """Parser of the command line.

    Returns
    -------
    argparse.ArgumentParser
    """
    top = argparse.ArgumentParser(
        prog="python -m dryfric_control",
        description="Control of machines with dry friction.",
    )
    top.add_argument("--version", action="version", version=__version__)
    commands = top.add_subparsers(dest="command", required=True)

    demo = commands.add_parser("demo", help="fit an axis to a record, replay it, draw the figures")
    demo.add_argument("--out", default="demo", metavar="DIR", help="folder for the results")
    demo.add_argument(
        "--record", metavar="FILE", help="measured record (CSV or MAT); default: one is made"
    )
    demo.set_defaults(run=_demo)

    diagnose = commands.add_parser(
        "diagnose",
        help="find what a simulated axis gets wrong about a record, and why",
        description="Writes report.html, report.png, diagnosis.json and extended.toml.",
    )
    diagnose.add_argument("record", metavar="RUN.csv", help="measured record (CSV or MAT)")
    diagnose.add_argument(
        "--axis", required=True, metavar="FILE", help="the axis as believed, TOML"
    )
    diagnose.add_argument(
        "--out", default="diagnosis", metavar="DIR", help="folder for the results"
    )
    diagnose.add_argument(
        "--columns",
        type=_pairs,
        metavar="t=..,u=..,x=..",
        help="headings of time, input and position where they are not the usual ones",
    )
    diagnose.add_argument(
        "--units",
        type=_pairs,
        metavar="t=..,u=..,x=..",
        help="units as stored, such as t=ms,x=mm, where the headings do not tell them",
    )
    diagnose.add_argument(
        "--gain", type=float, default=1.0, metavar="K", help="factor on the input, such as N per V"
    )
    diagnose.add_argument(
        "--dt", type=float, metavar="S", help="resample irregular time stamps to this step [s]"
    )
    diagnose.add_argument("--quiet", action="store_true", help="no progress bar")
    diagnose.set_defaults(run=_diagnose)
    return top


def _pairs(text: str) -> dict[str, str]:
    """Mapping from ``t=a,u=b``."""
    pairs = {}
    for part in text.split(","):
        role, mark, value = (word.strip() for word in part.partition("="))
        if not (mark and value):
            raise argparse.ArgumentTypeError(f"{part!r} must be such as u=force")
        pairs[role] = value
    return pairs


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        Default: those of the process.

    Returns
    -------
    int
        0, or 2 after an error of the user's, told in one line.
    """
    chosen = parser().parse_args(arguments)
    import matplotlib

    matplotlib.use("Agg")
    try:
        chosen.run(chosen)
    except (ValueError, OSError) as problem:
        words = " ".join(str(problem).split())
        words = re.sub(r'columns=\{"(\w+)": \.\.\.\}', r"--columns \1=...", words)
        print(f"{parser().prog}: {words}", file=sys.stderr)
        return 2
    return 0


def _demo(chosen: argparse.Namespace) -> None:
    from dryfric_control import demo

    demo.run(chosen.out, chosen.record)


def _diagnose(chosen: argparse.Namespace) -> None:
    from dryfric_control.diagnosis.diagnose import diagnose
    from dryfric_control.diagnosis.report.diagnosis import write_report
    from dryfric_control.records import read_record
    from dryfric_control.store.axis_file import read_axis

    folder = Path(chosen.out)
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"--out {folder} is a file: name a folder")
    axis = read_axis(chosen.axis)
    record = read_record(
        chosen.record, chosen.columns, chosen.gain, units=chosen.units, dt=chosen.dt
    )
    found = diagnose(axis, record, progress=not chosen.quiet and sys.stderr.isatty())
    write_report(found, folder)
    print(found.summary())
    print(f"report.html, report.png, diagnosis.json and extended.toml are in {folder}")


if __name__ == "__main__":
    raise SystemExit(main())
