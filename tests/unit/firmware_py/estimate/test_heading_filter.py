"""Heading filter on synthetic recordings: consistent, near the filter with the true levels, and robust."""

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from firmware_py.common.angles import radians
from firmware_py.estimate import heading_filter, heading_model
from firmware_py.estimate.heading_filter import (
    LEVEL_OFFSETS,
    LEVELS,
    MAX_LEVEL_STEP,
    MAX_LEVELS,
    MIN_LEVELS,
    PRIOR,
    PRIOR_SDS,
    UNKNOWN_RUDDER_WALK,
    begin,
    update,
)
from firmware_py.estimate.heading_model import NoiseLevels
from firmware_py.model.kt import OCEAN_RAMBLER
from support.heading_recording import (
    BIASES,
    DIFFUSIONS_DEG2_S,
    OLD_SEAS,
    Recording,
    Sea,
    compared,
    learned,
    recorded,
    with_turn,
    wrapped,
)

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
    for name, sea in OLD_SEAS.items()
    for memory_s in (100.0, 900.0)
    for known in (True, False)
}
# R2 of the heading ahead is lower than that of the filter that is given all levels by at most so much. In the old seas
# the bias returns to its mean within 100 s, which a random walk does not predict; with a large disturbance a small bias
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
    sea, known = GRID[name]
    return compared(sea, range(1, seeds + 1), rudder_known=known)


def assert_consistent_and_accurate(found) -> None:
    assert 0.6 <= found.learned.nees <= 1.4
    assert found.learned.error_deg <= 1.1 * found.informed.error_deg + 0.1
    assert found.learned.error_deg <= found.low_pass_deg


def assert_predicts(found, shortfall: float = 0.05) -> None:
    for ours, best in zip(found.learned.r2, found.informed.r2, strict=True):
        assert ours >= best - shortfall


@pytest.mark.parametrize(
    "name",
    ["D 0, bias 5 deg, 900 s, rudder", "D 2, bias 12 deg, 3000 s, rudder", "D 6, bias 2 deg, 900 s, no rudder"],
)
def test_it_is_consistent_and_near_the_filter_with_the_true_levels(name):
    found = comparison_of(name, seeds=2)
    assert_consistent_and_accurate(found)
    assert_predicts(found)


@pytest.mark.proof
@pytest.mark.parametrize("name", GRID)
def test_it_is_consistent_and_accurate_on_the_whole_grid(name):
    ours, best, low_pass_deg = found = comparison_of(name)
    r2 = " ".join(f"{a:.2f}/{b:.2f}" for a, b in zip(ours.r2, best.r2, strict=True))
    print(
        f"{name}: error {ours.error_deg:.2f}, true levels {best.error_deg:.2f}, low-pass {low_pass_deg:.2f} deg; "
        f"NEES {ours.nees:.2f}; R2 {r2}"
    )
    assert_consistent_and_accurate(found)


@pytest.mark.proof
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(
            name,
            marks=pytest.mark.xfail(
                name in SHORTFALLS, reason="the rudder bias is a random walk in the model", strict=True
            ),
        )
        for name, (_, known) in GRID.items()
        if known
    ],
)
def test_predictions_are_nearly_as_good_on_the_whole_grid(name):
    assert_predicts(comparison_of(name))


@pytest.mark.proof
@pytest.mark.parametrize(("name", "shortfall"), SHORTFALLS.items())
def test_known_shortfalls_do_not_grow(name, shortfall):
    assert_predicts(comparison_of(name), shortfall)


@pytest.mark.parametrize(
    ("sea", "tolerance"),
    [
        (Sea(), NoiseLevels(0.4, 0.1, 0.05, 0.2, 0.3, 0.8)),
        (OFFSHORE, NoiseLevels(0.4, 0.1, 0.05, 0.2, 0.3, 0.8)),
        # The damping is overestimated by 0.29 in the mean of 12 seeds.
        (OLD_SEAS["swell"], NoiseLevels(math.inf, 0.15, 0.1, 0.4, 1.0, 0.8)),
    ],
    ids=["typical", "offshore", "swell"],
)
def test_it_learns_the_levels(sea, tolerance):
    _, f = learned(sea, recorded(sea, 1))
    expected = NoiseLevels(
        math.log(max(sea.diffusion_deg2_s, 1e-9) * radians(1.0) ** 2),
        math.log(radians(sea.wave_deg)),
        math.log(sea.wave_period_s),
        math.log(sea.wave_damping),
        math.log(radians(sea.compass_noise_deg)),
        math.log(radians(sea.bias_sd_deg) * math.sqrt(2.0 / sea.bias_memory_s)),
    )
    for found, level, near in zip(f.levels, expected, tolerance, strict=True):
        assert found == pytest.approx(level, abs=near)


def test_without_yaw_disturbance_the_learned_diffusion_is_small():
    _, f = learned(Sea(0.0), recorded(Sea(0.0), 1))
    assert f.levels.diffusion < math.log(0.01 * radians(1.0) ** 2)


@pytest.mark.parametrize(("diffusion_deg2_s", "seed"), [(6.0, 20), (10.0, 11)])
def test_large_diffusion_is_not_mistaken_for_large_waves(diffusion_deg2_s, seed):
    """Candidates of little diffusion alone led to waves of 12 deg for hours, and an error of 4 deg."""
    sea = Sea(diffusion_deg2_s)
    recording = recorded(sea, seed, 900.0)
    estimates, f = learned(sea, recording)
    rows = recording.t_s > 120.0
    error_rad = wrapped(estimates.states[:, 0] - recording.true_rad)[rows]
    assert np.sqrt(np.mean(error_rad**2)) < radians(0.8)
    assert math.exp(f.levels.wave_sd) < radians(2.0)


def test_large_waves_are_found_in_the_first_minutes():
    sea = OLD_SEAS["swell"]
    recording = recorded(sea, 2, 300.0)
    estimates, _ = learned(sea, recording)
    rows = recording.t_s > 120.0
    error_rad = wrapped(estimates.states[:, 0] - recording.true_rad)[rows]
    assert np.sqrt(np.mean(error_rad**2)) < radians(8.0)
    assert np.mean((error_rad / estimates.heading_sd_rad[rows]) ** 2) < 4.0


@pytest.mark.parametrize("diffusion_deg2_s", [0.0, 2.0])
@pytest.mark.parametrize("rate_deg_s", [3.0, 10.0, 20.0])
def test_a_turn_that_the_rudder_does_not_explain_is_followed_within_seconds(rate_deg_s, diffusion_deg2_s):
    sea = Sea(diffusion_deg2_s)
    recording = with_turn(recorded(sea, 1, 1500.0), rate_deg_s)
    estimates, _ = learned(sea, recording)
    error_rad = np.abs(wrapped(estimates.states[:, 0] - recording.true_rad))
    assert error_rad[recording.t_s > max(1212.0, 1206.0 + 90.0 / rate_deg_s)].max() < radians(4.0)


def cut(recording: Recording, rows) -> Recording:
    """Return some rows of a recording, with the mean of the rudder angle over a gap."""
    places = np.flatnonzero(rows)
    total = np.concatenate([[0.0], np.cumsum(recording.rudder_rad)])
    ends = np.append(places[1:], rows.size)
    rudder_rad = (total[ends] - total[places]) / (ends - places)
    return Recording(recording.t_s[places], recording.compass_rad[places], rudder_rad, recording.true_rad[places])


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("gap_s", [5.0, 60.0])
def test_after_a_gap_the_innovation_is_as_large_as_expected(gap_s, known):
    squares = []
    for seed in range(1, 11):
        recording = recorded(Sea(), seed, 600.0)
        last_s = recording.t_s[-1]
        rows = (recording.t_s < last_s - gap_s) | (recording.t_s == last_s)
        _, f = learned(Sea(), cut(recording, rows), rudder_known=known)
        squares.append((f.innovation_rad / f.innovation_sd_rad) ** 2)
    assert (0.5 if known else 0.05) < np.mean(squares) < 2.0


def sampled(f, samples):
    """Return the filter after (time, heading, rudder) of each sample."""
    for t_s, heading_rad, rudder_rad in samples:
        f = update(f, OCEAN_RAMBLER, t_s, heading_rad, rudder_rad)
    return f


STEADY = [(0.5 * i, 1.0 + 0.02 * math.sin(1.3 * i), 0.02) for i in range(400)]


def test_a_long_gap_restarts_it():
    f = sampled(begin(0.0, 1.0), STEADY)
    assert sampled(f, [(f.t_s + 599.0, 1.0, 0.0)]).begun_s == 0.0
    again = sampled(f, [(f.t_s + 601.0, -2.0, 0.0)])
    assert repr(again) == repr(begin(f.t_s + 601.0, -2.0))


def test_the_first_heading_starts_it():
    f = begin(math.nan, 0.0)
    assert not heading_filter.has_started(f)
    started = sampled(f, [(12.0, 2.0, math.nan)])
    assert heading_filter.has_started(started)
    assert repr(started) == repr(begin(12.0, 2.0))


def test_late_headings_count_for_a_second_only_and_do_not_move_the_time():
    f = sampled(begin(0.0, 1.0), STEADY)
    assert sampled(f, [(f.t_s - 1.1, 2.0, 0.0)]) is f
    late = sampled(f, [(f.t_s - 0.9, f.motion.heading_rad + 0.01, 0.0)])
    assert late.t_s == f.t_s
    assert late.motion.p00 < f.motion.p00


@pytest.mark.parametrize("sample", [(math.nan, 1.0), (math.inf, 1.0), (300.0, math.nan), (300.0, -math.inf)])
def test_values_that_are_not_finite_change_nothing(sample):
    f = sampled(begin(0.0, 1.0), STEADY)
    assert sampled(f, [(*sample, 0.0)]) is f


HOSTILE = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True), st.floats(-7.0, 7.0), st.sampled_from((0.0, 1e300, -1e308, 5e-324))
)


LEARNING = sampled(begin(0.0, 1.0), STEADY[:160])


@settings(max_examples=25, phases=(Phase.generate,))
@given(
    st.lists(
        st.tuples(st.sampled_from((-2.0, -0.6, 0.0, 1e-300, 0.02, 0.5, 30.0, 599.0, 700.0)), HOSTILE, HOSTILE),
        max_size=20,
    ),
    st.booleans(),
)
def test_hostile_samples_leave_it_valid_and_it_recovers(steps, is_learning):
    f = LEARNING if is_learning else begin(0.0, 1.0)
    t_s = f.t_s
    for step_s, heading_rad, rudder_rad in steps:
        f = sampled(f, [(t_s + step_s, heading_rad, rudder_rad)])
        t_s = max(t_s, t_s + step_s)
        assert heading_model.is_valid(f.motion)
        assert all(low <= level <= high for low, level, high in zip(MIN_LEVELS, f.levels, MAX_LEVELS, strict=True))
        assert math.isfinite(f.innovation_rad)
        assert f.innovation_sd_rad > 0.0
    f = sampled(f, [(t_s + i, 2.0 + 0.01 * math.sin(2.3 * i), 0.0) for i in range(200)])
    assert abs(wrapped(f.motion.heading_rad - 2.0)) < radians(10.0)


def test_an_unknown_rudder_raises_the_bias_walk_for_as_long_as_it_is_unknown():
    assert heading_filter.levels_for(PRIOR, 0.1) == PRIOR
    assert heading_filter.levels_for(PRIOR, math.nan) == PRIOR._replace(bias_walk=UNKNOWN_RUDDER_WALK)
    free = PRIOR._replace(bias_walk=UNKNOWN_RUDDER_WALK + 0.1)
    assert heading_filter.levels_for(free, math.nan) == free
    recording = recorded(Sea(), 1, 2000.0)
    rudder_rad = recording.rudder_rad.copy()
    rudder_rad[3600] = math.nan
    _, whole = learned(Sea(), recording)
    _, missed = learned(Sea(), recording._replace(rudder_rad=rudder_rad))
    assert missed.levels.bias_walk == pytest.approx(whole.levels.bias_walk, abs=0.2)


def test_candidates_and_level_offsets_differ_in_one_level_each():
    candidates = {heading_filter.candidate_levels(number) for number in range(2 * LEVELS)}
    assert len(candidates) == 2 * LEVELS
    for candidate in candidates:
        same = {"diffusion": PRIOR.diffusion, "wave_sd": PRIOR.wave_sd, "wave_period": PRIOR.wave_period}
        assert candidate._replace(**same) == PRIOR
    for place in range(LEVELS):
        expected = [level + (0.25 if place == i else 0.0) for i, level in enumerate(PRIOR)]
        assert list(heading_filter.with_level_offset(PRIOR, place, 0.25)) == expected


@pytest.mark.parametrize(("age_s", "memory_s"), [(0.0, 100.0), (600.0, 300.0), (3600.0, 1800.0), (1e6, 1800.0)])
def test_the_memory_grows_from_minutes_to_half_an_hour(age_s, memory_s):
    assert heading_filter.memory_s(age_s) == memory_s


def sums_of(scores) -> np.ndarray:
    """Return the sums of log-likelihoods of a window in which the levels have these scores."""
    return np.column_stack([np.multiply(scores, LEVEL_OFFSETS), -np.multiply(scores, LEVEL_OFFSETS)]).ravel()


def test_a_window_moves_the_levels_by_the_scoring_step():
    numbers = np.random.default_rng(1)
    information, score = numbers.uniform(0.0, 60.0, LEVELS), numbers.standard_normal(LEVELS)
    levels = NoiseLevels(*(level + 0.2 for level in PRIOR))
    weight, share = 1.0 / np.array(PRIOR_SDS) ** 2, 1.0 - math.exp(-15.0 / heading_filter.memory_s(2000.0))
    step = (score + share * weight * (np.array(PRIOR) - np.array(levels))) / (information + weight)
    assert np.abs(step).max() < MAX_LEVEL_STEP
    found = heading_filter.scoring_step(levels, information, sums_of(score), 15.0, 2000.0)
    assert list(found) == pytest.approx(list(np.array(levels) + step), rel=1e-9)
    assert {type(level) for level in found} == {float}


def test_a_window_moves_no_level_by_more_than_the_limit_or_beyond_its_bounds():
    zero = np.zeros(LEVELS)
    found = heading_filter.scoring_step(PRIOR, zero, sums_of((100.0, 0.0, 0.0, 0.0, 0.0, -100.0)), 15.0, 100.0)
    moves = [after - before for after, before in zip(found, PRIOR, strict=True)]
    assert max(map(abs, moves)) == pytest.approx(MAX_LEVEL_STEP)
    assert moves[5] < 0.0 < moves[0]
    high = NoiseLevels(*MAX_LEVELS)
    assert heading_filter.scoring_step(high, zero, sums_of((9.0,) * LEVELS), 15.0, 100.0) == high
