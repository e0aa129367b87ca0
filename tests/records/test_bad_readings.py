"""Bad readings: found in spoiled records, and never in sound ones."""

import pickle
import warnings

import numpy as np
import pytest
import truth

import dryfric_control as dfc
from dryfric_control.estimation.likelihood import prepare
from dryfric_control.records.bad_readings import find

T = 1e-3 * np.arange(2000)
U = np.cos(5.0 * T)
QUANTUM = 1e-6
X = QUANTUM * np.round(0.1 * np.sin(5.0 * T) / QUANTUM)


def quiet(*arguments, make=dfc.Record, **options):
    """A record, its warnings not heard."""
    with warnings.catch_warnings(action="ignore", category=dfc.RecordWarning):
        return make(*arguments, **options)


def spoiled():
    """The sine with one jump and three repetitions."""
    x = X.copy()
    x[300] += 0.01
    x[701] = x[700]
    x[1002] = x[1001] = x[1000]
    return x


def test_masked_and_bridged():
    x = spoiled()
    words = r"masked: 1 jump, 3 repeated; the first is x\[300\]"
    with pytest.warns(dfc.RecordWarning, match=words):
        record = dfc.Record(T, U, x)
    assert record.masked.indices.tolist() == [300, 701, 1001, 1002]
    assert record.masked.reasons == ("jump", "repeated", "repeated", "repeated")
    assert repr(record.masked).splitlines() == [
        "masked    from sample  to sample  readings",
        "jump      300          300        1",
        "repeated  701          701        1",
        "repeated  1001         1002       2",
    ]
    assert np.array_equal(record.measured, x)
    assert np.flatnonzero(~record.good).tolist() == [300, 701, 1001, 1002]
    # A cubic misses 0.1 sin(5 t) by less than a quantum over three milliseconds.
    assert np.abs(record.x - X).max() < QUANTUM
    assert record.quantum == pytest.approx(QUANTUM)
    assert record.bad == {"jump": 1, "repeated": 3, "filled": 0, "given": 0, "clipped": 0}
    assert "1 jump, 3 repeated" in record.summary()


@pytest.mark.parametrize("what", ["backlash", "stribeck", "impacts", "lost_steps", "compliance"])
def test_motion_is_not_taken_for_bad_readings(what):
    for condition in ("exact", "coarse", "decimated"):
        case = truth.make_case(what, 0, condition)
        assert dfc.Record(case.t, case.u, case.x).good.all()


def test_what_a_logger_spoils_is_found():
    for seed in (0, 1, 2, 3):
        sound, case = truth.make_null(seed), truth.make_null(seed, "outliers")
        record = quiet(case.t, case.u, case.x)
        off = np.abs(case.x - sound.x) / case.quantum
        assert not np.any(off[record.masked.indices] == 0.0)
        # What is missed is as small as what the encoder leaves open.
        assert np.mean(off[record.good] > 5.0) < 3e-4
        assert off[record.good].max() < 10.0 < off.max()


@pytest.mark.parametrize(
    "bad",
    [
        {600: "jump", 601: "jump"}, {600: "jump", 602: "jump"}, {600: "jump", 602: "repeated"},
        {600: "repeated", 602: "repeated"}, {600: "repeated", 603: "repeated"},
    ],
)  # fmt: skip
def test_bad_readings_close_to_each_other(bad):
    x = X.copy()
    for k, kind in bad.items():
        x[k] = x[k - 1] if kind == "repeated" else X[k] + (2e-3 if k == 600 else -2e-4)
    found = find(x, QUANTUM / np.sqrt(12.0), QUANTUM)
    assert bad.keys() <= found.keys() and len(found) <= len(bad) + 1


SOUND = {
    "comes to rest": np.r_[X, np.full(40, X[-1])],
    "starts with a kick": np.r_[X, X[-1] + np.cumsum(np.full(40, 5e-4))],
    "lost count": np.r_[X, X + 0.02],
    "a slower encoder": np.repeat(X[::4], 4),
}


@pytest.mark.parametrize("why", SOUND)
def test_not_bad(why):
    assert find(SOUND[why], QUANTUM / np.sqrt(12.0), QUANTUM) == {}


def test_what_happens_all_the_time_is_no_exception():
    for every, found in ((50, list(range(5, X.size, 50))), (15, [])):
        x = X.copy()
        x[5::every] += 1e-3
        assert list(find(x, 1e-6, 0.0)) == found


def test_parts_and_copies_keep_the_mask():
    record = quiet(T, U, spoiled())
    assert record[200:800].masked.indices.tolist() == [100, 501]
    assert record.split(2)[1].bad["repeated"] == 2
    assert record.decimated(3).masked.indices.tolist() == [100, 334]
    assert record.resampled(1e-3).masked.indices.tolist() == [300, 701, 1001, 1002]
    again = pickle.loads(pickle.dumps(record))
    assert again == record and np.array_equal(again.good, record.good)
    assert np.array_equal(again.measured, record.measured)


def test_lost_samples_are_filled_and_masked():
    keep = np.ones(T.size, bool)
    keep[500:503] = False
    with pytest.warns(dfc.RecordWarning, match="of 2000 samples .* 3 filled"):
        record = dfc.Record.from_irregular(T[keep], 5.0 * T[keep], X[keep])
    assert np.flatnonzero(~record.good).tolist() == [500, 501, 502]
    # Held for four samples, the input before the gap would act as an impulse.
    assert record.u == pytest.approx(5.0 * T, abs=1e-12)


@pytest.mark.parametrize("late", [True, False])
def test_stamps_or_samples(late):
    """The readings show whether they were taken late or only stamped late."""
    rng = np.random.default_rng(3)
    moments = T + 3e-4 * rng.random(T.size)
    taken = T if late else moments
    x = QUANTUM * np.round(0.1 * np.sin(5.0 * taken) / QUANTUM)
    record = quiet(moments, np.cos(5.0 * taken), x, make=dfc.Record.from_irregular)
    assert any("uniform clock" in note for note in record.notes) == late
    true = 0.1 * np.sin(5.0 * (record.t - record.t[0] + (0.0 if late else moments[0])))
    # Stamps taken for true would be off by 0.5 m/s * 0.15 ms = 75 um.
    assert np.abs(record.x - true)[1:-1].max() < 2.0 * QUANTUM


def test_the_likelihood_leaves_masked_readings_out():
    record = quiet(T, U, spoiled())
    assert np.array_equal(prepare(record).good, record.good)
