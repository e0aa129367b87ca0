"""Write the logs of docs/data and of `datasets`, made by the independent simulator of the tests.

python docs/make_data.py
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from truth.plant import NSTATES, Plant, X, closed_loop, open_loop  # noqa: E402

DATA = ROOT / "docs" / "data"
SHIPPED = ROOT / "dryfric_control" / "datasets"
#: Two joints of an arm, as a robot logs them at 100 Hz, with rows that were lost.
JOINTS = {
    "elbow": Plant(mass=0.25, viscous=0.3, coulomb=1.2, stick_speed=1e-3),
    "wrist": Plant(mass=0.08, viscous=0.1, coulomb=0.4, stick_speed=1e-3),
}
ENCODER = 2.0 * np.pi / 2**14
#: A pendulum that is let go at 2.3 rad, at 200 Hz.
PENDULUM = Plant(mass=0.0224, viscous=0.45e-3, coulomb=4.1e-3, gravity=0.6927, stick_speed=1e-4)
COUNTS = 2.0 * np.pi / 4000
#: A belt-driven stage at 500 Hz: the model of `datasets.belt_stage` lacks the teeth of its belt,
#: and that friction is higher forwards.
STAGE = Plant(
    mass=2.4, viscous=12.0, coulomb=9.0, asymmetry=0.12, cogging=1.6, cogging_pitch=5e-3,
    cogging_phase=0.7,
)  # fmt: skip
STEP = 5e-6


def arm() -> str:
    """Stamps, positions and efforts of the joints."""
    rng, t = np.random.default_rng(3), 0.01 * np.arange(1500)
    columns, names = [t], ["time"]
    for i, (name, plant) in enumerate(JOINTS.items()):
        tones = np.array([0.9, 2.3, 5.1])[:, None] * (1.0 + 0.13 * i) * t
        waves = np.sin(tones + rng.uniform(0.0, 6.0, 3)[:, None])
        u = plant.coulomb * (np.array([1.1, 0.9, 0.7]) @ waves)
        x = open_loop(plant, u, 0.01, 200, np.zeros(NSTATES))[:-1, X]
        effort = u + 0.01 * plant.coulomb * rng.standard_normal(t.size)
        columns += [ENCODER * np.round(x / ENCODER), effort]
        names += [f"position.{name}", f"effort.{name}"]
    kept = np.column_stack(columns)[rng.random(t.size) > 0.01]
    rows = ("{:.2f},{:.5f},{:.4f},{:.5f},{:.4f}".format(*row) for row in kept)
    return "\n".join([",".join(names), *rows]) + "\n"


def pendulum() -> str:
    """Stamps and angles."""
    start = np.zeros(NSTATES)
    start[X] = -2.3
    x = open_loop(PENDULUM, np.zeros(4000), 5e-3, 50, start)[:-1, X]
    counts = np.round(x / COUNTS).astype(int)
    rows = (f"{5e-3 * k:.3f},{count}" for k, count in enumerate(counts))
    return "\n".join(["time [s],angle [counts]", *rows]) + "\n"


def belt_stage() -> str:
    """Time, drive force and position of a positioning run."""
    rng, n, dt = np.random.default_rng(11), 4000, 2e-3
    t = dt * np.arange(n)
    moves = np.repeat(rng.uniform(0.02, 0.28, n // 500), 500)
    moves = np.convolve(np.r_[np.full(149, moves[0]), moves], np.ones(150) / 150.0, "valid")
    wanted = np.where(t < 4.0, 0.15 + 0.1 * np.sin(1.7 * t) + 0.02 * np.sin(6.3 * t), moves)
    none = np.zeros(n)
    push = 0.1 * rng.standard_normal(n)
    u, y, _ = closed_loop(
        STAGE, wanted, dt, 80, 4000.0, 0.0, 140.0, 4e-3, 120.0, STEP, none, none, push, none
    )
    rows = (f"{a:.3f},{b:.3f},{c:.6f}" for a, b, c in zip(t, u, y, strict=True))
    return "\n".join(["t [s],u [N],x [m]", *rows]) + "\n"


MODEL = """<mujoco model="arm">
  <worldbody>
    <body>
      <joint name="elbow" axis="0 1 0" damping="0.1"/>  <!-- from the datasheet -->
      <inertial pos="0 0 0" mass="1" diaginertia="0.15 0.15 0.15"/>
      <body pos="0.3 0 0">
        <joint name="wrist" axis="0 0 1"/>
        <inertial pos="0 0 0" mass="0.001" diaginertia="0.03 0.03 0.03"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def main() -> None:
    """Write all files."""
    DATA.mkdir(exist_ok=True)
    for path, text in (
        (DATA / "arm.csv", arm()), (DATA / "pendulum.csv", pendulum()), (DATA / "arm.xml", MODEL),
        (SHIPPED / "belt_stage.csv", belt_stage()),
    ):  # fmt: skip
        path.write_text(text, encoding="utf-8")
        print(f"{path.name}: {len(text) / 1000:.0f} kB")


if __name__ == "__main__":
    main()
