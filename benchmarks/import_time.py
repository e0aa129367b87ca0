"""Time that `import dryfric_control` takes beyond `import control` (20 s).

Prints medians of fresh processes in turns.  The first pair, which may have to write byte code or
read the disk, is not counted.

python benchmarks/import_time.py
"""

from __future__ import annotations

import statistics
import subprocess
import sys
from pathlib import Path

#: Processes for each module.
REPEAT = 5
PROGRAM = "import time; start = time.perf_counter(); import {}; print(time.perf_counter() - start)"


def seconds(module: str) -> float:
    """Time that a fresh process takes to import a module."""
    command = [sys.executable, "-c", PROGRAM.format(module)]
    root = Path(__file__).parents[1]
    run = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True)
    return float(run.stdout)


if __name__ == "__main__":
    turns = [(seconds("control"), seconds("dryfric_control")) for _ in range(REPEAT + 1)][1:]
    print(f"import control         {statistics.median(theirs for theirs, _ in turns):6.2f} s")
    print(f"import dryfric_control {statistics.median(ours for _, ours in turns):6.2f} s")
    print(f"beyond control         {statistics.median(b - a for a, b in turns):6.2f} s")
