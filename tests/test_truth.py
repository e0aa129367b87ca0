"""What the bench of `truth` promises to its users; its physics is held against the axis elsewhere.

It shares no code with the package, so that nothing here imports the package:
`model/test_against_the_bench.py` compares the two, effect by effect.
"""

from pathlib import Path

import numpy as np
import pytest
from truth import CONDITIONS, RECORDERS, make_case, make_machine, make_null
from truth.bench import DT, VISIBLE, WINDOW
from truth.plant import X, free_runs

BASE = ("mass", "viscous", "coulomb")


@pytest.mark.parametrize("condition", CONDITIONS)
def test_same_seed_same_record(condition):
    first, again = make_case("cogging", 5, condition), make_case("cogging", 5, condition)
    for name in ("t", "u", "x", "reference", "states"):
        assert np.array_equal(getattr(first, name), getattr(again, name))
    assert first.truth == again.truth and first.believed == again.believed
    other = make_case("cogging", 6, condition)
    assert not np.array_equal(first.u, other.u)


def test_believed():
    for seed in range(3):
        exact, off = make_null(seed), make_null(seed, "off")
        assert exact.believed == exact.actual
        for key in BASE:
            share = off.believed[key] / off.actual[key] - 1.0
            assert 0.0 < abs(share) <= 0.031  # 3 % of the true value, as a ratio
    case = make_case("coulomb", 0, "off")
    assert case.truth["coulomb"]["coulomb"] == case.actual["coulomb"]
    assert abs(case.actual["coulomb"] / case.believed["coulomb"] - 1.0) > 0.05
    assert make_case("stribeck", 0).believed["stribeck"] is None


@pytest.mark.parametrize("how", RECORDERS)
def test_recorder_changes_only_what_is_written_down(how):
    for seed in (0, 1):
        sound, poor = make_case("spring", seed), make_case("spring", seed, how)
        assert poor.truth == sound.truth and poor.condition == how
        assert poor.t.size == poor.u.size == poor.x.size == poor.states.shape[0]
        level, n = sound.actual["coulomb"], sound.t.size
        if how == "noisy":
            assert np.std(poor.u - sound.u) == pytest.approx(0.03 * level, rel=0.02)
        elif how == "10-bit":
            assert np.unique(poor.u).size <= 1024
            assert np.abs(poor.u - sound.u).max() <= 0.5001 * np.ptp(sound.u) / 1023.0
        elif how == "decimated":
            assert np.diff(poor.t) == pytest.approx(4.0 * DT)
            impulse = np.sum(poor.u) * 4.0 - np.sum(sound.u)
            assert (abs(impulse) < 1e-6) == (seed == 0)
        elif how == "jitter":
            steps = np.diff(poor.t)
            assert np.all(steps > 0.69 * DT) and np.all(steps < 4.31 * DT)
            assert 0.003 < 1.0 - poor.t.size / n < 0.008
            # Late readings lie on the true path where it is at the stamped time.
            place = np.interp(poor.t, sound.t, sound.states[:, X])
            late = np.median(np.abs(poor.x - place)) / poor.quantum
            assert (late < 1.0) == (seed == 0)
        else:
            changed = np.abs(poor.x - sound.x)
            assert 0.0005 < np.mean(changed > 0.0015 * np.ptp(sound.x)) < 0.002
            assert np.array_equal(poor.u, sound.u)


def test_machine():
    for seed, effects, count in ((0, None, {2, 3, 4}), (1, ("spring", "drift"), {2}), (2, 0, {0})):
        runs = make_machine(seed, effects)
        first = runs[0]
        assert len(runs) == 3 and all(r.truth == first.truth for r in runs)
        assert len(first.truth) in count and set(effects or ()) <= set(first.truth)
        assert all(7.0 <= r.t.size * DT <= 9.0 for r in runs)
        assert all(r.believed == first.believed and r.plant == first.plant for r in runs)
        shares = {round(first.believed[k] / first.actual[k] - 1.0, 9) for k in BASE}
        assert shares == {-0.2, 0.2}
        for slug in first.truth:
            assert np.mean([r.visibility[slug] for r in runs]) >= VISIBLE


def test_twins_are_the_same_record():
    """A bias without a Stribeck peak is an asymmetry: F = s Fc + b either way."""
    seed = next(s for s in range(20) if make_case("bias_force", s).twins)
    case = make_case("bias_force", seed)
    share = -case.truth["bias_force"]["force"] / case.actual["coulomb"]
    twin = case.plant._replace(bias=0.0, asymmetry=share)
    x = free_runs(twin, case.u, DT, case.substeps, case.states, WINDOW)
    assert np.abs(x - case.states[:, X]).max() < 1e-3 * case.quantum


def test_shares_no_code_with_the_package():
    root = Path(__file__).parent
    sources = [*(root / "truth").glob("*.py"), root.parent / "benchmarks/diagnosis_baseline.py"]
    assert len(sources) == 7
    for source in sources:
        text = source.read_text()
        assert "import dryfric_control" not in text and "from dryfric_control" not in text
