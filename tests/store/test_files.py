"""Files: written whole or not at all, refused when damaged or newer, never executed."""

import json
import os
import signal
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import damage
import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

import dryfric_control as dfc
from dryfric_control.diagnosis import Experiment
from dryfric_control.diagnosis.report import diagnosis as report
from dryfric_control.diagnosis.report.findings import Gain, Unexplained
from dryfric_control.store import files

AXIS = dfc.FrictionAxis(
    mass=2.0, viscous=15.0, coulomb=8.0, travel=(0.0, 0.3), effects=(dfc.effects.Spring(40.0),)
)
RECORD = dfc.Record(damage.T, damage.U, damage.X, damage.REFERENCE, quantum=1e-6)
DESIGN = dfc.design_pi_observer(AXIS, dt=1e-3, encoder_quantum=1e-6)
DIAGNOSIS = dfc.Diagnosis(
    AXIS, RECORD, "nothing to find", (), AXIS, Gain(1e-6, 1e-6, 1e-6, (0.9, 1.1), "m"),
    Unexplained(0.0, False, ()), None, (), {}, 0.25, np.zeros(3, np.int64),
)  # fmt: skip
PLAN = Experiment(
    name="steps", title="steps", description="step it", t=damage.T, reference=damage.REFERENCE,
    score={}, tried={}, cause="coulomb", units=("m", "N"),
)  # fmt: skip
RAMP = dfc.slow_ramp_experiment(AXIS, duration=5.0)

WRITERS = {
    "Record.to_csv": ("run.csv", RECORD.to_csv),
    "write_axis": ("axis.toml", lambda path: dfc.write_axis(AXIS, path)),
    "ObserverDesign.save": ("observer.json", DESIGN.save),
    "Diagnosis.to_json": ("diagnosis.json", DIAGNOSIS.to_json),
    "Diagnosis.to_html": ("report.html", DIAGNOSIS.to_html),
    "Experiment.to_csv": ("plan.csv", PLAN.to_csv),
    "SlowRamp.to_csv": ("ramp.csv", RAMP.to_csv),
}


@pytest.mark.parametrize("writer", WRITERS)
@pytest.mark.parametrize("old", [b"what was there before", None])
def test_a_full_disk_leaves_the_old_file(tmp_path, monkeypatch, writer, old):
    resource = pytest.importorskip("resource")
    monkeypatch.setattr(report, "html_page", lambda _: "<p>its drawings take seconds</p>")
    name, write = WRITERS[writer]
    path = tmp_path / name
    if old is not None:
        path.write_bytes(old)
    # After a few bytes; instead of the usual signal, the write fails with an error.
    kept = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (5, limits[1]))
        with pytest.raises(OSError):
            write(path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, kept)
    assert [p.name for p in tmp_path.iterdir()] == ([name] if old is not None else [])
    assert old is None or path.read_bytes() == old
    write(path)
    assert path.stat().st_size > 5 and path.read_bytes() != old


@pytest.mark.slow
def test_a_killed_process_leaves_the_old_file(tmp_path):
    path = tmp_path / "observer.json"
    path.write_bytes(b"old")
    source = Path(files.__file__)
    code = f"""
import importlib.util, os, signal
spec = importlib.util.spec_from_file_location("files", {str(source)!r})
files = importlib.util.module_from_spec(spec)
spec.loader.exec_module(files)
with files.replace_file({str(path)!r}) as part:
    with part.open("w") as file:
        file.write("half of the new")
        file.flush()
        os.kill(os.getpid(), signal.SIGKILL)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=60)
    assert done.returncode == -signal.SIGKILL
    assert path.read_bytes() == b"old"
    # what is left over does not look like the file
    assert {p.suffix for p in tmp_path.iterdir() if p != path} == {".part"}


def test_an_axis_cut_off_anywhere_is_refused_or_sound(tmp_path):
    """Cut between two lines a TOML file is whole: it must lack something then, or be an axis."""
    path = tmp_path / "axis.toml"
    dfc.write_axis(AXIS, path)
    whole = path.read_bytes()
    taken = 0
    for place in range(len(whole)):
        path.write_bytes(whole[:place])
        try:
            found = dfc.read_axis(path)
        except ValueError as problem:
            assert "axis.toml" in str(problem)
        else:
            taken += 1
            # never another value than the one written: a number cut short is another number
            assert (found.mass, found.viscous, found.coulomb) == (2.0, 15.0, AXIS.coulomb)
    assert taken < 0.6 * len(whole)


_WATCH: list[str] | None = None
_FORBIDDEN = {
    "exec", "compile", "os.system", "os.exec", "os.posix_spawn", "os.fork", "subprocess.Popen",
    "pickle.find_class", "marshal.loads", "ctypes.dlopen", "socket.connect", "import",
}  # fmt: skip


def _hear(event: str, arguments: tuple[Any, ...]) -> None:
    if _WATCH is not None and event in _FORBIDDEN:
        _WATCH.append(f"{event}: {str(arguments)[:80]}")


sys.addaudithook(_hear)


def heard(call: Any) -> list[str]:
    """Events of the interpreter while a call runs that no reader needs."""
    global _WATCH
    _WATCH = []
    try:
        call()
    finally:
        events, _WATCH = _WATCH, None
    return events


def test_the_watch_hears():
    assert heard(lambda: eval("1 + 1"))
    assert not heard(lambda: 1 + 1)


_MARK = "__import__('os').system('touch executed')"
_TRAPS = {
    "record.csv": f"# {_MARK}\nt,u,x\n" + "".join(f"{k},{_MARK},{k}\n" for k in range(12)),
    "sheet.csv": "t,u,x\n" + "".join(f"{k},=cmd|' /C touch executed'!A0,{k}\n" for k in range(12)),
    "pickle.csv": b"cos\nsystem\n(S'touch executed'\ntR.",
    "axis.toml": f'mass = "{_MARK}"\nviscous = 15.0\ncoulomb = 8.0\n',
    "effect.toml": 'mass = 2.0\nviscous = 15.0\ncoulomb = 8.0\n[[effects]]\neffect = "__class__"\n',
    "observer.json": json.dumps({"format": "dryfric-control observer design", "version": 2,
                                 "axis": {"mass": 2.0, "viscous": 15.0, "coulomb": 8.0,
                                          "effects": [{"effect": _MARK}]}}),
    "log.json": json.dumps({"entries": [{"timestamp": _MARK}]}),
    "run.mat": b"cos\nsystem\n(S'touch executed'\ntR." + bytes(200),
}  # fmt: skip


@pytest.mark.parametrize("name", _TRAPS)
def test_nothing_in_a_file_is_executed(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    text = _TRAPS[name]
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    read = {"toml": dfc.read_axis, "csv": dfc.read_record, "mat": dfc.read_record}.get(
        path.suffix[1:], dfc.read_bam if name == "log.json" else dfc.ObserverDesign.load
    )

    def attempt() -> None:
        with pytest.raises(ValueError):
            read(path)

    attempt()  # imports what it needs
    assert heard(attempt) == []
    assert not (tmp_path / "executed").exists()


@pytest.fixture(scope="module")
def sound_files(tmp_path_factory):
    return damage.sound_files(tmp_path_factory.mktemp("sound"))


@pytest.mark.slow
@pytest.mark.parametrize("kind", damage.READERS)
def test_damaged_files_are_refused_or_read_soundly(kind, sound_files, tmp_path):
    """Always the same files; DAMAGED_FILES=100000 and --hypothesis-seed=1 try many others."""
    if kind not in sound_files:
        pytest.skip(f"the library that reads {kind} is not installed")
    sound, folder = sound_files[kind], tmp_path
    count = int(os.environ.get("DAMAGED_FILES", 100))
    assert [damage.verdict(kind, content, folder) for content in sound] == ["taken"] * len(sound)

    @settings(
        max_examples=count, phases=[Phase.generate], suppress_health_check=list(HealthCheck),
        derandomize=count == 100,
    )  # fmt: skip
    @given(st.sampled_from(sound), damage.damages)
    def one(content, changes):  # type: ignore[no-untyped-def]
        broken = damage.damaged(content, changes)
        assert damage.verdict(kind, broken, folder) in ("taken", "refused")

    with warnings.catch_warnings(action="ignore"):
        one()
