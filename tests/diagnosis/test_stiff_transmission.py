"""Two masses on a spring that rings between the frequency of the drive and that of the samples."""

import math

import numba
import numpy as np
import pytest

import dryfric_control as dfc

DT, STEP = 2e-3, 2e-6
MASS, VISCOUS, LEVEL, SHARE, RATIO = 4.0, 20.0, 6.0, 0.6, 0.03


@numba.njit
def two_masses(u, stiffness, damping):
    """Position of the motor, friction on the load; in steps of 2 us by the semi-implicit rule."""
    motor, load = MASS * (1.0 - SHARE), MASS * SHARE
    x = v = y = p = 0.0
    out = np.empty(u.size)
    for i in range(u.size):
        out[i] = x
        for _ in range(round(DT / STEP)):
            s = stiffness * (x - y) + damping * (v - p)
            v += STEP * (u[i] - s) / motor
            w = s - VISCOUS * p
            if p == 0.0:
                p = STEP * (w - math.copysign(LEVEL, w)) / load if abs(w) > LEVEL else 0.0
            else:
                new = p + STEP * (w - math.copysign(LEVEL, p)) / load
                p = 0.0 if new * p < 0.0 else new
            x, y = x + STEP * v, y + STEP * p
    return out


@pytest.mark.slow
@pytest.mark.parametrize(
    "turn", [*(pytest.param(one, marks=pytest.mark.long) for one in (0.6, 1.0)), 1.6],
    ids="{} rad a sample".format,
)  # fmt: skip
def test_it_is_found_where_no_reversal_shows_it(turn):
    # With 0.6 it was "velocity strengthening" and a periodic force, with 1 "unexplained", with 1.6 an
    # elastic contact: no friction builds up after reversals, it shows as a random force alone.
    rng = np.random.default_rng(int(10 * turn))
    t = DT * np.arange(4000)
    waves = ((1.3, 9.0), (7.1, 7.0), (23.0, 6.0), (61.0, 8.0), (110.0, 8.0))  # rad/s, N
    u = sum(a * np.sin(w * t + rng.uniform(0.0, 6.0)) for w, a in waves)
    reduced, rate = MASS * SHARE * (1.0 - SHARE), turn / DT
    stiffness, damping = reduced * rate**2, 2.0 * RATIO * reduced * rate
    x = 1e-6 * np.round(two_masses(u, stiffness, damping) / 1e-6)
    believed = dfc.FrictionAxis(mass=4.2, viscous=VISCOUS, coulomb=LEVEL)
    d = dfc.diagnose(believed, dfc.Record(t, u, x, quantum=1e-6), jobs=1, progress=False)
    assert [cause.effect for cause in d.causes if cause.effect != "inertia"] == ["compliance"]
    found = next(cause.parameters for cause in d.causes if cause.effect == "compliance")
    assert found["stiffness"] == pytest.approx(stiffness, rel=0.02)
    assert found["load_fraction"] == pytest.approx(SHARE, rel=0.02)
    assert d.extended.mass == pytest.approx(MASS, rel=2e-3)
