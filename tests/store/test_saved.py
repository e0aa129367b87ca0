"""What is saved: read back as it was; refused when changed, damaged or something else."""

import dataclasses
import functools
import json
from typing import Any

import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control import effects as fx
from dryfric_control.diagnosis import Experiment
from dryfric_control.diagnosis.remaining import Remaining
from dryfric_control.diagnosis.report.findings import Gain, Unexplained
from dryfric_control.store import saved
from dryfric_control.store.axis_file import axis_from_dict
from dryfric_control.store.saved import Saved, read_document, write_document

T = 1e-3 * np.arange(3000)
U = 20.0 * np.sin(6.0 * T) + 10.0 * np.sin(17.0 * T)
PLAIN = dfc.FrictionAxis(
    mass=2.0, viscous=15.0, coulomb=8.0, travel=(-1.0, 1.0), effects=fx.Spring(40.0)
)
AXIS = PLAIN.replace(coulomb=(8.0, 7.0), stribeck=dfc.Stribeck(0.1, 0.02), name="z ü")
X = 1e-6 * np.round(1e6 * AXIS.simulate(U, dt=1e-3).y[0])
MORE = dict(units={"x": "m"}, channels={"v": np.cos(T)}, raw={"x": ("counts", 1e-6)})
RECORD = dfc.Record(T, U, X, name="run", **MORE)
MOVE = dfc.motion_profile([0.0, 0.01], 1e-3, velocity=0.1, acceleration=2.0, jerk=80.0)


def diagnosis():
    cause = dfc.diagnosis.Cause(
        "spring", "spring", {"stiffness": 40.0}, {"stiffness": np.inf}, {"stiffness": "N/m"}, 1.0,
        (0.5, 1.5), ("gravity",), "e", "x",
    )  # fmt: skip
    plan = Experiment(
        name="steps", title="steps", description="step it", t=T, reference=np.sin(T),
        separates=("gravity",), score={"gravity": 3.0}, tried={"a": 1.0}, cause="spring",
        positions={"spring": T}, drives={"spring": U}, units=("m", "N"),
    )  # fmt: skip
    found = dfc.Diagnosis(
        AXIS, RECORD, "explained", (cause,), AXIS, Gain(1e-3, 1e-6, 1e-6, (0.9, 1.1), "m"),
        Unexplained(0.0, False, ()), plan, ("one",), {"": np.inf, "spring": 0.1}, 0.25,
        np.arange(12) % 3,
    )  # fmt: skip
    left = Remaining(0.2, 0.003, True, ("x",), (1.0, 10.0), (3e-4, 2e-4))
    return dataclasses.replace(found, remaining=left, references={"nominal axis": 3250.0})


def compensation(effects=(), **limit):
    axis = PLAIN.replace(stribeck=dfc.Stribeck(0.3, 0.01), stick_speed=1e-3, effects=effects)
    return dfc.design_compensation(axis, 1e-3, 1e-6, 1e-3, bandwidth=80.0, **limit)


def moved(one):
    """Axis, tube and the simulated loop of a compensation."""
    run = dfc.simulate_loop(one.axis, one.controller, MOVE, quantum=1e-6)
    return [one.axis, one.certificate.tube, one.limit, run.y.tobytes()]


HIDDEN = fx.Cogging(2.0, 8e-3, 0.5), fx.InputGain(0.8), fx.DeadZone(1.0), fx.PositionDependence(2.0)
#: What is saved, and what of it must come back, bit for bit.
MADE = {
    "record": (lambda: RECORD,
               lambda one: [one, one.raw, one.units, one.quantum, one.channels["v"].tobytes()]),
    "fit": (lambda: dfc.fit(AXIS, RECORD, free=("mass", "viscous")),
            lambda one: [one.axis, one.axis.name, one.parameters, one.interval(), one.replay(RECORD).rms,
                         one.bootstrap(repeats=20), one.training[0].windows.record]),
    "diagnosis": (diagnosis,
                  lambda one: [one.to_dict(), one.record, one.scores, one.remaining, one.references,
                               one.roles.tobytes(), one.next_experiment.drives["spring"].tobytes()]),
    "observer": (lambda: dfc.design_pi_observer(PLAIN, dt=1e-3, encoder_quantum=1e-6),
                 lambda one: [one.axis, one.gamma, dfc.observe(one, RECORD).y.tobytes()]),
    "compensation": (compensation, moved),
    "compensation of effects": (lambda: compensation(HIDDEN, limit=60.0), moved),
}  # fmt: skip


@functools.cache
def made(kind):
    """One of a kind, made once."""
    return MADE[kind][0]()


@pytest.mark.parametrize("kind", MADE)
def test_it_comes_back_as_it_was(kind, tmp_path):
    one, shown, path = made(kind), MADE[kind][1], tmp_path / "one.json"
    one.save(path)
    again = type(one).load(path)
    assert again.summary() == one.summary()
    assert shown(again) == shown(one)
    again.save(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == path.read_bytes()
    if kind.startswith(("observer", "compensation")):  # what a user sees of a design is plain data
        assert axis_from_dict(json.loads(json.dumps(one.to_dict()))["axis"]) == one.axis


@pytest.mark.parametrize("kind", MADE)
def test_what_was_changed_or_is_something_else_is_refused(kind, tmp_path):
    one, changed = made(kind), tmp_path / "changed.json"
    one.save(changed)
    text = changed.read_text()
    for words, now in (
        ("checksum does not fit", text.replace('"version": 1,', '"version": 1, "more": 0,')),
        ("is damaged", text[:-40]),
        ("version 3, this package reads 1: .* newer package", text.replace(": 1,", ": 3,", 1)),
        (f"is no {type(one)._kind}", text.replace("dryfric-control", "else", 1)),
    ):
        assert now != text
        changed.write_text(now)
        with pytest.raises(ValueError, match=words) as caught:
            type(one).load(changed)
        assert "changed.json" in str(caught.value)
    with pytest.raises(FileNotFoundError, match="Did you mean 'changed.json'"):
        type(one).load(tmp_path / "changed2.json")


#: Steps of a graph on which no mode ever changes, as a file has them.
LONE = [{"is": "tuple", "items": [k, k]} for k in (0, 1)]
# Beyond what a checksum shows: where, what, and what is said of it.
CHANGES = {
    "observer": [
        ("axis.of.mass", -2.0, "mass must be more than zero"),
        # another machine, gains as before
        ("axis.of.mass", 0.02, "changed: .*, or design again$"),
        ("dt", 0.0, "dt must be more than zero"), ("dt", 1.0, "changed: the gain condition fails"),
        # the same gains in the other form prove something else
        ("form", "prediction", "condition fails|does not decrease"),
        ("form", "filtered", "form must be one of"), ("method", "magic", "method must be one of"),
        ("decay", 1.5, "decay must lie above 0 and up to 1"),
        ("noise", -1e-6, "noise must be zero or more"),
        ("encoder_quantum", -1e-6, "encoder_quantum must be zero or more"),
        ("gamma", 1e-9, "changed: the gain condition fails"),
        ("node_gains.values.0", "NaN", "node_gains"), ("node_gains.dtype", ",", "damaged"),
        ("node_gains.values", [1.0, 2.0], "cannot reshape"),
        ("node_gains.values.2", 1e308, "damaged: .*overflow|changed"),
        ("state_scale.values.0", 0.0, "state_scale must be positive"),
        ("state_scale.values.0", 1e-320, "damaged: .*overflow"),
        ("lyapunov.values.0", -1.0, "changed: .*not positive definite"),
        ("uncertainty.items.1.1", -1.0, "graph.labels do not fit the classes"),
        ("performance.items.0", -1.0, "performance"),
        ("integral_modes.items", [0, 7], "integral_modes must be one of"),
        ("graph.fields.labels.items.0", 9, "graph.labels"),
        ("graph.fields.edges.items.0.items", [0, 99], "graph does not fit"),
        ("window", 1.5, "window must be a whole number"),
        # sound each, and not what was designed: another machine, another promise
        ("axis.of.coulomb.plus", [80.0], "checksum does not fit"),
        ("axis.of.stick_speed", 3e-4, "checksum does not fit"),
        ("noise", 0.0, "checksum does not fit|fails"),
        ("graph.fields.edges.items", LONE, "checksum does not fit"),
    ],
    "compensation": [
        ("design.fields.kp", -1.0, "kp"), ("design.fields.kp", 26000.0, "numbers"),
        ("design.fields.law", "magic", "law"), ("design.fields.law", "pid", "observer"),
        ("design.fields.mismatch", 1.5, "mismatch"), ("design.fields.dt", 2e-3, "dt"),
        ("design.fields.lead", 1.5, "lead"), ("design.fields.axis", {}, "damaged"),
        ("tube", 1e-6, "tube"),
    ],
}  # fmt: skip


@pytest.mark.parametrize(("kind", "row"), [(k, row) for k, rows in CHANGES.items() for row in rows])
def test_changed_numbers_are_refused_by_what_they_say(tmp_path, kind, row):
    (place, value, words), path = row, tmp_path / "changed.json"
    made(kind).save(path)
    data = json.loads(path.read_text())
    part = data["content"]["fields"]
    *way, last = [int(key) if key.isdigit() else key for key in place.split(".")]
    for key in way:
        part = part[key]
    part[last] = value
    path.write_text(json.dumps(data))
    load = dfc.ObserverDesign.load if kind == "observer" else dfc.load_compensation
    with pytest.raises(ValueError, match=words) as caught:
        load(path)
    assert "changed.json" in str(caught.value)


def test_a_sealed_file_that_makes_no_sense_is_refused(tmp_path):
    for content in ({"is": "Fit", "fields": {}}, {"is": "os.system"}, {"no": 1}, [1], 3, "x",
                    {"is": "axis", "of": {"mass": -1}}, {"is": "array", "dtype": "O", "shape": [1],
                                                          "values": [None]}):  # fmt: skip
        write_document(tmp_path / "fit.json", "fit", {"content": content})
        with pytest.raises(ValueError, match="is damaged"):
            dfc.Fit.load(tmp_path / "fit.json")


@dataclasses.dataclass(frozen=True)
class Thing(Saved):
    """Anything that a file may hold."""

    value: Any
    _kind = "thing"
    _holds = (Gain,)


def test_what_the_file_cannot_hold_is_named(tmp_path):
    with pytest.raises(ValueError, match="a complex cannot be saved"):
        Thing((1j,)).save(tmp_path / "a.json")
    assert not (tmp_path / "a.json").exists()
    Thing(Gain(1.0, np.inf, np.nan, (0.0, -0.0), "m")).save(tmp_path / "g.json")
    again = Thing.load(tmp_path / "g.json")
    assert repr(again.value) == repr(Gain(1.0, np.inf, np.nan, (0.0, -0.0), "m"))
    assert json.loads((tmp_path / "g.json").read_text())["format"] == "dryfric-control thing"


DATA = {"b": [0.1, 1e-300, (1, 2)], "a": {"x": "µm", "none": None}}


@pytest.fixture
def document(tmp_path):
    write_document(tmp_path / "thing.json", "thing", DATA)
    return tmp_path / "thing.json"


def test_order_and_white_space_are_free(document):
    whole = json.loads(document.read_text())
    document.write_text(json.dumps(dict(reversed(whole.items()))))
    data, intact = read_document(document, "thing")
    assert intact and "checksum" not in data
    assert {key: data[key] for key in DATA} == json.loads(json.dumps(DATA))


@pytest.mark.parametrize(
    "edit",
    [lambda d: d["b"].__setitem__(0, 0.1000001), lambda d: d["a"].pop("none"),
     lambda d: d.update(more=1), lambda d: d.pop("checksum"), lambda d: d.update(checksum="0" * 64)],
)  # fmt: skip
def test_an_edit_shows(document, edit):
    data = json.loads(document.read_text())
    edit(data)
    document.write_text(json.dumps(data))
    assert not read_document(document, "thing")[1]


def test_another_kind_or_version_is_refused(document, monkeypatch):
    with pytest.raises(ValueError, match="is no other: it has format = 'dryfric-control thing'"):
        read_document(document, "other")
    monkeypatch.setattr(saved, "VERSION", 2)
    with pytest.raises(ValueError, match="version 1, .*reads 2"):
        read_document(document, "thing")


def test_an_older_version_is_brought_up_step_by_step(document, monkeypatch):
    monkeypatch.setattr(saved, "VERSION", 3)
    monkeypatch.setitem(saved.MIGRATIONS, 1, lambda kind, data: data | {"a": kind})
    monkeypatch.setitem(saved.MIGRATIONS, 2, lambda kind, data: data | {"b": data["a"] + "s"})
    data, intact = read_document(document, "thing")
    assert intact and (data["a"], data["b"]) == ("thing", "things")
