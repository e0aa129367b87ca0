"""A known load acts on the mass as the drive does, and stays with its record."""

import numpy as np
import pytest
from dryfric_control.effects import Backlash, BiasForce, InputGain

import dryfric_control as dfc

DT = 1e-3
T = DT * np.arange(1500)
U = 12.0 * np.sin(5.0 * T) + 3.0 * np.sin(31.0 * T)
LOAD = 4.0 * np.sin(3.0 * T + 1.0) + 2.0 * np.cos(40.0 * T)
AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, stribeck=dfc.Stribeck(0.3, 0.01))


def record(axis=AXIS):
    x = 1e-6 * np.round(1e6 * axis.simulate(U, DT, load=LOAD).y[0])
    return dfc.Record(T, U, x, load=LOAD, units={"u": "N", "x": "m"}, name="loaded")


@pytest.mark.parametrize("hold", ["zero", "first"])
def test_without_effects_on_the_drive_it_is_the_same_as_more_drive(hold):
    one = AXIS.simulate(U, DT, load=LOAD, hold=hold)
    two = AXIS.simulate(U + LOAD, DT, hold=hold)
    np.testing.assert_allclose(one.y, two.y, atol=1e-12)  # round-off of a sum


def test_no_effect_on_the_drive_changes_it_and_of_two_masses_it_is_on_the_load():
    steady = np.full(T.size, 3.0)
    for effects in ((InputGain(gain=0.5),), (Backlash(gap=1e-4, load_fraction=0.6),)):
        axis = AXIS.replace(effects=effects)
        one = axis.simulate(U, DT, load=steady)
        two = axis.replace(effects=(*effects, BiasForce(force=3.0))).simulate(U, DT)
        np.testing.assert_allclose(one.y[0], two.y[0], atol=1e-8)  # error of the steps


def test_fit_replay_and_observers_take_it_from_the_record():
    loaded = record()
    added = dfc.Record(T, U + LOAD, loaded.x)
    a, b = (dfc.fit(AXIS.replace(mass=2.4, coulomb=7.0), r) for r in (added, loaded))
    for name, value in {"mass": 2.0, "viscous": 15.0, "coulomb": 8.0}.items():
        assert b.parameters[name] == pytest.approx(value, rel=1e-4)  # readings in steps of 1 um
        assert b.parameters[name] == pytest.approx(a.parameters[name], rel=1e-5)
    assert dfc.replay(AXIS, loaded).median == pytest.approx(dfc.replay(AXIS, added).median)
    design = dfc.design_pi_observer(AXIS, dt=DT, encoder_quantum=1e-6)
    np.testing.assert_allclose(dfc.observe(design, loaded).y, dfc.observe(design, added).y)
    hybrid = dfc.hybrid_filter(AXIS, DT, 1e-6)
    np.testing.assert_allclose(hybrid.run(loaded).outputs, hybrid.run(added).outputs, atol=1e-9)


def test_it_is_cut_saved_and_resampled_with_the_record(tmp_path):
    one = record()
    np.testing.assert_array_equal(one[100:200].known_load, LOAD[100:200])
    np.testing.assert_allclose(one.decimated(2).known_load, LOAD.reshape(-1, 2).mean(axis=1))
    np.testing.assert_allclose(one.resampled(2e-3).known_load, one.decimated(2).known_load)
    one.to_csv(tmp_path / "one.csv")
    one.save(tmp_path / "one.json")
    for back in (
        dfc.read_record(tmp_path / "one.csv"), dfc.load_record(tmp_path / "one.json"),
        dfc.Record.from_frame(one.to_pandas()), one.replace(u=U),
    ):  # fmt: skip
        assert back == one and np.array_equal(back.known_load, LOAD)
    assert "load" in one.summary() and dfc.Record(T, U, one.x).known_load is None
    labels = [line.get_label() for line in one.plot().axes[1, 0].get_lines()]
    assert "known load" in labels


def test_bad_loads_are_refused():
    x = record().x
    with pytest.raises(ValueError, match="load has 3 samples and u 1500: give one at each"):
        AXIS.simulate(U, DT, load=[0.0, 1.0, 2.0])
    with pytest.raises(ValueError, match="load has 3 samples but t has 1500"):
        dfc.Record(T, U, x, load=[0.0, 1.0, 2.0])
    with pytest.raises(ValueError, match="load is in N m and u in N: .* give the load in N"):
        dfc.Record(T, U, x, load=LOAD, units={"u": "N", "load": "N m"})
    with pytest.raises(ValueError, match="load cannot be used with law"):
        AXIS.simulate(U, DT, load=LOAD, law=dfc.laws.Tanh(speed=1e-3))
