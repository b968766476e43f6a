"""Heading filter on synthetic recordings: consistency, comparison with the true levels, robustness."""

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from firmware_py.common.angles import radians
from firmware_py.estimate import heading_filter, heading_model
from firmware_py.estimate.heading_filter import LEVEL_OFFSETS, MAX_LEVELS, MIN_LEVELS, PRIOR, PRIOR_SDS, begin, update
from firmware_py.estimate.heading_model import NoiseLevels
from firmware_py.model.kt import OCEAN_RAMBLER
from support.heading_recording import (
    BIASES,
    DIFFUSIONS_DEG2_S,
    UNDISTURBED_SEAS,
    Recording,
    Sea,
    compare_filters,
    draw_recording,
    run_filter,
    with_turn,
    wrap,
)

LEVELS = 6
MAX_LEVEL_STEP = 0.5
UNKNOWN_RUDDER_WALK = math.log(math.radians(2.0))

pytestmark = pytest.mark.timeout(600)  # the first test compiles the filter
OFFSHORE = Sea(6.0, 2.4, 3.2, compass_noise_deg=0.3, compass_hz=10.0)
GRID = {
    f"D {diffusion:g}, bias {bias}, {'rudder' if known else 'no rudder'}": (
        sea._replace(diffusion_deg2_s=diffusion),
        known,
    )
    for known in (True, False)
    for bias, sea in BIASES.items()
    for diffusion in DIFFUSIONS_DEG2_S
} | {
    f"{name}, bias memory {memory_s:g} s, {'rudder' if known else 'no rudder'}": (
        sea._replace(bias_memory_s=memory_s),
        known,
    )
    for name, sea in UNDISTURBED_SEAS.items()
    for memory_s in (100.0, 900.0)
    for known in (True, False)
}
# Largest difference in R2 of the predicted heading from the filter with the true levels. In the undisturbed seas the
# bias returns to its mean within 100 s, which a random walk does not predict; with a large disturbance a small bias
# cannot be distinguished from the prior.
SHORTFALLS = {
    "D 6, bias 2 deg, 900 s, rudder": 0.07,
    "sea, bias memory 100 s, rudder": 0.06,
    "swell, bias memory 100 s, rudder": 0.07,
    "storm, bias memory 100 s, rudder": 0.19,
    "storm, bias memory 900 s, rudder": 0.09,
}


@cache
def comparison_of(name: str, seeds: int = 20):
    sea, is_rudder_known = GRID[name]
    return compare_filters(sea, range(1, seeds + 1), rudder_known=is_rudder_known)


def assert_consistent_and_accurate(comparison) -> None:
    assert 0.6 <= comparison.learning.nees <= 1.4
    assert comparison.learning.error_deg <= 1.1 * comparison.reference.error_deg + 0.1
    assert comparison.learning.error_deg <= comparison.low_pass_deg


def assert_predicts(comparison, shortfall: float = 0.05) -> None:
    for r2, reference_r2 in zip(comparison.learning.r2, comparison.reference.r2, strict=True):
        assert r2 >= reference_r2 - shortfall


@pytest.mark.parametrize(
    "name",
    ["D 0, bias 5 deg, 900 s, rudder", "D 2, bias 12 deg, 3000 s, rudder", "D 6, bias 2 deg, 900 s, no rudder"],
)
def test_filter_is_consistent_and_near_the_filter_with_the_true_levels(name):
    comparison = comparison_of(name, seeds=2)
    assert_consistent_and_accurate(comparison)
    assert_predicts(comparison)


@pytest.mark.proof
@pytest.mark.parametrize("name", GRID)
def test_filter_is_consistent_and_accurate_on_the_whole_grid(name):
    learning, reference, low_pass_deg = comparison = comparison_of(name)
    r2 = " ".join(f"{a:.2f}/{b:.2f}" for a, b in zip(learning.r2, reference.r2, strict=True))
    errors = f"{learning.error_deg:.2f}, true levels {reference.error_deg:.2f}, low-pass {low_pass_deg:.2f} deg"
    print(f"{name}: error {errors}; NEES {learning.nees:.2f}; R2 {r2}")
    assert_consistent_and_accurate(comparison)


@pytest.mark.proof
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.xfail(name in SHORTFALLS, reason="bias is no random walk", strict=True))
        for name, (_, is_rudder_known) in GRID.items()
        if is_rudder_known
    ],
)
def test_predictions_are_nearly_those_with_the_true_levels_on_the_whole_grid(name):
    assert_predicts(comparison_of(name))


@pytest.mark.proof
@pytest.mark.parametrize(("name", "shortfall"), SHORTFALLS.items())
def test_known_shortfalls_of_predictions_do_not_grow(name, shortfall):
    assert_predicts(comparison_of(name), shortfall)


@pytest.mark.parametrize(
    ("sea", "tolerance"),
    [
        (Sea(), NoiseLevels(0.4, 0.1, 0.05, 0.2, 0.3, 0.8)),
        (OFFSHORE, NoiseLevels(0.4, 0.1, 0.05, 0.2, 0.3, 0.8)),
        # The damping is overestimated by 0.29 in the mean of 12 seeds.
        (UNDISTURBED_SEAS["swell"], NoiseLevels(math.inf, 0.15, 0.1, 0.4, 1.0, 0.8)),
    ],
    ids=["typical", "offshore", "swell"],
)
def test_filter_learns_the_levels(sea, tolerance):
    _, f = run_filter(sea, draw_recording(sea, 1))
    expected = NoiseLevels(
        math.log(max(sea.diffusion_deg2_s, 1e-9) * radians(1.0) ** 2),
        math.log(radians(sea.wave_deg)),
        math.log(sea.wave_period_s),
        math.log(sea.wave_damping),
        math.log(radians(sea.compass_noise_deg)),
        math.log(radians(sea.bias_sd_deg) * math.sqrt(2.0 / sea.bias_memory_s)),
    )
    for learned, level, max_error in zip(f.levels, expected, tolerance, strict=True):
        assert learned == pytest.approx(level, abs=max_error)


def test_without_yaw_disturbance_the_learned_diffusion_is_small():
    _, f = run_filter(Sea(0.0), draw_recording(Sea(0.0), 1))
    assert f.levels.diffusion < math.log(0.01 * radians(1.0) ** 2)


@pytest.mark.parametrize(("diffusion_deg2_s", "seed"), [(6.0, 20), (10.0, 11)])
def test_large_diffusion_is_not_mistaken_for_large_waves(diffusion_deg2_s, seed):
    """With candidates of small diffusion only, waves of 12 deg were learned for hours, with an error of 4 deg."""
    error_rad, _, f = errors_after_2_min(Sea(diffusion_deg2_s), seed, 900.0)
    assert np.sqrt(np.mean(error_rad**2)) < radians(0.8)
    assert math.exp(f.levels.wave_sd) < radians(2.0)


def errors_after_2_min(sea, seed, seconds):
    """Return the heading errors and their claimed standard deviations after two minutes, and the filter."""
    recording = draw_recording(sea, seed, seconds)
    estimates, f = run_filter(sea, recording)
    rows = recording.t_s > 120.0
    return wrap(estimates.states[:, 0] - recording.true_rad)[rows], estimates.heading_sd_rad[rows], f


def test_large_waves_are_learned_in_the_first_minutes():
    error_rad, sd_rad, _ = errors_after_2_min(UNDISTURBED_SEAS["swell"], 2, 300.0)
    assert np.sqrt(np.mean(error_rad**2)) < radians(8.0)
    assert np.mean((error_rad / sd_rad) ** 2) < 4.0


@pytest.mark.parametrize("diffusion_deg2_s", [0.0, 2.0])
@pytest.mark.parametrize("rate_deg_s", [3.0, 10.0, 20.0])
def test_turn_not_explained_by_the_rudder_is_followed_within_seconds(rate_deg_s, diffusion_deg2_s):
    sea = Sea(diffusion_deg2_s)
    recording = with_turn(draw_recording(sea, 1, 1500.0), rate_deg_s)
    estimates, _ = run_filter(sea, recording)
    error_rad = np.abs(wrap(estimates.states[:, 0] - recording.true_rad))
    assert error_rad[recording.t_s > max(1212.0, 1206.0 + 90.0 / rate_deg_s)].max() < radians(4.0)


def select_rows(recording: Recording, rows) -> Recording:
    """Return some rows of a recording, with the mean of the rudder angle over each gap."""
    indices = np.flatnonzero(rows)
    total = np.concatenate([[0.0], np.cumsum(recording.rudder_rad)])
    ends = np.append(indices[1:], rows.size)
    rudder_rad = (total[ends] - total[indices]) / (ends - indices)
    return Recording(recording.t_s[indices], recording.compass_rad[indices], rudder_rad, recording.true_rad[indices])


@pytest.mark.parametrize("is_rudder_known", [True, False])
@pytest.mark.parametrize("gap_s", [5.0, 60.0])
def test_innovation_after_a_gap_matches_its_standard_deviation(gap_s, is_rudder_known):
    squares = []
    for seed in range(1, 11):
        recording = draw_recording(Sea(), seed, 600.0)
        last_s = recording.t_s[-1]
        rows = (recording.t_s < last_s - gap_s) | (recording.t_s == last_s)
        _, f = run_filter(Sea(), select_rows(recording, rows), rudder_known=is_rudder_known)
        squares.append((f.innovation_rad / f.innovation_sd_rad) ** 2)
    assert (0.5 if is_rudder_known else 0.05) < np.mean(squares) < 2.0


def update_all(f, samples):
    """Return the filter updated with samples of time, heading and rudder angle."""
    for t_s, heading_rad, rudder_rad in samples:
        f = update(f, OCEAN_RAMBLER, t_s, heading_rad, rudder_rad)
    return f


STEADY = [(0.5 * i, 1.0 + 0.02 * math.sin(1.3 * i), 0.02) for i in range(400)]


def test_gap_of_more_than_10_min_restarts_the_filter():
    f = update_all(begin(0.0, 1.0), STEADY)
    assert update_all(f, [(f.t_s + 599.0, 1.0, 0.0)]).begun_s == 0.0
    restarted = update_all(f, [(f.t_s + 601.0, -2.0, 0.0)])
    assert repr(restarted) == repr(begin(f.t_s + 601.0, -2.0))


def test_first_heading_starts_the_filter():
    f = begin(math.nan, 0.0)
    assert not heading_filter.has_started(f)
    started = update_all(f, [(12.0, 2.0, math.nan)])
    assert heading_filter.has_started(started)
    assert repr(started) == repr(begin(12.0, 2.0))


def test_late_headings_are_used_for_a_second_and_keep_the_time():
    f = update_all(begin(0.0, 1.0), STEADY)
    assert update_all(f, [(f.t_s - 1.1, 2.0, 0.0)]) is f
    late = update_all(f, [(f.t_s - 0.9, f.motion.heading_rad + 0.01, 0.0)])
    assert late.t_s == f.t_s
    assert late.motion.p00 < f.motion.p00


@pytest.mark.parametrize("sample", [(math.nan, 1.0), (math.inf, 1.0), (300.0, math.nan), (300.0, -math.inf)])
def test_samples_that_are_not_finite_are_ignored(sample):
    f = update_all(begin(0.0, 1.0), STEADY)
    assert update_all(f, [(*sample, 0.0)]) is f


EXTREME_FLOATS = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True), st.floats(-7.0, 7.0), st.sampled_from((0.0, 1e300, -1e308, 5e-324))
)


LEARNING_FILTER = update_all(begin(0.0, 1.0), STEADY[:160])


@settings(max_examples=25, phases=(Phase.generate,))
@given(
    st.lists(
        st.tuples(
            st.sampled_from((-2.0, -0.6, 0.0, 1e-300, 0.02, 0.5, 30.0, 599.0, 700.0)), EXTREME_FLOATS, EXTREME_FLOATS
        ),
        max_size=20,
    ),
    st.booleans(),
)
def test_filter_stays_valid_with_extreme_samples_and_recovers(steps, is_learning):
    f = LEARNING_FILTER if is_learning else begin(0.0, 1.0)
    t_s = f.t_s
    for step_s, heading_rad, rudder_rad in steps:
        f = update_all(f, [(t_s + step_s, heading_rad, rudder_rad)])
        t_s = max(t_s, t_s + step_s)
        assert heading_model.is_valid(f.motion)
        assert all(low <= level <= high for low, level, high in zip(MIN_LEVELS, f.levels, MAX_LEVELS, strict=True))
        assert math.isfinite(f.innovation_rad)
        assert f.innovation_sd_rad > 0.0
    f = update_all(f, [(t_s + i, 2.0 + 0.01 * math.sin(2.3 * i), 0.0) for i in range(200)])
    assert abs(wrap(f.motion.heading_rad - 2.0)) < radians(10.0)


def test_unknown_rudder_raises_the_bias_walk_only_while_it_is_unknown():
    assert heading_filter.levels_for(PRIOR, 0.1) == PRIOR
    assert heading_filter.levels_for(PRIOR, math.nan) == PRIOR._replace(bias_walk=UNKNOWN_RUDDER_WALK)
    large_walk = PRIOR._replace(bias_walk=UNKNOWN_RUDDER_WALK + 0.1)
    assert heading_filter.levels_for(large_walk, math.nan) == large_walk
    recording = draw_recording(Sea(), 1, 2000.0)
    rudder_rad = recording.rudder_rad.copy()
    rudder_rad[3600] = math.nan
    _, complete = run_filter(Sea(), recording)
    _, interrupted = run_filter(Sea(), recording._replace(rudder_rad=rudder_rad))
    assert interrupted.levels.bias_walk == pytest.approx(complete.levels.bias_walk, abs=0.2)


def test_candidates_and_level_offsets_change_only_their_levels():
    candidates = {heading_filter.candidate_levels(number) for number in range(2 * LEVELS)}
    assert len(candidates) == 2 * LEVELS
    for candidate in candidates:
        prior_levels = {"diffusion": PRIOR.diffusion, "wave_sd": PRIOR.wave_sd, "wave_period": PRIOR.wave_period}
        assert candidate._replace(**prior_levels) == PRIOR
    for index in range(LEVELS):
        expected = [level + (0.25 if index == i else 0.0) for i, level in enumerate(PRIOR)]
        assert list(heading_filter.with_level_offset(PRIOR, index, 0.25)) == expected


@pytest.mark.parametrize(("age_s", "memory_s"), [(0.0, 100.0), (600.0, 300.0), (3600.0, 1800.0), (1e6, 1800.0)])
def test_memory_grows_with_the_age_within_its_limits(age_s, memory_s):
    assert heading_filter.memory_s(age_s) == memory_s


def sums_of(scores) -> np.ndarray:
    """Return the log-likelihood sums of a window that give these scores of the levels."""
    return np.column_stack([np.multiply(scores, LEVEL_OFFSETS), -np.multiply(scores, LEVEL_OFFSETS)]).ravel()


def test_window_changes_the_levels_by_the_scoring_step():
    rng = np.random.default_rng(1)
    information, score = rng.uniform(0.0, 60.0, LEVELS), rng.standard_normal(LEVELS)
    levels = NoiseLevels(*(level + 0.2 for level in PRIOR))
    weight, forgotten = 1.0 / np.array(PRIOR_SDS) ** 2, 1.0 - math.exp(-15.0 / heading_filter.memory_s(2000.0))
    step = (score + forgotten * weight * (np.array(PRIOR) - np.array(levels))) / (information + weight)
    assert np.abs(step).max() < MAX_LEVEL_STEP
    result = heading_filter.scoring_step(levels, information, sums_of(score), 15.0, 2000.0)
    assert list(result) == pytest.approx(list(np.array(levels) + step), rel=1e-9)
    assert {type(level) for level in result} == {float}


def test_window_changes_levels_within_step_limit_and_bounds():
    zero = np.zeros(LEVELS)
    result = heading_filter.scoring_step(PRIOR, zero, sums_of((100.0, 0.0, 0.0, 0.0, 0.0, -100.0)), 15.0, 100.0)
    changes = [new - old for new, old in zip(result, PRIOR, strict=True)]
    assert max(map(abs, changes)) == pytest.approx(MAX_LEVEL_STEP)
    assert changes[5] < 0.0 < changes[0]
    highest = NoiseLevels(*MAX_LEVELS)
    assert heading_filter.scoring_step(highest, zero, sums_of((9.0,) * LEVELS), 15.0, 100.0) == highest
