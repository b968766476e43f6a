"""Water filter: speed through the water, sideways speed and current, from positions and the heading.

Numeric core: functions without I/O over floats and small arrays; NaN: absent. Python runs this code on the boat, and
the laboratory compiles it unchanged (hil/lab/numeric_core.py).

State vector, 7: speed deviation s, mean speed U and sideways speed V (to starboard) through the water, current c_N and
c_E over the ground [m/s], position p_N and p_E [m]. With C and S, the means of cosine and sine of the heading:

    ds = -s / tau dt + sigma sqrt(2 / tau) dB1         dU = MEAN_WALK dB2        dV = SIDEWAYS_WALK dB3       dc = q dB4
    dp_N = ((s + U) C - V S + c_N) dt + g dB5          dp_E = ((s + U) S + V C + c_E) dt + g dB6

The model is linear, because leeway is not a state: it is atan2(V, U). Measurement: a position, at most one in
MIN_INTERVAL_S, with white noise of standard deviation rho in each axis, which includes orbital motion and receiver
noise. The velocity of the receiver is not used, because receivers smooth it with an unknown lag.

Levels, 4, as natural logarithms: sigma, q, g, rho. They are learned by recursive maximum likelihood. There are four
extra filters, each with one level raised by LEVEL_OFFSET. The differences of their log-likelihoods give the scores. The
information is the sum of the squared scores, with a memory of MEMORY_S, and the information of the prior. At each
position a level changes by score / information (Ljung and Soderstrom, Theory and Practice of Recursive Identification,
1983, ch. 3).

Outliers: beyond HUBER_SQUARE (squared Mahalanobis distance) a position has less weight (Huber, Robust Statistics,
1981), and beyond GATE_SQUARE none. After REJECTION_TIME_S without an accepted position the filter restarts its position
and keeps speed and current.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.common.angles import clamp

Floats = NDArray[np.float64]

MIN_INTERVAL_S: Final = 4.5  # between two positions that are used, because receiver noise is correlated for seconds
MEMORY_S: Final = 3600.0  # of the information
LEVEL_OFFSET: Final = 0.02
MAX_LEVEL_STEP: Final = 0.2  # of a logarithm, at one position
# Mean, standard deviation and bounds of the logarithms: sigma [m/s], q [m/s/sqrt(s)], g [m/sqrt(s)], rho [m].
# The mean of g is for a receiver error of 1 m with a memory of 60 s: sqrt(2 / 60) m/sqrt(s).
PRIOR_LEVELS: Final = (math.log(0.1), math.log(0.0004), math.log(0.15), math.log(0.3))
PRIOR_SDS: Final = (0.7, 0.7, 1.0, 1.0)
MIN_LEVELS: Final = (math.log(0.01), math.log(0.0001), math.log(0.001), math.log(0.02))
MAX_LEVELS: Final = (math.log(0.5), math.log(0.005), math.log(1.0), math.log(20.0))
SPEED_MEMORY_S: Final = 30.0  # tau
MEAN_WALK: Final = 0.001  # m/s/sqrt(s)
SIDEWAYS_WALK: Final = 0.0005  # m/s/sqrt(s)
HUBER_SQUARE: Final = 9.0  # exceeded by 1.1 % of the positions (chi-square with 2 degrees of freedom)
GATE_SQUARE: Final = 25.0  # exceeded by 4e-6 of the positions
GATE_SD_M: Final = 3.0  # added in each axis for the gate, because rho is not yet learned at first
REJECTION_TIME_S: Final = 30.0
MIN_SPEED_M_S: Final = 0.02  # below it the leeway is undefined
MIN_DETERMINANT_M4: Final = 1e-8  # of the innovation covariance; with the lowest rho it is 1.6e-7
MIN_KNOWN_SHARE: Final = 0.9  # share of the time between two positions in which the heading must be known
SUBSTEP_S: Final = 30.0
MAX_SUBSTEPS: Final = 20.0  # a longer interval has longer substeps
MAX_GAP_S: Final = 86400.0


LEVELS, FILTERS, STATES = 4, 5, 7
SPEED, MEAN_SPEED, SIDEWAYS, CURRENT_NORTH, CURRENT_EAST, NORTH, EAST = range(STATES)


class WaterFilter(NamedTuple):
    """Time of the last position, state of the filter and the extra filters, levels and information.

    `means` (FILTERS, STATES) and `covariances` (FILTERS, STATES, STATES): the filter in row 0, then an extra filter for
    each level. `levels` and `information` are (LEVELS,). The arrays are never changed in place.
    `cosine_s` and `sine_s` are the integrals of the heading's cosine and sine since t_s, over `known_s` seconds.
    `refused_t_s` is the time of the first of the rejected positions; NaN: the last one was used.
    """

    t_s: float = math.nan
    cosine_s: float = 0.0
    sine_s: float = 0.0
    known_s: float = 0.0
    refused_t_s: float = math.nan
    means: Floats = np.zeros((FILTERS, STATES))
    covariances: Floats = np.zeros((FILTERS, STATES, STATES))
    levels: Floats = np.array(PRIOR_LEVELS)
    information: Floats = np.zeros(LEVELS)


class Water(NamedTuple):
    """Speed (mean and deviation), mean speed, sideways speed, leeway and current, with their standard deviations.

    `covariance`: upper triangle, row by row, for current north and east, mean speed and sideways speed.
    `current_sd_m_s` is that of the direction in which it is largest.
    """

    speed_m_s: float
    speed_sd_m_s: float
    mean_speed_m_s: float
    mean_speed_sd_m_s: float
    sideways_m_s: float
    sideways_sd_m_s: float
    leeway_rad: float
    leeway_sd_rad: float
    current_north_m_s: float
    current_east_m_s: float
    current_sd_m_s: float
    covariance: tuple[float, float, float, float, float, float, float, float, float, float]


def decay_speed_deviation(x: Floats, p: Floats, keep: float) -> None:
    """Multiply the speed deviation by `keep`, in mean x (STATES,) and covariance p (STATES, STATES), in place."""
    x[SPEED] *= keep
    for j in range(STATES):
        p[SPEED, j] *= keep
        p[j, SPEED] *= keep


def apply_transition(x: Floats, p: Floats, step_s: float, cosine: float, sine: float) -> None:
    """Replace mean x (STATES,) and covariance p (STATES, STATES) by F x and F p F', in place, with F of a step."""
    keep = math.exp(-step_s / SPEED_MEMORY_S)
    deviation_s = SPEED_MEMORY_S * (1.0 - keep)  # time integral of the decaying deviation
    for axis, along, across in ((NORTH, cosine, -sine), (EAST, sine, cosine)):
        current = CURRENT_NORTH if axis == NORTH else CURRENT_EAST
        for source, factor_s in (
            (SPEED, deviation_s * along), (MEAN_SPEED, step_s * along), (SIDEWAYS, step_s * across), (current, step_s),
        ):  # fmt: skip
            x[axis] += factor_s * x[source]
            for j in range(STATES):
                p[axis, j] += factor_s * p[source, j]
            for j in range(STATES):
                p[j, axis] += factor_s * p[j, source]
    decay_speed_deviation(x, p, keep)


def add_noise(p: Floats, levels: Floats, step_s: float, cosine: float, sine: float) -> None:
    """Add the process noise of a step to a covariance, in place; exact for the speed deviation and its integral."""
    keep, sigma, walk = math.exp(-step_s / SPEED_MEMORY_S), math.exp(levels[0]), math.exp(levels[1])
    p[SPEED, SPEED] += sigma * sigma * (1.0 - keep * keep)
    p[MEAN_SPEED, MEAN_SPEED] += MEAN_WALK * MEAN_WALK * step_s
    p[SIDEWAYS, SIDEWAYS] += SIDEWAYS_WALK * SIDEWAYS_WALK * step_s
    p[CURRENT_NORTH, CURRENT_NORTH] += walk * walk * step_s
    p[CURRENT_EAST, CURRENT_EAST] += walk * walk * step_s
    if math.isnan(cosine):
        return
    speed_rate, drift = sigma * sigma * SPEED_MEMORY_S, math.exp(levels[2])
    cross_variance = speed_rate * (1.0 - keep) * (1.0 - keep)
    way_variance = max(speed_rate * (2.0 * step_s - SPEED_MEMORY_S * (3.0 - 4.0 * keep + keep * keep)), 0.0)
    p[NORTH, NORTH] += way_variance * cosine * cosine + drift * drift * step_s
    p[EAST, EAST] += way_variance * sine * sine + drift * drift * step_s
    for i, k, covariance in (
        (SPEED, NORTH, cross_variance * cosine),
        (SPEED, EAST, cross_variance * sine),
        (NORTH, EAST, way_variance * cosine * sine),
    ):
        p[i, k] += covariance
        p[k, i] += covariance


def predict(x: Floats, p: Floats, levels: Floats, step_s: float, cosine: float, sine: float) -> None:
    """Predict mean (STATES,) and covariance (STATES, STATES) over step_s, in place; cosine NaN: heading not known.

    Without a heading the direction of the motion is not known, so the position is no longer correlated with the water.
    """
    if math.isnan(cosine):
        keep, speed_m_s = math.exp(-step_s / SPEED_MEMORY_S), x[MEAN_SPEED] + x[SPEED]
        variance = 0.5 * (speed_m_s * speed_m_s + p[SPEED, SPEED] + p[MEAN_SPEED, MEAN_SPEED] + p[SIDEWAYS, SIDEWAYS])
        for i, current in ((NORTH, CURRENT_NORTH), (EAST, CURRENT_EAST)):
            x[i] += step_s * x[current]
            for j in range(NORTH):
                p[i, j] = p[j, i] = 0.0
            p[i, i] += step_s * step_s * (variance + p[current, current])
        decay_speed_deviation(x, p, keep)
        add_noise(p, levels, step_s, cosine, sine)
        return
    remaining_s, substep_s = step_s, max(SUBSTEP_S, step_s / MAX_SUBSTEPS)
    while remaining_s > 0.0:
        part_s = min(remaining_s, substep_s)
        apply_transition(x, p, part_s, cosine, sine)
        add_noise(p, levels, part_s, cosine, sine)
        remaining_s -= substep_s


def squared_distance(x: Floats, p: Floats, north_m: float, east_m: float, noise_m2: float) -> tuple[float, float]:
    """Return the squared Mahalanobis distance of a position, and the determinant of the innovation covariance."""
    a, b, c = float(p[NORTH, NORTH]) + noise_m2, float(p[NORTH, EAST]), float(p[EAST, EAST]) + noise_m2
    north_error_m, east_error_m = north_m - float(x[NORTH]), east_m - float(x[EAST])
    determinant = max(a * c - b * b, MIN_DETERMINANT_M4)
    square = (
        c * north_error_m * north_error_m - 2.0 * b * north_error_m * east_error_m + a * east_error_m * east_error_m
    )
    return square / determinant, determinant


def update_state(x: Floats, p: Floats, levels: Floats, north_m: float, east_m: float) -> float:
    """Update mean (STATES,) and covariance (STATES, STATES) with a position, in place; return its log-likelihood."""
    noise_m2 = math.exp(2.0 * levels[3])
    d2, determinant = squared_distance(x, p, north_m, east_m, noise_m2)
    likelihood = -0.5 * math.log(determinant)
    if d2 > HUBER_SQUARE:
        likelihood -= math.sqrt(HUBER_SQUARE * d2) - 0.5 * HUBER_SQUARE
        noise_m2 += (p[NORTH, NORTH] + p[EAST, EAST] + 2.0 * noise_m2) * 0.5 * (math.sqrt(d2 / HUBER_SQUARE) - 1.0)
        _, determinant = squared_distance(x, p, north_m, east_m, noise_m2)
    else:
        likelihood -= 0.5 * d2
    a, b, c = (p[EAST, EAST] + noise_m2) / determinant, -p[NORTH, EAST] / determinant, (p[NORTH, NORTH] + noise_m2)
    c /= determinant
    north_innovation_m, east_innovation_m = north_m - x[NORTH], east_m - x[EAST]
    north_column, east_column = np.empty(STATES), np.empty(STATES)
    for i in range(STATES):
        north_column[i], east_column[i] = p[i, NORTH], p[i, EAST]
    for i in range(STATES):
        gain_north, gain_east = a * north_column[i] + b * east_column[i], b * north_column[i] + c * east_column[i]
        x[i] += gain_north * north_innovation_m + gain_east * east_innovation_m
        for j in range(i, STATES):
            p[i, j] -= gain_north * north_column[j] + gain_east * east_column[j]
            p[j, i] = p[i, j]
    return likelihood


def restart_position(x: Floats, p: Floats, north_m: float, east_m: float) -> None:
    """Set the position and its variance, in place; speed and current stay the same."""
    x[NORTH], x[EAST] = north_m, east_m
    for i in (NORTH, EAST):
        for j in range(STATES):
            p[i, j] = p[j, i] = GATE_SD_M * GATE_SD_M if i == j else 0.0


def begin(
    t_s: float,
    north_m: float,
    east_m: float,
    speed_m_s: float,
    speed_sd_m_s: float,
    current_north_m_s: float,
    current_east_m_s: float,
    current_sd_m_s: float,
    sideways_m_s: float,
    sideways_sd_m_s: float,
) -> WaterFilter:
    """Return the state at the first position, with the expected values and their standard deviations."""
    means, covariances = np.zeros((FILTERS, STATES)), np.zeros((FILTERS, STATES, STATES))
    levels, information = np.empty(LEVELS), np.empty(LEVELS)
    for i in range(LEVELS):
        levels[i], information[i] = PRIOR_LEVELS[i], 1.0 / (PRIOR_SDS[i] * PRIOR_SDS[i])
    mean = (0.0, speed_m_s, sideways_m_s, current_north_m_s, current_east_m_s, north_m, east_m)
    position_sd_m, deviation_sd_m_s = math.exp(levels[3]), math.exp(levels[0])
    sds = (
        deviation_sd_m_s,
        speed_sd_m_s,
        sideways_sd_m_s,
        current_sd_m_s,
        current_sd_m_s,
        position_sd_m,
        position_sd_m,
    )
    for number in range(FILTERS):
        for i in range(STATES):
            means[number, i], covariances[number, i, i] = mean[i], sds[i] * sds[i]
    return WaterFilter(t_s, 0.0, 0.0, 0.0, math.nan, means, covariances, levels, information)


def take_heading(state: WaterFilter, heading_rad: float, step_s: float) -> WaterFilter:
    """Return the state after step_s on this heading; unchanged if the heading is NaN."""
    if not (math.isfinite(heading_rad) and 0.0 < step_s < MAX_GAP_S):
        return state
    return WaterFilter(
        state.t_s,
        state.cosine_s + step_s * math.cos(heading_rad),
        state.sine_s + step_s * math.sin(heading_rad),
        state.known_s + step_s,
        state.refused_t_s,
        state.means,
        state.covariances,
        state.levels,
        state.information,
    )


def mean_heading(state: WaterFilter, t_s: float) -> tuple[float, float]:
    """Return the means of the heading's cosine and sine since the last position; NaN if it is not known long enough."""
    if state.known_s <= 0.0 or state.known_s < MIN_KNOWN_SHARE * (t_s - state.t_s):
        return math.nan, math.nan
    return state.cosine_s / state.known_s, state.sine_s / state.known_s


def learn(levels: Floats, information: Floats, likelihoods: Floats, step_s: float) -> None:
    """Update levels and information, in place, with the log-likelihoods (FILTERS,) of a position after step_s."""
    forgotten_share = min(step_s / MEMORY_S, 1.0)
    for i in range(LEVELS):
        prior_information, score = (
            1.0 / (PRIOR_SDS[i] * PRIOR_SDS[i]),
            (likelihoods[i + 1] - likelihoods[0]) / LEVEL_OFFSET,
        )
        information[i] += score * score + forgotten_share * (prior_information - information[i])
        change = (score + forgotten_share * prior_information * (PRIOR_LEVELS[i] - levels[i])) / information[i]
        levels[i] = clamp(levels[i] + clamp(change, -MAX_LEVEL_STEP, MAX_LEVEL_STEP), MIN_LEVELS[i], MAX_LEVELS[i])


def correct(state: WaterFilter, t_s: float, north_m: float, east_m: float) -> WaterFilter:
    """Return the state updated with a position; one that is not finite, or too early, is ignored."""
    step_s = t_s - state.t_s
    if not (MIN_INTERVAL_S <= step_s < math.inf and abs(north_m) < math.inf and abs(east_m) < math.inf):
        return state
    step_s = min(step_s, MAX_GAP_S)
    cosine, sine = mean_heading(state, t_s)
    means, covariances, is_restart = state.means.copy(), state.covariances.copy(), False
    levels, information, likelihoods = state.levels.copy(), state.information.copy(), np.zeros(FILTERS)
    for i in range(FILTERS):
        x, p, filter_levels = means[i], covariances[i], state.levels.copy()
        if i > 0:
            filter_levels[i - 1] += LEVEL_OFFSET
        predict(x, p, filter_levels, step_s, cosine, sine)
        if i == 0:
            d2, _ = squared_distance(x, p, north_m, east_m, math.exp(2.0 * filter_levels[3]) + GATE_SD_M * GATE_SD_M)
            is_restart = not d2 < GATE_SQUARE
            if is_restart and (math.isnan(state.refused_t_s) or t_s - state.refused_t_s < REJECTION_TIME_S):
                return with_rejected_position(state, t_s)
        if is_restart:
            restart_position(x, p, north_m, east_m)
        else:
            likelihoods[i] = update_state(x, p, filter_levels, north_m, east_m)
    if not (is_restart or math.isnan(cosine)):
        learn(levels, information, likelihoods, step_s)
    return WaterFilter(t_s, 0.0, 0.0, 0.0, math.nan, means, covariances, levels, information)


def with_rejected_position(state: WaterFilter, t_s: float) -> WaterFilter:
    """Return the state after a rejected position."""
    return WaterFilter(
        state.t_s,
        state.cosine_s,
        state.sine_s,
        state.known_s,
        t_s if math.isnan(state.refused_t_s) else state.refused_t_s,
        state.means,
        state.covariances,
        state.levels,
        state.information,
    )


def with_moved_origin(state: WaterFilter, north_m: float, east_m: float) -> WaterFilter:
    """Return the state for an origin that is north_m and east_m from the previous one."""
    means = state.means.copy()
    for number in range(FILTERS):
        means[number, NORTH] -= north_m
        means[number, EAST] -= east_m
    return WaterFilter(
        state.t_s,
        state.cosine_s,
        state.sine_s,
        state.known_s,
        state.refused_t_s,
        means,
        state.covariances,
        state.levels,
        state.information,
    )


def water_at(state: WaterFilter, t_s: float) -> Water:
    """Return speed, current and leeway at a time; for earlier times, those at the last position."""
    x, p, step_s = state.means[0], state.covariances[0], clamp(t_s - state.t_s, 0.0, MAX_GAP_S)
    decay, sigma, walk = math.exp(-step_s / SPEED_MEMORY_S), math.exp(state.levels[0]), math.exp(state.levels[1])
    u, v, north, east = float(x[MEAN_SPEED]), float(x[SIDEWAYS]), float(x[CURRENT_NORTH]), float(x[CURRENT_EAST])
    ss, su = float(p[SPEED, SPEED]), float(p[SPEED, MEAN_SPEED])
    ss = decay * decay * ss + sigma * sigma * (1.0 - decay * decay)
    uu = float(p[MEAN_SPEED, MEAN_SPEED]) + MEAN_WALK * MEAN_WALK * step_s
    vv, uv = float(p[SIDEWAYS, SIDEWAYS]) + SIDEWAYS_WALK * SIDEWAYS_WALK * step_s, float(p[MEAN_SPEED, SIDEWAYS])
    nn = float(p[CURRENT_NORTH, CURRENT_NORTH]) + walk * walk * step_s
    ee, ne = float(p[CURRENT_EAST, CURRENT_EAST]) + walk * walk * step_s, float(p[CURRENT_NORTH, CURRENT_EAST])
    half, half_difference = 0.5 * (nn + ee), 0.5 * (nn - ee)
    speed2 = max(u * u + v * v, MIN_SPEED_M_S * MIN_SPEED_M_S)
    leeway_variance = (u * u * vv - 2.0 * u * v * uv + v * v * uu) / (speed2 * speed2)
    return Water(
        u + decay * float(x[SPEED]),
        standard_deviation(uu + ss + 2.0 * decay * su),
        u,
        standard_deviation(uu),
        v,
        standard_deviation(vv),
        math.atan2(v, u),
        min(standard_deviation(leeway_variance), math.pi),
        north,
        east,
        standard_deviation(half + math.sqrt(half_difference * half_difference + ne * ne)),
        (
            nn, ne, float(p[MEAN_SPEED, CURRENT_NORTH]), float(p[SIDEWAYS, CURRENT_NORTH]),
            ee, float(p[MEAN_SPEED, CURRENT_EAST]), float(p[SIDEWAYS, CURRENT_EAST]),
            uu, uv, vv,
        ),
    )  # fmt: skip


def standard_deviation(variance: float) -> float:
    """Return the standard deviation; 0 for a variance that is negative by rounding."""
    return math.sqrt(max(variance, 0.0))
