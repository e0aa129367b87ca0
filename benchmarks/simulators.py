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
import sys
import tempfile
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


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--joints", type=int, default=JOINTS)
    chosen = parser.parse_args()
    sys.exit(0 if random_joints(chosen.joints) else 1)
