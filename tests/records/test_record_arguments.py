"""What a call lacks or misnames around a record is told with what to type."""

import inspect
import operator
import pickle
from pathlib import Path

import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control.model.effects.effect import REGISTRY

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


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: dfc.diagnose(AXIS, RECORD, fixed=("mass",)), "diagnose has no .* give known="),
        (lambda: dfc.diagnose(AXIS, "m.csv", units={"x": "mm"}), r"read_record\(.*units=...\)"),
        (lambda: dfc.axis_from("m.csv", gain=-1), r'dfc.read_record\("run.csv", gain=...\)'),
        (lambda: dfc.Stribeck(excess=0.3, velocity=0.01), "Stribeck has no .* give speed="),
        (lambda: dfc.effects.Cogging(amplitude=1.0, pitch=0.01), "Cogging has no .* give period="),
        (lambda: dfc.Record(t=T, u=T, y=T), "Record has no .* give x="),
        (lambda: dfc.Record(dt=1e-3, u=T, x=T), r"give t=, .* dt \* numpy.arange\(len\(x\)\)"),
        (lambda: AXIS.simulate(T, T=1e-3), "FrictionAxis.simulate has no .* give dt="),
        (lambda: RECORD.force_map(hlod="zero"), "Did you mean 'hold'"),
        (lambda: dfc.fit(AXIS, RECORD, free=("mas",)), "Did you mean 'mass'.*choose from"),
        (lambda: dfc.fit(AXIS, RECORD, known=("masse",)), "Did you mean 'mass'.*choose from"),
        (lambda: dfc.datasets.belt(), "Did you mean 'belt_stage'"),
        (lambda: dfc.diagnos, "Did you mean 'diagnose'"),
    ],
)  # fmt: skip
def test_a_wrong_name_is_told_the_right_one(call, words):
    with pytest.raises((TypeError, ValueError, AttributeError), match=words):
        call()


def test_every_public_callable_tells_the_right_argument_and_keeps_its_signature():
    effects = [f"effects.{cls.__name__}" for cls in REGISTRY.values()]
    for name in (*dfc.__all__, *effects):
        one = operator.attrgetter(name)(dfc)
        made = inspect.isclass(one) and "__init__" in vars(one) and not issubclass(one, Exception)
        if not (made or inspect.isfunction(one)):
            continue
        kinds = {parameter.kind for parameter in inspect.signature(one).parameters.values()}
        if inspect.Parameter.VAR_KEYWORD in kinds:
            continue  # its rows are in the table of bad input
        with pytest.raises(TypeError, match="has no argument 'qqqq'.*, it has .|'qqqq'. Did you"):
            one(qqqq=1)
    assert pickle.loads(pickle.dumps(dfc.fit)) is dfc.fit
    assert dfc.load_diagnosis == dfc.Diagnosis.load
