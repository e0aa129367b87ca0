"""Files written for simulators, loaded and replayed there beside `simulate`.

    python benchmarks/simulators.py                  # MuJoCo as installed, 20 joints a kind
    python benchmarks/simulators.py others [FOLDER]  # all simulators, an environment for each

The second makes the environments in a folder (default: a temporary one) and takes half an hour.
A joint is driven for 10 s so that it sticks and slips; printed is the RMS difference of the
position over its standard deviation.  MuJoCo's steps move the position by the velocity at their
end, so that its positions are those of half a step later: both readings are printed.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
import venv
from pathlib import Path

import numpy as np

SECONDS = 10.0
STEPS = (5e-4, 1e-3, 2e-3)
JOINTS = 20
#: RMS over the standard deviation that MuJoCo 4 must keep, at half a step later.
MOST = {"Coulomb": 0.002, "Stribeck": 0.03, "drag": 0.015, "presliding": 0.05}
#: Inertia of the body in the model, as a part of that of the axis.
SHARE = 0.4


def random_axis(kind, seed):
    """A joint of a kind: 0.3 to 10 N m of Coulomb friction, 0.03 to 0.3 kg m^2 for each."""
    import dryfric_control as dfc

    rng = np.random.default_rng([list(MOST).index(kind), seed])
    level = 10.0 ** rng.uniform(-0.5, 1.0)
    own = {}
    if kind == "Stribeck":
        own["stribeck"] = dfc.Stribeck(rng.uniform(0.2, 0.6), 10.0 ** rng.uniform(-1.0, 0.0))
    elif kind == "drag":
        own["effects"] = (dfc.effects.QuadraticDrag(level * 10.0 ** rng.uniform(-2.0, -1.0)),)
    elif kind == "presliding":
        contact = {"distance": 10.0 ** rng.uniform(-4.0, -2.7), "bristles": float(seed % 2)}
        own["effects"] = (dfc.effects.Presliding(**contact),)
    return dfc.FrictionAxis(
        mass=level * 10.0 ** rng.uniform(-1.5, -0.5),
        viscous=level * 10.0 ** rng.uniform(-2.0, -1.0),
        coulomb=level,
        stick_speed=1e-4,
        units=("rad", "N m"),
        name="joint",
        **own,
    )


def drive(axis, dt, seed):
    """Torque of three tones that often exceeds the breakaway, shape (n,)."""
    rng = np.random.default_rng([99, seed])
    t = dt * np.arange(round(SECONDS / dt))
    tones = np.array([1.3, 3.1, 7.3]) * rng.uniform(0.8, 1.2, 3)
    u = rng.uniform(0.5, 1.0, 3) @ np.sin(np.outer(tones, t) + rng.uniform(0.0, 6.0, 3)[:, None])
    return u / np.abs(u).max() * axis.breakaway(0.0, 1) * rng.uniform(1.6, 2.6)


def positions(axis, u, dt, later):
    """Positions by `simulate` at the samples, and a part of a step later."""
    twice = axis.simulate(np.repeat(u, 2), dt=dt / 2.0).y[0]
    return twice[0::2], twice[1::2] if later else twice[0::2]


def model_text(inertia, dt):
    """An MJCF model of one joint."""
    body = " ".join(3 * [f"{inertia:.9g}"])
    return (
        f'<mujoco model="bench">\n  <option timestep="{dt}" gravity="0 0 0"/>\n  <worldbody>\n'
        '    <body name="link">\n      <joint name="joint" axis="0 0 1"/>\n'
        f'      <inertial pos="0 0 0" mass="1" diaginertia="{body}"/>\n    </body>\n'
        "  </worldbody>\n</mujoco>\n"
    )


def off(run, reference):
    """RMS difference over the standard deviation."""
    return float(np.sqrt(np.mean((run - reference) ** 2)) / np.std(reference))


def mujoco_run(path, u, dt):
    """Positions in MuJoCo under a held torque, shape (n,)."""
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.timestep = dt
    data = mujoco.MjData(model)
    x = np.empty(u.size)
    for k, torque in enumerate(u):
        x[k] = data.qpos[0]
        data.qfrc_applied[0] = torque
        mujoco.mj_step(model, data)
    return x


def written(axis, folder, dt, **options):
    """Path of the model with the values of the axis."""
    import dryfric_control as dfc

    path = Path(folder, "joint.xml")
    path.write_text(model_text(SHARE * axis.mass, dt))
    dfc.to_mjcf(axis, path, **options)
    return path


def errors(kind, seed, dt, folder, **options):
    """Errors of one joint as read, and half a step later."""
    axis = random_axis(kind, seed)
    u = drive(axis, dt, seed)
    run = mujoco_run(written(axis, folder, dt, **options), u, dt)
    now, later = positions(axis, u, dt, True)
    return off(run, now), off(run, later)


def random_joints(joints):
    """Table of random joints in the MuJoCo that is installed; whether all is as it must be."""
    import mujoco

    print(f"MuJoCo {mujoco.__version__}, {joints} joints a kind, RMS over standard deviation")
    print(f"{'kind':12}{'step':>8}{'median':>10}{'worst':>10}{'as read':>10}{'3.2':>10}")
    good = True
    with tempfile.TemporaryDirectory() as folder:
        for kind, most in MOST.items():
            for dt in STEPS:
                found = np.array([errors(kind, i, dt, folder) for i in range(joints)])
                plain = [errors(kind, i, dt, folder, dialect="3.2")[1] for i in range(joints)]
                median, worst = np.median(found[:, 1]), found[:, 1].max()
                row = f"{median:10.4f}{worst:10.4f}{found[:, 0].max():10.4f}{max(plain):10.4f}"
                print(f"{kind:12}{1e3 * dt:5.1f} ms{row}{'' if worst <= most else '  BEYOND'}")
                good &= bool(worst <= most)
    return good


# --- every simulator, in an environment of its own -------------------------------------------

#: Packages of each environment.
PACKAGES = {
    "mujoco32": ["mujoco==3.2.7"],
    "mujoco40": ["mujoco==4.0.0"],
    "pinocchio": ["pin==4.1.0"],
    "drake": ["drake==1.51.1"],
    "pybullet": ["pybullet==3.2.7", "numpy", "--only-binary=:all:"],
    "newton": ["newton[sim]==1.8.0"],
}
TITLES = ("Coulomb and viscous", "Stribeck 40 %", "drag", "presliding 2 mrad")
STEP = 1e-3  # s
LIMIT = 300.0  # s, for the replays of one environment


def hinges():
    """Hinges of 0.1 kg m^2 with 1 N m of friction."""
    import dryfric_control as dfc

    plain = dfc.FrictionAxis(
        mass=0.1, viscous=0.1, coulomb=1.0, stick_speed=1e-4, units=("rad", "N m"), name="joint"
    )
    made = (
        plain,
        plain.replace(stribeck=dfc.Stribeck(0.4, 0.3)),
        plain.replace(effects=(dfc.effects.QuadraticDrag(0.05),)),
        plain.replace(effects=(dfc.effects.Presliding(2e-3, bristles=1.0),)),
    )
    return dict(zip(TITLES, made, strict=True))


def urdf_text(inertia):
    """A URDF model of one joint, whose links bring all of the inertia."""
    moments = " ".join(f'{name}="{inertia}"' for name in ("ixx", "iyy", "izz"))
    return (
        '<robot name="bench">\n  <link name="base"/>\n  <link name="link">\n    <inertial>'
        f'<mass value="1"/><inertia {moments} ixy="0" ixz="0" iyz="0"/></inertial>\n  </link>\n'
        '  <joint name="joint" type="continuous">\n    <parent link="base"/><child link="link"/>'
        '<axis xyz="0 0 1"/>\n  </joint>\n</robot>\n'
    )


def write_cases(folder):
    """Files, drive and positions of each hinge."""
    import dryfric_control as dfc

    t = STEP * np.arange(round(SECONDS / STEP))
    u = 1.6 * np.sin(3.1 * t) + 0.7 * np.sin(7.3 * t + 0.5)
    for i, axis in enumerate(hinges().values()):
        for dialect in ("3.2", "4.0"):
            path = folder / f"{i}-{dialect}.xml"
            path.write_text(model_text(SHARE * axis.mass, STEP))
            dfc.to_mjcf(axis, path, dialect=dialect, stiff=True)
        path = folder / f"{i}.urdf"
        path.write_text(urdf_text(axis.mass))
        dfc.simulators.to_urdf(axis, path)
        now, later = positions(axis, u, STEP, True)
        np.savez(folder / f"{i}.npz", u=u, now=now, later=later)


def pinocchio_run(path, u):
    """aba with the friction data of the model, which aba itself leaves out."""
    import pinocchio as pin

    urdf = path.suffix == ".urdf"
    model = (pin.buildModelFromUrdf if urdf else pin.buildModelFromMJCF)(str(path))
    model.gravity.setZero()
    data, q, v = model.createData(), pin.neutral(model), np.zeros(1)
    x, angle = np.empty(u.size), 0.0
    for k, torque in enumerate(u):
        x[k] = angle
        free = v + STEP * pin.aba(model, data, q, v, np.array([torque]) - model.damping * v)
        inertia = pin.crba(model, data, q)[0, 0]
        most = STEP * model.upperDryFrictionLimit / inertia
        v = np.sign(free) * np.maximum(np.abs(free) - most, 0.0)
        q, angle = pin.integrate(model, q, STEP * v), angle + STEP * v[0]
    return x


def drake_run(path, u):
    """MultibodyPlant in discrete time."""
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.systems.analysis import Simulator

    plant = MultibodyPlant(STEP)
    Parser(plant).AddModels(str(path))
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, 0.0])
    if path.suffix == ".urdf":
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    simulator = Simulator(plant)
    context, port = (
        simulator.get_mutable_context(),
        plant.get_applied_generalized_force_input_port(),
    )
    x = np.empty(u.size)
    for k, torque in enumerate(u):
        x[k] = plant.GetPositions(context)[0]
        port.FixValue(context, [torque])
        simulator.AdvanceTo((k + 1) * STEP)
    return x


def pybullet_run(path, u):
    """Motor and its own damping off, torque applied."""
    import pybullet

    pybullet.connect(pybullet.DIRECT)
    pybullet.setTimeStep(STEP)
    body = pybullet.loadURDF(
        str(path), useFixedBase=True, flags=pybullet.URDF_USE_INERTIA_FROM_FILE
    )
    pybullet.setJointMotorControl2(body, 0, pybullet.VELOCITY_CONTROL, force=0.0)
    pybullet.changeDynamics(body, 0, linearDamping=0.0, angularDamping=0.0)
    x = np.empty(u.size)
    for k, torque in enumerate(u):
        x[k] = pybullet.getJointState(body, 0)[0]
        pybullet.setJointMotorControl2(body, 0, pybullet.TORQUE_CONTROL, force=torque)
        pybullet.stepSimulation()
    pybullet.disconnect()
    return x


def newton_run(path, u, solver):
    """A solver of Newton, on the processor."""
    import newton
    import warp

    warp.config.quiet = True
    builder = newton.ModelBuilder()
    (builder.add_urdf if path.suffix == ".urdf" else builder.add_mjcf)(str(path))
    model = builder.finalize(device="cpu")
    options = {"use_mujoco_cpu": True} if solver == "SolverMuJoCo" else {}
    stepper = getattr(newton.solvers, solver)(model, **options)
    state, after, control = model.state(), model.state(), model.control()
    newton.eval_fk(model, model.joint_q, model.joint_qd, state)
    x = np.empty(u.size)
    for k, torque in enumerate(u):
        x[k] = state.joint_q.numpy()[-1]
        control.joint_f.fill_(float(torque))
        stepper.step(state, after, control, None, STEP)
        state, after = after, state
    return x


#: What each environment replays: title, ending of the file, and how.
REPLAYS = {
    "mujoco32": [("MuJoCo 3.2.7, dialect 3.2", "-3.2.xml", mujoco_run)],
    "mujoco40": [
        ("MuJoCo 4.0.0, dialect 3.2", "-3.2.xml", mujoco_run),
        ("MuJoCo 4.0.0, dialect 4.0", "-4.0.xml", mujoco_run),
    ],
    "pinocchio": [
        ("Pinocchio 4.1.0, aba and its friction data, dialect 3.2", "-3.2.xml", pinocchio_run),
        ("the same, dialect 4.0", "-4.0.xml", pinocchio_run),
    ],
    "drake": [
        ("Drake 1.51.1, MJCF, dialect 3.2", "-3.2.xml", drake_run),
        ("the same, dialect 4.0", "-4.0.xml", drake_run),
        ("Drake 1.51.1, URDF", ".urdf", drake_run),
    ],
    "pybullet": [("PyBullet 3.2.7, URDF", ".urdf", pybullet_run)],
    "newton": [
        ("Newton 1.8.0, SolverMuJoCo, dialect 3.2", "-3.2.xml", "SolverMuJoCo"),
        ("the same, dialect 4.0", "-4.0.xml", "SolverMuJoCo"),
        ("Newton 1.8.0, SolverFeatherstone, dialect 3.2", "-3.2.xml", "SolverFeatherstone"),
    ],
}


def replay(name, folder):
    """Rows of one environment, as a line of JSON each: title, and an error or reason a hinge."""
    for title, ending, run in REPLAYS[name]:
        row = []
        for i in range(len(TITLES)):
            data = np.load(folder / f"{i}.npz")
            path = folder / f"{i}{ending}"
            try:
                if isinstance(run, str):
                    x = newton_run(path, data["u"], run)
                elif run is mujoco_run:
                    x = mujoco_run(path, data["u"], STEP)
                else:
                    x = run(path, data["u"])
                row.append(f"{min(off(x, data['now']), off(x, data['later'])):.2g}")
            except (RuntimeError, ValueError, NotImplementedError) as problem:
                print(f"{title}, {TITLES[i]}: {problem}", file=sys.stderr)
                row.append("refused")
        print(json.dumps([title, *row]), flush=True)


def others(folder):
    """Table of all simulators."""
    folder.mkdir(parents=True, exist_ok=True)
    write_cases(folder)
    rows = []
    for name, packages in PACKAGES.items():
        python = folder / name / "bin" / "python"
        began = time.monotonic()
        if not python.exists():
            venv.create(folder / name, with_pip=True)
            subprocess.run([python, "-m", "pip", "install", "--quiet", *packages], check=True)
        command = [python, __file__, "replay", name, str(folder)]
        try:
            ran = subprocess.run(
                command, stdout=subprocess.PIPE, text=True, check=False, timeout=LIMIT
            )
            lines = [line for line in ran.stdout.splitlines() if line.startswith('["')]
            rows += map(json.loads, lines)
        except subprocess.TimeoutExpired:
            rows.append((name, *["not finished"] * len(TITLES)))
        print(f"{name}: {time.monotonic() - began:.0f} s", file=sys.stderr)
    for row in [("simulator and file", *TITLES), 5 * ("---",), *rows]:
        print(f"| {' | '.join(row)} |")


def main():
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", nargs="?", default="mujoco", choices=["mujoco", "others", "replay"])
    parser.add_argument("rest", nargs="*")
    parser.add_argument("--joints", type=int, default=JOINTS)
    chosen = parser.parse_args()
    if chosen.what == "mujoco":
        return 0 if random_joints(chosen.joints) else 1
    if chosen.what == "replay":
        replay(chosen.rest[0], Path(chosen.rest[1]))
    elif chosen.rest:
        others(Path(chosen.rest[0]).resolve())
    else:
        with tempfile.TemporaryDirectory() as folder:
            others(Path(folder))
    return 0


if __name__ == "__main__":
    sys.exit(main())
