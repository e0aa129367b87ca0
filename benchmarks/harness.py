"""What the benchmarks share: the command line, tables, processor times, and fresh processes."""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
#: Measured records, which are not part of the project.
DATA = ROOT.parent / "shared" / "data"
#: Processor time of a first call beyond which it is the only one [s].
LONGEST_WARM_UP = 20.0
#: Processor time beyond which work is timed once [s].
LONGEST_REPEATED = 0.2

Work = Callable[[], object]
#: Options of a command: a default, or a type where there is none, and what it is.
Options = Mapping[str, tuple[Any, str]]


def import_from(*folders: str) -> None:
    """Make modules of some folders of the project importable."""
    sys.path[:0] = [str(ROOT / folder) for folder in folders]


def parser_of(doc: str | None, options: Options) -> argparse.ArgumentParser:
    """Parser of a command; its description is the head of the benchmark."""
    parser = argparse.ArgumentParser(
        description=doc, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for name, (default, text) in options.items():
        if default is False:
            parser.add_argument(name, action="store_true", help=text)
        elif isinstance(default, tuple):
            parser.add_argument(name, nargs="*", choices=default, default=default, help=text)
        elif isinstance(default, type):
            parser.add_argument(name, type=default, help=text)
        else:
            parser.add_argument(name, type=type(default), default=default, help=text)
    return parser


def print_tables(
    doc: str | None,
    tables: Mapping[str, Callable[[argparse.Namespace], object]],
    options: Options | None = None,
    default: tuple[str, ...] = (),
) -> None:
    """Print the tables that the command line names; without names those of `default`, or all."""
    parser = parser_of(doc, options or {})
    parser.add_argument("tables", nargs="*", metavar="TABLE", help=f"of {' '.join(tables)}")
    given = parser.parse_args()
    if unknown := set(given.tables) - set(tables):
        parser.error(f"no table {', '.join(sorted(unknown))}: name some of {' '.join(tables)}")
    for name in given.tables or default or tables:
        tables[name](given)


class Table:
    """A table that is printed row by row; columns by heading, with the format of their cells."""

    def __init__(self, columns: Mapping[str, str], title: str = "") -> None:
        self.formats = list(columns.values())
        widths = (re.findall(r"\d+", one)[0] + "s" for one in self.formats)
        sides = ("<" if one.endswith("s") else ">" for one in self.formats)
        head = [format(name, s + w) for name, s, w in zip(columns, sides, widths, strict=True)]
        print(f"\n{title}" if title else "")
        print(" ".join(head), flush=True)

    def row(self, *cells: object) -> None:
        """Print a row."""
        pairs = zip(cells, self.formats, strict=True)
        print(" ".join(format(cell, form) for cell, form in pairs), flush=True)


def race(works: list[Work], repeat: int) -> list[tuple[float, float, Any]]:
    """Best and median processor time [s] and result of each work, timed in turns.

    Processor time and turns, because a busy machine would otherwise stretch long work more than
    short, and one minute more than the next.  The first call of each only warms up, but for long
    work, which has no other.
    """
    results = []
    times: list[list[float]] = [[] for _ in works]
    for work, mine in zip(works, times, strict=True):
        begin = time.process_time()
        results.append(work())
        if time.process_time() - begin > LONGEST_WARM_UP:
            mine.append(time.process_time() - begin)
    for _ in range(repeat):
        for work, mine in zip(works, times, strict=True):
            if not mine or mine[0] < LONGEST_REPEATED:
                begin = time.process_time()
                work()
                mine.append(time.process_time() - begin)
    return [
        (min(mine), float(np.median(mine)), result)
        for mine, result in zip(times, results, strict=True)
    ]


def shortest_time(work: Work, repeat: int = 5) -> float:
    """Shortest processor time of some calls after a first one [s]."""
    return race([work], repeat)[0][0]


def fresh_process(*command: str, tree: Path = ROOT, **environment: str) -> Any:
    """What a fresh interpreter prints as JSON, with the package of a tree."""
    path = os.pathsep.join(filter(None, [str(tree), os.environ.get("PYTHONPATH", "")]))
    done = subprocess.run(
        [sys.executable, *command],
        env={**os.environ, "PYTHONPATH": path, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout)


def percent_of(marks: list[bool]) -> str:
    """Rate as counts and per cent."""
    return f"{sum(marks)}/{len(marks)} = {100.0 * np.mean(marks):.1f} %" if marks else "-"
