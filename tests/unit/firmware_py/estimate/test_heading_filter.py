"""Heading filter on synthetic recordings: consistency, comparison with the true levels, robustness."""

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from firmware_py.common.angles import radians
from firmware_py.estimate import heading_filter, heading_model
from firmware_py.estimate.heading_filter import begin, update
from firmware_py.estimate.heading_model import NoiseLevels
from firmware_py.model.kt import OCEAN_RAMBLER
from support.heading_recording import (
    BIASES,
    DIFFUSIONS_DEG2_S,
    UNDISTURBED_SEAS,
    Sea,
    compare_filters,
    draw_recording,
    run_filter,
    with_turn,
    wrap,
)

LEVELS = 6
DEGREE = math.radians(1.0)
MAX_LEVEL_STEP = 0.5
UNKNOWN_RUDDER_WALK = math.log(2.0 * DEGREE)
# Diffusion [rad^2/s], wave yaw [rad], its period [s] and damping, compass noise [rad], bias walk [rad/sqrt(s)].
PRIOR = NoiseLevels(*map(math.log, (DEGREE**2, DEGREE, 2.8, 0.2, 0.1 * DEGREE, 0.3 * DEGREE)))
PRIOR_SDS = np.array([2.5, 1.0, 0.6, 0.5, 0.7, 1.0])
MIN_LEVELS = NoiseLevels(*map(math.log, (1e-5 * DEGREE**2, 0.02 * DEGREE, 1.2, 0.04, 0.01 * DEGREE, 0.003 * DEGREE)))
MAX_LEVELS = NoiseLevels(*map(math.log, (60.0 * DEGREE**2, 40.0 * DEGREE, 16.0, 0.7, 3.0 * DEGREE, 6.0 * DEGREE)))
LEVEL_OFFSETS = np.array([0.3, 0.2, 0.05, 0.3, 0.4, 0.4])
CANDIDATES = [
    PRIOR._replace(
        diffusion=math.log(diffusion * DEGREE**2), wave_sd=math.log(wave_deg * DEGREE), wave_period=math.log(period_s)
    )
    for diffusion, wave_deg, periods_s in (
        (1.0, 1.0, (2.2, 3.6)),
        (8.0, 1.0, (2.2, 3.6)),
        (1.0, 4.0, (2.2, 3.6, 6.0, 10.0)),
        (1.0, 16.0, (2.2, 3.6, 6.0, 10.0)),
    )
    for period_s in periods_s
]

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


def update_all(f, samples):
    """Return the filter updated with samples of time, heading and rudder angle."""
    for t_s, heading_rad, rudder_rad in samples:
        f = update(f, OCEAN_RAMBLER, t_s, heading_rad, rudder_rad)
    return f


STEADY = [(0.5 * i, 1.0 + 0.02 * math.sin(1.3 * i), 0.02) for i in range(400)]


def test_gap_of_more_than_10_min_restarts_the_filter():
    f = update_all(begin(0.0, 1.0), STEADY)
    assert update_all(f, [(f.t_s + 600.0, 1.0, 0.0)]).begun_s == 0.0
    restarted = update_all(f, [(f.t_s + 601.0, -2.0, 0.0)])
    assert repr(restarted) == repr(begin(f.t_s + 601.0, -2.0))


def test_first_heading_starts_the_filter():
    f = begin(math.nan, 0.0)
    assert not heading_filter.has_started(f)
    not_started = f._replace(begun_s=math.nan, innovation_sd_rad=0.0)
    assert repr(heading_filter.not_started()) == repr(not_started)
    started = update_all(f, [(12.0, 2.0, math.nan)])
    assert heading_filter.has_started(started)
    assert repr(started) == repr(begin(12.0, 2.0))


def test_late_headings_are_used_for_a_second_and_keep_the_time():
    f = update_all(begin(0.0, 1.0), STEADY)
    assert update_all(f, [(f.t_s - 1.05, 2.0, 0.0)]) is f
    late = update_all(f, [(f.t_s - 1.0, f.motion.heading_rad + 0.01, 0.0)])
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


class PlainFilter:
    """The filter by the equations of the module's text, for samples in order and with a measured rudder."""

    def __init__(self, t_s, heading_rad):
        self.t_s = self.begun_s = self.learned_s = t_s
        self.motion, self.levels = heading_model.begin(heading_rad, PRIOR), PRIOR
        self.extra = [heading_model.begin(heading_rad, levels) for levels in CANDIDATES]
        self.sums, self.information = np.zeros(2 * LEVELS), np.zeros(LEVELS)
        self.window_s = self.rudder_rad_s = self.unexplained_s = 0.0
        self.innovation_square, self.unexplained_turns = 1.0, 0

    def update(self, t_s, heading_rad, rudder_rad):
        step_s, self.t_s = t_s - self.t_s, t_s
        self.motion, innovation, variance = self.correct(self.motion, self.levels, rudder_rad, step_s, heading_rad)
        square = innovation**2 / variance
        self.innovation_square += min(step_s / 60.0, 0.5) * (square - self.innovation_square)
        self.unexplained_s = self.unexplained_s + step_s if square > 9.0 else 0.0
        if self.unexplained_s > 2.0:
            self.motion, self.unexplained_s = heading_model.with_unexplained_turn(self.motion), 0.0
            self.unexplained_turns += 1
        self.rudder_rad_s += rudder_rad * step_s
        if t_s - self.learned_s >= 0.4:
            self.learn(t_s, t_s - self.learned_s, heading_rad)
            self.learned_s, self.rudder_rad_s = t_s, 0.0

    def correct(self, motion, levels, rudder_rad, step_s, heading_rad):
        motion = heading_model.predict(motion, levels, OCEAN_RAMBLER, rudder_rad, step_s)
        return heading_model.correct(motion, levels, heading_rad)

    def learn(self, t_s, step_s, heading_rad):
        age_s, likelihoods = t_s - self.begun_s, np.empty(2 * LEVELS)
        self.window_s += step_s
        for number in range(2 * LEVELS):
            levels = np.array(self.levels)
            levels[number // 2] += (-1) ** number * LEVEL_OFFSETS[number // 2]
            levels = CANDIDATES[number] if age_s < 60.0 else NoiseLevels(*levels)
            self.extra[number], innovation, variance = self.correct(
                self.extra[number], levels, self.rudder_rad_s / step_s, step_s, heading_rad
            )
            likelihoods[number] = heading_model.log_likelihood(innovation, variance)
        self.sums = self.sums + likelihoods
        if age_s < 60.0:
            if self.window_s >= 5.0:
                best = int(np.argmax(self.sums))
                self.motion, self.levels, self.window_s = self.extra[best], CANDIDATES[best], 0.0
        elif self.learned_s - self.begun_s < 60.0:
            self.extra, self.sums, self.window_s = [self.motion] * 12, np.zeros(2 * LEVELS), 0.0
        else:
            scores = (likelihoods[0::2] - likelihoods[1::2]) / (2.0 * LEVEL_OFFSETS)
            self.information = math.exp(-step_s / max(0.5 * age_s, 100.0)) * self.information + scores**2
            if self.window_s >= 15.0:
                self.move_levels(age_s)

    def move_levels(self, age_s):
        weights, forgotten = PRIOR_SDS**-2.0, 1.0 - math.exp(-self.window_s / max(0.5 * age_s, 100.0))
        score = (self.sums[0::2] - self.sums[1::2]) / (2.0 * LEVEL_OFFSETS)
        step = (score + forgotten * weights * (np.array(PRIOR) - np.array(self.levels))) / (self.information + weights)
        step *= min(MAX_LEVEL_STEP / np.abs(step).max(), 1.0)
        self.levels = NoiseLevels(*np.clip(np.array(self.levels) + step, MIN_LEVELS, MAX_LEVELS))
        self.sums, self.window_s = np.zeros(2 * LEVELS), 0.0


@pytest.mark.parametrize(("steps", "is_regular"), [(1400, False), (500, True)])
def test_filter_agrees_with_the_plain_filter_in_waves_turns_and_gaps(steps, is_regular):
    """At 115 s and 200 s the boat is turned by hand; later there is a gap of 40 s."""
    rng, t_s, heading_rad = np.random.default_rng(7), 3.0, 1.0
    f, plain = begin(t_s, heading_rad), PlainFilter(t_s, heading_rad)
    for number in range(steps):
        t_s += 40.0 if number == 1150 else 0.5 if is_regular else float(rng.uniform(0.05, 0.4))
        rudder_rad = 0.3 * math.sin(t_s / 11.0)
        heading_rad += 0.002 * math.cos(t_s / 9.0) + 0.02 * (115.0 < t_s < 120.0) - 0.06 * (200.0 < t_s < 209.0)
        wave_rad = 0.06 * math.sin(1.9 * t_s) * math.sin(0.05 * t_s) + 0.002 * float(rng.standard_normal())
        f = update(f, OCEAN_RAMBLER, t_s, wrap(heading_rad + wave_rad), rudder_rad)
        plain.update(t_s, wrap(heading_rad + wave_rad), rudder_rad)
        if number % 50 == 0 or number > 1350:
            assert f.levels == pytest.approx(plain.levels, rel=1e-9)
            assert f.motion == pytest.approx(plain.motion, rel=1e-6, abs=1e-12)
            assert f.innovation_square == pytest.approx(plain.innovation_square, rel=1e-9)
            assert f.learning.sums == pytest.approx(plain.sums, rel=1e-6, abs=1e-6)
            assert f.learning.motions == pytest.approx(np.array(plain.extra), rel=1e-6, abs=1e-9)
            assert f.learning.information == pytest.approx(plain.information, rel=1e-6)
    assert plain.unexplained_turns > 0
    assert np.abs(np.subtract(plain.levels, PRIOR)).max() > 0.5


@pytest.mark.parametrize("number", [0, 7, 11])
@pytest.mark.parametrize(("window_s", "is_chosen"), [(4.5, True), (4.4, False)])
def test_most_likely_candidate_replaces_the_filter_after_5_s(number, window_s, is_chosen):
    f = begin(0.0, 1.0)
    sums = np.zeros(2 * LEVELS)
    sums[number] = 1e3
    updated = update(
        f._replace(learning=f.learning._replace(sums=sums, window_s=window_s)), OCEAN_RAMBLER, 0.5, 1.1, 0.0
    )
    assert updated.levels == pytest.approx(CANDIDATES[number] if is_chosen else PRIOR)
    assert (updated.motion == heading_model.read_row(updated.learning.motions[number])) is is_chosen
    assert updated.learning.window_s == (0.0 if is_chosen else 4.9)


def test_sample_is_learned_from_0_4_s_after_the_last_one_on():
    f = begin(0.0, 1.0)
    for t_s, is_learned in ((0.39, False), (0.4, True)):
        updated = update(f, OCEAN_RAMBLER, t_s, 1.0, 0.25)
        assert (updated.learning.t_s == t_s) is is_learned
        assert updated.learning.rudder_rad_s == (0.0 if is_learned else 0.25 * t_s)


def test_rudder_angle_of_more_than_half_a_turn_is_not_measured():
    unknown = repr(update(LEARNING_FILTER, OCEAN_RAMBLER, 80.0, 1.0, math.nan))
    for rudder_rad, is_measured in ((math.pi, True), (-math.pi, True), (3.15, False), (-3.15, False)):
        assert (repr(update(LEARNING_FILTER, OCEAN_RAMBLER, 80.0, 1.0, rudder_rad)) != unknown) is is_measured


def test_extra_filters_start_again_from_another_motion():
    f = update_all(begin(0.0, 1.0), STEADY[:200])._replace(unexplained_s=1.0)
    f = f._replace(learning=f.learning._replace(window_s=3.0, rudder_rad_s=0.5))
    motion = f.motion._replace(heading_rad=2.0)
    moved = heading_filter.with_motion(f, 120.0, motion)
    assert [*moved.learning.motions] == [pytest.approx(motion)] * 12
    learning = f.learning._replace(motions=moved.learning.motions, t_s=120.0, rudder_rad_s=0.0)
    expected = f._replace(t_s=120.0, motion=motion, unexplained_s=0.0, learning=learning)
    assert repr(moved) == repr(expected)


def test_restarted_learning_begins_with_the_candidates_at_the_compass_heading():
    f = update_all(begin(0.0, 1.0), STEADY[:200])._replace(unexplained_s=1.0)
    restarted = heading_filter.with_learning_restarted(f)
    learning = begin(f.t_s, f.motion.heading_rad + f.motion.wave_rad).learning
    assert repr(restarted) == repr(f._replace(begun_s=f.t_s, learning=learning, unexplained_s=0.0))
    assert [*learning.motions] == [
        pytest.approx(heading_model.begin(f.motion.heading_rad + f.motion.wave_rad, levels)) for levels in CANDIDATES
    ]


@pytest.mark.parametrize(("age_s", "memory_s"), [(0.0, 100.0), (600.0, 300.0), (3600.0, 1800.0), (1e6, 1800.0)])
def test_memory_grows_with_the_age_within_its_limits(age_s, memory_s):
    assert heading_filter.memory_s(age_s) == memory_s


def sums_of(scores) -> np.ndarray:
    """Return the log-likelihood sums of a window that give these scores of the levels."""
    return np.column_stack([np.multiply(scores, LEVEL_OFFSETS), -np.multiply(scores, LEVEL_OFFSETS)]).ravel()


def test_window_changes_levels_within_step_limit_and_bounds():
    zero = np.zeros(LEVELS)
    result = heading_filter.scoring_step(PRIOR, zero, sums_of((100.0, 0.0, 0.0, 0.0, 0.0, -100.0)), 15.0, 100.0)
    changes = [new - old for new, old in zip(result, PRIOR, strict=True)]
    assert max(map(abs, changes)) == pytest.approx(MAX_LEVEL_STEP)
    assert changes[5] < 0.0 < changes[0]
    for bounds, sign in ((MIN_LEVELS, -1.0), (MAX_LEVELS, 1.0)):
        near = NoiseLevels(*(bound - 0.001 * sign for bound in bounds))
        result = heading_filter.scoring_step(near, zero, sums_of((900.0 * sign,) * LEVELS), 15.0, 100.0)
        assert result == pytest.approx(bounds, abs=1e-12)


@pytest.mark.parametrize("changes", [{"p00": math.nan}, {"p22": -1.0}, {"yaw_rate_rad_s": math.inf}])
def test_state_that_is_not_valid_restarts_the_filter(changes):
    f = LEARNING_FILTER._replace(motion=LEARNING_FILTER.motion._replace(**changes))
    assert repr(update(f, OCEAN_RAMBLER, 80.0, 2.0, 0.1)) == repr(begin(80.0, 2.0))


def test_rate_changes_only_the_motion():
    motion = LEARNING_FILTER.motion._replace(yaw_rate_rad_s=0.5)
    assert repr(heading_filter.with_rate(LEARNING_FILTER, motion)) == repr(LEARNING_FILTER._replace(motion=motion))
