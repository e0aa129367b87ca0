#!/usr/bin/env bash
# MuJoCo 4: the damping of LuGre bristles acts as inertia under implicitfast, for any motion.
#
# A <dcmotor lugre="sigma0 sigma1 Fc Fs vs"> has friction sigma0 z + sigma1 z' with
# z' = v - sigma0 |v| z / g(v).  In steady sliding z' = 0, so that the friction is Fc whatever
# sigma1, and a joint under a constant torque T accelerates with (T - Fc)/J.  The integrators that
# are implicit in velocity take sigma1 for the slope of the friction (it is near zero once it
# slides) and add sigma1 times the step to the inertia.
# Here sigma1 h = 0.3 J: 23 % less acceleration than with Euler, which has the right one.
# Expected: with every integrator (T - Fc)/J = 10 rad/s^2.
# Exits with 0 as long as the difference is there.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check "mujoco==4.0.0" >/dev/null
"$work/venv/bin/python" - <<'PYTHON'
import sys

import mujoco

MODEL = """
<mujoco><option timestep="0.001" integrator="{}"/><worldbody><body>
  <joint name="joint" axis="0 0 1"/>
  <inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>
</body></worldbody><actuator>
  <dcmotor joint="joint" input="none" motorconst="0" resistance="1" lugre="1e4 30 1 1 0.1"/>
</actuator></mujoco>"""


def acceleration(integrator):
    """Mean acceleration from 1 s to 2 s under 2 N m [rad/s^2]."""
    model = mujoco.MjModel.from_xml_string(MODEL.format(integrator))
    data = mujoco.MjData(model)
    data.qfrc_applied[0] = 2.0
    mujoco.mj_step(model, data, 1000)
    before = data.qvel[0]
    mujoco.mj_step(model, data, 1000)
    return float(data.qvel[0] - before)


found = {name: acceleration(name) for name in ("Euler", "implicit", "implicitfast")}
print(f"mujoco {mujoco.__version__}, expected 10.00 rad/s^2 with every integrator")
print("seen:", ", ".join(f"{name} {value:.2f}" for name, value in found.items()))
right = abs(found["Euler"] - 10.0) < 0.05
sys.exit(0 if right and abs(found["implicitfast"] - 10.0 / 1.3) < 0.1 else 1)
PYTHON
