#!/usr/bin/env bash
# An ASC log of a CAN bus with "timestamps relative": each stamp counts from the line before.
# python-can reads the word and returns the differences as if they were times.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
python3 -m venv env
env/bin/pip install --quiet "python-can==4.6.1"
env/bin/python - <<'PROGRAM'
import sys

import can

rows = "".join(f"   0.010000 1  64              Rx   d 1 0{k}\n" for k in range(3))
with open("log.asc", "w") as file:
    file.write(
        "date Mon Mar 2 10:00:00.000 am 2026\nbase hex  timestamps relative\n"
        "internal events logged\nBegin Triggerblock Mon Mar 2 10:00:00.000 am 2026\n"
        "   0.000000 Start of measurement\n" + rows + "End TriggerBlock\n"
    )
reader = can.ASCReader("log.asc")
stamps = [message.timestamp for message in reader]
print("python-can", can.__version__, "read:", reader.timestamps_format)
print("expected: 0.01, 0.02, 0.03 s")
print("seen:    ", ", ".join(f"{stamp:g}" for stamp in stamps), "s")
sys.exit(stamps != [0.01, 0.01, 0.01])
PROGRAM
