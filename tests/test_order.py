"""Arguments in the wrong order are refused where their values show it, and only there."""

import numpy as np
import pytest

import dryfric_control as dfc

DT = 1e-3
AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
SMALL = dfc.FrictionAxis(
    mass=1e-5, viscous=1e-5, coulomb=5e-3, stick_speed=1e-3, units=("rad", "N m")
)


@pytest.mark.parametrize(
    ("axis", "size", "quantum"), [(AXIS, 15.0, 1e-6), (AXIS, 9.0, 1e-4), (SMALL, 0.01, 1e-3)]
)
def test_drive_and_reading(axis, size, quantum):
    t = DT * np.arange(2000)
    u = size * np.sin(6.0 * t)
    y = quantum * np.round(axis.simulate(u, DT).y[0] / quantum)
    design = dfc.design_pi_observer(axis, DT, encoder_quantum=quantum)
    hybrid = dfc.hybrid_filter(axis, DT, quantum)
    for run in (lambda a, b: dfc.observe(design, a, b), hybrid.run):
        run(u, y)
        with pytest.raises(ValueError, match="u and y look exchanged: .* the other way round by"):
            run(y, u)
    swapped = dfc.Record(t, y, u, units={"x": axis.units[0], "u": axis.units[1]})
    for call, *given in (
        (dfc.observe, design, swapped), (dfc.fit, axis, swapped), (dfc.diagnose, axis, swapped),
        (dfc.replay, axis, swapped), (dfc.identify_coulomb, swapped, None, axis),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=r"record.*\.u and .*\.x look exchanged"):
            call(*given)


def test_a_nominal_axis_that_is_far_off_is_no_exchange():
    """Base parameters off by 2.5, a weight of twice the level nobody knows, a drive of noise."""
    rng = np.random.default_rng(5)
    t = DT * np.arange(3000)
    for force, length in ((1.0, 1.0), (1e-4, 1e2), (1e4, 1e-3)):
        axis = dfc.FrictionAxis(
            mass=2.0 * force / length, viscous=15.0 * force / length, coulomb=8.0 * force,
            stick_speed=1e-4 * length, effects=dfc.effects.BiasForce(force=-16.0 * force),
        )  # fmt: skip
        for noise in (0.0, 5.0):
            u = force * (16.0 + 12.0 * np.sin(5.0 * t) + noise * rng.standard_normal(t.size))
            y = axis.simulate(u, DT).y[0]
            for factor in (0.4, 2.5):
                off = dict(mass=factor * axis.mass, viscous=axis.viscous / factor)
                nominal = axis.replace(**off, effects=())
                dfc.replay(nominal, dfc.Record(t, u, y))
                dfc.replay(nominal, dfc.Record(t, u, y + 20.0 * length))
