#!/usr/bin/env bash
# MJX leaves the quadratic and cubic damping of a joint out, without an error or a warning.
#
# MuJoCo has had polynomial damping since 3.7: damping="b0 b1 b2" brakes a joint with
# b0 v + b1 v |v| + b2 v^3.  MJX of the same version accepts the model and applies b0 v alone.
# Expected: the passive force of both is the same (-4.25 at v = 5 for "0.1 0.05 0.02"), or MJX
# refuses the model, as it does for other features that it has not.
# Exits with 0 as long as the difference is there.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check \
  "mujoco==3.17.0" "mujoco-mjx==3.17.0" >/dev/null
"$work/venv/bin/python" - <<'PYTHON'
import sys
import warnings

import jax
import mujoco
import numpy as np
from mujoco import mjx

model = mujoco.MjModel.from_xml_string("""
<mujoco><worldbody><body>
  <joint axis="0 0 1" damping="0.1 0.05 0.02"/>
  <inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>
</body></worldbody></mujoco>""")
data = mujoco.MjData(model)
data.qvel[0] = 5.0
mujoco.mj_forward(model, data)
with warnings.catch_warnings(record=True) as told:
    warnings.simplefilter("always")
    other = mjx.put_model(model)
    state = mjx.make_data(other).replace(qvel=np.array([5.0]))
    force = float(jax.jit(mjx.forward)(other, state).qfrc_passive[0])
damping = [one for one in told if "damp" in str(one.message).lower()]
print(f"mujoco {mujoco.__version__}, expected in both: {-0.1 * 5 - 0.05 * 25 - 0.02 * 125:.4f}")
print(f"seen: MuJoCo {data.qfrc_passive[0]:.4f}, MJX {force:.4f}, warnings on damping: {len(damping)}")
left_out = abs(data.qfrc_passive[0] + 4.25) < 1e-6 and abs(force + 0.5) < 1e-5 and not damping
sys.exit(0 if left_out else 1)
PYTHON
