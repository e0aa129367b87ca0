#!/usr/bin/env bash
# Pinocchio reads polynomial damping of an MJCF joint as no damping at all, in silence.
#
# damping="0.1 0.05 0.02" is valid MJCF since MuJoCo 3.7.  The parser of Pinocchio expects one
# number; it neither keeps the first of several nor refuses the file: the damping is 0.
# Expected: 0.1, or an error.
# Exits with 0 as long as the difference is there.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check "pin==4.1.0" >/dev/null
cd "$work"
venv/bin/python - <<'PYTHON'
import pathlib
import sys

import pinocchio

found = {}
for damping in ("0.1", "0.1 0.05 0.02"):
    pathlib.Path("joint.xml").write_text(f"""
<mujoco model="joint"><worldbody><body name="link">
  <joint name="joint" axis="0 0 1" damping="{damping}"/>
  <inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>
</body></worldbody></mujoco>""")
    found[damping] = float(pinocchio.buildModelFromMJCF("joint.xml").damping[0])
print(f"pinocchio {pinocchio.__version__}, expected a damping of 0.1 in both, or an error")
print("seen:", ", ".join(f'damping="{text}" -> {value}' for text, value in found.items()))
sys.exit(0 if list(found.values()) == [0.1, 0.0] else 1)
PYTHON
