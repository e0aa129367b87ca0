"""Start states that no reading tells: time at rest, and the place of a load in its play."""

import numpy as np
import pytest
from diagnosis_cases import believed, record
from truth import make_case

import dryfric_control as dfc
from dryfric_control.estimation.windows import cut
from dryfric_control.model.effects.effect import REGISTRY

# A window whose score exceeds this is off by several times the noise.
OFF = 1.0


def scores_of_truth(slugs, seed):
    """Scores of the windows of a blind record under its own causes."""
    case = make_case(slugs, seed, "exact")
    true = [REGISTRY[slug](**case.truth[slug]) for slug in slugs]
    axis = believed(case).replace(effects=true)
    bench = cut(record(case))
    at = bench.evaluate(axis, np.ones(len(bench), bool), thorough=True)
    return bench.scores(at.costs), at


@pytest.mark.parametrize(
    ("slugs", "seed"),
    [
        # Some break-aways hang on a rest that began windows earlier; told by the
        # readings alone, which stand still too early, one or two come out wrong.
        (["dwell_time"], 1), (["dwell_time"], 3),
        # It moves elastically; told by the readings, eight and sixteen of eighty come out wrong.
        (["compliance", "dwell_time"], 2), (["presliding", "dwell_time"], 3),
    ],
)  # fmt: skip
def test_the_run_before_tells_for_how_long_an_axis_has_been_at_rest(slugs, seed):
    scores, _ = scores_of_truth(slugs, seed)
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
    scores, at = scores_of_truth(["backlash"], seed)
    # Nothing ran before the first window: its load is where it fits best.
    assert -1.0 <= at.starts[2, 0] <= 1.0
    assert scores[0] < OFF
