"""Command line: ``python -m dryfric_control demo --out DIR``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

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
    return top


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
    from dryfric_control import demo

    try:
        demo.run(chosen.out, chosen.record)
    except (ValueError, OSError) as problem:
        print(f"{parser().prog}: {problem}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
