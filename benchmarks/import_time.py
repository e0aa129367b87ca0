"""What `import dryfric_control` costs beyond `import control`.

    python benchmarks/import_time.py [--repeat 5]

Wall time, each in a fresh process, in turns; medians.  The first pair, which may
have to write byte code or read the disk, is not counted.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LIMIT = 1.5  # s, of the difference
PROGRAM = "import time; start = time.perf_counter(); import {}; print(time.perf_counter() - start)"


def seconds(module: str) -> float:
    """Time that a fresh process takes to import a module."""
    run = subprocess.run(
        [sys.executable, "-c", PROGRAM.format(module)],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return float(run.stdout)


def main() -> None:
    """Print both medians and their difference."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--repeat", type=int, default=5, help="processes for each")
    options = parser.parse_args()
    names = ("control", "dryfric_control")
    turns = [[seconds(name) for name in names] for _ in range(options.repeat + 1)][1:]
    theirs, ours = (statistics.median(column) for column in zip(*turns, strict=True))
    beyond = statistics.median(b - a for a, b in turns)
    print(f"import control          {theirs:6.2f} s")
    print(f"import dryfric_control  {ours:6.2f} s")
    print(f"beyond control          {beyond:6.2f} s   target < {LIMIT} s")


if __name__ == "__main__":
    main()
