"""Many cases: kept as they finish, the same however they are run."""

import functools
import json
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import joblib
import numpy as np
import pytest
from diagnosis_cases import among, driven

import dryfric_control as dfc
from dryfric_control import presets
from dryfric_control.store.batch import fingerprint

RUNS = 6
CASES = {"a": 4.0, "b": 9.0, "c": 16.0}
ROOTS = {"a": 2.0, "b": 3.0, "c": 4.0}


class Counted:
    """A function that knows which values it was called with."""

    def __init__(self, function=math.sqrt):
        self.function, self.seen = function, []

    def __call__(self, value):
        self.seen.append(value)
        return self.function(value)


def lines(path):
    return path.read_bytes().split(b"\n")[:-1]


def test_what_is_stored_is_not_run_again(tmp_path):
    store, function = tmp_path / "roots.jsonl", Counted()
    first = dfc.run_batch(function, {"b": 9.0}, store=store, progress=False)
    every = dfc.run_batch(function, CASES, store=store, progress=False)
    assert first == {"b": 3.0}
    assert every == ROOTS and list(every) == ["a", "b", "c"]
    assert function.seen == [9.0, 4.0, 16.0]
    before = store.read_bytes()
    assert dfc.run_batch(function, CASES, store=store, progress=False) == ROOTS
    assert len(function.seen) == 3 and store.read_bytes() == before


def test_the_store_is_plain_lines_of_json(tmp_path):
    store = tmp_path / "roots.jsonl"
    dfc.run_batch(math.sqrt, {("a", 1): 4.0}, store=store, settings={"unit": "m"}, progress=False)
    heading, entry = (json.loads(line) for line in lines(store))
    assert heading == {"store": "dryfric-control batch 1", "settings": {"unit": "m"}}
    assert entry == {"case": ["a", 1], "result": 2.0}
    assert [path.name for path in tmp_path.iterdir()] == ["roots.jsonl"]


@pytest.mark.parametrize("kept", ["", "store"])
def test_results_come_back_as_json_gives_them(tmp_path, kept):
    value = {"x": (0.1, -0.0, 1e-308, math.inf), "n": None, "text": "µ\n"}
    store = tmp_path / kept if kept else None
    for _ in range(2):
        found = dfc.run_batch(dict, {1: value}, store=store, progress=False)
        assert found == {1: value | {"x": [0.1, -0.0, 1e-308, math.inf]}}
        assert math.copysign(1.0, found[1]["x"][1]) == -1.0


def test_every_place_where_a_write_may_be_cut(tmp_path):
    """A last line that was cut is run again; what stands before it is kept."""
    store = tmp_path / "roots.jsonl"
    dfc.run_batch(math.sqrt, CASES, store=store, progress=False)
    raw = store.read_bytes()
    ends = [i + 1 for i, byte in enumerate(raw) if byte == ord("\n")]
    for size in range(ends[0], len(raw)):
        store.write_bytes(raw[:size])
        function = Counted()
        assert dfc.run_batch(function, CASES, store=store, progress=False) == ROOTS
        # One line of the whole ones is the heading.
        assert len(function.seen) == 3 - (sum(end <= size for end in ends) - 1)
        assert store.read_bytes() == raw


def test_a_case_that_fails_is_named_and_leaves_the_finished(tmp_path):
    store = tmp_path / "roots.jsonl"
    with pytest.raises(ValueError, match="math domain error|nonnegative") as caught:
        dfc.run_batch(math.sqrt, {"bad": -1.0, "good": 4.0}, store=store, progress=False)
    assert caught.value.__notes__ == ['in case "bad"']
    function = Counted()
    dfc.run_batch(function, {"good": 4.0}, store=store, progress=False)
    assert function.seen == []


def test_errors_are_returned_where_another_case_has_a_result():
    cases = {"bad": -1.0, "good": 4.0}
    found = dfc.run_batch(math.sqrt, cases, progress=False, failures="return")
    assert list(found) == ["bad", "good"] and found["good"] == 2.0
    assert isinstance(found["bad"], ValueError)
    with pytest.raises(ValueError, match="math domain error|nonnegative"):
        dfc.run_batch(math.sqrt, {"bad": -1.0}, progress=False, failures="return")
    with pytest.raises(ValueError, match="failures must be .*, got 'keep'"):
        dfc.run_batch(math.sqrt, cases, progress=False, failures="keep")


HEAD = b'{"store": "dryfric-control batch 1", "settings": '


@pytest.mark.parametrize(
    ("content", "words"),
    [
        *((content, "no store of a batch")
          for content in (b"", b"t,u,x\n0,0,0\n", HEAD[:30], b'{"store": "another"}\n')),
        (HEAD + b"3}\n", "m is 2.0 and was None"),
        (HEAD + b'{"m": 3.0}}\n', "m is 2.0 and was 3.0"),
        (HEAD + b'{"m": 2.0}}\n3\n', "damaged in line 2"),
        (HEAD + b'{"m": 2.0}}\n{"case": 1,\n{}', "damaged in line 2"),
    ],
)  # fmt: skip
def test_other_files_are_refused_and_left_alone(tmp_path, content, words):
    store, function = tmp_path / "store.jsonl", Counted()
    store.write_bytes(content)
    with pytest.raises(ValueError, match=f"store.jsonl .*{words}.*give another file"):
        dfc.run_batch(function, CASES, store=store, settings={"m": 2.0}, progress=False)
    assert store.read_bytes() == content and function.seen == []


def test_a_result_that_json_cannot_hold_is_told():
    with pytest.raises(ValueError, match='numbers, text, lists or dicts, got ndarray for case "a"'):
        dfc.run_batch(np.atleast_1d, {"a": 1.0}, progress=False)


def test_fingerprint_tells_values_apart_not_how_they_are_held():
    values = [0.0, -0.0, 1, "1", None, [1.0], [[1.0]], np.array([1.0]), np.array([[1.0]]),
              np.array([1.0], np.float32), {"a": 1.0}, dfc.Stribeck(0.3, 0.01),
              dfc.Stribeck(0.3, 0.02), dfc.effects.Spring(0.3, 0.01), {1}]  # fmt: skip
    assert len({fingerprint(value) for value in values}) == len(values)
    assert fingerprint((np.float64(1.0),)) == fingerprint([1.0])
    assert fingerprint(np.zeros((4, 4))[::2]) == fingerprint(np.zeros((2, 4)))
    assert fingerprint(dfc.effects.Spring(0.3, 0.01)) == fingerprint(dfc.effects.Spring(0.3, 0.01))
    # What is left out, and what is worked out, makes no difference.
    axes = [dfc.FrictionAxis(mass=1.0, viscous=0.0, coulomb=level) for level in (1.0, 2.0)]
    assert len({fingerprint(axis) for axis in axes}) == 2
    assert len({fingerprint([axis], without=(dfc.CoulombMap,)) for axis in axes}) == 1
    record = dfc.Record(1e-3 * np.arange(50), np.arange(50.0), np.arange(50.0) ** 2)
    before = fingerprint(record)
    record.derivatives()
    assert "quantum" in vars(record) and fingerprint(record) == before


@pytest.fixture(scope="module")
def design():
    return presets.clutch_observer()


@pytest.fixture(scope="module")
def plain(design):
    """Scores without a store, in this process."""
    found = scores(design)
    assert np.isfinite(found).all()
    return found


def scores(design, **options):
    options |= dict(runs=RUNS, duration=2.0, progress=False)
    return np.stack([*presets.clutch_monte_carlo(design, **options).scores.values()])


@pytest.mark.slow
def test_same_bits_with_and_without_store_in_any_number_of_jobs(design, plain, tmp_path):
    store = tmp_path / "runs.jsonl"
    for jobs in (2, 1):  # the second reads what the first has kept
        assert scores(design, store=store, jobs=jobs).tobytes() == plain.tobytes()
        assert len(lines(store)) == 1 + RUNS


WAITER = """
import os
import pathlib
import time


def wait(folder):
    pathlib.Path(folder, f"worker{os.getpid()}").write_text("")
    time.sleep(600.0)
"""
WAITING = """
import sys
import waiter
import dryfric_control as dfc
if __name__ == "__main__":
    dfc.run_batch(waiter.wait, dict.fromkeys(range(4), sys.argv[1]), jobs=2, progress=False)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="an orphan keeps the number of its parent")
def test_workers_end_with_a_run_that_is_killed(tmp_path):
    (tmp_path / "waiter.py").write_text(WAITER)
    path = [str(tmp_path), str(Path(dfc.__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    run = subprocess.Popen(
        [sys.executable, "-c", WAITING, str(tmp_path)], stderr=subprocess.DEVNULL,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(path)},
    )  # fmt: skip

    def workers():
        return [int(one.name[6:]) for one in tmp_path.glob("worker*")]

    def alive(worker):
        try:
            os.kill(worker, 0)
        except ProcessLookupError:
            return False
        # Dead, but not yet waited for by the process that takes orphans.
        status = Path(f"/proc/{worker}/stat")
        return not status.exists() or status.read_text().rpartition(")")[2].split()[0] != "Z"

    try:
        deadline = time.monotonic() + 300.0  # compiling, on a busy machine
        while len(workers()) < 2:
            assert run.poll() is None and time.monotonic() < deadline
            time.sleep(0.05)
        run.kill()
        run.wait()
        # Far less than the case would take, far more than a busy machine needs to look.
        deadline = time.monotonic() + 60.0
        while any(map(alive, workers())) and time.monotonic() < deadline:
            time.sleep(0.1)
        assert not any(map(alive, workers()))
    finally:
        run.kill()
        for worker in filter(alive, workers()):
            os.kill(worker, signal.SIGKILL)


def process_of(case):
    return os.getpid()


@pytest.mark.long
def test_the_same_call_on_a_dask_cluster(design, plain, tmp_path):
    distributed = pytest.importorskip("distributed", reason="dask[distributed] is not installed")
    store = tmp_path / "runs.jsonl"
    cluster = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, host="127.0.0.1",
        dashboard_address=None, local_directory=str(tmp_path),
    )  # fmt: skip
    with cluster, distributed.Client(cluster) as client:
        addresses = {worker["host"] for worker in client.scheduler_info()["workers"].values()}
        assert addresses == {"127.0.0.1"}
        before = client.run(os.getpid)
        with joblib.parallel_config(backend="dask"):
            on_cluster, stored = scores(design), scores(design, store=store)
            pids = dfc.run_batch(process_of, dict(enumerate(range(8))), progress=False)
        # It was the workers that ran.
        assert set(pids.values()) <= set(before.values())
    assert on_cluster.tobytes() == stored.tobytes() == plain.tobytes()
    assert len(lines(store)) == 1 + RUNS


@pytest.mark.slow
def test_a_batch_of_diagnoses_is_that_of_each(tmp_path):
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    machine = axis.replace(effects=(dfc.effects.InputGain(gain=1.2),))
    records = {"monday": driven(machine), "tuesday": driven(machine, seconds=2.5)}
    store = tmp_path / "diagnoses.jsonl"
    batch = functools.partial(dfc.diagnose_batch, progress=False, store=store)
    with among("input_gain", "load_dependence", "bias_force", "stribeck"):
        one = batch(axis, {"monday": records["monday"]})
        both = batch(axis, records)
        assert both["monday"] == one["monday"]
        for name, record in records.items():
            alone = dfc.diagnose(axis, record, jobs=1).to_dict()
            assert both[name] == json.loads(json.dumps(alone))
            assert [cause["effect"] for cause in both[name]["causes"]] == ["input_gain"]
        kept = store.read_bytes()
        assert batch(axis, records) == both and store.read_bytes() == kept
        # The same name over other data is another case; records in a list are numbered.
        assert batch(axis, {"monday": records["tuesday"]}) == {"monday": both["tuesday"]}
        assert batch(axis, [records["monday"]]) == {0: both["monday"]}
        assert len(lines(store)) == 5
        for other in (dict(axis=axis.replace(mass=2.1)), dict(window=0.3), dict(hold="first")):
            with pytest.raises(ValueError, match=f"other settings: {next(iter(other))} is"):
                batch(**dict(axis=axis, records=records) | other)
