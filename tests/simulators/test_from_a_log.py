"""From a made log of some joints, as robots write it, to MuJoCo by one command."""

import damage
import numpy as np
import pytest
from diagnosis_cases import among
from truth.plant import NSTATES, Plant, X, open_loop

import dryfric_control as dfc
from dryfric_control.__main__ import main

pytestmark = pytest.mark.long

DT, N = 0.01, 2000
T = DT * np.arange(N)
QUANTUM = 2.0 * np.pi / 2**16
JOINTS = {
    "joint_1": Plant(mass=1.2, viscous=2.0, coulomb=4.0, stick_speed=1e-3),
    "joint_2": Plant(mass=0.5, viscous=0.8, coulomb=2.0, stick_speed=1e-3, load_fraction=0.5,
                     gap=0.02, coupling_stiffness=2e4, coupling_damping=60.0),
    "joint_3": Plant(mass=0.08, viscous=0.1, coulomb=0.4, stick_speed=1e-3, wall_stiffness=300.0,
                     wall_damping=0.8, wall_low=-0.6, wall_high=0.5),
}  # fmt: skip
#: Of the inertia, that of the body in the model.
SHARE = 0.6


def driven():
    """Torque as recorded, with noise of 2 % of the level, and reading of each joint."""
    rng, found = np.random.default_rng(1), {}
    for i, (name, plant) in enumerate(JOINTS.items()):
        tones = np.array([0.9, 2.3, 5.1])[:, None] * (1.0 + 0.13 * i) * T
        waves = np.sin(tones + rng.uniform(0.0, 6.0, 3)[:, None])
        u = plant.coulomb * (np.array([1.1, 0.9, 0.7]) @ waves)
        x = open_loop(plant, u, DT, 200, np.zeros(NSTATES))[:-1, X]
        noise = 0.02 * plant.coulomb * rng.standard_normal(N)
        found[name] = u + noise, QUANTUM * np.round(x / QUANTUM)
    return found


def test_from_a_log_to_mujoco_by_one_command(tmp_path, monkeypatch):
    mujoco = pytest.importorskip("mujoco")
    pytest.importorskip("mcap_ros2")
    monkeypatch.chdir(tmp_path)
    runs = driven()
    # The log has lost one row in a hundred.
    there = np.flatnonzero(np.random.default_rng(2).random(N) > 0.01)
    joints = {name: (x[there], u[there]) for name, (u, x) in runs.items()}
    (tmp_path / "run.mcap").write_bytes(damage.joint_states(joints, 10**7 * there))
    axes, bodies = "", ""
    for name, plant in JOINTS.items():
        # Nominal values that are 25 % too large, 30 and 20 % too small.
        axes += f"[{name}]\nmass = {1.25 * plant.mass}\nviscous = {0.7 * plant.viscous}\n"
        axes += f"coulomb = {0.8 * plant.coulomb}\nunits = ['rad', 'N m']\nstick_speed = 1e-3\n"
        inertia = " ".join(3 * [str(SHARE * plant.mass)])
        bodies += f'<body><joint name="{name}"/><inertial pos="0 0 0" mass="1" '
        bodies += f'diaginertia="{inertia}"/></body>'
    (tmp_path / "axes.toml").write_text(axes)
    (tmp_path / "arm.xml").write_text(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    command = "joints run.mcap --axes axes.toml --model arm.xml --dt 0.01 --stiff --quiet"
    with among("backlash", "compliance", "end_stop", "input_gain", "load_dependence", "stribeck"):
        assert main([*command.split(), "--jobs", "1"]) == 0

    found = {name: dfc.Diagnosis.load(f"joints/{name}/saved.json") for name in JOINTS}
    causes = {name: {c.effect for c in d.causes} for name, d in found.items()}
    said = dfc.to_mjcf(found, "arm.xml", out="again.xml").messages
    assert "backlash" in causes["joint_2"] and "end_stop" in causes["joint_3"]
    model = mujoco.MjModel.from_xml_path("joints/arm.xml")
    model.opt.gravity[:] = 0.0
    # MuJoCo steps to first order; at half a millisecond that is below the noise.
    steps = 20
    model.opt.timestep = DT / steps
    for name, plant in JOINTS.items():
        at = model.joint(name).dofadr[0]
        mass = model.dof_armature[at] + SHARE * plant.mass
        values = (mass, model.dof_damping[at], model.dof_frictionloss[at])
        # All forces of a joint that is off in each of them may be a gain, or friction by load.
        right = np.allclose(values, (plant.mass, plant.viscous, plant.coulomb), rtol=0.05)
        assert right or any(one.startswith(f"{name}: ") for one in said), (name, values)
        # The same free runs as of the axis with these values.
        axis = dfc.FrictionAxis(*values, stick_speed=1e-3, units=("rad", "N m"))
        u, x = runs[name]
        reduced = dfc.replay(axis, dfc.Record(T, u, x, units={"x": "rad", "u": "N m"}))
        windows, data, moved = reduced.windows, mujoco.MjData(model), np.empty(N)
        edges = zip(windows.edges[:-1], windows.edges[1:], windows.x0, windows.v0, strict=True)
        for start, end, x0, v0 in edges:
            mujoco.mj_resetData(model, data)
            data.qpos[at], data.qvel[at] = x0, v0
            for k in range(start, end):
                moved[k] = data.qpos[at]
                data.qfrc_applied[at] = u[k]
                for _ in range(steps):
                    mujoco.mj_step(model, data)
        assert np.sqrt(np.mean((moved - x) ** 2)) < 1.2 * reduced.rms, name
