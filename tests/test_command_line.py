"""``python -m dryfric_control diagnose`` reads a file as its options say."""

import importlib
from types import SimpleNamespace

import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control.__main__ import main
from dryfric_control._version import __version__
from dryfric_control.records.scaling import read_sampling
from dryfric_control.store.axis_file import axis_text

AXIS = "mass = 2.0\nviscous = 15.0\ncoulomb = 8.0\n"
ROOM = "dryfric_control.__main__"


def test_export_writes_c_of_what_was_saved(tmp_path, capsys):
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, name="stage")
    dfc.write_axis(axis, tmp_path / "stage.toml")
    dfc.design_pi_observer(axis, dt=1e-3).save(tmp_path / "observer.json")
    # The second keeps the README of the first.
    for file, name, about in (
        ("stage.toml", "stage", "README.md"),
        ("observer.json", "stage_observer", "README_stage_observer.md"),
    ):
        out = str(tmp_path / "out")
        assert main(["export", str(tmp_path / file), "--to", "c", "--out", out]) == 0
        assert f"{name}.h, {name}.c, {name}.json, {about} in" in capsys.readouterr().out
        assert (tmp_path / "out" / f"{name}.c").stat().st_size > 1000


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Writes a CSV, runs the command up to the diagnosis, and gives the record that it got."""
    seen = []

    def no_diagnosis(axis, record, **_):
        seen.append(record)
        raise ValueError("that will do")

    monkeypatch.setattr(importlib.import_module(ROOM), "diagnose", no_diagnosis)
    (tmp_path / "axis.toml").write_text(AXIS)

    def command(text, *options):
        (tmp_path / "run.csv").write_text(text, encoding="utf-8")
        files = [str(tmp_path / "run.csv"), "--axis", str(tmp_path / "axis.toml")]
        assert main(["diagnose", *files, "--out", str(tmp_path / "out"), *options]) == 2
        return seen.pop() if seen else None

    return command


def table(heading, columns):
    rows = (";".join(f"{v:.6f}" for v in row) for row in zip(*columns, strict=True))
    return "\n".join([heading, *rows])


T = 1e-3 * np.arange(200)
X = 0.01 * np.sin(20.0 * T)


def test_columns_units_gain_and_dt(run, capsys):
    text = table("a;b;c;d", (1e3 * T, 3.0 * X, 1e3 * X, T))
    assert run(text) is None
    assert "Say which they are: --columns t=...,u=...,x=..." in capsys.readouterr().err
    record = run(text, "--columns", "t=a,u=b,x=c", "--units", "t=ms, x=mm", "--gain", "2.5")
    np.testing.assert_allclose(record.x, X, atol=1e-9)
    np.testing.assert_allclose(record.u, 7.5 * X, atol=1e-5)
    shaken = 1e3 * (T + 1e-4 * np.sin(T * 1e3))
    assert run(table("t [ms];u;x", (shaken, X, X)), "--dt", "0.001").dt == 1e-3


def test_gains_and_numbers_of_the_machine(run, tmp_path):
    counts = np.round(1e5 * X)
    text = table("t;u [%];x [counts]", (T, 100.0 * X, counts))
    record = run(text, "--counts-per-turn", "4096", "--lead", "5e-3", "--rated-force", "200")
    np.testing.assert_allclose(record.x, counts / 4096 * 5e-3)
    np.testing.assert_allclose(record.u, 200.0 * X, atol=1e-6)
    record = run(text, "--gain", "u=2,x=1e-6", "--units", "x=m, u=N")
    np.testing.assert_allclose(record.x, 1e-6 * counts)
    np.testing.assert_allclose(record.u, 200.0 * X, atol=1e-6)
    numbers = "[record]\ncounts_per_turn = 4096\nlead = 5e-3\nrated_force = 100.0\n"
    (tmp_path / "axis.toml").write_text(AXIS + numbers)
    np.testing.assert_allclose(run(text).u, 100.0 * X, atol=1e-6)
    np.testing.assert_allclose(run(text, "--rated-force", "200").u, 200.0 * X, atol=1e-6)


@pytest.mark.parametrize(
    "command", ["demo", "diagnose", "joints", "arm", "export", "simulator", ""]
)
def test_help_and_version_can_be_printed(command, capsys):
    with pytest.raises(SystemExit) as end:
        main([command, "--help"] if command else ["--version"])
    assert end.value.code == 0
    assert ("--out " if command else __version__) in capsys.readouterr().out


def test_the_axis_file_says_how_records_are_sampled(run, tmp_path):
    there = np.delete(np.arange(200), np.arange(50, 60))
    text = table("t;u;x", (T[there], X[there], X[there]))
    file = tmp_path / "axis.toml"
    file.write_text(AXIS + "[record]\ndt = 1e-3\nmax_gap = 0.02\nlead = 5e-3\n")
    assert run(text).bad["filled"] == 10
    assert run(text, "--dt", "0.002").dt == 0.002  # the gap allowed by the file still is
    assert run(table("u;x", (X, X)), "--rate", "500").dt == 0.002  # no dt, which it excludes
    file.write_text(AXIS + "[record]\nrate = 250\n")
    assert run(table("u;x", (X, X))).dt == 0.004
    assert run(text, "--dt", "0.001", "--max-gap", "0.02").dt == 0.001


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (AXIS + "[record]\ndt = 0.0\n", "axis.toml: record.dt must be more than zero"),
        (AXIS + '[record]\nmax_gap = "5 ms"\n', "axis.toml: record.max_gap must be a number"),
        (AXIS + "[record]\nmax_gpa = 0.02\n", "record.max_gpa is not known. Did you mean 'max_gap'?"),
        ("mass = 2.0\ninertia = 0.02\nviscous = 0.1\ncoulomb = 0.5\n", "are the same argument"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_an_axis_file_is_told(run, tmp_path, capsys, text, words):
    (tmp_path / "axis.toml").write_text(text)
    assert run(table("t;u;x", (T, X, X))) is None
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("", "required: {demo,diagnose,joints,arm,export,simulator}"),
        ("diagnose a.csv --axis a --windows 3", "known. Did you mean '--window'?"),
        ("diagnose a.csv --axis a --window abc", "'abc'"),
        ("export a.toml --to c --tol 3", "export: --tol 3 is not known"),
        ("diagnose a.csv --axis a --tolerance mass", "'mass' must be such as visc"),
        ("diagnose a.csv --axis a --tolerance mass=x", "such as viscous=0.5"),
        ("diagnose a.csv --axis a --columns force", "'force' must be such as u=force"),
        ("diagnose a.csv --axis a --gain u=two", "--gain"),
    ],
)
def test_what_cannot_be_parsed_is_told_in_one_line(command, words, capsys):
    with pytest.raises(SystemExit) as ended:
        main(command.split())
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line and "--help" in line


@pytest.mark.parametrize(
    ("file", "options", "words"),
    [
        ("axis.toml", "--to c --version 2.0", "--version 2.0 is for --to fmu: leave it out"),
        ("axis.toml", "--to fmu --precision single", "--precision single is for --to c: leave it"),
        ("axis.toml", "--to c --name a+b", "give --name"),
        ("other.json", "--to c", "can not be exported: give an axis"),
    ],
)
def test_an_export_that_makes_no_sense_is_refused(tmp_path, capsys, file, options, words):
    (tmp_path / "axis.toml").write_text(AXIS)
    (tmp_path / "other.json").write_text("[1]")
    out = tmp_path / "out"
    assert main(["export", str(tmp_path / file), "--out", str(out), *options.split()]) == 2
    assert words in capsys.readouterr().err and not out.exists()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (table("u;x", (X, X)), "Without a column of time give --rate [samples per s]."),
        ("t [s],u [N],x [m]\n", "run.csv holds a heading and no data rows"),
        (table("t;u;x", (T[:5], X[:5], X[:5])), "run.csv: 5 samples are too few"),
        (table("t;u;x", (T, X, np.where(T % 0.01 < 0.005, np.nan, X))), "gap of 0.007 s"),
        (table("t;u;x", (T, X, X)).replace(";0.000200;", ";;", 1), "empty; give --dt"),
        (table("t;u1;u2;x1;x2", (T, X, X, X, X)), "say which: --columns u=..."),
        (table("t;u;x [counts]", (T, X, np.round(1e5 * X))), "run.csv: x is in 'counts', the axis has 'm'"),
        ("t,u,x\n0,1,2\n0.001,abc,2\n", "row 3"),
        (table("t;u [N m];x [rad]", (T, X, X)), 'with units = ["rad", "N m"] in its file'),
        (table("t;u [N];x [rad]", (T, X, X)), "--gain x=... [m per rad] and --units x=m"),
    ],
)  # fmt: skip
def test_a_file_that_cannot_be_used_is_told_by_name_and_option(run, capsys, text, words):
    assert run(text) is None
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line


def test_a_warning_is_one_line_that_names_options(run, capsys):
    run(table("t;u;x", (1e3 * T, X, X)))
    lines = capsys.readouterr().err.splitlines()
    words = "warning: dt = 1 s: time suspected in milliseconds; then give --units t=ms"
    assert lines[0].endswith(words)
    assert all(line.startswith("python -m dryfric_control: ") for line in lines)


def test_the_extended_axis_reads_records_as_the_nominal_one_did(tmp_path, monkeypatch):
    room, kept = importlib.import_module(ROOM), []
    found = SimpleNamespace(summary=lambda: "verdict: explained")
    monkeypatch.setattr(room, "diagnose", lambda *_, **__: found)
    monkeypatch.setattr(room, "write_report", lambda found, folder, record: kept.append(record))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "axis.toml").write_text(AXIS + "[record]\nlead = 5e-3\nmax_gap = 0.02\n")
    (tmp_path / "run.csv").write_text(table("t;u;x [counts]", (T, X, np.round(1e5 * X))))
    options = "--counts-per-turn 4096 --load-encoder --gain 2 --dt 0.001 --out out"
    assert main(["diagnose", "run.csv", "--axis", "axis.toml", *options.split()]) == 0
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, effects=dfc.effects.Spring(40.0))
    file = tmp_path / "extended.toml"
    file.write_text(axis_text(axis, kept[0]))
    assert dfc.read_axis(file) == axis
    assert dfc.Scaling.from_file(file) == dfc.Scaling(
        gain={"u": 2.0}, counts_per_turn=4096, lead=5e-3, load_encoder=True
    )
    assert read_sampling(file) == {"dt": 1e-3, "max_gap": 0.02}


def test_arguments_are_refused_before_a_record_is_read(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "axis.toml").write_text(AXIS)
    for option, words in (
        ("--window -1", "window must be more than zero [s], got -1.0"),
        ("--time-limit 0", "time_limit must be more than zero [s], got 0.0"),
        ("--known gravity", "known: 'gravity' is no base parameter"),
        ("--axis axsi.toml", "Did you mean 'axis.toml'?"),
    ):
        assert main(["diagnose", "nowhere.csv", "--axis", "axis.toml", *option.split()]) == 2
        assert words in capsys.readouterr().err


def test_a_diagnosis_without_an_axis_begins_with_that_of_the_record(tmp_path, monkeypatch, capsys):
    seen = []

    def no_diagnosis(axis, record, **_):
        seen.append(axis)
        raise ValueError("that will do")

    monkeypatch.setattr(importlib.import_module(ROOM), "diagnose", no_diagnosis)
    record = dfc.datasets.belt_stage()
    record.to_csv(tmp_path / "run.csv")
    assert main(["diagnose", str(tmp_path / "run.csv"), "--out", str(tmp_path / "out")]) == 2
    assert seen == [dfc.axis_from(record).replace(name=seen[0].name)]
    assert "no --axis: that of the record" in capsys.readouterr().out


@pytest.mark.filterwarnings("always")
def test_a_wrong_sign_stops_the_command_unless_told_to_go_on(tmp_path, monkeypatch, capsys):
    t = 1e-3 * np.arange(4000)
    u = 20.0 * np.sin(6.0 * t)
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    dfc.Record(t, -u, axis.simulate(u, dt=1e-3).y[0]).to_csv(tmp_path / "run.csv")
    (tmp_path / "axis.toml").write_text(AXIS)
    monkeypatch.chdir(tmp_path)
    command = ["diagnose", "run.csv", "--axis", "axis.toml"]
    assert main(command) == 2
    said = capsys.readouterr().err
    assert "wrong sign. --gain -1 turns the drive, --gain x=-1.0 the position; --anyway go" in said
    # The rest of the work is not done here: only what the search is given is looked at.
    room = importlib.import_module("dryfric_control.diagnosis.diagnose")

    def no_search(*_, **__):
        raise ValueError("that will do")

    monkeypatch.setattr(room, "_search_and_judge", no_search)
    for options in (["--anyway"], ["--gain", "-1"]):
        assert main([*command, *options]) == 2
        said = capsys.readouterr().err
        assert said.splitlines()[-1].endswith("that will do")
        assert ("takes energy out" in said) == (options == ["--anyway"])


def test_an_interrupt_is_one_line_and_status_130(monkeypatch, capsys, tmp_path):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    (tmp_path / "taken").write_text("")
    assert main(["demo", "--out", str(tmp_path / "taken")]) == 2
    assert "is a file: name a folder" in capsys.readouterr().err
    monkeypatch.setattr("dryfric_control.demo.run", interrupted)
    assert main(["demo", "--out", str(tmp_path)]) == 130
    told = capsys.readouterr()
    assert told.out == "" and told.err.splitlines() == [told.err.strip()]
    assert told.err.endswith("interrupted\n")
