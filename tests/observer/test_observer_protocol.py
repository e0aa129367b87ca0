"""What all observers have in common: one sample, several faces, kept in a file."""

import dataclasses

import numpy as np
import pytest
from observers import AXIS, DT, OBSERVERS, drive_and_reading

import dryfric_control as dfc
from dryfric_control.observer import Observer

every_observer = pytest.mark.parametrize("observer", OBSERVERS.values(), ids=OBSERVERS)


@every_observer
def test_the_faces_of_an_observer_are_one_sample(observer):
    u, y = drive_and_reading(300)
    run = observer.run(u, y).y
    stepper, block = observer.stepper(), observer.block()
    state = np.zeros(block.nstates)
    # Where a block starts is its user's: the switched observer takes a state, no first reading.
    state[0] = y[0]
    for k, signals in enumerate(zip(u, y, strict=True)):
        assert np.array_equal(stepper.step(*signals), run[:, k])
        t, signals = k * DT, np.array(signals)
        assert np.array_equal(block.output(t, state, signals), run[:, k])
        state = block.dynamics(t, state, signals)


@every_observer
def test_a_record_is_its_drive_and_positions(observer):
    u, y = drive_and_reading(300)
    record = dfc.Record(np.arange(u.size) * DT, u, y)
    assert np.array_equal(observer.run(record).y, observer.run(u, y).y)


@every_observer
def test_the_known_load_of_a_record_acts_on_the_mass(observer):
    u, y = drive_and_reading(300)
    record = dfc.Record(np.arange(u.size) * DT, u, y, load=np.full(u.size, 2.0))
    # A design may have a stick velocity of its own.
    axis = observer.axis
    pushed = axis.replace(effects=(*axis.effects, dfc.effects.BiasForce(2.0)))
    informed = dataclasses.replace(observer, axis=pushed)
    loaded = observer.run(record).y
    np.testing.assert_allclose(loaded, informed.run(u, y).y, rtol=1e-9, atol=1e-9)  # order of sums
    # In the velocity of one with a model, in the friction of any.
    assert not np.allclose(loaded[1:3], observer.run(u, y).y[1:3], atol=1e-4)


@every_observer
def test_a_file_keeps_an_observer(observer, tmp_path):
    u, y = drive_and_reading(300)
    observer.save(tmp_path / "observer.json")
    kept = type(observer).load(tmp_path / "observer.json")
    assert np.array_equal(kept.run(u, y).y, observer.run(u, y).y)


@every_observer
def test_a_file_with_another_field_is_refused(observer, tmp_path):
    path = tmp_path / "observer.json"
    observer.save(path)
    path.write_text(path.read_text().replace('"dt",', '"dz",').replace('"dt":', '"dz":'))
    with pytest.raises(ValueError, match="damaged"):
        type(observer).load(path)


@every_observer
def test_an_observer_is_determined_by_its_fields(observer):
    assert isinstance(observer, Observer)
    twin = dataclasses.replace(observer)
    pairs = zip(observer.tables(), twin.tables(), strict=True)
    assert all(np.array_equal(one, other) for one, other in pairs)


@every_observer
def test_an_option_that_an_observer_has_not_is_an_error(observer):
    with pytest.raises(TypeError, match="gain"):
        observer.run(*drive_and_reading(10), gain=1.0)


def test_the_functions_of_the_switched_observer_call_its_methods():
    design, (u, y) = OBSERVERS["switched PI"], drive_and_reading(300)
    options = {"vhat0": 0.01, "what0": -0.1, "switching": "paper", "encoder_quantum": 2e-5}
    run = design.run(u, y, **options)
    assert np.array_equal(run.y, dfc.observe(design, u, y, **options).y)
    stepper = dfc.observer.ObserverStepper(design, **options)
    assert np.array_equal(stepper.step(u[0], y[0]), run.y[:, 0])
    assert dfc.pi_observer(design).state_labels == design.block().state_labels


def test_a_compensation_runs_as_its_controller():
    comp = dfc.design_compensation(AXIS, DT)
    move = dfc.motion_profile(0.01, DT, velocity=0.05, acceleration=1.0, jerk=50.0)
    runs = [dfc.simulate_loop(AXIS, one, move, quantum=1e-6).y for one in (comp, comp.controller)]
    assert np.array_equal(*runs)
    reference = {"xref": 1e-3, "vref": 0.05, "aref": 0.0, "y": 1e-3}
    assert comp.stepper().step(**reference) == comp.controller.stepper().step(**reference)
