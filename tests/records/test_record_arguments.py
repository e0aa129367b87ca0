"""What a call lacks or misnames around a record is told with what to type."""

import inspect
from pathlib import Path

import numpy as np
import pytest

import dryfric_control as dfc

T = 1e-3 * np.arange(200)
RECORD = dfc.Record(T, np.sin(9.0 * T), T)
AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)


@pytest.mark.parametrize("name", ["diagnose", "fit", "replay"])
@pytest.mark.parametrize(
    ("alone", "words"),
    [
        ("run.csv", r"dfc.{}\(dfc.axis_from\('run.csv'\), 'run.csv'\)"),
        (Path("run.csv"), r"dfc.{}\(dfc.axis_from\('run.csv'\), 'run.csv'\)"),
        (RECORD, r"dfc.{}\(dfc.axis_from\(record\), record\)"),
        (["a.csv", "b.csv"], r"dfc.{}\(dfc.axis_from\(record\[0\]\), record\)"),
        (AXIS, r'lacks the record: dfc.{}\(axis, "run.csv"\)'),
    ],
)
def test_an_axis_or_a_record_alone_is_told_what_to_type(name, alone, words):
    call = getattr(dfc, name)
    with pytest.raises(TypeError, match=rf"^{name}\(axis, record\) .*{words.format(name)}"):
        call(alone)
    with pytest.raises(ValueError, match=r"comes first; dfc.axis_from\(record\)"):
        call("run.csv", AXIS)
    assert list(inspect.signature(call).parameters)[:2] == ["axis", "record"]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("unit", 'give units={"x": "mm"}'), ("scale", 'give gain={"u": 35.0}'),
        ("cols", 'columns={"t": "time"'), ("force", r"arrays make dfc.Record\(t, u, x\)"),
        ("fs", "rate=1000.0"), ("Ts", "dt=1e-3"), ("sep", "whose layout is recognised"),
        ("lead", r"gain=dfc.Scaling\(lead=...\)"), ("joints", "Did you mean 'joint'"),
        ("qqqq", "it has source, columns, gain"),
    ],
)  # fmt: skip
def test_an_argument_of_a_reader_by_another_name_is_told_the_right_one(name, words):
    with pytest.raises(TypeError, match=f"^read_record has no argument '{name}'.*{words}"):
        dfc.read_record("run.csv", **{name: 1.0})
