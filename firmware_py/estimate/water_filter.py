"""Water filter: speed through the water, sideways speed and current from positions, with the heading as given.

Numeric core: functions over floats and tuples of floats, without I/O and without None; NaN stands for a value that is
absent. Python runs this text on the boat, and the laboratory compiles it as it stands (hil/lab/numeric_core.py).

State vector, 7: speed deviation s, mean speed U and sideways speed V (to starboard) through the water, current c_N and
c_E over the ground [m/s], position p_N and p_E [m]. With C and S, the means of cosine and sine of the heading:

    ds = -s / tau dt + sigma sqrt(2 / tau) dB1         dU = MEAN_WALK dB2        dV = SIDE_WALK dB3       dc = q dB4
    dp_N = ((s + U) C - V S + c_N) dt + g dB5          dp_E = ((s + U) S + V C + c_E) dt + g dB6

The model is linear, because the leeway atan2(V, U) is a quotient of two states. Measurement: a position, at most one in
EVERY_S, with white noise of standard deviation rho in each axis, which includes orbital motion and receiver noise. The
receiver's velocity is not used: receivers smooth it by a lag that is not known.

Levels, 4, as natural logarithms: sigma, q, g, rho. They are learned by recursive maximum likelihood. Beside the filter
run four more, each with one level higher by MOVE. The differences of their log-likelihoods are the scores. The sum of
the squared scores, with a memory of MEMORY_S, and the information of the prior are the information. A level
moves by score / information at each correction (Ljung and Soderstrom, Theory and Practice of Recursive
Identification, 1983, ch. 3).

Outliers: beyond HUBER2 (squared Mahalanobis distance) a position has less weight (Huber, Robust Statistics, 1981), and
beyond GATE2 none. When all positions are refused for REFUSED_S the position restarts there and the water stays.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from firmware_py.common.angles import clamp

Four = tuple[float, float, float, float]
Five = tuple[float, float, float, float, float]
Fifteen = tuple[float, float, float, float, float, float, float, float, float, float, float, float, float, float, float]

EVERY_S: Final = 4.5  # between two positions that are used: receiver noise is correlated for longer than a second
MEMORY_S: Final = 3600.0  # of the learning
MOVE: Final = 0.02
LONGEST_STEP: Final = 0.2  # of a level's logarithm, in one correction
# Middle, standard deviation and bounds of the logarithms: sigma [m/s], q [m/s/sqrt(s)], g [m/sqrt(s)], rho [m].
# The middle of g is for a receiver error of 1 m with a memory of 60 s: sqrt(2 / 60) m/sqrt(s).
START: Final = (math.log(0.1), math.log(0.0004), math.log(0.15), math.log(0.3))
SPREAD: Final = (0.7, 0.7, 1.0, 1.0)
LOW: Final = (math.log(0.01), math.log(0.0001), math.log(0.001), math.log(0.02))
HIGH: Final = (math.log(0.5), math.log(0.005), math.log(1.0), math.log(20.0))
SPEED_MEMORY_S: Final = 30.0  # tau
MEAN_WALK: Final = 0.001  # m/s/sqrt(s)
SIDE_WALK: Final = 0.0005
HUBER2: Final = 9.0  # chi-square of 2 degrees of freedom: 1.1 % of the positions are beyond it
GATE2: Final = 25.0  # 4e-6, with GATE_SD_M added in each axis, for a filter that has not yet learned rho
GATE_SD_M: Final = 3.0
REFUSED_S: Final = 30.0
MIN_SPEED_M_S: Final = 0.02  # below it the leeway is no angle
MIN_DETERMINANT_M4: Final = 1e-8  # that of the lowest rho is 1.6e-7
KNOWN_PART: Final = 0.9  # of the time between two positions in which the heading must be known
SUBSTEP_S: Final = 30.0
SUBSTEPS: Final = 20.0  # at most: a longer silence is taken in longer steps
LONGEST_S: Final = 86400.0


NO_FIVE: Final = (0.0, 0.0, 0.0, 0.0, 0.0)
NO_FIFTEEN: Final = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Track(NamedTuple):
    """Estimate of one filter: (s, U, V, c_N, c_E), position, and covariance in blocks.

    `water` is the covariance of the first five, upper triangle, row by row; `with_north` and `with_east` are their
    covariances with the position.
    """

    mean: Five = NO_FIVE
    north_m: float = 0.0
    east_m: float = 0.0
    water: Fifteen = NO_FIFTEEN
    with_north: Five = NO_FIVE
    with_east: Five = NO_FIVE
    north_m2: float = 0.0
    both_m2: float = 0.0
    east_m2: float = 0.0


NO_TRACK: Final = Track()


class WaterFilter(NamedTuple):
    """State: time of the last position, the estimate, the five filters of the learning, levels and information.

    `cosine_s` and `sine_s` are the integrals of the heading's cosine and sine since t_s, over `known_s` seconds.
    `refused_t_s` is the time of the first of the refused positions, NaN: the last one was used.
    """

    t_s: float = math.nan
    cosine_s: float = 0.0
    sine_s: float = 0.0
    known_s: float = 0.0
    refused_t_s: float = math.nan
    track: Track = NO_TRACK
    moved: tuple[Track, Track, Track, Track] = (NO_TRACK, NO_TRACK, NO_TRACK, NO_TRACK)
    levels: Four = START
    information: Four = (0.0, 0.0, 0.0, 0.0)


class Water(NamedTuple):
    """Speed (deviation and mean), mean speed, sideways speed, current [m/s], leeway [rad], standard deviations.

    `covariance`: upper triangle, row by row, of that of current north and east, mean speed and sideways speed.
    `current_sd_m_s` is that of the worse known direction.
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


def product(b: Fifteen, a: Five) -> Five:
    """Return B a, with the upper triangle b of a symmetric B."""
    return (
        b[0] * a[0] + b[1] * a[1] + b[2] * a[2] + b[3] * a[3] + b[4] * a[4],
        b[1] * a[0] + b[5] * a[1] + b[6] * a[2] + b[7] * a[3] + b[8] * a[4],
        b[2] * a[0] + b[6] * a[1] + b[9] * a[2] + b[10] * a[3] + b[11] * a[4],
        b[3] * a[0] + b[7] * a[1] + b[10] * a[2] + b[12] * a[3] + b[13] * a[4],
        b[4] * a[0] + b[8] * a[1] + b[11] * a[2] + b[13] * a[3] + b[14] * a[4],
    )


def dot(a: Five, b: Five) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4]


def combined(p: float, a: Five, q: float, b: Five) -> Five:
    """Return p a + q b."""
    return (
        p * a[0] + q * b[0],
        p * a[1] + q * b[1],
        p * a[2] + q * b[2],
        p * a[3] + q * b[3],
        p * a[4] + q * b[4],
    )


def without(b: Fifteen, f: Five, c: Five, g: Five, d: Five) -> Fifteen:
    """Return the upper triangle of B - f c' - g d', which is symmetric."""
    return (
        b[0] - f[0] * c[0] - g[0] * d[0],
        b[1] - f[0] * c[1] - g[0] * d[1],
        b[2] - f[0] * c[2] - g[0] * d[2],
        b[3] - f[0] * c[3] - g[0] * d[3],
        b[4] - f[0] * c[4] - g[0] * d[4],
        b[5] - f[1] * c[1] - g[1] * d[1],
        b[6] - f[1] * c[2] - g[1] * d[2],
        b[7] - f[1] * c[3] - g[1] * d[3],
        b[8] - f[1] * c[4] - g[1] * d[4],
        b[9] - f[2] * c[2] - g[2] * d[2],
        b[10] - f[2] * c[3] - g[2] * d[3],
        b[11] - f[2] * c[4] - g[2] * d[4],
        b[12] - f[3] * c[3] - g[3] * d[3],
        b[13] - f[3] * c[4] - g[3] * d[4],
        b[14] - f[4] * c[4] - g[4] * d[4],
    )


def aged(mean: Five, b: Fifteen, levels: Four, step_s: float) -> tuple[Five, Fifteen]:
    """Return mean and covariance of the water after a step."""
    keep, sigma, walk = math.exp(-step_s / SPEED_MEMORY_S), math.exp(levels[0]), math.exp(levels[1])
    current = walk * walk * step_s
    return (keep * mean[0], mean[1], mean[2], mean[3], mean[4]), (
        keep * keep * b[0] + sigma * sigma * (1.0 - keep * keep),
        keep * b[1],
        keep * b[2],
        keep * b[3],
        keep * b[4],
        b[5] + MEAN_WALK * MEAN_WALK * step_s,
        *(b[6], b[7], b[8]),
        b[9] + SIDE_WALK * SIDE_WALK * step_s,
        *(b[10], b[11]),
        b[12] + current,
        b[13],
        b[14] + current,
    )


def predicted(track: Track, levels: Four, step_s: float, cosine: float, sine: float) -> Track:
    """Return the estimate after a step with these means of the heading's cosine and sine; exact for the deviation s."""
    sigma, drift, keep = math.exp(levels[0]), math.exp(levels[2]), math.exp(-step_s / SPEED_MEMORY_S)
    way_s = SPEED_MEMORY_S * (1.0 - keep)  # in which the deviation at the beginning of the step leads as far
    north = (way_s * cosine, step_s * cosine, -step_s * sine, step_s, 0.0)
    east = (way_s * sine, step_s * sine, step_s * cosine, 0.0, step_s)
    by_north, by_east = product(track.water, north), product(track.water, east)
    rate = sigma * sigma * SPEED_MEMORY_S
    speed_way = rate * (1.0 - keep) * (1.0 - keep)
    way = max(rate * (2.0 * step_s - SPEED_MEMORY_S * (3.0 - 4.0 * keep + keep * keep)), 0.0)
    spread = drift * drift * step_s
    c, d = combined(1.0, track.with_north, 1.0, by_north), combined(1.0, track.with_east, 1.0, by_east)
    mean, water = aged(track.mean, track.water, levels, step_s)
    return Track(
        mean,
        track.north_m + dot(north, track.mean),
        track.east_m + dot(east, track.mean),
        water,
        (keep * c[0] + speed_way * cosine, c[1], c[2], c[3], c[4]),
        (keep * d[0] + speed_way * sine, d[1], d[2], d[3], d[4]),
        track.north_m2 + dot(north, track.with_north) + dot(north, c) + way * cosine * cosine + spread,
        track.both_m2 + dot(north, track.with_east) + dot(east, c) + way * cosine * sine,
        track.east_m2 + dot(east, track.with_east) + dot(east, d) + way * sine * sine + spread,
    )


def advanced(track: Track, levels: Four, step_s: float, cosine: float, sine: float) -> Track:
    """Return the estimate after step_s; NaN for cosine and sine: the heading was not known.

    Without a heading the position may have gone anywhere and is no longer correlated with the water.
    """
    if math.isnan(cosine):
        mean, water = aged(track.mean, track.water, levels, step_s)
        nothing = (0.0, 0.0, 0.0, 0.0, 0.0)
        speed_m_s = track.mean[1] + track.mean[0]
        way2 = 0.5 * step_s * step_s * (speed_m_s * speed_m_s + track.water[0] + track.water[5] + track.water[9])
        return Track(
            mean,
            track.north_m + step_s * track.mean[3],
            track.east_m + step_s * track.mean[4],
            water,
            nothing,
            nothing,
            track.north_m2 + way2 + step_s * step_s * track.water[12],
            track.both_m2,
            track.east_m2 + way2 + step_s * step_s * track.water[14],
        )
    left_s, substep_s = step_s, max(SUBSTEP_S, step_s / SUBSTEPS)
    while left_s > 0.0:
        track = predicted(track, levels, min(left_s, substep_s), cosine, sine)
        left_s -= substep_s
    return track


def distance2(track: Track, north_m: float, east_m: float, noise_m2: float) -> tuple[float, float]:
    """Return the squared Mahalanobis distance of a position, and the determinant of its covariance."""
    a, b, c = track.north_m2 + noise_m2, track.both_m2, track.east_m2 + noise_m2
    x, y = north_m - track.north_m, east_m - track.east_m
    determinant = max(a * c - b * b, MIN_DETERMINANT_M4)
    return (c * x * x - 2.0 * b * x * y + a * y * y) / determinant, determinant


def corrected(track: Track, levels: Four, north_m: float, east_m: float) -> tuple[Track, float]:
    """Return the estimate with a position, and the log-likelihood of the position (Huber's)."""
    noise_m2 = math.exp(2.0 * levels[3])
    d2, determinant = distance2(track, north_m, east_m, noise_m2)
    likelihood = -0.5 * math.log(determinant)
    if d2 > HUBER2:
        likelihood -= math.sqrt(HUBER2 * d2) - 0.5 * HUBER2
        noise_m2 += (track.north_m2 + track.east_m2 + 2.0 * noise_m2) * 0.5 * (math.sqrt(d2 / HUBER2) - 1.0)
        _, determinant = distance2(track, north_m, east_m, noise_m2)
    else:
        likelihood -= 0.5 * d2
    w, v, u = (
        (track.east_m2 + noise_m2) / determinant,
        -track.both_m2 / determinant,
        (track.north_m2 + noise_m2) / determinant,
    )
    c, d = track.with_north, track.with_east
    f, g = combined(w, c, v, d), combined(v, c, u, d)
    x, y = north_m - track.north_m, east_m - track.east_m
    a, b, e = track.north_m2, track.both_m2, track.east_m2
    m, n, o, p = w * a + v * b, w * b + v * e, v * a + u * b, v * b + u * e  # W P
    return (
        Track(
            combined(1.0, track.mean, 1.0, combined(x, f, y, g)),
            track.north_m + m * x + o * y,
            track.east_m + n * x + p * y,
            without(track.water, f, c, g, d),
            combined(1.0, c, -1.0, combined(a, f, b, g)),
            combined(1.0, d, -1.0, combined(b, f, e, g)),
            a - a * m - b * o,
            b - a * n - b * p,
            e - b * n - e * p,
        ),
        likelihood,
    )


def restarted(track: Track, north_m: float, east_m: float, sd_m: float) -> Track:
    """Return the estimate with another position and the same water."""
    nothing = (0.0, 0.0, 0.0, 0.0, 0.0)
    return Track(track.mean, north_m, east_m, track.water, nothing, nothing, sd_m * sd_m, 0.0, sd_m * sd_m)


def higher(levels: Four, number: int) -> Four:
    """Return the levels with one higher by MOVE."""
    return (
        levels[0] + (MOVE if number == 0 else 0.0),
        levels[1] + (MOVE if number == 1 else 0.0),
        levels[2] + (MOVE if number == 2 else 0.0),
        levels[3] + (MOVE if number == 3 else 0.0),
    )


def learned(level: float, information: float, gain: float, number: int, step_s: float) -> tuple[float, float]:
    """Return a level and its information after a correction with this gain of log-likelihood by the filter moved."""
    forget = min(step_s / MEMORY_S, 1.0)
    prior = 1.0 / (SPREAD[number] * SPREAD[number])
    score = gain / MOVE
    information = information + score * score + forget * (prior - information)
    change = (score + forget * prior * (START[number] - level)) / information
    return clamp(level + clamp(change, -LONGEST_STEP, LONGEST_STEP), LOW[number], HIGH[number]), information


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
    """Return the state at a first position, with the water that is expected and its standard deviations."""
    sigma, current = math.exp(START[0]), current_sd_m_s * current_sd_m_s
    water = (
        *(sigma * sigma, 0.0, 0.0, 0.0, 0.0),
        *(speed_sd_m_s * speed_sd_m_s, 0.0, 0.0, 0.0),
        *(sideways_sd_m_s * sideways_sd_m_s, 0.0, 0.0),
        *(current, 0.0, current),
    )
    mean, nothing = (0.0, speed_m_s, sideways_m_s, current_north_m_s, current_east_m_s), (0.0, 0.0, 0.0, 0.0, 0.0)
    noise_m2 = math.exp(2.0 * START[3])
    track = Track(mean, north_m, east_m, water, nothing, nothing, noise_m2, 0.0, noise_m2)
    information = (
        1.0 / (SPREAD[0] * SPREAD[0]),
        1.0 / (SPREAD[1] * SPREAD[1]),
        1.0 / (SPREAD[2] * SPREAD[2]),
        1.0 / (SPREAD[3] * SPREAD[3]),
    )
    return WaterFilter(t_s, 0.0, 0.0, 0.0, math.nan, track, (track, track, track, track), START, information)


def take_heading(state: WaterFilter, heading_rad: float, step_s: float) -> WaterFilter:
    """Return the state after step_s on this heading; NaN: not known."""
    if not (math.isfinite(heading_rad) and 0.0 < step_s < LONGEST_S):
        return state
    return WaterFilter(
        state.t_s,
        state.cosine_s + step_s * math.cos(heading_rad),
        state.sine_s + step_s * math.sin(heading_rad),
        state.known_s + step_s,
        state.refused_t_s,
        state.track,
        state.moved,
        state.levels,
        state.information,
    )


def mean_heading(state: WaterFilter, t_s: float) -> tuple[float, float]:
    """Return the means of the heading's cosine and sine since the last position, NaN when too little of it is known."""
    if state.known_s <= 0.0 or state.known_s < KNOWN_PART * (t_s - state.t_s):
        return math.nan, math.nan
    return state.cosine_s / state.known_s, state.sine_s / state.known_s


def refused(state: WaterFilter, t_s: float) -> WaterFilter:
    """Return the state with a position noted as refused and not used."""
    since_s = t_s if math.isnan(state.refused_t_s) else state.refused_t_s
    return WaterFilter(
        state.t_s,
        state.cosine_s,
        state.sine_s,
        state.known_s,
        since_s,
        state.track,
        state.moved,
        state.levels,
        state.information,
    )


def correct(state: WaterFilter, t_s: float, north_m: float, east_m: float) -> WaterFilter:
    """Return the state at a position; the same state for one that is no number or comes too soon."""
    step_s = t_s - state.t_s
    if not (EVERY_S <= step_s < math.inf and abs(north_m) < math.inf and abs(east_m) < math.inf):
        return state
    step_s = min(step_s, LONGEST_S)
    cosine, sine = mean_heading(state, t_s)
    levels = state.levels
    track = advanced(state.track, levels, step_s, cosine, sine)
    d2, _ = distance2(track, north_m, east_m, math.exp(2.0 * levels[3]) + GATE_SD_M * GATE_SD_M)
    restart = False
    if not d2 < GATE2:
        if math.isnan(state.refused_t_s) or t_s - state.refused_t_s < REFUSED_S:
            return refused(state, t_s)
        restart = True
    a, b, c, d = (
        advanced(state.moved[0], higher(levels, 0), step_s, cosine, sine),
        advanced(state.moved[1], higher(levels, 1), step_s, cosine, sine),
        advanced(state.moved[2], higher(levels, 2), step_s, cosine, sine),
        advanced(state.moved[3], higher(levels, 3), step_s, cosine, sine),
    )
    information = state.information
    if restart:
        track = restarted(track, north_m, east_m, GATE_SD_M)
        a, b, c, d = (
            restarted(a, north_m, east_m, GATE_SD_M),
            restarted(b, north_m, east_m, GATE_SD_M),
            restarted(c, north_m, east_m, GATE_SD_M),
            restarted(d, north_m, east_m, GATE_SD_M),
        )
    else:
        track, likelihood = corrected(track, levels, north_m, east_m)
        a, by_a = corrected(a, higher(levels, 0), north_m, east_m)
        b, by_b = corrected(b, higher(levels, 1), north_m, east_m)
        c, by_c = corrected(c, higher(levels, 2), north_m, east_m)
        d, by_d = corrected(d, higher(levels, 3), north_m, east_m)
        if not math.isnan(cosine):
            l0, i0 = learned(levels[0], information[0], by_a - likelihood, 0, step_s)
            l1, i1 = learned(levels[1], information[1], by_b - likelihood, 1, step_s)
            l2, i2 = learned(levels[2], information[2], by_c - likelihood, 2, step_s)
            l3, i3 = learned(levels[3], information[3], by_d - likelihood, 3, step_s)
            levels, information = (l0, l1, l2, l3), (i0, i1, i2, i3)
    return WaterFilter(t_s, 0.0, 0.0, 0.0, math.nan, track, (a, b, c, d), levels, information)


def move_origin(track: Track, north_m: float, east_m: float) -> Track:
    """Return the estimate for an origin that lies north_m and east_m from the one before."""
    return Track(
        track.mean,
        track.north_m - north_m,
        track.east_m - east_m,
        track.water,
        track.with_north,
        track.with_east,
        track.north_m2,
        track.both_m2,
        track.east_m2,
    )


def moved_origin(state: WaterFilter, north_m: float, east_m: float) -> WaterFilter:
    """Return the state for an origin that lies north_m and east_m from the one before."""
    return WaterFilter(
        state.t_s,
        state.cosine_s,
        state.sine_s,
        state.known_s,
        state.refused_t_s,
        move_origin(state.track, north_m, east_m),
        (
            move_origin(state.moved[0], north_m, east_m),
            move_origin(state.moved[1], north_m, east_m),
            move_origin(state.moved[2], north_m, east_m),
            move_origin(state.moved[3], north_m, east_m),
        ),
        state.levels,
        state.information,
    )


def water_of(state: WaterFilter, t_s: float) -> Water:
    """Return the water at a time, not before that of the last position."""
    mean, b = aged(state.track.mean, state.track.water, state.levels, clamp(t_s - state.t_s, 0.0, LONGEST_S))
    s, u, v, north, east = mean
    half, differ = 0.5 * (b[12] + b[14]), 0.5 * (b[12] - b[14])
    way2 = max(u * u + v * v, MIN_SPEED_M_S * MIN_SPEED_M_S)
    leeway2 = (u * u * b[9] - 2.0 * u * v * b[6] + v * v * b[5]) / (way2 * way2)
    return Water(
        u + s,
        deviation(b[5] + b[0] + 2.0 * b[1]),
        u,
        deviation(b[5]),
        v,
        deviation(b[9]),
        math.atan2(v, u),
        min(deviation(leeway2), math.pi),
        north,
        east,
        deviation(half + math.sqrt(differ * differ + b[13] * b[13])),
        (b[12], b[13], b[7], b[10], b[14], b[8], b[11], b[5], b[6], b[9]),
    )


def deviation(variance: float) -> float:
    """Return the standard deviation; 0 for a variance below 0 by rounding."""
    return math.sqrt(max(variance, 0.0))
