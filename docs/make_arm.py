"""Write docs/data/six_joints.csv and .xml: a log of an arm, made by MuJoCo in steps of 0.1 ms.

python docs/make_arm.py
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "benchmarks"))

import arm_truth  # noqa: E402

DATA = ROOT / "docs" / "data"
#: The arm holds a tool of which its model does not know.
TRUTH = arm_truth.Truth(
    friction=tuple(one._replace(by_load=0.0, excess=0.0) for one in arm_truth.FRICTION),
    payload=0.8,
)
SECONDS, RATE = 24.0, 100.0


def main() -> None:
    """Write both files."""
    fine = arm_truth.simulate(TRUTH, seed=7, seconds=SECONDS)
    every = round(1.0 / RATE / (fine["time"][1] - fine["time"][0]))
    columns = {}
    for name, values in fine.items():
        # Torques are held from one sample to the next: their means are logged.
        held = name.endswith("effort")
        columns[name] = values.reshape(-1, every).mean(axis=1) if held else values[::every]
    rows = (
        ",".join(f"{v:.2f}" if k == 0 else f"{v:.5f}" if k % 2 else f"{v:.3f}"
                 for k, v in enumerate(row))
        for row in np.column_stack(list(columns.values()))
    )  # fmt: skip
    text = "\n".join([",".join(columns), *rows]) + "\n"
    for path, content in (
        (DATA / "six_joints.csv", text), (DATA / "six_joints.xml", arm_truth.mjcf() + "\n"),
    ):  # fmt: skip
        path.write_text(content, encoding="utf-8")
        print(f"{path.name}: {len(content) / 1000:.0f} kB")


if __name__ == "__main__":
    main()
