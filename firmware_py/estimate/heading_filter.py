"""Heading filter that learns its noise levels. Numeric core; the model is heading_model.py.

Learning is recursive maximum likelihood (recursive prediction error method: Ljung and Soderstrom, Theory and Practice
of Recursive Identification, 1983). For each noise level there are two extra filters, with the logarithm of that level
changed by plus and minus LEVEL_OFFSETS. The difference of their log-likelihoods at each sample gives the score of the
level, the derivative of the log-likelihood. The sum of the squared scores, with a fading memory, is the information.
At the end of each window each level moves by

    (score of the window + share of the prior) / (information + 1 / PRIOR_SDS^2)

which is the scoring step of a maximum a posteriori estimate with the log-normal prior PRIOR, PRIOR_SDS and a fading
memory. The memory grows from MIN_MEMORY_S to MAX_MEMORY_S. The extra filters take at most one sample in
LEARNING_STEP_S, which resolves the waves.

The likelihood has local maxima if the waves are much larger or longer than those of the prior, or if the diffusion of
the heading is much larger. So in the first minute the twelve extra filters are twelve candidates of diffusion, wave yaw
and period, and the most likely one replaces the filter.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from firmware_py.common.angles import PI, clamp, radians, wrap_pi
from firmware_py.estimate import heading_model
from firmware_py.estimate.heading_model import ROW_LENGTH, Floats, Motion, NoiseLevels, read_row, write_row
from firmware_py.model.kt import KtModel

LEVELS = 6
# Mean and standard deviation of the prior of each logarithm, and its bounds. The mean is that of the recorded seas
# (docs/explanation/physics.md). The standard deviation of D is large because D is 0 in a tank.
PRIOR = NoiseLevels(
    math.log(radians(1.0) ** 2), math.log(radians(1.0)), math.log(2.8), math.log(0.2), math.log(radians(0.1)),
    math.log(radians(0.3)),
)  # fmt: skip
PRIOR_SDS = NoiseLevels(2.5, 1.0, 0.6, 0.5, 0.7, 1.0)
MIN_LEVELS = NoiseLevels(
    math.log(1e-5 * radians(1.0) ** 2), math.log(radians(0.02)), math.log(1.2), math.log(0.04), math.log(radians(0.01)),
    math.log(radians(0.003)),
)  # fmt: skip
MAX_LEVELS = NoiseLevels(
    math.log(60.0 * radians(1.0) ** 2), math.log(radians(40.0)), math.log(16.0), math.log(0.7), math.log(radians(3.0)),
    math.log(radians(6.0)),
)  # fmt: skip
# Offsets of the extra filters: small for the curvature of the likelihood, and large compared with rounding errors.
LEVEL_OFFSETS = NoiseLevels(0.3, 0.2, 0.05, 0.3, 0.4, 0.4)
MAX_LEVEL_STEP = 0.5  # of a logarithm, in a window
WINDOW_S = 15.0
MIN_MEMORY_S, MAX_MEMORY_S, MEMORY_SHARE = 100.0, 1800.0, 0.5  # share of the time since the start
LEARNING_STEP_S = 0.4
UNKNOWN_RUDDER_WALK = math.log(radians(2.0))  # lets the bias follow a rudder that is not measured
CANDIDATE_PHASE_S, CHOICE_INTERVAL_S = 60.0, 5.0
# Diffusion of the heading [deg^2/s], wave yaw [deg] and period [s] of the candidates. Small waves are short. Without
# the candidates of large diffusion, the filter would take a large diffusion for large waves, for hours.
CANDIDATES = (
    (1.0, 1.0, 2.2), (1.0, 1.0, 3.6), (8.0, 1.0, 2.2), (8.0, 1.0, 3.6),
    (1.0, 4.0, 2.2), (1.0, 4.0, 3.6), (1.0, 4.0, 6.0), (1.0, 4.0, 10.0),
    (1.0, 16.0, 2.2), (1.0, 16.0, 3.6), (1.0, 16.0, 6.0), (1.0, 16.0, 10.0),
)  # fmt: skip
# A turn is unexplained if the innovations exceed 3 standard deviations for UNEXPLAINED_S.
UNEXPLAINED_SQUARE, UNEXPLAINED_S = 9.0, 2.0
MAX_GAP_S = 600.0  # after a longer gap the filter restarts
MAX_SAMPLE_DELAY_S = 1.0  # a heading that is older than the state by more is ignored
AVERAGE_S = 60.0  # time constant of the mean squared innovation

FILTERS = 2 * LEVELS


class Learning(NamedTuple):
    """State of the extra filters; the arrays are never changed in place.

    `motions` (FILTERS, ROW_LENGTH): their states, two for each level, with the level raised and lowered, or the twelve
    candidates in the first minute. `sums` (FILTERS,): their log-likelihoods, summed over the first minute and later
    over the window, which has lasted `window_s`. `information` (LEVELS,): that of each level. `t_s`: time of the last
    sample used. `rudder_rad_s`: integral of the rudder angle since then.
    """

    motions: Floats = np.zeros((FILTERS, ROW_LENGTH))
    sums: Floats = np.zeros(FILTERS)
    information: Floats = np.zeros(LEVELS)
    window_s: float = 0.0
    t_s: float = math.nan
    rudder_rad_s: float = 0.0


class HeadingFilter(NamedTuple):
    """State of the filter at t_s, the time of the last heading; NaN: it has not started.

    `unexplained_s`: time for which the innovations have been too large. `innovation_square`: mean over about a minute
    of the squared innovation divided by its variance.
    """

    t_s: float = math.nan
    begun_s: float = math.nan
    motion: Motion = Motion()
    levels: NoiseLevels = PRIOR
    learning: Learning = Learning()
    unexplained_s: float = 0.0
    innovation_rad: float = 0.0
    innovation_sd_rad: float = 0.0
    innovation_square: float = 1.0


def candidate_levels(number: int) -> NoiseLevels:
    """Return the levels of a candidate of the first minute."""
    diffusion_deg2_s, wave_deg, period_s = CANDIDATES[number]
    return NoiseLevels(
        math.log(diffusion_deg2_s * radians(1.0) ** 2),
        math.log(radians(wave_deg)),
        math.log(period_s),
        PRIOR.wave_damping,
        PRIOR.compass_noise,
        PRIOR.bias_walk,
    )


def _initial_learning(t_s: float, heading_rad: float) -> Learning:
    """Return the learning state whose extra filters are the candidates at a heading."""
    motions = np.empty((FILTERS, ROW_LENGTH))
    for number in range(FILTERS):
        write_row(motions[number], heading_model.begin(heading_rad, candidate_levels(number)))
    return Learning(motions, np.zeros(FILTERS), np.zeros(LEVELS), 0.0, t_s, 0.0)


def _extra_filters_at(motion: Motion) -> Floats:
    """Return the array of extra filters, all at the same state."""
    motions = np.empty((FILTERS, ROW_LENGTH))
    for number in range(FILTERS):
        write_row(motions[number], motion)
    return motions


def begin(t_s: float, heading_rad: float) -> HeadingFilter:
    """Return the filter at its first heading."""
    motion, sd_rad = heading_model.begin(heading_rad, PRIOR), math.sqrt(heading_model.INITIAL_HEADING_VARIANCE)
    return HeadingFilter(t_s, t_s, motion, PRIOR, _initial_learning(t_s, heading_rad), 0.0, 0.0, sd_rad, 1.0)


def not_started() -> HeadingFilter:
    """Return the filter before its first heading."""
    motion, levels = heading_model.begin(0.0, PRIOR), PRIOR
    return HeadingFilter(math.nan, math.nan, motion, levels, _initial_learning(math.nan, 0.0), 0.0, 0.0, 0.0, 1.0)


def has_started(f: HeadingFilter) -> bool:
    """Return whether the filter has received a heading."""
    return not math.isnan(f.t_s)


def with_level_offset(levels: NoiseLevels, index: int, offset: float) -> NoiseLevels:
    """Return the levels with `offset` added to the level with this index."""
    return NoiseLevels(
        levels.diffusion + (offset if index == 0 else 0.0),
        levels.wave_sd + (offset if index == 1 else 0.0),
        levels.wave_period + (offset if index == 2 else 0.0),
        levels.wave_damping + (offset if index == 3 else 0.0),
        levels.compass_noise + (offset if index == 4 else 0.0),
        levels.bias_walk + (offset if index == 5 else 0.0),
    )


def levels_for(levels: NoiseLevels, rudder_rad: float) -> NoiseLevels:
    """Return the levels to use; with a larger walk of the bias if the rudder is not measured (NaN)."""
    if math.isfinite(rudder_rad) or levels.bias_walk >= UNKNOWN_RUDDER_WALK:
        return levels
    return with_level_offset(levels, 5, UNKNOWN_RUDDER_WALK - levels.bias_walk)


def memory_s(age_s: float) -> float:
    """Return the memory of the learning [s] at an age of the filter."""
    return clamp(MEMORY_SHARE * age_s, MIN_MEMORY_S, MAX_MEMORY_S)


def scoring_step(levels: NoiseLevels, information: Floats, sums: Floats, window_s: float, age_s: float) -> NoiseLevels:
    """Return the levels after the scoring step at the end of a window; the information matrix is diagonal."""
    step, max_step, forgotten = np.zeros(LEVELS), 0.0, 1.0 - math.exp(-window_s / memory_s(age_s))
    for i in range(LEVELS):
        weight = 1.0 / (PRIOR_SDS[i] * PRIOR_SDS[i])
        score = (sums[2 * i] - sums[2 * i + 1]) / (2.0 * LEVEL_OFFSETS[i]) + forgotten * weight * (PRIOR[i] - levels[i])
        step[i] = score / (information[i] + weight)
        max_step = max(max_step, abs(step[i]))
    scale = 1.0 if max_step <= MAX_LEVEL_STEP else MAX_LEVEL_STEP / max_step
    return NoiseLevels(
        clamp(levels.diffusion + scale * float(step[0]), MIN_LEVELS.diffusion, MAX_LEVELS.diffusion),
        clamp(levels.wave_sd + scale * float(step[1]), MIN_LEVELS.wave_sd, MAX_LEVELS.wave_sd),
        clamp(levels.wave_period + scale * float(step[2]), MIN_LEVELS.wave_period, MAX_LEVELS.wave_period),
        clamp(levels.wave_damping + scale * float(step[3]), MIN_LEVELS.wave_damping, MAX_LEVELS.wave_damping),
        clamp(levels.compass_noise + scale * float(step[4]), MIN_LEVELS.compass_noise, MAX_LEVELS.compass_noise),
        clamp(levels.bias_walk + scale * float(step[5]), MIN_LEVELS.bias_walk, MAX_LEVELS.bias_walk),
    )


def _update_extra_filters(
    motions: Floats,
    levels: NoiseLevels,
    is_choosing: bool,  # noqa: FBT001 - compiled
    model: KtModel,
    rudder_rad: float,
    step_s: float,
    heading_rad: float,
) -> Floats:
    """Update the extra filters (in place) or the candidates with a sample; return its log-likelihood in each."""
    likelihoods = np.empty(FILTERS)
    for number in range(FILTERS):
        offset = LEVEL_OFFSETS[number // 2] if number % 2 == 0 else -LEVEL_OFFSETS[number // 2]
        filter_levels = candidate_levels(number) if is_choosing else with_level_offset(levels, number // 2, offset)
        motion = heading_model.predict(read_row(motions[number]), filter_levels, model, rudder_rad, step_s)
        motion, innovation_rad, variance = heading_model.correct(motion, filter_levels, heading_rad)
        write_row(motions[number], motion)
        likelihoods[number] = heading_model.log_likelihood(innovation_rad, variance)
    return likelihoods


def _most_likely(sums: Floats) -> int:
    """Return the index of the largest sum, which is that of the most likely candidate."""
    best = 0
    for number in range(1, FILTERS):
        if sums[number] > sums[best]:
            best = number
    return best


def _learn(f: HeadingFilter, levels: NoiseLevels, model: KtModel, t_s: float, heading_rad: float) -> HeadingFilter:
    """Return the filter with its extra filters updated with a heading, and new levels at the end of a window."""
    previous, motions, information = f.learning, f.learning.motions.copy(), f.learning.information.copy()
    step_s, age_s = t_s - previous.t_s, t_s - f.begun_s
    is_choosing, window_s = age_s < CANDIDATE_PHASE_S, previous.window_s + step_s
    likelihoods = _update_extra_filters(
        motions, levels, is_choosing, model, previous.rudder_rad_s / step_s, step_s, heading_rad
    )
    sums, motion, levels = np.empty(FILTERS), f.motion, f.levels
    for number in range(FILTERS):
        sums[number] = previous.sums[number] + likelihoods[number]
    if is_choosing:
        if window_s >= CHOICE_INTERVAL_S:
            best, window_s = _most_likely(sums), 0.0
            motion, levels = read_row(motions[best]), candidate_levels(best)
    elif previous.t_s - f.begun_s < CANDIDATE_PHASE_S:
        # The candidate phase ends; the extra filters start at the state of the filter.
        motions, sums, window_s = _extra_filters_at(motion), np.zeros(FILTERS), 0.0
    else:
        decay = math.exp(-step_s / memory_s(age_s))
        for i in range(LEVELS):
            score = (likelihoods[2 * i] - likelihoods[2 * i + 1]) / (2.0 * LEVEL_OFFSETS[i])
            information[i] = decay * information[i] + score * score
        if window_s >= WINDOW_S:
            levels = scoring_step(levels, information, sums, window_s, age_s)
            sums, window_s = np.zeros(FILTERS), 0.0
    learning = Learning(motions, sums, information, window_s, t_s, 0.0)
    return HeadingFilter(
        f.t_s, f.begun_s, motion, levels, learning, f.unexplained_s, f.innovation_rad, f.innovation_sd_rad,
        f.innovation_square,
    )  # fmt: skip


def update(f: HeadingFilter, model: KtModel, t_s: float, heading_rad: float, rudder_rad: float) -> HeadingFilter:
    """Return the filter updated with a true heading.

    `rudder_rad` is the rudder angle measured since the previous heading; NaN: not measured. An angle of more than half
    a turn counts as not measured. A heading that is not finite, or too old, is ignored. The first heading, one after
    MAX_GAP_S, and a state that is not finite start the filter again.
    """
    heading_rad = wrap_pi(heading_rad)
    if not (math.isfinite(t_s) and math.isfinite(heading_rad)):
        return f
    step_s = t_s - f.t_s
    if not has_started(f) or step_s > MAX_GAP_S:
        return begin(t_s, heading_rad)
    if step_s < -MAX_SAMPLE_DELAY_S:
        return f
    angle_rad = rudder_rad if abs(rudder_rad) <= PI else math.nan
    levels, motion = levels_for(f.levels, angle_rad), f.motion
    angle_rad = 0.0 if math.isnan(angle_rad) else angle_rad
    if step_s > 0.0:
        motion = heading_model.predict(motion, levels, model, angle_rad, step_s)
    motion, innovation_rad, variance = heading_model.correct(motion, levels, heading_rad)
    square = innovation_rad * innovation_rad / variance
    unexplained_s = f.unexplained_s + max(step_s, 0.0) if square > UNEXPLAINED_SQUARE else 0.0
    if unexplained_s > UNEXPLAINED_S:
        unexplained_s, motion = 0.0, heading_model.with_unexplained_turn(motion)
    if not heading_model.is_valid(motion):
        return begin(t_s, heading_rad)
    gain, previous = clamp(step_s / AVERAGE_S, 0.0, 0.5), f.learning
    learning = Learning(
        previous.motions, previous.sums, previous.information, previous.window_s, previous.t_s,
        previous.rudder_rad_s + angle_rad * max(step_s, 0.0),
    )  # fmt: skip
    f = HeadingFilter(
        max(t_s, f.t_s), f.begun_s, motion, f.levels, learning, unexplained_s, innovation_rad, math.sqrt(variance),
        f.innovation_square + gain * (square - f.innovation_square),
    )  # fmt: skip
    return f if t_s - previous.t_s < LEARNING_STEP_S else _learn(f, levels, model, t_s, heading_rad)


def with_learning_restarted(f: HeadingFilter) -> HeadingFilter:
    """Return the filter with its learning restarted, as in the first minute; used when its levels are wrong."""
    learning = _initial_learning(f.t_s, f.motion.heading_rad + f.motion.wave_rad)
    return HeadingFilter(
        f.t_s, f.t_s, f.motion, f.levels, learning, 0.0, f.innovation_rad, f.innovation_sd_rad, f.innovation_square
    )


def with_rate(f: HeadingFilter, motion: Motion) -> HeadingFilter:
    """Return the filter with this motion, updated with a yaw rate; the noise levels are learned from headings only."""
    return HeadingFilter(
        f.t_s, f.begun_s, motion, f.levels, f.learning, f.unexplained_s, f.innovation_rad, f.innovation_sd_rad,
        f.innovation_square,
    )  # fmt: skip


def with_motion(f: HeadingFilter, t_s: float, motion: Motion) -> HeadingFilter:
    """Return the filter with this motion; the extra filters start again from it."""
    previous = f.learning
    learning = Learning(_extra_filters_at(motion), previous.sums, previous.information, previous.window_s, t_s, 0.0)
    return HeadingFilter(
        t_s, f.begun_s, motion, f.levels, learning, 0.0, f.innovation_rad, f.innovation_sd_rad, f.innovation_square
    )
