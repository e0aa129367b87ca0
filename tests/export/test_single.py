"""Single precision after hours and far from zero, against double precision and closed forms."""

import subprocess

import native
import numpy as np
import pytest
from remembering import SLIP

import dryfric_control as dfc
from dryfric_control.compiled import axis_step

pytestmark = pytest.mark.skipif(native.GCC is None, reason="no gcc: exported C is not compiled")

E = dfc.effects
DT, QUANTUM = 1e-4, 1e-6

PULSES = E.TimePeriodic(2.0, 50.0, 0.3)
HOUR = 36_000_000


def stage(*effects, **given):
    return dfc.FrictionAxis(2.0, 5.0, 8.0, effects=effects, name="stage", **given)


@pytest.mark.parametrize(
    ("precision", "after"), [("single", HOUR), ("mixed", 2**32 - 100), ("single", 2**36)]
)
def test_a_periodic_force_keeps_its_phase(tmp_path, precision, after):
    code = native.Native(stage(PULSES), tmp_path, precision, DT, [f"-DAFTER={after}u"])
    friction = code.run(np.zeros(400))[0][2]
    # A period is of 200 samples.
    expected = 2.0 * np.sin(2.0 * np.pi * ((after + np.arange(400)) % 200) / 200.0 + 0.3)
    assert np.abs(friction - expected).max() < 2e-6


def test_the_count_of_samples_does_not_end_in_double_precision(tmp_path):
    axis = stage(E.Drift(1e-6), PULSES)
    code = native.Native(axis, tmp_path, dt=DT, flags=[f"-DAFTER={2**32 - 100}u"])
    out, _ = code.run(np.full(200, 30.0), starts=[0.0, 1.0])
    level = 8.0 * (1.0 + 1e-6 * DT * (2**32 - 100 + np.arange(200)))
    assert np.all(out[3] == 1.0)  # a motion that goes on; the mode is not chosen anew
    assert np.abs(out[2] - level).max() < 1e-9


@pytest.mark.parametrize("more", [(), (E.Presliding(2e-5),)], ids=["rigid", "elastic"])
def test_time_at_rest_is_summed_without_loss(tmp_path, more):
    n = 200_000  # 20 s, of which a float that grows by samples loses 30 ms
    code = native.Native(stage(E.DwellTime(4.0, 60.0), *more), tmp_path, "single", DT)
    (tmp_path / "driver.c").write_text(
        '#include "stage.h"\n#include <stdio.h>\nint main(void)\n{\n    stage_state s;\n'
        "    stage_output o;\n    stage_init(&s, 0, 0);\n"
        f"    for (int k = 0; k < {n}; ++k)\n        (void)stage_step(&s, 2, &o);\n"
        f'    printf("%.9g", (double)s.memory[{axis_step.REST}]);\n    return 0;\n}}\n'
    )
    program = code.compiled(tmp_path / "alone")
    rest = float(subprocess.run([program], capture_output=True, check=True).stdout)
    assert abs(rest - n * DT) < 1e-5


FAR = 5.0
PLACED = (E.Cogging(1.0, 0.002, 0.4), E.EccentricEncoder(2e-5, 0.001, 0.2), E.Spring(20.0, FAR))
UNEVEN = dfc.CoulombMap([8.0, 0.2], [7.0, -0.1])
KINDS = {
    "plain": (),
    "contact": (E.Presliding(2e-5),),
    "spring": (E.Compliance(1e5, 50.0, 0.4),),
    "memory": (SLIP,),
}


def moving(axis, place=FAR):
    """Drive and motion of an axis from rest, with a reversal."""
    u = np.repeat([12.0, -12.0], 2000)
    return u, axis.simulate(u, DT, x0=place).y


@pytest.mark.parametrize("kind", KINDS)
def test_an_axis_moves_far_from_zero_as_near(tmp_path, kind):
    axis = stage(*PLACED, *KINDS[kind]).replace(coulomb=UNEVEN, travel=(-10.0, 10.0))
    u, expected = moving(axis)
    out, _ = native.Native(axis, tmp_path, "mixed", DT).run(u, starts=[FAR, 0.0])
    assert np.ptp(expected[0]) > 1e-3
    assert np.abs(out[0] - expected[0]).max() < 1e-6
    assert np.abs(out[1] - expected[1]).max() < 1e-4
    single, _ = native.Native(axis, tmp_path / "single", "single", DT).run(u, starts=[FAR, 0.0])
    assert np.abs(single[0] - expected[0]).max() < 1e-6 + 2.0**-22  # the last place of 5 m
    assert np.abs(single[1:] - out[1:]).max() == 0.0


def test_many_turns_are_as_one(tmp_path):
    # A thousand turns, and a quarter.
    place = 2.0 * np.pi * 1000.25
    axis = stage(E.Gravity(3.0, 0.5), E.Cogging(1.0, 0.1), units=("rad", "N m"))
    code = native.Native(axis, tmp_path, "mixed", DT)
    load = code.run(np.zeros(2), starts=[place, 0.0])[0][2]
    assert abs(load[0] + 3.0 * np.cos(0.5) - np.sin(20.0 * np.pi * place)) < 1e-5


@pytest.mark.parametrize(
    ("estimate", "precision"), [(dfc.design_pi_observer, "single"), (dfc.hybrid_filter, "mixed")]
)
def test_estimates_are_as_good_far_from_zero(tmp_path, estimate, precision):
    axis, off = stage(*PLACED[:1]).replace(coulomb=UNEVEN, travel=(-10.0, 10.0)), []
    for place in (0.0, FAR):
        u, motion = moving(axis, place)
        y = QUANTUM * np.round(motion[0] / QUANTUM)
        if precision == "single":
            # What its reading can hold there; the same near zero.
            y = np.float32(y - place + FAR).astype(float) - FAR + place
        obj = estimate(axis, DT, encoder_quantum=QUANTUM)
        expected = native.by_kernel(obj, u, y, place=place)
        code = native.Native(obj, tmp_path / f"{place}", precision)
        out, _ = code.run(u, y, starts=[place, 0.0, 0.0] if precision == "single" else [])
        # Where modes are equally likely, one sample may differ by more.
        off.append(np.median(np.abs(out[:3] - expected[:3]), axis=1))
        assert np.abs(out[0] - y).max() < 20 * QUANTUM
    off[1][0] -= np.finfo(code.real).eps * FAR  # the last place of a position
    assert np.all(off[1] < 3.0 * off[0] + 1e-9), off
