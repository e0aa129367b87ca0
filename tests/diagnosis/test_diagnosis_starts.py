"""Start states that no reading tells: time at rest, and the place of a load in its play."""

import numpy as np
import pytest
from diagnosis_cases import believed, record
from truth import make_case

import dryfric_control as dfc
from dryfric_control.estimation.windows import cut

# A window whose score exceeds this is off by several times the noise.
OFF = 1.0


def scores_of_truth(slugs, effects, seed):
    """Scores of the windows of a blind record under its own causes."""
    case = make_case(slugs, seed, "exact")
    true = [effect(**case.truth[slug]) for slug, effect in zip(slugs, effects, strict=True)]
    axis = believed(case).replace(effects=true)
    bench = cut(record(case))
    at = bench.evaluate(axis, np.ones(len(bench), bool), thorough=True)
    return bench.scores(at.costs), at


@pytest.mark.parametrize("seed", [1, 3])
def test_the_run_before_tells_for_how_long_an_axis_has_been_at_rest(seed):
    # Some break-aways hang on a rest that began windows earlier; told by the
    # readings alone, which stand still too early, one or two come out wrong.
    scores, _ = scores_of_truth(["dwell_time"], [dfc.effects.DwellTime], seed)
    assert not np.any(scores > OFF)


@pytest.mark.parametrize(
    ("slug", "effect", "seed"),
    [("compliance", dfc.effects.Compliance, 2), ("presliding", dfc.effects.Presliding, 3)],
)
def test_what_moves_elastically_has_rested_all_the_while(slug, effect, seed):
    # The readings move; told by them alone, eight and sixteen windows of eighty come out wrong.
    effects = [effect, dfc.effects.DwellTime]
    scores, _ = scores_of_truth([slug, "dwell_time"], effects, seed)
    assert not np.any(scores > OFF)


def test_noise_sets_no_resting_axis_in_motion():
    rng = np.random.default_rng(5)
    t = 1e-3 * np.arange(2000)
    x = 1e-6 * rng.standard_normal(t.size) + 0.01 * np.clip(t - 1.5, 0.0, None)
    windows = cut(dfc.Record(t, np.cos(t), x))
    still = (windows.rest > 0.05) & (windows.start_times < 1.4)
    assert still.sum() > 3
    assert np.all(windows.v0[still] == 0.0)


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_a_load_may_start_anywhere_in_its_play(seed):
    scores, at = scores_of_truth(["backlash"], [dfc.effects.Backlash], seed)
    # Nothing ran before the first window: its load is where it fits best.
    assert -1.0 <= at.starts[2, 0] <= 1.0
    assert scores[0] < OFF
