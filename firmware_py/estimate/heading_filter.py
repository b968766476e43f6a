"""Heading filter that learns its noise levels. Numeric core; the model is heading_model.py.

Learning is recursive maximum likelihood (recursive prediction error method: Ljung and Soderstrom, Theory and Practice
of Recursive Identification, 1983): beside the filter run two more per noise level, with the logarithm of that level
moved up and down by MOVES. The difference of their log-likelihoods, sample by sample, is the score (the derivative of
the log-likelihood) of that level; the sum of its outer products, with a memory, is the information matrix. Once in a
window all levels move by

    (information + 1 / SPREAD^2)^-1 (score of the window + share of the prior)

which is the scoring step of a maximum a posteriori estimate with the log-normal prior PRIOR, SPREAD and a fading
memory. The memory grows from a minute to half an hour. The extra filters take at most one sample in LEARNING_STEP_S,
which is enough for the waves of a boat.

The likelihood has local maxima where the waves are much larger or longer than those of the prior. So in the first
minute the twelve extra filters are twelve candidates of wave yaw and period, and the most likely one replaces the
filter.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.common.angles import PI, clamp, radians, wrap_pi
from firmware_py.estimate import heading_model
from firmware_py.estimate.heading_model import Motion, NoiseLevels
from firmware_py.model.kt import KtModel

LEVELS = 6
# Middle and standard deviation of the prior of each logarithm, and its bounds. The middle is that of the recorded seas
# (docs/explanation/physics.md); the spread of D is wide because it is 0 in a tank.
PRIOR = NoiseLevels(
    math.log(radians(1.0) ** 2), math.log(radians(1.0)), math.log(2.8), math.log(0.2), math.log(radians(0.1)),
    math.log(radians(0.3)),
)  # fmt: skip
SPREAD = NoiseLevels(2.5, 1.0, 0.6, 0.5, 0.7, 1.0)
LOWEST = NoiseLevels(
    math.log(1e-5 * radians(1.0) ** 2), math.log(radians(0.02)), math.log(1.2), math.log(0.04), math.log(radians(0.01)),
    math.log(radians(0.003)),
)  # fmt: skip
HIGHEST = NoiseLevels(
    math.log(60.0 * radians(1.0) ** 2), math.log(radians(40.0)), math.log(16.0), math.log(0.7), math.log(radians(3.0)),
    math.log(radians(6.0)),
)  # fmt: skip
# By so much the extra filters differ: less than a likelihood bends within, more than rounding.
MOVES = NoiseLevels(0.3, 0.2, 0.05, 0.3, 0.4, 0.4)
LONGEST_MOVE = 0.5  # of any logarithm in a window
WINDOW_S = 15.0
SHORTEST_MEMORY_S, LONGEST_MEMORY_S, MEMORY_SHARE = 100.0, 1800.0, 0.5  # of the time since the start
LEARNING_STEP_S = 0.4
UNKNOWN_RUDDER_WALK = math.log(radians(2.0))  # the bias follows a rudder that is not measured
FIRST_S, CHOICE_S = 60.0, 5.0
CANDIDATE_SDS_RAD = (radians(1.0), radians(4.0), radians(16.0))
CANDIDATE_PERIODS_S = (2.2, 3.6, 6.0, 10.0)
# A turn is unexplained when the innovations stay beyond 3 standard deviations for so long.
UNEXPLAINED, UNEXPLAINED_S = 9.0, 2.0
LONGEST_GAP_S = 600.0  # after it the filter starts again
LATEST_S = 1.0  # a heading that is older than the state by more is not taken
AVERAGE_S = 60.0


class Pair(NamedTuple):
    """The two extra filters of a noise level: with the level moved up and down."""

    up: Motion = Motion()
    down: Motion = Motion()


Six = tuple[float, float, float, float, float, float]
Pairs = tuple[Pair, Pair, Pair, Pair, Pair, Pair]
NO_PAIRS: Final = (Pair(), Pair(), Pair(), Pair(), Pair(), Pair())
ZEROS: Final = (0.0,) * 6
CANDIDATES: Final = (0.0,) * 12
TRIANGLE: Final = (0.0,) * 21


class HeadingFilter(NamedTuple):
    """State of the filter at the heading of time t_s.

    `pairs` belong to the six levels, or to the twelve candidates in the first minute, of which `likelihoods` are the
    sums. `information` is the upper triangle, row by row, `score` the sum of the window. `taught_s` is the time of the
    last sample of the extra filters, `rudder_rad_s` the integral of the rudder angle since, `unexplained_s` how long
    the innovations have been too large. `innovation_square` is the mean of the squared innovations by their variance
    over about a minute. A filter that has not started has NaN for its time.
    """

    t_s: float = math.nan
    begun_s: float = math.nan
    motion: Motion = Motion()
    levels: NoiseLevels = PRIOR
    pairs: Pairs = NO_PAIRS
    likelihoods: tuple[float, ...] = CANDIDATES
    information: tuple[float, ...] = TRIANGLE
    score: Six = ZEROS
    window_s: float = 0.0
    taught_s: float = math.nan
    rudder_rad_s: float = 0.0
    unexplained_s: float = 0.0
    innovation_rad: float = 0.0
    innovation_sd_rad: float = 0.0
    innovation_square: float = 1.0


def candidate(number: int) -> NoiseLevels:
    """Return the levels of a candidate of the first minute."""
    return NoiseLevels(
        PRIOR.diffusion,
        math.log(CANDIDATE_SDS_RAD[number % 3]),
        math.log(CANDIDATE_PERIODS_S[number // 3]),
        PRIOR.wave_damping,
        PRIOR.compass_noise,
        PRIOR.bias_walk,
    )


def _candidates(number: int, heading_rad: float) -> Pair:
    first, second = candidate(2 * number), candidate(2 * number + 1)
    return Pair(heading_model.begin(heading_rad, first), heading_model.begin(heading_rad, second))


def begin(t_s: float, heading_rad: float) -> HeadingFilter:
    """Return the filter at its first heading."""
    return HeadingFilter(
        t_s,
        t_s,
        heading_model.begin(heading_rad, PRIOR),
        PRIOR,
        (
            _candidates(0, heading_rad), _candidates(1, heading_rad), _candidates(2, heading_rad),
            _candidates(3, heading_rad), _candidates(4, heading_rad), _candidates(5, heading_rad),
        ),
        CANDIDATES, TRIANGLE, ZEROS, 0.0, t_s, 0.0, 0.0, 0.0, math.sqrt(heading_model.FIRST_HEADING_VARIANCE), 1.0,
    )  # fmt: skip


NOT_STARTED: Final = HeadingFilter()


def has_started(f: HeadingFilter) -> bool:
    """Return whether the filter has had a heading."""
    return not math.isnan(f.t_s)


def moved(levels: NoiseLevels, place: int, by: float) -> NoiseLevels:
    """Return the levels with the one at that place moved by so much."""
    return NoiseLevels(
        levels.diffusion + (by if place == 0 else 0.0),
        levels.wave_sd + (by if place == 1 else 0.0),
        levels.wave_period + (by if place == 2 else 0.0),
        levels.wave_damping + (by if place == 3 else 0.0),
        levels.compass_noise + (by if place == 4 else 0.0),
        levels.bias_walk + (by if place == 5 else 0.0),
    )


def levels_for(levels: NoiseLevels, rudder_rad: float) -> NoiseLevels:
    """Return the levels to filter by: the bias has to follow a rudder that is not measured (NaN)."""
    if math.isfinite(rudder_rad) or levels.bias_walk >= UNKNOWN_RUDDER_WALK:
        return levels
    return moved(levels, 5, UNKNOWN_RUDDER_WALK - levels.bias_walk)


def _extra(
    m: Motion, levels: NoiseLevels, model: KtModel, rudder_rad: float, step_s: float, heading_rad: float
) -> tuple[Motion, float]:
    """Return an extra filter with a sample taken in, and the log-likelihood of the sample."""
    predicted = heading_model.predict(m, levels, model, rudder_rad, step_s)
    corrected, innovation_rad, variance = heading_model.correct(predicted, levels, heading_rad)
    return corrected, heading_model.log_likelihood(innovation_rad, variance)


def _scored(
    pair: Pair, levels: NoiseLevels, place: int, model: KtModel, rudder_rad: float, step_s: float, heading_rad: float
) -> tuple[Pair, float]:
    """Return the pair of a level with a sample taken in, and the score of the level."""
    by = MOVES[place]
    up, above = _extra(pair.up, moved(levels, place, by), model, rudder_rad, step_s, heading_rad)
    down, below = _extra(pair.down, moved(levels, place, -by), model, rudder_rad, step_s, heading_rad)
    return Pair(up, down), (above - below) / (2.0 * by)


def _tried(
    pair: Pair, number: int, model: KtModel, rudder_rad: float, step_s: float, heading_rad: float
) -> tuple[Pair, float, float]:
    """Return two candidates with a sample taken in, and the log-likelihoods of the sample."""
    up, first = _extra(pair.up, candidate(2 * number), model, rudder_rad, step_s, heading_rad)
    down, second = _extra(pair.down, candidate(2 * number + 1), model, rudder_rad, step_s, heading_rad)
    return Pair(up, down), first, second


def memory_s(age_s: float) -> float:
    """Return the memory of the learning after so long."""
    return clamp(MEMORY_SHARE * age_s, SHORTEST_MEMORY_S, LONGEST_MEMORY_S)


def solved(matrix: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve a symmetric positive definite system by elimination without pivoting; both arguments are overwritten."""
    n = right.shape[0]
    for i in range(n):
        for k in range(i + 1, n):
            factor = matrix[k, i] / matrix[i, i]
            for j in range(i, n):
                matrix[k, j] -= factor * matrix[i, j]
            right[k] -= factor * right[i]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            right[i] -= matrix[i, j] * right[j]
        right[i] /= matrix[i, i]
    return right


def stepped(
    levels: NoiseLevels, information: tuple[float, ...], score: tuple[float, ...], window_s: float, age_s: float
) -> NoiseLevels:
    """Return the levels after the scoring step of a window."""
    matrix, right, entry = np.zeros((LEVELS, LEVELS)), np.zeros(LEVELS), 0
    share = 1.0 - math.exp(-window_s / memory_s(age_s))
    for i in range(LEVELS):
        weight = 1.0 / (SPREAD[i] * SPREAD[i])
        right[i] = score[i] + share * weight * (PRIOR[i] - levels[i])
        for j in range(i, LEVELS):
            matrix[i, j] = matrix[j, i] = information[entry]
            entry += 1
        matrix[i, i] += weight
    step = solved(matrix, right)
    largest = 0.0
    for i in range(LEVELS):
        largest = max(largest, abs(float(step[i])))
    by = 1.0 if largest <= LONGEST_MOVE else LONGEST_MOVE / largest
    return NoiseLevels(
        clamp(levels.diffusion + by * float(step[0]), LOWEST.diffusion, HIGHEST.diffusion),
        clamp(levels.wave_sd + by * float(step[1]), LOWEST.wave_sd, HIGHEST.wave_sd),
        clamp(levels.wave_period + by * float(step[2]), LOWEST.wave_period, HIGHEST.wave_period),
        clamp(levels.wave_damping + by * float(step[3]), LOWEST.wave_damping, HIGHEST.wave_damping),
        clamp(levels.compass_noise + by * float(step[4]), LOWEST.compass_noise, HIGHEST.compass_noise),
        clamp(levels.bias_walk + by * float(step[5]), LOWEST.bias_walk, HIGHEST.bias_walk),
    )


def _try_candidates(
    f: HeadingFilter, model: KtModel, t_s: float, heading_rad: float, rudder_rad: float
) -> HeadingFilter:
    """Take a sample into the candidates of the first minute; the best one replaces the filter once in a window."""
    step_s = t_s - f.taught_s
    p0, a0, b0 = _tried(f.pairs[0], 0, model, rudder_rad, step_s, heading_rad)
    p1, a1, b1 = _tried(f.pairs[1], 1, model, rudder_rad, step_s, heading_rad)
    p2, a2, b2 = _tried(f.pairs[2], 2, model, rudder_rad, step_s, heading_rad)
    p3, a3, b3 = _tried(f.pairs[3], 3, model, rudder_rad, step_s, heading_rad)
    p4, a4, b4 = _tried(f.pairs[4], 4, model, rudder_rad, step_s, heading_rad)
    p5, a5, b5 = _tried(f.pairs[5], 5, model, rudder_rad, step_s, heading_rad)
    pairs, old = (p0, p1, p2, p3, p4, p5), f.likelihoods
    sums = (
        old[0] + a0, old[1] + b0, old[2] + a1, old[3] + b1, old[4] + a2, old[5] + b2,
        old[6] + a3, old[7] + b3, old[8] + a4, old[9] + b4, old[10] + a5, old[11] + b5,
    )  # fmt: skip
    motion, levels, window_s = f.motion, f.levels, f.window_s + step_s
    if window_s >= CHOICE_S:
        window_s, best = 0.0, 0
        for number in range(1, 2 * LEVELS):
            if sums[number] > sums[best]:
                best = number
        pair = pairs[best // 2]
        motion, levels = pair.up if best % 2 == 0 else pair.down, candidate(best)
        if t_s - f.begun_s + CHOICE_S > FIRST_S:
            same = Pair(motion, motion)
            pairs = (same, same, same, same, same, same)
    return HeadingFilter(
        f.t_s, f.begun_s, motion, levels, pairs, sums, f.information, f.score, window_s, t_s, 0.0, f.unexplained_s,
        f.innovation_rad, f.innovation_sd_rad, f.innovation_square,
    )  # fmt: skip


def _learn(
    f: HeadingFilter, levels: NoiseLevels, model: KtModel, t_s: float, heading_rad: float, rudder_rad: float
) -> HeadingFilter:
    """Take a sample into the extra filters around levels, and move those of the filter at the end of a window."""
    step_s = t_s - f.taught_s
    p0, s0 = _scored(f.pairs[0], levels, 0, model, rudder_rad, step_s, heading_rad)
    p1, s1 = _scored(f.pairs[1], levels, 1, model, rudder_rad, step_s, heading_rad)
    p2, s2 = _scored(f.pairs[2], levels, 2, model, rudder_rad, step_s, heading_rad)
    p3, s3 = _scored(f.pairs[3], levels, 3, model, rudder_rad, step_s, heading_rad)
    p4, s4 = _scored(f.pairs[4], levels, 4, model, rudder_rad, step_s, heading_rad)
    p5, s5 = _scored(f.pairs[5], levels, 5, model, rudder_rad, step_s, heading_rad)
    age_s, old = t_s - f.begun_s, f.information
    keep = math.exp(-step_s / memory_s(age_s))
    information = (
        keep * old[0] + s0 * s0, keep * old[1] + s0 * s1, keep * old[2] + s0 * s2, keep * old[3] + s0 * s3,
        keep * old[4] + s0 * s4, keep * old[5] + s0 * s5,
        keep * old[6] + s1 * s1, keep * old[7] + s1 * s2, keep * old[8] + s1 * s3, keep * old[9] + s1 * s4,
        keep * old[10] + s1 * s5,
        keep * old[11] + s2 * s2, keep * old[12] + s2 * s3, keep * old[13] + s2 * s4, keep * old[14] + s2 * s5,
        keep * old[15] + s3 * s3, keep * old[16] + s3 * s4, keep * old[17] + s3 * s5,
        keep * old[18] + s4 * s4, keep * old[19] + s4 * s5,
        keep * old[20] + s5 * s5,
    )  # fmt: skip
    total = f.score
    score = (total[0] + s0, total[1] + s1, total[2] + s2, total[3] + s3, total[4] + s4, total[5] + s5)
    levels, window_s = f.levels, f.window_s + step_s
    if window_s >= WINDOW_S:
        levels = stepped(levels, information, score, window_s, age_s)
        score, window_s = ZEROS, 0.0
    return HeadingFilter(
        f.t_s, f.begun_s, f.motion, levels, (p0, p1, p2, p3, p4, p5), f.likelihoods, information, score, window_s, t_s,
        0.0, f.unexplained_s, f.innovation_rad, f.innovation_sd_rad, f.innovation_square,
    )  # fmt: skip


def update(f: HeadingFilter, model: KtModel, t_s: float, heading_rad: float, rudder_rad: float) -> HeadingFilter:
    """Return the filter with one true heading taken in.

    rudder_rad is the measured rudder angle since the heading before, NaN where it is not measured; an angle beyond a
    half turn is not taken. A heading that is not finite, or late, changes nothing; the first one, one after a long
    silence, and a state that is not finite start the filter again.
    """
    heading_rad = wrap_pi(heading_rad)
    if not (math.isfinite(t_s) and math.isfinite(heading_rad)):
        return f
    step_s = t_s - f.t_s
    if not has_started(f) or step_s > LONGEST_GAP_S:
        return begin(t_s, heading_rad)
    if step_s < -LATEST_S:
        return f
    angle_rad = rudder_rad if abs(rudder_rad) <= PI else math.nan
    levels, motion = levels_for(f.levels, angle_rad), f.motion
    angle_rad = 0.0 if math.isnan(angle_rad) else angle_rad
    if step_s > 0.0:
        motion = heading_model.predict(motion, levels, model, angle_rad, step_s)
    motion, innovation_rad, variance = heading_model.correct(motion, levels, heading_rad)
    square = innovation_rad * innovation_rad / variance
    unexplained_s = f.unexplained_s + max(step_s, 0.0) if square > UNEXPLAINED else 0.0
    if unexplained_s > UNEXPLAINED_S:
        unexplained_s, motion = 0.0, heading_model.with_unexplained_turn(motion)
    if not heading_model.is_valid(motion):
        return begin(t_s, heading_rad)
    share = clamp(step_s / AVERAGE_S, 0.0, 0.5)
    f = HeadingFilter(
        max(t_s, f.t_s), f.begun_s, motion, f.levels, f.pairs, f.likelihoods, f.information, f.score, f.window_s,
        f.taught_s, f.rudder_rad_s + angle_rad * max(step_s, 0.0), unexplained_s, innovation_rad, math.sqrt(variance),
        f.innovation_square + share * (square - f.innovation_square),
    )  # fmt: skip
    since_s = t_s - f.taught_s
    if since_s < LEARNING_STEP_S:
        return f
    mean_rad = f.rudder_rad_s / since_s
    if t_s - f.begun_s < FIRST_S:
        return _try_candidates(f, model, t_s, heading_rad, mean_rad)
    return _learn(f, levels, model, t_s, heading_rad, mean_rad)


def correct_course(
    f: HeadingFilter, model: KtModel, t_s: float, heading_rad: float, sd_rad: float, rudder_rad: float
) -> HeadingFilter:
    """Return a filter that has started with a heading from the track taken in; nothing is learned of it."""
    step_s = t_s - f.t_s
    if not (0.0 < step_s <= LONGEST_GAP_S and math.isfinite(heading_rad) and sd_rad > 0.0):
        return f
    motion = heading_model.predict(f.motion, f.levels, model, rudder_rad, step_s)
    return with_motion(f, t_s, heading_model.correct_course(motion, heading_rad, sd_rad))


def relearned(f: HeadingFilter) -> HeadingFilter:
    """Return the filter with its learning started again, as in the first minute, because its levels fit no more."""
    heading_rad = f.motion.heading_rad + f.motion.wave_rad
    pairs = (
        _candidates(0, heading_rad), _candidates(1, heading_rad), _candidates(2, heading_rad),
        _candidates(3, heading_rad), _candidates(4, heading_rad), _candidates(5, heading_rad),
    )  # fmt: skip
    return HeadingFilter(
        f.t_s,
        f.t_s,
        f.motion,
        f.levels,
        pairs,
        CANDIDATES,
        TRIANGLE,
        ZEROS,
        0.0,
        f.t_s,
        0.0,
        0.0,
        f.innovation_rad,
        f.innovation_sd_rad,
        f.innovation_square,
    )


def with_motion(f: HeadingFilter, t_s: float, motion: Motion) -> HeadingFilter:
    """Return the filter with another state; the extra filters start again from it."""
    same = Pair(motion, motion)
    return HeadingFilter(
        t_s, f.begun_s, motion, f.levels, (same, same, same, same, same, same), f.likelihoods, f.information, f.score,
        f.window_s, t_s, 0.0, 0.0, f.innovation_rad, f.innovation_sd_rad, f.innovation_square,
    )  # fmt: skip
