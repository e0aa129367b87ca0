#!/usr/bin/env bash
# Two channels of an MDF file brought onto one raster by asammdf: where the file does not begin at 0 s,
# half of the rows hold the sample before the one that was read at their time.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
python3 -m venv env
env/bin/pip install --quiet "asammdf==8.8.28" "numpy==2.4.6" "pandas==3.1.1"
env/bin/python - <<'PROGRAM'
import sys

import asammdf
import numpy as np
from asammdf import MDF, Signal

start = 100.0
fast = start + 1e-3 * np.arange(20000)
slow = start + 2.5e-3 * np.arange(8000)
file = MDF()
file.append([Signal(np.arange(20000, dtype="i4"), fast, name="position")])
file.append([Signal(np.arange(8000, dtype="i4"), slow, name="torque")])
path = file.save("run.mf4", overwrite=True)
file.close()
frame = MDF(path).to_dataframe(raster=2.5e-3)
expected = np.floor(2.5 * np.arange(len(frame)) + 1e-6)
old = int(np.count_nonzero(frame["position"].to_numpy() == expected - 1))
print("asammdf", asammdf.__version__)
print(f"expected: in each of {len(frame)} rows the last position that was read by then")
print(f"seen:     {old} rows one sample older")
sys.exit(not 0.4 * len(frame) < old < 0.6 * len(frame))
PROGRAM
