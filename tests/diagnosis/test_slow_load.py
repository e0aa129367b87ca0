"""A load that swings slowly, on a rope or a long belt, in a record made by plain steps."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control.estimation.windows import cut

TROLLEY, LOAD = 250.0, 120.0  # [kg]
VISCOUS, COULOMB = 70.0, 90.0  # of the trolley [N s/m], [N]
STIFFNESS, DAMPING = 390.0, 6.0  # m g / length of the rope [N/m], [N s/m]
DT, SUBSTEPS = 1e-2, 50
AXIS = dfc.FrictionAxis(mass=380.0, viscous=60.0, coulomb=100.0)


def swinging(seconds=25.0):
    """Drive and encoder of the trolley, moved to and fro by a loop, and the position of its load."""
    rng = np.random.default_rng(3)
    n, h = round(seconds / DT), DT / SUBSTEPS
    x = v = y = p = last = 0.0
    u, seen, hangs = np.empty(n), np.empty(n), np.empty(n)
    for k in range(n):
        seen[k] = 1e-5 * round(x / 1e-5)
        hangs[k] = y
        wanted = 1.2 * math.sin(0.55 * k * DT) + 0.4 * math.sin(1.3 * k * DT)
        u[k] = 900.0 * (wanted - seen[k]) - 700.0 * (seen[k] - last) / DT
        last = seen[k]
        for _ in range(SUBSTEPS):
            pull = STIFFNESS * (x - y) + DAMPING * (v - p)
            if v != 0.0 or abs(u[k] - pull) > COULOMB:
                s = math.copysign(1.0, v if v != 0.0 else u[k] - pull)
                new = v + h * (u[k] - pull - COULOMB * s - VISCOUS * v) / TROLLEY
                v = 0.0 if v * new < 0.0 else new
            p += h * pull / LOAD
            x += h * v
            y += h * p
    return dfc.Record(DT * np.arange(n), u + 0.5 * rng.standard_normal(n), seen), hangs


def test_the_force_of_the_load_is_a_column_of_the_motion_of_the_trolley():
    t = 2e-3 * np.arange(10_000)
    a = np.sin(1.9 * t) * np.exp(-(((t - 5.0) / 2.0) ** 2)) + 0.3 * np.cos(4.1 * t)
    view = SimpleNamespace(
        axis=SimpleNamespace(mass=370.0), t=t, a=a, dt=2e-3, duration=float(t[-1])
    )
    columns = [one for one in dfc.effects.Compliance.columns(view) if one.force]
    share = 0.3
    values = columns[7].values([share])
    y = p = 0.0
    pulled = np.empty(t.size)
    for k, one in enumerate(a):  # of the stretch of the spring, by plain steps
        for _ in range(20):
            bends = one - (values["stiffness"] * y + values["damping"] * p) / (share * 370.0)
            p += 1e-4 * bends
            y += 1e-4 * p
        pulled[k] = share * 370.0 * (one - (values["stiffness"] * y + values["damping"] * p)
                                     / (share * 370.0))  # fmt: skip
    off = share * columns[7].force[0] - pulled
    assert np.sqrt(np.mean(off**2)) < 0.02 * np.sqrt(np.mean(pulled**2))
    assert values["friction_on_motor"] == 1.0 and values["load_fraction"] == share


def test_a_free_run_knows_where_the_load_swings_from_all_the_motion_before():
    record, _ = swinging(12.0)
    load = dfc.effects.Compliance(
        stiffness=STIFFNESS, damping=DAMPING, load_fraction=LOAD / (TROLLEY + LOAD),
        friction_on_motor=1.0,
    )  # fmt: skip
    axis = dfc.FrictionAxis(mass=TROLLEY + LOAD, viscous=VISCOUS, coulomb=COULOMB, effects=(load,))
    windows = cut(record, 0.5)
    last = np.arange(len(windows)) == len(windows) - 2
    alone = windows.evaluate(axis, last).costs[last]
    among_all = windows.evaluate(axis, np.ones(len(windows), bool)).costs[last]
    assert alone == pytest.approx(among_all, rel=0.2, abs=5.0)
    rigid = axis.replace(effects=())
    assert np.all(alone < 0.1 * windows.evaluate(rigid, last).costs[last])


@pytest.mark.slow
def test_a_load_on_a_rope_is_named_and_no_disturbance_in_time():
    d = dfc.diagnose(AXIS, swinging()[0], jobs=1, progress=False)
    assert [
        cause.effect for cause in d.main_causes if cause.effect not in ("coulomb", "viscous")
    ] == ["compliance"]
    (found,) = d.extended.effects
    assert found.friction_on_motor == 1.0
    assert found.stiffness == pytest.approx(STIFFNESS, rel=0.05)
    assert found.load_fraction == pytest.approx(LOAD / (TROLLEY + LOAD), rel=0.05)
