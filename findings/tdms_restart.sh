#!/usr/bin/env bash
# A run that is started again in one TDMS file: nptdms keeps one start and one increment per channel,
# the last ones, so that the time track of the first part is that of the second.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
python3 -m venv env
env/bin/pip install --quiet "nptdms==1.13.0" "numpy==2.4.6"
env/bin/python - <<'PROGRAM'
import sys

import nptdms
import numpy as np
from nptdms import ChannelObject, TdmsFile, TdmsWriter

start = np.datetime64("2026-03-02T10:00:00", "us")
parts = ((start, 1e-3), (start + np.timedelta64(60, "s"), 2e-3))
with TdmsWriter("run.tdms") as file:
    for begin, step in parts:
        timing = {"wf_start_time": begin, "wf_start_offset": 0.0, "wf_increment": step}
        file.write_segment([ChannelObject("run", "torque", np.zeros(1000), properties=timing)])
track = TdmsFile.read("run.tdms")["run"]["torque"].time_track(absolute_time=True)
first = (track[0] - start) / np.timedelta64(1, "s")
step = (track[1] - track[0]) / np.timedelta64(1, "s")
print("nptdms", nptdms.__version__)
print("expected: the first sample at 0 s, the second 0.001 s later, 60 s before the second part")
print(f"seen:     the first sample at {first:g} s, the second {step:g} s later")
sys.exit(not (first == 60.0 and step == 2e-3))
PROGRAM
