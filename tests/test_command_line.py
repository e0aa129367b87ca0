"""``python -m dryfric_control diagnose`` reads a file as its options say."""

import sys

import numpy as np
import pytest

from dryfric_control.__main__ import main

AXIS = "mass = 2.0\nviscous = 15.0\ncoulomb = 8.0\n"


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Writes a CSV, runs the command up to the diagnosis, and gives the record that it got."""
    seen = []

    def no_diagnosis(axis, record, **_):
        seen.append(record)
        raise ValueError("that will do")

    import dryfric_control.diagnosis.diagnose  # noqa: F401

    room = sys.modules["dryfric_control.diagnosis.diagnose"]
    monkeypatch.setattr(room, "diagnose", no_diagnosis)
    (tmp_path / "axis.toml").write_text(AXIS)

    def command(text, *options):
        (tmp_path / "run.csv").write_text(text, encoding="utf-8")
        files = [str(tmp_path / "run.csv"), "--axis", str(tmp_path / "axis.toml")]
        assert main(["diagnose", *files, "--out", str(tmp_path / "out"), *options]) == 2
        return seen.pop() if seen else None

    return command


def table(heading, columns, comma="."):
    rows = (
        ";".join(f"{v:.6f}".replace(".", comma) for v in row) for row in zip(*columns, strict=True)
    )
    return "\n".join([heading, *rows])


T = 1e-3 * np.arange(200)
X = 0.01 * np.sin(20.0 * T)


def test_a_german_controller_log_is_read_as_it_is(run):
    record = run(table("# Achse 7\nZeit [ms];Kraft [N];Weg [mm]", (1e3 * T, 3.0 * X, 1e3 * X), ","))
    np.testing.assert_allclose(record.x, X, atol=1e-9)  # six digits of millimetres
    np.testing.assert_allclose(record.u, 3.0 * X, atol=1e-6)
    assert record.dt == pytest.approx(1e-3)


def test_columns_units_gain_and_dt(run, capsys):
    text = table("a;b;c;d", (1e3 * T, 3.0 * X, 1e3 * X, T))
    assert run(text) is None
    assert "Say which it is: --columns t=..." in capsys.readouterr().err
    record = run(text, "--columns", "t=a,u=b,x=c", "--units", "t=ms, x=mm", "--gain", "2.5")
    np.testing.assert_allclose(record.x, X, atol=1e-9)
    np.testing.assert_allclose(record.u, 7.5 * X, atol=1e-5)
    shaken = 1e3 * (T + 1e-4 * np.sin(T * 1e3))
    assert run(table("t [ms];u;x", (shaken, X, X)), "--dt", "0.001").dt == 1e-3


def test_a_pair_without_a_mark_is_refused(run, capsys):
    with pytest.raises(SystemExit):
        run("", "--columns", "force")
    assert "'force' must be such as u=force" in capsys.readouterr().err


def test_a_missing_axis_file_is_told_with_a_guess(tmp_path, capsys):
    (tmp_path / "axis.toml").write_text(AXIS)
    assert main(["diagnose", "run.csv", "--axis", str(tmp_path / "axsi.toml")]) == 2
    assert "Did you mean 'axis.toml'?" in capsys.readouterr().err
